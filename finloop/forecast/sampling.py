"""Sampling: the next state is the network's mean plus a departure from it that the film shows.

A fish follows a row: from tick to tick it takes the departures of successive rows, whose states are
similar to its own. Now and then it jumps to a similar row of another passage of the film. With F
the film's states, r the row, f the network, x the fish's state and u the control:

    x(t + 1) = F(r + 1) + s · (f(past, u) − f(past of r, u of r))

A fish in a row's own state and under its own control swims as filmed. Elsewhere the network
predicts the difference, and s < 1 lets it settle. A control that differs from the row's turns the
fish as the network has learnt.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_kernel, finite_leaf
from finloop.forecast.film import MOTION, FilmStates
from finloop.forecast.model import Forecast, KernelWeights, Weights, predict_next_mean
from finloop.forecast.settings import ForecastSettings

_BATCH = 50_000  # rows at a time, to save memory
_EDGES = 1_000_000  # pairs of similar rows, sampled to measure how much controls differ


Similar = NDArray[np.int32]
"""Rows that are similar to others; a million rows have 50 million of them."""


class Sampler(NamedTuple):
    """All data that drive a simulated fish, as kernels take them; m rows, with mirror images.

    net: the network's weights; states, mean (m, d): states of the rows, and the next states
    predicted from them; control (m, 2): next motion; usable (m,): whether a fish can follow the
    row; low, high (d,): range of the film's states; lags (l,): ticks; settle (d,): share of a
    difference that remains after a tick; start, to: the rows similar to row i are
    to[start[i]:start[i + 1]]; follow_ticks: mean time for which a row is followed; tolerance (2,):
    difference of a row's control from the given one at which the row is exp(−1/2) times as likely;
    rests (m,): whether a fish at the row rests, and so moves as in the film, not as predicted.
    """

    net: KernelWeights
    states: Floats
    mean: Floats
    control: Floats
    usable: Mask
    low: Floats
    high: Floats
    lags: Ints
    settle: Floats
    start: Ints
    to: Similar
    follow_ticks: float
    tolerance: Floats
    rests: Mask


class RolloutState(NamedTuple):
    """A simulated fish: its past states (L + 1, d), the present first, and its present film row.

    L: the longest lag.
    """

    past: Floats
    row: int


def build_sampler(
    film: FilmStates, model: Forecast, graph: tuple[Ints, Similar], p: ForecastSettings,
    mean: Floats | None = None,
) -> Sampler:  # fmt: skip
    """Return the `Sampler`, all that drives a simulated fish, from a film, its network and a graph.

    graph: of similar rows, start and to, from `build_similarity_graph`; mean (m, d): predicted next
    states of the rows, None to compute them.
    """
    rows, (start, to) = film.rows, graph
    if mean is None:
        mean = np.zeros_like(film.states)
        for batch in np.split(rows, range(_BATCH, len(rows), _BATCH)):
            mean[batch] = model.predict_means(film.past(batch), film.control[batch])
    edges = np.arange(0, len(to), 1 + len(to) // _EDGES)  # a sample of the similar pairs
    source = np.searchsorted(start, edges, "right") - 1
    differences = film.control[source] - film.control[to[edges]]
    code_count = len(film.scale) - MOTION
    half_lives = p.pose_half_life_deltas, p.motion_half_life_deltas
    half_life = np.repeat(half_lives, [code_count, MOTION])
    return Sampler(
        net=model.kernel_weights(), states=np.nan_to_num(film.states), mean=mean,
        control=np.nan_to_num(film.control), usable=film.usable, low=film.states[rows].min(0),
        high=film.states[rows].max(0), lags=film.lags,
        settle=0.5 ** (1 / (half_life * film.delta)), start=start, to=to,
        follow_ticks=max(1.0, p.follow_deltas * film.delta, film.memory),
        # A share of the usual difference.
        tolerance=p.control_tolerance * np.sqrt((differences**2).mean(0)),
        rests=np.zeros(len(film.states), bool),  # `plan.graph.remove_dead_ends` sets them
    )  # fmt: skip


def start_at_row(sampler: Sampler, row: int) -> RolloutState:
    """Return a simulated fish that starts at a film row, with the filmed fish's past as its own."""
    return RolloutState(sampler.states[row - np.arange(sampler.lags[-1] + 1)], row)


def step_fish(
    sampler: Sampler, state: RolloutState, control: Floats | None, rng: np.random.Generator
) -> RolloutState:
    """Simulate a fish for one tick, under a control (2,), or freely if that is None; return it.

    At the end of a film run, or at random, the fish jumps to a similar row. Only `rng` is changed.
    """
    row = state.row
    if not sampler.usable[row] or rng.random() < 1 / sampler.follow_ticks:
        row = draw_next_row(sampler, row, control, rng)
    row_control = sampler.control[row] if control is None else np.asarray(control, float)
    next_state = follow_row(sampler, state.past, row, 1, row_control)
    return RolloutState(np.concatenate([next_state, state.past[:-1]]), row + 1)


