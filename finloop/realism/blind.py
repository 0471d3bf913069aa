"""Choose pairs of film and animation for a blind test, build its page, and score the answers.

Stretches of film and animation are chosen by chance among those in which no other animal is near,
and only the surroundings of the animal are shown: company and place tell nothing. Both halves of a
pair have one size and are one picture, side by side: whatever codes that film codes both alike, and
no file shows by its size which half is which.
"""

import base64
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial import KDTree
from scipy.stats import binomtest

from finloop.base.arrays import Floats, Picture
from finloop.base.errors import FinloopError
from finloop.render.painter import Box

PAIRS, SECONDS = 40, 2.0  # of a test; of each clip
LEAST_PAIRS = 4  # with 3, even all answers right could be chance: the interval holds 1/2
SIDES = LEFT, RIGHT = ("left", "right")
ANSWERS = ("pair", "side", "answer", "right", "seconds")
"""Columns of an answer file: number of the pair, side of the film, side chosen, 1 where they are
the same else 0, and seconds until the answer."""

_FADE_BL, _SEEN_BL = 0.75, 0.95  # from the mass centre: where the picture fades, and ends
_ALONE_BL = 1.5  # from there on another animal lies outside what is seen
_GRID_PX = 16  # sides are multiples of it: no block of the coder lies in both halves
_MOST_PX = 768  # longest side of a half; larger crops are made smaller
_MODULUS, _FACTOR = 2**31 - 1, 16807  # of the code that hides a side from readers of the source


class LoneStretch(NamedTuple):
    """Some consecutive ticks of an animal: its scene, the first tick, and its centres.

    scene: what is seen at once, the film or an edit list. centres (ticks, 2): mass centres x, y px.
    """

    scene: int
    first: int
    centres: Floats


class BlindSource(NamedTuple):
    """Where stretches come from: the film, or the edit lists of a mode.

    table: scene, animal, tick, x_px, y_px, sorted by the first three. length_px: body length.
    shape: height and width of the picture.
    """

    table: pd.DataFrame
    length_px: float
    shape: tuple[int, int]

    def stretches_alone(self, ticks: int) -> list[LoneStretch]:
        """Return stretches of `ticks` ticks in which no other animal is near; none overlap.

        What is left over of a run of such ticks is left out at its end.
        """
        keys = self.table[["scene", "animal", "tick"]].to_numpy()
        places = self.table[["x_px", "y_px"]].to_numpy(float)
        near = _ALONE_BL * self.length_px
        # Animals of other moments are far away along a third axis.
        moment = self.table.groupby(["scene", "tick"]).ngroup().to_numpy() * 2 * near
        points = np.c_[places, moment]
        is_alone = np.isinf(KDTree(points).query(points, k=2, distance_upper_bound=near)[0][:, 1])
        is_break = (np.diff(keys, axis=0) != (0, 0, 1)).any(axis=1) | (np.diff(is_alone) != 0)
        edges = [0, *(np.flatnonzero(is_break) + 1).tolist(), len(keys)]
        return [
            LoneStretch(int(keys[first, 0]), int(keys[first, 2]), places[first : first + ticks])
            for start, stop in pairwise(edges)
            if start < stop and is_alone[start]
            for first in range(start, stop - ticks + 1, ticks)
        ]

    def width_bl(self, stretch: LoneStretch) -> float:
        """Return the side [body lengths] of a square that holds all that is seen of a stretch."""
        return float(np.ptp(stretch.centres, axis=0).max()) / self.length_px + 2 * _SEEN_BL

    def crop(self, stretch: LoneStretch, side_px: int) -> "Crop":
        """Return the square crop, `side_px` wide, around the middle of the way of a stretch.

        Where it would reach beyond the picture it is moved into it.
        """
        middle = (stretch.centres.min(axis=0) + stretch.centres.max(axis=0)) / 2
        left, top = (
            min(max(round(centre - (side_px - 1) / 2), 0), side - side_px)
            for centre, side in zip(middle.tolist(), self.shape[::-1], strict=True)
        )
        box = Box(top, left, top + side_px, left + side_px)
        return Crop(stretch, box, stretch.centres - (left, top), self.length_px)


class Crop(NamedTuple):
    """What is seen of a stretch: a square box of the picture, and in it the animal's surroundings.

    centres (ticks, 2): mass centres, px of the box. length_px: body length.
    """

    stretch: LoneStretch
    box: Box
    centres: Floats
    length_px: float

    def cut_frames(
        self, frames: Iterable[Picture], size_px: int, around: Picture
    ) -> Iterator[Picture]:
        """Yield the box cut out of whole frames, one for each tick, and scaled to `size_px` px.

        The results are (size_px, size_px) or (size_px, size_px, 3) uint8. around: the level or
        colour that they fade into, (1 or 3).
        """
        y, x = np.mgrid[: self.box.bottom - self.box.top, : self.box.right - self.box.left]
        for frame, (centre_x, centre_y) in zip(frames, self.centres, strict=True):
            distance_bl = np.hypot(x - centre_x, y - centre_y) / self.length_px
            seen = np.clip((_SEEN_BL - distance_bl) / (_SEEN_BL - _FADE_BL), 0, 1)
            crop = frame[self.box.slices]
            share = seen if crop.ndim == 2 else seen[..., None]
            faded = np.rint(around + share * (crop - around.astype(float))).astype(np.uint8)
            yield _resize(faded, size_px)


