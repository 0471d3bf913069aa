"""The painter: pictures of a fish laid over the empty tank, turned, scaled and cross-faded.

What an edit list asks for (fish paper Figs. 16, 18). Everything is premultiplied by alpha and stays
in floating point until the canvas, so that a pixel is rounded once:

    F = (1 − w) A + w B        the cross-fade of two pictures A, B, w the partner's share
    canvas = F + (1 − alpha of F) · tank

A and B are sampled with the cubic kernel of Keys (a = −1/2), which gives back every polynomial up
to the second degree: a shift by a part of a pixel moves the mass centre by exactly that part, and
no shift at all changes nothing. Its overshoots are cut off: 0 ≤ colour ≤ alpha ≤ 255, so that no
fringe shines at the outline and nothing overflows.

Coordinates in px, x right, y down, pixel centres at integers; angles anticlockwise as seen.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import cv2
import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

from finloop.base.cutout import Cutout
from finloop.errors import FinloopError

Image = NDArray[np.uint8]
_ONE = np.float32(1)
_PAD = 3  # transparent pixels around a picture: what the kernel reads beyond it


class Box(NamedTuple):
    """A rectangle of the canvas, half open; empty where bottom ≤ top or right ≤ left."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def of(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def empty(self) -> bool:
        """Whether there is nothing in it."""
        return self.bottom <= self.top or self.right <= self.left

    def within(self, shape: tuple[int, ...]) -> "Box":
        """The part of it that lies on a canvas of this shape."""
        top, bottom = (min(max(edge, 0), shape[0]) for edge in (self.top, self.bottom))
        left, right = (min(max(edge, 0), shape[1]) for edge in (self.left, self.right))
        return Box(top, left, bottom, right)

    @classmethod
    def around(cls, boxes: Iterable["Box"]) -> "Box":
        """The smallest one that holds all of them."""
        tops, lefts, bottoms, rights = zip(*boxes, strict=True)
        return cls(min(tops), min(lefts), max(bottoms), max(rights))


class Picture(NamedTuple):
    """A fish to draw: pixels (h, w, 2 or 4) uint8 with a transparent rim, premultiplied.

    near: (h, w) uint8, 0 where all that the kernel reads, between a pixel and the next, is
    transparent. x_px, y_px: its mass centre, in its own pixels. Made by `picture`.
    """

    pixels: Image
    near: Image
    x_px: float
    y_px: float


class Turned(NamedTuple):
    """A picture as it is to be drawn, turned about its mass centre."""

    picture: Picture
    rotation_deg: float = 0.0
    scale: float = 1.0


def picture(pixels: Image, x_px: float, y_px: float) -> Picture:
    """A picture from a cut-out (h, w, 2 or 4) uint8 whose mass centre is (x_px, y_px) of it."""
    rim = (_PAD, _PAD)
    padded = np.pad(pixels, (rim, rim, (0, 0)))
    alpha = np.ascontiguousarray(padded[..., -1])
    near = cv2.dilate(alpha, np.ones((4, 4), np.uint8), anchor=(1, 1))  # pixels −1, 0, 1, 2
    return Picture(padded, near, x_px + _PAD, y_px + _PAD)


class Painter:
    """A canvas to draw on, again and again; only what was drawn is wiped.

    Attributes
    ----------
    floor
        (H, W, 1 or 3) uint8, what the canvas is without fish. Whoever draws on it says where, by
        `touch`.
    canvas
        The same, with fish.
    """

    def __init__(self, background: Image, colour: bool = False) -> None:
        """Take the empty tank, (H, W) or (H, W, 3); `colour` makes a grey one RGB."""
        floor = background if background.ndim == 3 else background[..., None]
        if colour and floor.shape[2] == 1:
            floor = floor.repeat(3, axis=2)
        self.floor = np.array(floor, order="C")
        self.canvas = self.floor.copy()
        self._touched: list[Box] = []

    @property
    def frame(self) -> Image:
        """The canvas as (H, W) or (H, W, 3); a view."""
        return self.canvas if self.canvas.shape[2] == 3 else self.canvas[..., 0]

    def touch(self, box: Box) -> None:
        """Say that the canvas is not the floor there any more, or will not be."""
        if not box.empty:
            self._touched.append(box)

    def wipe(self) -> None:
        """Make the canvas the floor again."""
        for box in self._touched:
            self.canvas[box.of] = self.floor[box.of]
        self._touched.clear()

    def show(self, one: "Placed") -> Box:
        """The floor with this fish alone; where it is."""
        self.wipe()
        return self.draw(*one)

    def draw(
        self,
        x_px: float,
        y_px: float,
        fish: Turned,
        partner: Turned | None = None,
        weight: float = 0.0,
    ) -> Box:
        """Draw a fish with its mass centre at (x_px, y_px); what lies outside is cut off.

        `partner` is cross-faded into it with the share `weight` (0 … 1). Returns what was touched.
        """
        other, share = (partner, weight) if partner is not None else (fish, 0.0)
        if (
            max(fish.picture.pixels.shape[2], other.picture.pixels.shape[2])
            > self.canvas.shape[2] + 1
        ):
            raise ValueError("a coloured fish needs a coloured canvas")
        shown = [one for one, w in ((fish, 1 - share), (other, share)) if w > 0]
        box = Box.around(_extent(x_px, y_px, one) for one in shown).within(self.canvas.shape)
        if not box.empty:
            _lay(
                self.canvas, box,
                fish.picture.pixels, fish.picture.near, _inverse(x_px, y_px, fish),
                other.picture.pixels, other.picture.near, _inverse(x_px, y_px, other), share,
            )  # fmt: skip
            self.touch(box)
        return box


