"""Morph drawings shape by shape (curve paper §4.1, Figs. 4, 5), such as outline, eyes, mouth.

Shapes of the same id form a pair. Coordinates are rounded before folds are counted, so the counts
hold for the coordinates in the files. Two of the paper's methods are here, linear (Eq. 4.1, Fig. 4)
and physical (Fig. 5); neither avoids folds.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import ceil, inf, log10
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints, Mask, Points
from finloop.base.drawing import Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import PART, layers_by_shape
from finloop.base.style import Gradient, Paint, mix_paints, move_paint, scale_paint
from finloop.curve.contour import Curve, nearest_on_curve
from finloop.curve.dynamics import Material, Problem, solve_motion
from finloop.curve.wavelet import close_by_mirroring
from finloop.morph.cover import find_covered_pieces, find_shifts
from finloop.morph.folds import (
    ContourLayout,
    contours_stay_simple,
    count_contour_folds,
    count_polygon_folds,
    stays_simple,
)
from finloop.morph.match import FULL, SAME, Pins, Resolution, match_curves
from finloop.morph.shapes import match_shapes
from finloop.morph.simple import morph_contours

METHODS = ("linear", "physical", "fold_free")
DIGITS = (6, 9, 12)  # significant digits of the larger side: the grid is 1e-5 of it or finer
REACH = 1000  # sides of the picture: the largest coordinate of a contour
MOST_FRAMES, LEAST_POINTS, MOST_POINTS = 10_000, 8, 16_384
HIDDEN = 0.5  # widths of a line: a contour shorter than that is a point, and has no line
CLOSED_BY = 0.3  # share of a morph, after which a line has closed the gaps along cuts
NEAR_CUT = 1e-3  # of a contour's size: how near to a cut the middle of an edge counts as on it
FADE = 0.25
"""Final share of the time of a physical morph, in which the motion fades out: it ends at b."""


class PhysicalOptions(NamedTuple):
    """Settings of the physical morph: elastic constant e₀, damping c and density ρ (`mass`).

    c is s₁ρ of Eq. 3.5, and `stiffness_damping` its s₂. By default the curve swings a little and
    settles.
    """

    elastic: float = 1.0
    damping: float = 8.0
    mass: float = 1.0
    stiffness_damping: float = 0.0


def physical_material(physics: PhysicalOptions) -> Material:
    """Return the material of the curves in a physical morph."""
    damping, mass = physics.damping, physics.mass
    return Material(
        density=mass,
        elastic=physics.elastic,
        mass_damping=damping / mass if mass > 0 else damping,
        stiffness_damping=physics.stiffness_damping,
    )


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

    a, b: with shapes of the same ids. An open contour may become a closed one, and holes may
    differ, but not the number of separate parts. method: one of METHODS; `fold_free` keeps every
    contour free of folds, every region free of crossings, and pieces of one shape apart, as far as
    `find_shifts` can. frames: their number, at least 2, both ends included. points: of every
    contour, at least 8; a power of two for `physical`, and with a level.
    resolution: of every contour, also in both ends. physics: settings of the physical morph.
    FinloopError if the drawings do not match, a number is out of range, or the method cannot morph
    a contour, which the message names.
    """
    if method not in METHODS:
        raise FinloopError(
            f"the method {method!r}", f"one of {', '.join(METHODS)}", "choose one of these"
        )
    check_sizes("morph", frames, points, 2)
    check_physics(physics)
    shapes_a, shapes_b = layers_by_shape(a.curves), layers_by_shape(b.curves)
    _check_shapes(shapes_a, shapes_b)
    b = fit_drawing(b, a.width, a.height)
    side = max(a.width, a.height)
    layers: dict[str, Points] = {}
    closed: dict[str, bool] = {}
    for shape, names in shapes_a.items():
        try:
            contours = _morph_shape(
                [a.curves[name] for name in names],
                [b.curves[name] for name in shapes_b[shape]],
                Pins(*(drawing.pins.get(shape, np.zeros((0, 2))) for drawing in (a, b))),
                method, frames, points, resolution, physics,
            )  # fmt: skip
        except FinloopError as error:
            raise FinloopError(f"shape {shape!r}: {error.came}", error.wanted, error.do) from error
        for number, (stack, is_closed) in enumerate(contours, start=1):
            _require_near(shape, stack, side)
            name = f"{shape}{PART}{number}" if number > 1 else shape
            layers[name], closed[name] = stack, is_closed
    shapes = layers_by_shape(layers)
    families = [
        [name for name in family if all(closed[layer] for layer in shapes[name])]
        for family in a.families
    ]
    families = [family for family in families if len(family) > 1]
    if method == "fold_free":
        for family in families:
            pieces = [[layers[layer] for layer in shapes[name]] for name in family]
            for name, shift in zip(family, find_shifts(pieces), strict=True):
                for layer in shapes[name]:
                    layers[layer] = layers[layer] + shift[:, None]
    for drawing, end in ((a, 0), (b, -1)):
        for name, cuts in drawing.cuts.items():
            layers[name] = np.roll(layers[name], -_find_start(layers[name][end], cuts), axis=1)
    digits = DIGITS if method == "fold_free" else DIGITS[:1]
    tau = np.linspace(0, 1, frames)
    ends = [{name: stack[end] for name, stack in layers.items()} for end in (0, -1)]
    styles = mix_styles(a, b, tau, layers, ends)
    covers = find_covered_pieces(
        {shape: [layers[name] for name in names] for shape, names in shapes.items()}, families
    )
    return replace(build_morph(a, tau, layers, styles, digits, closed=closed), covers=covers)


