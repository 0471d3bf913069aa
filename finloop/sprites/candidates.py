"""Candidates for sprites: every tail beat, glide and turn of the film, with its faults.

A fault of 1 is just acceptable. `settings` are those of `sprites.settings`, tables those of
`sprites.swimmers`.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask, Reals
from finloop.features.swimming_type import STRAIGHT
from finloop.sprites.settings import SpritesSettings
from finloop.sprites.swimmers import smooth, unbroken_row_slices


def beats(table: pd.DataFrame, delta: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return the film's stretches of one straight tail beat: a row each, with its faults.

    delta: Δ in frames. Columns: start (row of `table`), length (frames), and one per fault (1 is
    just acceptable). The frame after a stretch is in the same track, since it is compared with the
    first.
    """
    least = max(settings.beat_frames, round(settings.beat_least * delta))
    parts = []
    for track, n, start, at in _straight(table, least, round(settings.beat_most * delta)):
        tail = sliding_window_view(track["tail"].to_numpy(), n)[start]
        power = np.abs(np.fft.rfft(tail - tail.mean(1, keepdims=True), axis=1)) ** 2
        power[:, 1 : (n + 1) // 2] *= 2
        total = np.maximum(power[:, 1:].sum(1), 1e-12)
        swing = np.maximum(np.ptp(tail, axis=1), 1e-6)
        faults = _common_faults(track, start, n, settings) | {
            "several waves": (1 - power[:, 1] / total) / (1 - settings.one_wave),
            "flicker": settings.flicker_frames / n,
            "lopsided": np.abs(tail.mean(1)) / swing / settings.lopsided,
        }
        parts.append(pd.DataFrame({"start": at, "length": n, "swing": swing, **faults}))
    waves = _concat(parts)
    if waves.empty:
        return waves
    beat = waves["swing"].between(settings.min_tail_swing_bl, settings.max_tail_swing_bl)
    waves = waves[beat & (waves["several waves"] <= 1)]
    untypical = np.abs(np.log2(waves["swing"] / waves["swing"].median()))
    return waves.drop(columns="swing").assign(**{"untypical beat": untypical})


def slides(table: pd.DataFrame, delta: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return the film's stretches of gliding: a row each, with the columns start, length, faults.

    delta: Δ in frames. Stretches shorter than `slide_least` are included only if there are no
    longer ones. Those whose tail moves more than `still` are included only if no tail is still.
    """
    least = max(3, round(settings.slide_least * delta))
    most = max(3, round(settings.slide_most * delta))
    typical = max(float(table.loc[table["usable"], "speed"].median()), 1e-6)
    for shortest in sorted({least, max(3, least // 2), 3}, reverse=True):
        parts = []
        for track, n, start, at in _straight(table, shortest, most):
            tail = sliding_window_view(track["tail"].to_numpy(), n)[start]
            speed = sliding_window_view(track["speed"].to_numpy(), n)[start].mean(1)
            faults = _common_faults(track, start, n, settings) | {
                "tail moves": np.ptp(tail, axis=1) / settings.still,
                "tail aside": np.abs(tail.mean(1)) / settings.still,
                "untypical speed": np.abs(np.log2(np.maximum(speed, 1e-6) / typical)) / 2,
                "short": least / n,
            }
            parts.append(pd.DataFrame({"start": at, "length": n, **faults}))
        glides = _concat(parts)
        if not glides.empty:
            still = glides[glides["tail moves"] <= 1]
            return glides if still.empty else still
    return pd.DataFrame()


def substitute_beats(table: pd.DataFrame, delta: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return glides that replace a missing tail beat: a row each, with the columns of `slides`.

    delta: Δ in frames. The glides are of straight swimming, else of any swimming, else of any
    frames, usable or not.
    """
    as_straight = table.assign(type=np.int8(STRAIGHT))
    for rows in (table, as_straight, as_straight.assign(usable=True)):
        if not (glides := slides(rows, delta, settings)).empty:
            return glides
    return pd.DataFrame()


def _straight(
    table: pd.DataFrame, least: int, most: int
) -> Iterator[tuple[pd.DataFrame, int, NDArray[np.intp], NDArray[np.intp]]]:
    """Yield windows of `least` … `most` usable straight frames, followed by a straight frame.

    Each item is a track, a length, the windows' first rows in that track and in `table`.
    """
    fine = ((table["type"] == STRAIGHT) & table["usable"]).to_numpy()
    for span in unbroken_row_slices(table):
        for n in range(least, min(most, span.stop - span.start - 1) + 1):
            start = np.flatnonzero(sliding_window_view(fine[span], n + 1).all(1))
            if start.size:
                yield table.iloc[span], n, start, start + span.start


def _common_faults(
    track: pd.DataFrame, start: NDArray[np.intp], n: int, settings: SpritesSettings
) -> dict[str, Floats]:
    """Return the faults that beats and slides share, of windows of `n` frames from `start`."""
    heading = track["heading"].to_numpy()
    speed = sliding_window_view(track["speed"].to_numpy(), n)[start]
    area = sliding_window_view(track["area_px"].to_numpy(), n + 1)[start]
    change = np.abs(speed[:, -(n // 2) :].mean(1) - speed[:, : n // 2].mean(1))
    return {
        "drift": np.abs(heading[start + n] - heading[start]) / settings.drift_deg,
        "speed changes": change / np.maximum(speed.mean(1), 1e-6) / settings.speed_change,
        "area changes": np.ptp(area, axis=1) / area.mean(1) / settings.area_change,
        "another size": track["animal_off"].to_numpy()[start],
        "not alone": _crowding(
            sliding_window_view(track["alone"].to_numpy(), n)[start].min(1), settings
        ),
    }


def _crowding(alone: Reals, settings: SpritesSettings) -> Floats:
    """Return 1 where another fish is just far enough away, 0 from twice that distance."""
    return np.clip(2 - alone / settings.min_neighbour_distance_bl, 0, 1)


def _concat(parts: list[pd.DataFrame]) -> pd.DataFrame:
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()


# -- turns -----------------------------------------------------------------------------------------


class _Bends(NamedTuple):
    """The bend to one side, 1 = left, −1 = right, of every row (n,), and the strongest."""

    side: int
    bend: Floats
    strongest: float


def turns(table: pd.DataFrame, side: int, settings: SpritesSettings) -> pd.DataFrame:
    """Return the film's strongest whole turns to one side: a row each, with start, length, faults.

    side: 1 = left, −1 = right. start: row of `table`; length: frames. A turn is whole if all its
    frames are usable, it has frames before and after the largest bend, and the heading changes.
    Weaker turns are included only if there are no stronger ones: see `strong` in the settings.
    """
    bend = side * table["bend"].to_numpy()
    turning = (table["type"] == side).to_numpy() & table["usable"].to_numpy()
    if not turning.any() or bend[turning].max() <= 0:
        return pd.DataFrame()
    of_side = _Bends(side, bend, float(bend[turning].max()))
    rows = [
        turn
        for span in unbroken_row_slices(table)
        for peak in _peaks(bend[span], turning[span])
        if (turn := _turn(table, of_side, span, span.start + peak, settings)) is not None
    ]
    for share in settings.strong:
        strong = [row for row in rows if row["weaker"] <= (1 - share) / settings.weaker + 1e-9]
        if strong:
            return pd.DataFrame(strong)
    return pd.DataFrame()


def substitute_turns(table: pd.DataFrame, side: int) -> pd.DataFrame:
    """Return the bends that replace a missing whole turn to one side: a row each.

    side: 1 = left, −1 = right. Columns: start (row of `table`), length (frames), and weaker: the
    share of the strongest bend that this one lacks. A bend runs from a minimum of bending to the
    next one.
    """
    bend = side * table["bend"].to_numpy()
    rows = []
    for span in unbroken_row_slices(table):
        inside = bend[span.start : span.stop - 1]  # a frame of the track follows
        low = span.start + np.flatnonzero(_minimal(inside))
        for first, last in pairwise(low.tolist()):
            peak = float(bend[first : last + 1].max())
            if last - first >= 2 and peak > max(0.0, bend[first], bend[last]):
                rows.append({"start": first, "length": last - first + 1, "weaker": peak})
    candidates = pd.DataFrame(rows)
    if not candidates.empty:
        candidates["weaker"] = 1 - candidates["weaker"] / candidates["weaker"].max()
    return candidates


def _minimal(bend: Reals) -> Mask:
    """Return local minima (n,): less than the number before, at most the next one; and the ends."""
    inner = (bend[1:-1] < bend[:-2]) & (bend[1:-1] <= bend[2:])
    return np.concatenate([[True], inner, [True]])[: len(bend)]


def _peaks(bend: Reals, turning: Mask) -> NDArray[np.intp]:
    inner = np.flatnonzero((bend[1:-1] > bend[:-2]) & (bend[1:-1] >= bend[2:])) + 1
    return inner[turning[inner] & (bend[inner] > 0)]


def _turn(
    table: pd.DataFrame, of_side: _Bends, span: slice, peak: int, settings: SpritesSettings
) -> dict[str, float] | None:
    """Return the turn around `peak`, the row of its largest bend; None if it is not whole."""
    side, bend, strongest = of_side
    first = _downhill(bend, peak, span.start, -1, settings)
    last = _downhill(bend, peak, span.stop - 1, 1, settings)
    before = first - 1  # the head has begun to turn by the first frame that is bent at all
    if before >= span.start and abs(bend[before]) < settings.bent * bend[peak]:
        first = before
    inside = slice(first, last + 1)
    strong = np.flatnonzero(bend[inside] >= settings.hold * bend[peak]) + first
    if first == strong[0] or last == strong[-1] or last + 1 >= span.stop:
        return None
    if not table["usable"].to_numpy()[inside].all():
        return None
    if (table["type"].to_numpy()[inside] == -side).any():
        return None
    heading = table["heading"].to_numpy()[first : last + 2]
    step = side * np.diff(smooth(heading))
    if step.sum() < settings.min_turn_deg:
        return None
    area = table["area_px"].to_numpy()[inside]
    ends = np.abs(bend[[first, last]])
    n = last - first + 1
    return {
        "start": first,
        "length": n,
        "weaker": (1 - bend[peak] / strongest) / settings.weaker,
        "bent at the ends": ends.sum() / bend[peak] / (2 * settings.bent),
        "turns back": -np.minimum(step, 0).sum() / settings.drift_deg,
        "goes on": abs(heading[-1] - heading[-2]) / settings.drift_deg,
        "bends twice": _climbs(bend[inside]) / bend[peak] / settings.bent,
        "jumps": step.max() / settings.jump_deg,
        "flicker": settings.flicker_frames / n,
        "area changes": np.abs(np.diff(area)).max() / area.mean() / settings.area_change,
        "another size": table["animal_off"].to_numpy()[first],
        "not alone": float(_crowding(table["alone"].to_numpy()[inside].min(), settings)),
    }


def _downhill(bend: Reals, peak: int, end: int, way: int, settings: SpritesSettings) -> int:
    """Return the row between `peak` and `end` where the fish is straightest before the next bend.

    `way`: 1 = later, −1 = earlier. Small rises do not end the search; a straight fish does.
    """
    low = row = peak
    while row != end and abs(bend[low]) > settings.straight_bend * bend[peak]:
        row += way
        if abs(bend[row]) < abs(bend[low]):
            low = row
        elif bend[row] < 0 or bend[row] > bend[low] + settings.bent * bend[peak]:
            break
    return low


def _climbs(bend: Reals) -> float:
    """Return how much the bend falls before its peak and rises after it, together."""
    step = np.diff(bend)
    peak = int(bend.argmax())
    return float(-np.minimum(step[:peak], 0).sum() + np.maximum(step[peak:], 0).sum())
