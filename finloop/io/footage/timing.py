"""Rate and time of a film's frames: from time stamps to the ticks of a constant rate.

Times are seconds.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TypeVar

import numpy as np

T = TypeVar("T")

# A longer pause, or a clock that runs backwards, is a cut and not a slow frame: a new segment of
# the film begins, instead of a fish that stands still.
CUT_S, CUT_FRAMES = 1.0, 5.0  # whichever is longer


def estimate_frame_rate(
    times_s: Sequence[float] | np.ndarray, candidates: Sequence[Fraction]
) -> Fraction:
    """Return the constant frame rate that a film's ascending time stamps are nearest to.

    Each gap counts as the whole number of frames that it lasts at the median gap, so dropped frames
    do not lower the rate; cuts are left out. Of the rates that the file states (`candidates`), the
    first one within half a frame of this estimate over the whole film is taken: stamps are often
    rounded to milliseconds, and 30000/1001 is then a better answer.
    """
    gaps = np.diff(np.asarray(times_s, np.float64))
    gaps = gaps[(gaps > 0) & (gaps <= max(CUT_S, CUT_FRAMES * float(np.median(gaps))))]
    if not gaps.size:  # the stamps say nothing: the first rate that is stated, else 25 frames/s
        return next((rate for rate in candidates if rate > 0), Fraction(25))
    counts = np.rint(gaps / np.median(gaps))
    estimate = float(counts.sum() / gaps.sum())
    for rate in candidates:
        if rate > 0 and abs(float(rate) / estimate - 1) * counts.sum() < 0.5:
            return rate
    return Fraction(estimate).limit_denominator(1001)


@dataclass
class FrameCounts:
    """Counts of frames that grow while a film is converted to a constant frame rate."""

    frames: int = 0  # shown, repeats included
    repeated: int = 0  # shown again, to fill a tick without a frame
    dropped: int = 0  # not shown, where several fall on one tick
    cuts: list[int] = field(default_factory=list)  # first frame of each segment without a cut


def resample_nearest(
    stamped: Iterable[tuple[float, T]], frame_rate: Fraction, timing: FrameCounts
) -> Iterator[T]:
    """Yield, for every tick of a constant rate, the item that is nearest in time.

    stamped: pairs (time [s], item), such as frames, in order. frame_rate: ticks per second. Where
    the time jumps, a new segment begins, whose first tick is at its first item. A film of constant
    rate passes through item by item if its time stamps jitter by less than half a frame. timing:
    its counts of items shown, repeated and dropped grow; its cuts get each segment's first tick.
    """
    rate = float(frame_rate)
    longest_step_s = max(CUT_S, CUT_FRAMES / rate)
    last: tuple[float, T] | None = None
    start_s = 0.0  # time of tick 0 of this segment
    ticks = 0  # of this segment

    def yield_repeats(until: float) -> Iterator[T]:
        """Yield the last item for each new tick before tick `until`; count repeats and drops.

        until: in ticks of this segment; a fraction is rounded up.
        """
        nonlocal ticks
        assert last is not None
        count = max(0, int(np.ceil(until)) - ticks)
        ticks += count
        timing.frames += count
        timing.repeated += max(0, count - 1)
        timing.dropped += count == 0
        for _ in range(count):
            yield last[1]

    for time_s, item in stamped:
        if last is not None and 0 <= time_s - last[0] <= longest_step_s:
            # The last item is the nearest up to the middle between both.
            yield from yield_repeats(((last[0] + time_s) / 2 - start_s) * rate)
        else:  # a new segment
            if last is not None:
                yield from yield_repeats((last[0] - start_s) * rate + 0.5)
            timing.cuts.append(timing.frames)
            start_s, ticks = time_s, 0
        last = time_s, item
    if last is not None:
        yield from yield_repeats((last[0] - start_s) * rate + 0.5)


def split_at_cuts(cuts: Sequence[int], frames: int) -> tuple[tuple[int, int], ...]:
    """Return the ranges [start, stop) of frames into which cuts divide a film.

    cuts: the first frame of each range, ascending. frames: number of frames of the film.
    """
    return tuple(zip(cuts, [*cuts[1:], frames], strict=True))