def _morph_shape(
    a: Sequence[Curve], b: Sequence[Curve], pins: Pins, method: str, frames: int, points: int,
    resolution: Resolution, physics: PhysicalOptions,
) -> list[tuple[Points, bool]]:  # fmt: skip
    """Return the frames (frames, points, 2) of each contour of a shape, and whether each is closed.

    FinloopError if the contours cannot be paired, or the method cannot morph them.
    """
    is_physical = method == "physical"  # solved at all points, or at those of its own level
    pairs = match_shapes(
        a, b, points, FULL if is_physical else resolution, pins, needs_regions=method == "fold_free"
    )
    contours = list[tuple[Points, bool]]()
    for first, second, layout in pairs:
        if method == "fold_free":
            is_pinned = bool(len(pins.first))
            stack = morph_contours(first, second, layout, frames, is_pinned)
        elif is_physical:
            stack = np.concatenate([
                release_curve(first[part], second[part], layout.closed, frames, physics, resolution)
                for part in layout.parts
            ], axis=1)  # fmt: skip
        else:
            stack = blend_points(first, second, frames)
        contours += [(stack[:, part], layout.closed) for part in layout.parts]
    return contours


def build_morph(
    a: Drawing,
    tau: Points,
    layers: dict[str, Points],
    styles: dict[str, tuple[Paint, ...]],
    digits: Sequence[int],
    repeats: bool = False,
    closed: Mapping[str, bool] | None = None,
) -> Morph:
    """Return a morph made of given frames, with rounded coordinates and counted folds.

    Its `continuous` says of each contour whether it is proved that no fold lies between frames.
    a: the first drawing, which gives the size of the picture. tau (f,): share of the way to the
    second drawing in every frame; layers: contours (f, n, 2) by id; styles: f paints by id.
    digits: to how many significant digits of the picture's larger side coordinates are rounded: the
    first number with which no frame folds, else the last. repeats: whether the first frame follows
    the last. closed: whether each contour is closed, by id; None: as in `a`.
    """
    closed = closed or {name: curve.closed for name, curve in a.curves.items()}
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
        closed={name: closed[name] for name in layers},
        folds=folds,
        continuous=continuous,
        styles=styles,
        width=a.width,
        height=a.height,
        decimals=decimals,
    )


def _layout(stacks: Sequence[Points]) -> ContourLayout:
    """Return the layout of contours (f, n, 2) in one array, one after the other."""
    return ContourLayout(tuple(stack.shape[1] for stack in stacks))


