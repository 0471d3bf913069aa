"""Make the feature table from tracks, a row per fish per frame (§2.2-2.3, Fig. 7, Table 1).

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
from finloop.base.axes import to_body_axes
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema, columns, lists_to_array, lists_to_points
from finloop.features.area import interpolate_lines, measure_bend
from finloop.features.current import measure_current, places_through_water
from finloop.features.head import (
    HeadCues,
    choose_head_cues,
    decide_head_end,
    match_head_end,
)
from finloop.features.memory import measure_delta_s
from finloop.features.settings import FeaturesSettings, HeadRule
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
    """Return Δ, given in s, in whole frames, at least 1."""
    return max(1, round(delta_s * rate_hz))


def infer_delta_frames(features: pd.DataFrame) -> int:
    """Return Δ [frames] with which a feature table was measured.

    A displacement needs a frame Δ later, so the last Δ rows of a track have none: the result is the
    largest number of rows without one in a track.
    """
    return int(features["displacement"].isna().groupby(features["track_id"]).sum().max())


def natural_step_frames(features: pd.DataFrame) -> int:
    """Return the length in frames of a natural step, which is Δ / 5, at least 1.

    The typical difference of pictures that are a natural step apart is the unit of all picture
    distances. In the paper's film (25 Hz, Δ of 5 frames) the step is one frame; with a faster
    camera, a frame would be too short.
    """
    return max(1, round(infer_delta_frames(features) / _STEPS))


def wrap_deg(angle_deg: Reals) -> Floats:
    """Return angles [°] of any shape, wrapped to (−180, 180]."""
    return 180.0 - (180.0 - np.asarray(angle_deg, float)) % 360.0


def find_orientations(heading_deg: Reals, orientations: int) -> NDArray[np.int8]:
    """Return the orientation of each heading [°]: the number of its sector, from 1 (§3.3).

    The sectors divide 360° equally, 24 in the paper. Sector 1 is centred on 0°, to the right;
    numbers rise anticlockwise. The result has the shape of the headings.
    """
    sector = 360 / orientations
    return (np.floor(np.asarray(heading_deg) / sector + 0.5) % orientations + 1).astype(np.int8)


def orientation_heading_deg(orientation: NDArray[np.integer] | int, orientations: int) -> Floats:
    """Return the heading [°], in [0, 360), at the middle of an orientation's sector."""
    return (np.asarray(orientation, float) - 1) * (360 / orientations)


def count_orientations(table: pd.DataFrame) -> int:
    """Return the number of orientations in a table of features or of sprites."""
    return int(table["orientations"].iloc[0])


def measure_headings(backbone: Reals) -> Floats:
    """Return the heading (rows,) [°] of backbones (rows, n, 2) px, which run from head to tail.

    This is the direction from a third of the body to the head end: that part does not bend.
    """
    third = interpolate_lines(backbone, np.array([_HEAD_SHARE * (backbone.shape[1] - 1)]))[:, 0]
    dx, dy = (backbone[:, 0] - third).T
    return wrap_deg(np.degrees(np.arctan2(-dy, dx)))


def measure_features(
    tracks: pd.DataFrame, rate_hz: float, settings: FeaturesSettings,
    given: pd.DataFrame | None = None,
) -> tuple[pd.DataFrame, NDArray[np.float32]]:  # fmt: skip
    """Return the feature table of tracked fish, and their backbones (rows, n, 2) px, head first.

    tracks: the table of `extract`, in the order (track_id, frame), else FinloopError. `given`, of
    the same rows, holds head_x_px, head_y_px, tail_x_px, tail_y_px of another program; where they
    are not NaN, they decide which end is the head. The feature table has the columns `FEATURES`:
    place, heading, bend, motion and swimming type.
    """
    _refuse_unsorted(tracks)
    rows_of_tracks = track_slices(tracks)
    backbone, confidence = orient_backbones(tracks, rate_hz, given, settings.head)
    place = tracks[["x_px", "y_px"]].to_numpy(float)
    length = tracks["length_px"].to_numpy(float)
    bend, heading = measure_bend(backbone, length), measure_headings(backbone)
    delta_s = settings.delta_s
    if delta_s == "auto":
        delta_s = measure_delta_s([bend[rows] for rows in rows_of_tracks], rate_hz)
    delta = delta_in_frames(delta_s, rate_hz)
    current = settings.water_current_bl_s  # of the water, against which animals may swim
    if current == "auto":
        tail_px = to_body_axes(backbone[:, -1] - backbone[:, 0], np.radians(heading))[:, 1]
        current = measure_current(
            place / length[:, None], heading, tail_px / length, bend, rows_of_tracks, rate_hz
        )
    area = np.abs(bend)
    table = pd.DataFrame(
        {
            "track_id": tracks["track_id"].to_numpy(),
            "frame": tracks["frame"].to_numpy(),
            "time_s": tracks["frame"].to_numpy() / rate_hz,
            "x_px": place[:, 0],
            "y_px": place[:, 1],
            "head_x_px": backbone[:, 0, 0],
            "head_y_px": backbone[:, 0, 1],
            "tail_x_px": backbone[:, -1, 0],
            "tail_y_px": backbone[:, -1, 1],
            "heading_deg": heading,
            "orientation": find_orientations(heading, settings.orientations),
            "orientations": settings.orientations,
            "body_length_px": length,
            "motion_area": area,
            "motion_area_rel": area / (area.max() or 1.0),
            "bend": bend,
            "current": current,
            "swimming_type": _find_swimming_types(heading, bend, rows_of_tracks, delta, settings),
            "head_confidence": confidence,
        }
    )
    displacement, turn = _measure_motion_over_delta(table, rows_of_tracks, delta)
    table = table.assign(displacement=displacement, included_angle_deg=turn)
    return table[FEATURES.names], backbone.astype(np.float32)


