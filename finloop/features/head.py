"""Which end is the head, decided once for a whole track.

The paper locates head and tail and does not say how. Deciding frame by frame flips; so each frame
only gives evidence, and the most probable sequence of a two-state hidden Markov model decides
(Viterbi). State 0: the first backbone point is the head; state 1: the last one.

Evidence: the head is the blunt end, and fish swim forwards. Between frames, an end stays near where
it was: exchanging head and tail would mean a jump of a body length, and costs accordingly.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Reals

_BLUNT = 0.12  # relative difference in width between the halves that makes the odds e : 1
_FORWARD = 0.05  # body lengths of travel between frames that make the odds e : 1
_MOST = 2.0  # most that either cue may say about one frame, in log odds
_WANDER = 0.15  # body lengths that an end moves between frames, standard deviation
_CERTAIN = 1e6  # log odds; more than all evidence about a track
_MEMORY_S = 0.4  # frames nearer than this tell the same thing twice


def tail_first(lines: Reals, features: pd.DataFrame) -> Mask:
    """Which lines (rows, n, 2) px, beside a feature table, begin at the tail of their fish."""
    head = features[["head_x_px", "head_y_px"]].to_numpy(float)
    first, last = (np.linalg.norm(lines[:, end] - head, axis=1) for end in (0, -1))
    return last < first


def head_told(backbone: Reals, head: Reals, tail: Reals) -> NDArray[np.int8]:
    """Which end another program says is the head: 1 the first, −1 the last, 0 not told; (rows,).

    backbone: (rows, n, 2) px; head, tail: (rows, 2) px, NaN where not told.
    """
    ends = backbone[:, [0, -1]].astype(float)
    same, swapped = (
        sum(
            np.nan_to_num(np.linalg.norm(ends[:, end] - place, axis=1))
            for end, place in ((one, head), (1 - one, tail))
        )
        for one in (0, 1)
    )
    return np.sign(swapped - same).astype(np.int8)


def head_first(
    backbone: Reals, half_width: Reals, rate_hz: float, told: NDArray[np.int8] | None = None
) -> tuple[Mask, Floats]:
    """Whether the first point is the head, and how sure that is, for one track.

    backbone: (frames, n, 2) px, of consecutive frames, either end first.
    half_width: (frames, n) px, beside it.
    rate_hz: frames per second.
    told: (frames,) as `head_told` gives it; where it is not 0 it decides.

    Returns
    -------
    first : (frames,) bool; confidence : (frames,) probability in [0.5, 1] or below where the frame
    taken by itself would rather be the other way round than its track, or than it is told.
    """
    length = np.median(np.hypot(*np.diff(backbone, axis=1).transpose(2, 0, 1)).sum(1))
    evidence = _blunt(half_width) + _forward(backbone, length)
    evidence /= max(1.0, _MEMORY_S * rate_hz)
    same, swapped = _moves(backbone, length)
    emission = np.stack([evidence, -evidence], 1) / 2  # (frames, 2) log likelihoods
    said = emission if told is None else emission + _CERTAIN * told[:, None] * np.array([1, -1])
    first = _viterbi(said, same, swapped) == 0
    confidence = _posterior(emission, same, swapped)
    return first, np.where(first, confidence[:, 0], confidence[:, 1])


def _blunt(half_width: Reals) -> Floats:
    """Log odds (frames,) that the first point is the head, from the widths near both ends."""
    part = half_width.shape[1] * 3 // 8
    one, other = half_width[:, 1:part].mean(1), half_width[:, -part:-1].mean(1)
    return np.clip((one - other) / np.maximum(one + other, 1e-9) / _BLUNT, -_MOST, _MOST)


def _forward(backbone: Reals, length: float) -> Floats:
    """Log odds (frames,) that the first point is the head, from the travel around each frame."""
    if len(backbone) < 2:
        return np.zeros(len(backbone))
    middle = backbone.mean(1)
    travel = np.gradient(middle, axis=0)
    axis = backbone[:, 0] - backbone[:, -1]
    axis /= np.maximum(np.hypot(*axis.T), 1e-9)[:, None]
    return np.clip((travel * axis).sum(1) / length / _FORWARD, -_MOST, _MOST)


def _moves(backbone: Reals, length: float) -> tuple[Floats, Floats]:
    """Log probabilities (frames - 1,) of the step to the next frame: ends kept, ends exchanged."""
    ends = backbone[:, [0, -1]]
    kept = ((ends[1:] - ends[:-1]) ** 2).sum((1, 2))
    exchanged = ((ends[1:, ::-1] - ends[:-1]) ** 2).sum((1, 2))
    scale = 2 * (_WANDER * length) ** 2
    return -kept / scale, -exchanged / scale


def _viterbi(emission: Floats, same: Floats, swapped: Floats) -> NDArray[np.intp]:
    """Most probable state sequence (frames,) of the two-state chain."""
    frames = len(emission)
    back = np.zeros((frames, 2), np.intp)
    score = emission[0].copy()
    for t in range(1, frames):
        step = score[:, None] + np.array(
            [[same[t - 1], swapped[t - 1]], [swapped[t - 1], same[t - 1]]]
        )
        back[t] = step.argmax(0)
        score = step.max(0) + emission[t]
    states = np.empty(frames, np.intp)
    states[-1] = score.argmax()
    for t in range(frames - 1, 0, -1):
        states[t - 1] = back[t, states[t]]
    return states


def _posterior(emission: Floats, same: Floats, swapped: Floats) -> Floats:
    """Probability (frames, 2) of each state given the whole track (forward-backward)."""
    frames = len(emission)
    ahead, behind = emission.copy(), np.zeros_like(emission)
    for t in range(1, frames):
        keep, swap = same[t - 1], swapped[t - 1]
        ahead[t, 0] += np.logaddexp(ahead[t - 1, 0] + keep, ahead[t - 1, 1] + swap)
        ahead[t, 1] += np.logaddexp(ahead[t - 1, 1] + keep, ahead[t - 1, 0] + swap)
        ahead[t] -= ahead[t].max()
    for t in range(frames - 2, -1, -1):
        keep, swap = same[t], swapped[t]
        one, other = behind[t + 1] + emission[t + 1]
        behind[t] = np.logaddexp(one + keep, other + swap), np.logaddexp(one + swap, other + keep)
        behind[t] -= behind[t].max()
    odds = np.clip((ahead + behind) @ np.array([1.0, -1.0]), -700, 700)
    probability = 1 / (1 + np.exp(-odds))
    return np.stack([probability, 1 - probability], 1)
