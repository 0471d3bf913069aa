"""Which shapes of two drawings become each other: by file, by id, or by place and shape.

A shape is a contour, or all contours of one path (`d`, `d#2` …). A file of pairs goes first; then
equal ids belong together; the others of one kind, closed or open, are paired so that place, size
and shape differ least. What is left vanishes to a point, or grows from one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import yaml

from finloop.base.arrays import Points
from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.base.paint import PART, layers_by_shape, shape_of
from finloop.base.style import scale_paint
from finloop.curve.contour import Curve, resample_curve
from finloop.morph.layers import fit_drawing
from finloop.morph.match import match_curves

POINT = 1e-3
"""Size of a shape that vanishes, as a share of what it was: less than a pixel."""
POINTS = 64  # of a contour whose shape is compared
PLACE_WEIGHT, SIZE_WEIGHT = 4.0, 0.5
"""Cost of a place that is off by the picture's side, and of a double size. A shape that is off by
its own radius (RMS) costs 1. By place weights of 2 and 4 all 42 shapes of the shipped face, dog and
fish find their partners without ids; by 1 and 8, 40. Size tells an eye from its pupil."""
FORM = "pairs: {eye: left_eye}, vanish: [hat], appear: [beard]"


@dataclass(frozen=True)
class Pairing:
    """Shapes of two drawings by id: pairs first → second; which vanish, and which appear.

    proposed: those of the first drawing that place and shape alone have paired.
    """

    pairs: Mapping[str, str]
    vanish: Sequence[str] = ()
    appear: Sequence[str] = ()
    proposed: Sequence[str] = field(default=())

    @property
    def summary(self) -> str:
        """Return in words what was not paired by id; "" if all was."""
        parts = []
        if self.proposed:
            pairs = ", ".join(f"{name} → {self.pairs[name]}" for name in self.proposed)
            parts.append(f"paired by place and shape: {pairs}")
        parts += [
            f"{verb}: {', '.join(names)}"
            for verb, names in (("vanish", self.vanish), ("appear", self.appear))
            if names
        ]
        return "; ".join(parts)


def load_pairing(path: Path) -> Pairing:
    """Load a file of pairs, YAML in the form FORM. FinloopError says what makes it none."""
    try:
        values: Any = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FinloopError(f"{path} cannot be read: {error}", FORM, "correct it") from error
    problems = []
    if not isinstance(values, dict):
        values, problems = {}, ["it has no keys"]
    elif unknown := set(values) - {"pairs", "vanish", "appear"}:
        problems.append(f"it has {', '.join(sorted(map(str, unknown)))}")
    pairs = values.get("pairs") or {}
    lists = {key: values.get(key) or [] for key in ("vanish", "appear")}
    if not isinstance(pairs, dict) or not all(isinstance(name, str) for name in pairs.values()):
        problems.append("its pairs are no `id: id`")
    problems += [f"its {key} is no list" for key, names in lists.items() if type(names) is not list]
    if problems:
        raise FinloopError(f"{path} has no pairs: {'; '.join(problems)}", FORM, "correct it")
    pairs = {str(name): other for name, other in pairs.items()}
    return Pairing(pairs, *([str(name) for name in names] for names in lists.values()))


def pair_shapes(a: Drawing, b: Drawing, given: Pairing | None = None) -> Pairing:
    """Return which shapes of drawing `a` become which of `b`, both of one size.

    given: goes first. FinloopError if it names a shape that is not there, or one twice.
    """
    given = given or Pairing({})
    first, second = shape_contours(a), shape_contours(b)
    _require_shapes(first, [*given.pairs, *given.vanish], "first")
    _require_shapes(second, [*given.pairs.values(), *given.appear], "second")
    pairs = dict(given.pairs)
    left = [name for name in first if name not in pairs and name not in given.vanish]
    right = [name for name in second if name not in {*pairs.values(), *given.appear}]
    same = [name for name in left if name in right]
    pairs |= {name: name for name in same}
    left = [name for name in left if name not in same]
    right = [name for name in right if name not in same]
    side = max(a.width, a.height)
    costs = np.array([
        [_pair_cost(first[name], second[other], side) for other in right] for name in left
    ]).reshape(len(left), len(right))  # fmt: skip
    finite = np.where(np.isfinite(costs), costs, 1e9)
    proposed = []
    for row, column in zip(*scipy.optimize.linear_sum_assignment(finite), strict=True):
        if np.isfinite(costs[row, column]):
            pairs[left[row]] = right[column]
            proposed.append(left[row])
    return Pairing(
        pairs,
        [*given.vanish, *(name for name in left if name not in pairs)],
        [*given.appear, *(name for name in right if name not in pairs.values())],
        proposed,
    )


def shape_contours(drawing: Drawing) -> dict[str, list[Curve]]:
    """Return the contours of each shape of a drawing by id, in drawing order."""
    shapes = layers_by_shape(drawing.curves)
    return {name: [drawing.curves[layer] for layer in layers] for name, layers in shapes.items()}


def _require_shapes(shapes: Iterable[str], names: Sequence[str], which: str) -> None:
    """Raise FinloopError if a name is none of a drawing's shapes, or is there twice."""
    unknown = [name for name in names if name not in shapes]
    twice = sorted({name for name in names if names.count(name) > 1})
    if unknown or twice:
        problems = [f"no shape {name!r}" for name in unknown]
        problems += [f"{name!r} twice in the pairs" for name in twice]
        raise FinloopError(
            f"the {which} drawing: {', '.join(problems)}",
            f"each of its shapes at most once: {', '.join(shapes)}",
            "correct the file of pairs",
        )


