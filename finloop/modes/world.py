"""What the fish paper's modes swim in: the tank, and what the film teaches of swimming."""

from dataclasses import dataclass

import numpy as np

from finloop.animate.arena import Tank
from finloop.animate.kinematics import Spot
from finloop.animate.motion import Motion
from finloop.animate.state import Fish


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
