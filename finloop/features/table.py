"""Tracks → the feature table, one row per fish per frame (fish paper §2.2-2.3, Fig. 7, Table 1).

Glossary: Δ the time over which motion is measured (`finloop.features.memory`); *included angle* the
change of heading over the next Δ; *bend* the signed motion area. Angles are degrees,
anticlockwise as seen on screen, 0 = to the right.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Reals
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema, columns, lists_to_array, lists_to_points
from finloop.features.area import interpolate_lines, measure_bend
from finloop.features.current import measure_current, places_through_water
from finloop.features.head import decide_head_end, match_head_end
from finloop.features.memory import measure_delta_s
from finloop.features.settings import FeaturesSettings
from finloop.features.swimming_type import (
    TurnThresholds,
    classify_swimming_types,
    heading_change,
    measure_turn_thresholds,
)

_STEPS = 5  # natural steps in Δ, as in the paper's film
_HEAD_SHARE = 1 / 3  # of the body; the head is bone and does not bend (§2.2)

USED = (
    "track_id", "frame", "x_px", "y_px", "length_px",
    "backbone_x_px", "backbone_y_px", "half_width_px",
)  # fmt: skip
"""The columns of a table of tracks from which features are computed."""

FEATURES = Schema(
    *columns("int32", "1", "track_id", "frame"),
    Column("time_s", "float64", "s"),
    *columns("float64", "px", "x_px", "y_px"),
    *columns("float32", "px", "head_x_px", "head_y_px", "tail_x_px", "tail_y_px"),
    Column("heading_deg", "float32", "deg"),
    *columns("int8", "1", "orientation", "orientations"),
    Column("body_length_px", "float32", "px"),
    Column("motion_area", "float32", "body length²"),
    Column("motion_area_rel", "float32", "1"),
    Column("bend", "float32", "body length²"),
    Column("displacement", "float32", "body length", nullable=True),
    Column("included_angle_deg", "float32", "deg", nullable=True),
    Column("current", "float32", "body length/s"),
    Column("swimming_type", "int8", "1"),
    Column("head_confidence", "float32", "1"),
)


def delta_in_frames(delta_s: float, rate_hz: float) -> int:
    """Return Δ, the time over which motion is measured, in whole frames, at least 1."""
    return max(1, round(delta_s * rate_hz))


def infer_delta_frames(features: pd.DataFrame) -> int:
    """Return Δ, the time [frames] over which the displacements of a feature table were measured.

    A displacement needs a frame Δ later, so the empty ones at the end of the longest track are
    counted.
    """
    return int(features["displacement"].isna().groupby(features["track_id"]).sum().max())


def natural_step_frames(features: pd.DataFrame) -> int:
    """Return the frames of a natural step, the unit in which picture distances are given.

    It is Δ / 5, at least 1: one frame of the paper's film (25 Hz, Δ of 5 frames). The step from
    frame to frame would shrink with a faster camera.
    """
    return max(1, round(infer_delta_frames(features) / _STEPS))


def wrap_deg(angle_deg: Reals) -> Floats:
    """Return angles [°] of any shape, wrapped to (−180, 180]."""
    return 180.0 - (180.0 - np.asarray(angle_deg, float)) % 360.0


def find_orientations(heading_deg: Reals, orientations: int) -> NDArray[np.int8]:
    """Return the numbers, 1 … `orientations`, of the sectors in which headings [°] lie (§3.3).

    Sector 1 is centred on 0°, to the right; numbers rise anticlockwise. The paper has 24 (Table 1).
    """
    sector = 360 / orientations
    return (np.floor(np.asarray(heading_deg) / sector + 0.5) % orientations + 1).astype(np.int8)


def orientation_heading_deg(orientation: NDArray[np.integer] | int, orientations: int) -> Floats:
    """Return the heading [°], in [0, 360), at the centre of an orientation, 1 … `orientations`."""
    return (np.asarray(orientation, float) - 1) * (360 / orientations)


def count_orientations(table: pd.DataFrame) -> int:
    """Return the number of orientations in a table of features or of sprites."""
    return int(table["orientations"].iloc[0])


def measure_headings(backbone: Reals) -> Floats:
    """Return the heading (rows,) [°] of backbones (rows, n, 2) px, which run from head to tail.

    It is the direction of the chord from one third of the body to the head end: that part does not
    bend.
    """
    third = interpolate_lines(backbone, np.array([_HEAD_SHARE * (backbone.shape[1] - 1)]))[:, 0]
    dx, dy = (backbone[:, 0] - third).T
    return wrap_deg(np.degrees(np.arctan2(-dy, dx)))


def measure_features(
    tracks: pd.DataFrame, rate_hz: float, settings: FeaturesSettings,
    given: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, NDArray[np.float32]]:  # fmt: skip
    """Measure heading, bend, motion and turns of every fish in every frame: the feature table.

    tracks: the table of `extract`, in the order (track_id, frame), else FinloopError. `given`, of
    the same rows, holds head_x_px, head_y_px, tail_x_px, tail_y_px of another program; where they
    are not NaN, they decide which end is the head. The feature table has the columns `FEATURES`;
    beside it backbones (rows, n, 2) px, head first, are returned.
    """
    if not pd.MultiIndex.from_frame(tracks[["track_id", "frame"]]).is_monotonic_increasing:
        raise FinloopError(
            "the table of tracks is not sorted by track_id, frame",
            "the table that the stage `extract` writes, whose rows are those of the cut-outs",
            "make it again: `dvc repro --force extract`",
        )
    every = track_slices(tracks)
    backbone, confidence = orient_backbones(tracks, rate_hz, given)
    place, length = (tracks[name].to_numpy(float) for name in (["x_px", "y_px"], "length_px"))
    bent, direction = measure_bend(backbone, length), measure_headings(backbone)
    delta_s = settings.delta_s
    if delta_s == "auto":
        delta_s = measure_delta_s([bent[one] for one in every], rate_hz)
    delta = delta_in_frames(delta_s, rate_hz)
    limits = choose_turn_thresholds(direction, bent, every, delta, settings)
    types = [
        classify_swimming_types(
            heading_change(direction[one], delta), bent[one], limits, settings.turn_end_threshold
        )
        for one in every
    ]
    current = settings.water_current_bl_s
    if current == "auto":
        dx, dy = (backbone[:, -1] - backbone[:, 0]).T
        back = np.radians(direction)
        tail = (-dx * np.sin(back) - dy * np.cos(back)) / length
        current = measure_current(place / length[:, None], direction, tail, bent, every, rate_hz)
    area = np.abs(bent)
    ends = {"": place, "head_": backbone[:, 0], "tail_": backbone[:, -1]}
    values = {
        "track_id": tracks["track_id"].to_numpy(),
        "frame": tracks["frame"].to_numpy(),
        "time_s": tracks["frame"].to_numpy() / rate_hz,
        **{f"{end}{axis}_px": at[:, k] for end, at in ends.items() for k, axis in enumerate("xy")},
        "heading_deg": direction,
        "orientation": find_orientations(direction, settings.orientations),
        "orientations": settings.orientations,
        "body_length_px": length,
        "motion_area": area,
        "motion_area_rel": area / (area.max() or 1.0),
        "bend": bent,
        "current": current,
        "swimming_type": np.concatenate(types),
        "head_confidence": confidence,
    }
    table = pd.DataFrame(values)
    moved, turned = _measure_motion_over_delta(table, every, delta)
    table = table.assign(displacement=moved, included_angle_deg=turned)
    return table[FEATURES.names], backbone.astype(np.float32)


def _measure_motion_over_delta(
    table: pd.DataFrame, tracks: Sequence[slice], delta_frames: int
) -> tuple[Floats, Floats]:
    """Return rows' displacement [body lengths] and change of heading [°] over the next Δ, (n,)."""
    way = places_through_water(table)
    direction, length = (table[name].to_numpy(float) for name in ("heading_deg", "body_length_px"))
    moved, turned = np.full((2, len(table)), np.nan)
    for one in tracks:
        last = max(one.stop - delta_frames, one.start)
        now, then = slice(one.start, last), slice(one.start + delta_frames, last + delta_frames)
        moved[now] = np.hypot(*(way[then] - way[now]).T) / np.median(length[one])
        turned[now] = wrap_deg(direction[then] - direction[now])
    return moved, turned


