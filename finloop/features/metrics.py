"""Metrics of a feature table: Table 1, errors against ground truth, plausibility."""

import numpy as np
import pandas as pd

from finloop.base.schema import lists_to_points
from finloop.features.area import interpolate_lines
from finloop.features.swimming_type import LEFT, RIGHT, STRAIGHT
from finloop.features.table import (
    count_orientations,
    infer_delta_frames,
    orient_backbones,
    read_head_and_tail,
    wrap_deg,
)  # fmt: skip

_MOVING = 0.1  # body lengths in Δ from which a fish has a direction of travel


def orientation_table(features: pd.DataFrame) -> pd.DataFrame:
    """Return Table 1 of the fish paper: a row per orientation, its frames by swimming type in %.

    `max_area_…` is the largest motion area relative to the clip's largest of that type of turn;
    `amount_pct` is the orientation's share of all frames. Straight + right + left is 100 in a row,
    and the amounts sum to 100 (the paper's own do not: 101.45 in row 23, 99.87). Shares and areas
    of an orientation without frames are empty.
    """
    rows = []
    for number in range(1, count_orientations(features) + 1):
        here = features[features["orientation"] == number]
        row: dict[str, float] = {"orientation": number}
        for word, kind in (("straight", STRAIGHT), ("right", RIGHT), ("left", LEFT)):
            of_kind = here["swimming_type"] == kind
            row[f"{word}_pct"] = 100 * of_kind.mean() if len(here) else np.nan
            if kind != STRAIGHT:
                largest = features.loc[features["swimming_type"] == kind, "motion_area"].max()
                area = here.loc[of_kind, "motion_area"].max() / largest
                row[f"max_area_{word}"] = (0.0 if np.isnan(area) else area) if len(here) else np.nan
        row["amount_pct"] = 100 * len(here) / len(features)
        rows.append(row)
    return pd.DataFrame(rows)