def _axes(fish: Turned) -> tuple[float, float]:
    """Cosine and sine of the turn; of whole turns exactly 1 and 0."""
    angle = math.radians(math.remainder(fish.rotation_deg, 360.0))
    return math.cos(angle), math.sin(angle)


def _inverse(x_px: float, y_px: float, fish: Turned) -> tuple[float, ...]:
    """u = m0 x + m1 y + m2, v = m3 x + m4 y + m5: the picture's pixel (u, v) seen at (x, y)."""
    cos, sin = (part / fish.scale for part in _axes(fish))
    u, v = fish.picture.x_px, fish.picture.y_px
    return cos, -sin, u - cos * x_px + sin * y_px, sin, cos, v - sin * x_px - cos * y_px


def _extent(x_px: float, y_px: float, fish: Turned) -> Box:
    """Where a picture can leave a trace: its corners, turned; the kernel reaches 2 px beyond."""
    cos, sin = (part * fish.scale for part in _axes(fish))
    (height, width), reach = fish.picture.pixels.shape[:2], _PAD - 2
    us = [edge - fish.picture.x_px for edge in (reach, width - 1 - reach)]
    vs = [edge - fish.picture.y_px for edge in (reach, height - 1 - reach)]
    xs = [x_px + cos * u + sin * v for u in us for v in vs]
    ys = [y_px - sin * u + cos * v for u in us for v in vs]
    return Box(
        math.ceil(min(ys)), math.ceil(min(xs)), math.floor(max(ys)) + 1, math.floor(max(xs)) + 1
    )


@njit(cache=True, nogil=True)
def _keys(t):  # type: ignore[no-untyped-def]
    """Weights of the pixels −1, 0, 1, 2 for a place t in [0, 1) after pixel 0 (Keys, a = −1/2)."""
    return (
        np.float32(((2 - t) * t - 1) * t / 2),
        np.float32(((3 * t - 5) * t * t + 2) / 2),
        np.float32(((4 - 3 * t) * t + 1) * t / 2),
        np.float32((t - 1) * t * t / 2),
    )


@njit(cache=True, nogil=True)
def _sample(pixels, near, u, v):  # type: ignore[no-untyped-def]
    """Red, green, blue (grey: thrice), alpha of a picture at (u, v), 0 ≤ colour ≤ alpha ≤ 255."""
    height, width, channels = pixels.shape
    column, row = math.floor(u), math.floor(v)
    red = green = blue = alpha = np.float32(0)
    inside = column >= 1 and row >= 1 and column <= width - 3 and row <= height - 3
    if inside and near[row, column]:
        across, down = _keys(u - column), _keys(v - row)
        for j in range(4):
            r = g = b = a = np.float32(0)
            y = row - 1 + j
            for i in range(4):
                x, weight = column - 1 + i, across[i]
                r += weight * pixels[y, x, 0]
                a += weight * pixels[y, x, channels - 1]
                if channels == 4:
                    g += weight * pixels[y, x, 1]
                    b += weight * pixels[y, x, 2]
            red += down[j] * r
            green += down[j] * g
            blue += down[j] * b
            alpha += down[j] * a
        if channels == 2:
            green = blue = red
        # Where alpha overshoots, the colour goes with it: a fish of the tank's colour stays unseen.
        alpha, share = max(alpha, np.float32(0)), min(np.float32(255) / max(alpha, _ONE), _ONE)
        alpha *= share
        red = min(max(red * share, np.float32(0)), alpha)
        green = min(max(green * share, np.float32(0)), alpha)
        blue = min(max(blue * share, np.float32(0)), alpha)
    return red, green, blue, alpha


