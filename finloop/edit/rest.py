"""Rest: rows of the film at which the animal keeps its place and posture.

A camera sees a resting animal as one picture again and again; so does a codec that leaves out small
changes. Nothing may move the fish there: a picture that stays the same and drifts looks false.
"""

import numpy as np

from finloop.base.arrays import Mask
from finloop.edit.bodies import Bodies


def resting_rows(bodies: Bodies, share: float) -> Mask:
    """Return whether the animal rests at each feature row (n,).

    It rests where it moves, since the row before, less than `share` of the film's root mean square
    movement. The movement is that of its centre and of the body about it.
    """
    pose, here = bodies.poses.pose, bodies.goes_on[:-1]
    way = np.hypot(np.diff(pose.x_px), np.diff(pose.y_px)) / pose.size_px[1:]
    square = way**2 + bodies.movement.whole**2
    made = np.zeros(len(bodies.goes_on), bool)
    if here.any():
        made[1:] = here & (square < share**2 * square[here].mean())
    return made