def _pair_cost(first: Sequence[Curve], second: Sequence[Curve], side: float) -> float:
    """Return how badly two shapes fit each other: place, size, and form of the largest contour.

    side: of the picture. Infinite if one shape is open and the other closed.
    """
    if {curve.closed for curve in first} != {curve.closed for curve in second}:
        return np.inf
    largest = max(first, key=_extent), max(second, key=_extent)
    points_a, points_b = match_curves(largest[0], largest[1], POINTS)
    far = float(np.hypot(*(points_a.mean(axis=0) - points_b.mean(axis=0))))
    sizes = [float(np.hypot(*points.std(axis=0))) for points in (points_a, points_b)]
    form = [
        (points - points.mean(axis=0)) / size
        for points, size in zip((points_a, points_b), sizes, strict=True)
    ]
    misfit = float(np.sqrt(((form[0] - form[1]) ** 2).sum(axis=1).mean()))
    return PLACE_WEIGHT * far / side + SIZE_WEIGHT * abs(np.log2(sizes[0] / sizes[1])) + misfit


def _extent(curve: Curve) -> float:
    """Return the diagonal of a contour's bounding box."""
    return float(np.hypot(*np.ptp(curve.points, axis=0)))


def match_drawings(
    a: Drawing, b: Drawing, path: Path | None = None
) -> tuple[Drawing, Drawing, str]:
    """Return two drawings of one size and with the same ids, and in words what was paired.

    b: is fitted into the picture of a; path: of a file of pairs, None = there is none.
    """
    b = fit_drawing(b, a.width, a.height)
    pairing = pair_shapes(a, b, None if path is None else load_pairing(path))
    return *pair_drawings(a, b, pairing), pairing.summary


def pair_drawings(a: Drawing, b: Drawing, pairing: Pairing) -> tuple[Drawing, Drawing]:
    """Return two drawings whose shapes have the ids of the first, as `morph_drawings` takes them.

    A shape that vanishes is in the second as small as a point, one that appears in the first. It
    lies above the shape that is below it in the second drawing.
    """
    first, second = shape_contours(a), shape_contours(b)
    order, names = list(first), {other: name for name, other in pairing.pairs.items()}
    below = ""  # name of the shape below in the second drawing
    for other in second:
        if other in pairing.appear:
            names[other] = _unused_name(other, order)
            order.insert(order.index(below) + 1 if below else 0, names[other])
        below = names[other]
    renamed = _rename_shapes(b, names)
    shapes = first, shape_contours(renamed)
    curves: tuple[dict[str, Curve], dict[str, Curve]] = {}, {}
    styles = dict(a.styles), dict(renamed.styles)
    for name in order:
        for side, partner in ((0, 1), (1, 0)):
            contours = shapes[side].get(name)
            if contours is None:
                middle = _find_middle(shapes[partner][name])
                contours = [_shrink(curve, middle) for curve in shapes[partner][name]]
                styles[side].update({
                    layer: scale_paint(paint, POINT, middle * (1 - POINT))
                    for layer, paint in styles[partner].items()
                    if shape_of(layer) == name
                })  # fmt: skip
            curves[side].update({
                f"{name}{PART}{number}" if number > 1 else name: curve
                for number, curve in enumerate(contours, start=1)
            })  # fmt: skip
    return (
        replace(a, curves=curves[0], styles=styles[0]),
        replace(renamed, curves=curves[1], styles=styles[1]),
    )


def _rename_shapes(drawing: Drawing, names: Mapping[str, str]) -> Drawing:
    """Return a drawing whose shapes have other ids, of those that names gives; the others go."""
    layers = {
        layer: names[shape_of(layer)] + layer.removeprefix(shape_of(layer))
        for layer in drawing.curves
        if shape_of(layer) in names
    }
    return replace(
        drawing,
        curves={new: drawing.curves[old] for old, new in layers.items()},
        styles={new: drawing.styles[old] for old, new in layers.items() if old in drawing.styles},
        groups={new: drawing.groups[old] for old, new in layers.items() if old in drawing.groups},
    )


def _unused_name(name: str, used: Sequence[str]) -> str:
    """Return a name that is not used yet: itself, or with a number."""
    number, unique = 1, name
    while unique in used:
        number += 1
        unique = f"{name}-{number}"
    return unique


def _find_middle(contours: Sequence[Curve]) -> Points:
    """Return the middle (2,) of the largest contour of a shape."""
    return resample_curve(max(contours, key=_extent), POINTS).points.mean(axis=0)


def _shrink(curve: Curve, middle: Points) -> Curve:
    """Return a curve scaled by POINT about a point (2,)."""
    return Curve(middle + (curve.points - middle) * POINT, curve.closed)
