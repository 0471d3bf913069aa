"""The film's swimming statistics for every mode: speeds and headings along tracks, and turns.

A *run* is a part of a track with one swimming type: straight, left or right. A *turn* is a run to
the left or right; both are kept as turns to the left, as a fish is symmetrical.

Speeds are body lengths per second, distances body lengths, angles degrees, + = left.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.axes import to_body_axes
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.features.current import places_through_water
from finloop.features.swimming_type import LEFT, RIGHT
from finloop.features.swimming_type import STRAIGHT as TYPE_STRAIGHT

_MOST_ROWS = 100_000  # rows to learn from: they show thousands of phases and turns
_MOTION = ("heading_deg", "bend")


@dataclass(frozen=True)
class Turns:
    """The film's turns (n,), mirrored so that all are to the left.

    angle_deg, ticks: of each whole turn; included_angle_deg, displacement [body lengths]: over the
    Δ in which the heading changes most. forward, sideways: body lengths in each tick, of all turns
    one after the other; those of turn i begin at `start[i]`.
    """

    angle_deg: Floats
    ticks: NDArray[np.int32]
    start: NDArray[np.int32]
    included_angle_deg: Floats
    displacement: Floats
    forward: Floats
    sideways: Floats


@dataclass(frozen=True)
class TrackKinematics:
    """How one track swims, frame by frame (n,); speed, growth and sway are measured over Δ.

    Over Δ noise does not count as motion. speed: body lengths/s; heading_deg: without jumps of 360;
    forward, sideways: body lengths per frame; growth: of the speed, as a share of itself, in a Δ;
    sway: standard deviation of the bend within Δ; kind: swimming type.
    """

    speed: Floats
    heading_deg: Floats
    forward: Floats
    sideways: Floats
    growth: Floats
    sway: Floats
    kind: NDArray[np.int8]

    def runs(self) -> "list[SwimmingRun]":
        """Return the track's runs, parts of one swimming type each, in their order."""
        edges = np.flatnonzero(np.diff(self.kind)) + 1
        bounds = np.concatenate([[0], edges, [len(self.kind)]]).tolist()
        return [
            SwimmingRun(self, int(self.kind[first]), first, end) for first, end in pairwise(bounds)
        ]


class SwimmingRun(NamedTuple):
    """A part of a track with one swimming type (kind): its first frame, and one past its last."""

    track: TrackKinematics
    kind: int
    first: int
    end: int


@dataclass(frozen=True)
class MotionStatistics:
    """How the film's fish swim.

    tracks: those that the rest is learnt from; straight_ticks (k,): durations of swimming between
    two turns; delta: Δ in ticks; body_length_px: as drawn, `size` times as large as filmed.
    """

    tracks: list[TrackKinematics]
    turns: Turns
    straight_ticks: NDArray[np.int32]
    rate_hz: float
    delta: int
    body_length_px: float
    size: float = 1.0

    def scale_to(self, size: float) -> "MotionStatistics":
        """Return the statistics of a fish drawn `size` times as large as filmed."""
        return replace(self, body_length_px=self.body_length_px * size / self.size, size=size)


Track = dict[str, NDArray[Any]]
"""Columns of a feature table, the rows of one track; x_px, y_px from `places_through_water`."""


