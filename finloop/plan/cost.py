"""The cost of a way of `matching`, in ticks: every term has its weight here."""

from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, chain
from typing import NamedTuple

import numpy as np

from finloop.animate.route import Route, asked_at, heading_at, place
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import finite_leaf, for_kernels, kernel
from finloop.edit.bodies import Movement
from finloop.edit.schema import TERMS
from finloop.plan.graph import MotionGraph, lags, mean_step_px

SEAM, REPEAT, RARITY, LAG, PATH, TIME, TO_COME, CHANCE = range(len(TERMS))
"""Numbers of the terms, `finloop.edit.schema.TERMS`."""


class CostWeights(NamedTuple):
    """Settings of the search, and weights of its costs; times and costs in ticks.

    pace [px/tick]: of a fish at typical high speed; turning [°/tick]: of the film's turns, median;
    stride: ticks between two checks of a way, at which it may jump; beam: branches followed at
    once; seam: cost of a jump of one natural step; repeat: cost of a row just seen; memory: until a
    row is forgotten.
    """

    pace: float
    turning: float
    stride: int
    beam: int
    seam: float
    repeat: float
    memory: float


@for_kernels
def repeat_cost(ago, weights):  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of showing again a row that was on screen `ago` ticks before.

    ago: a number or an array. The cost falls from `weights.repeat` to 0 at `weights.memory` ticks.
    """
    return weights.repeat * np.maximum(0.0, 1.0 - ago / weights.memory)


_SOON = 3  # ticks in which an offset dies away fastest


@dataclass(frozen=True)
class Rarity:
    """The cost of the steps to the film's rows (n,): rare steps cost more.

    A step that the film shows once in n frames costs share × n ticks. steps (n,): distance (Eq. 5)
    from the row before, 0 where there is none; known (k,): those that are known, rising; pull: the
    largest step that an offset of 1 in the pose codes makes in a tick while it dies away.
    """

    steps: Floats
    known: Floats
    share: float
    pull: float

    @classmethod
    def from_movement(
        cls, moved: Movement, codes: Floats, goes_on: Mask, seen: Floats, spring: Floats,
        share: float,
    ) -> "Rarity":  # fmt: skip
        """Return the rarity of a film (n rows), from its steps and the movements of its fish.

        codes (n, c): pose codes; goes_on (n,): whether the next row is the next frame; seen (n,):
        distance (Eq. 5) from a row to the next, NaN where unknown: the body's movement replaces it
        there; spring (t,): what is left of an offset of 1 after 0, 1 … ticks; share: weight.
        """
        here = goes_on[:-1]
        moves, bends = (one[here] for one in moved)
        step, far = seen[:-1][here], np.linalg.norm(np.diff(codes, axis=0), axis=1)[here]
        sure = np.isfinite(step)
        unit = float(step[sure].sum()) / max(float(moves[sure].sum()), 1e-12)
        steps = np.zeros(len(goes_on))
        steps[1:][here] = np.where(sure, step, unit * moves)
        fastest = float(-np.diff(spring, append=0.0).min(initial=0.0))
        pull = fastest * unit * float(bends.sum()) / max(float(far.sum()), 1e-12)
        return cls(steps, np.sort(steps[1:][here]), share, pull)

    def price(self, steps: Floats) -> Floats:
        """Return the cost, in ticks, of each of some steps (…), distances as in Eq. 5."""
        smaller = np.searchsorted(self.known, steps)
        return self.share * len(self.known) / np.maximum(len(self.known) - smaller, 1)

    @property
    def cumulative(self) -> Floats:
        """Return the running sum (n,) of the rows' costs, each less their mean, in ticks."""
        return (self._each - self._each.mean()).cumsum()

    @cached_property
    def _each(self) -> Floats:
        return self.price(self.steps)

    def transition_costs(self, rows: Ints, far: Floats) -> Floats:
        """Return the extra ticks (k,) that going on at each of rows (k,) costs at first.

        The first three steps count. far (k,): distance of each row's pose code from the one on
        screen. Rows n, n + 1 … are mirror images.
        """
        soon = (rows[:, None] + np.arange(1, 1 + _SOON)) % len(self.steps)
        steps = self.steps[soon] + self.pull * far[:, None]
        return (self.price(steps) - self._each[soon]).sum(1)


_MOST = 3.0  # times the usual lag, beyond which the cost does not grow
_BASE = 0.25  # of the price at the usual lag, along a path for a fish that does not lag


