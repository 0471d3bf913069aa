"""What a fish swims by in place of a goal: zones, or a leader (`finloop.social`)."""

from typing import NamedTuple

from finloop.base.arrays import Reals
from finloop.social.rule import Others, Shoaling

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
    def from_leader(cls, leader: Reals) -> "Rule":
        """Make the rule to follow a leader at x, y, heading (3,)."""
        return cls(Others(leader[None, :2], leader[None, 2]), None, 0)
