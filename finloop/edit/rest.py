"""Rest: rows of the film at which the animal is where it was, in the posture that it had.

A camera sees an animal at rest as one picture again and again, and so does a codec that leaves out
what hardly changes. Whatever else moves a fish must not move it there: a picture that stays the
same and drifts looks false.
"""

import numpy as np

from finloop.base.arrays import Mask
from finloop.edit.bodies import Bodies


def rests(bodies: Bodies, share: float) -> Mask:
    """Whether the animal rests at each row (n,) of the film.

    It does where it moves from the row before by less than a share of the root mean square of the
    film. Its movement is that of its centre, and of the body about it.
    """
    pose, here = bodies.poses.pose, bodies.goes_on[:-1]
    way = np.hypot(np.diff(pose.x_px), np.diff(pose.y_px)) / pose.size_px[1:]
    square = way**2 + bodies.movement.whole**2
    made = np.zeros(len(bodies.goes_on), bool)
    if here.any():
        made[1:] = here & (square < share**2 * square[here].mean())
    return made
