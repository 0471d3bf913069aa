"""The frequency and phase of every frame of a motion that repeats (for curve paper §4.2).

For every frequency a sinusoid and a straight line are fitted to a window of two cycles about every
frame (harmonic least squares). Viterbi's algorithm finds the best path of frequencies through the
frames, and the modes give the phase along it.

Glossary: *share* the part of the variance in a window that its sinusoid explains, 0-1; *ridge* the
path of frequencies over the frames.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Complex, Floats

LEAST_FRAMES = 8  # least frames of a window: the fit has four numbers

_STEP = 1.04  # ratio of neighbouring frequencies
_CYCLES = 2.0  # cycles in a window
_QUIET = 0.1  # share of the whole variance: a window with less shows rest, not a beat
_OCTAVE = 0.5  # cost, in shares, of a change of frequency by an octave within a cycle


def grid_of(low: float, high: float) -> Floats:
    """Return the frequencies from `low` to `high`, evenly spaced on a logarithmic scale.

    Neighbours differ by about 4 % or less; the unit is that of the bounds.
    """
    return np.geomspace(low, high, max(3, int(np.ceil(np.log(high / low) / np.log(_STEP)))))


def _windows(modes: Floats, frequency: float) -> tuple[Floats, Complex, Floats]:
    """Fit a sinusoid of `frequency` (cycles a frame) in a window about every frame.

    Least squares with a sine-shaped weight, together with a straight line (a turn, a drift). The
    first and last frames share the first and last whole window.

    Returns
    -------
    share : explained share (frames,); amplitude : in the middle of the window, (frames, modes);
    apart : distance of the frame from that middle, (frames,)
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
    # Subtract what noise alone would give: two of the n - 2 numbers that a line leaves.
    fair = explained - np.maximum(total - explained, 0) * 2 / (n - 4)
    rest = _QUIET * modes.var(axis=0).sum() * (weight**2).sum()
    cos, sin = np.moveaxis(along[..., 2:] @ np.linalg.inv(upper[2:, 2:]).T, -1, 0)
    start = np.clip(np.arange(frames) - n // 2, 0, frames - n)
    apart = (np.arange(frames) - start - (n - 1) / 2).astype(np.float64)
    share: Floats = (np.maximum(fair, 0) / (total + rest))[start]
    return share, (cos - 1j * sin)[start], apart


def shares(modes: Floats, grid: Floats) -> Floats:
    """Return how well each frequency explains the motion about each frame: (frequencies, frames).

    modes (frames, m): the motion; grid: frequencies in cycles a frame. The values are shares of the
    variance in a window, 0-1.
    """
    return np.stack([_windows(modes, frequency)[0] for frequency in grid])


def ridge(share: Floats, grid: Floats) -> NDArray[np.intp]:
    """Return the best frequency of every frame: indices (frames,) in `grid`, a smooth path.

    share: of `shares`; grid: frequencies in cycles a frame. The path has the greatest sum of
    shares. From one frame to the next an index changes by at most one. A change costs more for a
    slow beat, as a beat changes little within a cycle.
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
    """Return the frequency (frames,) of the greatest share near the ridge, interpolated."""
    frame = np.arange(len(path))
    middle = np.clip(path, 1, len(grid) - 2)
    low, here, high = (share[middle + step, frame] for step in (-1, 0, 1))
    bow = 2 * here - low - high
    off = np.divide(high - low, 2 * bow, out=np.zeros(len(path)), where=bow > 1e-12)
    return grid[middle] * (grid[1] / grid[0]) ** np.clip(off, -1, 1)


def phase_along(modes: Floats, share: Floats, path: NDArray[np.intp], grid: Floats) -> Floats:
    """Return the common phase (frames,) of all modes (frames, m), in cycles, not wrapped.

    share, path: of `shares` and `ridge`; grid: frequencies in cycles a frame. The amplitudes
    (frames, m), turned from the middle of the window to the frame, are approximated by one pattern
    of modes times one complex number a frame. A wave runs through the modes in one direction, so
    the number's angle always rises.
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