def _refuse_unsorted(tracks: pd.DataFrame) -> None:
    """Raise FinloopError unless a table of tracks is in the order (track_id, frame)."""
    if not pd.MultiIndex.from_frame(tracks[["track_id", "frame"]]).is_monotonic_increasing:
        raise FinloopError(
            "the table of tracks is not sorted by track_id, frame",
            "the table that the stage `extract` writes, whose rows are those of the cut-outs",
            "make it again: `dvc repro --force extract`",
        )


def _find_swimming_types(
    heading_deg: Floats, bend: Floats, tracks: Sequence[slice], delta_frames: int,
    settings: FeaturesSettings,
) -> NDArray[np.int8]:  # fmt: skip
    """Return the swimming type (n,) of every row, from its bend and its change of heading.

    heading_deg, bend (n,): of every row; tracks: the rows of each track.
    """
    thresholds = choose_turn_thresholds(heading_deg, bend, tracks, delta_frames, settings)
    types = []
    for rows in tracks:
        turn_deg = heading_change(heading_deg[rows], delta_frames)
        types.append(
            classify_swimming_types(turn_deg, bend[rows], thresholds, settings.turn_end_threshold)
        )
    return np.concatenate(types)


def _measure_motion_over_delta(
    table: pd.DataFrame, tracks: Sequence[slice], delta_frames: int
) -> tuple[Floats, Floats]:
    """Return displacements (n,) [body lengths] and changes of heading (n,) [°] over the next Δ.

    table: the feature table; tracks: the rows of each track. The last Δ rows of a track have NaN.
    """
    place = places_through_water(table)
    heading, length = (table[name].to_numpy(float) for name in ("heading_deg", "body_length_px"))
    displacement, turn = np.full((2, len(table)), np.nan)
    for rows in tracks:
        now = np.arange(rows.start, rows.stop - delta_frames)
        later = now + delta_frames
        displacement[now] = np.hypot(*(place[later] - place[now]).T) / np.median(length[rows])
        turn[now] = wrap_deg(heading[later] - heading[now])
    return displacement, turn


def choose_turn_thresholds(
    heading_deg: Reals, bend: Reals, tracks: Sequence[slice], delta_frames: int,
    settings: FeaturesSettings,
) -> TurnThresholds:  # fmt: skip
    """Return the change of heading and the bend that make a turn: settings, or measured.

    Each threshold is the number in the settings; if it is "auto" there, it is measured in the film.
    heading_deg (n,): heading of each row of the film, degrees; bend (n,): signed motion area of
    each row, body length²; tracks: the rows of each track; delta_frames: the time over which a
    change of heading is measured, Δ in frames.
    """
    headings, bends = [heading_deg[rows] for rows in tracks], [bend[rows] for rows in tracks]
    limits = measure_turn_thresholds(headings, bends, delta_frames)
    if settings.turn_threshold_deg != "auto":
        limits = limits._replace(turn_deg=settings.turn_threshold_deg)
    if settings.bend_threshold != "auto":
        limits = limits._replace(bend=settings.bend_threshold)
    return limits


def track_slices(tracks: pd.DataFrame) -> list[slice]:
    """Return the slice of rows of each track in a table that is sorted by `track_id`."""
    first = np.flatnonzero(np.diff(tracks["track_id"].to_numpy(), prepend=np.nan))
    return [slice(start, stop) for start, stop in pairwise([*first.tolist(), len(tracks)])]


def orient_backbones(
    tracks: pd.DataFrame, rate_hz: float, given: pd.DataFrame | None = None,
    rule: HeadRule = "auto",
) -> tuple[Floats, Floats]:  # fmt: skip
    """Return backbones (rows, n, 2) px head first, and the probability (rows,) of that.

    tracks: the columns `USED`, sorted by track and frame; rate_hz: frames per second; given:
    another program's heads and tails, same rows, which decide where they are not NaN; rule: how the
    head is found elsewhere.
    """
    backbone = lists_to_points(tracks, "backbone").astype(float)
    width = lists_to_array(tracks["half_width_px"])
    given_head = np.zeros(len(tracks), np.int8)  # unknown
    if given is not None:
        given_head = match_head_end(backbone, *read_head_and_tail(given))
    cues = choose_head_cues(rule, backbone, width, track_slices(tracks), rate_hz)
    head_first, confidence = np.empty(len(tracks), bool), np.empty(len(tracks))
    for rows in track_slices(tracks):
        head_first[rows], confidence[rows] = decide_head_end(
            backbone[rows], width[rows], rate_hz, given_head[rows], cues
        )
    return np.where(head_first[:, None, None], backbone, backbone[:, ::-1]), confidence


def learn_head_cues(tracks: pd.DataFrame, rate_hz: float, rule: HeadRule) -> HeadCues:
    """Return the cues that show the head in a film, chosen from its tracks.

    tracks: the columns `USED`, sorted by track and frame; rate_hz: frames per second; rule: of the
    settings.
    """
    backbone = lists_to_points(tracks, "backbone").astype(float)
    width = lists_to_array(tracks["half_width_px"])
    return choose_head_cues(rule, backbone, width, track_slices(tracks), rate_hz)


def read_head_and_tail(given: pd.DataFrame) -> tuple[Floats, Floats]:
    """Return another program's heads and tails, (rows, 2) px each, NaN where unknown.

    given: a table with head_x_px, head_y_px, tail_x_px and tail_y_px.
    """
    head, tail = (given[[f"{end}_x_px", f"{end}_y_px"]].to_numpy(float) for end in ("head", "tail"))
    return head, tail
