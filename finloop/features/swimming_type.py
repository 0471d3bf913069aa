"""Swimming type: straight, turning left, turning right (fish paper §2.3, §3.2, Fig. 7b).

The paper gives no rule. A turning fish is bent and changes its heading, both to the same side; a
tail beat bends it as well, and a drift changes its heading as well. So both count, in units of
their thresholds, and the mean of the two decides with hysteresis.
"""

import numpy as np
import skimage
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Reals

STRAIGHT, LEFT, RIGHT = 0, 1, -1
WORDS = {STRAIGHT: "straight", LEFT: "left", RIGHT: "right"}


def turn(heading_deg: Reals, span: int) -> Floats:
    """Change of heading (frames,) in degrees over `span` frames centred on each frame, + = left.

    Near the ends of a track, where the span does not fit, it is shortened and the change scaled up.
    """
    heading = np.unwrap(np.asarray(heading_deg, float), period=360)
    last = len(heading) - 1
    frame = np.arange(len(heading))
    before = np.clip(frame - span // 2, 0, max(last - 1, 0))
    after = np.clip(frame - span // 2 + span, 0, last)
    return (heading[after] - heading[before]) * span / np.maximum(after - before, 1)


def swimming_type(
    turn_deg: Reals,
    bend: Reals,
    *,
    turn_threshold_deg: float,
    bend_threshold: float,
    release: float,
) -> NDArray[np.int8]:
    """Type (frames,) int8 of consecutive frames: 0 straight, 1 left, −1 right.

    A turn is a run of frames whose score - the mean of turn and signed bend, each over its
    threshold - stays above `release` and somewhere reaches 1.
    """
    score = 0.5 * (turn_deg / turn_threshold_deg + bend / bend_threshold)
    left = skimage.filters.apply_hysteresis_threshold(score, release, 1.0)
    right = skimage.filters.apply_hysteresis_threshold(-score, release, 1.0)
    return (LEFT * left + RIGHT * right).astype(np.int8)
