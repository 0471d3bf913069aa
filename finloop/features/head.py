"""Which end is the head, decided once for a whole track.

The paper locates head and tail without saying how. A decision frame by frame flips; so each frame
only gives evidence, and the most probable sequence of a two-state hidden Markov model decides
(Viterbi). State 0: the first backbone point is the head; state 1: the last one.

Evidence: the head is the blunt end, and fish swim forwards. Between frames, an end stays near its
place: exchanging head and tail would be a jump of a body length, and costs accordingly.
"""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Reals

_BLUNT = 0.12  # relative difference in width between the halves that makes the odds e : 1
_FORWARD = 0.05  # body lengths of travel between frames that make the odds e : 1
_MOST = 2.0  # most log odds of either cue in one frame
_WANDER = 0.15  # body lengths that an end moves between frames, standard deviation
_MOST_ODDS = 700.0  # log odds whose exponential is still finite
_CERTAIN = 1e6  # log odds; more than all evidence about a track
_MEMORY_S = 0.4  # nearer frames repeat the same evidence


def begins_at_tail(lines: Reals, features: pd.DataFrame) -> Mask:
    """Return a mask (rows,) of the backbones (rows, n, 2) px whose first point is the tail.

    features: the same rows of a feature table, which has the places of the heads.
    """
    head = features[["head_x_px", "head_y_px"]].to_numpy(float)
    first, last = (np.linalg.norm(lines[:, end] - head, axis=1) for end in (0, -1))
    return last < first


def match_head_end(backbone: Reals, head: Reals, tail: Reals) -> NDArray[np.int8]:
    """Return which end of each backbone (rows, n, 2) px another tracking program calls the head.

    The result (rows,) is 1 for the first point, −1 for the last, 0 for unknown. head, tail: the
    program's points, (rows, 2) px, NaN where unknown.
    """
    ends = backbone[:, [0, -1]].astype(float)
    same, swapped = (
        sum(
            np.nan_to_num(np.linalg.norm(ends[:, end] - place, axis=1))
            for end, place in ((index, head), (1 - index, tail))
        )
        for index in (0, 1)
    )
    return np.sign(swapped - same).astype(np.int8)


def decide_head_end(
    backbone: Reals, half_width: Reals, rate_hz: float, given_head: NDArray[np.int8] | None = None
) -> tuple[Mask, Floats]:
    """Decide for each frame of a track whether the first backbone point is the head.

    Return the decisions (frames,) and their probabilities (frames,); below 0.5, the frame by itself
    speaks against the decision. backbone: (frames, n, 2) px, consecutive frames; half_width:
    (frames, n) px; rate_hz: frames per second; given_head: (frames,) from `match_head_end`, which
    decides where it is not 0.
    """
    length = np.median(np.hypot(*np.diff(backbone, axis=1).transpose(2, 0, 1)).sum(1))
    evidence = _width_evidence(half_width) + _travel_evidence(backbone, length)
    evidence /= max(1.0, _MEMORY_S * rate_hz)
    stay = _stay_odds(backbone, length).tolist()
    total = evidence if given_head is None else evidence + 2 * _CERTAIN * given_head
    first = _most_probable_states(total.tolist(), stay)
    probability = _state_probabilities(evidence.tolist(), stay)
    return first, np.where(first, probability, 1 - probability)


def _width_evidence(half_width: Reals) -> Floats:
    """Return log odds (frames,) that the first point is the head: the head is the wider end.

    half_width: (frames, n) px, along the backbone.
    """
    part = half_width.shape[1] * 3 // 8
    first, last = half_width[:, 1:part].mean(1), half_width[:, -part:-1].mean(1)
    return np.clip((first - last) / np.maximum(first + last, 1e-9) / _BLUNT, -_MOST, _MOST)


def _travel_evidence(backbone: Reals, length_px: float) -> Floats:
    """Return log odds (frames,) that the first point is the head: fish swim head first.

    backbone: (frames, n, 2) px; length_px: body length.
    """
    if len(backbone) < 2:
        return np.zeros(len(backbone))
    middle = backbone.mean(1)
    travel = np.gradient(middle, axis=0)
    axis = backbone[:, 0] - backbone[:, -1]
    axis /= np.maximum(np.hypot(*axis.T), 1e-9)[:, None]
    return np.clip((travel * axis).sum(1) / length_px / _FORWARD, -_MOST, _MOST)


def _stay_odds(backbone: Reals, length_px: float) -> Floats:
    """Return log odds (frames − 1,) that both ends stay near their places rather than swap.

    backbone: (frames, n, 2) px; length_px: body length.
    """
    ends = backbone[:, [0, -1]]
    same = ((ends[1:] - ends[:-1]) ** 2).sum((1, 2))
    exchanged = ((ends[1:, ::-1] - ends[:-1]) ** 2).sum((1, 2))
    return (exchanged - same) / (2 * (_WANDER * length_px) ** 2)


def _most_probable_states(evidence: list[float], stay_odds: list[float]) -> Mask:
    """Return whether the first point is the head, for each frame (frames,), by Viterbi's algorithm.

    evidence: (frames,) log odds of each frame by itself; stay_odds: (frames − 1,) log odds that the
    ends do not swap in a step. Plain numbers are twenty times as fast here as arrays of two states.
    """
    from_first = []  # of each step, for state 0 and 1: whether state 0 is the better one before
    odds = evidence[0]
    for own, stay in zip(evidence[1:], stay_odds, strict=True):
        from_first.append((odds + stay >= 0, odds - stay >= 0))
        odds = own + 0.5 * (abs(odds + stay) - abs(odds - stay))
    states = [odds >= 0]
    for to_first, to_last in reversed(from_first):
        states.append(to_first if states[-1] else to_last)
    return np.array(states[::-1])


def _state_probabilities(evidence: list[float], stay_odds: list[float]) -> Floats:
    """Return the probability (frames,) that the first point is the head, given the whole track.

    evidence, stay_odds: as in `_most_probable_states`. It is the forward-backward algorithm.
    """
    ahead, behind = evidence[:1], [0.0]
    for own, stay in zip(evidence[1:], stay_odds, strict=True):
        ahead.append(own + _odds_from_neighbour(ahead[-1], stay))
    for own, stay in zip(evidence[:0:-1], reversed(stay_odds), strict=True):
        behind.append(_odds_from_neighbour(behind[-1] + own, stay))
    odds = np.array(ahead) + behind[::-1]
    return 1 / (1 + np.exp(np.clip(-odds, -_MOST_ODDS, _MOST_ODDS)))


def _odds_from_neighbour(odds: float, stay: float) -> float:
    """Return the log odds that the first point is the head, judged by a neighbouring frame alone.

    odds: log odds of that frame; stay: log odds that the ends do not swap in between. The result is
    log((e^(odds + stay) + 1) / (e^odds + e^stay)), written so that nothing overflows.
    """
    both, either = abs(odds + stay), abs(odds - stay)
    return 0.5 * (both - either) + math.log1p(math.exp(-both)) - math.log1p(math.exp(-either))
