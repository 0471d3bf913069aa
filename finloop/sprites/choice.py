"""The choice of frames for sprites (fish paper §3.3, which makes it by hand).

Four sequences: *straight* (one full tail beat whose end meets its beginning), *slide* (gliding with
a still tail, also a loop), and the strongest *left* and *right* turns, from nearly straight through
the bend back to nearly straight. The candidate with the smallest sum of faults is chosen, so its
faults explain the choice. Only the best candidates are compared as pictures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Reals
from finloop.base.errors import FinloopError
from finloop.distance.picture import distance_pair_by_pair, successive_distances
from finloop.features.swimming_type import STRAIGHT
from finloop.sprites.candidates import beats, slides, substitute_beats, substitute_turns, turns
from finloop.sprites.settings import SpritesSettings
from finloop.sprites.stretch import SIDES, WORDS, FrameRun, cycle_heading, parse_frame_run

_SAMPLE = 200  # frames that give the clip's median sharpness; more do not change it

Look = Callable[[NDArray[np.intp], Reals], NDArray[np.float32]]
"""Rows of the table of swimmers and a heading for each → pictures (n, size, size, channels) of
these fish, headed right, their mass centres in the middle, all of one length."""


@dataclass(frozen=True)
class Choice:
    """The film's frames for one sequence of sprites.

    mirrored: the frames show a turn to the other side, and the sprites are their mirror images.
    stands_in: the film has no tail beat, or no whole turn, and these frames are the best
    substitute.
    """

    stretch: FrameRun
    mirrored: bool = False
    stands_in: bool = False


def choose(
    table: pd.DataFrame, look: Look, delta: int, settings: SpritesSettings
) -> dict[str, Choice]:
    """Choose the film's frames for each sequence of `WORDS`: those of the settings, else the best.

    table: from `swimmers`; look: draws rows of it; delta: Δ in frames. A side without a turn gets
    the opposite turn, mirrored. A film without a tail beat or a whole turn gets the best
    substitute. FinloopError if the settings name frames that do not exist, or the fish never bends.
    """
    sharp = _typical_sharpness(table, look, settings)
    stretches: dict[str, Sequence[FrameRun]] = {}
    stands_in: set[str] = set()

    def best(word: str, candidates: pd.DataFrame) -> list[FrameRun]:
        return best_of_tracks(table, candidates, look, sharp, settings, loops=word not in SIDES)

    for word in WORDS:
        text = getattr(settings, f"{word}_frames")
        if text is not None:
            stretches[word] = [parse_frame_run(table, word, text, settings.hold)]
            continue
        if word in SIDES:
            candidates = turns(table, SIDES[word], settings)
        else:
            candidates = (beats if word == "straight" else slides)(table, delta, settings)
        stretches[word] = best(word, candidates)
    if not stretches["straight"]:
        stretches["straight"] = best("straight", substitute_beats(table, delta, settings))
        stands_in.add("straight")
    if not (stretches["left"] or stretches["right"]):
        for word, side in SIDES.items():
            stretches[word] = best(word, substitute_turns(table, side))
            stands_in.add(word)
    _check(stretches)
    choices = {
        word: Choice(s, stands_in=word in stands_in)
        for word, s in choose_combination(table, stretches, settings).items()
    }
    if "slide" not in choices:  # nothing glides: the straightest there is
        choices["slide"] = choices["straight"]
    for word, opposite in (("left", "right"), ("right", "left")):
        if word not in choices:
            choices[word] = replace(choices[opposite], mirrored=True)
    return {word: choices[word] for word in WORDS}


def _typical_sharpness(table: pd.DataFrame, look: Look, settings: SpritesSettings) -> float:
    """Return the median `sharpness` of usable frames spread over the film, else of all frames."""
    usable = np.flatnonzero(table["usable"])
    usable = usable if usable.size else np.arange(len(table))
    rows = usable[np.linspace(0, usable.size - 1, min(_SAMPLE, usable.size)).astype(int)]
    return float(np.median(sharpness(look(rows, table["heading"].to_numpy()[rows]))))


def _check(stretches: dict[str, Sequence[FrameRun]]) -> None:
    lacks = [] if stretches["straight"] else ["four frames of one track, one after the other"]
    if not (stretches["left"] or stretches["right"]):
        lacks.append("a fish that bends")
    if lacks:
        raise FinloopError(
            f"the film does not show {' nor '.join(lacks)}",
            "a fish that swims, some seconds of it",
            "take a longer film (reports/features/trajectories.png shows what was followed)",
        )


def best_of_tracks(
    table: pd.DataFrame, candidates: pd.DataFrame, look: Look, sharp: float,
    settings: SpritesSettings, *, loops: bool,
) -> list[FrameRun]:  # fmt: skip
    """Return each track's best candidate, with the faults of its pictures; the best track first.

    candidates: columns start, length and faults; sharp: the median of `sharpness` over the film;
    loops: the frame after the last should be like the first, within a natural step.
    """
    if candidates.empty:
        return []
    faults = [name for name in candidates if name not in ("start", "length")]
    cost = candidates[faults].sum(axis=1)
    number = table["track_id"].to_numpy()[candidates["start"]]
    order = cost.sort_values(kind="stable").index
    rank = cost[order].groupby(pd.Series(number, candidates.index)[order]).cumcount()
    best: dict[int, FrameRun] = {}
    for at in order[(rank < settings.candidates_per_track).to_numpy()][: settings.candidates]:
        start, n = int(candidates.at[at, "start"]), int(candidates.at[at, "length"])
        more = {}
        rows = np.arange(start, start + n + 1)
        pictures = look(
            rows, cycle_heading(table, start, n) if loops else table["heading"].to_numpy()[rows]
        )
        if loops:
            more["does not close"] = closure(pictures)
        more["soft"] = max(0.0, 1 - float(np.median(sharpness(pictures))) / sharp) / settings.soft
        track = int(table["track_id"].iat[start])
        stretch = FrameRun(
            track, int(table["frame"].iat[start]), int(table["frame"].iat[start + n - 1]),
            slice(start, start + n), candidates.loc[at, faults].to_dict() | more,
        )  # fmt: skip
        if track not in best or stretch.cost < best[track].cost:
            best[track] = stretch
    return sorted(best.values(), key=lambda s: s.cost)


def closure(pictures: Reals) -> float:
    """Return the picture distance from a loop's end to its start, over its median step.

    pictures (n + 1, size, size, channels): the n frames of the loop and the frame after them. At 1
    the loop closes as smoothly as the film plays on.
    """
    return float(distance_pair_by_pair(pictures[-1], pictures[0])) / max(
        float(np.median(successive_distances(pictures))), 1e-9
    )


def sharpness(pictures: Reals) -> Floats:
    """Return how sharp each picture is (n,): its summed squared gradient over its summed alpha.

    pictures (n, h, w, channels): values 0 … 1, alpha last.
    """
    down, right = np.diff(pictures, axis=1)[:, :, :-1], np.diff(pictures, axis=2)[:, :-1]
    return (down**2 + right**2).sum((1, 2, 3)) / np.maximum(pictures[..., -1].sum((1, 2)), 1e-9)


def choose_combination(
    table: pd.DataFrame, stretches: dict[str, Sequence[FrameRun]], settings: SpritesSettings
) -> dict[str, FrameRun]:
    """Return the best frames of each sequence: least faults together, and few changes of animal.

    stretches: the candidates of each sequence. A sequence of another track than the first one costs
    `track_change_cost`. A relative difference of `size_off` in length, contrast and area, on
    average, costs 1 more.
    """
    words = [word for word in stretches if stretches[word]]
    looks = (
        table[table["type"] == STRAIGHT]
        .groupby("track_id")[["length_px", "contrast", "area_px"]]
        .median()
        .reindex(table["track_id"].unique())
        .fillna(table[["length_px", "contrast", "area_px"]].median())
    )
    like = np.log(looks)

    def strange(a: int, b: int) -> float:
        if a == b:
            return 0.0
        difference = float(np.abs(like.loc[a] - like.loc[b]).mean())
        return settings.track_change_cost + difference / settings.size_off

    best: tuple[float, dict[str, FrameRun]] = (np.inf, {})
    for first in stretches[words[0]]:
        choice = {words[0]: first}
        total = settings.cycle_weight * first.cost
        for word in words[1:]:
            price, choice[word] = min(
                ((s.cost + strange(first.track_id, s.track_id), s) for s in stretches[word]),
                key=lambda priced: priced[0],
            )
            total += price
        if total < best[0]:
            best = (total, choice)
    return best[1]
