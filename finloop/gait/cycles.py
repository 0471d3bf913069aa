"""From contours and their period to the cycle of a gait: the phase of every frame.

Phase 0 is key 1 (curve paper, Fig. 9). In a walker from the side, the right fore and left hind
limbs are foremost then, the others hindmost. In a fish, the tail is farthest to the left.
"""

from dataclasses import replace

import numpy as np

from finloop.base.arrays import Floats
from finloop.gait.feet import align_phase, foot_positions
from finloop.gait.film import GaitContours, hip_offsets
from finloop.gait.limbs import Limbs, Region, limbs
from finloop.gait.outline import TrackContours, join_steady_frames
from finloop.gait.period import Period, fill_gaps, period, require_periodic

OUTLINE = "outline"


def film_of_swim(swim: TrackContours) -> GaitContours:
    """Return the contours and phases of the steady frames of a fish, in body lengths.

    FinloopError if no motion repeats.
    """
    points, phase = join_steady_frames([swim])
    return GaitContours({OUTLINE: points}, phase, 1.0, "mirror")


def film_of_regions(
    frames: list[dict[str, Region | None]],
    frame_rate_hz: float,
    n: int,
    split: float = 0.25,
    first: int = 0,
) -> tuple[GaitContours, Period, Limbs]:
    """Return a walker's contours and phases in its steady frames, its period, and all its limbs.

    frames: contours by id for each frame, in px; n: points of a contour; split: phase of key 2, in
    cycles; first: the number of the first frame, for messages. Limbs are in the body frame, px. The
    period is computed twice, because the body's track is smoothed over a cycle. FinloopError as in
    `gait.limbs.limbs`, or if no motion repeats.
    """
    contours = limbs(frames, n, None, first)
    beat = _beat(contours, frame_rate_hz)
    contours = limbs(frames, n, round(frame_rate_hz / beat.frequency_hz), first)
    beat = _beat(contours, frame_rate_hz)
    steady = {name: points[beat.steady] for name, points in contours.points.items()}
    phase = align_phase(beat.phase[beat.steady], foot_positions(steady), split)
    film = GaitContours(steady, phase, contours.length_px, "swap").complete()
    return replace(film, offsets=hip_offsets(film)), beat, contours


def _beat(contours: Limbs, frame_rate_hz: float) -> Period:
    points = contours.points
    signal = np.concatenate([of.reshape(len(of), -1) for of in points.values()], axis=1)
    beat = period(fill_gaps(signal), frame_rate_hz, limb_signal(points))
    return require_periodic(beat, f"the limbs {', '.join(points)}")


def limb_signal(points: dict[str, Floats]) -> Floats:
    """Return a signal (frames,) that is greatest at key 1: right fore and left hind limbs ahead.

    points: limbs (frames, n, 2) by id, x ahead; NaN where missing. The result has their unit. The
    other limbs are behind. Among ids that are neither fore nor hind, the right are ahead.
    """
    total = np.zeros(len(next(iter(points.values()))))
    for name, limb in points.items():
        x = limb[..., 0].mean(axis=1)
        sign = 1 if ("right" in name) != ("hind" in name) else -1
        total += sign * fill_gaps((x - np.nanmean(x))[:, None])[:, 0]
    return total