def track_kinematics(track: Track, delta: int, length_px: float, rate_hz: float) -> TrackKinematics:
    """Return how a track (n rows) swims, frame by frame: speed, heading, steps, sway, type.

    delta: Δ in frames; length_px: body length; rate_hz: frames per second. The unit of distances is
    the body length, of angles degrees, + = left; values over Δ are those of the Δ around a frame.
    """
    frames = np.arange(len(track["x_px"]))
    before = np.maximum(frames - delta // 2, 0)
    after = np.minimum(frames - delta // 2 + delta, frames[-1])
    frames_between = np.maximum(after - before, 1)
    place = np.column_stack([track["x_px"], track["y_px"]]) / length_px
    velocity = (place[after] - place[before]) / frames_between[:, None]  # per frame
    heading = np.unwrap(track["heading_deg"], period=360)
    step = to_body_axes(np.gradient(place, axis=0), np.radians(heading))
    bend = track["bend"]
    # Sway: the standard deviation of the bend. Growth: change of the speed in a Δ, as a share.
    mean_bend = scipy.ndimage.uniform_filter1d(bend, delta + 1)
    variance = scipy.ndimage.uniform_filter1d(bend**2, delta + 1) - mean_bend**2
    speed = np.hypot(*velocity.T) * rate_hz
    speed_change = np.gradient(scipy.ndimage.uniform_filter1d(speed, delta)) * delta
    return TrackKinematics(
        speed=speed, heading_deg=heading, forward=step[:, 0], sideways=step[:, 1],
        growth=speed_change / np.maximum(speed, 1e-9), sway=np.sqrt(np.maximum(variance, 0.0)),
        kind=track["swimming_type"],
    )  # fmt: skip


def _kinematics_of_tracks(
    features: pd.DataFrame, rate_hz: float, delta: int
) -> list[TrackKinematics]:
    """Return the kinematics of the film's tracks that are longer than 2 Δ.

    rate_hz: frames per second; delta: Δ in frames. From a film of hours tracks spread over it are
    taken. Where the film shows no straight swimming, all of it counts as straight. FinloopError if
    nothing moves.
    """
    length = float(features["body_length_px"].median())
    long_tracks = _long_tracks(features, 2 * delta)
    tracks = [track_kinematics(columns, delta, length, rate_hz) for columns in long_tracks]
    if not tracks or max(track.speed.max() for track in tracks) <= 0:
        raise too_little_error("swimming")
    if not any((track.kind == TYPE_STRAIGHT).any() for track in tracks):
        tracks = [replace(track, kind=np.full_like(track.kind, TYPE_STRAIGHT)) for track in tracks]
    return tracks


def learn_motion(features: pd.DataFrame, rate_hz: float, delta: int) -> MotionStatistics:
    """Return how the film's fish swim, by the feature table: tracks, turns, times between turns.

    rate_hz: frames per second; delta: Δ in frames. Where the film shows no turn, each whole track
    counts as one. FinloopError if nothing moves, or no heading changes.
    """
    tracks = _kinematics_of_tracks(features, rate_hz, delta)
    runs = [run for track in tracks for run in track.runs()]
    straight = [run.end - run.first for run in runs if run.kind == TYPE_STRAIGHT]
    turning = [run for run in runs if run.kind != TYPE_STRAIGHT]
    turns = _turns_of_runs(turning, rate_hz, delta)
    if turns is None:
        turns = _turns_of_runs([_track_as_turn(track) for track in tracks], rate_hz, delta)
    if turns is None:
        raise too_little_error("turning")
    length = float(features["body_length_px"].median())
    return MotionStatistics(tracks, turns, np.array(straight, np.int32), rate_hz, delta, length)


def _long_tracks(features: pd.DataFrame, exceeded_frames: int) -> Iterator[Track]:
    """Yield the tracks longer than `exceeded_frames`; of a long film only some, spread over it.

    Each is columns by name: heading_deg, bend, x_px, y_px through the water, swimming_type.
    """
    edges = np.flatnonzero(np.diff(features["track_id"], prepend=-1, append=-1))
    columns: Track = {name: features[name].to_numpy(float) for name in _MOTION}
    columns["x_px"], columns["y_px"] = places_through_water(features).T
    columns["swimming_type"] = features["swimming_type"].to_numpy()
    long = np.flatnonzero(np.diff(edges) > exceeded_frames)
    rows = int(np.diff(edges)[long].sum())
    if rows > _MOST_ROWS:
        long = spread_rows(long, max(1, len(long) * _MOST_ROWS // rows))
    for number in long.tolist():
        track_rows = slice(edges[number], edges[number + 1])
        yield {name: column[track_rows] for name, column in columns.items()}


def too_little_error(swimming: str) -> FinloopError:
    """Return the error that a film shows too little of `swimming`, such as "turning"."""
    return FinloopError(
        f"the film shows no {swimming} to learn from",
        "tracks of some seconds in which a fish swims straight, and turns",
        "take a longer film, or change features.turn_threshold_deg (reports/film/features/fig7.png "
        "shows the types)",
    )


def _track_as_turn(track: TrackKinematics) -> SwimmingRun:
    """Return a track, without its first and last frame, as one turn to the side it turns to."""
    side = LEFT if track.heading_deg[-1] >= track.heading_deg[0] else RIGHT
    return SwimmingRun(track, side, 1, len(track.kind) - 1)


def _turns_of_runs(runs: list[SwimmingRun], rate_hz: float, delta: int) -> Turns | None:
    """Return the turns: the runs to the left or right that are filmed whole; None without any.

    All are mirrored to be turns to the left. rate_hz: frames per second; delta: Δ in frames.
    """
    rows = []
    for track, side, first, end in runs:  # side: 1 left, −1 right
        if first == 0 or end > len(track.kind) - 1:
            continue  # cut off by an end of the track
        # Degrees turned up to each frame, from the one before the run on; and in each Δ, or in all
        # of a shorter run.
        turned = side * (track.heading_deg[first - 1 : end + 1] - track.heading_deg[first - 1])
        if turned[-1] <= 0:
            continue  # the fish bent, and did not turn
        in_delta = turned[min(delta, len(turned) - 1) :] - turned[: max(len(turned) - delta, 1)]
        fastest = first - 1 + int(in_delta.argmax())  # beginning of the Δ with the largest turn
        # What the fish swims in that Δ, at the speed of its middle.
        displacement = track.speed[min(fastest + delta // 2, end - 1)] * delta / rate_hz
        forward, sideways = track.forward[first:end], side * track.sideways[first:end]
        rows.append((turned[-1], end - first, in_delta.max(), displacement, forward, sideways))
    if not rows:
        return None
    angles, ticks, included, displacements, forwards, sideways_parts = zip(*rows, strict=True)
    return Turns(
        np.array(angles), np.array(ticks, np.int32), start=first_ticks(ticks),
        included_angle_deg=np.array(included), displacement=np.array(displacements),
        forward=np.concatenate(forwards), sideways=np.concatenate(sideways_parts),
    )  # fmt: skip


def first_ticks(lengths: Sequence[int]) -> NDArray[np.int32]:
    """Return the first tick (n,) of each of n successive parts, whose lengths are in ticks."""
    return np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int32)
