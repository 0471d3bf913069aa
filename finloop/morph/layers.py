"""Morphs of drawings in layers (curve paper §4.1, Figs. 4, 5): a face is outline, eyes, mouth.

Contours of the same id form a pair. Coordinates are rounded before folds are counted, so the counts
hold for the coordinates in the files.
"""

from collections.abc import Callable
from dataclasses import replace
from math import ceil, log10
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Ints, Points
from finloop.base.drawing import Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve
from finloop.morph.folds import folds, stays_simple
from finloop.morph.linear import linear, physical
from finloop.morph.simple import simple_frames

METHODS = ("linear", "physical", "simple")
DIGITS = (6, 9, 12)  # significant digits of the larger side: the grid is 1e-5 of it or finer
REACH = 1000  # sides of the picture: the largest coordinate of a contour
MOST_FRAMES, LEAST_POINTS, MOST_POINTS = 10_000, 8, 16_384


class Scales(NamedTuple):
    """Settings of the linear morph: how many scales of details it omits, and their wavelet.

    level: None omits none, and needs no wavelet.
    """

    level: int | None = None
    wavelet: str = "coif2"


class Physics(NamedTuple):
    """Settings of the physical morph: elastic constant e₀, damping c and density ρ (`mass`).

    By default the curve swings a little and settles.
    """

    elastic: float = 1.0
    damping: float = 8.0
    mass: float = 1.0


def morph(
    a: Drawing,
    b: Drawing,
    method: str,
    frames: int,
    points: int = 256,
    scales: Scales = Scales(),  # noqa: B008  (immutable)
    physics: Physics = Physics(),  # noqa: B008  (immutable)
) -> Morph:
    """Return the morph of drawing `a` into drawing `b`, which is fitted into the picture of `a`.

    FinloopError if the drawings do not match, a number is out of range, or the method cannot morph
    a contour; the message names it.

    Parameters
    ----------
    a, b
        Drawings with the same ids, each contour closed in both or open in both.
    method
        One of METHODS; `simple` keeps every contour free of folds.
    frames
        Number of frames, at least 2, both ends included.
    points
        Points of every contour, at least 8; a power of two for `physical`, and for `linear` with a
        level.
    scales, physics
        Settings of the linear and the physical morph.
    """
    _check_numbers(method, frames, points)
    check_pairs(a, b)
    b = fit_drawing(b, a.width, a.height)
    side = max(a.width, a.height)
    make: dict[str, Callable[[Curve, Curve], Points]] = {
        "linear": lambda a, b: linear(a, b, frames, points, *scales),
        "physical": lambda a, b: physical(a, b, frames, points, *physics),
        "simple": lambda a, b: simple_frames(a, b, frames, points),
    }
    stacks = {
        name: _contour(name, curve, b.curves[name], side, make[method])
        for name, curve in a.curves.items()
    }
    closed = {name: curve.closed for name, curve in a.curves.items()}
    decimals, layers, counts = _round_layers(stacks, closed, side, method == "simple")
    return Morph(
        tau=np.linspace(0, 1, frames),
        layers=layers,
        closed=closed,
        folds=counts,
        continuous={name: stays_simple(stack, closed[name]) for name, stack in layers.items()},
        styles=b.styles | a.styles,
        width=a.width,
        height=a.height,
        decimals=decimals,
    )


def _round_layers(
    stacks: dict[str, Points], closed: dict[str, bool], side: float, simple_only: bool
) -> tuple[int, dict[str, Points], dict[str, Ints]]:
    """Return decimals, rounded layers and their folds, on the coarsest grid of DIGITS.

    `simple_only` chooses the coarsest grid without folds, if there is one: parts that are nearer to
    each other than the grid need a finer grid.
    """
    for digits in DIGITS:
        decimals = digits - ceil(log10(side))
        layers = {name: np.round(stack, decimals) + 0.0 for name, stack in stacks.items()}  # no −0
        counts = {name: folds(stack, closed[name]) for name, stack in layers.items()}
        if not simple_only or not any(count.any() for count in counts.values()):
            break
    return decimals, layers, counts


