"""Several fish of one tank, planned together: the one whose plan ends first decides next.

A fish that decides knows what every other one has planned (`finloop.animate.obstacles`), and keeps
clear of it. Fish whose plans end at the same tick decide in the order of their numbers. Each draws
from a generator of its own, so that fish that never meet swim as each would alone.
"""

import heapq
from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.animate.obstacles import Plans, can_stay
from finloop.animate.protocols import AnyPlayer
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.edit.build import build_edit_list
from finloop.edit.schema import PATH, Goal
from finloop.edit.stretch import Swim
from finloop.social.rule import require_rule


class SwimTask(NamedTuple):
    """The task of a fish: a path, then goals one after the other, then a rule or wandering.

    rng: for all its random choices; zones: whether its rule is to swim by zones, in which others
    repel, align and attract it; follows: number, from 0, of the fish that it follows by rule.
    """

    goals: Sequence[Goal]
    rng: np.random.Generator
    route: Route | None = None
    zones: bool = False
    follows: int | None = None


def deal_goals(goals: Sequence[Goal], fish_count: int) -> list[list[Goal]]:
    """Return the goals of each fish, dealt in turn: the first goal to the first fish."""
    return [list(goals[number::fish_count]) for number in range(fish_count)]


def refuse_shared_goals(goals: Sequence[Goal], goal_seekers: Sequence[int]) -> None:
    """Raise FinloopError if two fish would be sent to one place at the same time.

    Two places are one if one is within the radius of the other. goal_seekers: the numbers, from 0,
    of the fish that swim to goals; messages number fish from 1, as the parameters do.
    """
    count, meetings = len(goal_seekers), []
    for first in range(0, len(goals), count):  # goals that all fish have at the same time
        goals_by_fish = zip(goal_seekers, goals[first : first + count], strict=False)
        for (fish, goal), (other_fish, other) in combinations(goals_by_fish, 2):
            if np.hypot(goal.x_px - other.x_px, goal.y_px - other.y_px) < goal.radius_px:
                meetings.append(
                    f"{goal.name} (fish {fish + 1}) and {other.name} (fish {other_fish + 1})"
                )
    if meetings:
        raise FinloopError(
            f"animate.goals sends two fish to one place at the same time: {', '.join(meetings)}",
            f"places at least {goals[0].radius_px:.0f} px apart (animate.goal_radius_bl): goals "
            f"are dealt in turn to the fish {', '.join(str(fish + 1) for fish in goal_seekers)}",
            "move the goals (animate.goals), or let fish overlap (matching.overlap=true)",
        )


def make_tasks(
    goals: Sequence[Goal], fish_count: int, rng: np.random.Generator, route: Route | None = None
) -> list[SwimTask]:
    """Return the task of each fish: goals are dealt in turn, and the first fish gets the route.

    rng: of the first fish, from which those of the others are spawned.
    """
    generators = [rng, *rng.spawn(fish_count - 1)]
    first, *others = map(SwimTask, deal_goals(goals, fish_count), generators)
    return [first._replace(route=route), *others]


