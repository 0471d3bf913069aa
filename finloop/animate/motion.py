"""What the film shows of swimming: phases of straight swimming, and turns (fish paper, Fig. 18).

A *phase* is a stretch of straight swimming with one character: sliding with a still tail,
accelerating, decelerating, or plain straight. Its speeds and the drift of its heading are kept as
they were, so that whoever swims by them swims as the film does. A *turn* is a stretch of one
swimming type, left or right; both sides are kept as turns to the left, as a fish is symmetrical.

Speeds are body lengths per second, distances body lengths, angles degrees, + = left.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.animate.settings import Settings
from finloop.base.arrays import Floats
from finloop.base.axes import ahead_left
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread
from finloop.edit.schema import ACCELERATE, DECELERATE, SLIDE, STRAIGHT, TURN
from finloop.features.current import through_water
from finloop.features.swimming_type import STRAIGHT as TYPE_STRAIGHT

_QUICKEST = 0.99  # quantile of speeds and turn rates; beyond it are faults
_LEARNT = 100_000  # rows; they show thousands of phases and turns, of which few are ever alike
_MOTION = ("heading_deg", "bend")


@dataclass(frozen=True)
class Phases:
    """Phases (n,), their ticks one after the other in the flat arrays, phase i from `start[i]`.

    before: state of the phase before, −1 where the film does not show it. `speed_change` and
    `drift_deg` since the tick before the phase: of speed and of heading.
    """

    state: NDArray[np.int8]
    before: NDArray[np.int8]
    ticks: NDArray[np.int32]
    start: NDArray[np.int32]
    first_speed: Floats
    speed_change: Floats
    drift_deg: Floats


@dataclass(frozen=True)
class Turns:
    """Turns (n,), all to the left; `forward`, `sideways` body lengths per tick, flat as in Phases.

    included_angle_deg, displacement: over the Δ in which the heading changes most.
    """

    angle_deg: Floats
    ticks: NDArray[np.int32]
    start: NDArray[np.int32]
    included_angle_deg: Floats
    displacement: Floats
    forward: Floats
    sideways: Floats


@dataclass(frozen=True)
class Motion:
    """All that a fish needs to know to swim as the film does.

    straight_ticks: how long it swam between two turns. low, high: the range of its speeds.
    brisk_deg: by how much it turns in a tick where it turns briskly, over Δ; about: ticks in which
    it turns by `animate.ahead_turn` then. body_length_px: as drawn, `size` times as large as
    filmed.
    """

    phases: Phases
    turns: Turns
    straight_ticks: NDArray[np.int32]
    low: float
    high: float
    brisk_deg: float
    about: int
    rate_hz: float
    delta: int
    body_length_px: float
    size: float = 1.0

    def sized(self, size: float) -> "Motion":
        """The same of a fish drawn so many times as large as filmed."""
        return replace(self, body_length_px=self.body_length_px * size / self.size, size=size)


@dataclass(frozen=True)
class Course:
    """How one track swims: everything smoothed over Δ, so that noise is not taken for motion."""

    speed: Floats
    heading_deg: Floats
    forward: Floats
    sideways: Floats
    growth: Floats  # of the speed, as a share of itself, in a Δ
    sway: Floats  # deviation of the bend within Δ
    kind: NDArray[np.int8]


Track = dict[str, NDArray[Any]]
"""Columns of a feature table, the rows of one track; x_px, y_px as `through_water` has them."""


def course(track: Track, delta: int, length_px: float, rate_hz: float) -> Course:
    """What one track, frame by frame, does."""
    frames = np.arange(len(track["x_px"]))
    before = np.maximum(frames - delta // 2, 0)
    after = np.minimum(frames - delta // 2 + delta, frames[-1])
    span = np.maximum(after - before, 1)
    place = np.column_stack([track["x_px"], track["y_px"]]) / length_px
    moved = (place[after] - place[before]) / span[:, None]
    heading = np.unwrap(track["heading_deg"], period=360)
    step = ahead_left(np.gradient(place, axis=0), np.radians(heading))
    bend = track["bend"]
    mean = scipy.ndimage.uniform_filter1d(bend, delta + 1)
    spread = scipy.ndimage.uniform_filter1d(bend**2, delta + 1) - mean**2
    speed = np.hypot(*moved.T) * rate_hz
    faster = np.gradient(scipy.ndimage.uniform_filter1d(speed, delta)) * delta
    return Course(
        speed=speed,
        heading_deg=heading,
        forward=step[:, 0],
        sideways=step[:, 1],
        growth=faster / np.maximum(speed, 1e-9),
        sway=np.sqrt(np.maximum(spread, 0.0)),
        kind=track["swimming_type"],
    )


def learn(features: pd.DataFrame, rate_hz: float, delta: int, settings: Settings) -> Motion:
    """Phases and turns of a feature table.

    A film of hours is learnt from tracks that are spread over it. Where the film shows no straight
    swimming, all of it counts as straight; where no turn, each track is one. FinloopError if
    nothing moves, or no heading changes.
    """
    length = float(features["body_length_px"].median())
    courses = [course(track, delta, length, rate_hz) for track in _tracks(features, 2 * delta)]
    if not courses or max(c.speed.max() for c in courses) <= 0:
        raise _too_little("swimming")
    if not any((c.kind == TYPE_STRAIGHT).any() for c in courses):
        courses = [replace(c, kind=np.full_like(c.kind, TYPE_STRAIGHT)) for c in courses]
    beating = np.concatenate([c.sway[c.kind == TYPE_STRAIGHT] for c in courses])
    speeds = np.concatenate([c.speed for c in courses])
    low, high = np.quantile(speeds, (settings.speed_low, settings.speed_high))
    turned = [np.abs(c.heading_deg[delta:] - c.heading_deg[:-delta]) / delta for c in courses]
    brisk = brisk_of(np.concatenate(turned), settings)
    runs = [(c, *run) for c in courses for run in _runs(c.kind)]
    straight = [run for run in runs if run[1] == TYPE_STRAIGHT]
    still = settings.still * float(np.quantile(beating, 0.9))
    phases = _phases(straight, still, delta, settings)
    turning = [run for run in runs if run[1] != TYPE_STRAIGHT]
    turns = _turns(turning, rate_hz, delta) or _turns([_whole(c) for c in courses], rate_hz, delta)
    if turns is None:
        raise _too_little("turning")
    between = np.array([last - first for _, _, first, last in straight], np.int32)
    about = _ticks_to_turn([c.heading_deg for c in courses], delta, settings)
    return Motion(
        phases, turns, between, float(low), float(high), brisk, about, rate_hz, delta, length
    )


def _ticks_to_turn(headings: Sequence[Floats], delta: int, settings: Settings) -> int:
    """Ticks, whole Δ, in which a brisk fish turns by `ahead_turn`; as many as `look_ahead` at most.

    headings: of each track, unwrapped. In a shorter time its head sways with the tail.
    """
    most = max(1, round(settings.look_ahead))
    for times in range(1, most):
        lag = times * delta
        turned = [np.abs(one[lag:] - one[:-lag]) for one in headings]
        every = np.concatenate(turned)
        if len(every) and np.quantile(every, settings.brisk) >= settings.ahead_turn:
            return lag
    return most * delta


def brisk_of(sizes: Floats, settings: Settings) -> float:
    """The speed, or turn rate, of a brisk fish among those (n,) of a film.

    A quantile; of a fish that rests for most of the film a share of the quickest.
    """
    quantile, quickest = np.quantile(sizes, (settings.brisk, _QUICKEST))
    return float(max(quantile, settings.brisk_least * quickest, 1e-6))


def _tracks(features: pd.DataFrame, least: int) -> Iterator[Track]:
    """The tracks that are longer than `least`; of a long film as many as have `_LEARNT` rows."""
    edges = np.flatnonzero(np.diff(features["track_id"], prepend=-1, append=-1))
    columns: Track = {name: features[name].to_numpy(float) for name in _MOTION}
    columns["x_px"], columns["y_px"] = through_water(features).T
    columns["swimming_type"] = features["swimming_type"].to_numpy()
    long = np.flatnonzero(np.diff(edges) > least)
    rows = int(np.diff(edges)[long].sum())
    if rows > _LEARNT:
        long = spread(long, max(1, len(long) * _LEARNT // rows))
    for number in long.tolist():
        here = slice(edges[number], edges[number + 1])
        yield {name: column[here] for name, column in columns.items()}


def _too_little(what: str) -> FinloopError:
    return FinloopError(
        f"the film shows no {what} to learn from",
        "tracks of some seconds in which a fish swims straight, and turns",
        "take a longer film, or change features.turn_threshold_deg (reports/features/fig7.png "
        "shows the types)",
    )


def _runs(kind: NDArray[np.int8]) -> list[tuple[int, int, int]]:
    """(type, first, one past the last) of every run of one swimming type."""
    edges = np.flatnonzero(np.diff(kind)) + 1
    bounds = np.concatenate([[0], edges, [len(kind)]])
    return [(int(kind[a]), int(a), int(b)) for a, b in pairwise(bounds)]


Run = tuple[Course, int, int, int]


def _phases(runs: list[Run], still: float, delta: int, settings: Settings) -> Phases:
    """still: sway below which a tail is still."""
    limits = still, settings.steady, max(1, round(settings.phase_least * delta))
    rows = []
    for c, _, first, last in runs:
        came = TURN if first > 0 else -1
        for label, a, b in _labels(c, first, last, limits):
            prior = max(a - 1, 0)
            drifted = c.heading_deg[a:b] - c.heading_deg[prior]
            if np.abs(drifted).max() <= settings.phase_drift_deg:
                begins = c.speed[prior]
                rows.append((label, came, b - a, begins, c.speed[a:b] - begins, drifted))
            came = label
    if not rows:
        raise _too_little("straight swimming")
    state, before, ticks, first_speed, change, drift = zip(*rows, strict=True)
    return Phases(
        np.array(state, np.int8),
        np.array(before, np.int8),
        np.array(ticks, np.int32),
        _starts(ticks),
        np.array(first_speed),
        np.concatenate(change),
        np.concatenate(drift),
    )


def _labels(
    c: Course, first: int, last: int, limits: tuple[float, float, int]
) -> list[tuple[int, int, int]]:
    """(state, first, one past the last) of the phases of a straight run.

    limits: of the sway of a still tail, of the growth of a steady speed, and of ticks, at least.
    """
    here, (still, steady, least) = slice(first, last), limits
    growth = c.growth[here]
    label = np.select(
        [c.sway[here] < still, growth > steady, growth < -steady],
        [SLIDE, ACCELERATE, DECELERATE],
        STRAIGHT,
    ).astype(np.int8)
    labels: list[tuple[int, int, int]] = []
    for kind, a, b in _runs(label):
        if labels and (b - a < least or labels[-1][0] == kind):
            labels[-1] = (labels[-1][0], labels[-1][1], first + b)
        elif labels and labels[-1][2] - labels[-1][1] < least:  # only the first can be short
            labels[-1] = (kind, labels[-1][1], first + b)
        else:
            labels.append((kind, first + a, first + b))
    return labels


def _whole(c: Course) -> Run:
    """A track as one turn, to the side to which it turns in all."""
    side = 1 if c.heading_deg[-1] >= c.heading_deg[0] else -1
    return c, side, 1, len(c.kind) - 1


def _turns(runs: list[Run], rate_hz: float, delta: int) -> Turns | None:
    """The turns of runs; None where no run turns."""
    rows = []
    for c, kind, first, last in runs:
        prior, final = max(first - 1, 0), min(last, len(c.kind) - 1)
        turned = kind * (c.heading_deg[prior : final + 1] - c.heading_deg[prior])
        if turned[-1] <= 0 or prior == first or final < last:
            continue  # cut off by an end of the track, or a bend that turned nothing
        over = turned[min(delta, len(turned) - 1) :] - turned[: max(len(turned) - delta, 1)]
        peak = prior + int(over.argmax())
        displacement = c.speed[min(peak + delta // 2, last - 1)] * delta / rate_hz
        sideways = kind * c.sideways[first:last]
        forward = c.forward[first:last]
        rows.append((turned[-1], last - first, over.max(), displacement, forward, sideways))
    if not rows:
        return None
    angle, ticks, included, far, ahead, aside = zip(*rows, strict=True)
    return Turns(
        np.array(angle),
        np.array(ticks, np.int32),
        _starts(ticks),
        np.array(included),
        np.array(far),
        np.concatenate(ahead),
        np.concatenate(aside),
    )


def _starts(ticks: tuple[int, ...]) -> NDArray[np.int32]:
    return np.concatenate([[0], np.cumsum(ticks)[:-1]]).astype(np.int32)
