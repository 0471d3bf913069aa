"""The rule of a fish without a goal: zones, or a leader (`finloop.social`)."""

from typing import NamedTuple

from finloop.base.arrays import Reals
from finloop.social.rule import OtherFish, SchoolRule

BY_ZONES, FOLLOWING = "company", "leader"
"""The goals, in an edit list, of a fish that swims by zones, or behind a leader."""


class Rule(NamedTuple):
    """A rule of swimming with other fish: behind a leader, or with all by zones.

    others: places and headings of the other fish; school_rule: how fish swim by zones; leader:
    column of the fish to follow; None: by zones.
    """

    others: OtherFish
    school_rule: SchoolRule | None = None
    leader: int | None = None

    @property
    def name(self) -> str:
        """Return the name that an edit list gives to the goal of a fish with this rule."""
        return BY_ZONES if self.leader is None else FOLLOWING

    @classmethod
    def by_zones(cls, poses: Reals, school_rule: SchoolRule) -> "Rule":
        """Return the rule to swim by zones with other fish at poses (n, 3): x, y px, heading."""
        return cls(OtherFish(poses[:, :2], poses[:, 2]), school_rule)

    @classmethod
    def to_follow(cls, pose: Reals) -> "Rule":
        """Return the rule to follow one fish, the leader, at pose (3,): x, y px, heading."""
        return cls(OtherFish(pose[None, :2], pose[None, 2]), leader=0)