def draw_next_row(
    sampler: Sampler, row: int, control: Floats | None, rng: np.random.Generator
) -> int:
    """Return a film row that a simulated fish follows next, drawn at random among similar rows.

    control (2,): with q a row's squared difference from it, in units of `sampler.tolerance`, the
    row is exp(−½ (q − least q)) times as likely; None: the control does not matter.
    """
    rows, weights = next_row_weights(sampler, row)
    if control is not None:
        misfit = (((sampler.control[rows] - control) / sampler.tolerance) ** 2).sum(1)
        weights = weights * np.exp(-0.5 * (misfit - misfit.min(initial=np.inf)))
    return int(rows[np.searchsorted(np.cumsum(weights), rng.random() * weights.sum())])


def next_row_weights(sampler: Sampler, row: int) -> tuple[Ints, Floats]:
    """Return the rows (k,) that a fish may follow next, and the weight (k,) of each in the draw.

    row: the one that the fish follows now. If it is not usable and has no similar rows, the last
    earlier row that is or has stands in for it. The result is the rows similar to the stand-in, and
    then the stand-in itself. The weights, which need not sum to 1, let all rows be visited equally
    often (Metropolis).
    """
    stand_in = row
    while not sampler.usable[stand_in] and sampler.start[stand_in] == sampler.start[stand_in + 1]:
        stand_in -= 1
    rows = sampler.to[sampler.start[stand_in] : sampler.start[stand_in + 1]]
    neighbour_counts = sampler.start[rows + 1] - sampler.start[rows]
    weights = 1 / np.maximum(neighbour_counts, max(len(rows), 1))
    # The stand-in gets what the similar rows leave of 1, but nothing where the fish has to leave.
    has_to_leave = not sampler.usable[row] and len(rows) > 0
    stay_weight = 0.0 if has_to_leave else max(1 - weights.sum(), 0.0)
    # What is similar to `row` comes as far after these rows as `row` after its stand-in. There only
    # usable rows count; if there are none, the rows themselves do.
    shifted = rows + row - stand_in
    is_usable = sampler.usable[np.minimum(shifted, len(sampler.usable) - 1)]
    if is_usable.any():
        rows, weights = shifted[is_usable], weights[is_usable]
    return np.append(rows, stand_in), np.append(weights, stay_weight)


def swim_freely(sampler: Sampler, ticks: int, rng: np.random.Generator) -> tuple[Floats, Ints]:
    """Simulate a fish from a random film row; return its states (ticks, d) and rows (ticks,).

    The fish swims without control; the rows are those of the film that it follows.
    """
    past, row = start_at_row(sampler, int(rng.choice(np.flatnonzero(sampler.usable))))
    states, rows, done = [], [], 0
    while done < ticks:
        row = draw_next_row(sampler, row, None, rng)
        run_ticks = int(rng.geometric(1 / sampler.follow_ticks))
        later = follow_row(sampler, past, row, run_ticks, sampler.control[row])  # last tick first
        past = np.concatenate([later, past])[: len(past)]
        states.append(later[::-1])
        rows.append(row + 1 + np.arange(len(later)))
        row += len(later)
        done += len(later)
    return np.concatenate(states)[:ticks], np.concatenate(rows)[:ticks]


@finite_leaf
def _fill_with_past(inputs: Weights, states: Floats, present_index: int, lags: Ints) -> None:
    """Write the states at the given lags before the present into the first l · d network inputs.

    inputs: changed; states (…, d): the latest first, the present one at `present_index`.
    """
    size = states.shape[1]
    for i in range(lags.size):
        for j in range(size):
            inputs[i * size + j] = states[present_index + lags[i], j]


@finite_kernel
def follow_row(sampler: Sampler, past: Floats, row: int, ticks: int, control: Floats) -> Floats:
    """Return the next states (ticks, d) of a fish that moves as the film does from a row on.

    The last tick is first. Each is the film's state plus `settle` times the difference of two
    predictions: from the fish's own past, and from the film's (sampler.mean). The motion of a row
    at rest is the film's alone. The states are fewer if the row's track ends. past (L + 1, d): the
    fish's states, the present first; control (2,): of the first tick; its difference from the row's
    own stays constant.
    """
    size, lags, past_length = sampler.states.shape[1], sampler.lags, len(past)
    while ticks > 1 and not sampler.usable[row : row + ticks].all():
        ticks -= 1
    states = np.empty((ticks + past_length, size))  # the latest first: the present moves to index 0
    for i in range(past_length):
        for j in range(size):
            states[ticks + i, j] = past[i, j]
    inputs, mean = np.empty(lags.size * size + 2, np.float32), np.empty(size)
    hidden = np.empty((2, sampler.net.second_bias.shape[1]), np.float32)
    for t in range(ticks):
        present_index = ticks - t
        _fill_with_past(inputs, states, present_index, lags)
        for j in range(2):
            inputs[lags.size * size + j] = (
                sampler.control[row + t, j] + control[j] - sampler.control[row, j]
            )
        predict_next_mean(sampler.net, inputs, mean, hidden)
        for j in range(size):
            value = sampler.states[row + t + 1, j]
            is_motion = j >= size - MOTION  # the last components of a state are its motion
            if not (sampler.rests[row + t + 1] and is_motion):
                value += sampler.settle[j] * (mean[j] - sampler.mean[row + t, j])
            states[present_index - 1, j] = min(max(value, sampler.low[j]), sampler.high[j])
    return states[:ticks]
