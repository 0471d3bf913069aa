"""Speed figures of a running session for the experimenter."""

from collections import Counter, deque
from dataclasses import dataclass, field

import numpy as np

_RECENT = 512  # values kept of each


@dataclass
class Numbers:
    """The last latencies of a running session, ms, and its counts of frames and messages.

    planned, drawn: from an input to the planned reaction, and to the frame that shows it; ticks:
    how much later ticks were planned than due; frames, dropped, late: displayed, missed, and drawn
    too late; bad: invalid messages of pages; heard: messages of trackers by verdict.
    """

    planned: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    drawn: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    ticks: deque[float] = field(default_factory=lambda: deque(maxlen=_RECENT))
    frames: int = 0
    dropped: int = 0
    late: int = 0
    bad: int = 0
    heard: Counter[str] = field(default_factory=Counter)


def percentiles(values: deque[float]) -> tuple[float, float]:
    """Return the median and the 99th percentile of values, in their unit; NaN if there are none."""
    if not values:
        return float("nan"), float("nan")
    median, most = np.percentile(np.array(values), [50, 99])
    return float(median), float(most)
