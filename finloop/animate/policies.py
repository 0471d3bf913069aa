"""What mode `matching` may show next: the film, what the forecast predicts, or both.

With both, the film is played where a way of it is legal and gains enough; elsewhere the fish swims
as the forecast predicts, in frames of the film bent into the predicted poses.
"""

from dataclasses import dataclass, replace

import numpy as np

from finloop.animate.bounds import beyond
from finloop.animate.forecast import ForecastSwimmer
from finloop.animate.kinematics import Spot, wrap
from finloop.animate.loops import FilmSwimmer, counted
from finloop.animate.objectives import remaining
from finloop.animate.state import Fish, Options
from finloop.base.arrays import Ints, Mask
from finloop.edit.schema import FILM, NO_WAY, WALL
from finloop.edit.stretch import Stretch


@dataclass(frozen=True)
class Policy:
    """What may be shown next. film, forecast: how a fish swims by each.

    shows_film: whether the film is played as filmed; if not, there is a forecast. sprite_rows (s,):
    the rows behind sprites, from which a fish of another mode goes on.
    """

    film: FilmSwimmer
    forecast: ForecastSwimmer | None
    shows_film: bool
    sprite_rows: Ints

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, in a state of the film."""
        return self.film.begin(rng) if self.forecast is None else self.forecast.begin(rng)

    def next(self, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
        """What is shown next, on the way to a goal."""
        if fish.row < 0:
            fish = self._from_sprite(fish)
        if self.forecast is None:
            return self.film.swim(fish, goal, rng)
        if not self.shows_film:
            return self.forecast.next(fish, goal, rng)
        return film_or_forecast(self.film, self.forecast, fish, goal, rng)

    def _from_sprite(self, fish: Fish) -> Fish:
        """A fish that a sprite shows, as one of the film's row behind it."""
        film = self.film.waters.film
        row = int(self.sprite_rows[fish.sprite])
        rot = float(wrap(fish.heading - film.heading[row]))
        return replace(fish, state=FILM, sprite=-1, row=row, rot=rot, since=self.film.rules.stay)


def film_or_forecast(
    film: FilmSwimmer, forecast: ForecastSwimmer, fish: Fish, goal: Spot, rng: np.random.Generator
) -> Stretch:
    """By the film where that is legal and gains enough, else as the forecast predicts.

    Where that leads farther up to a wall, the film goes on.
    """
    if fish.row < 0 or not film.waters.film.more[fish.row]:
        return forecast.next(fish, goal, rng)
    aim = film.aim(fish, goal)
    options = film.options(fish, aim)
    taken = film.choose(options, worth(film, options, fish, aim), rng)
    if taken is not None:
        return film.play(fish, taken, goal, aim)
    stretch = forecast.next(fish, goal, rng)
    if _up_to_wall(film, fish, stretch):
        return film.by(options, fish, (goal, aim), rng)
    if fish.state == FILM:
        stretch = replace(stretch, decision=stretch.decision._replace(exit=NO_WAY))
    decision = counted(stretch.decision, options)
    return replace(stretch, options=replace(options, taken=-1), decision=decision)


def _up_to_wall(film: FilmSwimmer, fish: Fish, stretch: Stretch) -> bool:
    """Whether a stretch as foretold is along a wall, or has less room ahead than the fish has."""
    bounds, room = film.waters.bounds, film.rules.room
    before = beyond(bounds, fish.x, fish.y, fish.heading, room)
    after = beyond(bounds, *stretch.way[-1].tolist(), room)
    return stretch.decision.reason == WALL or after > before


def worth(film: FilmSwimmer, options: Options, fish: Fish, aim: Spot) -> Mask:
    """Ways that are legal and bring the fish nearer to its aim by `gain` seconds a second.

    Of a fish that wanders, all that are legal.
    """
    if aim.free:
        return options.legal
    rate, gain = film.waters.motion.rate_hz, film.waters.settings.gain
    ticks = remaining(fish.x, fish.y, fish.heading, aim, film.rules)
    return options.legal & (options.value <= (ticks + (1 - gain) * options.ticks) / rate)
