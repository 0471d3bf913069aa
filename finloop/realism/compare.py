"""Comparisons: an animation with its film, and one half of the film with the other."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.features.table import infer_delta_frames
from finloop.realism.auc import Auc, Scores, auc
from finloop.realism.classifier import score_held_out_windows
from finloop.realism.instrument import Swimming
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import (
    AGAIN,
    CHANNELS,
    HALVES,
    Blocks,
    Cutting,
    Ticks,
    Windows,
    convert_to_frames,
    cut_windows,
    equal_blocks,
)  # fmt: skip

Sides = dict[str, tuple[Windows, Windows]]
"""Pairs of sets of windows by name, the film's set first."""

LEAST = 2
"""Windows, at least, that a block tests and learns from."""


@dataclass(frozen=True)
class Sample:
    """The film with which animations are compared, and how both are cut into windows.

    film: drawn and measured again; frame_s (rows,): time in s of each row of the feature table;
    largest: greatest motion area in `film`, in squares of BL; rate_hz: frames per second; delta: Δ
    in frames.
    """

    film: Swimming
    frame_s: Floats
    largest: float
    rate_hz: float
    delta: int
    p: RealismSettings

    @property
    def cut(self) -> Cutting:
        """Return the length, stride and step of the windows, in frames."""
        p = self.p
        return convert_to_frames(p.window_deltas, p.stride, p.step, self.delta)

    def cut_windows(self, swimming: Swimming, film: Blocks, part: Mask | None = None) -> Windows:
        """Cut film or animation into windows, each assigned to a block of the film's time.

        swimming: n measured ticks; film: the blocks; part (n,): the ticks to use, None for all.
        """
        p, gap = self.p, self.p.gap * self.delta / self.rate_hz
        plays = swimming.row >= 0
        time_s = self.frame_s[np.where(plays, swimming.row, 0)]
        own = equal_blocks(swimming.time_s, p.cross_validation_folds)
        chunk = max(1, round(p.cluster * self.delta))
        tick = np.round(swimming.time_s * self.rate_hz).astype(np.int64)
        block = np.where(plays, film.block_numbers(time_s), own.block_numbers(swimming.time_s))
        near = np.where(plays[:, None], film.near(time_s, gap), own.near(swimming.time_s, gap))
        cluster = np.where(plays, swimming.row // chunk, -1 - tick // chunk)
        used = np.arange(len(plays)) if part is None else np.flatnonzero(part)
        ticks = Ticks(block[used], near[used], cluster[used])
        table = swimming.table.iloc[used]
        result = cut_windows(table, ticks, self.cut, self.rate_hz, self.largest)
        return replace(result, first=used[result.first])

    def blocks(self, times: int = 1) -> Blocks:
        """Divide the film's time into blocks of equally many rows, in one or several sequences."""
        return equal_blocks(self.frame_s[self.film.row], self.p.cross_validation_folds, times)

    def windows_beside_film(self, animation: Swimming) -> tuple[Windows, Windows]:
        """Return the windows of the film and the windows of an animation made from it."""
        blocks = self.blocks()
        return self.cut_windows(self.film, blocks), self.cut_windows(animation, blocks)

    def halves(self) -> tuple[Windows, Windows]:
        """Return the windows of the film's first half and those of its second half.

        Each half is divided into the same number of blocks. The halves are halves of time: each
        shows the same fish, as an animation does. From halves by tracks, a classifier would learn
        to distinguish the fish.
        """
        film, blocks = self.film, self.blocks(2)
        early = self.frame_s[film.row] < blocks.edges[self.p.cross_validation_folds]
        return self.cut_windows(film, blocks, early), self.cut_windows(film, blocks, ~early)

    def comparison_windows(self, measured: Mapping[str, Swimming], features: pd.DataFrame) -> Sides:
        """Return the two sets of windows of every comparison, by name.

        The names are the modes, each beside the film; HALVES, the film's halves; AGAIN, the film as
        filmed beside the film drawn again. measured: each mode's animation; features: feature table
        of the film.
        """
        film = self.film
        before = features.iloc[film.row].assign(track_id=film.table["track_id"].to_numpy())
        filmed = self.cut_windows(replace(film, table=before), self.blocks())
        return {
            **{mode: self.windows_beside_film(animation) for mode, animation in measured.items()},
            HALVES: self.halves(),
            AGAIN: (filmed, self.cut_windows(film, self.blocks())),
        }


def film_sample(
    film: Swimming, features: pd.DataFrame, rate_hz: float, p: RealismSettings
) -> Sample:
    """Return the `Sample` of a film: what every comparison of an animation with this film needs.

    film: drawn and measured again; features: columns of `FEATURES`, of the whole film.
    """
    frame_s, largest = features["frame"].to_numpy(float) / rate_hz, film.table["motion_area"].max()
    return Sample(film, frame_s, float(largest), rate_hz, infer_delta_frames(features), p)


@dataclass(frozen=True)
class Verdict:
    """How well a classifier distinguishes two sets of windows.

    whole: area by all channels; alone: channel → area by that channel; importance: channel → loss
    of area when it is shuffled; scores: by all channels, windows of the first set first.
    """

    whole: Auc
    alone: dict[str, Auc]
    importance: dict[str, float]
    scores: Scores


def classify_windows(
    sides: tuple[Windows, Windows], p: RealismSettings, alone: bool = True
) -> Verdict:
    """Train classifiers on two sets of windows and return how well they distinguish them.

    sides: the film's windows first; alone: whether to classify by each channel by itself, too.
    FinloopError if a block has too few windows of either set to test and to learn from.
    """
    _require_enough_windows(sides, p)
    every = tuple(range(len(CHANNELS)))
    answer = score_held_out_windows(*sides, p, every)
    whole = auc(answer.scores)
    single = {
        CHANNELS[part]: auc(score_held_out_windows(*sides, p, (part,)).scores)
        for part in (every if alone else ())
    }
    importance = {name: whole.value - auc(part).value for name, part in answer.shuffled.items()}
    return Verdict(whole, single, importance, answer.scores)


def _require_enough_windows(sides: tuple[Windows, Windows], p: RealismSettings) -> None:
    """Raise FinloopError if windows are too few to train and test a classifier in every block."""
    film, beside = sides
    folds = p.cross_validation_folds
    tested, learnt = np.bincount(film.block, minlength=folds), (~film.near).sum(axis=0)
    learnt_beside = (~beside.near).sum(axis=0)
    if min(tested.min(), learnt.min(), learnt_beside.min()) < LEAST or len(beside.x) < folds:
        raise FinloopError(
            f"the blocks test {tested.tolist()} windows of the film, and learn from "
            f"{learnt.tolist()} of the film and {learnt_beside.tolist()} of the other side",
            f"at least {LEAST} of each in each of {folds} blocks",
            "a longer film, fewer realism.cross_validation_folds, or a shorter "
            "realism.window_deltas",
        )


def verdict_table(verdicts: dict[str, Verdict]) -> pd.DataFrame:
    """Return the verdicts as a table, a row per comparison and channel; channel "all" comes first.

    Columns: compared, channel; auc, low, high: the area and its 95 % interval; lost: area lost when
    the channel is shuffled, NaN for "all".
    """
    rows = []
    for name, result in verdicts.items():
        for channel, area in {"all": result.whole, **result.alone}.items():
            rows.append((name, channel, *area, result.importance.get(channel, np.nan)))
    return pd.DataFrame(rows, columns=["compared", "channel", "auc", "low", "high", "lost"])


def auc_metrics(verdicts: dict[str, Verdict]) -> dict[str, float]:
    """Return the areas as flat metrics: `<name>_auc`, `_auc_low`, `_auc_high`, `_<channel>_auc`.

    verdicts: by the name of the comparison. Low and high are the ends of the 95 % interval.
    """
    flat: dict[str, float] = {}
    for name, result in verdicts.items():
        flat |= {
            f"{name}_auc": result.whole.value,
            f"{name}_auc_low": result.whole.low,
            f"{name}_auc_high": result.whole.high,
            **{f"{name}_{channel}_auc": area.value for channel, area in result.alone.items()},
        }
    return flat
