"""Windows of swimming, cut from film and animation alike: the input of the classifier.

A window is a stretch of one fish. Its channels are forward and sideways speed, turning speed and
relative motion area (fish paper §2.2-2.3), in the fish's own frame: they do not show place and
direction.

A tick that shows a frame of the film belongs to the film's time, in every mode. A tick with a
sprite belongs to the animation's own time. Both times are divided into blocks. A window is tested
in the block to which most of its ticks belong. The classifier of a block learns from no window with
a tick in the block, or within a gap of it. So frames that an animation plays are never learnt from
as one kind and tested as the other. Otherwise a perfect copy of the film would get an AUC near 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.axes import to_body_axes
from finloop.features.current import places_through_water

CHANNELS = ("forward", "sideways", "turning", "area")
"""Forward, sideways: body lengths/s; turning: °/s, + = left; area: of the film's largest."""

HALVES, AGAIN = "halves", "again"
"""Comparisons that need no animation: one half of the film with the other; the film as filmed with
the film drawn and measured again."""


@dataclass(frozen=True)
class Windows:
    """n windows of swimming (stretches of one fish), the input of the classifier.

    x (n, steps, 4): CHANNELS. first (n,): the row with which each begins. block (n,): the block of
    time in which each is tested. near (n, blocks): True where the block's classifier must not learn
    from it. cluster (n,): windows with the same number are not independent.
    """

    x: NDArray[np.float32]
    first: Ints
    block: Ints
    near: Mask
    cluster: Ints

    def __len__(self) -> int:
        return len(self.x)


class Blocks(NamedTuple):
    """The times of blocks: m stretches, each of which belongs to a block.

    edges (m + 1,): in s, ascending. number (m,): the block of each stretch.
    """

    edges: Floats
    number: Ints

    def block_numbers(self, time_s: Floats) -> Ints:
        """Return the number of the block (n,) that contains each of n times in s."""
        stretch = np.searchsorted(self.edges, time_s, "right") - 1
        return self.number[np.clip(stretch, 0, len(self.number) - 1)]

    def are_near(self, time_s: Floats, gap_s: float) -> Mask:
        """Return which of n times lie in each block, or within a gap of it: (n, blocks)."""
        near = np.zeros((len(time_s), int(self.number.max()) + 1), bool)
        for number, low, high in zip(self.number, self.edges, self.edges[1:], strict=False):
            near[:, number] |= (time_s > low - gap_s) & (time_s < high + gap_s)
        return near


def equal_blocks(time_s: Floats, count: int, repeats: int = 1) -> Blocks:
    """Divide time into `count` blocks that contain equally many of n times in s.

    repeats: how often the sequence of blocks is repeated, each time with further stretches of time.
    The first and the last stretch have no outer end.
    """
    edges = np.quantile(time_s, np.linspace(0, 1, repeats * count + 1))
    edges[[0, -1]] = -np.inf, np.inf
    return Blocks(edges, np.tile(np.arange(count), repeats))


class WindowCut(NamedTuple):
    """How windows are cut: their length, stride and averaging step, in frames.

    length: of a window, a whole number of steps; stride: from the start of a window to that of the
    next one; step: part of a window over which a channel is averaged to one number.
    """

    length: int
    stride: int
    step: int


def window_cut_from_deltas(
    window_deltas: float, stride_deltas: float, step_deltas: float, delta: int
) -> WindowCut:
    """Return window, stride and step in frames, converted from units of the time Δ.

    delta: Δ in frames.
    """
    step = max(1, round(step_deltas * delta))
    length = step * max(1, round(window_deltas * delta / step))
    return WindowCut(length, max(1, round(stride_deltas * delta)), step)


def track_channels(track: pd.DataFrame, rate_hz: float, largest: float) -> Floats:
    """Return the channels of a track, (ticks − 1, 4): two speeds, turning speed, motion area.

    They are CHANNELS: speeds ahead and to the left [BL/s], anticlockwise turning [degrees/s], and
    relative motion area.
    track: columns of `FEATURES`; rate_hz: ticks per second; largest: motion area of the film's most
    bent fish, in squares of a body length.
    """
    length = float(track["body_length_px"].median())
    travel = np.diff(places_through_water(track), axis=0) * (rate_hz / length)
    heading = np.unwrap(track["heading_deg"].to_numpy(float), period=360)
    angle_rad = np.radians((heading[1:] + heading[:-1]) / 2)
    return np.column_stack([
        to_body_axes(travel, angle_rad),
        np.diff(heading) * rate_hz,
        track["motion_area"].to_numpy(float)[1:] / largest,
    ])  # fmt: skip


class TickBlocks(NamedTuple):
    """The block and the cluster to which each of n measured ticks belongs, and the blocks near it.

    near (n, blocks): True where the block contains the tick or lies within a gap of it.
    """

    block: Ints
    near: Mask
    cluster: Ints


def cut_windows(
    table: pd.DataFrame, ticks: TickBlocks, cut: WindowCut, rate_hz: float, largest: float
) -> Windows:
    """Cut measured swimming into windows of channels; no window crosses from track to track.

    table: columns of `FEATURES`, track by track. ticks: of the same rows. A window belongs to the
    block of most of its ticks. rate_hz, largest: as in `track_channels`.
    """
    # The channels of the windows, and the rows with which they begin.
    x, first = [np.zeros((0, cut.length // cut.step, len(CHANNELS)))], [np.zeros(0, np.intp)]
    track_start = 0
    for _, track in table.groupby("track_id", sort=False):
        channels = track_channels(track, rate_hz, largest)
        starts = np.arange(0, len(channels) - cut.length + 1, cut.stride)
        if len(starts):
            inside = channels[starts[:, None] + np.arange(cut.length)]
            # each step of a window is the mean of its ticks
            x.append(inside.reshape(len(starts), -1, cut.step, len(CHANNELS)).mean(axis=2))
            first.append(track_start + starts)
        track_start += len(track)
    # Their blocks and clusters.
    first_rows = np.concatenate(first)
    rows = first_rows[:, None] + np.arange(cut.length + 1)  # (windows, ticks): n steps, n + 1 ticks
    blocks = np.arange(ticks.near.shape[1])
    ticks_in_block = (ticks.block[rows][..., None] == blocks).sum(axis=1)  # (windows, blocks)
    return Windows(
        x=np.concatenate(x).astype(np.float32), first=first_rows,
        block=ticks_in_block.argmax(axis=1), near=ticks.near[rows].any(axis=1),
        cluster=ticks.cluster[rows[:, cut.length // 2]],
    )  # fmt: skip


def join_windows(parts: Sequence[Windows]) -> Windows:
    """Return several sets of windows joined into one set, in the given order."""
    by_field = zip(*(vars(part).values() for part in parts), strict=True)
    return Windows(*(np.concatenate(arrays) for arrays in by_field))
