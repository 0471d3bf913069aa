"""A detour: what a fish does that comes no nearer to its goal.

Ways are looked at for a few seconds. Where each of them first leads away, as from a corner that the
fish faces, to rest there is cheapest, and is so again at the next decision. So a fish that has come
no nearer for a time is sent anywhere else, and then to its goal again. A fish that has passed its
goal and swims back comes nearer than it has been since.
"""

import numpy as np

from finloop.animate.state import Effort, Fish, Waters
from finloop.edit.schema import Goal

_NEARER = 0.25  # body lengths; by less a fish comes no nearer


def effort(
    before: Effort, fish: Fish, goal: Goal, waters: Waters, rng: np.random.Generator
) -> Effort:
    """How a fish gets on now; a detour is begun where it came no nearer for `matching.patience`."""
    far = float(np.hypot(goal.x_px - fish.x, goal.y_px - fish.y))
    if before.goal != (goal.x_px, goal.y_px):
        return Effort((goal.x_px, goal.y_px), far, fish.tick)
    if fish.tick < before.until:
        return before
    if before.until > before.since:  # a detour is over
        return before._replace(far=far, since=fish.tick, until=0)
    if far < before.far - _NEARER * waters.motion.body_length_px:
        return before._replace(far=far, since=fish.tick)
    before = before._replace(far=max(far, before.far))
    p = waters.settings
    if fish.tick - before.since < waters.ticks(p.patience):
        return before
    return before._replace(
        detour=waters.tank.random_point(rng), until=fish.tick + waters.ticks(p.look_ahead)
    )