class Tempo(NamedTuple):
    """How fast the film's fish swim, and how much they usually lag.

    step_px: mean px that they swim in a tick; keeps: share of a lag that is left after a tick;
    usual: root mean square of their lags, ticks.
    """

    step_px: float
    keeps: float
    usual: float

    @classmethod
    def from_film(cls, film: MotionGraph, memory: float, least: float) -> "Tempo":
        """Return the tempo of a film.

        memory: ticks after which 1/e of a lag is left; least: smallest `usual` lag, ticks.
        """
        rows, keeps = film.rows[: film.filmed], float(np.exp(-1 / memory))
        tracks = np.split(lags(rows), np.flatnonzero(~rows["has_next"]) + 1)
        summed = [accumulate(one.tolist(), lambda left, lag: keeps * left + lag) for one in tracks]
        usual = float(np.sqrt(np.mean(np.fromiter(chain(*summed), float) ** 2)))
        return cls(mean_step_px(rows), keeps, max(usual, least))

    def lag_after(self, lag: float, way: Floats, begin: tuple[float, float]) -> float:
        """Return the lag, in ticks, after a way that begins at `begin`, x, y px, with `lag`.

        way (n, 3): x, y px, heading.
        """
        return float(_lag_after(self.step_px, self.keeps, lag, way, begin))

    def rest_price(self, lag: float, share: float) -> float:
        """Return what a tick on the spot costs, in ticks, at a lag; < 0 for a fish that is ahead.

        lag: ticks, + where the fish is late; share: the cost at the usual lag, ticks. The cost is
        proportional to the lag, and constant beyond 3 usual lags to either side.
        """
        return share * min(max(lag / self.usual, -_MOST), _MOST)

    def rest_price_on_path(self, lag: float, share: float) -> float:
        """Return what a tick on the spot costs along a path, in ticks ≥ 0, at a lag in ticks.

        share: the cost per usual lag; a quarter of it is added, as slow fish stay closer to the
        path.
        """
        return share * max(_BASE + min(lag / self.usual, _MOST), 0.0)


@kernel
def _lag_after(step_px, keeps, lag, way, begin):  # type: ignore[no-untyped-def]
    x, y = begin
    for t in range(len(way)):
        lag = keeps * lag + 1 - np.hypot(way[t, 0] - x, way[t, 1] - y) / step_px
        x, y = way[t, 0], way[t, 1]
    return lag


class Steering(NamedTuple):
    """How far a fish may be steered onto its path, and what leaving the path costs.

    turn [°/tick, of a brisk fish], shift [px/tick at a body length/s]: the largest corrections,
    smaller for a slower fish, none for a resting one; brisk: typical high speed, body lengths/s;
    reach: ticks of film to look ahead; length_px: a body length. Costs, in ticks per tick: across,
    late: a body length beside the path, and from the place due now; heading: at right angles to the
    requested heading; effort: the largest correction.
    """

    turn: float
    shift: float
    brisk: float
    reach: int
    length_px: float
    across: float
    late: float
    heading: float
    effort: float


NO_STEERING = Steering(0.0, 0.0, 1.0, 0, 1.0, 0.0, 0.0, 0.0, 0.0)


@finite_leaf
def tick_cost(route: Route, at, foot_at, used, tick: int, steering: Steering) -> float:  # type: ignore[no-untyped-def]
    """Return the cost, in ticks, of a tick on a path: offset, delay, heading, corrections.

    at: x, y px, heading; foot_at: px along the path, x and y px of the foot; used: turn and shift
    as shares of the largest: the turn of a brisk fish, the shift at its own speed.
    """
    square = steering.length_px * steering.length_px
    x, y, heading = at
    cost = steering.across * huber((foot_at[1] - x) ** 2 + (foot_at[2] - y) ** 2, square)
    if route.when.size:
        tx, ty = place(route, asked_at(route, tick))
        cost += steering.late * huber((tx - x) ** 2 + (ty - y) ** 2, square)
    if route.heading.size:
        off = np.radians(heading_at(route, foot_at[0]) - heading)
        cost += steering.heading * (1.0 - np.cos(off))
    return cost + steering.effort * (used[0] * used[0] + used[1] * used[1])


@finite_leaf
def huber(far2: float, unit2: float) -> float:
    """Return the square of a distance in units; beyond one unit it grows linearly.

    far2: square of the distance, px²; unit2: square of the unit, px².
    """
    share = far2 / unit2
    return share if share < 1.0 else 2.0 * np.sqrt(share) - 1.0
