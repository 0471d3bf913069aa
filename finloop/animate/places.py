"""Random places in the tank: goals, and where a fish wanders to."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.animate.arena import goal_name
from finloop.animate.state import Fish
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.edit.schema import Goal

_TRIES = 8  # draws of a good place to wander to, before any place will do


def random_goals(world: World, count: int, rng: np.random.Generator) -> list[Goal]:
    """Return random goals that the head of a fish can touch; all pixels are equally likely."""
    tank, touch_px = world.tank, world.touch_px + world.head_px
    goals: list[Goal] = []
    while len(goals) < count:
        y, x = (int(rng.integers(side)) for side in tank.arena.shape)
        near = tank.nearest_legal_point(x, y)
        if tank.arena[y, x] and np.hypot(near[0] - x, near[1] - y) <= touch_px:
            goals.append(Goal(goal_name(len(goals)), float(x), float(y)))
    return goals


def random_wander_place(world: World, fish: Fish, rng: np.random.Generator) -> tuple[Floats, int]:
    """Choose a random place to wander to; return x, y px (2,), and for how many ticks it holds.

    It is as far to the side as one of the film's turns, as far away as a straight stretch, and in
    sight; else anywhere in the tank.
    """
    motion, tank = world.motion, world.tank
    for _ in range(_TRIES):
        angle_deg = random_item(motion.turns.angle_deg, rng)
        turn = angle_deg * (-1.0, 1.0)[rng.integers(2)]  # to the right or left
        ticks = int(random_item(motion.straight_ticks, rng))
        distance = max(2.0, fish.speed * ticks / motion.rate_hz) * motion.body_length_px
        direction = np.radians(fish.heading + turn)
        x, y = fish.x + distance * np.cos(direction), fish.y - distance * np.sin(direction)
        if tank.can_swim_straight(fish.x, fish.y, x, y):
            return np.array([x, y]), ticks
    return np.array(tank.random_point(rng)), int(random_item(motion.straight_ticks, rng))


def random_item(values: NDArray[Any], rng: np.random.Generator) -> Any:
    """Return one of the values (n,) at random, as `rng.choice` does, but five times as fast."""
    return values[rng.integers(len(values))]
