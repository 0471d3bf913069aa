"""Own steps of a film's fish, and fish that are points and swim by them and by the zones.

Speeds, turns and their chance are the film's, and so is what fish do beside a wall; the zones say
what the others change in that. A step that leaves the tank is not taken.
"""

import numpy as np
import pandas as pd

from finloop.base.arrays import Complex, Ints
from finloop.calibrate.film import FilmShoal
from finloop.calibrate.settings import CalibrateSettings
from finloop.social.measures import shoal_table
from finloop.social.neighbours import neighbours
from finloop.social.steps import SocialSteps, add_pull_to_moves, add_pull_to_turns, last_rows
from finloop.social.walls import Walls
from finloop.social.zones import Zones, pull

_BURN_IN = 0.1  # of the steps: where the fish begin is forgotten


def own_steps(film: FilmShoal, rows: Ints, zones: Zones) -> SocialSteps:
    """The own steps from some rows that have one before and a later one.

    A pull of 1 changes displacement and direction by as much as the fish's own direction has.
    """
    pulls, own = pull(film.visible_neighbours(rows), zones), film.heading[rows]
    move, turn = film.moves(rows), film.directions(rows)
    before = (film.place[rows] - film.place[last_rows(film.later)[rows]]) * own.conj()
    forward, onward = (_own_part(vector, pulls) for vector in (move, turn))
    return SocialSteps(
        film.walls.near(film.place[rows], own), before, move - forward * pulls,
        turn - onward * pulls, forward, onward,
    )  # fmt: skip


def _own_part(vectors: Complex, pulls: Complex) -> float:
    """a ≥ 0 of vectors (n,) that are a (1 + pull) in the mean, by least squares; 0 of none."""
    by = 1 + pulls
    squares = float((np.abs(by) ** 2).sum())
    return max(0.0, float((vectors * by.conj()).real.sum()) / squares) if squares > 0 else 0.0


def swum_points(
    film: FilmShoal,
    steps: SocialSteps,
    zones: Zones,
    p: CalibrateSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """The measures (`SHOAL`) of as many fish as a film shows, that swim `p.steps` steps."""
    fish, count = film.fish, p.steps
    place = film.place[rng.choice(len(film.place), fish, replace=len(film.place) < fish)]
    heading, last = np.exp(2j * np.pi * rng.random(fish)), np.zeros(fish, complex)
    first = round(_BURN_IN * count)
    places, headings = np.empty((2, count, fish), complex)
    for number in range(first + count):
        pulls = pull(neighbours(place, heading), zones)
        here = film.walls.near(place, heading), last * heading.conj()
        moves, turns = steps.draw(*here, p.alike, rng)
        to, which = _choose_move(
            film.walls, place, heading * add_pull_to_moves(moves.T, pulls, steps)
        )
        heading = heading * add_pull_to_turns(turns[np.arange(fish), which], pulls, steps)
        last, place = to - place, to
        if number >= first:
            places[number - first], headings[number - first] = place, heading
    at = np.stack([places.real, -places.imag], axis=-1).reshape(-1, 2) * film.walls.length
    frame = np.repeat(np.arange(count), fish)
    return shoal_table(frame, at, np.degrees(np.angle(headings)).ravel(), film.walls)


def _choose_move(walls: Walls, place: Complex, ways: Complex) -> tuple[Complex, Ints]:
    """Return where fish (m,) go by the first of ways (k, m) inside the tank, and its number.

    Who has none stays.
    """
    inside = walls.inside(place + ways)
    which = inside.argmax(axis=0)
    own = np.arange(len(place))
    return np.where(inside.any(axis=0), place + ways[which, own], place), which