def choose_turn_thresholds(
    heading_deg: Reals,
    bend: Reals,
    tracks: Sequence[slice],
    delta_frames: int,
    settings: FeaturesSettings,
) -> TurnThresholds:
    """Return the thresholds of a turn: those of the settings, or, for `auto`, measured in the film.

    heading_deg, bend (n,): of all rows; tracks: the rows of each track.
    """
    given = settings.turn_threshold_deg, settings.bend_threshold
    measured = measure_turn_thresholds(
        [heading_deg[one] for one in tracks], [bend[one] for one in tracks], delta_frames
    )
    pairs = zip(given, measured, strict=True)
    return TurnThresholds(*(own if value == "auto" else value for value, own in pairs))


def track_slices(tracks: pd.DataFrame) -> list[slice]:
    """Return a slice of rows for each track of a table that is sorted by `track_id`."""
    first = np.flatnonzero(np.diff(tracks["track_id"].to_numpy(), prepend=np.nan))
    return [slice(*one) for one in pairwise([*first.tolist(), len(tracks)])]


def orient_backbones(
    tracks: pd.DataFrame, rate_hz: float, given: pd.DataFrame | None = None
) -> tuple[Floats, Floats]:
    """Return backbones (rows, n, 2) px turned head first, and how probable that is (rows,).

    tracks: the columns `USED`, sorted by track and frame; rate_hz: frames per second; given:
    another program's heads and tails, same rows, which decide where they are not NaN.
    """
    backbone = lists_to_points(tracks, "backbone").astype(float)
    width = lists_to_array(tracks["half_width_px"])
    ends = None if given is None else match_head_end(backbone, *read_head_and_tail(given))
    first, confidence = np.empty(len(tracks), bool), np.empty(len(tracks))
    for one in track_slices(tracks):
        end = None if ends is None else ends[one]
        first[one], confidence[one] = decide_head_end(backbone[one], width[one], rate_hz, end)
    return np.where(first[:, None, None], backbone, backbone[:, ::-1]), confidence


def read_head_and_tail(given: pd.DataFrame) -> tuple[Floats, Floats]:
    """Return head and tail, (rows, 2) px each, of another program; NaN where unknown."""
    head, tail = (given[[f"{end}_x_px", f"{end}_y_px"]].to_numpy(float) for end in ("head", "tail"))
    return head, tail
