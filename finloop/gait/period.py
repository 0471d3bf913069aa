"""Find frequency and phase of a motion that repeats, from contours over time (§4.2).

The paper cuts the gait cycle out of the film by hand. Here the principal modes of all coordinates
give the frequency and phase of every frame. For every frequency a sinusoid and a straight line are
fitted to a window of two cycles about every frame (harmonic least squares). Viterbi's algorithm
finds the best path of frequencies through the frames, and the modes give the phase along it. The
confidence is how well all other cycles predict each cycle.

Glossary: *share* the part of the variance in a window that its sinusoid explains, 0-1.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Complex, Floats, Mask
from finloop.base.errors import FinloopError

CONFIDENT = 0.5  # least confidence of a periodic motion
LEAST_FRAMES = 8  # least frames of a window: the fit has four numbers

_STEP = 1.04  # ratio of neighbouring frequencies
_CYCLES = 2.0  # cycles in a window
_QUIET = 0.1  # share of the whole variance: a window with less shows rest, not a beat
_OCTAVE = 0.5  # cost, in shares, of a change of frequency by an octave within a cycle

_MODES = 6  # most principal modes used
_VARIANCE = 0.98  # share of the motion's variance that the modes hold together
_FASTEST = 0.4  # share of the frame rate: nearer to one half, a beat is confused with its alias
_STEADY = 0.6  # least explained share of a window about a frame of steady motion
_LEAST_CYCLES = 1.8  # least steady cycles: a cycle can only be compared with another one
_HARMONICS = 2  # harmonics of the cycle that predicts the others
_HALF_WINDOW = 0.75  # cycles before and after a frame in the window of `remove_beat`


@dataclass(frozen=True)
class Period:
    """The frequency and phase of a repeating motion, and the confidence in them."""

    frequency_hz: float  # cycles a second over the steady frames; NaN if there is none
    phase: Floats  # (frames,) in cycles, rising, not wrapped; whole numbers are key frame 1
    steady: Mask  # (frames,) bool, where the motion repeats and the phase is valid
    # 0-1, share of the variance of a steady cycle that the others predict; 0 if too few
    confidence: float
    cycles: float  # number of steady cycles
    why: str  # why the motion is not periodic; empty if it is


def find_period(signal: Floats, frame_rate_hz: float, extreme: Floats | None = None) -> Period:
    """Return the frequency and phase of a repeating motion, from coordinates (frames, k).

    signal: NaN where missing. extreme (frames,): a signal that is greatest at phase 0, such as the
    tail's deflection; by default the strongest mode, signed so that its largest coordinate is
    positive. The search goes from one cycle in the film to _FASTEST. FinloopError if the signal is
    not (frames, k), has no complete row, or the rate is not positive. A motion that does not repeat
    is no error: see `Period.why` and `require_periodic`.
    """
    signal = np.asarray(signal, np.float64)
    _refuse_unusable_signal(signal, frame_rate_hz)
    complete_rows = np.asarray(np.isfinite(signal).all(axis=1))
    frames = len(signal)
    if frames < LEAST_FRAMES:
        return _no_period(frames, f"{frames} frames are too few, {LEAST_FRAMES} are needed")
    modes = _principal_modes(fill_gaps(np.where(complete_rows[:, None], signal, np.nan)))
    if not modes.size:
        return _no_period(frames, "nothing moves")
    phase, share = _trace_beat(modes, frame_rate_hz)
    may_be_steady = (share >= _STEADY) & complete_rows
    period = period_from_phase(modes, phase, may_be_steady, frame_rate_hz)
    if not period.cycles:
        return replace(period, why=_explain_missing_period(modes, share, period.why))
    if extreme is None:
        extreme = _signed_main_mode(modes, signal[complete_rows])
    return set_phase_zero(period, np.asarray(extreme, float))


def _refuse_unusable_signal(signal: Floats, frame_rate_hz: float) -> None:
    """Raise FinloopError unless a signal is (frames, k) with a complete row, and the rate > 0."""
    if signal.ndim != 2 or not np.isfinite(signal).all(axis=1).any():
        raise FinloopError(
            f"the motion is an array of shape {signal.shape} in which "
            f"{np.count_nonzero(~np.isfinite(signal))} values are no numbers",
            "an array (frames, k) of coordinates, with a frame in which all are numbers",
            "give a row of coordinates for each frame, with NaN where it shows nothing",
        )
    if not 0 < frame_rate_hz < np.inf:
        raise FinloopError(
            f"a frame rate of {frame_rate_hz:g} Hz", "a positive number", "pass the film's rate"
        )


def _signed_main_mode(modes: Floats, complete: Floats) -> Floats:
    """Return the strongest mode (frames,), signed so that its largest coordinate is positive.

    modes (frames, m): scores of the principal modes, whose signs are arbitrary; complete (c, k):
    the frames with all coordinates.
    """
    directions = np.linalg.svd(complete - complete.mean(axis=0), full_matrices=False)[2]
    main = directions[0]  # (k,) of the strongest mode
    return np.asarray(modes[:, 0] * np.sign(main[np.abs(main).argmax()]))


def period_from_phase(signal: Floats, phase: Floats, good: Mask, frame_rate_hz: float) -> Period:
    """Return the `Period` of a motion (frames, k) whose phase is known, and its confidence.

    phase (frames,): in cycles. good (frames,): where the motion may be steady; only runs of good
    frames that last a cycle or more are. If these hold less than _LEAST_CYCLES in all there is no
    period: `cycles` is 0, and `why` says so. If the confidence is low, `why` says that.
    """
    steady = _find_steady_runs(good, phase)
    inner = steady[1:] & steady[:-1]  # steps from one steady frame to the next
    cycles = float(np.diff(phase)[inner].sum())
    if cycles < _LEAST_CYCLES:
        return _no_period(
            len(phase), f"{cycles:.1f} cycles are steady, {_LEAST_CYCLES:g} are needed"
        )
    beat_alone = signal - remove_beat(signal, phase)
    confidence = _cross_validated_share(beat_alone, phase, steady)
    why = "" if confidence >= CONFIDENT else "no cycle is much like another"
    frequency = cycles / np.count_nonzero(inner) * frame_rate_hz
    return Period(float(frequency), phase, steady, confidence, cycles, why)


def set_phase_zero(period: Period, extreme: Floats) -> Period:
    """Return a period whose phase is a whole number where a signal (frames,) is greatest.

    extreme (frames,): the signal, of which only the sinusoid of the period counts.
    """
    frames = period.steady & np.isfinite(extreme)
    terms = _harmonic_terms(period.phase[frames], 1)
    _constant, cos, sin = np.linalg.lstsq(terms, extreme[frames], rcond=None)[0]
    phase = period.phase - np.arctan2(sin, cos) / (2 * np.pi)
    return replace(period, phase=phase - np.floor(phase.min()))  # 0 or more


def require_periodic(beat: Period, name: str) -> Period:
    """Return a period (`beat`) unchanged; FinloopError if the motion does not repeat.

    name: what moves, for the message.
    """
    if beat.why:
        raise FinloopError(
            f"the motion of {name} is not periodic: {beat.why} (confidence {beat.confidence:.2f},"
            f" {beat.cycles:.1f} steady cycles in {len(beat.phase)} frames)",
            f"confidence {CONFIDENT:g} or more over {_LEAST_CYCLES:g} cycles or more",
            "use a longer film, or the part in which the animal moves steadily",
        )
    return beat


def _no_period(frames: int, why: str) -> Period:
    """Return the `Period` of a motion that does not repeat, with the reason `why`."""
    none = np.zeros(frames)
    return Period(np.nan, phase=none, steady=none > 0, confidence=0.0, cycles=0.0, why=why)


def fill_gaps(signal: Floats) -> Floats:
    """Return a signal (frames, k) with NaN replaced by linear interpolation in each column.

    Before the first number, and after the last, that number is repeated. FinloopError if a column
    is all NaN.
    """
    time, filled = np.arange(len(signal)), signal.copy()
    for column in filled.T:  # views
        finite = np.isfinite(column)
        if not finite.any():
            raise FinloopError(
                "no frame shows one of the limbs",
                "each limb in at least half of the frames",
                "leave that limb out",
            )
        column[:] = np.interp(time, time[finite], column[finite])
    return filled


def _principal_modes(signal: Floats) -> Floats:
    """Return the scores (frames, m) of a signal's strongest principal components, in order.

    They hold _VARIANCE of the variance, but are at most _MODES; m is 0 if nothing moves.
    """
    centred = signal - signal.mean(axis=0)
    left, strength, _ = np.linalg.svd(centred, full_matrices=False)
    if strength[0] <= 1e-12 * max(1.0, np.abs(signal).max()):
        return np.zeros((len(signal), 0))
    variance = np.cumsum(strength**2) / (strength**2).sum()
    keep = min(_MODES, int(np.searchsorted(variance, _VARIANCE)) + 1)
    return left[:, :keep] * strength[:keep]


def _find_steady_runs(good: Mask, phase: Floats) -> Mask:
    """Return a mask (frames,) of the good frames in runs that last at least one cycle.

    good (frames,): frames that may be steady; phase (frames,): in cycles. A run ends where
    the phase does not rise.
    """
    good = good & np.r_[True, np.diff(phase) > 0]
    edges = np.flatnonzero(np.diff(np.r_[False, good, False].astype(np.int8)))
    result = np.zeros(len(good), bool)
    for start, stop in edges.reshape(-1, 2):
        result[start:stop] = phase[stop - 1] - phase[start] >= 1
    return result


def remove_beat(values: Floats, phase: Floats) -> Floats:
    """Return values (frames, k) without what repeats with a beat; turns and drift remain.

    phase (frames,): of the beat, in cycles. At every frame a straight line plus a sinusoid of the
    beat is fitted to the cycle and a half about it, or, near an end, to the first or the last cycle
    and a half. The line's value is kept.
    """
    smooth = np.empty_like(values)
    span = 2 * _HALF_WINDOW
    low, high = phase.min(), phase.max()
    for frame, moment in enumerate(phase):
        start = min(max(moment - _HALF_WINDOW, low), max(high - span, low))
        near = np.flatnonzero((phase >= start) & (phase <= start + span))
        turn = 2 * np.pi * phase[near]
        # Time counts from this frame, so the line's value there is the first factor.
        terms = np.stack([np.ones(len(near)), near - frame, np.cos(turn), np.sin(turn)], axis=1)
        smooth[frame] = np.linalg.lstsq(terms, values[near], rcond=None)[0][0]
    return smooth


def _harmonic_terms(phase: Floats, count: int) -> Floats:
    """Return a constant, and cosines and sines of a phase's harmonics: (frames, 1 + 2 count).

    phase (frames,): in cycles; count: number of harmonics.
    """
    angle = 2 * np.pi * phase[:, None] * np.arange(1, count + 1)
    return np.hstack([np.ones((len(phase), 1)), np.cos(angle), np.sin(angle)])


def _cross_validated_share(modes: Floats, phase: Floats, steady: Mask) -> float:
    """Return the share (0–1) of variance that the other cycles predict in each steady cycle.

    modes (frames, m): scores of the principal components; phase (frames,): in cycles; steady
    (frames,): which frames count.
    """
    y, moment = modes[steady], phase[steady]
    terms = _harmonic_terms(moment, _HARMONICS)
    cycle = np.floor(moment - moment[0]).astype(int)
    # Each cycle is predicted by a fit to all others.
    squared_error = 0.0
    for number in np.unique(cycle):
        held_out = cycle == number
        fit = np.linalg.lstsq(terms[~held_out], y[~held_out], rcond=None)[0]
        squared_error += float(((y[held_out] - terms[held_out] @ fit) ** 2).sum())
    total = float(((y - y.mean(axis=0)) ** 2).sum())
    return max(0.0, 1 - squared_error / total)


def _explain_missing_period(modes: Floats, share: Floats, why: str) -> str:
    """Return the best reason why a motion has too few steady cycles.

    modes (frames, m): scores of the principal modes; share (frames,): of the variance about each
    frame that a sinusoid explains, 0-1; why: which cycles are steady.
    """
    half_turn = np.pi * np.arange(len(modes)) / len(modes)
    strongest = modes[:, 0]
    # A motion one way, or there and back at most, is half a wave over the whole film. If this
    # explains 90 % of the strongest mode, the film holds less than a cycle.
    terms = np.stack([np.ones(len(modes)), np.cos(half_turn), np.sin(half_turn)], axis=1)
    residual = strongest - terms @ np.linalg.lstsq(terms, strongest, rcond=None)[0]
    if residual @ residual < 0.1 * (strongest @ strongest):
        return f"the {len(modes)} frames hold no more than about half a cycle"
    return f"at most in bursts: {why}" if share.max() >= _STEADY else "no frequency explains it"


# --- the frequency and phase of every frame


def _trace_beat(modes: Floats, frame_rate_hz: float) -> tuple[Floats, Floats]:
    """Return the phase (frames,) of a beat, in cycles, and the share of variance that it explains.

    The share (frames,) is that of the variance about each frame, 0-1. modes (frames, m): scores of
    the principal modes; frame_rate_hz: frames per second, which cancels but for rounding.
    """
    # Frequencies from one cycle in the film to _FASTEST, with steps of a constant ratio.
    frames = len(modes)
    slowest_hz, fastest_hz = frame_rate_hz / frames, _FASTEST * frame_rate_hz
    count = max(3, int(np.ceil(np.log(fastest_hz / slowest_hz) / np.log(_STEP))))
    grid = np.geomspace(slowest_hz, fastest_hz, count) / frame_rate_hz  # cycles a frame
    shares = np.stack([_fit_sinusoids(modes, frequency).share for frequency in grid])
    path = _best_frequency_path(shares, grid)
    phase = _phase_of_frequency_path(modes, shares, path, grid)
    return phase, shares[path, np.arange(frames)]


class _SinusoidFit(NamedTuple):
    """A sinusoid of one frequency, fitted to a window around every frame.

    share (frames,): of the variance in the window that it explains, 0-1; amplitude (frames, modes):
    complex, its angle is the phase in the middle of the window; offset (frames,): of the frame from
    that middle, in frames.
    """

    share: Floats
    amplitude: Complex
    offset: Floats


def _fit_sinusoids(modes: Floats, frequency: float) -> _SinusoidFit:
    """Return the sinusoid of `frequency` (cycles a frame) that fits the modes around each frame.

    modes (frames, m): scores of the principal modes. In a window about each frame, a straight line
    (a turn, a drift) and the sinusoid are fitted together; frames count less towards its ends. The
    first and last frames share the first and last whole window.
    """
    # The four terms in a window of n frames: a straight line, cosine and sine.
    frames = len(modes)
    n = min(frames, max(LEAST_FRAMES, round(_CYCLES / frequency)))
    t = np.arange(n) - (n - 1) / 2
    angle = 2 * np.pi * frequency * t
    weight = np.sin(np.pi * (np.arange(n) + 0.5) / n)
    terms = np.stack([np.ones(n), t / n, np.cos(angle), np.sin(angle)], axis=1)
    basis, upper = np.linalg.qr(terms * weight[:, None])  # orthonormal terms
    # How much of each term every window holds, (windows, modes, 4), by one convolution for all.
    kernels = (basis * weight[:, None])[::-1]
    projections = scipy.signal.fftconvolve(
        modes[:, :, None], kernels[:, None], mode="valid", axes=0
    )
    of_line, of_sinusoid = projections[..., :2], projections[..., 2:]
    # Sums of squares in each window: about the straight line, and what the sinusoid explains.
    squares = scipy.signal.fftconvolve((modes**2).sum(axis=1), weight[::-1] ** 2, mode="valid")
    about_line = np.maximum(squares - (of_line**2).sum(axis=(1, 2)), 0)
    explained = (of_sinusoid**2).sum(axis=(1, 2))
    # Less what noise alone would give: two of the n - 2 numbers that a line leaves.
    without_noise = explained - np.maximum(about_line - explained, 0) * 2 / (n - 4)
    # Added to the squares of a window, so that no beat is seen where the animal rests.
    least_squares = _QUIET * modes.var(axis=0).sum() * (weight**2).sum()
    # Back from orthonormal terms to the amplitudes of cosine and sine; then from windows to frames.
    cos, sin = np.moveaxis(of_sinusoid @ np.linalg.inv(upper[2:, 2:]).T, -1, 0)
    start = np.clip(np.arange(frames) - n // 2, 0, frames - n)
    offset = (np.arange(frames) - start - (n - 1) / 2).astype(np.float64)
    share: Floats = (np.maximum(without_noise, 0) / (about_line + least_squares))[start]
    return _SinusoidFit(share, (cos - 1j * sin)[start], offset)


def _best_frequency_path(share: Floats, grid: Floats) -> NDArray[np.intp]:
    """Return each frame's most likely frequency, as indices (frames,) in `grid`, by Viterbi.

    share (frequencies, frames): of the variance that each frequency explains, 0-1. The path has the
    greatest sum of shares less the costs of changes, by at most one index from frame to frame. A
    change costs more for a slow beat, as a beat changes little within a cycle. grid: the
    frequencies, cycles a frame.
    """
    count, frames = share.shape
    cost = _OCTAVE * np.log2(grid[1] / grid[0]) / grid  # of a change from each frequency
    best_sum = share[:, 0].copy()
    previous = np.zeros((frames, count), np.intp)
    for row in range(1, frames):
        from_below = np.r_[-np.inf, best_sum[:-1] - cost[:-1]]
        from_above = np.r_[best_sum[1:] - cost[1:], -np.inf]
        options = np.stack([from_below, best_sum, from_above])
        previous[row] = np.arange(count) + options.argmax(axis=0) - 1  # −1: the index below
        best_sum = options.max(axis=0) + share[:, row]
    # From the best end backwards.
    path = np.empty(frames, np.intp)
    path[-1] = best_sum.argmax()
    for row in range(frames - 1, 0, -1):
        path[row - 1] = previous[row, path[row]]
    return path


def _phase_of_frequency_path(
    modes: Floats, share: Floats, path: NDArray[np.intp], grid: Floats
) -> Floats:
    """Return the rising phase (frames,), in cycles, of the beat that all modes (frames, m) share.

    share (frequencies, frames): of the variance that each frequency explains, 0-1; grid: the
    frequencies, cycles a frame; path (frames,): index of each frame's frequency. The modes'
    amplitudes, turned from the middle of the window to the frame, are approximated by one pattern
    of modes times one complex number a frame. A wave runs through the modes in one direction, so
    the number's angle always rises.
    """
    frequency = _refine_frequencies(share, path, grid)
    amplitudes = np.empty(modes.shape, np.complex128)
    for index in np.unique(path):
        frames_there = path == index
        fit = _fit_sinusoids(modes, grid[index])
        turn = np.exp(2j * np.pi * frequency[frames_there] * fit.offset[frames_there])
        amplitudes[frames_there] = fit.amplitude[frames_there] * turn[:, None]
    # The pattern of modes that holds most of the amplitudes, and the angle of each frame along it.
    pattern = np.linalg.svd(amplitudes, full_matrices=False)[2][0]
    angle = np.angle(amplitudes @ pattern.conj()) / (2 * np.pi)
    # Unwrapped about the phase that the frequencies predict, so that every step has the right sign.
    predicted = np.concatenate([[0.0], np.cumsum((frequency[1:] + frequency[:-1]) / 2)])
    return predicted + np.unwrap(angle - predicted, period=1.0)


def _refine_frequencies(share: Floats, path: NDArray[np.intp], grid: Floats) -> Floats:
    """Return each frame's best frequency (frames,), found between the values of `grid`.

    It is in cycles a frame, as `grid` is, at the top of a parabola through three shares. share
    (frequencies, frames): of the variance that each frequency explains; path (frames,): indices.
    """
    frame = np.arange(len(path))
    middle = np.clip(path, 1, len(grid) - 2)
    low, centre, high = (share[middle + step, frame] for step in (-1, 0, 1))
    curvature = 2 * centre - low - high
    offset = np.divide(high - low, 2 * curvature, out=np.zeros(len(path)), where=curvature > 1e-12)
    return grid[middle] * (grid[1] / grid[0]) ** np.clip(offset, -1, 1)
