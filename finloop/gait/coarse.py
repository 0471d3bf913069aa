"""A gait cycle at few control points (curve paper Fig. 14): only their coefficients move.

The model moves every coefficient by itself (Eq. 3.16), so few control points, solved alone, make
the curves that all coefficients make without their details.
"""

from collections.abc import Mapping

import numpy as np

from finloop.base.arrays import Points
from finloop.curve.wavelet import control_points, count_halvings, curves_from_control
from finloop.gait.model import (
    Gait,
    HalfCycleLayout,
    add_second_half,
    four_key_frames,
    interpolate_first_half,
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
        few = [control_points(pose[name], gait.wavelet, level) for pose in poses[:3]]
        gammas = [gait.contour_gamma(name, letter)[:control] for letter in "AB"]  # coarse to fine
        frames = interpolate_first_half(few, gammas, subcycle, tau, gait.descriptor)
        first_half[name] = curves_from_control(frames, gait.wavelet, level)
    return add_second_half(first_half, phases, gait.symmetry, layout)