@njit(cache=True, nogil=True)
def _lay(canvas, box, fish, fish_near, m, partner, partner_near, n, share):  # type: ignore[no-untyped-def]
    """Lay (1 − share) fish + share partner over the canvas; m, n: see `_inverse`."""
    top, left, bottom, right = box
    keep, share = np.float32(1 - share), np.float32(share)
    for y in range(top, bottom):
        for x in range(left, right):
            red = green = blue = alpha = np.float32(0)
            if keep > 0:
                u, v = m[0] * x + m[1] * y + m[2], m[3] * x + m[4] * y + m[5]
                r, g, b, a = _sample(fish, fish_near, u, v)
                red, green, blue, alpha = keep * r, keep * g, keep * b, keep * a
            if share > 0:
                u, v = n[0] * x + n[1] * y + n[2], n[3] * x + n[4] * y + n[5]
                r, g, b, a = _sample(partner, partner_near, u, v)
                red += share * r
                green += share * g
                blue += share * b
                alpha += share * a
            if alpha > 0:
                through = 1 - alpha / np.float32(255)
                pixel = canvas[y, x]
                pixel[0] = np.uint8(red + through * pixel[0] + np.float32(0.5))
                if canvas.shape[2] == 3:
                    pixel[1] = np.uint8(green + through * pixel[1] + np.float32(0.5))
                    pixel[2] = np.uint8(blue + through * pixel[2] + np.float32(0.5))


class Store(Protocol):
    """Cut-outs by number, see `finloop.base.cutout.Cutouts`."""

    def __len__(self) -> int: ...
    def __getitem__(self, row: int) -> Cutout: ...


class Shelf(NamedTuple):
    """Cut-outs of one kind with their mass centres in the film, (n, 2) px."""

    store: Store
    centres_px: NDArray[np.float64]


class Gallery:
    """Pictures by kind and number, the most recent `keep` of them held."""

    def __init__(self, shelves: Mapping[str, Shelf], keep: int = 512) -> None:
        self.shelves = shelves
        self.picture = lru_cache(keep)(self._picture)

    def _picture(self, kind: str, number: int) -> Picture:
        cutout = self.shelves[kind].store[number]
        x, y = self.shelves[kind].centres_px[number]
        return picture(cutout.pixels, x - cutout.x0_px, y - cutout.y0_px)

    def turned(self, kind: str, number: int, rotation_deg: float, scale: float) -> Turned:
        """A picture, turned."""
        return Turned(self.picture(kind, number), rotation_deg, scale)


class Placed(NamedTuple):
    """What a row of an edit list wants drawn; the arguments of `Painter.draw`."""

    x_px: float
    y_px: float
    fish: Turned
    partner: Turned | None
    weight: float


def placed(edit: pd.DataFrame, gallery: Gallery) -> Iterator[Placed]:
    """Row by row what an edit list (schema EDIT) wants drawn.

    Raises
    ------
    FinloopError
        At once, listing all that cannot be drawn.
    """
    _refuse(edit, gallery.shelves)

    def given() -> Iterator[Placed]:
        own = ("kind", "source", "rotation_deg", "scale")
        other = ("partner_kind", "partner", "partner_rotation_deg", "partner_scale")
        columns = (edit[list(names)].itertuples(index=False) for names in (own, other))
        where = edit[["x_px", "y_px", "weight"]].itertuples(index=False)
        for fish, partner, (x, y, weight) in zip(*columns, where, strict=True):
            second = gallery.turned(*partner) if weight > 0 else None
            yield Placed(x, y, gallery.turned(*fish), second, weight)

    return given()


