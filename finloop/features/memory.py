"""The memory of an animal's posture: the film's own measure of time.

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
    """Return after how many frames an animal's posture is half forgotten.

    That is the lag τ at which the mean square of posture(t + τ) − posture(t) is half of that
    between any two postures, linear between whole frames; the longest track's length if it never
    is. postures: (n, k), any numbers; track (n,): the track of each row, in the order of frames.
    """
    values = np.asarray(postures, float)
    most = int(np.bincount(np.unique(track, return_inverse=True)[1]).max())
    half, before = _HALF * 2 * float(values.var(0).sum()), 0.0
    for lag in range(1, most if half > 0 else 1):
        same = track[lag:] == track[:-lag]
        square = float(((values[lag:] - values[:-lag]) ** 2).sum(1)[same].mean())
        if square >= half:
            return lag - 1 + (half - before) / max(square - before, 1e-12)
        before = square
    return float(most)


def held_out_block_frames(
    block_deltas: float, held_out_share: float, delta_frames: int, frames: Ints, least_frames: int
) -> int:
    """Return the length [frames] of the blocks of time that are held out to test a prediction.

    It is `block_deltas` times Δ (the time over which motion is measured, delta_frames), but at most
    the share `held_out_share` of the film, or `least_frames` if that is more. frames (n,): frame
    numbers of the rows.
    """
    film = int(np.ptp(frames)) + 1 if len(frames) else 1
    return min(
        max(1, round(block_deltas * delta_frames)), max(least_frames, int(held_out_share * film))
    )


def measure_delta_s(bends: Sequence[Reals], rate_hz: float) -> float:
    """Return Δ, the time [s] over which motion is measured, chosen for a film.

    Δ is the paper's, but at most three memories (`measure_memory_frames`), half a tail beat, so
    that quick motion is not smoothed away, and at most a quarter of the longest track. bends: the
    signed motion areas (n,) of each track; rate_hz: frames per second.
    """
    longest = max(len(bend) for bend in bends)
    track = np.repeat(np.arange(len(bends)), [len(bend) for bend in bends])
    memory = measure_memory_frames(np.concatenate(bends)[:, None], track)
    return min(_PAPER_DELTA_S, min(_MEMORIES * memory, longest / _PARTS) / rate_hz)
