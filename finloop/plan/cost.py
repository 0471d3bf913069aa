"""The cost of a branch of `matching`, in ticks: every term has its weight here."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from finloop.animate.route import Route, due_along, heading_at, point_along
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_leaf, for_kernels, kernel, leaf_kernel
from finloop.edit.bodies import Movement
from finloop.edit.schema import TERMS
from finloop.plan.graph import MotionGraph, mean_step_px, row_lags

SEAM, REPEAT, RARITY, LAG, PATH, TIME, TO_COME, CHANCE = range(len(TERMS))
"""Numbers of the terms, `finloop.edit.schema.TERMS`."""


class CostWeights(NamedTuple):
    """Settings of the beam search, and weights of its costs; times and costs in ticks.

    fast_px: px that a fast fish of the film swims in a tick; turn_deg: degrees that a fish turns
    for the cost of a tick; stride: ticks between two checks of a branch, at which it may jump;
    beam: branches followed at once; seam: cost of a jump of one natural step; repeat: cost of a row
    just seen; memory: ticks until a row on screen is forgotten; retry_beam: branches followed in a
    second search, where the first left some out and none of its branches leads on.
    """

    fast_px: float
    turn_deg: float
    stride: int
    beam: int
    seam: float
    repeat: float
    memory: float
    retry_beam: int = 0


@leaf_kernel
def repeat_cost(ticks_ago: float, weights: CostWeights) -> float:
    """Return the cost, in ticks, of showing a row again that was on screen `ticks_ago` before.

    The cost falls from `weights.repeat` to 0 at `weights.memory` ticks.
    """
    if ticks_ago >= weights.memory:  # most rows; a division takes long
        return 0.0
    return weights.repeat * (1.0 - ticks_ago / weights.memory)


_FADING_TICKS = 3  # ticks after a transition in which an offset of the pose fades fastest


@dataclass(frozen=True)
class Rarity:
    """The cost of the steps from row to row of a film: steps that the film seldom shows cost more.

    A step that the film shows once in n frames costs weight × n ticks. steps (n,): Euclidean
    distance (Eq. 5) of a row's picture from the one before, 0 where there is none; sorted_steps
    (k,): those there are, rising; added_step: the largest step in a tick that inertialization, the
    fading of a pose offset, adds for an offset of 1 in the pose codes.
    """

    steps: Floats
    sorted_steps: Floats
    weight: float
    added_step: float

    @classmethod
    def from_movement(
        cls, movement: Movement, codes: Floats, goes_on: Mask, filmed_steps: Floats,
        spring_response: Floats, weight: float,
    ) -> "Rarity":  # fmt: skip
        """Return a `Rarity`, which prices steps between film rows, from a film's measured movement.

        movement: of the body, from each row to the next; codes (n, c): pose codes; goes_on (n,):
        whether the next row is the next frame; filmed_steps (n,): Euclidean distance (Eq. 5) from a
        row's picture to the next; where it is NaN, the body's movement is scaled to stand in.
        spring_response (t,): share left of a pose offset after 0, 1 … ticks; its steepest fall sets
        `added_step`. weight: a step shown once in n frames costs weight × n ticks.
        """
        pairs = goes_on[:-1]  # of a row and the next one
        whole, bends = (values[pairs] for values in movement)
        filmed = filmed_steps[:-1][pairs]
        code_steps = np.linalg.norm(np.diff(codes, axis=0), axis=1)[pairs]
        is_known = np.isfinite(filmed)
        # By how much a picture changes when its fish moves by one body length.
        distance_per_bl = float(filmed[is_known].sum()) / max(float(whole[is_known].sum()), 1e-12)
        steps = np.zeros(len(goes_on))
        steps[1:][pairs] = np.where(is_known, filmed, distance_per_bl * whole)
        # An offset of 1 in the codes fades by at most this share in a tick; a step of 1 in the
        # codes bends the body by Σ bends / Σ code_steps body lengths.
        fastest_fade = float(-np.diff(spring_response, append=0.0).min(initial=0.0))
        fade_distance = fastest_fade * distance_per_bl  # of pictures, if it bent by a body length
        added_step = fade_distance * float(bends.sum()) / max(float(code_steps.sum()), 1e-12)
        return cls(steps, np.sort(steps[1:][pairs]), weight, added_step)

    def step_costs(self, steps: Floats) -> Floats:
        """Return the cost of each step, in ticks, of the shape of `steps`.

        steps (…): Euclidean distances (Eq. 5) of pictures. The cost grows with the share of film
        steps that are smaller.
        """
        return np.asarray(_step_cost(steps, self.sorted_steps, self.weight))

    @property
    def cumulative_row_costs(self) -> Floats:
        """Return the running sum (n,), in ticks, of each row's cost less the mean row's."""
        return (self._row_costs - self._row_costs.mean()).cumsum()

    @cached_property
    def _row_costs(self) -> Floats:
        """Return the cost (n,), in ticks, of the step to each row."""
        return self.step_costs(self.steps)

    def transition_costs(self, rows: Ints, codes: Floats, row: int) -> Floats:
        """Return the extra cost (k,), in ticks, of the first steps after a transition to each row.

        The two poses of a transition differ. Over the first three steps the difference fades, which
        makes each of them larger than in the film. rows (k,): rows that may be shown next; row: the
        one on screen; of a film of n rows, n … 2 n − 1 are the mirror images. codes (m, c): pose
        codes of all rows, and of the mirror images, if there are any.
        """
        costs = _transition_costs(
            self.steps, self._row_costs, self.sorted_steps, self.weight, self.added_step, rows,
            codes, row,
        )  # fmt: skip
        return np.asarray(costs)


@for_kernels
def _step_cost(step, sorted_steps, weight):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of a step from one picture to the next: rare steps cost more.

    It is weight · n / m, where m of the film's n steps are as large or larger, but m is at least 1.
    step: a number or an array, as an Euclidean distance (Eq. 5); sorted_steps (n,): those of the
    film, rising.
    """
    count = len(sorted_steps)
    return weight * count / np.maximum(count - np.searchsorted(sorted_steps, step), 1)