def _count_crossings(
    names: Sequence[str], layers: Mapping[str, Points], folds: Mapping[str, Ints],
    closed: Mapping[str, bool],
) -> Ints:  # fmt: skip
    """Return how often the contours of one shape meet each other in every frame (f,).

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


def _require_near(name: str, stack: Points, side: float) -> None:
    """Raise FinloopError if a frame of a shape (f, n, 2) goes more than REACH pictures away.

    name: of the shape, for the message; side: the longer side of the picture.
    """
    if not (np.abs(stack) <= REACH * side).all():
        raise FinloopError(
            f"shape {name!r} reaches {np.abs(stack).max():g} in a picture {side:g} large",
            f"at most {REACH} times its size",
            "move the shape into the picture, or set the viewBox around the contours",
        )


def mix_styles(
    a: Drawing,
    b: Drawing,
    shares: Points,
    layers: Mapping[str, Points],
    ends: Sequence[Mapping[str, Points]],
) -> dict[str, tuple[Paint, ...]]:
    """Return, by id, the paint of each contour in every frame between two drawings.

    A contour that only one drawing paints has that paint throughout. A gradient moves with its
    contour: from either drawing by the affine motion that fits the motion of the points best. A
    line leaves cuts open, as a gap between dashes, which closes on the way; but not where the line
    of a hole would show gaps, too, since it has the same dashes.
    shares (f,): of the way from `a` to `b` in every frame; layers: contours (f, n, 2) by id; ends:
    of a and of b, the same points (n, 2) by id.
    """
    styles = dict[str, tuple[Paint, ...]]()
    shapes = layers_by_shape(layers)
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
            for drawing, end, whole in zip((a, b), ends, (shares, 1 - shares), strict=True):
                if name in drawing.cuts:
                    is_cut = _find_cut_edges(end[name], drawing.cuts[name])
                    holes = [_measure_lengths(layers[hole]) for hole in shapes[name][1:]]
                    longest = np.max(holes, axis=0) if holes else np.zeros(len(stack))
                    rows = zip(styles[name], stack, whole, longest, strict=True)
                    styles[name] = tuple(
                        _leave_gaps(paint, points, is_cut, float(share) / CLOSED_BY, float(hole))
                        for paint, points, share, hole in rows
                    )
    for names in shapes.values():
        if len(names) > 1 and names[0] in styles:
            lengths = [_measure_lengths(layers[name]) for name in names]
            hidden = tuple(map(_hide_points, styles[names[0]], np.transpose(lengths)))
            styles |= dict.fromkeys(names, hidden)
    return styles


def _measure_lengths(stack: Points) -> Floats:
    """Return the length (f,) of a closed contour (f, n, 2) in every frame, in its unit."""
    return np.asarray(np.hypot(*(np.roll(stack, -1, axis=1) - stack).T).sum(axis=0))


def _hide_points(paint: Paint, lengths: Floats) -> Paint:
    """Return a paint whose line is not drawn along contours as small as points.

    lengths (k,): of a shape's contours, in a frame. Each line begins with a gap that is too small
    to be seen between round ends, in which such a contour lies whole.
    """
    gap = HIDDEN * paint.width
    if paint.stroke is None or paint.dashes or not lengths.min() < 0.9 * gap < lengths.max():
        return paint
    dash = 2 * float(lengths.max())
    # The line begins within the gap: a dash that ends where it begins would be a dot.
    return replace(
        paint,
        dashes=(dash, gap),
        dash_offset=dash + 0.1 * gap,
        round_dashes=True,
        leaves_gaps=True,
    )


def _find_cut_edges(points: Points, cuts: Points) -> Mask:
    """Return a mask (n,) of a closed contour's edges that lie along cuts; cuts: ends (k, 2, 2)."""
    middles = (points + np.roll(points, -1, axis=0)) / 2
    gaps = [nearest_on_curve(middles, Curve(ends, False))[1] for ends in cuts]
    near = np.min([np.hypot(*gap.T) for gap in gaps], axis=0)
    is_cut = near <= NEAR_CUT * np.hypot(*np.ptp(points, axis=0))
    is_cut |= np.roll(is_cut, 1) & np.roll(is_cut, -1)  # an edge across a corner of the cut
    return np.asarray(is_cut)


