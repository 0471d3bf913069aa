"""The rule of a fish without a goal: zones, or a leader (`finloop.social`)."""

from typing import NamedTuple

from finloop.base.arrays import Reals
from finloop.social.rule import Others, Shoaling

BY_ZONES, FOLLOWING = "company", "leader"
"""The goals, in an edit list, of a fish that swims by zones, or behind a leader."""


class Rule(NamedTuple):
    """A rule between fish. leader: which of the others leads; None: by zones, all of them."""

    others: Others
    shoaling: Shoaling | None = None
    leader: int | None = None

    @property
    def name(self) -> str:
        """Return the name of its goal in an edit list."""
        return BY_ZONES if self.leader is None else FOLLOWING

    @classmethod
    def by_zones(cls, ways: Reals, shoaling: Shoaling) -> "Rule":
        """Make the rule by zones, for other fish at x, y, heading (n, 3)."""
        return cls(Others(ways[:, :2], ways[:, 2]), shoaling)

    @classmethod
    def from_leader(cls, leader: Reals) -> "Rule":
        """Make the rule to follow a leader at x, y, heading (3,)."""
        return cls(Others(leader[None, :2], leader[None, 2]), None, 0)
