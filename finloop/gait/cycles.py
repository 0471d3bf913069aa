"""Find the phase of every frame in the cycle of a gait, from contours and their period.

Phase 0 is key 1 (curve paper, Fig. 9). In a walker from the side, the right fore and left hind
limbs are foremost then, the others hindmost. In a fish, the tail is farthest to the left.

The fundamental of a walk gives its period well, but not the phase at which the feet turn: a foot on
the ground moves evenly, a lifted foot does not. In a gait of four subcycles every foot moves along
four parabolas joined at the keys. So the keys are where four parabolas fit all feet best.

Without symmetry, as in a gallop, the keys are where four straight lines joined at them fit all feet
best: parabolas follow the frames of a short film wherever the keys are. Key 1 is the one of the
four at which the feet are farthest apart.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.gait.fit import GaitContours, partner_offsets
from finloop.gait.limbs import Limbs, Region, limb_contours
from finloop.gait.model import locate_in_subcycle
from finloop.gait.outline import TrackContours, join_steady_frames
from finloop.gait.period import Period, fill_gaps, find_period, require_periodic, set_phase_zero
from finloop.gait.settings import Symmetry

OUTLINE = "outline"
FOOT = 16  # the lowest 1/FOOT of a limb's contour is its foot
REACH = 0.06  # cycles: half width of the search for key 1
STEPS = 61  # of that search, 0.002 cycles apart
SHIFTS = 240  # of the phase in a cycle without symmetry, among which key 1 is searched for


def swimmer_gait_contours(swim: TrackContours) -> GaitContours:
    """Return a fish's outlines and phases in the frames in which it beats its tail steadily.

    swim: the contours of one track, in body lengths. FinloopError if no motion repeats.
    """
    points, phase = join_steady_frames([swim])
    return GaitContours({OUTLINE: points}, phase, body_length=1.0, symmetry="mirror")


def walker_gait_contours(
    frames: list[dict[str, Region | None]],
    frame_rate_hz: float,
    n: int,
    split: float = 0.25,
    first: int = 0,
    symmetry: Symmetry = "swap",
    cycle_frames: float | None = None,
) -> tuple[GaitContours, Period, Limbs]:
    """Return a walker's contours and phases in steady frames, its period, and its limbs.

    frames: contours by id for each frame, in px, None where missing; n: points of a contour; split:
    phase of key frame 2, in cycles; first: number of the first frame, for messages; symmetry:
    "swap" or "none"; cycle_frames: frames of a gait cycle, None = to be found. If it is given all
    frames count. The limbs are the contours in all frames, px from the body, and the body's track.
    FinloopError if there is no limb, more than half of the frames lack a limb, no motion repeats,
    or the film has fewer frames than a cycle.
    """
    is_given = cycle_frames is not None
    if cycle_frames is None:
        # The body's track is smoothed over a cycle, so the period is found twice: at first with a
        # body that moves straight.
        limbs = limb_contours(frames, n, None, first, symmetry)
        cycle_frames = frame_rate_hz / _find_limb_period(limbs, frame_rate_hz).frequency_hz
        limbs = limb_contours(frames, n, round(cycle_frames), first, symmetry)
        period = _find_limb_period(limbs, frame_rate_hz)
    else:
        if len(frames) < cycle_frames:
            raise FinloopError(
                f"{len(frames)} frames, and a gait cycle of {cycle_frames:g}",
                "a film of a whole cycle or more",
                "trace more frames, or correct gait.regions_cycle_frames",
            )
        limbs = limb_contours(frames, n, cycle_frames, first, symmetry)
        phase = np.arange(len(frames)) / cycle_frames
        every = np.ones(len(frames), bool)
        period = Period(
            frame_rate_hz / cycle_frames, phase, every, np.nan, len(frames) / cycle_frames, why=""
        )
        if symmetry == "swap":
            period = set_phase_zero(period, _key_1_signal(limbs.points))
    contours = {name: points[period.steady] for name, points in limbs.points.items()}
    phase, feet = period.phase[period.steady], foot_positions(contours)
    if symmetry == "none":
        phase = align_phase_without_symmetry(phase, feet, split)
        return GaitContours(contours, phase, limbs.length_px, symmetry), period, limbs
    phase = align_phase(phase, feet, split, stretches=not is_given)
    film = GaitContours(contours, phase, limbs.length_px, symmetry).add_hidden_limbs()
    return replace(film, offsets=partner_offsets(film)), period, limbs


def _find_limb_period(limbs: Limbs, frame_rate_hz: float) -> Period:
    """Return the limbs' common period, phase 0 at key frame 1; FinloopError if there is none."""
    points = limbs.points
    coordinates = [limb.reshape(len(limb), -1) for limb in points.values()]
    signal = fill_gaps(np.concatenate(coordinates, axis=1))
    period = find_period(signal, frame_rate_hz, extreme=_key_1_signal(points))
    return require_periodic(period, f"the limbs {', '.join(points)}")


def _key_1_signal(points: dict[str, Floats]) -> Floats:
    """Return a signal (frames,) that is greatest at key frame 1 of a walk.

    It grows as the right fore and left hind limbs come forward and the others go back. points:
    contours (frames, n, 2) by id, x forward. Ids without "hind" count as fore, without "right" as
    left.
    """
    signal = np.zeros(len(next(iter(points.values()))))
    for name, limb in points.items():
        x = limb[..., 0].mean(axis=1)  # its middle, NaN where the limb is hidden
        sign = 1 if ("right" in name) != ("hind" in name) else -1
        signal += sign * fill_gaps((x - np.nanmean(x))[:, None])[:, 0]
    return signal


