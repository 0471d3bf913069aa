"""Where a fish swims by a rule: in a school, by zones, or after its leader.

A rule takes the present places of the others and returns a place to swim to. The same arguments and
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
    """The rule of a school: zones, and the film's own steps, which the pull of the zones changes.

    horizon: ticks that a step lasts; alike: number of similar steps from which one is drawn.
    """

    zones: Zones
    steps: SocialSteps
    horizon: int
    alike: int


def require_rule(shoaling: Shoaling | None) -> Shoaling:
    """Return the rule itself; raise FinloopError if it is None or has no steps."""
    if shoaling is None or not len(shoaling.steps.move):
        raise FinloopError(
            "there are no zones for fish in a school"
            if shoaling is None
            else "the film's tracks are too short for the steps of fish in a school",
            "zones, and steps of a film that shows a fish in three consecutive frames",
            "make them (dvc repro calibrate; in Python find_zones, for "
            "steer(…, shoaling=…)), film longer, or take another rule (matching.rule)",
        )
    return shoaling


class Others(NamedTuple):
    """The other fish of a tank: places (n, 2) px, y down, and headings (n,) in degrees."""

    places: Reals
    headings_deg: Reals


class Self(NamedTuple):
    """The fish that decides: place x, y in px, heading in degrees, last step in BL."""

    x: float
    y: float
    heading_deg: float
    last: float


def shoaling_place(
    own: Self, others: Others, shoaling: Shoaling, walls: Walls, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Return the place x, y in px to which a fish swims next; None if no other fish pulls it.

    The place is the end of a step of the film plus the pull of the other fish. The film's fish was
    equally near to a wall and moved alike. Of several steps drawn, it is the first that ends in the
    tank. If all end outside, it is the last, and the caller must move it into the tank.
    """
    place, heading = vectors(np.array([[own.x, own.y]]), np.array([own.heading_deg]), walls.length)
    group = vectors(others.places, others.headings_deg, walls.length)
    pulls = pull(relative_neighbours(place[:, None], heading[:, None], group), shoaling.zones)
    if pulls[0] == 0:
        return None
    last = np.array([own.last + 0j])
    moves, _ = shoaling.steps.draw(walls.near(place, heading), last, shoaling.alike, rng)
    ends = place + heading * add_pull_to_moves(moves[0], pulls, shoaling.steps)
    inside = walls.inside(ends)
    to = ends[int(inside.argmax()) if inside.any() else -1] * walls.length
    return float(to.real), float(-to.imag)
