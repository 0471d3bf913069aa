"""Leaders and followers: which fish swims after which.

A follower heads for its leader, wherever that is. A leader does what it would do alone, or follows
another leader.
"""

from collections.abc import Mapping, Sequence

from finloop.base.errors import FinloopError


def leaders_by_follower(pairs: Sequence[Sequence[int]], fish: int) -> dict[int, int]:
    """Return the leader of each follower, from pairs [follower, leader] of fish counted from 1.

    fish: how many there are. FinloopError if a pair has not two members or names a missing fish, a
    fish has two leaders, or fish follow each other in a circle.
    """
    problems: list[str] = []
    leader_of: dict[int, int] = {}
    for pair in pairs:
        if len(pair) != 2:
            problems.append(f"{list(pair)} is not a pair [follower, leader]")
            continue
        follower, leader = pair
        if missing := [number for number in pair if not 1 <= number <= fish]:
            problems.append(f"{list(pair)} names fish {missing[0]} of {fish}")
        elif leader_of.get(follower, leader) != leader:
            problems.append(f"fish {follower} has two leaders, {leader_of[follower]} and {leader}")
        else:
            leader_of[follower] = leader
    if not problems:
        circles = [_find_circle(leader_of, follower) for follower in leader_of]
        problems = [circle for circle in circles if circle]
    if problems:
        raise FinloopError(
            f"the pairs of followers and leaders contradict each other: {problems[0]}"
            + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""),
            f"pairs [follower, leader] of fish 1 to {fish}, one leader each, and no circle of "
            "followers",
            "let one fish of each group lead: matching.follow_pairs=[[2,1],[3,1]]",
        )
    return leader_of


def describe_contradiction(leader_of: Mapping[int, int], follower: int, leader: int) -> str | None:
    """Return in words why `follower` cannot follow `leader`, or None if it can.

    leader_of: the present leaders by follower. The only obstacle is a circle of followers.
    """
    return _find_circle({**leader_of, follower: leader}, follower)


def _find_circle(leader_of: Mapping[int, int], first: int) -> str | None:
    """Return in words the circle of followers that leads back to fish `first`, or None."""
    circle, leader = [first], leader_of.get(first)
    while leader is not None and leader not in circle:
        circle.append(leader)
        leader = leader_of.get(leader)
    if leader != first:
        return None
    if len(circle) == 1:
        return f"fish {first} follows itself"
    return f"fish {' follows fish '.join(map(str, [*circle, first]))}"
