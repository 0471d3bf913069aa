"""The world of a fish of `matching`: the tank, the film, and what the film teaches."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from finloop.animate.obstacles import NO_DISCS, Discs
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.features.table import wrap_deg
from finloop.plan.cost import CostWeights, Steering, Tempo
from finloop.plan.graph import MotionGraph, farthest_distances, ticks_to_film_end
from finloop.plan.matching_settings import AllSettings
from finloop.plan.walls import Bounds, tank_bounds
from finloop.social.walls import Walls


@dataclass(frozen=True)
class FilmWorld(World):
    """The world of a fish of `matching`: the tank, the film, and statistics of its motion.

    film: motion graph of the rows; settings: parameters of `animate` and `matching`; discs: that
    cover the body, to test whether a picture is inside the tank; without any the fish keeps to
    where every picture fits.
    """

    film: MotionGraph
    settings: AllSettings
    discs: Discs = NO_DISCS

    def to_ticks(self, time_deltas: float) -> int:
        """Return a time in Δ, the unit of the parameters, as a whole number of ticks."""
        return round(time_deltas * self.motion.delta)

    @cached_property
    def walls(self) -> Walls:
        """Return the walls of the tank, of which fish that swim by a rule keep clear."""
        return Walls(self.tank.arena, self.motion.body_length_px)

    @cached_property
    def bounds(self) -> Bounds:
        """Return the bounds that keep a fish inside the tank: depths, walls and discs."""
        return tank_bounds(self.tank, self.discs)

    @cached_property
    def farthest_px(self) -> Floats:
        """Return the largest distances (t,), px, that the film's fish cover in 0, 1, 2 … ticks.

        They reach twice as far ahead as a fish expects others to keep their places.
        """
        return farthest_distances(self.film, self.to_ticks(2 * self.settings.give_way) + 2)

    @cached_property
    def tempo(self) -> Tempo:
        """Return how fast the film's fish swim on average, and how much they usually lag."""
        return Tempo.from_film(
            self.film, self.to_ticks(self.settings.repeat_memory), self.motion.delta
        )

    @cached_property
    def cost_weights(self) -> CostWeights:
        """Return the settings of the search and the weights of its costs."""
        motion, p, delta = self.motion, self.settings, self.motion.delta
        # Where the film hardly turns, a fish turns on the spot, at the cost of its rarest steps.
        filmed_deg = float(np.median(motion.turns.angle_deg / motion.turns.ticks))
        on_spot_deg = self.most_spot_turn_deg / (1 + self.rarest_step_cost)
        return CostWeights(
            fast_px=self.fast_bl_s * motion.body_length_px / motion.rate_hz,
            turn_deg=max(filmed_deg, on_spot_deg),
            stride=max(1, self.to_ticks(p.search_step_deltas)), beam=p.beam,
            seam=p.discontinuity_cost * delta, repeat=p.repeat_cost * delta,
            memory=p.repeat_memory * delta,
        )  # fmt: skip

    @cached_property
    def most_spot_turn_deg(self) -> float:
        """Return the most [°] a fish on the spot turns in a tick, unless its pictures turn more.

        At this limit its head, half a body length from its centre, moves as fast as a fast fish.
        """
        return float(np.degrees(2 * self.fast_bl_s / self.motion.rate_hz))

    @cached_property
    def rarest_step_cost(self) -> float:
        """Return the cost, in ticks, of a step that the film shows once."""
        film = self.film
        return self.settings.rarity_weight * np.count_nonzero(film.has_next[: film.filmed_count])

    @cached_property
    def fast_bl_s(self) -> float:
        """Return the speed of a fast fish of the film, body lengths/s; 1 if it shows none."""
        speeds = self.film.speed[self.film.has_next]
        return fast_speed(speeds, self.settings) if len(speeds) else 1.0

    @cached_property
    def fastest_bl_s(self) -> float:
        """Return the highest speed of the film's fish, body lengths/s, without tracking faults."""
        speeds = np.concatenate([track.speed for track in self.motion.tracks])
        return float(np.quantile(speeds, _FASTEST))

    @cached_property
    def turn_spread_deg(self) -> float:
        """Return the standard deviation of the film's turns over Δ, degrees."""
        rows, delta = self.film.rows[: self.film.filmed_count], self.motion.delta
        first = np.flatnonzero(ticks_to_film_end(rows["has_next"]) >= delta)
        if not len(first):
            return 0.0
        turns = wrap_deg(rows["heading"][first + delta] - rows["heading"][first])
        return float(turns.std())

    @cached_property
    def steering(self) -> Steering:
        """Return how far a fish may be steered onto a path, and what leaving the path costs."""
        motion, p = self.motion, self.settings
        return Steering(
            turn=max(p.path_max_correction_ratio * self.turn_spread_deg / motion.delta, 1e-6),
            shift=p.path_max_correction_ratio * motion.body_length_px / motion.rate_hz,
            fast_bl_s=self.fast_bl_s,
            reach=self.steering_ticks, length_px=motion.body_length_px,
            across=p.path_offset_cost, late=p.path_late_cost,
            heading=p.path_heading_cost, effort=p.path_correction_cost,
        )  # fmt: skip

    @property
    def steering_ticks(self) -> int:
        """Return how many ticks of film a fish on a path looks ahead, to steer."""
        return max(2, self.to_ticks(self.settings.path_steer_ahead))

    @property
    def duration(self) -> int:
        """Return how many ticks the animation lasts."""
        return round(self.settings.seconds * self.motion.rate_hz)


_QUICK = 0.99  # quantile of speeds; beyond it are faults of tracking
_FASTEST = 0.998  # quantile taken for the highest speed; beyond it are faults of tracking


def fast_speed(speeds: Floats, settings: AllSettings) -> float:
    """Return the speed of a fast fish of a film, in the unit of `speeds`.

    speeds (n,): all speeds of the film. The result is their quantile `expected_speed_quantile`, but
    at least `expected_speed_least` of a very high quantile: a fish may rest for most of the film.
    """
    quantile, quick = np.quantile(speeds, (settings.expected_speed_quantile, _QUICK))
    return float(max(quantile, settings.expected_speed_least * quick, 1e-6))