def rows_of_longest_track(features: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the track with the most frames."""
    return features[features["track_id"] == features["track_id"].mode()[0]]


def summarize_features(features: pd.DataFrame, long_frames: int = 60) -> dict[str, float]:
    """Return counts, medians and shares of a feature table by name, for metrics.json.

    long_frames: frames from which a track counts as a long one.
    """
    lengths = features.groupby("track_id").size()
    kinds = features["swimming_type"]
    return {
        "fish_frames": len(features),
        "tracks": len(lengths),
        f"fish_frames_in_tracks_of_{long_frames}_frames": int(
            lengths[lengths >= long_frames].sum()
        ),
        "body_length_median_px": float(features["body_length_px"].median()),
        "straight_pct": float(100 * (kinds == STRAIGHT).mean()),
        "left_pct": float(100 * (kinds == LEFT).mean()),
        "right_pct": float(100 * (kinds == RIGHT).mean()),
        "orientations_seen": int(features["orientation"].nunique()),
        "motion_area_max_body_lengths_2": float(features["motion_area"].max()),
        "displacement_median_body_lengths": float(features["displacement"].median()),
        "head_confidence_min": float(features["head_confidence"].min()),
        "head_confidence_below_0_9_pct": float(100 * (features["head_confidence"] < 0.9).mean()),
        **measure_heading_agreement(features),
    }


def metrics_in_mm(
    features: pd.DataFrame, tank_px: tuple[int, int], rate_hz: float, mm_per_px: float
) -> dict[str, float]:
    """Return body length, median speed and tank size in millimetres by name, for metrics.json.

    tank_px: width and height; rate_hz: frames per second. The speed is the displacement over the
    time Δ; NaN where no track is as long as Δ.
    """
    speed = features["displacement"] * features["body_length_px"]
    return {
        "body_length_median_mm": float(features["body_length_px"].median()) * mm_per_px,
        "speed_median_mm_s": float(speed.median())
        * mm_per_px
        * rate_hz
        / infer_delta_frames(features),
        "tank_width_mm": tank_px[0] * mm_per_px,
        "tank_height_mm": tank_px[1] * mm_per_px,
    }


def measure_heading_agreement(features: pd.DataFrame) -> dict[str, float]:
    """Return how well headings agree with the direction of motion, by name, for metrics.json.

    Only rows (a fish in one frame) that move count: their number, the share headed within 90° of
    their motion, and the median angle. Swapped heads and tails lower the share. The motion is
    measured over the time Δ, the heading in the middle of it. In a current the film shows no such
    motion.
    """
    delta = infer_delta_frames(features)
    start = np.flatnonzero(features["displacement"] > _MOVING)
    if start.size == 0 or features["current"].any():
        return {"moving_fish_frames": 0}
    x, y = features["x_px"].to_numpy(), features["y_px"].to_numpy()
    way = np.degrees(np.arctan2(-(y[start + delta] - y[start]), x[start + delta] - x[start]))
    off = np.abs(wrap_deg(features["heading_deg"].to_numpy()[start + delta // 2] - way))
    return {
        "moving_fish_frames": int(start.size),
        "headed_along_travel_pct": float(100 * (off <= 90).mean()),
        "heading_off_travel_median_deg": float(np.median(off)),
    }


def compare_with_truth(
    features: pd.DataFrame, backbones: np.ndarray, truth: pd.DataFrame
) -> dict[str, float]:
    """Return the errors of measured features against the drawn carp's truth, for metrics.json.

    backbones (rows, n, 2): px, head first, in the table's order; truth: a row per carp per frame.
    Each measured fish is compared with the nearest carp of its frame. A backbone's error is the
    mean distance of its points from the true points at the same shares of the length.
    """
    found, nearest = _pair_with_truth(features, truth)
    fish, true = features.iloc[found], truth.iloc[nearest]
    length = true["body_length_px"].to_numpy(float)
    lines = lists_to_points(true, "backbone")
    lines = interpolate_lines(lines, np.linspace(0, lines.shape[1] - 1, backbones.shape[1]))
    own = backbones[found]
    as_it_is, exchanged = _mean_line_distance(own, lines), _mean_line_distance(own[:, ::-1], lines)
    swapped, apart = as_it_is > exchanged, np.minimum(as_it_is, exchanged) / length
    fish, true = fish.reset_index(drop=True), true.reset_index(drop=True)
    centre = np.hypot(fish["x_px"] - true["x_px"], fish["y_px"] - true["y_px"])
    off = np.abs(wrap_deg(fish["heading_deg"] - true["heading_deg"]))
    fish_length = fish["body_length_px"].to_numpy(float)
    agree = fish["swimming_type"] == true["swimming_type"]
    same_track = np.diff(fish["track_id"]) == 0
    area = fish["motion_area"].rank()
    return {
        "truth_fish_frames": len(truth),
        "truth_found_pct": float(100 * len(found) / len(truth)),
        "truth_centre_error_median_px": float(np.median(centre)),
        "truth_centre_error_p95_px": float(np.quantile(centre, 0.95)),
        "truth_backbone_error_mean_pct": float(100 * apart.mean()),
        "truth_backbone_error_p95_pct": float(100 * np.quantile(apart, 0.95)),
        "truth_body_length_bias_pct": float(100 * (fish_length / length - 1).mean()),
        "truth_heading_error_median_deg": float(np.median(off)),
        "truth_heading_error_p95_deg": float(np.quantile(off, 0.95)),
        "truth_head_tail_swaps": int(swapped.sum()),
        "truth_identity_changes": int((same_track & (np.diff(true["fish_id"]) != 0)).sum()),
        "truth_swimming_type_agreement_pct": float(100 * agree.mean()),
        **{
            f"truth_{word}_recall_pct": float(100 * agree[true["swimming_type"] == kind].mean())
            for word, kind in (("straight", STRAIGHT), ("left", LEFT), ("right", RIGHT))
            if (true["swimming_type"] == kind).any()
        },
        **{
            f"truth_motion_area_{word}_rank_correlation": float(
                np.corrcoef(area, true[column].abs().rank())[0, 1]
            )
            for word, column in (("bend", "bend"), ("curvature", "curvature_deg"))
        },
    }


def compare_heads_with_external(
    tracks: pd.DataFrame, given: pd.DataFrame, rate_hz: float
) -> dict[str, float]:
    """Return how well another program's heads agree with ours, by name, for metrics.json.

    The metrics are the share of rows in which the program gives a head, the share in which it calls
    our tail the head, and the median angle between the two directions from tail to head. Where it
    gives no tail, the middle of the backbone is used. tracks: the columns
    `finloop.features.table.USED`; given: schema GIVEN, the same rows.
    """
    own, _ = orient_backbones(tracks, rate_hz)
    head, tail = read_head_and_tail(given)
    tail = np.where(np.isfinite(tail), tail, own[:, own.shape[1] // 2])
    ours, theirs = own[:, 0] - own[:, -1], head - tail
    comparable = np.isfinite(theirs).all(axis=1)
    if not comparable.any():
        return {"head_told_share": 0.0}
    cross = ours[:, 0] * theirs[:, 1] - ours[:, 1] * theirs[:, 0]
    angle = np.degrees(np.abs(np.arctan2(cross, (ours * theirs).sum(axis=1))))[comparable]
    return {
        "head_told_share": float(comparable.mean()),
        "head_disagreement_share": float((angle > 90).mean()),
        "head_disagreement_median_deg": float(np.median(angle)),
    }


def _mean_line_distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the mean distance (rows,) of corresponding points of lines a and b (rows, n, 2)."""
    return np.hypot(*(a - b).transpose(2, 0, 1)).mean(1)


def _pair_with_truth(features: pd.DataFrame, truth: pd.DataFrame) -> np.ndarray:
    """Return pairs (2, k) of row numbers: measured fish, and nearest true fish of the frame."""
    fish = features[["frame", "x_px", "y_px"]].assign(fish=np.arange(len(features)))
    true = truth[["frame", "x_px", "y_px"]].assign(true=np.arange(len(truth)))
    both = fish.merge(true, on="frame", suffixes=("", "_true"))
    both["apart"] = np.hypot(both["x_px"] - both["x_px_true"], both["y_px"] - both["y_px_true"])
    best = both.loc[both.groupby("fish")["apart"].idxmin()]
    return best[["fish", "true"]].to_numpy().T
