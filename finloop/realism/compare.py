"""Comparisons: an animation with its film, and one half of the film with the other.

Either by motion (the channels of `windows`) or by pictures (those of `crops`, and crops as such).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.features.table import infer_delta_frames
from finloop.realism.auc import Auc, Scores, compute_auc
from finloop.realism.classifier import score_held_out_windows
from finloop.realism.crops import PICTURE_CHANNELS
from finloop.realism.instrument import Swimming
from finloop.realism.network import Part, score_held_out_crops
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import (
    AGAIN,
    CHANNELS,
    HALVES,
    Blocks,
    TickBlocks,
    WindowCut,
    Windows,
    change_statistics,
    cut_windows,
    equal_blocks,
    mean_of_steps,
    motion_channels,
    window_cut_from_deltas,
)  # fmt: skip

Sides = dict[str, tuple[Windows, Windows]]
"""Pairs of sets of windows by name, the film's set first."""

LEAST = 2
"""Windows, at least, that a block tests and learns from."""

CROP_VIEWS = "crop", "crop_change"
"""What the network sees: a crop, or its change from the tick before."""

View = Literal["motion", "picture", "crop"]
"""What windows show: channels of motion, channels of pictures, or each a crop and its change."""


@dataclass(frozen=True)
class FilmSample:
    """The film with which animations are compared, and how both are cut into windows.

    film: drawn and measured again, as animations are; where pictures are compared, as filmed. Then
    it has `pictures`, as all that is compared with it. frame_s (rows,): time in s of each row of
    the feature table. largest: greatest motion area in `film`, in squares of a body length.
    rate_hz: frames per second. delta: Δ, the time over which motion is measured, in frames. view:
    what is compared.
    """

    film: Swimming
    frame_s: Floats
    largest: float
    rate_hz: float
    delta: int
    p: RealismSettings
    view: View = "motion"

    @property
    def window_cut(self) -> WindowCut:
        """Return how windows are cut, in frames; the parameters give these times in Δ."""
        length, stride = self.p.window_deltas, self.p.window_deltas / self.p.windows_per_length
        return window_cut_from_deltas(length, stride, self.p.step, self.delta)

    def cut_windows(self, swimming: Swimming, blocks: Blocks, used: Mask | None = None) -> Windows:
        """Cut swimming into windows of what `view` shows, each with its block of time.

        swimming: n measured ticks. used (n,): True for ticks to use, None for all. A tick with a
        frame of the film belongs to one of the `blocks` of the film's time; one with a sprite to a
        block of the time that the animation has played, in blocks of equally many ticks. Windows
        also name their cluster, and the blocks near which they lie.
        """
        p = self.p
        # A classifier learns nothing within a window's length of its block.
        gap_s = p.window_deltas * self.delta / self.rate_hz
        is_frame, played_s = swimming.row >= 0, swimming.time_s
        film_s = self.frame_s[np.where(is_frame, swimming.row, 0)]
        played_blocks = equal_blocks(played_s, p.cross_validation_folds)
        block = np.where(
            is_frame, blocks.block_numbers(film_s), played_blocks.block_numbers(played_s)
        )
        near = np.where(
            is_frame[:, None], blocks.are_near(film_s, gap_s),
            played_blocks.are_near(played_s, gap_s),
        )  # fmt: skip
        # Clusters of sprites have negative numbers, which differ from those of the film.
        tick = np.round(played_s * self.rate_hz).astype(np.int64)
        cluster_ticks = max(1, round(p.windows_per_cluster * p.window_deltas * self.delta))
        cluster = np.where(is_frame, swimming.row // cluster_ticks, -1 - tick // cluster_ticks)
        ticks = TickBlocks(block, near, cluster)
        if self.view == "crop":
            return _crop_windows(swimming, ticks, used)
        rows = np.arange(len(is_frame)) if used is None else np.flatnonzero(used)
        channels = PICTURE_CHANNELS if self.view == "picture" else CHANNELS
        if self.view == "picture":
            assert swimming.pictures is not None
            values, summarise = swimming.pictures.channels, change_statistics
        else:
            values = motion_channels(swimming.table, self.rate_hz, self.largest)
            summarise = partial(mean_of_steps, step=self.window_cut.step)
        track_id = swimming.table["track_id"].to_numpy()[rows]
        used_ticks = TickBlocks(block[rows], near[rows], cluster[rows])
        windows = cut_windows(
            track_id, values[rows], used_ticks, self.window_cut, summarise, channels
        )
        return replace(windows, first=rows[windows.first])

    def film_blocks(self, repeats: int = 1) -> Blocks:
        """Return the blocks of the film's time, with equally many rows (a fish in a frame) in each.

        repeats: how often the sequence of blocks is repeated, one after another.
        """
        return equal_blocks(self.frame_s[self.film.row], self.p.cross_validation_folds, repeats)

    def windows_beside_film(self, animation: Swimming) -> tuple[Windows, Windows]:
        """Return the windows of the film and the windows of an animation made from it."""
        blocks = self.film_blocks()
        return self.cut_windows(self.film, blocks), self.cut_windows(animation, blocks)

    def half_windows(self) -> tuple[Windows, Windows]:
        """Return the windows of the film's first half and those of its second half.

        Each half is divided into blocks with the same numbers. The halves are halves of time, which
        show the same fish, as an animation does. From halves by tracks, a classifier would learn to
        distinguish the fish.
        """
        film, blocks = self.film, self.film_blocks(repeats=2)
        # Where the numbers of the blocks begin again.
        middle_s = blocks.edges[self.p.cross_validation_folds]
        early = self.frame_s[film.row] < middle_s
        return self.cut_windows(film, blocks, early), self.cut_windows(film, blocks, ~early)

    def comparison_windows(self, measured: Mapping[str, Swimming], features: pd.DataFrame) -> Sides:
        """Return the two sets of windows that each comparison has to distinguish, by its name.

        The names are the modes, each beside the film; HALVES, the film's halves; AGAIN, the film as
        filmed beside the film drawn and measured again. measured: each mode's animation.
        """
        filmed = self.cut_windows(self.as_filmed(features), self.film_blocks())
        return {
            **{mode: self.windows_beside_film(animation) for mode, animation in measured.items()},
            HALVES: self.half_windows(),
            AGAIN: (filmed, self.cut_windows(self.film, self.film_blocks())),
        }

    def as_filmed(self, features: pd.DataFrame) -> Swimming:
        """Return the same stretches of the film, measured in the film and not drawn again.

        features: columns of `FEATURES`, of the whole film.
        """
        table = features.iloc[self.film.row].assign(track_id=self.film.table["track_id"].to_numpy())
        return replace(self.film, table=table)


def _crop_windows(swimming: Swimming, ticks: TickBlocks, used: Mask | None) -> Windows:
    """Return the crops of film or animation as windows of one tick: x is (n, 2, pixels).

    The two parts are the crop and its change from the tick before. used (ticks,): True for ticks to
    use, None for all.
    """
    pictures = swimming.pictures
    assert pictures is not None
    shown = slice(None) if used is None else used[pictures.crop_rows]
    rows = pictures.crop_rows[shown]
    return Windows(
        x=pictures.crops[shown].reshape(len(rows), 2, -1), first=rows, block=ticks.block[rows],
        near=ticks.near[rows], cluster=ticks.cluster[rows], channels=("grey",),
    )  # fmt: skip


def build_film_sample(
    film: Swimming, features: pd.DataFrame, rate_hz: float, p: RealismSettings
) -> FilmSample:
    """Return the film's side of all comparisons: its measured swimming, and how to cut windows.

    film: drawn and measured again. features: columns of `FEATURES`, of the whole film.
    """
    frame_s, largest = features["frame"].to_numpy(float) / rate_hz, film.table["motion_area"].max()
    return FilmSample(film, frame_s, float(largest), rate_hz, infer_delta_frames(features), p)


@dataclass(frozen=True)
class Verdict:
    """How well a classifier distinguishes two sets of windows, such as film and animation.

    whole: AUC (0.5 not at all, 1 always) by all channels. alone: channel → AUC by only this
    channel. importance: channel → loss of AUC when its values are shuffled. scores: by all
    channels, windows of the first set first. looks (k, h, w): how much each pixel of a crop counts
    for the network, by crops and by their changes; None without a network.
    """

    whole: Auc
    alone: dict[str, Auc]
    importance: dict[str, float]
    scores: Scores
    looks: Floats | None = None

    @property
    def best(self) -> Auc:
        """Return the largest of the AUCs by all channels, by crops and by changes of crops."""
        return max([self.whole, *(self.alone[name] for name in CROP_VIEWS if name in self.alone)])

    def to_values(self) -> dict[str, Any]:
        """Return the verdict as plain values that JSON can hold; `from_values` restores it."""
        return {
            "whole": list(self.whole),
            "alone": {name: list(area) for name, area in self.alone.items()},
            "importance": self.importance,
            "scores": [column.tolist() for column in self.scores],
            "looks": None if self.looks is None else self.looks.tolist(),
        }

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> "Verdict":
        """Restore a verdict from the plain values of `to_values`."""
        alone = {name: Auc(*area) for name, area in values["alone"].items()}
        scores = Scores(*map(np.array, values["scores"]))
        looks = None if values["looks"] is None else np.array(values["looks"])
        return cls(Auc(*values["whole"]), alone, values["importance"], scores, looks)


def classify_windows(
    window_pair: tuple[Windows, Windows], p: RealismSettings, by_channel: bool = True
) -> Verdict:
    """Train classifiers on two sets of windows; return how well they distinguish them.

    window_pair: the film's set first. by_channel: whether to classify also by each channel alone.
    FinloopError if a block has too few windows of either set to test and to learn from.
    """
    _require_enough_windows(window_pair, p)
    names = window_pair[0].channels
    channels = tuple(range(len(names)))
    share = p.picture_share if names == PICTURE_CHANNELS else 1.0
    held_out = score_held_out_windows(*window_pair, p, channels, share)
    whole, alone = compute_auc(held_out.scores), {}
    for channel in channels if by_channel else ():
        scores = score_held_out_windows(*window_pair, p, (channel,), share).scores
        alone[names[channel]] = compute_auc(scores)
    importance = {
        name: whole.value - compute_auc(scores).value for name, scores in held_out.shuffled.items()
    }
    return Verdict(whole, alone, importance, held_out.scores)


def classify_pictures(
    window_pair: tuple[Windows, Windows], crop_pair: tuple[Windows, Windows] | None,
    p: RealismSettings,
) -> Verdict:  # fmt: skip
    """Return how well pictures distinguish two sets: their channels, crops, and changes of crops.

    window_pair: windows of channels, the film's set first. crop_pair: the same of crops, which a
    network judges (`alone` has its AUCs by the names of CROP_VIEWS); None: no network. FinloopError
    as in `classify_windows`.
    """
    verdict = classify_windows(window_pair, p)
    if crop_pair is None:
        return verdict
    _require_enough_windows(crop_pair, p)
    alone, looks = dict(verdict.alone), list[Floats]()
    parts: tuple[Part, ...] = 0, 1
    for part, name in zip(parts, CROP_VIEWS, strict=True):
        scores, look = score_held_out_crops(*crop_pair, part, p)
        alone[name] = compute_auc(scores)
        looks.append(look)
    return replace(verdict, alone=alone, looks=np.stack(looks))


def _require_enough_windows(window_pair: tuple[Windows, Windows], p: RealismSettings) -> None:
    """Raise FinloopError if there are too few windows to train and test a classifier per block."""
    film, other = window_pair
    folds = p.cross_validation_folds
    tested, learnt = np.bincount(film.block, minlength=folds), (~film.near).sum(axis=0)
    learnt_other = (~other.near).sum(axis=0)
    if min(tested.min(), learnt.min(), learnt_other.min()) < LEAST or len(other.x) < folds:
        raise FinloopError(
            f"the blocks test {tested.tolist()} windows of the film, and learn from "
            f"{learnt.tolist()} of the film and {learnt_other.tolist()} of the other side",
            f"at least {LEAST} of each in each of {folds} blocks",
            "a longer film, fewer realism.cross_validation_folds, or a shorter "
            "realism.window_deltas",
        )


def verdict_table(verdicts: Mapping[str, Verdict], by: str = "motion") -> pd.DataFrame:
    """Return the verdicts as a table: a row per comparison and channel, channel "all" first.

    Columns: compared; by, as given, "motion" or "picture"; channel; auc, low, high: the area under
    the ROC curve and its 95 % interval; lost: area lost when the channel is shuffled, NaN for "all"
    and for what the network sees.
    """
    rows = []
    for name, verdict in verdicts.items():
        for channel, area in {"all": verdict.whole, **verdict.alone}.items():
            rows.append((name, by, channel, *area, verdict.importance.get(channel, np.nan)))
    return pd.DataFrame(rows, columns=["compared", "by", "channel", "auc", "low", "high", "lost"])


def auc_metrics(motion: Mapping[str, Verdict], pictures: Mapping[str, Verdict]) -> dict[str, float]:
    """Return the AUCs as metrics by name, by motion and by pictures.

    `<name>_auc`, `_auc_low`, `_auc_high` are the AUC by motion and its 95 % interval,
    `<name>_<channel>_auc` that by one channel. `<name>_picture_auc`, `…_low`, `…_high` are those of
    the classifier of pictures that distinguishes best: by all channels, by crops, or by changes.
    """
    metrics: dict[str, float] = {}
    for name, verdict in motion.items():
        metrics |= _named_auc(f"{name}_auc", verdict.whole)
        metrics |= {f"{name}_{channel}_auc": area.value for channel, area in verdict.alone.items()}
    for name, verdict in pictures.items():
        metrics |= _named_auc(f"{name}_picture_auc", verdict.best)
    return metrics


def _named_auc(name: str, auc: Auc) -> dict[str, float]:
    """Return an AUC and the ends of its interval as metrics: name, `<name>_low`, `<name>_high`."""
    return {name: auc.value, f"{name}_low": auc.low, f"{name}_high": auc.high}
