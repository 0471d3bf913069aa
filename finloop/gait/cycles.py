"""From contours and their period to the cycle of a gait: the phase of every frame.

Phase 0 is key 1 (curve paper, Fig. 9). In a walker from the side, the right fore and left hind
limbs are foremost then, the others hindmost. In a fish, the tail is farthest to the left.

The fundamental of a walk gives its period well, but not the phase at which the feet turn: a foot on
the ground moves evenly, a lifted foot does not. In a gait of four subcycles every foot moves along
four parabolas joined at the keys. So the keys are where four parabolas fit all feet best.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy

from finloop.base.arrays import Floats
from finloop.gait.fit import GaitContours, partner_offsets
from finloop.gait.limbs import Limbs, Region, limb_contours
from finloop.gait.model import locate_in_subcycle
from finloop.gait.outline import TrackContours, join_steady_frames
from finloop.gait.period import Period, fill_gaps, find_period, require_periodic

OUTLINE = "outline"
FOOT = 16  # the lowest 1/FOOT of a limb's contour is its foot
REACH = 0.06  # cycles: half width of the search for key 1
STEPS = 61


def swimmer_gait_contours(swim: TrackContours) -> GaitContours:
    """Return a fish's outlines in the frames with a steady tail beat, and their phases in the beat.

    swim: the contours of one track, in body lengths. FinloopError if no motion repeats.
    """
    points, phase = join_steady_frames([swim])
    return GaitContours({OUTLINE: points}, phase, 1.0, "mirror")


def walker_gait_contours(
    frames: list[dict[str, Region | None]],
    frame_rate_hz: float,
    n: int,
    split: float = 0.25,
    first: int = 0,
) -> tuple[GaitContours, Period, Limbs]:
    """Return a walker's outlines and phases in frames with a steady gait, its period, its limbs.

    frames: contours by id for each frame, in px; n: points of a contour; split: phase of key 2, in
    cycles; first: the number of the first frame, for messages. Limbs are relative to the body, px.
    The period is computed twice, because the body's track is smoothed over a cycle. FinloopError as
    in `gait.limbs.limb_contours`, or if no motion repeats.
    """
    contours = limb_contours(frames, n, None, first)
    beat = _find_limb_period(contours, frame_rate_hz)
    contours = limb_contours(frames, n, round(frame_rate_hz / beat.frequency_hz), first)
    beat = _find_limb_period(contours, frame_rate_hz)
    steady = {name: points[beat.steady] for name, points in contours.points.items()}
    phase = align_phase(beat.phase[beat.steady], foot_positions(steady), split)
    film = GaitContours(steady, phase, contours.length_px, "swap").add_hidden_limbs()
    return replace(film, offsets=partner_offsets(film)), beat, contours


def _find_limb_period(contours: Limbs, frame_rate_hz: float) -> Period:
    """Return the common period of an animal's limbs; FinloopError if their motion does not repeat.

    contours: of all limbs.
    """
    points = contours.points
    signal = np.concatenate([of.reshape(len(of), -1) for of in points.values()], axis=1)
    beat = find_period(fill_gaps(signal), frame_rate_hz, _key_1_signal(points))
    return require_periodic(beat, f"the limbs {', '.join(points)}")


def _key_1_signal(points: dict[str, Floats]) -> Floats:
    """Return a signal (frames,) that is greatest at key frame 1 of a walk.

    There the right fore and left hind limbs are foremost. points: contours (frames, n, 2) by id.
    Among ids that are neither fore nor hind, the right lead.
    """
    total = np.zeros(len(next(iter(points.values()))))
    for name, limb in points.items():
        x = limb[..., 0].mean(axis=1)
        sign = 1 if ("right" in name) != ("hind" in name) else -1
        total += sign * fill_gaps((x - np.nanmean(x))[:, None])[:, 0]
    return total


def foot_positions(limbs: Mapping[str, Floats]) -> Floats:
    """Return how far forward each foot is in each frame: x (frames, limbs), NaN where hidden.

    limbs: contours (frames, n, 2) by id, x forward and y down; the result has their unit. A foot is
    the lowest 1/FOOT of the points.
    """
    feet = []
    for points in limbs.values():
        low = np.argsort(-np.nanmean(points[..., 1], axis=0), kind="stable")
        feet.append(points[:, low[: max(1, len(low) // FOOT)], 0].mean(axis=1))
    return np.stack(feet, axis=1)


def align_phase(phase: Floats, foot_x: Floats, split: float) -> Floats:
    """Shift and stretch the phase (frames,) so that the feet turn round at the key frames.

    phase: in cycles; foot_x (frames, k): how far forward k feet are; split: phase of key 2. Least
    squares over the shift, at most about REACH, and the stretch. Rows with NaN are ignored.
    """
    whole = np.isfinite(foot_x).all(axis=1)
    if whole.sum() < 12:  # the fit has eight numbers per foot
        return phase
    phases, centred_x = phase[whole], foot_x[whole] - foot_x[whole].mean(axis=0)
    middle = float(phases.mean())

    def residual(change: Floats) -> float:
        return _fit_residual(phases - change[0] + change[1] * (phases - middle), centred_x, split)

    moves = np.linspace(-REACH, REACH, STEPS)
    first = float(moves[np.argmin([residual(np.array([move, 0.0])) for move in moves])])
    best = scipy.optimize.minimize(
        residual,
        (first, 0.0),
        method="Nelder-Mead",
        options={
            "initial_simplex": [(first, 0.0), (first + 0.004, 0.0), (first, 0.003)],
            "xatol": 1e-5,
            "fatol": 1e-12 * float((centred_x**2).sum()),
        },
    ).x
    return phase - best[0] + best[1] * (phase - middle)


def _fit_residual(phase: Floats, foot_x: Floats, split: float) -> float:
    """Return how badly four parabolas, joined at the key frames, fit how feet move: squared error.

    phase (frames,): in cycles; foot_x (frames, k): how far forward k feet are; split: phase of key
    2.
    """
    which, tau = locate_in_subcycle(phase, split)
    terms, row = np.zeros((len(phase), 8)), np.arange(len(phase))
    terms[row, which] = 1 - tau
    terms[row, (which + 1) % 4] = tau
    terms[row, 4 + which] = tau * (1 - tau)
    left = foot_x - terms @ np.linalg.lstsq(terms, foot_x, rcond=None)[0]
    return float((left**2).sum())
