"""Where a fish swims by a rule: with its company, by zones, or after its leader.

A rule takes where the others are now, and gives a place to swim to. The same arguments and
generator state give the same place.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Reals
from finloop.base.errors import FinloopError
from finloop.social.neighbours import relative_neighbours, vectors
from finloop.social.steps import SocialSteps, add_pull_to_moves
from finloop.social.walls import Walls
from finloop.social.zones import Zones, pull


@dataclass(frozen=True)
class Shoaling:
    """Zones, and the film's own steps that they change (`finloop.calibrate`).

    horizon: ticks of a step; alike: from so many steps one is drawn.
    """

    zones: Zones
    steps: SocialSteps
    horizon: int
    alike: int


def rule_of(shoaling: Shoaling | None) -> Shoaling:
    """The rule itself. FinloopError if there is none, or it has no step of a fish."""
    if shoaling is None or not len(shoaling.steps.move):
        raise FinloopError(
            "no zones are known by which fish swim in company"
            if shoaling is None
            else "the film's tracks are too short for the steps of fish in company",
            "zones, and steps of a film in which a fish is seen in three frames on end",
            "make them (dvc repro calibrate; of the library find_zones, for "
            "steer(…, shoaling=…)), film longer, or take another rule (matching.rule)",
        )
    return shoaling


class Others(NamedTuple):
    """The other fish of a tank: places (n, 2) px, y down, and headings (n,) in degrees."""

    places: Reals
    headings_deg: Reals


class Self(NamedTuple):
    """A fish: place x, y px, heading in degrees; last: body lengths that it swam in a step."""

    x: float
    y: float
    heading_deg: float
    last: float


def shoaling_place(
    own: Self, others: Others, shoaling: Shoaling, walls: Walls, rng: np.random.Generator
) -> tuple[float, float] | None:
    """The place, px, that a fish swims to next by zones; None if no other is in one of them.

    It is that of a step of the film, of a fish that was as near to a wall and had moved alike, and
    of the pull of the company: the first of several steps drawn that stays in the tank, or the last
    of them. Whoever swims there moves that into the tank.
    """
    place, heading = vectors(np.array([[own.x, own.y]]), np.array([own.heading_deg]), walls.length)
    company = vectors(others.places, others.headings_deg, walls.length)
    wish = pull(relative_neighbours(place[:, None], heading[:, None], company), shoaling.zones)
    if wish[0] == 0:
        return None
    last = np.array([own.last + 0j])
    moves, _ = shoaling.steps.draw(walls.near(place, heading), last, shoaling.alike, rng)
    ways = place + heading * add_pull_to_moves(moves[0], wish, shoaling.steps)
    inside = walls.inside(ways)
    to = ways[int(inside.argmax()) if inside.any() else -1] * walls.length
    return float(to.real), float(-to.imag)