@kernel
def _transition_costs(  # type: ignore[no-untyped-def]
    steps, row_costs, sorted_steps, weight, added_step, rows, codes, row
):  # fmt: skip
    """Return the extra cost (k,), in ticks, of the first steps after a transition to each row (k,).

    These are the _FADING_TICKS steps in which the offset between the two poses fades fastest.
    steps, sorted_steps, weight, added_step: fields of `Rarity`; row_costs (n,): ticks that the step
    to each row costs in the film; codes (m, c): pose codes of all rows and, from n on, their mirror
    images; row: the one on screen.
    """
    costs = np.zeros(rows.size)
    for k in range(rows.size):
        square_offset = 0.0  # between the poses of the two rows
        for c in range(codes.shape[1]):
            square_offset += (codes[rows[k], c] - codes[row, c]) ** 2
        for tick in range(1, 1 + _FADING_TICKS):
            next_row = (rows[k] + tick) % len(steps)  # a mirror image has the same steps
            step = steps[next_row] + added_step * np.sqrt(square_offset)
            costs[k] += _step_cost(step, sorted_steps, weight) - row_costs[next_row]
    return costs


_MOST_LAGS = 3.0  # times the usual lag, beyond which the cost of rest does not grow
_BASE = 0.25  # added to the lag on a path, in usual lags: slow fish stay closer to the path


class Tempo(NamedTuple):
    """How fast the film's fish swim, and how much they usually lag behind the mean speed.

    A lag: ticks by which a fish is behind one that swims at the mean speed, < 0 if it is ahead.
    What every tick adds is summed up, and fades. step_px: mean px that they swim in a tick; keeps:
    share of a lag that is left after a tick; usual: root mean square of their lags, ticks.
    """

    step_px: float
    keeps: float
    usual: float

    @classmethod
    def from_film(cls, film: MotionGraph, memory_ticks: float, least_ticks: float) -> "Tempo":
        """Return the film's mean step, how fast a lag fades, and the root mean square of its lags.

        A lag: ticks by which a fish is behind one that swims at the mean speed. The lag at a row is
        what is left of the lag at the row before, plus the row's own (`row_lags`). memory_ticks:
        ticks after which 1/e of a lag is left; least_ticks: a smaller root mean square is raised to
        this.
        """
        rows, keeps = film.rows[: film.filmed_count], float(np.exp(-1 / memory_ticks))
        lags = _sum_fading_lags(row_lags(rows), rows["has_next"], keeps)
        usual = float(np.sqrt(np.mean(lags**2)))
        return cls(mean_step_px(rows), keeps, max(usual, least_ticks))

    def lag_after(self, lag: float, trajectory: Floats, begin_px: tuple[float, float]) -> float:
        """Return a fish's lag behind the film's mean speed, in ticks, after a trajectory.

        trajectory (n, 3): x, y px, heading; lag: before it; begin_px: x, y of the fish before it.
        """
        return float(_lag_after(self.step_px, self.keeps, lag, trajectory, begin_px))

    def cost_of_rest(self, lag: float, weight: float) -> float:
        """Return what a tick on the spot costs, in ticks; negative for a fish that is ahead.

        lag: ticks, + where the fish is late; weight: the cost at the usual lag, ticks. The cost is
        proportional to the lag, and constant beyond 3 usual lags to either side.
        """
        return weight * min(max(lag / self.usual, -_MOST_LAGS), _MOST_LAGS)

    def cost_of_rest_on_path(self, lag: float, weight: float) -> float:
        """Return what a tick on the spot costs a fish on a path, in ticks ≥ 0.

        lag: ticks, + where the fish is late; weight: the cost at the usual lag, ticks; a quarter of
        it is added at every lag, as slow fish stay closer to the path. Beyond 3 usual lags the cost
        is constant.
        """
        return weight * max(_BASE + min(lag / self.usual, _MOST_LAGS), 0.0)


