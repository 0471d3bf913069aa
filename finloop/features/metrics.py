"""Summarise a feature table: Table 1, errors against ground truth, plausibility."""

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask
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
_LONG_FRAMES = 60  # frames of a track that counts as a long one
_JUMP_DEG = 45.0  # from frame to frame; an animal turns less


def orientation_table(features: pd.DataFrame) -> pd.DataFrame:
    """Return Table 1 of the fish paper: a row per orientation, with its shares of swimming types.

    Columns: `orientation`; `straight_pct`, `right_pct`, `left_pct`: percent of the orientation's
    frames; `max_area_right`, `max_area_left`: its largest motion area in such turns, as a share of
    the film's largest, 0 without such turns; `amount_pct`: percent of all frames. The amounts sum
    to 100 (the paper's own do not: 99.87). An orientation without frames has amount 0, all else is
    NaN.
    """
    film_areas = features.groupby("swimming_type")["motion_area"].max()
    rows = []
    for number in range(1, count_orientations(features) + 1):
        frames = features[features["orientation"] == number]
        row: dict[str, float] = {"orientation": number}
        for word, swimming_type in (("straight", STRAIGHT), ("right", RIGHT), ("left", LEFT)):
            frames_of_type = frames[frames["swimming_type"] == swimming_type]
            share = len(frames_of_type) / len(frames) if len(frames) else np.nan
            row[f"{word}_pct"] = 100 * share
            if swimming_type != STRAIGHT:
                area = frames_of_type["motion_area"].max() / film_areas.get(swimming_type, np.nan)
                row[f"max_area_{word}"] = 0.0 if share == 0 else area
        row["amount_pct"] = 100 * len(frames) / len(features)
        rows.append(row)
    return pd.DataFrame(rows)


