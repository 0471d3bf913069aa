"""Classify the swimming type: straight, turning left or right (§2.3, §3.2, Fig. 7b).

The paper gives no rule. A turning fish is bent and changes its heading, both to the same side; a
tail beat also bends it, and a drift also changes its heading. So both count, in units of their
thresholds, and the mean of the two decides with hysteresis.

Animals differ in how fast they turn and how far they bend, so thresholds of one would find no turn
of another. They are measured in the film, unless they are given.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import skimage
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Reals

STRAIGHT, LEFT, RIGHT = 0, 1, -1
WORDS = {STRAIGHT: "straight", LEFT: "left", RIGHT: "right"}

_SELDOM = 0.9  # quantile of a film's frames; turns start above it, and may continue below
# Degrees within a track. Measured: fish that keep one heading 4-8, others 250 and more.
_TURNS_DEG = 45.0


class TurnThresholds(NamedTuple):
    """The change of heading and the bend that each make a turn; `turn_score` combines them."""

    turn_deg: float  # change of heading over Δ, the time over which motion is measured
    bend: float  # signed motion area, body length²


BRISK = TurnThresholds(16.0, 0.04)
"""Thresholds of a brisk fish: zebrafish, and the drawn carp, whose turns are known."""


def measure_turn_thresholds(
    headings_deg: Sequence[Reals], bends: Sequence[Reals], delta_frames: int
) -> TurnThresholds:
    """Return the change of heading and the bend that make a turn, measured in a film.

    headings_deg, bends: of each track (n,), degrees and signed body length²; delta_frames: time Δ
    over which headings change. The thresholds are `BRISK`, lowered for a slower or stiffer fish
    until a tenth of the frames count as turns. If no track turns by 45° in all, they are not
    lowered, or tail beats would count as turns.
    """
    ranges = [np.ptp(np.unwrap(np.asarray(heading), period=360)) for heading in headings_deg]
    if max(ranges) < _TURNS_DEG:
        return BRISK
    turns = np.concatenate([heading_change(heading, delta_frames) for heading in headings_deg])
    bend = np.concatenate(list(bends))
    limits = TurnThresholds(
        min(BRISK.turn_deg, _upper_tenth(turns)), min(BRISK.bend, _upper_tenth(bend))
    )
    # The score is 1 at a turn; halving both thresholds doubles it.
    factor = min(1.0, _upper_tenth(turn_score(turns, bend, limits)))
    return TurnThresholds(factor * limits.turn_deg, factor * limits.bend)


def _upper_tenth(values: Reals) -> float:
    """Return the limit that a tenth of the values (n,) exceed in absolute value."""
    return max(float(np.quantile(np.abs(values), _SELDOM)), 1e-9)


def turn_score(turn_deg: Reals, bend: Reals, thresholds: TurnThresholds) -> Floats:
    """Return the turn score of frames (n,): a left turn from 1 on, a right turn from −1 down.

    It is the mean of two ratios: change of heading to its threshold, and bend to its threshold.
    turn_deg (n,): change of heading over the time Δ; bend (n,): signed, body length².
    """
    return 0.5 * (turn_deg / thresholds.turn_deg + bend / thresholds.bend)


def heading_change(heading_deg: Reals, span_frames: int) -> Floats:
    """Return the change of heading (frames,) [°] over a time around each frame, + = left.

    heading_deg: (frames,) of one track; span_frames: length of the span. At the ends of the track
    the span is shorter, and the change is scaled up.
    """
    heading = np.unwrap(np.asarray(heading_deg, float), period=360)
    last = len(heading) - 1
    frame = np.arange(len(heading))
    before = np.clip(frame - span_frames // 2, 0, max(last - 1, 0))
    after = np.clip(frame - span_frames // 2 + span_frames, 0, last)
    return (heading[after] - heading[before]) * span_frames / np.maximum(after - before, 1)


def classify_swimming_types(
    turn_deg: Reals, bend: Reals, thresholds: TurnThresholds, end_score: float
) -> NDArray[np.int8]:
    """Return the swimming type (frames,) of consecutive frames: 0 straight, 1 left, −1 right.

    turn_deg (frames,): change of heading over the time Δ; bend (frames,): signed, body length². A
    turn is a run of frames whose `turn_score` exceeds `end_score` and somewhere reaches 1.
    """
    scores = turn_score(turn_deg, bend, thresholds)
    left = skimage.filters.apply_hysteresis_threshold(scores, end_score, 1.0)
    right = skimage.filters.apply_hysteresis_threshold(-scores, end_score, 1.0)
    return (LEFT * left + RIGHT * right).astype(np.int8)
