"""Leaders and followers: who swims after whom.

A follower heads for its leader, wherever that is. A leader does what it would do alone, or follows
another one.
"""

from collections.abc import Mapping, Sequence

from finloop.base.errors import FinloopError


def leaders(pairs: Sequence[Sequence[int]], fish: int) -> dict[int, int]:
    """The leader of each follower, from pairs [follower, leader], fish numbered from 1.

    FinloopError if a pair is no pair or names a fish that is not there, a fish has two leaders, or
    fish follow each other round.
    """
    problems: list[str] = []
    leader_of: dict[int, int] = {}
    for pair in pairs:
        if len(pair) != 2:
            problems.append(f"{list(pair)} is no pair [follower, leader]")
            continue
        follower, leader = pair
        if strangers := [one for one in pair if not 1 <= one <= fish]:
            problems.append(f"{list(pair)} names fish {strangers[0]} of {fish}")
        elif leader_of.get(follower, leader) != leader:
            problems.append(f"fish {follower} has two leaders, {leader_of[follower]} and {leader}")
        else:
            leader_of[follower] = leader
    if not problems:
        problems = [_round(leader_of, one) for one in leader_of if _circle(leader_of, one)]
    if problems:
        raise FinloopError(
            f"who follows whom is contradictory: {problems[0]}"
            + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""),
            f"pairs [follower, leader] of fish 1 to {fish}, one leader each, so that whoever goes "
            "from leader to leader comes to a fish that follows nobody",
            "let one fish of each group lead: matching.follow_pairs=[[2,1],[3,1]]",
        )
    return leader_of


def contradiction(leader_of: Mapping[int, int], follower: int, leader: int) -> str | None:
    """Why a fish cannot follow another one, as who follows whom now; None if it can."""
    after = {**leader_of, follower: leader}
    return _round(after, follower) if _circle(after, follower) else None


def _circle(leader_of: Mapping[int, int], first: int) -> list[int]:
    """The fish from one back to itself, by who leads; empty where the way ends elsewhere."""
    circle, one = [first], leader_of.get(first)
    while one is not None and one not in circle:
        circle.append(one)
        one = leader_of.get(one)
    return circle if one == first else []


def _round(leader_of: Mapping[int, int], first: int) -> str:
    """A circle in words."""
    circle = _circle(leader_of, first)
    if len(circle) == 1:
        return f"fish {first} follows itself"
    return f"fish {' follows fish '.join(map(str, [*circle, first]))}"
