"""Swimming by a rule in place of a goal: with company, by zones, or after a leader.

At each decision a rule's wish (`finloop.social`) becomes a place to swim to. By zones that is where
a step of the film leads, and it holds for as long as such a step takes; who has no company wanders.
A follower heads for the place a body length behind its leader, wherever that is now.
"""

from typing import NamedTuple

import numpy as np

from finloop.animate.state import Fish, Waters
from finloop.base.arrays import Floats, Reals
from finloop.social.rule import Others, Self, Shoaling, shoaling_place

BY_ZONES, FOLLOWING = "company", "leader"
"""The goals, in an edit list, of whoever swims by zones, or after a leader."""


class Rule(NamedTuple):
    """What a fish swims by. leader: which of the others leads; None: by zones, all of them."""

    others: Others
    shoaling: Shoaling | None = None
    leader: int | None = None

    @property
    def name(self) -> str:
        """The name of its goal."""
        return BY_ZONES if self.leader is None else FOLLOWING

    @classmethod
    def by_zones(cls, ways: Reals, shoaling: Shoaling) -> "Rule":
        """By zones, in company of others at x, y, heading (n, 3)."""
        return cls(Others(ways[:, :2], ways[:, 2]), shoaling)

    @classmethod
    def after(cls, leader: Reals) -> "Rule":
        """After a leader at x, y, heading (3,)."""
        return cls(Others(leader[None, :2], leader[None, 2]), None, 0)


def wish(
    rule: Rule, fish: Fish, waters: Waters, rng: np.random.Generator
) -> tuple[Floats, int] | None:
    """The place (2,), px, that a fish swims to by a rule, and for how many ticks it holds.

    None where the rule wishes nothing.
    """
    length = waters.motion.body_length_px
    if rule.leader is not None:
        angle = np.radians(rule.others.headings_deg[rule.leader])
        x, y = rule.others.places[rule.leader] - length * np.array([np.cos(angle), -np.sin(angle)])
        return np.array(waters.tank.into(float(x), float(y))), 0
    shoaling = rule.shoaling
    assert shoaling is not None
    last = fish.speed * shoaling.horizon / waters.motion.rate_hz
    own = Self(fish.x, fish.y, fish.heading, last)
    place = shoaling_place(own, rule.others, shoaling, waters.walls, rng)
    return None if place is None else (np.array(waters.tank.into(*place)), shoaling.horizon)