class SchoolMember:
    """A fish of a group, and the animation that it has planned so far (`swim`)."""

    def __init__(self, player: AnyPlayer, task: SwimTask, number: int, plans: Plans) -> None:
        """Put a fish into the tank, at rest in `plans`, with no stretch planned yet.

        number: of the fish, from 0; plans: of all fish, to which its place is added. NoRoom where
        there is no place; FinloopError where it begins a path on another fish.
        """
        self._player, self._task, self._route = player, task, task.route
        self._number = number
        obstacles = player.others_to_avoid(plans.places_of_others(number, 0), 0)
        self._state = player.begin(task.rng, task.route, obstacles)
        self.swim = Swim([], [], np.full(len(task.goals), -1))
        self._reached = 0  # goals
        fish = self._state.fish
        pose = np.array([fish.x, fish.y, fish.heading, fish.picture])
        if task.route is not None and not can_stay(obstacles, fish.picture, pose[:3], 0):
            others = obstacles.places[0, :, :2] - pose[:2]
            near = plans.fish_in_column(number, int(np.hypot(*others.T).argmin()))
            raise FinloopError(
                f"matching.path begins fish {number + 1} on fish {near + 1}, at "
                f"({fish.x:.0f}, {fish.y:.0f}) px",
                "beginnings at which the fish do not touch",
                "begin a path elsewhere, or let fish overlap (matching.overlap=true)",
            )
        plans.store(number, 0, pose[None])

    @property
    def next_tick(self) -> int:
        """Return the first tick for which nothing is planned."""
        return self._state.fish.tick

    def decide(self, plans: Plans) -> None:
        """Plan the fish's next stretch, clear of the others; add it to `plans` and to `swim`."""
        start_tick, others = self.next_tick, plans.places_of_others(self._number, self.next_tick)
        goal = self._next_goal() or self._next_rule(plans, others)
        state = self._player.with_obstacles(self._state, others)
        stretch, self._state = self._player.plan(state, goal, self._task.rng)
        plans.store(self._number, start_tick, stretch.path_and_pictures)
        # What the animation says of it; a goal that the stretch touches at its end is reached.
        name = PATH if isinstance(goal, Route) else goal.name if goal else ""
        self.swim.stretches.append(stretch)
        self.swim.names.append(name)
        if isinstance(goal, Goal) and stretch.touches_goal:
            self.swim.reached[self._reached] = self.next_tick - 1
            self._reached += 1

    def _next_goal(self) -> Goal | Route | None:
        """Return the path or goal that the fish swims by next; None if it has none left.

        A path is forgotten once the fish is at its end.
        """
        if self._route is not None and self._route.is_done(
            self._state.progress.along, self.next_tick
        ):
            self._route = None
        if self._route is not None:
            return self._route
        goals = self._task.goals
        return goals[self._reached] if self._reached < len(goals) else None

    def _next_rule(self, plans: Plans, other_plans: Floats) -> Rule | None:
        """Return the rule by which a fish without a goal swims next; None if it has none.

        other_plans (n, m, 4): x, y px, heading, picture of m others at n ticks, from the present
        one on.
        """
        task, school_rule = self._task, self._player.school_rule
        if task.follows is not None and plans.has_planned(task.follows):
            return Rule.to_follow(plans.pose_at(task.follows, self.next_tick))
        if not (task.zones and other_plans.shape[1]):
            return None
        return Rule.by_zones(other_plans[0, :, :3], require_rule(school_rule))


def settle_fish(player: AnyPlayer, tasks: Sequence[SwimTask], plans: Plans) -> list[SchoolMember]:
    """Put a fish for each task into the tank; return them, each with its first stretch planned.

    All fish with a path are there before any plans; the others come one after the other. plans:
    empty, for as many fish; their plans are added. NoRoom if the tank lacks room for all of them.
    """
    path_followers = [number for number, task in enumerate(tasks) if task.route is not None]
    fish = {number: SchoolMember(player, tasks[number], number, plans) for number in path_followers}
    for number in path_followers:
        fish[number].decide(plans)
    for number in sorted(set(range(len(tasks))) - set(path_followers)):
        try:
            fish[number] = SchoolMember(player, tasks[number], number, plans)
            fish[number].decide(plans)
        except NoRoom as error:
            raise NoRoom(
                f"matching.fish={len(tasks)}: the tank has room for {len(fish)}",
                f"at most {len(fish)} fish of this size, clear of each other",
                "take fewer fish (matching.fish), let them overlap (matching.overlap=true), or "
                "film them from farther away",
            ) from error
    return [fish[number] for number in range(len(tasks))]


def animate_group(player: AnyPlayer, tasks: Sequence[SwimTask], ticks: int) -> list[Swim]:
    """Animate a fish for each task, together, for at least `ticks` ticks; return each `Swim`.

    The fish whose plan ends first decides next. Goals reached after `ticks` count as not reached
    (−1). NoRoom if the tank lacks room for all of them.
    """
    plans = Plans(len(tasks))
    fish = settle_fish(player, tasks, plans)
    # By the tick at which the plan of each fish ends.
    queue = [(member.next_tick, number) for number, member in enumerate(fish)]
    heapq.heapify(queue)
    while queue[0][0] < ticks:
        number = queue[0][1]
        fish[number].decide(plans)
        heapq.heapreplace(queue, (fish[number].next_tick, number))
    for member in fish:
        member.swim.reached[member.swim.reached >= ticks] = -1
    return [member.swim for member in fish]


def animate_fish(
    player: AnyPlayer, goals: Sequence[Goal], ticks: int, rng: np.random.Generator,
    route: Route | None = None,
) -> Swim:  # fmt: skip
    """Animate one fish for at least `ticks` ticks; return its stretches as a `Swim`.

    It swims along its path, then to its goals in turn, then wanders.
    """
    return animate_group(player, [SwimTask(goals, rng, route)], ticks)[0]


def plan_edit_list(
    player: AnyPlayer, goals: Sequence[Goal], ticks: int, rng: np.random.Generator
) -> pd.DataFrame:
    """Return the edit list of one fish, `ticks` long, that swims to goals and then wanders."""
    return build_edit_list(animate_fish(player, goals, ticks, rng), ticks, player.edit_inputs)


class NoRoom(FinloopError):
    """The error that the tank has no place for another fish that is clear of those in it."""
