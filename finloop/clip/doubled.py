"""Pictures that a film shows twice, as after a conversion to a higher rate (25 → 30 Hz).

The change from one frame to the next is that of the blocks that change most. Where animals move, it
rises and falls smoothly; a doubled picture is a small change between large ones. An animal that
rests and darts away has small changes before large ones, and no doubled pictures.
"""

from typing import NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Floats, Ints, Mask, Picture

_BLOCK = 12  # px
_MOST = 0.01  # share of the blocks: those that change most
_AROUND = 6  # frames to each side with which a change is compared
_BESIDE = 3  # frames to each side, at least one of them new: shot at a quarter of the rate or more
_GAP = 2.5  # between the changes of doubled pictures and those of new ones, as a ratio
_THIRD = 3  # rank of the change that counts: two flashes do not decide
_LEAST = 1.0  # grey levels; where less changes, a frame is undecidable
_AGREE = 0.95  # share of the decidable frames that a cadence must predict
_PHASES = 33  # phases that are tried
_FEW = 8  # doubled pictures from which a cadence is searched for


def picture_change(before: Picture, after: Picture) -> float:
    """Return how much two grey frames (h, w) differ, in grey levels ≥ 0.

    Only the 1 % of all blocks (12×12 px) that change most count, so a small animal is noticed.
    """
    size = tuple(max(1, side // _BLOCK) for side in before.shape[::-1])
    difference = cv2.absdiff(before, after).astype(np.float32)
    blocks = np.sort(cv2.resize(difference, size, interpolation=cv2.INTER_AREA), axis=None)
    return float(blocks[-max(1, round(_MOST * blocks.size)) :].mean())


class RepeatedFrames(NamedTuple):
    """The frames of a film that repeat the picture of the frame before.

    A cadence is the regular rhythm of repeats that a conversion of the frame rate leaves. Without
    one every frame counts as a new picture.
    """

    share: float  # of repeats, 0 … 1, in the frames in which enough moves to decide
    rate: float  # different pictures per frame; 1 without repeats, NaN without a cadence
    pictures: Ints  # (frames,) the number of the picture that each frame shows
    repeats: Mask  # (frames,) whether that is the picture of the frame before


def find_repeats(changes: Floats) -> RepeatedFrames:
    """Return which frames show the same picture as the frame before, their share and their rhythm.

    changes (frames,): how much each frame differs from the one before, grey levels; changes[0] is
    NaN. Repeats of no regular rhythm, or fewer than eight, count only for the share: no frame is a
    repeat, and the rate is NaN. Without any doubled frame the rate is 1.
    """
    decidable, doubled = _find_doubled(changes)
    share = float(doubled[decidable].mean()) if decidable.any() else 0.0
    all_new = np.arange(len(changes)), np.zeros(len(changes), bool)
    if doubled.sum() < _FEW:
        return RepeatedFrames(share, 1.0 if not doubled.any() else float("nan"), *all_new)
    rate, pictures, repeats = _fit_cadence(decidable, doubled)
    if np.mean(repeats[decidable] == doubled[decidable]) < _AGREE:
        return RepeatedFrames(share, float("nan"), *all_new)
    # The cadence may be off by a frame, so where enough moves, what was seen decides.
    repeats = np.where(decidable, doubled, repeats)
    repeats[0] = False
    return RepeatedFrames(share, rate, pictures - pictures[0], repeats)


def _find_doubled(changes: Floats) -> tuple[Mask, Mask]:
    """Return two masks (frames,): where enough moves to decide, and which frames are doubled.

    A frame is doubled if its change is small, and a larger one is among the three before it and
    among the three after it: a resting animal that darts away has small changes on one side only.
    An end of the film counts as a larger change.
    changes (frames,): how much each frame differs from the one before, grey levels.
    """
    known = np.nan_to_num(changes)
    largest, limit = _small_change_limits(known)
    # Enough moves: the largest change is above `_LEAST`, and in the upper half of such changes.
    decidable = largest > _LEAST
    if decidable.any():
        decidable &= largest >= np.median(largest[decidable])
    decidable[:1] = False  # the first frame has none before it
    padded = np.pad(known, _BESIDE, constant_values=np.inf)
    beside = np.lib.stride_tricks.sliding_window_view(padded, _BESIDE).max(axis=1)
    before, after = beside[: len(known)], beside[_BESIDE + 1 :]
    return decidable, decidable & (known <= limit) & (before > limit) & (after > limit)


def _small_change_limits(changes: Floats) -> tuple[Floats, Floats]:
    """Return for each frame the largest change near it, and the largest small change, (frames,).

    The changes of the six frames to either side are sorted, without the two largest, which may be
    flashes. Those below the largest gap, a ratio of one to the next, are small; where no gap is
    large enough none is, and the limit is −∞.
    """
    padded = np.pad(changes, _AROUND)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _AROUND + 1)
    around = np.sort(windows, axis=1)[:, : 1 - _THIRD]
    largest = around[:, -1]
    around = np.maximum(around, 0.02 * largest[:, None] + 1e-9)  # avoids ratios of near zeros
    ratios = around[:, 1:] / around[:, :-1]
    below_gap = np.take_along_axis(around, ratios.argmax(axis=1)[:, None], axis=1)[:, 0]
    return largest, np.where(ratios.max(axis=1) >= _GAP, below_gap, -np.inf)


def _fit_cadence(decidable: Mask, doubled: Mask) -> tuple[float, Ints, Mask]:
    """Fit the regular rhythm of doubled frames that a conversion of the frame rate leaves.

    It always finds one; the caller checks whether it fits. Return the number of new pictures per
    frame, 0 … 1, the number of each frame's picture (frames,), and which frames the rhythm says are
    doubled (frames,). decidable, doubled: masks (frames,) where enough moves, and what is doubled
    there.
    """
    # The rarer kind of frames, doubled or new, has the simpler rhythm: one comes with each beat,
    # and floor(frame · rate + phase) counts the beats.
    rare = doubled if 2 * doubled.sum() < decidable.sum() else decidable & ~doubled
    rate, phase = _find_rhythm(decidable, rare)
    phase = _refine_phase(decidable, rare, rate, phase)
    number = np.arange(len(decidable))
    beats = np.floor(number * rate + phase).astype(np.int64)
    on_beat = _frames_on_beat(number, rate, phase)
    if rare is doubled:  # each beat is a doubled frame, so all others are new pictures
        return 1 - rate, number - beats, on_beat
    return rate, beats, ~on_beat


def _frames_on_beat(number: Ints, rate: float, phase: float) -> Mask:
    """Return a mask (n,) of frames, given by number (n,), on which a beat of a rhythm falls.

    rate: beats per frame; phase: how many beats there are up to frame 0.
    """
    return np.floor(number * rate + phase) > np.floor((number - 1) * rate + phase)


def _find_rhythm(decidable: Mask, rare: Mask) -> tuple[float, float]:
    """Return the rate [beats per frame] and rough phase [beats] at which rare frames come.

    The rate is the peak of a spectrum. decidable, rare: masks (frames,).
    """
    frames = len(decidable)
    density = rare[decidable].mean()
    signal = np.where(decidable, rare - density, 0.0)
    # The spectrum's peak near the density, from a quarter of it to twice, on a grid of 8 bins per
    # frame of film, then on a finer one.
    power = np.abs(np.fft.rfft(signal, 8 * frames))
    low = max(1, round(8 * frames * 0.25 * density))
    peak = low + int(power[low : round(8 * frames * min(0.5, 2 * density)) + 1].argmax())
    rates = (peak + np.linspace(-1, 1, 41)) / (8 * frames)
    waves = np.exp(-2j * np.pi * rates[:, None] * np.flatnonzero(rare)).sum(axis=1)
    best = int(np.abs(waves).argmax())
    return float(rates[best]), float(np.angle(waves[best])) / (2 * np.pi)


def _refine_phase(decidable: Mask, rare: Mask, rate: float, phase: float) -> float:
    """Return the phase [beats] of a rhythm that agrees with the most frames.

    Phases from `phase` to `phase + rate` are tried, which lead to different frames; of equally good
    ones the middle is returned. rate: beats per frame; decidable, rare: masks (frames,).
    """
    number = np.arange(len(decidable))
    phases = [phase + rate * share for share in np.linspace(0, 1, _PHASES)]
    on_beat = (_frames_on_beat(number, rate, tried) for tried in phases)
    agreement = np.array([np.mean(mask[decidable] == rare[decidable]) for mask in on_beat])
    best = np.flatnonzero(agreement == agreement.max())
    return phases[best[len(best) // 2]]
