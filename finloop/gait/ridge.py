"""The frequency and phase of every frame of a motion that repeats (for curve paper §4.2).

For every frequency a sinusoid and a straight line are fitted to a window of two cycles about every
frame (harmonic least squares); the best path of frequencies through the frames is found (Viterbi),
and the phase of all modes along it.

Glossary: *share* the part of the variance in a window that its sinusoid explains, 0-1; *ridge* the
path of frequencies over the frames.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Complex, Floats

LEAST_FRAMES = 8  # in a window: four numbers are fitted to it

_STEP = 1.04  # from one frequency to the next
_CYCLES = 2.0  # in a window
_QUIET = 0.1  # of the whole motion's variance: what stays below in a window is rest, not a beat
_OCTAVE = 0.5  # cost of a change of frequency by an octave within a cycle, in shares


def grid_of(low: float, high: float) -> Floats:
    """Frequencies from `low` to `high` in even ratios; a window of each is `_CYCLES` long."""
    return np.geomspace(low, high, max(3, int(np.ceil(np.log(high / low) / np.log(_STEP)))))


def _windows(modes: Floats, frequency: float) -> tuple[Floats, Complex, Floats]:
    """A sinusoid of `frequency` (cycles a frame) in a window about every frame.

    Beside a straight line (a turn, a drift), by least squares with a sine-shaped weight. The first
    and last frames share the first and last whole window.

    Returns
    -------
    share : explained, (frames,); amplitude : in the middle of the window, (frames, modes);
    apart : of the frame from that middle, (frames,)
    """
    frames = len(modes)
    n = min(frames, max(LEAST_FRAMES, round(_CYCLES / frequency)))
    t = np.arange(n) - (n - 1) / 2
    angle = 2 * np.pi * frequency * t
    weight = np.sin(np.pi * (np.arange(n) + 0.5) / n)
    terms = np.stack([np.ones(n), t / n, np.cos(angle), np.sin(angle)], axis=1)
    basis, upper = np.linalg.qr(terms * weight[:, None])
    kernels = (basis * weight[:, None])[::-1]
    along = scipy.signal.fftconvolve(modes[:, :, None], kernels[:, None], mode="valid", axes=0)
    total = scipy.signal.fftconvolve((modes**2).sum(axis=1), weight[::-1] ** 2, mode="valid")
    total = np.maximum(total - (along[..., :2] ** 2).sum(axis=(1, 2)), 0)
    explained = (along[..., 2:] ** 2).sum(axis=(1, 2))
    # What noise alone would give is taken off: two of the n - 2 numbers that a line leaves.
    fair = explained - np.maximum(total - explained, 0) * 2 / (n - 4)
    rest = _QUIET * modes.var(axis=0).sum() * (weight**2).sum()
    cos, sin = np.moveaxis(along[..., 2:] @ np.linalg.inv(upper[2:, 2:]).T, -1, 0)
    start = np.clip(np.arange(frames) - n // 2, 0, frames - n)
    apart = (np.arange(frames) - start - (n - 1) / 2).astype(np.float64)
    share: Floats = (np.maximum(fair, 0) / (total + rest))[start]
    return share, (cos - 1j * sin)[start], apart


def shares(modes: Floats, grid: Floats) -> Floats:
    """Share explained (frequencies, frames) by each frequency of `grid` about every frame."""
    return np.stack([_windows(modes, frequency)[0] for frequency in grid])


def ridge(share: Floats, grid: Floats) -> NDArray[np.intp]:
    """The frequency (frames,) of every frame, as places in `grid`: greatest sum of shares.

    From one frame to the next a place may move by one; a move costs the more the slower the beat,
    as a beat is not expected to change by much within a cycle.
    """
    count, frames = share.shape
    cost = _OCTAVE * np.log2(grid[1] / grid[0]) / grid  # cycles a frame: slow beats move seldom
    best = share[:, 0].copy()
    came = np.zeros((frames, count), np.intp)
    for t in range(1, frames):
        options = np.stack(
            [np.r_[-np.inf, best[:-1] - cost[:-1]], best, np.r_[best[1:] - cost[1:], -np.inf]]
        )
        move = options.argmax(axis=0)
        came[t] = np.arange(count) + move - 1
        best = np.take_along_axis(options, move[None], axis=0)[0] + share[:, t]
    path = np.empty(frames, np.intp)
    path[-1] = best.argmax()
    for t in range(frames - 1, 0, -1):
        path[t - 1] = came[t, path[t]]
    return path


def _peak(share: Floats, path: NDArray[np.intp], grid: Floats) -> Floats:
    """Frequency (frames,) of the greatest share near the ridge, between the places of the grid."""
    frame = np.arange(len(path))
    middle = np.clip(path, 1, len(grid) - 2)
    low, here, high = (share[middle + step, frame] for step in (-1, 0, 1))
    bow = 2 * here - low - high
    off = np.divide(high - low, 2 * bow, out=np.zeros(len(path)), where=bow > 1e-12)
    return grid[middle] * (grid[1] / grid[0]) ** np.clip(off, -1, 1)


def phase_along(modes: Floats, share: Floats, path: NDArray[np.intp], grid: Floats) -> Floats:
    """Phase (frames,) in cycles that all modes have in common, along the ridge `path`.

    Of the amplitudes (frames, modes), turned on from the middle of the window to the frame, the
    best product of one pattern of modes and one complex number a frame: a wave runs through the
    modes in one direction, so its angle always rises.
    """
    frequency = _peak(share, path, grid)
    amplitudes = np.empty(modes.shape, np.complex128)
    for place in np.unique(path):
        here = path == place
        _, amplitude, apart = _windows(modes, grid[place])
        turn = np.exp(2j * np.pi * frequency[here] * apart[here])
        amplitudes[here] = amplitude[here] * turn[:, None]
    pattern = np.linalg.svd(amplitudes, full_matrices=False)[2][0]
    angle = np.angle(amplitudes @ pattern.conj()) / (2 * np.pi)
    # Unwrapped about the phase that the frequencies predict, so that every step has the right sign.
    predicted = np.concatenate([[0.0], np.cumsum((frequency[1:] + frequency[:-1]) / 2)])
    return predicted + np.unwrap(angle - predicted, period=1.0)
