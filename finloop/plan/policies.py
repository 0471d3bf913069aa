"""What mode `matching` may show next: the film, what the forecast predicts, or both.

With both, the film is played where a way of it stays in the tank; elsewhere the fish swims as the
forecast predicts, in frames of the film bent into the predicted poses.
"""

from dataclasses import dataclass, replace

import numpy as np

from finloop.animate.kinematics import Target, wrap
from finloop.animate.state import Fish
from finloop.base.arrays import Ints
from finloop.edit.schema import FILM, NO_WAY
from finloop.edit.stretch import Stretch
from finloop.plan.film_swimmer import FilmSwimmer, counted
from finloop.plan.forecast_swimmer import ForecastSwimmer


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

    def next(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """What is shown next, on the way to a goal."""
        if fish.row < 0:
            fish = self._from_sprite(fish)
        if self.forecast is None:
            return self.film.swim(fish, goal, rng)
        if not self.shows_film:
            return self.forecast.next(fish, goal, rng)
        return choose_motion(self.film, self.forecast, fish, goal, rng)

    def _from_sprite(self, fish: Fish) -> Fish:
        """A fish that a sprite shows, as one of the film's row behind it."""
        film = self.film.waters.film
        row = int(self.sprite_rows[fish.sprite])
        rot = float(wrap(fish.heading - film.heading[row]))
        return replace(fish, state=FILM, sprite=-1, row=row, rot=rot, since=self.film.rules.stay)


def choose_motion(
    film: FilmSwimmer, forecast: ForecastSwimmer, fish: Fish, goal: Target, rng: np.random.Generator
) -> Stretch:
    """Return what is shown next: film where a way of it stays in the tank, else a prediction."""
    if fish.row < 0 or not film.waters.film.more[fish.row]:
        return forecast.next(fish, goal, rng)
    aim = film.aim(fish, goal)
    options = film.choose(film.options(fish, aim), rng)
    if options.taken >= 0:
        return film.play(fish, options, goal, aim)
    stretch = forecast.next(fish, goal, rng)
    if fish.state == FILM:
        stretch = replace(stretch, decision=stretch.decision._replace(exit=NO_WAY))
    return replace(stretch, options=options, decision=counted(stretch.decision, options))
