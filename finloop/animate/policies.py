"""The three modes, which differ in what may be shown next.

Network mode shows sprites (Fig. 18), loops mode the film, hybrid mode the film where it leads to
the goal and sprites between (§4.3, Figs. 17, 19). A fish that swims as is foretold takes the place
of sprites, where there is one. Every policy goes on from any state that a fish is in: by a gateway
where it may not show more of what is on screen.
"""

from dataclasses import dataclass, replace

import numpy as np

from finloop.animate import search
from finloop.animate.bounds import beyond
from finloop.animate.crossing import Crossing, refused
from finloop.animate.forecast import ForecastSwimmer
from finloop.animate.kinematics import Spot
from finloop.animate.loops import FilmSwimmer
from finloop.animate.network import SpriteSwimmer
from finloop.animate.state import Fish, Options
from finloop.base.arrays import Mask
from finloop.edit.schema import FILM, HYBRID, LOOPS, NETWORK, NO_WAY, OTHER_MODE, WALL
from finloop.edit.stretch import Stretch


@dataclass(frozen=True)
class Policy:
    """What may be shown next in a mode. crossing: None where there is no film to be in.

    forecast: whoever swims in place of sprites.
    """

    mode: str
    sprites: SpriteSwimmer
    crossing: Crossing | None = None
    forecast: ForecastSwimmer | None = None

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank: gliding, in loops mode in the film."""
        if self.forecast is not None:
            return self.forecast.begin(rng)
        if self.crossing is not None and self.mode == LOOPS:
            return self.crossing.film.begin(rng)
        return self.sprites.begin(rng)

    def next(self, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
        """What is shown next, on the way to a goal; first into the film, or out of it."""
        if self.forecast is not None:
            if self.mode == HYBRID and self.crossing is not None:
                return film_or_forecast(self.crossing, self.forecast, fish, goal, rng)
            return self.forecast.next(fish, goal, rng)
        if self.crossing is None:
            return self.sprites.figure18(fish, goal, rng)
        if self.mode == HYBRID:
            return figure19(self.crossing, fish, goal, rng)
        if self.mode == NETWORK:
            if fish.row >= 0:
                return self.crossing.leave(fish, goal, OTHER_MODE, rng)
            return self.sprites.figure18(fish, goal, rng)
        if fish.row >= 0:
            return self.crossing.film.swim(fish, goal, rng)
        return _enter(self.crossing, fish, goal, rng, any_way=True)


def figure19(crossing: Crossing, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
    """Fig. 19, playing in hybrid mode.

    Network mode until a gateway fits. In the film every loop end asks whether a way on is legal and
    gains enough; if not, out by a gateway, which is waited for a moment.
    """
    film, least = crossing.film, crossing.waters.ticks(crossing.waters.settings.network_least)
    if fish.row < 0:
        if fish.since < least:
            return crossing.sprites.figure18(fish, goal, rng)
        return _enter(crossing, fish, goal, rng, any_way=False)
    aim = film.aim(fish, goal)
    options = film.options(fish, aim)
    taken = film.choose(options, worth(crossing, options, fish, aim), rng)
    if taken is not None:
        return film.play(fish, taken, goal, aim)
    left = crossing.leave(fish, goal, NO_WAY, rng)
    if np.isnan(left.decision.seam) and fish.waits < least:
        taken = film.choose(options, np.isfinite(options.value), rng)
        if taken is not None:
            return replace(film.play(fish, taken, goal, aim), waits=True)
    return refused(left, options)


def film_or_forecast(
    crossing: Crossing, forecast: ForecastSwimmer, fish: Fish, goal: Spot, rng: np.random.Generator
) -> Stretch:
    """Fig. 19 without sprites: by the film where that is legal and gains enough, else as foretold.

    No gateways are needed: a fish that swims as is foretold shows a row of the film, too. Where
    that leads farther up to a wall, the film goes on as in loops mode.
    """
    film = crossing.film
    if fish.row < 0 or not film.waters.film.more[fish.row]:
        return forecast.next(fish, goal, rng)
    aim = film.aim(fish, goal)
    options = film.options(fish, aim)
    taken = film.choose(options, worth(crossing, options, fish, aim), rng)
    if taken is not None:
        return film.play(fish, taken, goal, aim)
    stretch = forecast.next(fish, goal, rng)
    if _up_to_wall(film, fish, stretch):
        return film.by(options, fish, (goal, aim), rng)
    if fish.state == FILM:
        stretch = replace(stretch, decision=stretch.decision._replace(exit=NO_WAY))
    return refused(stretch, options)


def _up_to_wall(film: FilmSwimmer, fish: Fish, stretch: Stretch) -> bool:
    """Whether a stretch as foretold is along a wall, or has less room ahead than the fish has."""
    bounds, room = film.waters.bounds, film.rules.room
    before = beyond(bounds, fish.x, fish.y, fish.heading, room)
    after = beyond(bounds, *stretch.way[-1].tolist(), room)
    return stretch.decision.reason == WALL or after > before


def worth(crossing: Crossing, options: Options, fish: Fish, aim: Spot) -> Mask:
    """Ways that are legal and bring the fish nearer to its aim by `gain` seconds a second.

    Of a fish that wanders, all that are legal.
    """
    if aim.free:
        return options.legal
    rate, gain = crossing.waters.motion.rate_hz, crossing.waters.settings.gain
    ticks = search.remaining(fish.x, fish.y, fish.heading, aim, crossing.film.rules)
    return options.legal & (options.value <= (ticks + (1 - gain) * options.ticks) / rate)


def _enter(
    crossing: Crossing, fish: Fish, goal: Spot, rng: np.random.Generator, any_way: bool
) -> Stretch:
    """By a gateway into the film where a way from there is worth it, else on by sprites.

    any_way: also where it only stays in the tank.
    """
    film = crossing.film
    aim = film.aim(fish, goal)
    options = crossing.ways_in(fish, aim)
    if options is not None:
        taken = film.choose(options, worth(crossing, options, fish, aim), rng)
        if taken is None and any_way:
            taken = film.choose(options, np.isfinite(options.value), rng)
        if taken is not None:
            return film.play(fish, taken, goal, aim)
    return refused(crossing.sprites.figure18(fish, goal, rng), options)
