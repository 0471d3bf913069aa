"""The truth about the drawn dog that only tests ask for: masks of its parts, its soles."""

import numpy as np
import skimage

from finloop.drawn.dog import walk
from finloop.drawn.dog.shape import BODY, FAR_OFFSET, LIMBS

POINTS = 256


def fill(contour, height, width):
    """Pixels (height, width) whose centres lie within a contour (n, 2) of x and y."""
    out = np.zeros((height, width), bool)
    out[skimage.draw.polygon(contour[:, 1], contour[:, 0], out.shape)] = True
    return out


def true_masks(dog, frame):
    """Masks of all limbs and of the trunk, whole, also where other parts hide them.

    So a person would trace them.
    """
    phase, origin = float(walk.frame_phases(dog)[frame]), walk.standing_points_px(dog)[frame]
    parts = {name: walk.limb_contours_at(dog, name, np.array(phase), POINTS) for name in walk.NAMES}
    parts["body"] = walk.part_contour(dog, phase, BODY, POINTS)
    size = dog.height_px, dog.width_px
    return {name: fill(origin + contour, *size) for name, contour in parts.items()}


def feet_px(dog, name, phase):
    """Point of the sole (…, 2) below the foot's joint, in the body frame, px; at rest y is 0."""
    far = np.array(FAR_OFFSET if name.endswith("left") else (0.0, 0.0))
    sole = np.array([LIMBS[name[:4]].joints[3][0], 0.0])
    return dog.trunk_px * (walk.foot_displacements(dog, name, phase) + sole + far)
