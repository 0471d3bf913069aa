"""The quality of forecasts, on held-out rows and on fish that swim by them.

They are compared with persistence (no change) and, for motion area Δ later, with the paper's
network (`finloop.bpn`) under the same control.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.schema import Column, Schema, columns
from finloop.base.stretches import longest_repeated_run
from finloop.features.area import measure_bend
from finloop.forecast.film import MOTION, FilmStates, Partition
from finloop.forecast.model import Forecast
from finloop.forecast.sampling import RolloutState, Sampler, draw_next_row, start_at_row, step_fish
from finloop.puppet.pose import Pose, backbone_steps

HELD_OUT = Schema(
    Column("row", "int32", "1"),
    *columns("float32", "1", "pose_rank", "forward_rank", "sideways_rank", "turning_rank"),
)
"""Held-out rows: the share of predicted next states below the true one, 0 … 1, for the first code
and the three speeds."""

FREE = Schema(
    Column("row", "int32", "1"),
    *columns("float32", "body length/s", "forward", "sideways"),
    Column("turning", "float32", "rad/s"),
    Column("pose", "float32", "1"),
)
"""A fish that swims freely, tick by tick: its speeds, its first code, and the row that it follows:
one of n, or of 2 n with mirror images."""

_TRIALS = 400  # random rows from which a fish starts, to measure how well it obeys its controls
_PRIOR = 4.0  # members that the variance of the whole film counts as, in an ensemble's variance
_LEAST_MEMBERS = 5  # of an ensemble: fewer say too little of its spread


class PredictedEnsembles(NamedTuple):
    """Predicted states (pose and speeds) after k held-out rows, each as an ensemble of members.

    rows (k,): of the film; mean, spread (k, d): mean and standard deviation of a row's members;
    rank (k, d): share of members below the true state, 0 … 1. The d numbers of a state and their
    units are those of `FilmStates`.
    """

    rows: Ints
    mean: Floats
    spread: Floats
    rank: Floats


def predict_ensembles(
    film: FilmStates, sampler: Sampler, parts: Partition, rng: np.random.Generator
) -> PredictedEnsembles:
    """Return the states predicted after held-out rows, each as an ensemble from training rows.

    A member is the network's prediction plus the error that the network made at a similar training
    row; rows with fewer than 5 members are left out. rng: draws where between two neighbouring
    members the true state lies.
    """
    is_training = np.zeros(len(film.states), bool)
    is_training[parts.train] = True
    errors = np.zeros_like(film.states)
    errors[film.rows] = film.states[film.rows + 1] - sampler.mean[film.rows]
    film_variance = errors[is_training].var(0)
    rows, means, spreads, ranks = [], [], [], []
    for row in parts.held_out.tolist():
        similar = sampler.to[sampler.start[row] : sampler.start[row + 1]]
        similar = similar[is_training[similar]]
        if len(similar) < _LEAST_MEMBERS:
            continue
        members = errors[similar]
        below = (members < errors[row]).sum(0) + rng.random(members.shape[1])
        count = len(similar)
        # The variance of few members is drawn towards that of the whole film.
        variance = (count * members.var(0) + _PRIOR * film_variance) / (count + _PRIOR)
        rows.append(row)
        means.append(sampler.mean[row] + members.mean(0))
        spreads.append(np.sqrt(variance))
        ranks.append(below / (count + 1))
    shape = -1, len(film.scale)
    return PredictedEnsembles(
        np.array(rows, np.int64),
        mean=np.array(means).reshape(shape),
        spread=np.array(spreads).reshape(shape),
        rank=np.array(ranks).reshape(shape),
    )


def measure_predictions(
    film: FilmStates, ensemble: PredictedEnsembles, sampler: Sampler, parts: Partition
) -> dict[str, float]:
    """Return errors, log likelihoods and coverage of predictions on held-out rows, by name.

    Errors: root mean squares in standard deviations of the film, of posture codes (pose) and of
    speeds (motion); likelihoods: nats per state number; coverage: % of true numbers in the inner 50
    or 80 % of their ensemble. Keys that name persistence: of the prediction that nothing changes.
    Likelihoods and coverage are left out without ensembles.
    """
    rows, true = parts.held_out, film.states[parts.held_out + 1]
    metrics = {}
    for name, which in {"pose": slice(0, -MOTION), "motion": slice(-MOTION, None)}.items():
        unit = film.scale[which]
        error, persistence_error = (
            float(np.sqrt(np.mean(((states[rows] - true)[:, which] / unit) ** 2)))
            for states in (sampler.mean, film.states)
        )
        metrics[f"{name}_error"] = error
        metrics[f"persistence_{name}_error"] = persistence_error
        metrics[f"{name}_skill_against_persistence"] = 1 - error / persistence_error
    change = film.states[parts.train + 1] - film.states[parts.train]
    if len(ensemble.rows):
        later = film.states[ensemble.rows + 1]
        metrics["held_out_log_likelihood"] = _log_likelihood(
            (later - ensemble.mean) / film.scale, ensemble.spread / film.scale
        )
        metrics["persistence_log_likelihood"] = _log_likelihood(
            (later - film.states[ensemble.rows]) / film.scale, change.std(0) / film.scale
        )
        for share in (50, 80):
            inner = np.abs(ensemble.rank - 0.5) <= share / 200
            metrics[f"truth_in_inner_{share}_pct"] = float(100 * inner.mean())
    return metrics


def _log_likelihood(error: Floats, deviation: Floats) -> float:
    """Return the mean log density, nats, of normal errors (k, d) of a standard deviation (k, d)."""
    return float(np.mean(-((error / deviation) ** 2) / 2 - np.log(deviation * np.sqrt(2 * np.pi))))


def roll_out_means(film: FilmStates, model: Forecast, rows: Ints) -> Floats:
    """Return the states (k, d) predicted for a time Δ after rows (k,), tick by tick.

    Each prediction is the input of the next one. The controls (displacement and turn) are those of
    the film.
    """
    past = film.states[rows[:, None] - np.arange(film.lags[-1] + 1)]
    for tick in range(film.delta):
        next_states = model.predict_means(past[:, film.lags], film.control[rows + tick])
        past = np.concatenate([next_states[:, None], past[:, :-1]], 1)
    return past[:, 0]


def _simulate_control(
    sampler: Sampler, film: FilmStates, row: int, control: Floats, rng: np.random.Generator
) -> tuple[float, float]:
    """Simulate a controlled fish for the time Δ; return its displacement [BL] and turn [rad].

    row: at which the fish starts; control (2,): displacement [BL] and turn [rad] over Δ, asked for.
    Turns are + to the left.
    """
    past = start_at_row(sampler, row).past
    state, steps = RolloutState(past, draw_next_row(sampler, row, control, rng)), []
    step_s = 1 / film.rate_hz
    for _ in range(film.delta):
        state = step_fish(sampler, state, control, rng)
        steps.append(state.past[0, -MOTION:] * step_s)
    # Places as complex numbers: each step is turned by the heading before it.
    ahead, left, turn = np.transpose(steps)
    heading = np.cumsum(turn)
    displacement = ((ahead + 1j * left) * np.exp(1j * np.append(0.0, heading[:-1]))).sum()
    return float(abs(displacement)), float(heading[-1])


def measure_control_slopes(
    sampler: Sampler, film: FilmStates, rng: np.random.Generator
) -> dict[str, float]:
    """Return how well a simulated fish obeys its control: slopes of motion against control.

    In each trial a fish starts at a random film row, and takes the control of a random row that is
    similar to it. Keys displacement_slope, angle_slope: 1 if the fish moves as controlled, 0 if it
    ignores the control. A key is missing if its control is the same in all trials, or no row is
    similar to another.
    """
    controls, motions = [], []
    for row in rng.choice(film.rows, _TRIALS).tolist():
        similar = sampler.to[sampler.start[row] : sampler.start[row + 1]]
        if len(similar):
            controls.append(sampler.control[rng.choice(similar)])
            motions.append(_simulate_control(sampler, film, row, controls[-1], rng))
    slopes: dict[str, float] = {}
    if not controls:
        return slopes
    for name, control, motion in zip(
        ("displacement_slope", "angle_slope"), np.transpose(controls), np.transpose(motions),
        strict=True,
    ):  # fmt: skip
        if np.ptp(control) > 0:
            slopes[name] = float(np.polyfit(control, motion, 1)[0])
    return slopes


def posture_bends(postures: Floats) -> Floats:
    """Return each posture's motion area (k,), how much it is bent, in squared body lengths, ≥ 0.

    postures (k, 2 + 2 n): as in `Pose.posture`. The motion area is the area that the backbone's
    spline encloses (fish paper §2.2).
    """
    zeros = np.zeros(len(postures))
    poses = Pose(zeros, zeros, heading_rad=zeros, size_px=zeros + 1, posture=postures)
    lines = poses.backbone_px()
    return np.abs(measure_bend(lines, backbone_steps(postures).sum(1)))


def rank_table(ensemble: PredictedEnsembles) -> pd.DataFrame:
    """Return the table HELD_OUT: the rank of true codes and speeds among the predicted members."""
    first_code_and_speeds = ensemble.rank[:, [0, -3, -2, -1]].T
    ranks = dict(zip(HELD_OUT.names[1:], first_code_and_speeds, strict=True))
    return pd.DataFrame({"row": ensemble.rows, **ranks})


def free_swim_table(states: Floats, rows: Ints) -> pd.DataFrame:
    """Return the table FREE of a free swim, with states (t, d) and rows (t,) from `swim_freely`."""
    return pd.DataFrame({
        "row": rows, "forward": states[:, -3], "sideways": states[:, -2], "turning": states[:, -1],
        "pose": states[:, 0],
    })  # fmt: skip


def compare_free_swim(
    states: Floats, rows: Ints, film: FilmStates, sampler: Sampler
) -> dict[str, float]:
    """Return, by name, spread and repeats of a free swim (by predictions alone), beside the film's.

    states (t, d), rows (t,): from `swim_freely`. Keys …_spread_of_film: standard deviation divided
    by the film's; free_clamped_pct: share of ticks at the edge of the film's range;
    free_longest_…_repeat_s: longest stretch of states, or of rows, that is shown again.
    """
    filmed = film.states[film.rows]
    clamped = (states <= sampler.low) | (states >= sampler.high)
    spread = states.std(0) / filmed.std(0)
    _, state_numbers = np.unique(states.round(9), axis=0, return_inverse=True)  # of equal states
    # The last three numbers of a state are the speeds forward and sideways, and turning.
    return {
        "free_pose_spread_of_film": float(np.sqrt((spread[:-MOTION] ** 2).mean())),
        "free_forward_spread_of_film": float(spread[-3]),
        "free_turning_spread_of_film": float(spread[-1]),
        "free_clamped_pct": float(100 * clamped.any(1).mean()),
        "free_longest_exact_repeat_s": longest_repeated_run(state_numbers.ravel()) / film.rate_hz,
        "free_longest_row_repeat_s": longest_repeated_run(rows) / film.rate_hz,
    }


def autocorrelation(values: Floats, follows: Mask, lags: int) -> Floats:
    """Return the autocorrelation (lags,) of a series (n,), at lags 0 … lags − 1.

    follows (n − 1,): whether value i + 1 continues value i; pairs across a gap do not count.
    """
    centred, run = values - values.mean(), np.append(0, np.cumsum(~follows))
    variance, result = float((centred**2).mean()), []
    for lag in range(lags):
        products = centred[lag:] * centred[: len(centred) - lag]
        same_run = run[lag:] == run[: len(run) - lag]
        result.append(float(products[same_run].mean()) / variance)
    return np.array(result)
