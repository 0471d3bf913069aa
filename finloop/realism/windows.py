"""Windows of swimming, cut from film and animation alike: the input of the classifier.

A window is a stretch of one fish. Its channels are forward and sideways speed, turning speed and
relative motion area (fish paper §2.2-2.3), in the fish's own frame: they do not show place and
direction. Pictures are cut into the same windows; their channels are those of `crops`.

A tick that shows a frame of the film belongs to the film's time, in every mode. A tick with a
sprite belongs to the animation's own time. Both times are divided into blocks. A window is tested
in the block to which most of its ticks belong. The classifier of a block learns from no window with
a tick in the block, or within a gap of it. So frames that an animation plays are never learnt from
as one kind and tested as the other. Otherwise a perfect copy of the film would get an AUC near 0.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask, Reals
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

    x (n, parts, channels): a number per part of the window, such as a step, and channel. first
    (n,): the row with which each begins. block (n,): the block of time in which each is tested.
    near (n, blocks): True where the block's classifier must not learn from it. cluster (n,):
    windows with the same number are not independent. channels: their names.
    """

    x: Reals
    first: Ints
    block: Ints
    near: Mask
    cluster: Ints
    channels: tuple[str, ...] = CHANNELS

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
        """Return a mask (n, blocks) of the times (n,) in a block or within a gap of it."""
        near = np.zeros((len(time_s), int(self.number.max()) + 1), bool)
        for number, low, high in zip(self.number, self.edges, self.edges[1:], strict=False):
            near[:, number] |= (time_s > low - gap_s) & (time_s < high + gap_s)
        return near


def equal_blocks(time_s: Floats, count: int, repeats: int = 1) -> Blocks:
    """Divide time into `count` blocks that contain equally many of n times in s.

    time_s (n,): the times, in any order; repeats: how often the sequence of blocks is repeated,
    each time with further stretches of time. The first and the last stretch have no outer end.
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


def motion_channels(table: pd.DataFrame, rate_hz: float, largest: float) -> Floats:
    """Return CHANNELS of every row of a table (n, 4), NaN in the first row of each track.

    table: columns of `FEATURES`, track by track. rate_hz, largest: as in `track_channels`.
    """
    channels = np.full((len(table), len(CHANNELS)), np.nan)
    row = 0
    for _, track in table.groupby("track_id", sort=False):
        channels[row + 1 : row + len(track)] = track_channels(track, rate_hz, largest)
        row += len(track)
    return channels


class TickBlocks(NamedTuple):
    """The block and the cluster to which each of n measured ticks belongs, and the blocks near it.

    near (n, blocks): True where the block contains the tick or lies within a gap of it.
    """

    block: Ints
    near: Mask
    cluster: Ints


def mean_of_steps(inside: Floats, step: int) -> Floats:
    """Return the means of windows (n, ticks, channels) over steps of `step` ticks each."""
    windows, ticks, channels = inside.shape
    return inside.reshape(windows, ticks // step, step, channels).mean(axis=2)


def change_statistics(inside: Floats) -> Floats:
    """Return four numbers per window and channel (n, 4, channels), from (n, ticks, channels).

    They are the mean, the SD, and the mean and the largest absolute change from tick to tick.
    """
    changes = np.abs(np.diff(inside, axis=1))
    return np.stack([inside.mean(1), inside.std(1), changes.mean(1), changes.max(1)], axis=1)


def cut_windows(
    track_id: Ints, values: Floats, ticks: TickBlocks, cut: WindowCut,
    summarise: Callable[[Floats], Floats], channels: tuple[str, ...] = CHANNELS,
) -> Windows:  # fmt: skip
    """Cut the channels of n ticks into windows; no window crosses from track to track.

    track_id (n,): track by track. values (n, channels): a window's first tick gives no value, and a
    window with a NaN is left out. ticks: of the same rows; a window belongs to the block of most of
    its ticks. summarise: (windows, ticks, channels) → (windows, parts, channels).
    """
    ends = np.flatnonzero(np.diff(track_id, append=np.nan)) + 1
    starts = [
        np.arange(start, stop - cut.length, cut.stride)
        for start, stop in pairwise([0, *ends.tolist()])
    ]
    first = np.concatenate([np.zeros(0, np.intp), *starts])
    whole = np.asarray(np.isfinite(values).all(axis=1))
    first = first[whole[first[:, None] + 1 + np.arange(cut.length)].all(axis=1)]
    rows = first[:, None] + np.arange(cut.length + 1)  # (windows, ticks): n steps, n + 1 ticks
    blocks = np.arange(ticks.near.shape[1])
    ticks_in_block = (ticks.block[rows][..., None] == blocks).sum(axis=1)  # (windows, blocks)
    return Windows(
        x=summarise(values[rows[:, 1:]]).astype(np.float32), first=first,
        block=ticks_in_block.argmax(axis=1), near=np.asarray(ticks.near[rows].any(axis=1)),
        cluster=ticks.cluster[rows[:, cut.length // 2]], channels=channels,
    )  # fmt: skip


def join_windows(parts: Sequence[Windows]) -> Windows:
    """Return several sets of windows of the same channels joined into one set, in their order."""
    names = [field.name for field in fields(Windows) if field.name != "channels"]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Windows(**arrays, channels=parts[0].channels)
