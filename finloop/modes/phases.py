"""Phases: how the film's fish swim straight (fish paper Fig. 18).

A *phase* is a stretch of straight swimming of one kind: sliding with a still tail, accelerating,
decelerating, or plain straight. It keeps its filmed speeds and the drift of its heading, so that
sprites swim as the film does. Speeds are body lengths per second, angles degrees, + = left.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.motion import (
    TYPE_STRAIGHT,
    Run,
    TrackKinematics,
    kinematics_of_tracks,
    swimming_runs,
    too_little_error,
)
from finloop.base.arrays import Floats
from finloop.edit.schema import ACCELERATE, DECELERATE, FILM, SLIDE, STATES, STRAIGHT, TURN
from finloop.modes.network_settings import NetworkSettings


@dataclass(frozen=True)
class Phases:
    """Phases (n,) of straight swimming, and their ticks one after the other in flat arrays.

    state, ticks: of each; the ticks of phase i begin at `start[i]` of speed_change and drift_deg;
    before: state of the phase before, −1 where the film does not show it; first_speed: at the tick
    before the phase, body lengths/s; speed_change, drift_deg: of speed and heading since that tick;
    low, high: range of the film's speeds.
    """

    state: NDArray[np.int8]
    before: NDArray[np.int8]
    ticks: NDArray[np.int32]
    start: NDArray[np.int32]
    first_speed: Floats
    speed_change: Floats
    drift_deg: Floats
    low: float
    high: float


def learn_phases(features: pd.DataFrame, rate_hz: float, delta: int, p: NetworkSettings) -> Phases:
    """Return the phases of straight swimming of a feature table; FinloopError if it shows none.

    rate_hz: frames per second; delta: Δ in frames; p: what counts as sliding, steady and fast.
    """
    every = kinematics_of_tracks(features, rate_hz, delta)
    beating = np.concatenate([c.sway[c.kind == TYPE_STRAIGHT] for c in every])
    still = p.still_tail_ratio * float(np.quantile(beating, 0.9))
    speeds = np.concatenate([c.speed for c in every])
    low, high = np.quantile(speeds, (p.min_speed_quantile, p.max_speed_quantile))
    straight = [run for one in every for run in swimming_runs(one) if run[1] == TYPE_STRAIGHT]
    return _phases_of_runs(straight, still, delta, p, (float(low), float(high)))


def _phases_of_runs(
    runs: Sequence[Run],
    still_sway: float,
    delta: int,
    p: NetworkSettings,
    speed_range: tuple[float, float],
) -> Phases:
    """Return the phases of straight swimming in runs of the film.

    still_sway: sway of a still tail; delta: Δ in ticks; speed_range: of the film, body lengths/s.
    """
    limits = still_sway, p.steady_speed_ratio, max(1, round(p.phase_least * delta))
    rows = []
    for c, _, first, last in runs:
        came = TURN if first > 0 else -1
        for label, a, b in _split_run(c, first, last, limits):
            prior = max(a - 1, 0)
            drifted = c.heading_deg[a:b] - c.heading_deg[prior]
            if np.abs(drifted).max() <= p.phase_drift_deg:
                begins = c.speed[prior]
                rows.append((label, came, b - a, begins, c.speed[a:b] - begins, drifted))
            came = label
    if not rows:
        raise too_little_error("straight swimming")
    state, before, ticks, first_speed, change, drift = zip(*rows, strict=True)
    return Phases(
        np.array(state, np.int8), np.array(before, np.int8), np.array(ticks, np.int32),
        np.concatenate([[0], np.cumsum(ticks)[:-1]]).astype(np.int32), np.array(first_speed),
        np.concatenate(change), np.concatenate(drift), *speed_range,
    )  # fmt: skip


def _split_run(
    track: TrackKinematics, first: int, last: int, limits: tuple[float, float, int]
) -> list[tuple[int, int, int]]:
    """Return (state, first, one past the last) of the phases of a straight run.

    limits: the sway of a still tail, the growth of a steady speed, and the fewest ticks.
    """
    here, (still, steady, least) = slice(first, last), limits
    growth = track.growth[here]
    label = np.select(
        [track.sway[here] < still, growth > steady, growth < -steady],
        [SLIDE, ACCELERATE, DECELERATE],
        STRAIGHT,
    ).astype(np.int8)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1, [len(label)]])
    labels: list[tuple[int, int, int]] = []
    for a, b in pairwise(edges.tolist()):
        kind = int(label[a])
        if labels and (b - a < least or labels[-1][0] == kind):
            labels[-1] = (labels[-1][0], labels[-1][1], first + b)
        elif labels and labels[-1][2] - labels[-1][1] < least:  # only the first can be short
            labels[-1] = (kind, labels[-1][1], first + b)
        else:
            labels.append((kind, first + a, first + b))
    return labels


def state_shares(features: pd.DataFrame, phases: Phases) -> dict[str, float]:
    """Return the percentage of time that the fish spend in each state, `<state>_pct`."""
    straight = np.bincount(phases.state, weights=phases.ticks, minlength=TURN)[:TURN]
    turning = float((features["swimming_type"] != 0).mean())
    share = np.append(straight / straight.sum() * (1 - turning), turning)
    return {
        f"{state}_pct": 100 * float(part) for state, part in zip(STATES[:FILM], share, strict=True)
    }
