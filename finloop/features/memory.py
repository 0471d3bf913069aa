"""Measure how long an animal's posture is remembered: the film's own measure of time.

Glossary: the *memory* of a film is the time after which a posture is half as far from itself as
from any other; Δ the time over which motion is measured (the paper: 5 frames at 25 Hz); *bend* the
signed motion area.
"""

from collections.abc import Sequence

import numpy as np

from finloop.base.arrays import Ints, Reals

_PAPER_DELTA_S = 0.2
_HALF = 0.5  # share of the mean square between any two postures at which a posture is forgotten
_MEMORIES = 3.0  # memories in Δ: half a beat, as a sine is forgotten after a sixth of its period
_PARTS = 4  # least Δ in the longest track: the last one has no motion, and blocks need some


def measure_memory_frames(postures: Reals, track: Ints) -> float:
    """Return the lag [frames] after which an animal's posture is half forgotten.

    At this lag τ, the mean square of posture(t + τ) − posture(t) is half of that between any two
    postures; between whole frames it is interpolated linearly. If it stays below half, the result
    is the longest track's length. postures (n, k): k numbers that describe a posture; track (n,):
    the track of each row, in the order of frames.
    """
    values = np.asarray(postures, float)
    longest = int(np.bincount(np.unique(track, return_inverse=True)[1]).max())
    half_square = _HALF * 2 * float(values.var(0).sum())  # two values differ by 2 variances
    if not half_square:
        return float(longest)
    previous_square = 0.0
    for lag in range(1, longest):
        same_track = track[lag:] == track[:-lag]
        square = float(((values[lag:] - values[:-lag]) ** 2).sum(1)[same_track].mean())
        if square >= half_square:
            share = (half_square - previous_square) / max(square - previous_square, 1e-12)
            return lag - 1 + share
        previous_square = square
    return float(longest)


def held_out_block_frames(
    block_deltas: float, held_out_share: float, delta_frames: int, frames: Ints, least_frames: int
) -> int:
    """Return the length [frames] of blocks of time that are held out for a test.

    It is `block_deltas` times `delta_frames` (Δ, the time over which motion is measured), but at
    most the share `held_out_share` of the film, or `least_frames` if that is more. frames (n,):
    frame numbers of the rows.
    """
    film_frames = int(np.ptp(frames)) + 1 if len(frames) else 1
    wanted = max(1, round(block_deltas * delta_frames))
    return min(wanted, max(least_frames, int(held_out_share * film_frames)))


def measure_delta_s(bends: Sequence[Reals], rate_hz: float) -> float:
    """Return Δ [s], the time over which motion is measured, chosen for a film.

    It is the paper's 0.2 s, but at most half a tail beat, taken as three times the memory of a
    posture (`measure_memory_frames`), and at most a quarter of the longest track. bends: the signed
    motion areas (n,) of each track; rate_hz: frames per second.
    """
    lengths = [len(bend) for bend in bends]
    track = np.repeat(np.arange(len(bends)), lengths)
    memory_frames = measure_memory_frames(np.concatenate(bends)[:, None], track)
    most_frames = min(_MEMORIES * memory_frames, max(lengths) / _PARTS)
    return min(_PAPER_DELTA_S, most_frames / rate_hz)
