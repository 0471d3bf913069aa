"""The parts of the standing dog, and how its limbs bend: outlines, joints, skin.

Unit: the trunk, from hip to shoulder joint, is 1 long. x is forward (screen right), y down, 0 at
the ground below the middle of the trunk. Outlines run clockwise as seen.

A limb has four bones, each turning about its upper joint: upper, lower, pastern and paw. Its skin
moves by linear blend skinning: a bone nearer to the point at rest has more weight.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from finloop.base.arrays import Floats
from finloop.curve.contour import Curve, resample_curve

FAR_OFFSET = (0.045, -0.022)  # shift of the far limbs, for a view from slightly above
FINE = 2048
BLEND = 4  # power of the distance to a bone
BLUNT = 0.02  # added to that distance, so that a point on a bone follows the others too


@dataclass(frozen=True)
class LimbShape:
    """One limb of the drawn dog at rest: joints, outline, and how it bends, in trunk lengths."""

    # (5, 2): hip or shoulder, knee or elbow, hock or wrist, foot, tip of the toes
    joints: tuple[tuple[float, float], ...]
    outline: tuple[tuple[float, float], ...]  # (k, 2) nodes of a closed smooth curve
    bend: int  # side of the knee: 1 = forward (knee), −1 = backward (elbow)
    # turn of the pastern [rad] per unit of the foot ahead, and per unit of lift
    lean: tuple[float, float]

    def bone_lengths(self) -> Floats:
        """Return the lengths (4,) of the bones, from the top to the toes, in trunk lengths."""
        return np.asarray(np.linalg.norm(np.diff(self.joints, axis=0), axis=1))


FORE = LimbShape(
    joints=((0.47, -0.78), (0.29, -0.47), (0.42, -0.13), (0.44, -0.035), (0.54, -0.025)),
    outline=(
        (0.37, -0.82), (0.47, -0.90), (0.58, -0.82), (0.585, -0.68), (0.50, -0.53),
        (0.455, -0.41), (0.465, -0.26), (0.475, -0.14), (0.50, -0.085), (0.555, -0.06),
        (0.585, -0.025), (0.56, 0.0), (0.475, 0.0), (0.40, -0.004), (0.375, -0.035),
        (0.375, -0.11), (0.36, -0.20), (0.315, -0.34), (0.24, -0.44), (0.245, -0.54),
        (0.30, -0.69),
    ),
    bend=-1,
    lean=(-0.5, 2.2),
)  # fmt: skip
HIND = LimbShape(
    joints=((-0.46, -0.80), (-0.34, -0.50), (-0.56, -0.25), (-0.50, -0.035), (-0.39, -0.025)),
    outline=(
        (-0.60, -0.80), (-0.48, -0.91), (-0.33, -0.87), (-0.25, -0.73), (-0.245, -0.57),
        (-0.285, -0.46), (-0.36, -0.375), (-0.435, -0.29), (-0.475, -0.20), (-0.465, -0.12),
        (-0.435, -0.08), (-0.385, -0.055), (-0.355, -0.022), (-0.38, 0.0), (-0.465, 0.0),
        (-0.54, -0.004), (-0.565, -0.04), (-0.57, -0.11), (-0.60, -0.19), (-0.63, -0.26),
        (-0.60, -0.32), (-0.545, -0.40), (-0.555, -0.52), (-0.60, -0.63), (-0.63, -0.72),
    ),
    bend=1,
    lean=(-0.6, 2.6),
)  # fmt: skip
LIMBS = {"fore": FORE, "hind": HIND}

BODY = (
    (-0.66, -0.80), (-0.62, -0.92), (-0.48, -0.99), (-0.20, -0.97), (0.12, -0.96), (0.38, -1.02),
    (0.54, -1.13), (0.66, -1.28), (0.80, -1.27), (0.86, -1.14), (0.80, -0.98), (0.72, -0.84),
    (0.64, -0.70), (0.52, -0.60), (0.34, -0.55), (0.08, -0.57), (-0.16, -0.63), (-0.34, -0.67),
    (-0.52, -0.66), (-0.63, -0.70),
)  # fmt: skip
HEAD = (
    (0.61, -1.25), (0.66, -1.36), (0.76, -1.41), (0.87, -1.38), (0.95, -1.30), (1.08, -1.26),
    (1.15, -1.22), (1.16, -1.16), (1.11, -1.11), (0.98, -1.09), (0.85, -1.07), (0.72, -1.10),
    (0.63, -1.16),
)  # fmt: skip
EAR = (
    (0.66, -1.36), (0.75, -1.35), (0.76, -1.25), (0.74, -1.12), (0.68, -1.05), (0.61, -1.09),
    (0.60, -1.22),
)  # fmt: skip
TAIL = (
    (-0.58, -0.92), (-0.70, -1.00), (-0.80, -1.12), (-0.85, -1.26), (-0.91, -1.30),
    (-0.92, -1.20), (-0.88, -1.05), (-0.78, -0.90), (-0.66, -0.82), (-0.57, -0.82),
)  # fmt: skip
NECK, TAIL_ROOT = (0.74, -1.18), (-0.60, -0.87)  # head and tail turn about these
EYE, NOSE = (0.905, -1.275), (1.145, -1.205)


@cache
def points_on_smooth_curve(nodes: tuple[tuple[float, float], ...], n: int) -> Floats:
    """Return n points (n, 2) at equal distances on the closed smooth curve through nodes."""
    corners = np.array([*nodes, nodes[0]])
    # Centripetal knots, √distance apart, keep the curve from overshooting between near nodes.
    knots = np.r_[0.0, np.cumsum(np.sqrt(np.linalg.norm(np.diff(corners, axis=0), axis=1)))]
    spline = scipy.interpolate.CubicSpline(knots, corners, bc_type="periodic")
    fine = spline(np.linspace(0, knots[-1], FINE, endpoint=False))
    return resample_curve(Curve(fine, closed=True), n).points


@cache
def _skin_and_bone_weights(shape: LimbShape, n: int) -> tuple[Floats, Floats]:
    """Return a limb's outline (n, 2) at rest, and the weight (n, 4) of each bone at its points.

    The nearer a bone the greater its weight; the weights at a point add up to 1.
    """
    outline, joints = points_on_smooth_curve(shape.outline, n), np.array(shape.joints)
    upper_ends, bones = joints[:-1], np.diff(joints, axis=0)
    # The place on each bone that is nearest to each point of the outline, 0 at its upper end.
    along = np.einsum("nbk,bk->nb", outline[:, None] - upper_ends, bones)
    share = np.clip(along / shape.bone_lengths() ** 2, 0, 1)
    nearest = upper_ends + share[..., None] * bones
    distance = np.linalg.norm(outline[:, None] - nearest, axis=2) + BLUNT
    weight = distance**-BLEND
    return outline, weight / weight.sum(axis=1, keepdims=True)


def limb_outlines(shape: LimbShape, foot: Floats, top: Floats, n: int) -> Floats:
    """Return outlines (…, n, 2) of a limb whose foot and top are displaced from rest.

    foot, top (…, 2): how far both are moved; y is down, the unit the trunk length. NaN if the limb
    does not reach so far. The outline is a smooth function of `foot` and `top` alone.
    """
    upper_ends, turns = _pose_bones(shape, foot, top)
    outline, weight = _skin_and_bone_weights(shape, n)
    # Linear blend skinning, in complex numbers: each bone turns and moves the whole outline, seen
    # from its upper end (n, 4); a point of the limb is the weighted mean of its four.
    local = (outline[:, None] - np.array(shape.joints)[:4]) @ [1, 1j]
    ends = upper_ends @ np.array([1, 1j])
    points = np.einsum("nb,...nb->...n", weight, local * np.exp(1j * turns)[..., None, :])
    points = points + ends @ weight.T
    return np.stack([points.real, points.imag], axis=-1)


def _pose_bones(shape: LimbShape, foot: Floats, top: Floats) -> tuple[Floats, Floats]:
    """Return the upper ends (…, 4, 2) of a limb's bones, and their turns (…, 4) from rest [rad].

    foot, top (…, 2): how far both are moved from rest, in trunk lengths; y is down, so a turn from
    x to y is clockwise on screen. The foot's motion turns paw and pastern; the knee (of a fore
    limb: elbow) follows by two-link inverse kinematics, NaN if the limb does not reach so far.
    """
    rest, bones = np.array(shape.joints), shape.bone_lengths()
    pastern_turn = shape.lean[0] * foot[..., 0] - shape.lean[1] * foot[..., 1]
    paw_turn = -0.6 * shape.lean[1] * foot[..., 1]  # 0.6 of the pastern's turn by lift
    # From the foot up to the ankle (hock or wrist), as a complex number, turned with the pastern.
    up = (rest[2] - rest[3]) @ [1, 1j] * np.exp(1j * pastern_turn)
    ankle = rest[3] + foot + np.stack([up.real, up.imag], axis=-1)
    hip = rest[0] + top
    across = ankle - hip
    distance = np.linalg.norm(across, axis=-1)
    # Law of cosines: the angle at the hip between the upper bone and the line to the ankle.
    cosine = (bones[0] ** 2 + distance**2 - bones[1] ** 2) / (2 * bones[0] * distance)
    # y is down, so a knee in front (+x) of a limb that hangs down is at a smaller angle.
    upper_angle = np.arctan2(across[..., 1], across[..., 0]) - shape.bend * np.arccos(cosine)
    knee = hip + bones[0] * np.stack([np.cos(upper_angle), np.sin(upper_angle)], axis=-1)
    lower_x, lower_y = np.moveaxis(ankle - knee, -1, 0)
    lower_angle = np.arctan2(lower_y, lower_x)
    rest_x, rest_y = np.diff(rest, axis=0).T  # of the bones at rest
    rest_angle = np.arctan2(rest_y, rest_x)
    turns = [upper_angle - rest_angle[0], lower_angle - rest_angle[1], pastern_turn, paw_turn]
    upper_ends = np.stack([hip, knee, ankle, rest[3] + foot], axis=-2)
    return upper_ends, np.stack(turns, axis=-1)