def rows_of_longest_track(features: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the longest track; of equally long ones, that with the lowest number."""
    return features[features["track_id"] == features["track_id"].mode()[0]]


def summarize_features(features: pd.DataFrame) -> dict[str, float]:
    """Return counts, medians and shares of a feature table, by name of the metric."""
    track_frames = features.groupby("track_id").size()
    swimming_type = features["swimming_type"]
    return {
        "fish_frames": len(features),
        "tracks": len(track_frames),
        f"fish_frames_in_tracks_of_{_LONG_FRAMES}_frames": int(
            track_frames[track_frames >= _LONG_FRAMES].sum()
        ),
        "body_length_median_px": float(features["body_length_px"].median()),
        "straight_pct": float(100 * (swimming_type == STRAIGHT).mean()),
        "left_pct": float(100 * (swimming_type == LEFT).mean()),
        "right_pct": float(100 * (swimming_type == RIGHT).mean()),
        "orientations_seen": int(features["orientation"].nunique()),
        "motion_area_max_body_lengths_2": float(features["motion_area"].max()),
        "displacement_median_body_lengths": float(features["displacement"].median()),
        "head_confidence_min": float(features["head_confidence"].min()),
        "head_confidence_below_0_9_pct": float(100 * (features["head_confidence"] < 0.9).mean()),
        "heading_jumps_pct": measure_heading_jumps(features),
        "frames_per_beat": measure_frames_per_beat(features),
        **measure_heading_agreement(features),
    }


def measure_frames_per_beat(features: pd.DataFrame) -> float:
    """Return how many frames a tail beat lasts, judged by the changes of bend.

    A sine of n frames a period differs from the mean of its neighbours by the share
    1 − cos(2π / n) of itself; this share is fitted to all frames with both neighbours, by least
    squares. Bends without any order give 4. NaN without such frames, or if nothing bends.
    """
    track, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    bend = features["bend"].to_numpy(float)
    bend = bend - features.groupby("track_id")["bend"].transform("mean").to_numpy(float)
    middle = np.flatnonzero((track[2:] == track[:-2]) & (frame[2:] - frame[:-2] == 2)) + 1
    neighbour_mean = (bend[middle - 1] + bend[middle + 1]) / 2
    square = float(np.sum(bend[middle] ** 2))
    if not square:
        return float("nan")
    share = float(np.sum((bend[middle] - neighbour_mean) * bend[middle])) / square
    return float(2 * np.pi / np.arccos(np.clip(1 - share, -1, 1 - 1e-9)))


def measure_heading_jumps(features: pd.DataFrame) -> float:
    """Return the percentage of steps from frame to frame in which a heading turns by over 45°.

    Where it is large, headings are not those of the animals. NaN if no track has two frames.
    """
    turn_deg = np.abs(wrap_deg(np.diff(features["heading_deg"].to_numpy(float))))
    track, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    steps = turn_deg[(np.diff(track) == 0) & (np.diff(frame) == 1)]
    return float(100 * (steps > _JUMP_DEG).mean()) if steps.size else float("nan")


def metrics_in_mm(
    features: pd.DataFrame, tank_px: tuple[int, int], rate_hz: float, mm_per_px: float
) -> dict[str, float]:
    """Return body length, median speed and tank size in millimetres, by name of the metric.

    tank_px: width and height; rate_hz: frames per second. The speed is the displacement over the
    time Δ; NaN where no track is as long as Δ.
    """
    distance_px = float((features["displacement"] * features["body_length_px"]).median())
    speed = distance_px * mm_per_px * rate_hz / infer_delta_frames(features)
    return {
        "body_length_median_mm": float(features["body_length_px"].median()) * mm_per_px,
        "speed_median_mm_s": speed,
        "tank_width_mm": tank_px[0] * mm_per_px,
        "tank_height_mm": tank_px[1] * mm_per_px,
    }


def measure_heading_agreement(features: pd.DataFrame) -> dict[str, float]:
    """Return how well headings agree with the direction of motion, by name of the metric.

    Only rows (a fish in one frame) that move by 0.1 body lengths in the time Δ count. The metrics
    are their number, the percentage headed within 90° of their motion, and the median angle between
    both. The heading is that in the middle of Δ. Swapped heads and tails lower the percentage. If
    no row moves, or the fish swim against a current, there is only the number, 0.
    """
    delta = infer_delta_frames(features)
    moving = np.flatnonzero(features["displacement"] > _MOVING)  # rows at the beginning of Δ
    if moving.size == 0 or features["current"].any():
        return {"moving_fish_frames": 0}
    place = features[["x_px", "y_px"]].to_numpy()
    dx, dy = (place[moving + delta] - place[moving]).T
    travel_deg = np.degrees(np.arctan2(-dy, dx))
    heading_deg = features["heading_deg"].to_numpy()[moving + delta // 2]
    difference_deg = np.abs(wrap_deg(heading_deg - travel_deg))
    return {
        "moving_fish_frames": int(moving.size),
        "headed_along_travel_pct": float(100 * (difference_deg <= 90).mean()),
        "heading_off_travel_median_deg": float(np.median(difference_deg)),
    }


def compare_with_truth(
    features: pd.DataFrame, backbones: np.ndarray, truth: pd.DataFrame
) -> dict[str, float]:
    """Return the errors of measured features against the drawn carp's truth, by name.

    backbones (rows, n, 2): px, head first, in the table's order; truth: a row per carp per frame.
    Each measured fish is compared with the nearest carp of its frame. A backbone's error is the
    mean distance of its points from the true points at the same shares of the length. Where it is
    smaller with head and tail exchanged, that error counts, and the swap is counted.
    """
    fish_rows, true_rows = _pair_with_truth(features, truth)
    fish = features.iloc[fish_rows].reset_index(drop=True)
    true = truth.iloc[true_rows].reset_index(drop=True)
    length = true["body_length_px"].to_numpy(float)
    distance_px, swapped = _compare_backbones(backbones[fish_rows], true)
    backbone_error = distance_px / length
    centre = np.hypot(fish["x_px"] - true["x_px"], fish["y_px"] - true["y_px"])
    heading_error = np.abs(wrap_deg(fish["heading_deg"] - true["heading_deg"]))
    fish_length = fish["body_length_px"].to_numpy(float)
    agree = fish["swimming_type"] == true["swimming_type"]
    same_track = np.diff(fish["track_id"]) == 0
    area_rank = fish["motion_area"].rank()
    return {
        "truth_fish_frames": len(truth),
        "truth_found_pct": float(100 * len(fish) / len(truth)),
        "truth_centre_error_median_px": float(np.median(centre)),
        "truth_centre_error_p95_px": float(np.quantile(centre, 0.95)),
        "truth_backbone_error_mean_pct": float(100 * backbone_error.mean()),
        "truth_backbone_error_p95_pct": float(100 * np.quantile(backbone_error, 0.95)),
        "truth_body_length_bias_pct": float(100 * (fish_length / length - 1).mean()),
        "truth_heading_error_median_deg": float(np.median(heading_error)),
        "truth_heading_error_p95_deg": float(np.quantile(heading_error, 0.95)),
        "truth_head_tail_swaps": int(swapped.sum()),
        "truth_identity_changes": int((same_track & (np.diff(true["fish_id"]) != 0)).sum()),
        "truth_swimming_type_agreement_pct": float(100 * agree.mean()),
        **{
            f"truth_{word}_recall_pct": float(100 * agree[true["swimming_type"] == number].mean())
            for word, number in (("straight", STRAIGHT), ("left", LEFT), ("right", RIGHT))
            if (true["swimming_type"] == number).any()
        },
        **{
            f"truth_motion_area_{word}_rank_correlation": float(
                np.corrcoef(area_rank, true[column].abs().rank())[0, 1]
            )
            for word, column in (("bend", "bend"), ("curvature", "curvature_deg"))
        },
    }


def compare_heads_with_external(
    tracks: pd.DataFrame, given: pd.DataFrame, rate_hz: float
) -> dict[str, float]:
    """Return how well another program's heads agree with ours, by name of the metric.

    `head_told_share` is the share of rows in which the program gives a head. If there are any, two
    more describe them: `head_disagreement_share`, the share in which it calls our tail the head,
    and `head_disagreement_median_deg`, the angle between the two directions from tail to head. If
    it gives no tail, the middle of the backbone is used. tracks: the columns
    `finloop.features.table.USED`; given: places of heads and tails, the same rows.
    """
    backbones, _ = orient_backbones(tracks, rate_hz)
    head, tail = read_head_and_tail(given)
    tail = np.where(np.isfinite(tail), tail, backbones[:, backbones.shape[1] // 2])
    ours, theirs = backbones[:, 0] - backbones[:, -1], head - tail
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
    """Return the mean distance (rows,) of lines a and b (rows, n, 2), point by point."""
    return np.hypot(*(a - b).transpose(2, 0, 1)).mean(1)


def _compare_backbones(backbones: np.ndarray, true: pd.DataFrame) -> tuple[Floats, Mask]:
    """Return the mean error (k,) [px] of k backbones, and a mask of those that run tail to head.

    A distance is the mean over the points, at equal shares of the length; a backbone that is nearer
    the other way round is turned first. backbones (k, n, 2): px; true: rows of the truth.
    """
    true_lines = lists_to_points(true, "backbone")
    places = np.linspace(0, true_lines.shape[1] - 1, backbones.shape[1])
    true_lines = interpolate_lines(true_lines, places)
    distance = _mean_line_distance(backbones, true_lines)
    swapped_distance = _mean_line_distance(backbones[:, ::-1], true_lines)
    return np.minimum(distance, swapped_distance), distance > swapped_distance


def _pair_with_truth(features: pd.DataFrame, truth: pd.DataFrame) -> np.ndarray:
    """Return pairs of row numbers (2, k): a measured fish, and the nearest true fish.

    Measured fish in frames without a true fish are left out.
    """
    fish = features[["frame", "x_px", "y_px"]].assign(fish=np.arange(len(features)))
    true = truth[["frame", "x_px", "y_px"]].assign(true=np.arange(len(truth)))
    pairs = fish.merge(true, on="frame", suffixes=("", "_true"))
    pairs["distance"] = np.hypot(
        pairs["x_px"] - pairs["x_px_true"], pairs["y_px"] - pairs["y_px_true"]
    )
    nearest = pairs.loc[pairs.groupby("fish")["distance"].idxmin()]
    return nearest[["fish", "true"]].to_numpy().T
