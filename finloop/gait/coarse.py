"""Solve a gait cycle at few control points (curve paper Fig. 14), which alone move.

The model moves every coefficient by itself (Eq. 3.16), so few control points, solved alone, make
the curves that all coefficients make without their details.
"""

from finloop.base.arrays import Points
from finloop.curve.wavelet import control_points, count_halvings, curves_from_control
from finloop.gait.model import (
    LETTERS,
    Gait,
    HalfCycleLayout,
    Keys,
    exchange_second_half,
    four_key_frames,
    interpolate_subcycles,
    locate_with_symmetry,
)


def few_point_contours(
    keys: Keys, gait: Gait, phases: Points, layout: HalfCycleLayout, control: int
) -> dict[str, Points]:
    """Return closed contours (frames, n, 2), by id, of a gait cycle solved at few control points.

    keys: two key frames, or four without symmetry; phases (frames,): of the gait cycle; layout:
    where the second half of the cycle is placed; control: number of control points of each contour,
    a power of two, at least `gait.coarse` and at most n. FinloopError if the keys do not match, or
    n or `control` is no power of two.
    """
    four_keys = four_key_frames(keys, gait.symmetry, layout)
    subcycle, tau = locate_with_symmetry(phases, gait.symmetry, gait.split)
    cycle = dict[str, Points]()
    for name, contour in four_keys[0].items():
        level = count_halvings(len(contour)) - count_halvings(control)
        few = [control_points(key[name], gait.wavelet, level) for key in four_keys]
        gammas = [  # coarse to fine
            gait.contour_gamma(name, letter)[:control] for letter in LETTERS[gait.symmetry]
        ]
        poses = interpolate_subcycles(few, gammas, subcycle, tau, gait.descriptor)
        cycle[name] = curves_from_control(poses, gait.wavelet, level)
    return exchange_second_half(cycle, phases, gait.symmetry, layout)
