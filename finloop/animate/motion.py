"""What the film shows of swimming: phases of straight swimming, and turns (fish paper, Fig. 18).

A *phase* is a stretch of straight swimming with one character: sliding with a still tail,
accelerating, decelerating, or plain straight. Its speeds and the drift of its heading are kept as
they were, so that whoever swims by them swims as the film does. A *turn* is a stretch of one
swimming type, left or right; both sides are kept as turns to the left, as a fish is symmetrical.

Speeds are body lengths per second, distances body lengths, angles degrees, + = left.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.animate.settings import Settings
from finloop.errors import FinloopError
from finloop.features.swimming_type import STRAIGHT as TYPE_STRAIGHT

STRAIGHT, SLIDE, ACCELERATE, DECELERATE, TURN, FILM = range(6)
STATES = ("straight", "slide", "accelerate", "decelerate", "turn", "film")
"""What a fish does: by sprites, or as a stretch of film."""


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
    first_speed: NDArray[np.float64]
    speed_change: NDArray[np.float64]
    drift_deg: NDArray[np.float64]


@dataclass(frozen=True)
class Turns:
    """Turns (n,), all to the left; `forward`, `sideways` body lengths per tick, flat as in Phases.

    included_angle_deg, displacement: over the Δ in which the heading changes most.
    """

    angle_deg: NDArray[np.float64]
    ticks: NDArray[np.int32]
    start: NDArray[np.int32]
    included_angle_deg: NDArray[np.float64]
    displacement: NDArray[np.float64]
    forward: NDArray[np.float64]
    sideways: NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """All that a fish needs to know to swim as the film does.

    straight_ticks: how long it swam between two turns. low, high: the range of its speeds.
    """

    phases: Phases
    turns: Turns
    straight_ticks: NDArray[np.int32]
    low: float
    high: float
    rate_hz: float
    delta: int
    body_length_px: float


@dataclass(frozen=True)
class Course:
    """How one track swims: everything smoothed over Δ, so that noise is not taken for motion."""

    speed: NDArray[np.float64]
    heading_deg: NDArray[np.float64]
    forward: NDArray[np.float64]
    sideways: NDArray[np.float64]
    sway: NDArray[np.float64]  # deviation of the bend within Δ
    kind: NDArray[np.int8]


def course(track: pd.DataFrame, delta: int, length_px: float, rate_hz: float) -> Course:
    """What one track of the feature table, frame by frame, does."""
    frames = np.arange(len(track))
    before = np.maximum(frames - delta // 2, 0)
    after = np.minimum(frames - delta // 2 + delta, len(track) - 1)
    span = np.maximum(after - before, 1)
    place = track[["x_px", "y_px"]].to_numpy(float) / length_px
    moved = (place[after] - place[before]) / span[:, None]
    heading = np.unwrap(track["heading_deg"].to_numpy(float), period=360)
    angle = np.radians(heading)
    step = np.gradient(place, axis=0) if len(track) > 1 else np.zeros_like(place)
    bend = track["bend"].to_numpy(float)
    mean = scipy.ndimage.uniform_filter1d(bend, delta + 1)
    spread = scipy.ndimage.uniform_filter1d(bend**2, delta + 1) - mean**2
    return Course(
        speed=np.hypot(*moved.T) * rate_hz,
        heading_deg=heading,
        forward=step[:, 0] * np.cos(angle) - step[:, 1] * np.sin(angle),
        sideways=-step[:, 0] * np.sin(angle) - step[:, 1] * np.cos(angle),
        sway=np.sqrt(np.maximum(spread, 0.0)),
        kind=track["swimming_type"].to_numpy(),
    )


def learn(features: pd.DataFrame, rate_hz: float, delta: int, settings: Settings) -> Motion:
    """Phases and turns of a feature table.

    FinloopError if the film shows no straight swimming, or no turn.
    """
    length = float(features["body_length_px"].median())
    courses = [
        course(track, delta, length, rate_hz)
        for _, track in features.groupby("track_id")
        if len(track) > 2 * delta
    ]
    speeds = np.concatenate([c.speed for c in courses] or [np.zeros(0)])
    beating = [c.sway[c.kind == TYPE_STRAIGHT] for c in courses]
    straight = np.concatenate(beating or [np.zeros(0)])
    if straight.size == 0 or speeds.max() <= 0:
        raise _too_little("straight swimming", "features.turn_threshold_deg")
    still = settings.still * np.quantile(straight, 0.9)
    low, high = np.quantile(speeds, (settings.speed_low, settings.speed_high))
    rules = PhaseRules(float(still), rate_hz, delta, settings)
    runs = [
        (c, kind, first, last)
        for c in courses
        for kind, first, last in _runs(c.kind)
    ]  # fmt: skip
    phases = _phases([run for run in runs if run[1] == TYPE_STRAIGHT], rules)
    turns = _turns([run for run in runs if run[1] != TYPE_STRAIGHT], rate_hz, delta)
    if len(phases.ticks) == 0:
        raise _too_little("straight swimming", "features.turn_threshold_deg")
    if len(turns.ticks) == 0:
        raise _too_little("turning", "features.turn_threshold_deg")
    between = [last - first for c, kind, first, last in runs if kind == TYPE_STRAIGHT]
    return Motion(
        phases, turns, np.array(between, np.int32), float(low), float(high), rate_hz, delta, length
    )


def _too_little(what: str, threshold: str) -> FinloopError:
    return FinloopError(
        f"the film shows no {what} to learn from",
        "tracks of some seconds in which a fish swims straight, and turns",
        f"take a longer film, or change {threshold} (reports/features/fig7.png shows the types)",
    )


def _runs(kind: NDArray[np.int8]) -> list[tuple[int, int, int]]:
    """(type, first, one past the last) of every run of one swimming type."""
    edges = np.flatnonzero(np.diff(kind)) + 1
    bounds = np.concatenate([[0], edges, [len(kind)]])
    return [(int(kind[a]), int(a), int(b)) for a, b in pairwise(bounds)]


Run = tuple[Course, int, int, int]


class PhaseRules(NamedTuple):
    """How straight swimming is cut into phases. still: sway below which a tail is still."""

    still: float
    rate_hz: float
    delta: int
    settings: Settings


def _phases(runs: list[Run], rules: PhaseRules) -> Phases:
    state, before, ticks, first_speed, change, drift = [], [], [], [], [], []
    for c, _, first, last in runs:
        labels = _labels(c, first, last, rules)
        came = TURN if first > 0 else -1
        for label, a, b in labels:
            prior = max(a - 1, 0)
            drifted = c.heading_deg[a:b] - c.heading_deg[prior]
            if np.abs(drifted).max() > rules.settings.phase_drift_deg:
                came = label
                continue
            state.append(label)
            before.append(came)
            ticks.append(b - a)
            first_speed.append(c.speed[prior])
            change.append(c.speed[a:b] - c.speed[prior])
            drift.append(drifted)
            came = label
    return Phases(
        np.array(state, np.int8),
        np.array(before, np.int8),
        np.array(ticks, np.int32),
        _starts(ticks),
        np.array(first_speed, float),
        np.concatenate(change or [np.zeros(0)]),
        np.concatenate(drift or [np.zeros(0)]),
    )


def _labels(c: Course, first: int, last: int, rules: PhaseRules) -> list[tuple[int, int, int]]:
    """(state, first, one past the last) of the phases of a straight run."""
    here, steady, least = slice(first, last), rules.settings.steady, rules.settings.phase_ticks
    rate = np.gradient(scipy.ndimage.uniform_filter1d(c.speed, rules.delta))[here] * rules.rate_hz
    rate = rate / np.maximum(c.speed[here], 1e-9)
    label = np.select(
        [c.sway[here] < rules.still, rate > steady, rate < -steady],
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


def _turns(runs: list[Run], rate_hz: float, delta: int) -> Turns:
    angle, ticks, included, displacement, forward, sideways = [], [], [], [], [], []
    for c, kind, first, last in runs:
        prior, final = max(first - 1, 0), min(last, len(c.kind) - 1)
        turned = kind * (c.heading_deg[prior : final + 1] - c.heading_deg[prior])
        if turned[-1] <= 0 or prior == first or final < last:
            continue  # cut off by an end of the track, or a bend that turned nothing
        over = turned[min(delta, len(turned) - 1) :] - turned[: max(len(turned) - delta, 1)]
        peak = prior + int(over.argmax())
        angle.append(turned[-1])
        ticks.append(last - first)
        included.append(over.max())
        displacement.append(c.speed[min(peak + delta // 2, last - 1)] * delta / rate_hz)
        forward.append(c.forward[first:last])
        sideways.append(kind * c.sideways[first:last])
    return Turns(
        np.array(angle, float),
        np.array(ticks, np.int32),
        _starts(ticks),
        np.array(included, float),
        np.array(displacement, float),
        np.concatenate(forward or [np.zeros(0)]),
        np.concatenate(sideways or [np.zeros(0)]),
    )


def _starts(ticks: list[int]) -> NDArray[np.int32]:
    return np.concatenate([[0], np.cumsum(ticks)[:-1]]).astype(np.int32)