@kernel
def _lag_after(step_px, keeps, lag, trajectory, begin_px):  # type: ignore[no-untyped-def]
    """Return the lag, in ticks, after a trajectory (n, 3), compiled; < 0: the fish is ahead.

    A tick at rest adds 1. step_px: mean px in a tick; keeps: share of a lag left after a tick; lag,
    begin_px: the fish's lag and x, y px before the trajectory.
    """
    x, y = begin_px
    for t in range(len(trajectory)):
        lag = keeps * lag + 1 - np.hypot(trajectory[t, 0] - x, trajectory[t, 1] - y) / step_px
        x, y = trajectory[t, 0], trajectory[t, 1]
    return lag


@kernel
def _sum_fading_lags(row_lags, has_next, keeps):  # type: ignore[no-untyped-def]
    """Return the lag (n,) at each row, ticks: the row's own, plus what is left of the one before.

    row_lags (n,): the rows' own; has_next (n,): whether the film goes on from a row, as after it
    another track begins with no lag; keeps: share of a lag that is left after a tick.
    """
    lags, lag = np.empty(len(row_lags)), 0.0
    for row in range(len(row_lags)):
        lag = keeps * lag + row_lags[row]
        lags[row] = lag
        if not has_next[row]:
            lag = 0.0
    return lags


class Steering(NamedTuple):
    """How far a fish may be steered onto its path, and what leaving the path costs.

    turn [°/tick, of a fast fish], shift [px/tick at a body length/s]: the largest corrections,
    smaller for a slower fish, none for a resting one; fast_bl_s: speed of a fast fish, body
    lengths/s; reach: ticks of film to look ahead; length_px: a body length. Costs, in ticks per
    tick: across, late: of a body length beside the path, or from the place due now; heading: of a
    right angle to the requested heading; effort: of the largest correction.
    """

    turn: float
    shift: float
    fast_bl_s: float
    reach: int
    length_px: float
    across: float
    late: float
    heading: float
    effort: float


NO_STEERING = Steering(
    turn=0.0, shift=0.0, fast_bl_s=1.0, reach=0, length_px=1.0,
    across=0.0, late=0.0, heading=0.0, effort=0.0,
)  # fmt: skip


@finite_leaf
def path_tick_cost(
    route: Route, pose: tuple[float, float, float], nearest: tuple[float, float, float],
    corrections: tuple[float, float], tick: int, steering: Steering,
) -> float:  # fmt: skip
    """Return the cost, in ticks, of one tick on a path: offset, delay, heading, corrections.

    pose: x, y px, heading in degrees; nearest: the point of the route nearest to the fish, px along
    the route, and x, y px; corrections: the turn as a share of a fast fish's largest, and the shift
    as a share of the largest at the fish's own speed. The delay counts on a route with times, the
    heading on one with headings.
    """
    unit_px2 = steering.length_px * steering.length_px
    (x, y, heading), (along_px, near_x, near_y), (turn, shift) = pose, nearest, corrections
    cost = steering.across * offset_cost((near_x - x) ** 2 + (near_y - y) ** 2, unit_px2)
    if route.when.size:
        due_x, due_y = point_along(route, due_along(route, tick))
        cost += steering.late * offset_cost((due_x - x) ** 2 + (due_y - y) ** 2, unit_px2)
    if route.heading.size:
        off_rad = np.radians(heading_at(route, along_px) - heading)
        cost += steering.heading * (1.0 - np.cos(off_rad))
    return cost + steering.effort * (turn * turn + shift * shift)


@finite_leaf
def offset_cost(distance_px2: float, unit_px2: float) -> float:
    """Return the cost of a distance: its square in units, linear beyond one unit (Huber, 1964).

    distance_px2: square of the distance, px²; unit_px2: square of the unit, px².
    """
    share = distance_px2 / unit_px2
    return share if share < 1.0 else 2.0 * np.sqrt(share) - 1.0
