"""Where a fish swims by a rule: with its company, by zones, or after its leader.

A rule asks where the others are now, and gives a place to swim to. It changes nothing, so whoever
keeps what it was asked with, and the state of the random generator, gets the same place again.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Complex, Reals
from finloop.social.neighbours import seen_from, vectors
from finloop.social.steps import Steps, moved
from finloop.social.walls import Walls
from finloop.social.zones import Zones, pull


@dataclass(frozen=True)
class Shoaling:
    """Zones, and the film's own steps that they change (`finloop.calibrate`).

    horizon: ticks of a step; alike: from so many steps one is drawn.
    """

    zones: Zones
    steps: Steps
    horizon: int
    alike: int


class Others(NamedTuple):
    """The other fish of a tank: places (n, 2) px, y down, and headings (n,) in degrees."""

    places: Reals
    headings_deg: Reals


class Self(NamedTuple):
    """A fish: place x, y px, heading in degrees, and where it was a step ago."""

    x: float
    y: float
    heading_deg: float
    last_x: float
    last_y: float


def shoaling_place(
    own: Self, others: Others, shoaling: Shoaling, walls: Walls, rng: np.random.Generator
) -> tuple[float, float] | None:
    """The place, px, that a fish swims to next by zones; None if no other is in one of them.

    It is that of a step of the film, of a fish that was as near to a wall and had moved alike, and
    of the pull of the company. Of steps that leave the tank the last one's place is given all the
    same: whoever swims there moves it into the tank.
    """
    (place,), (heading,) = _vector([own.x], [own.y], own.heading_deg, walls)
    company = vectors(others.places, others.headings_deg, walls.length)
    wish = pull(seen_from(place, heading, company), shoaling.zones)
    if wish == 0:
        return None
    (before,), _ = _vector([own.last_x], [own.last_y], own.heading_deg, walls)
    last = (place - before) * np.conj(heading)
    near = walls.near(np.array([place]), np.array([heading]))
    moves, _ = shoaling.steps.draw(near, np.array([last]), shoaling.alike, rng)
    ways = place + heading * moved(moves[0], wish, shoaling.steps)
    inside = walls.inside(ways)
    to = ways[int(inside.argmax()) if inside.any() else -1] * walls.length
    return float(to.real), float(-to.imag)


def _vector(
    x: list[float], y: list[float], heading_deg: float, walls: Walls
) -> tuple[Complex, Complex]:
    return vectors(np.stack([x, y], axis=-1), np.array([heading_deg]), walls.length)