def foot_positions(limbs: Mapping[str, Floats]) -> Floats:
    """Return how far forward each foot is in each frame: x (frames, limbs), NaN where hidden.

    limbs: contours (frames, n, 2) by id, x forward and y down; the result has their unit. A foot is
    the 1/FOOT of a contour's points that are lowest on average.
    """
    feet_x = []
    for points in limbs.values():
        lowest_first = np.argsort(-np.nanmean(points[..., 1], axis=0), kind="stable")
        foot = lowest_first[: max(1, len(lowest_first) // FOOT)]
        feet_x.append(points[:, foot, 0].mean(axis=1))
    return np.stack(feet_x, axis=1)


def align_phase(phase: Floats, foot_x: Floats, split: float, stretches: bool = True) -> Floats:
    """Return phases (frames,), shifted and stretched so that feet turn back at the key frames.

    phase: in cycles; foot_x (frames, k): how far forward k feet are; split: phase of key frame 2.
    The shift, at most about REACH cycles, and the stretch about the middle are those with which
    parabolas fit the feet best. Frames with NaN are not fitted; if fewer than 12 are left, the
    phase is returned unchanged. stretches: False = the cycle's length is known, so shift alone.
    """
    complete = np.isfinite(foot_x).all(axis=1)
    if complete.sum() < 12:  # the fit has eight numbers per foot
        return phase
    fitted_phase, centred_x = phase[complete], foot_x[complete] - foot_x[complete].mean(axis=0)
    middle = float(fitted_phase.mean())

    def squared_error(change: Floats) -> float:
        """Return the squared error after a change of the phase: shift, or shift and stretch."""
        shift, stretch = (*change, 0.0)[:2]
        changed = fitted_phase - shift + stretch * (fitted_phase - middle)
        return _parabola_fit_error(changed, centred_x, split)

    # First the best shift on a grid, then shift and stretch by descent from there.
    shifts = np.linspace(-REACH, REACH, STEPS)
    errors = [squared_error(np.array([shift, 0.0])) for shift in shifts]
    best_shift = float(shifts[np.argmin(errors)])
    # The best shift, one two steps of the grid farther, and a little stretch.
    simplex = np.array([(best_shift, 0.0), (best_shift + 0.004, 0.0), (best_shift, 0.003)])
    if not stretches:
        simplex = simplex[:2, :1]
    fatol = 1e-12 * float((centred_x**2).sum())
    found = scipy.optimize.minimize(
        squared_error,
        simplex[0],
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 1e-5, "fatol": fatol},
    ).x
    shift, stretch = (*found, 0.0)[:2]
    return phase - shift + stretch * (phase - middle)


def align_phase_without_symmetry(phase: Floats, foot_x: Floats, split: float) -> Floats:
    """Return phases (frames,), shifted so that feet move straight from key frame to key frame.

    phase: in cycles; foot_x (frames, k): how far forward k feet are; split: phase of key frame 2.
    Each foot is fitted to the frames that show it. Key 1 is the key at which the feet are farthest
    apart.
    """
    shifts, errors, apart = np.arange(SHIFTS) / SHIFTS, [], []
    for shift in shifts:
        terms = _line_terms(phase - shift, split)
        error, places = 0.0, list[float]()  # of the feet in key 1
        for foot in foot_x.T:
            shown = np.isfinite(foot)
            keys = np.linalg.lstsq(terms[shown], foot[shown], rcond=None)[0]  # the foot in them
            error += float(((foot[shown] - terms[shown] @ keys) ** 2).sum())
            places.append(float(keys[0]))
        errors.append(error)
        apart.append(float(np.ptp(places)))
    # The keys are the same half a cycle later, and in even quarters a quarter later: there the
    # errors differ by rounding alone.
    equal = np.array(errors) <= min(errors) + 1e-9 * float(np.nansum(foot_x**2))
    return phase - shifts[np.where(equal, apart, -1).argmax()]


def _line_terms(phase: Floats, split: float) -> Floats:
    """Return the weights (frames, 4) of the key frames at each phase, by linear interpolation.

    phase (frames,): in cycles; split: phase of key frame 2.
    """
    subcycle, tau = locate_in_subcycle(phase, split)
    terms, row = np.zeros((len(phase), 4)), np.arange(len(phase))
    terms[row, subcycle] = 1 - tau
    terms[row, (subcycle + 1) % 4] = tau
    return terms


def _parabola_fit_error(phase: Floats, foot_x: Floats, split: float) -> float:
    """Return the squared error of a fit of feet's motion by parabolas between key frames.

    phase (frames,): in cycles; foot_x (frames, k): how far forward k feet are; split: phase of key
    frame 2. The error is summed over frames and feet.
    """
    subcycle, tau = locate_in_subcycle(phase, split)
    bows = np.zeros((len(phase), 4))  # one in each subcycle
    bows[np.arange(len(phase)), subcycle] = tau * (1 - tau)
    terms = np.hstack([_line_terms(phase, split), bows])
    residual = foot_x - terms @ np.linalg.lstsq(terms, foot_x, rcond=None)[0]
    return float((residual**2).sum())
