"""What the fish paper's modes swim in: the tank, and what the film teaches of swimming."""

from dataclasses import dataclass

import numpy as np

from finloop.animate.arena import Tank
from finloop.animate.kinematics import Spot
from finloop.animate.motion import Motion
from finloop.animate.state import Fish
from finloop.animate.swim import one_of
from finloop.base.arrays import Floats

_TRIES = 8  # a place to wander to is drawn so often before any place will do


@dataclass(frozen=True)
class World:
    """tank: its legal places are those where every picture fits in, whatever its heading.

    touch_px: radius of a goal; head_px: the head is so far before the centre.
    """

    tank: Tank
    motion: Motion
    touch_px: float
    head_px: float

    def aim(self, fish: Fish, goal: Spot, near_px: float) -> Spot:
        """Return the point to head for: the legal place nearest to the goal, or one on the way.

        The goal itself where that is less than `near_px` away.
        """
        legal = self.tank.into(goal.x, goal.y)
        if np.hypot(legal[0] - fish.x, legal[1] - fish.y) < near_px:
            return goal
        x, y = self.tank.waypoint(fish.x, fish.y, *legal)
        return goal._replace(x=float(x), y=float(y))

    def somewhere(self, fish: Fish, rng: np.random.Generator) -> tuple[Floats, int]:
        """Draw a place (2,) px to wander to, and for how many ticks, as the film's turns go."""
        motion, tank = self.motion, self.tank
        for _ in range(_TRIES):
            angle = one_of(motion.turns.angle_deg, rng) * (-1.0, 1.0)[rng.integers(2)]
            ticks = int(one_of(motion.straight_ticks, rng))
            way = max(2.0, fish.speed * ticks / motion.rate_hz) * motion.body_length_px
            direction = np.radians(fish.heading + angle)
            x, y = fish.x + way * np.cos(direction), fish.y - way * np.sin(direction)
            if tank.sees(fish.x, fish.y, x, y):
                return np.array([x, y]), ticks
        return np.array(tank.random_point(rng)), int(one_of(motion.straight_ticks, rng))