def _contour(
    name: str, a: Curve, b: Curve, side: float, make: Callable[[Curve, Curve], Points]
) -> Points:
    """Return the frames (frames, points, 2) of one pair of contours; errors name it."""
    try:
        stack = make(a, b)
    except FinloopError as error:
        raise FinloopError(f"contour {name!r}: {error.came}", error.wanted, error.do) from error
    if not (np.abs(stack) <= REACH * side).all():
        raise FinloopError(
            f"contour {name!r} reaches {np.abs(stack).max():g} in a picture {side:g} large",
            f"at most {REACH} times its size",
            "move the contour into the picture, or set the viewBox around the contours",
        )
    return stack


def there_and_back(morph: Morph) -> Morph:
    """Return the morph followed by its reverse, so that it repeats without a jump.

    The frames at both ends are not repeated: f frames become 2 f − 2.
    """

    def both(values: NDArray) -> NDArray:
        return np.concatenate([values, values[-2:0:-1]])

    return replace(
        morph,
        tau=both(morph.tau),
        layers={name: both(stack) for name, stack in morph.layers.items()},
        folds={name: both(count) for name, count in morph.folds.items()},
    )


def fit_drawing(drawing: Drawing, width: float, height: float) -> Drawing:
    """Return the drawing scaled to fit a picture and centred there, as SVG fits a viewBox.

    width, height: of the picture, in the unit of its coordinates.
    """
    scale = min(width / drawing.width, height / drawing.height)
    if scale == 1 and (drawing.width, drawing.height) == (width, height):
        return drawing
    shift = (np.array([width, height]) - scale * np.array([drawing.width, drawing.height])) / 2
    curves = {
        name: Curve(curve.points * scale + shift, curve.closed)
        for name, curve in drawing.curves.items()
    }
    return Drawing(curves, width, height, drawing.styles)


def _check_numbers(method: str, frames: int, points: int) -> None:
    if method not in METHODS:
        raise FinloopError(
            f"the method {method!r}", f"one of {', '.join(METHODS)}", "choose one of these"
        )
    check_sizes("morph", frames, points, 2)


def check_sizes(what: str, frames: int, points: int, least_frames: int) -> None:
    """Raise FinloopError if the number of frames, or of points of a contour, is out of range.

    what: the noun for the message, such as "morph"; least_frames: fewest frames allowed.
    """
    for name, count, least, most, usual in (
        (f"a {what} of {frames} frames", frames, least_frames, MOST_FRAMES, "24 frames or more"),
        (f"contours of {points} points", points, LEAST_POINTS, MOST_POINTS, "128 points"),
    ):
        if not least <= count <= most:
            raise FinloopError(name, f"{least} … {most}", f"set {usual}")


def check_pairs(a: Drawing, b: Drawing) -> None:
    """Raise FinloopError, with all problems, if the contours of two drawings form no pairs."""
    wrong = [
        f"{', '.join(map(repr, lone[:5]))}{' …' * (len(lone) > 5)} only in the {which}"
        for which, lone in (
            ("first", [name for name in a.curves if name not in b.curves]),
            ("second", [name for name in b.curves if name not in a.curves]),
        )
        if lone
    ]
    kind = {True: "closed", False: "open"}
    wrong += [
        f"{name!r} {kind[curve.closed]} in the first, {kind[not curve.closed]} in the second"
        for name, curve in a.curves.items()
        if name in b.curves and b.curves[name].closed != curve.closed
    ]
    if wrong:
        raise FinloopError(
            f"the drawings do not match: {'; '.join(wrong)}",
            "the same ids in both, each contour closed (Z) in both or open in both",
            "give the contours of a pair the same id, and close both or neither",
        )