def _find_start(points: Points, cuts: Points) -> int:
    """Return the vertex of a closed contour (n, 2) where its longest uncut stretch begins.

    cuts (k, 2, 2): their ends. There is room for the line of a hole, which has the same dashes.
    """
    is_cut = _find_cut_edges(points, cuts)
    starts = np.flatnonzero(~is_cut & np.roll(is_cut, 1))
    if not len(starts):
        return 0
    lengths = np.hypot(*(np.roll(points, -1, axis=0) - points).T) * ~is_cut
    parts = np.add.reduceat(np.roll(lengths, -starts[0]), starts - starts[0])
    return int(starts[parts.argmax()])


def _leave_gaps(
    paint: Paint, points: Points, is_cut: Mask, whole: float, hole: float = 0.0
) -> Paint:
    """Return a paint whose line has gaps along the cut edges of a closed contour (n, 2).

    is_cut (n,): of its edges. whole: 0 … 1; towards 1, gaps shrink to their middles. hole: length
    of a hole's line, which has the same dashes. A line with dashes of its own, on a contour that is
    cut all round, or with gaps that the hole would get, stays as it is.
    """
    if paint.stroke is None or paint.dashes or whole >= 1 or is_cut.all() or not is_cut.any():
        return paint
    start = int(np.flatnonzero(is_cut & ~np.roll(is_cut, 1))[0])  # the first gap begins here
    lengths = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    along = np.r_[0.0, np.cumsum(np.roll(lengths, -start))]
    cut = np.r_[np.roll(is_cut, -start), False]
    begins = np.flatnonzero(cut & ~np.r_[False, cut[:-1]])
    ends = np.flatnonzero(~cut & np.r_[False, cut[:-1]])
    shrink = whole * (along[ends] - along[begins]) / 2
    gaps = np.stack([along[begins] + shrink, along[ends] - shrink], axis=1)
    origin = along[-1] - lengths[:start].sum()  # of all lines of the shape: the contour's point 0
    is_in_gap = ((gaps[:, 0] < origin) & (origin < gaps[:, 1] - SAME * along[-1])).any()
    if hole and (is_in_gap or hole > ((gaps[:, 0] - origin) % along[-1]).min()):
        return paint
    widths = np.roll(gaps[:, 1] - gaps[:, 0], -1)  # each after its dash
    dashes = np.append(gaps[1:, 0], gaps[0, 0] + along[-1]) - gaps[:, 1]
    first_dash = lengths[:start].sum() + gaps[0, 1]
    return replace(
        paint,
        dashes=tuple(np.stack([dashes, widths], axis=1).ravel().tolist()),
        dash_offset=float((-first_dash) % along[-1]),
        round_dashes=True,
        leaves_gaps=True,
    )


def _move_with_contour(paint: Paint, contour: Points, stack: Points) -> list[Paint]:
    """Return a contour's paint in each of the frames (f, n, 2); gradients move with the contour."""
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


def linear_morph(
    a: Curve, b: Curve, frames: int, points: int, resolution: Resolution = FULL
) -> Points:
    """Return the frames (frames, points, 2) of the linear morph from curve a to b (Eq. 4.1).

    A(τ) = (1 − τ) Aˢ + τ Aᵈ, where Aˢ and Aᵈ are the control points of a and of b at a resolution.
    The inverse transform is linear, so the curves that they make are blended in their place: the
    same frames, without a transform for each. FinloopError as `match_curves`.
    """
    return blend_points(*match_curves(a, b, points, resolution), frames)


def blend_points(first: Points, second: Points, frames: int) -> Points:
    """Return frames (frames, n, 2) in which points (n, 2) move straight to others (Eq. 4.1)."""
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
    """Return the motion (frames, points, 2) of curve b, which is bent into a's shape and released.

    As `release_curve`. FinloopError also as `match_curves`.
    """
    shape, rest = match_curves(a, b, points)
    return release_curve(shape, rest, a.closed, frames, physics, resolution)


