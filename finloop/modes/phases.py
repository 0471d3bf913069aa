"""Phases: how the film's fish swim straight (fish paper Fig. 18).

A *phase* is a part of a straight run of the film: sliding with a still tail, accelerating,
decelerating, or plain straight. It keeps its filmed speeds and the drift of its heading, so that
sprites swim as the film does. Speeds are body lengths per second, angles degrees, + = left.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.motion import (
    TYPE_STRAIGHT,
    MotionStatistics,
    SwimmingRun,
    first_ticks,
    too_little_error,
)
from finloop.base.arrays import Floats
from finloop.edit.schema import ACCELERATE, DECELERATE, FILM, SLIDE, STATES, STRAIGHT, TURN
from finloop.modes.network_settings import NetworkSettings

_BEATING = 0.9  # quantile of the sways: that of a tail that beats


@dataclass(frozen=True)
class Phases:
    """Phases (n,) of straight swimming, and their ticks one after the other in flat arrays.

    state, ticks: of each, a number of `STATES` and its duration; the ticks of phase i begin at
    `start[i]` of speed_change and drift_deg; before: state of the phase before, −1 where the film
    does not show it; first_speed: at the tick before the phase, body lengths/s; speed_change,
    drift_deg: change of speed and heading since that tick; low, high: range of the film's speeds.
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


def learn_phases(motion: MotionStatistics, p: NetworkSettings) -> Phases:
    """Return a film's phases of straight swimming, such as slides; FinloopError for none.

    motion: how the film's fish swim; p: what counts as sliding, steady and fast.
    """
    tracks = motion.tracks
    sways = np.concatenate([track.sway[track.kind == TYPE_STRAIGHT] for track in tracks])
    still_sway = p.still_tail_ratio * float(np.quantile(sways, _BEATING))
    speeds = np.concatenate([track.speed for track in tracks])
    low, high = np.quantile(speeds, (p.min_speed_quantile, p.max_speed_quantile))
    runs = [run for track in tracks for run in track.runs()]
    straight = [run for run in runs if run.kind == TYPE_STRAIGHT]
    return _phases_of_runs(straight, still_sway, motion.delta, p, (float(low), float(high)))


def _phases_of_runs(
    runs: Sequence[SwimmingRun], still_sway: float, delta: int, p: NetworkSettings,
    speed_range: tuple[float, float],
) -> Phases:  # fmt: skip
    """Return the phases of straight runs of the film, each of one state, such as sliding.

    A phase is left out if its heading goes farther than `p.phase_drift_deg` from that of the frame
    before it; its state is still the state before the next phase. still_sway: sway of a still tail;
    delta: Δ in ticks; speed_range: lowest and highest speed of the film, body lengths/s.
    FinloopError if there are no phases.
    """
    least_ticks = max(1, round(p.phase_least * delta))
    kept_phases = []
    for run in runs:
        # Straight runs follow turns; what was before the first one of a track is unknown: −1.
        track, state_before = run.track, TURN if run.first > 0 else -1
        for state, first, end in _split_run(run, still_sway, p.steady_speed_ratio, least_ticks):
            frame_before = max(first - 1, 0)
            drift = track.heading_deg[first:end] - track.heading_deg[frame_before]
            if np.abs(drift).max() <= p.phase_drift_deg:
                speed = track.speed[frame_before]
                change = track.speed[first:end] - speed
                kept_phases.append((state, state_before, end - first, speed, change, drift))
            state_before = state
    if not kept_phases:
        raise too_little_error("straight swimming")
    states, states_before, ticks, speeds, changes, drifts = zip(*kept_phases, strict=True)
    return Phases(
        state=np.array(states, np.int8), before=np.array(states_before, np.int8),
        ticks=np.array(ticks, np.int32),
        start=first_ticks(ticks),
        first_speed=np.array(speeds), speed_change=np.concatenate(changes),
        drift_deg=np.concatenate(drifts), low=speed_range[0], high=speed_range[1],
    )  # fmt: skip


class _PhaseFrames(NamedTuple):
    """A phase of a run: its state, its first frame in the track, and one past its last."""

    state: int
    first: int
    end: int


def _split_run(
    run: SwimmingRun, still_sway: float, steady_growth: float, least_ticks: int
) -> list[_PhaseFrames]:
    """Split one straight run into phases by the state of its frames; return them in order.

    The state of a frame follows from its sway, how much the tail beats (a still one slides), and
    its growth, the relative change of the speed in a Δ. still_sway: a still tail sways less;
    steady_growth: largest growth of a steady speed, either way; least_ticks: of a phase; a shorter
    one is added to the phase before it, a shorter first one to the phase after it.
    """
    first, frames = run.first, slice(run.first, run.end)
    sway, growth = run.track.sway[frames], run.track.growth[frames]
    label = np.select(
        [sway < still_sway, growth > steady_growth, growth < -steady_growth],
        [SLIDE, ACCELERATE, DECELERATE],
        STRAIGHT,
    ).astype(np.int8)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(label)) + 1, [len(label)]])
    phases: list[_PhaseFrames] = []
    for begin, end in pairwise(edges.tolist()):
        part = _PhaseFrames(int(label[begin]), first + begin, first + end)
        last = phases.pop() if phases else part  # the first part continues itself
        if part.end - part.first < least_ticks or part.state == last.state:
            phases.append(last._replace(end=part.end))
        elif last.end - last.first < least_ticks:  # only the first can be so short
            phases.append(part._replace(first=last.first))
        else:
            phases += last, part
    return phases


def state_shares(features: pd.DataFrame, phases: Phases) -> dict[str, float]:
    """Return the percentage of time that the fish spend in each state, `<state>_pct`."""
    # The states before TURN are those of straight swimming; they share the rest of the time.
    straight = np.bincount(phases.state, weights=phases.ticks, minlength=TURN)[:TURN]
    turning = float((features["swimming_type"] != 0).mean())
    shares = np.append(straight / straight.sum() * (1 - turning), turning)
    return {
        f"{state}_pct": 100 * float(share)
        for state, share in zip(STATES[:FILM], shares, strict=True)
    }
