"""Decide which end of a backbone is the head, once for a whole track.

The paper locates head and tail without saying how. A decision frame by frame flips; so each frame
only gives evidence, and the most probable sequence of a two-state hidden Markov model decides
(Viterbi). State 0: the first backbone point is the head; state 1: the last one.

Evidence: the head is the blunt end, and fish swim forwards. Of other animals the thin end may lead:
which end does is learned from all tracks of the film. Between frames, an end stays near its place:
exchanging head and tail would be a jump of a body length, and costs accordingly.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Reals
from finloop.features.settings import HeadRule

_BLUNT = 0.12  # relative difference in width between the halves that makes the odds e : 1
_FORWARD = 0.05  # body lengths of travel between frames that make the odds e : 1
_MOST = 2.0  # most log odds of either cue in one frame
_WANDER = 0.15  # body lengths that an end moves between frames, standard deviation
_MOST_ODDS = 700.0  # log odds whose exponential is still finite
_CERTAIN = 1e6  # log odds; more than all evidence about a track
_MEMORY_S = 0.4  # nearer frames repeat the same evidence
# The thin end leads in a film where the products of both cues' log odds sum to less than minus
# this. A frame that repeats no other adds at most 2 · 2.
_AGAINST_BLUNT = 3.0


class HeadCues(NamedTuple):
    """The cues that show which end of an animal is its head."""

    width: int = 1  # 1: the head is the blunt end; −1: the thin end; 0: the width is not used
    travel: bool = True  # whether animals are taken to move head first


FISH_CUES = HeadCues()
"""A fish swims blunt end first."""


def choose_head_cues(
    rule: HeadRule, backbone: Reals, half_width: Reals, tracks: Sequence[slice], rate_hz: float
) -> HeadCues:
    """Return the cues that show the head in a film: the wider or thinner end, travel, or both.

    rule: "travel", "blunt" or "thin" uses only that cue. "auto" uses travel, and as the head's end
    the one that leads in the film, blunt or thin; where little moves, the blunt end, as of a fish.
    backbone: (rows, n, 2) px; half_width: (rows, n) px; tracks: the rows of each track;
    rate_hz: frames per second.
    """
    # width: 1 the blunt end is the head, −1 the thin one, 0 the width says nothing.
    if rule == "travel":
        return HeadCues(width=0)
    if rule != "auto":
        return HeadCues(width=1 if rule == "blunt" else -1, travel=False)
    agreement = 0.0  # of both cues; negative if the thin end leads
    for rows in tracks:
        travel = _travel_evidence(backbone[rows], _median_length(backbone[rows]))
        agreement += float((travel * _width_evidence(half_width[rows])).sum())
    # Frames that repeat one another count as one.
    thin_end_leads = agreement / max(1.0, _MEMORY_S * rate_hz) < -_AGAINST_BLUNT
    return HeadCues(width=-1 if thin_end_leads else 1)


def begins_at_tail(lines: Reals, features: pd.DataFrame) -> Mask:
    """Return a mask (rows,) of backbones (rows, n, 2) px whose first point is the tail.

    features: the same rows of a feature table, which has the places of the heads.
    """
    head = features[["head_x_px", "head_y_px"]].to_numpy(float)
    first, last = (np.linalg.norm(lines[:, end] - head, axis=1) for end in (0, -1))
    return last < first


def turn_head_first(lines: Reals, features: pd.DataFrame) -> NDArray[Any]:
    """Return backbones (rows, n, 2) px reordered so that each begins at the head.

    features: the same rows of a feature table, which has the places of the heads.
    """
    return np.where(begins_at_tail(lines, features)[:, None, None], lines[:, ::-1], lines)


def match_head_end(backbone: Reals, head: Reals, tail: Reals) -> NDArray[np.int8]:
    """Return which end of each backbone (rows, n, 2) px another program calls the head.

    The result (rows,) is 1 for the first point, −1 for the last, 0 for unknown. head, tail: the
    program's points, (rows, 2) px, NaN where unknown; the nearer end of the backbone is meant.
    """

    def distance(end: int, place: Reals) -> Floats:
        """Return the distance (rows,) [px] of an end of each backbone from a point, or 0."""
        return np.nan_to_num(np.linalg.norm(backbone[:, end].astype(float) - place, axis=1))

    head_first = distance(0, head) + distance(-1, tail)
    head_last = distance(-1, head) + distance(0, tail)
    return np.sign(head_last - head_first).astype(np.int8)


def decide_head_end(
    backbone: Reals, half_width: Reals, rate_hz: float, given_head: NDArray[np.int8] | None = None,
    cues: HeadCues = FISH_CUES,
) -> tuple[Mask, Floats]:  # fmt: skip
    """Return whether the first backbone point is the head in each frame, and how probably.

    Return the decisions (frames,) and their probabilities (frames,). These are judged by the film
    alone: below 0.5, it speaks against the decision of another program. backbone: (frames, n, 2)
    px, consecutive frames; half_width: (frames, n) px, of the body along the backbone; rate_hz:
    frames per second; given_head (frames,): which end another program calls the head, 1 the first,
    −1 the last, 0 unknown; it decides where it is known. cues: what tells the head in this film.
    """
    length = _median_length(backbone)
    # Log odds that the first point is the head. cues.width: −1 where the head is the thin end.
    evidence = cues.width * _width_evidence(half_width)
    if cues.travel:
        evidence = evidence + _travel_evidence(backbone, length)
    evidence /= max(1.0, _MEMORY_S * rate_hz)  # frames that repeat one another count as one
    stay_odds = _stay_odds(backbone, length).tolist()
    all_evidence = evidence if given_head is None else evidence + 2 * _CERTAIN * given_head
    head_first = _most_probable_states(all_evidence.tolist(), stay_odds)
    probability = _state_probabilities(evidence.tolist(), stay_odds)
    return head_first, np.where(head_first, probability, 1 - probability)


def _median_length(backbone: Reals) -> float:
    """Return the median length, px, of the backbones (frames, n, 2) px of a track."""
    return float(np.median(np.hypot(*np.diff(backbone, axis=1).transpose(2, 0, 1)).sum(1)))


def _width_evidence(half_width: Reals) -> Floats:
    """Return log odds (frames,) that the first point is the head, because that end is wider.

    half_width: (frames, n) px, along the backbone. The 3/8 of the body at either end are compared,
    without the outermost point.
    """
    points = half_width.shape[1] * 3 // 8
    first, last = half_width[:, 1:points].mean(1), half_width[:, -points:-1].mean(1)
    difference = (first - last) / np.maximum(first + last, 1e-9)
    return np.clip(difference / _BLUNT, -_MOST, _MOST)


def _travel_evidence(backbone: Reals, length_px: float) -> Floats:
    """Return log odds (frames,) that the first point is the head, because it travels first.

    backbone: (frames, n, 2) px; length_px: body length. A single frame gives 0.
    """
    if len(backbone) < 2:
        return np.zeros(len(backbone))
    travel_px = np.gradient(backbone.mean(1), axis=0)  # per frame, of the backbone's middle
    axis = backbone[:, 0] - backbone[:, -1]
    axis /= np.maximum(np.hypot(*axis.T), 1e-9)[:, None]
    travel_to_first_px = (travel_px * axis).sum(1)
    return np.clip(travel_to_first_px / length_px / _FORWARD, -_MOST, _MOST)


def _stay_odds(backbone: Reals, length_px: float) -> Floats:
    """Return log odds (frames − 1,) that the first point stays at the same end of the animal.

    An end moves little in a frame: its move is Gaussian with the standard deviation `_WANDER`, and
    the result is the difference of both cases' log probabilities. backbone: (frames, n, 2) px;
    length_px: body length.
    """
    ends = backbone[:, [0, -1]]
    square_if_same = ((ends[1:] - ends[:-1]) ** 2).sum((1, 2))
    square_if_swapped = ((ends[1:, ::-1] - ends[:-1]) ** 2).sum((1, 2))
    return (square_if_swapped - square_if_same) / (2 * (_WANDER * length_px) ** 2)


def _most_probable_states(evidence: list[float], stay_odds: list[float]) -> Mask:
    """Return whether the first point is the head, for each frame (frames,), by Viterbi.

    evidence: (frames,) log odds of each frame by itself; stay_odds: (frames − 1,) log odds that the
    ends do not swap in a step. Plain numbers are twenty times as fast here as arrays of two states.
    """
    # Forwards: `odds` are those of the best sequence that ends with the first point as the head, to
    # the best that ends otherwise: the frame's own, and max(odds + stay, 0) − max(odds, stay), that
    # is (|odds + stay| − |odds − stay|) / 2.
    # Whether it was the head a frame ago, if it is now, and if it is not.
    before_head, before_tail = [], []
    odds = evidence[0]
    for frame_odds, stay in zip(evidence[1:], stay_odds, strict=True):
        before_head.append(odds + stay >= 0)
        before_tail.append(odds - stay >= 0)
        odds = frame_odds + 0.5 * (abs(odds + stay) - abs(odds - stay))
    # Backwards: from the better last state, follow what was best before it.
    states = [odds >= 0]
    for if_head, if_tail in zip(reversed(before_head), reversed(before_tail), strict=True):
        states.append(if_head if states[-1] else if_tail)
    return np.array(states[::-1])


def _state_probabilities(evidence: list[float], stay_odds: list[float]) -> Floats:
    """Return the probability (frames,) that the first point is the head, given the whole track.

    This is the forward-backward algorithm. evidence: (frames,) log odds of each frame by itself;
    stay_odds: (frames − 1,) log odds that the ends do not swap in a step.
    """
    from_past, from_future = evidence[:1], [0.0]  # log odds; a frame's own count in `from_past`
    for frame_odds, stay in zip(evidence[1:], stay_odds, strict=True):
        from_past.append(frame_odds + _odds_from_neighbour(from_past[-1], stay))
    for frame_odds, stay in zip(evidence[:0:-1], reversed(stay_odds), strict=True):
        from_future.append(_odds_from_neighbour(from_future[-1] + frame_odds, stay))
    odds = np.array(from_past) + from_future[::-1]
    return 1 / (1 + np.exp(np.clip(-odds, -_MOST_ODDS, _MOST_ODDS)))


def _odds_from_neighbour(odds: float, stay: float) -> float:
    """Return the log odds that the first point is the head, judged by a neighbouring frame alone.

    odds: log odds of that frame; stay: log odds that the ends do not swap in between. The result is
    log((e^(odds + stay) + 1) / (e^odds + e^stay)), written so that nothing overflows.
    """
    total, difference = abs(odds + stay), abs(odds - stay)
    rest = math.log1p(math.exp(-total)) - math.log1p(math.exp(-difference))
    return 0.5 * (total - difference) + rest