def release_curve(
    shape: Points,
    rest: Points,
    closed: bool,
    frames: int,
    physics: PhysicalOptions = PhysicalOptions(),  # noqa: B008  (immutable)
    resolution: Resolution = FULL,
) -> Points:
    """Return the motion (frames, n, 2) of a curve that was bent into a shape and is released.

    shape, rest (n, 2): the curve bent, and at rest, which the last frame is; closed: whether it is.
    The motion is ρ ü + (c + s₂K) u̇ + K u = 0 (Eq. 3.3) in a time of 1; ρ, c, s₂ and e₀ are those
    of `physics`. With a level, only its control points are solved. Mode m of a closed curve swings
    m √(e₀/ρ) times, of an open curve half as often. With little damping the curve overshoots, with
    much it creeps, without mass it does not swing.

    No stiffness holds the mean of the points, so it is moved as the slowest mode moves.
    FinloopError if n is no power of two, the resolution does not exist for n points, or mass and
    damping are both 0.
    """
    offset = shape - rest
    mean_offset = offset.mean(axis=0)
    bend = offset - mean_offset if closed else close_by_mirroring(offset - mean_offset)
    # One swing along the closed curve: the shape of the slowest mode.
    slowest = np.cos(2 * np.pi * (np.arange(len(bend)) + 0.5) / len(bend))
    times = np.linspace(0, 1, frames)
    start = np.column_stack([bend, slowest])  # x, y, and a third coordinate for the mean's motion
    at_rest = np.zeros_like(start)
    problem = Problem(at_rest, start, physical_material(physics), times, wavelet=resolution.wavelet)
    motion = solve_motion(problem, level=resolution.level).displacement
    mean_factor = motion[:, 0, 2] / motion[0, 0, 2]  # how much is left of the slowest mode
    displacement = motion[:, : len(rest), :2] + mean_factor[:, None, None] * mean_offset
    # From 1 to 0 in the last part of the time, with slope 0 at both ends (smoothstep).
    fade = np.clip((1 - times) / FADE, 0, 1)
    rest = resolution.reduce_curves(rest, closed)
    return rest + (fade**2 * (3 - 2 * fade))[:, None, None] * displacement


def there_and_back(morph: Morph) -> Morph:
    """Return a morph that runs there and back, so that it repeats without a jump.

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
    return replace(
        drawing,
        curves=curves,
        width=width,
        height=height,
        styles=styles,
        pins={name: pins * scale + shift for name, pins in drawing.pins.items()},
        cuts={name: cuts * scale + shift for name, cuts in drawing.cuts.items()},
    )


def check_physics(physics: PhysicalOptions) -> None:
    """Raise FinloopError for physical settings that are invalid, or let a curve drift."""
    values = physics._asdict()
    wrong = [f"{name} {value:g}" for name, value in values.items() if not 0 <= value < inf]
    if physics.mass == physics.damping == 0:
        wrong.append("mass 0 and damping 0: nothing resists a shift")
    if wrong:
        raise FinloopError(
            ", ".join(wrong), "finite numbers of 0 or more, and a mass or a damping", "correct them"
        )


def check_sizes(what: str, frames: int, points: int, least_frames: int) -> None:
    """Raise FinloopError if the number of frames, or of points of a contour, is out of range.

    what: the noun for the message, such as "morph"; least_frames: fewest frames allowed.
    """
    for came, count, least, most, usual in (
        (f"a {what} of {frames} frames", frames, least_frames, MOST_FRAMES, 24),
        (f"contours of {points} points", points, LEAST_POINTS, MOST_POINTS, 128),
    ):
        if not least <= count <= most:
            do = f"set a number in this range; {usual} is usual"
            raise FinloopError(came, f"{least} … {most}", do)


def _check_shapes(first: Collection[str], second: Collection[str]) -> None:
    """Raise FinloopError if two drawings do not have shapes of the same ids."""
    if problems := _describe_singles(first, second):
        raise FinloopError(
            f"the drawings do not match: {'; '.join(problems)}",
            "shapes of the same ids in both",
            "give both shapes of a pair the same id, or pair the drawings first (match_drawings)",
        )


def _describe_singles(first: Collection[str], second: Collection[str]) -> list[str]:
    """Return in words the ids that only one of two drawings has."""
    problems = []
    for which, names, others in (("first", first, second), ("second", second, first)):
        if single := [name for name in names if name not in others]:
            few = ", ".join(map(repr, single[:5])) + (" …" if len(single) > 5 else "")
            problems.append(f"{few} only in the {which}")
    return problems


def check_pairs(a: Drawing, b: Drawing) -> None:
    """Raise FinloopError, with all problems, if contours of two drawings cannot be paired by id."""
    problems = _describe_singles(a.curves, b.curves)
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
