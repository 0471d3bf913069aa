"""Morphs of drawings in layers (curve paper §4.1, Figs. 4, 5): a face is outline, eyes, mouth.

Shapes of the same id form a pair. Coordinates are rounded before folds are counted, so the counts
hold for the coordinates in the files. Two of the paper's methods are here, linear (Eq. 4.1, Fig. 4)
and physical (Fig. 5); neither avoids folds.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from math import ceil, log10
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Ints, Points
from finloop.base.drawing import Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import PART, layers_by_shape, shape_of
from finloop.base.style import Gradient, Paint, mix_paints, move_paint, scale_paint
from finloop.curve.contour import Curve
from finloop.curve.dynamics import Material, Problem, solve_motion
from finloop.curve.wavelet import close_by_mirroring
from finloop.morph.folds import (
    ContourLayout,
    contours_stay_simple,
    count_contour_folds,
    count_polygon_folds,
    stays_simple,
)
from finloop.morph.match import FULL, Resolution, match_curves
from finloop.morph.simple import morph_regions_without_folds, morph_without_folds

METHODS = ("linear", "physical", "fold_free")
DIGITS = (6, 9, 12)  # significant digits of the larger side: the grid is 1e-5 of it or finer
REACH = 1000  # sides of the picture: the largest coordinate of a contour
MOST_FRAMES, LEAST_POINTS, MOST_POINTS = 10_000, 8, 16_384
FADE = 0.25
"""Final share of the time of a physical morph, in which the motion fades out: it ends at b."""


class PhysicalOptions(NamedTuple):
    """Settings of the physical morph: elastic constant e₀, damping c and density ρ (`mass`).

    By default the curve swings a little and settles.
    """

    elastic: float = 1.0
    damping: float = 8.0
    mass: float = 1.0


def morph_drawings(
    a: Drawing,
    b: Drawing,
    method: str,
    frames: int,
    points: int = 256,
    resolution: Resolution = FULL,
    physics: PhysicalOptions = PhysicalOptions(),  # noqa: B008  (immutable)
) -> Morph:
    """Return the morph of drawing `a` into drawing `b`, which is fitted into the picture of `a`.

    a, b: with the same ids, each contour closed in both or open in both; with `fold_free`, a shape
    may have other holes in b. method: one of METHODS; `fold_free` keeps every contour free of
    folds, and every region free of crossings. frames: their number, at least 2, both ends included.
    points: of every contour, at least 8; a power of two for `physical`, and with a level.
    resolution: of every contour, also in both ends. physics: settings of the physical morph.
    FinloopError if the drawings do not match, a number is out of range, or the method cannot morph
    a contour, which the message names.
    """
    if method not in METHODS:
        raise FinloopError(
            f"the method {method!r}", f"one of {', '.join(METHODS)}", "choose one of these"
        )
    check_sizes("morph", frames, points, 2)
    regions = _region_names(a, b) if method == "fold_free" else {}
    in_regions = {name for names in regions.values() for pair in names for name in pair}
    check_pairs(_without(a, in_regions), _without(b, in_regions))
    b = fit_drawing(b, a.width, a.height)
    side = max(a.width, a.height)
    morph_pair: dict[str, Callable[[Curve, Curve], Points]] = {
        "linear": lambda a, b: linear_morph(a, b, frames, points, resolution),
        "physical": lambda a, b: physical_morph(a, b, frames, points, physics, resolution),
        "fold_free": lambda a, b: morph_without_folds(a, b, frames, points, resolution),
    }
    layers: dict[str, Points] = {}
    for name, curve in a.curves.items():
        shape = shape_of(name)
        if shape not in regions:
            layers[name] = _morph_contour(name, curve, b.curves[name], side, morph_pair[method])
        elif shape not in layers:  # all contours of a region at its first one
            names_a, names_b = regions[shape]
            stacks = _morph_region(
                shape, [a.curves[part] for part in names_a], [b.curves[part] for part in names_b],
                side, frames, points, resolution,
            )  # fmt: skip
            layers |= {
                f"{shape}{PART}{number}" if number > 1 else shape: stack
                for number, stack in enumerate(stacks, start=1)
            }
    digits = DIGITS if method == "fold_free" else DIGITS[:1]
    tau = np.linspace(0, 1, frames)
    ends = [{name: stack[end] for name, stack in layers.items()} for end in (0, -1)]
    styles = mix_styles(a, b, tau, layers, ends)
    return build_morph(a, tau, layers, styles, digits)


def build_morph(
    a: Drawing,
    tau: Points,
    layers: dict[str, Points],
    styles: dict[str, tuple[Paint, ...]],
    digits: Sequence[int],
    repeats: bool = False,
) -> Morph:
    """Return a morph made of given frames: coordinates rounded, folds counted.

    Its `continuous` says of each contour whether it is proved that no fold lies between frames.
    a: the first drawing, which gives the size of the picture. tau (f,): share of the way to the
    second drawing in every frame; layers: contours (f, n, 2) by id; styles: f paints by id.
    digits: to how many significant digits of the picture's larger side coordinates are rounded: the
    first number with which no frame folds, else the last. repeats: whether the first frame follows
    the last.
    """
    closed = {name: a.curves[name].closed if name in a.curves else True for name in layers}
    shapes = layers_by_shape(layers)
    for significant in digits:
        decimals = significant - ceil(log10(max(a.width, a.height)))
        rounded = {name: np.round(stack, decimals) + 0.0 for name, stack in layers.items()}  # no −0
        folds = {name: count_polygon_folds(stack, closed[name]) for name, stack in rounded.items()}
        for names in shapes.values():
            folds[names[0]] = folds[names[0]] + _count_crossings(names, rounded, folds, closed)
        if not any(count.any() for count in folds.values()):
            break
    continuous: dict[str, bool] = {}
    for names in shapes.values():
        motions = [rounded[name] for name in names]
        if repeats:
            motions = [np.r_[stack, stack[:1]] for stack in motions]
        if len(names) > 1 and all(closed[name] for name in names):
            proved = contours_stay_simple(np.concatenate(motions, axis=1), _layout(motions))
            continuous |= dict.fromkeys(names, proved)
        else:
            continuous |= {
                name: stays_simple(motion, closed[name])
                for name, motion in zip(names, motions, strict=True)
            }
    return Morph(
        tau=tau,
        layers=rounded,
        closed=closed,
        folds=folds,
        continuous=continuous,
        styles=styles,
        width=a.width,
        height=a.height,
        decimals=decimals,
    )


def _layout(stacks: Sequence[Points]) -> ContourLayout:
    """Return how closed contours (f, n, 2) lie one after the other in one array."""
    return ContourLayout(tuple(stack.shape[1] for stack in stacks))


def _count_crossings(
    names: Sequence[str], layers: Mapping[str, Points], folds: Mapping[str, Ints],
    closed: Mapping[str, bool],
) -> Ints:  # fmt: skip
    """Return how often the contours of a shape meet each other in every frame (f,).

    names: ids of the contours. layers, folds, closed: contours (f, n, 2), their own folds (f,), and
    whether they are closed, by id. 0 for a shape with an open contour, whose lines may cross, and
    for one whose contours cross in the first or last frame: it is drawn so.
    """
    if len(names) == 1 or not all(closed[name] for name in names):
        return np.zeros_like(folds[names[0]])
    stacks = [layers[name] for name in names]
    together = count_contour_folds(np.concatenate(stacks, axis=1), _layout(stacks))
    crossings = together - np.sum([folds[name] for name in names], axis=0)
    is_drawn = crossings[0] or crossings[-1]  # contours that cross in a drawing may cross
    return np.zeros_like(crossings) if is_drawn else crossings


def _region_names(a: Drawing, b: Drawing) -> dict[str, tuple[list[str], list[str]]]:
    """Return the regions of two drawings: shape → ids of its contours in a, and in b.

    A region is a shape of closed contours that has several of them in one of the drawings.
    """
    shapes_a, shapes_b = layers_by_shape(a.curves), layers_by_shape(b.curves)
    return {
        shape: (names, shapes_b[shape])
        for shape, names in shapes_a.items()
        if shape in shapes_b
        and max(len(names), len(shapes_b[shape])) > 1
        and all(a.curves[name].closed for name in names)
        and all(b.curves[name].closed for name in shapes_b[shape])
    }


def _without(drawing: Drawing, names: Collection[str]) -> Drawing:
    """Return a drawing without the contours of some ids."""
    curves = {name: curve for name, curve in drawing.curves.items() if name not in names}
    return replace(drawing, curves=curves)


def _morph_region(
    shape: str, a: Sequence[Curve], b: Sequence[Curve], side: float, frames: int, points: int,
    resolution: Resolution,
) -> list[Points]:  # fmt: skip
    """Return the frames (frames, points, 2) of each contour of a shape.

    shape: its id, for error messages; side: longer side of the picture. FinloopError as in
    `morph_regions_without_folds`, or if a contour reaches farther than REACH sides.
    """
    try:
        stacks = morph_regions_without_folds(a, b, frames, points, resolution)
    except FinloopError as error:
        raise FinloopError(f"shape {shape!r}: {error.came}", error.wanted, error.do) from error
    for stack in stacks:
        _require_near(shape, stack, side)
    return stacks


def _require_near(name: str, stack: Points, side: float) -> None:
    """Raise FinloopError if a frame of a contour (f, n, 2) reaches farther than REACH sides."""
    if not (np.abs(stack) <= REACH * side).all():
        raise FinloopError(
            f"contour {name!r} reaches {np.abs(stack).max():g} in a picture {side:g} large",
            f"at most {REACH} times its size",
            "move the contour into the picture, or set the viewBox around the contours",
        )


def mix_styles(
    a: Drawing,
    b: Drawing,
    shares: Points,
    layers: Mapping[str, Points],
    ends: Sequence[Mapping[str, Points]],
) -> dict[str, tuple[Paint, ...]]:
    """Return, by id, how each contour is painted in every frame between two drawings.

    A contour that only one drawing paints has that paint throughout. A gradient moves with its
    contour: from either drawing by the affine motion that fits the motion of the points best.
    shares (f,): of the way from `a` to `b` in every frame; layers: contours (f, n, 2) by id; ends:
    of a and of b, the same points (n, 2) by id.
    """
    styles = dict[str, tuple[Paint, ...]]()
    for name, stack in layers.items():
        known = [
            (drawing.styles[name], end[name])
            for drawing, end in zip((a, b), ends, strict=True)
            if name in drawing.styles
        ]
        if known:
            moved = [
                _move_with_contour(paint, contour, stack)
                for paint, contour in (known[0], known[-1])
            ]
            styles[name] = tuple(map(mix_paints, *moved, shares.tolist()))
    return styles


def _move_with_contour(paint: Paint, contour: Points, stack: Points) -> list[Paint]:
    """Return the paint of a contour (n, 2), its gradients moved to each of the frames (f, n, 2)."""
    if not any(isinstance(fill, Gradient) for fill in (paint.fill, paint.stroke)):
        return [paint] * len(stack)
    centre, centres = contour.mean(axis=0), stack.mean(axis=1)
    # Least squares; where a straight contour leaves the motion open, the smallest matrix.
    turns = np.eye(2) + np.linalg.pinv(contour - centre, rcond=1e-6) @ (
        stack - centres[:, None] - (contour - centre)
    )
    return [
        move_paint(paint, turn, goal - centre @ turn)
        for turn, goal in zip(turns, centres, strict=True)
    ]


def _morph_contour(
    name: str, a: Curve, b: Curve, side: float, morph_pair: Callable[[Curve, Curve], Points]
) -> Points:
    """Return the frames (frames, points, 2) that `morph_pair` makes of contours a and b.

    name: of both, for error messages; side: longer side of the picture. FinloopError if
    `morph_pair` raises it, or a frame reaches farther than REACH sides.
    """
    try:
        stack = morph_pair(a, b)
    except FinloopError as error:
        raise FinloopError(f"contour {name!r}: {error.came}", error.wanted, error.do) from error
    _require_near(name, stack, side)
    return stack


def linear_morph(
    a: Curve, b: Curve, frames: int, points: int, resolution: Resolution = FULL
) -> Points:
    """Return the frames (frames, points, 2) of the linear morph from curve a to b (Eq. 4.1).

    A(τ) = (1 − τ) Aˢ + τ Aᵈ, where Aˢ and Aᵈ are the control points of a and of b at a resolution.
    The inverse transform is linear, so the curves that they make are blended in their place: the
    same frames, without a transform for each. FinloopError as `match_curves`.
    """
    first, second = match_curves(a, b, points, resolution)
    tau = np.linspace(0, 1, frames)[:, None, None]
    return (1 - tau) * first + tau * second


def physical_morph(
    a: Curve,
    b: Curve,
    frames: int,
    points: int,
    physics: PhysicalOptions = PhysicalOptions(),  # noqa: B008  (immutable)
    resolution: Resolution = FULL,
) -> Points:
    """Return the motion (frames, points, 2) of curve b, bent into the shape of a and released.

    The last frame is b. The motion is ρ ü + c u̇ + K u = 0 (Eq. 3.3) in a time of 1; ρ, c and e₀ are
    those of `physics`. With a level, only its control points are solved. Mode m of a closed curve
    swings m √(e₀/ρ) times, of an open curve half as often. With little damping the curve
    overshoots, with much it creeps, without mass it does not swing.

    No stiffness holds the mean of the points, so it is moved as the slowest mode moves.
    FinloopError if one curve is open and the other closed, `points` is no power of two, the
    resolution does not exist for them, or mass and damping are both 0.
    """
    elastic, damping, mass = physics
    shape, rest = match_curves(a, b, points)
    offset = shape - rest
    mean_offset = offset.mean(axis=0)
    bend = offset - mean_offset if a.closed else close_by_mirroring(offset - mean_offset)
    # One swing along the closed curve: the shape of the slowest mode.
    slowest = np.cos(2 * np.pi * (np.arange(len(bend)) + 0.5) / len(bend))
    mass_damping = damping / mass if mass > 0 else damping
    material = Material(density=mass, elastic=elastic, mass_damping=mass_damping)
    times = np.linspace(0, 1, frames)
    start = np.column_stack([bend, slowest])  # x, y, and a third coordinate for the mean's motion
    at_rest = np.zeros_like(start)
    problem = Problem(at_rest, start, material, times, wavelet=resolution.wavelet)
    motion = solve_motion(problem, level=resolution.level).displacement
    mean_factor = motion[:, 0, 2] / motion[0, 0, 2]  # how much is left of the slowest mode
    displacement = motion[:, :points, :2] + mean_factor[:, None, None] * mean_offset
    # From 1 to 0 in the last part of the time, with slope 0 at both ends (smoothstep).
    fade = np.clip((1 - times) / FADE, 0, 1)
    rest = resolution.reduce_curves(rest, a.closed)
    return rest + (fade**2 * (3 - 2 * fade))[:, None, None] * displacement


def there_and_back(morph: Morph) -> Morph:
    """Return a morph with its frames appended in reverse, so that it repeats without a jump.

    The frames at both ends are not repeated: f frames become 2 f − 2.
    """
    frames = np.arange(len(morph.tau))
    return morph.take_frames(np.r_[frames, frames[-2:0:-1]])


def fit_drawing(drawing: Drawing, width: float, height: float) -> Drawing:
    """Return a drawing scaled to fit a picture and centred there, as SVG fits a viewBox.

    width, height: of the picture, in the unit of its coordinates.
    """
    if (drawing.width, drawing.height) == (width, height):
        return drawing
    scale = min(width / drawing.width, height / drawing.height)
    shift = (np.array([width, height]) - scale * np.array([drawing.width, drawing.height])) / 2
    curves = {
        name: Curve(curve.points * scale + shift, curve.closed)
        for name, curve in drawing.curves.items()
    }
    styles = {name: scale_paint(paint, scale, shift) for name, paint in drawing.styles.items()}
    return Drawing(curves, width, height, styles, drawing.groups)


def check_sizes(what: str, frames: int, points: int, least_frames: int) -> None:
    """Raise FinloopError if the number of frames, or of points of a contour, is out of range.

    what: the noun for the message, such as "morph"; least_frames: fewest frames allowed.
    """
    for came, count, least, most, usual in (
        (f"a {what} of {frames} frames", frames, least_frames, MOST_FRAMES, "24 frames or more"),
        (f"contours of {points} points", points, LEAST_POINTS, MOST_POINTS, "128 points"),
    ):
        if not least <= count <= most:
            raise FinloopError(came, f"{least} … {most}", f"set {usual}")


def check_pairs(a: Drawing, b: Drawing) -> None:
    """Raise FinloopError, with all problems, if the contours of two drawings form no pairs."""
    problems = []
    for which, drawing, other in (("first", a, b), ("second", b, a)):
        single = [name for name in drawing.curves if name not in other.curves]
        if single:
            names = ", ".join(map(repr, single[:5])) + (" …" if len(single) > 5 else "")
            problems.append(f"{names} only in the {which}")
    kind = {True: "closed", False: "open"}
    for name, curve in a.curves.items():
        if name in b.curves and b.curves[name].closed != curve.closed:
            here, there = kind[curve.closed], kind[not curve.closed]
            problems.append(f"{name!r} {here} in the first, {there} in the second")
    if problems:
        raise FinloopError(
            f"the drawings do not match: {'; '.join(problems)}",
            "the same ids in both, each contour closed (Z) in both or open in both",
            "give the contours of a pair the same id, and close both or neither",
        )
