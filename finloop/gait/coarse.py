"""A gait cycle at few control points (curve paper Fig. 14): only their coefficients move.

The model moves every coefficient by itself (Eq. 3.16), so few control points, solved alone, make
the curves that all coefficients make without their details.
"""

from collections.abc import Mapping

import numpy as np

from finloop.base.arrays import Points
from finloop.curve.wavelet import control_points, count_halvings, curves_from_control
from finloop.gait.model import (
    POOLED,
    Gait,
    HalfCycleLayout,
    contours_half_cycle_later,
    four_key_frames,
    interpolate_contours,
    locate_in_subcycle,
)


def few_point_contours(
    key1: Mapping[str, Points],
    key2: Mapping[str, Points],
    gait: Gait,
    phases: Points,
    layout: HalfCycleLayout,
    control: int,
) -> dict[str, Points]:
    """Return closed contours (frames, n, 2), by id, of a cycle solved at few control points.

    key1, key2: key frames, contours (n, 2) by id; phases (frames,): of the gait cycle; layout:
    where the second half of the cycle is placed; control: number of control points of each contour,
    a power of two, at least `gait.coarse` and at most n. FinloopError if the keys do not match, or
    n or `control` is no power of two.
    """
    poses = four_key_frames(key1, key2, gait.symmetry, layout)
    subcycle, tau = locate_in_subcycle(np.mod(phases, 0.5), gait.split)
    first_half = dict[str, Points]()
    for name in key1:
        level = count_halvings(len(poses[0][name])) - count_halvings(control)
        gait_gamma = gait.gamma.get(name, gait.gamma.get(POOLED, {}))
        few = [control_points(pose[name], gait.wavelet, level) for pose in poses[:3]]
        frames = np.empty((len(phases), control, 2))
        for number, letter in enumerate("AB"):
            is_now = subcycle == number
            gammas = gait_gamma.get(letter, (0.0,))[:control]  # coarse to fine
            frames[is_now] = interpolate_contours(
                few[number], few[number + 1], tau[is_now], gammas, gait.descriptor
            )
        first_half[name] = curves_from_control(frames, gait.wavelet, level)
    later = contours_half_cycle_later(first_half, gait.symmetry, layout)
    in_first_half = (np.mod(phases, 1.0) < 0.5)[:, None, None]
    return {name: np.where(in_first_half, half, later[name]) for name, half in first_half.items()}
