"""Own steps of a film's fish, and simulated point fish that swim by them and by the zones.

Speeds, turns and chance come from the film, and so does the behaviour near a wall. The zones add
the response to other fish. A step that leaves the tank is not taken.
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

_BURN_IN = 0.1  # share of the steps until the first places are forgotten


def own_steps(film: FilmShoal, rows: Ints, zones: Zones) -> SocialSteps:
    """Return the steps of k rows of a film without the pull of the other fish.

    rows (k,): each has a row before and one after (`whole_steps`). A least-squares fit gives how
    much a pull of 1 moves and turns a fish: as much as its own direction does.
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
    """Return a ≥ 0 with vectors (n,) ≈ a (1 + pull), by least squares; 0 for no vectors."""
    by = 1 + pulls
    squares = float((np.abs(by) ** 2).sum())
    return max(0.0, float((vectors * by.conj()).real.sum()) / squares) if squares > 0 else 0.0


def simulate_points(
    film: FilmShoal,
    steps: SocialSteps,
    zones: Zones,
    p: CalibrateSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Simulate point fish that swim by steps and zones; return their measures (columns of `SHOAL`).

    There are as many as the film shows in a frame. The table has `p.steps` frames, after a time in
    which they forget their random start.
    """
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
    """Return where fish (m,) go by the first of moves (k, m) inside the tank, and its number.

    A fish without such a move stays.
    """
    inside = walls.inside(place + ways)
    which = inside.argmax(axis=0)
    own = np.arange(len(place))
    return np.where(inside.any(axis=0), place + ways[which, own], place), which