def _refuse(edit: pd.DataFrame, shelves: Mapping[str, Shelf]) -> None:
    """Raise if an edit list cannot be drawn: every kind of problem, each with its first tick."""
    do = "make the edit list again: `dvc repro --force animate`"
    if edit.empty:
        raise FinloopError("the edit list is empty", "at least one tick", do)
    problems: list[str] = []

    def refuse(bad: NDArray[np.bool_] | pd.Series, column: str, wanted: str) -> None:
        wrong = edit[np.asarray(bad, bool)]
        if len(wrong):
            tick, value = wrong.iloc[0]["tick"], wrong.iloc[0][column]
            more = f" (and at {len(wrong) - 1} more ticks)" if len(wrong) > 1 else ""
            problems.append(f"tick {tick}: {column} is {value}, wanted {wanted}{more}")

    sizes = {kind: len(shelf.store) for kind, shelf in shelves.items()}
    refuse(edit["tick"] != np.arange(len(edit)), "tick", "0, 1, 2, …")
    for column in ("x_px", "y_px"):
        refuse(~np.isfinite(edit[column].to_numpy(float)), column, "a place")
    refuse(~edit["weight"].between(0, 1), "weight", "0 … 1")
    fades = (edit["weight"] > 0).to_numpy()
    for prefix, number, used in (
        ("", "source", np.full(len(edit), True)),
        ("partner_", "partner", fades),
    ):
        kind, row = edit[f"{prefix}kind"], edit[number].fillna(-1).to_numpy(int)
        refuse(used & ~kind.isin(list(sizes)), f"{prefix}kind", " or ".join(sizes))
        for name, size in sizes.items():
            bad = used & (kind == name) & ((row < 0) | (row >= size))
            refuse(bad, number, f"a {name}, 0 … {size - 1}")
        scale = edit[f"{prefix}scale"].to_numpy(float)
        refuse(used & ~(np.isfinite(scale) & (scale > 0)), f"{prefix}scale", "more than 0")
        angle = edit[f"{prefix}rotation_deg"].to_numpy(float)
        refuse(used & ~np.isfinite(angle), f"{prefix}rotation_deg", "an angle")
    if problems:
        raise FinloopError(
            "the edit list cannot be drawn:\n    " + "\n    ".join(problems),
            "pictures that exist, at places and of sizes that can be drawn",
            do,
        )


class Steps:
    """How much the picture changes from one drawn frame to the next (Eq. 5 on what is shown).

    ‖F_t − F_(t−1)‖₂ over the whole picture in grey levels, colours by their root mean square. It
    grows with the way swum as with the change of shape. `film_steps` measures the film so.
    """

    def __init__(self, painter: Painter) -> None:
        self._painter = painter
        self._last: tuple[Box, Image] | None = None

    def to(self, box: Box) -> float:
        """The step to what is on the canvas now, a fish in `box` alone; NaN at the first."""
        canvas, last = self._painter.canvas, self._last
        self._last = box, canvas[box.of].copy()
        if last is None:
            return math.nan
        before, patch = last
        filled = [one for one in (before, box) if not one.empty]
        if not filled:
            return 0.0
        both = Box.around(filled)
        was = self._painter.floor[both.of].copy()
        if not before.empty:
            was[before.top - both.top :, before.left - both.left :][
                : patch.shape[0], : patch.shape[1]
            ] = patch
        change = canvas[both.of].astype(np.float32) - was
        return math.sqrt(float(np.vdot(change, change)) / canvas.shape[2])


def film_steps(
    painter: Painter, gallery: Gallery, kind: str, tracks: pd.DataFrame, most: int = 400
) -> NDArray[np.float64]:
    """The steps of the film itself: its fish drawn alone at their own places, frame after frame.

    tracks: track_id, frame and mass centre, a row per picture of this `kind`; at most so many pairs
    of consecutive frames, spread over the film.
    """
    track, frame = (tracks[name].to_numpy() for name in ("track_id", "frame"))
    first = np.flatnonzero((np.diff(track) == 0) & (np.diff(frame) == 1))
    chosen = first[np.unique(np.linspace(0, len(first) - 1, min(most, len(first))).astype(int))]
    places = tracks[["x_px", "y_px"]].to_numpy(float)
    found = []
    for pair in zip(chosen, chosen + 1, strict=True):
        steps = Steps(painter)
        for row in pair:
            x, y = places[row]
            painter.wipe()
            step = steps.to(painter.draw(x, y, Turned(gallery.picture(kind, int(row)))))
        found.append(step)
    painter.wipe()
    return np.array(found)


def step_numbers(drawn: Sequence[float], film: NDArray[np.float64]) -> dict[str, float]:
    """Metrics: the steps of an animation beside those of the film itself."""
    steps = np.asarray(drawn)[1:]
    if not len(steps) or not len(film):
        return {}
    return {
        "picture_step_median_grey": float(np.median(steps)),
        "picture_step_p95_grey": float(np.quantile(steps, 0.95)),
        "film_picture_step_median_grey": float(np.median(film)),
        "film_picture_step_p95_grey": float(np.quantile(film, 0.95)),
        "picture_step_ratio": float(np.median(steps) / np.median(film)),
        "picture_steps_above_film_p95_share": float(np.mean(steps > np.quantile(film, 0.95))),
    }