class BlindPair(NamedTuple):
    """A crop of film and one of animation, the side [px] of both, and on which side the film is."""

    film: Crop
    animation: Crop
    size_px: int
    side: str


def choose_pairs(
    film: BlindSource, animation: BlindSource, ticks: int, seed: int, most: int = PAIRS
) -> list[BlindPair]:
    """Return pairs of film and animation by chance, at most `most`; half have the film left.

    ticks: of a clip. Both crops of a pair are equally wide in body lengths, at most as wide as the
    picture's shorter side. FinloopError with fewer than LEAST_PAIRS.
    """
    rng = np.random.default_rng(seed)
    filmed, animated = (source.stretches_alone(ticks) for source in (film, animation))
    count = min(len(filmed), len(animated), most)
    if count < LEAST_PAIRS:
        raise FinloopError(
            f"{count} pairs for a blind test: in {len(filmed)} stretches of film and "
            f"{len(animated)} of animation, each of {ticks} frames, is an animal alone",
            f"{LEAST_PAIRS} pairs or more: of fewer, even all answers right could be chance",
            "take a longer film, or one of fewer animals",
        )
    orders = (rng.permutation(len(filmed))[:count], rng.permutation(len(animated))[:count])
    sides = rng.permutation([SIDES[k % 2] for k in range(count)]).tolist()
    scale = animation.length_px / film.length_px
    widest = min(film.shape) * min(1.0, 1 / scale)  # px of the film
    pairs = []
    for k, other, side in zip(*orders, sides, strict=True):
        width = max(film.width_bl(filmed[k]), animation.width_bl(animated[other]))
        film_px = int(min(math.ceil(width * film.length_px / _GRID_PX), widest // _GRID_PX))
        film_px *= _GRID_PX
        drawn_px = round(film_px * scale)
        size_px = max(min(film_px, drawn_px, _MOST_PX) // _GRID_PX, 1) * _GRID_PX
        crops = film.crop(filmed[k], film_px), animation.crop(animated[other], drawn_px)
        pairs.append(BlindPair(*crops, size_px, side))
    return pairs


def join_halves(
    film: Iterable[Picture], animation: Iterable[Picture], pair: BlindPair, around: Picture
) -> Iterator[Picture]:
    """Yield the frames of a pair, (size_px, 2 size_px + 16) or with 3 colours, uint8.

    film, animation: whole frames, (h, w) or (h, w, 3) uint8, of the two stretches. around: the
    level or colour, (1 or 3) uint8, that both fade into.
    """
    halves = [
        crop.cut_frames(frames, pair.size_px, around)
        for crop, frames in ((pair.film, film), (pair.animation, animation))
    ]
    for first, second in zip(*(halves if pair.side == LEFT else halves[::-1]), strict=True):
        gap = np.empty_like(first[:, :_GRID_PX])
        gap[:] = around
        yield np.hstack([first, gap, second])


def _resize(crop: Picture, size_px: int) -> Picture:
    """Return a square crop scaled to `size_px` px a side; the crop itself if it has that size."""
    if len(crop) == size_px:
        return crop
    smaller = cv2.INTER_AREA if size_px < len(crop) else cv2.INTER_CUBIC
    return cv2.resize(crop, (size_px, size_px), interpolation=smaller)


# --- the page


def encode_side(side: str, rng: np.random.Generator) -> int:
    """Return a number from which the page finds a side, but which does not show it to a reader."""
    while True:
        code = int(rng.integers(1, _MODULUS))
        if SIDES[code * _FACTOR % _MODULUS % 2] == side:
            return code


def build_blind_page(
    films: Sequence[bytes], sides: Sequence[str], mode: str, rate_hz: float, seed: int
) -> str:
    """Return the HTML of the test: one file that asks, counts, and saves the answers.

    films: an MP4 for each pair, both halves side by side. sides: of the film. mode: of the
    animation, named in the answer file. seed: of the codes that hide the sides.
    """
    rng = np.random.default_rng(seed)
    content = {
        "mode": mode, "columns": ANSWERS, "factor": _FACTOR, "modulus": _MODULUS,
        "pairs": [
            {"code": encode_side(side, rng), "film": base64.b64encode(film).decode()}
            for film, side in zip(films, sides, strict=True)
        ],
    }  # fmt: skip
    page = Path(__file__).with_name("blind.html").read_text(encoding="utf-8")
    for name, value in {
        "count": str(len(films)),
        "seconds": f"{SECONDS:g}",
        "rate": escape(f"{rate_hz:.3g}"),
        "content": json.dumps(content, separators=(",", ":")),
    }.items():
        page = page.replace(f"{{{{{name}}}}}", value)
    return page


# --- the answers


class Score(NamedTuple):
    """How many of some answers are right, and the 95 % interval of their share (Wilson, 1927)."""

    right: int
    answers: int
    low: float
    high: float

    @property
    def sentence(self) -> str:
        """Return a sentence that says whether film and animation can be told apart."""
        if self.low > 0.5:
            return "Film and animation can be told apart."
        if self.high < 0.5:
            return "The two look different, but the animation is taken for the film."
        return (
            "This does not show that they can be told apart; the true share may be as high as "
            f"{self.high:.0%}."
        )


def score_answers(right: int, answers: int) -> Score:
    """Return the share of right answers with its 95 % interval. ValueError without an answer."""
    interval = binomtest(right, answers).proportion_ci(0.95, method="wilson")
    return Score(right, answers, float(interval.low), float(interval.high))
