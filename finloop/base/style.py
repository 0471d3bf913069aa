"""How shapes are painted: colours, gradients, strokes and dashes, and paints between two paints.

Colours are mixed in Oklab: B. Ottosson, "A perceptual color space for image processing" (2020).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import lcm
from typing import Literal, NamedTuple

import numpy as np

from finloop.base.arrays import Points

Colour = tuple[int, int, int]
"""Red, green, blue, 0 … 255, as in sRGB."""


class Stop(NamedTuple):
    """A colour of a gradient; offset: its place, 0 … 1; opacity: 0 … 1."""

    offset: float
    colour: Colour
    opacity: float


@dataclass(frozen=True)
class Gradient:
    """Colours along a line, or from a focus to a circle around it.

    In its own plane the line runs from (0, 0) to (1, 0), and the circle is the unit circle.
    """

    kind: Literal["linear", "radial"]
    stops: tuple[Stop, ...]  # one or more, by rising offset
    matrix: tuple[float, float, float, float, float, float]
    """a … f as in SVG, from its plane to the drawing: x′ = a x + c y + e, y′ = b x + d y + f."""
    focus: tuple[float, float] = (0.0, 0.0)  # within the unit circle; radial only
    spread: Literal["pad", "reflect", "repeat"] = "pad"  # how it goes on beyond its ends


Fill = Colour | Gradient | None


@dataclass(frozen=True)
class Paint:
    """How a shape is painted; None where nothing is painted."""

    fill: Fill
    stroke: Fill
    fill_opacity: float  # 0 … 1
    stroke_opacity: float
    width: float  # of the stroke, in units of the drawing
    # lengths of dashes and gaps in turn, an even number, in units of the drawing; () = no gaps
    dashes: tuple[float, ...] = ()
    dash_offset: float = 0.0  # where in the dashes the line begins
    round_dashes: bool = False  # whether dashes have round ends, else straight ones
    leaves_gaps: bool = False  # whether the dashes are what a cut or a lost hole leaves of a line


# --- between two paints

_LMS = np.array([
    [0.4122214708, 0.5363325363, 0.0514459929],
    [0.2119034982, 0.6806995451, 0.1073969566],
    [0.0883024619, 0.2817188376, 0.6299787005],
])  # fmt: skip
_LAB = np.array([
    [0.2104542553, 0.7936177850, -0.0040720468],
    [1.9779984951, -2.4285922050, 0.4505937099],
    [0.0259040371, 0.7827717662, -0.8086757660],
])  # fmt: skip


def format_colour(colour: Colour) -> str:
    """Return a colour as #rrggbb."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def colour_to_oklab(colour: Colour) -> Points:
    """Return an sRGB colour as Oklab (3,): lightness 0 … 1, green to red, blue to yellow."""
    srgb = np.asarray(colour, np.float64) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    lab: Points = _LAB @ np.cbrt(_LMS @ linear)
    return lab


def oklab_to_colour(lab: Points) -> Colour:
    """Return an Oklab colour (3,) as the nearest 8-bit sRGB colour, each channel clipped."""
    linear = np.clip(np.linalg.solve(_LMS, np.linalg.solve(_LAB, lab) ** 3), 0, 1)
    srgb = np.where(linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055)
    red, green, blue = np.round(255 * srgb).astype(int).tolist()
    return red, green, blue


def mix_colours(a: Colour, b: Colour, share: float) -> Colour:
    """Return the colour between a and b in Oklab; share: 0 gives a, 1 gives b."""
    if a == b:
        return a
    return oklab_to_colour((1 - share) * colour_to_oklab(a) + share * colour_to_oklab(b))


def mix_paints(a: Paint, b: Paint, share: float) -> Paint:
    """Mix two paints; share: 0 gives what a shows, 1 what b shows.

    A fill or stroke that only one of them has becomes transparent towards the other. A line without
    dashes counts as the other's dashes without gaps.
    """
    fill, fill_opacity = _mix_fills(a.fill, a.fill_opacity, b.fill, b.fill_opacity, share)
    stroke, stroke_opacity = _mix_fills(
        a.stroke, a.stroke_opacity, b.stroke, b.stroke_opacity, share
    )
    # A missing stroke has the width and the dashes of the other.
    line_a, line_b = (b if a.stroke is None else a), (a if b.stroke is None else b)
    width = _mix(line_a.width, line_b.width, share)
    paint = Paint(fill, stroke, fill_opacity, stroke_opacity, width)
    if not line_a.dashes and not line_b.dashes:
        return paint
    # As CSS interpolates lists of dashes.
    line_a, line_b = align_dashes([line_a, line_b])
    pairs = zip(line_a.dashes, line_b.dashes, strict=True)
    dashes = tuple(_mix(*pair, share) for pair in pairs)
    if not any(dashes[1::2]):
        return paint  # a whole line
    return replace(
        paint,
        dashes=dashes,
        dash_offset=_mix(line_a.dash_offset, line_b.dash_offset, share),
        round_dashes=(line_a if share < 0.5 else line_b).round_dashes,
    )


def _mix(a: float, b: float, share: float) -> float:
    """Return the number between a and b; share: 0 gives a, 1 gives b."""
    return (1 - share) * a + share * b


def _give_dashes(line: Paint, other: Paint) -> Paint:
    """Return a line with dashes: its own, or for a whole line those of `other`, without gaps."""
    if line.dashes:
        return line
    pairs = zip(other.dashes[::2], other.dashes[1::2], strict=True)
    dashes = tuple(length for dash, gap in pairs for length in (dash + gap, 0.0))
    return replace(
        line, dashes=dashes, dash_offset=other.dash_offset, round_dashes=other.round_dashes
    )


def align_dashes(lines: Sequence[Paint]) -> list[Paint]:
    """Return lines with equally many dashes, so that players can interpolate them.

    A shorter list of dashes repeats. A whole line gets those of the first line that has some.
    """
    dashed = next((line for line in lines if line.dashes), None)
    if dashed is None:
        return list(lines)
    lines = [_give_dashes(line, dashed) for line in lines]
    count = lcm(*(len(line.dashes) for line in lines))
    return [replace(line, dashes=line.dashes * (count // len(line.dashes))) for line in lines]


def _mix_fills(
    a: Fill, a_opacity: float, b: Fill, b_opacity: float, share: float
) -> tuple[Fill, float]:
    """Return the fill between a and b, and its opacity; share: 0 gives a, 1 gives b."""
    if a is None and b is None:
        return None, 1.0
    if a is None:
        a, a_opacity = b, 0.0
    if b is None:
        b, b_opacity = a, 0.0
    opacity = _mix(a_opacity, b_opacity, share)
    if isinstance(a, Gradient) and isinstance(b, Gradient) and a.kind != b.kind:
        # No gradient lies between a line and a circle: by way of one colour.
        colour = mix_colours(_mean_colour(a), _mean_colour(b), 0.5)
        flat_opacity = float(np.mean([stop.opacity for stop in (*a.stops, *b.stops)]))
        half = (a, _flatten_gradient(a, colour, flat_opacity), 2 * share)
        if share > 0.5:
            half = (_flatten_gradient(b, colour, flat_opacity), b, 2 * share - 1)
        return _mix_gradients(*half), opacity
    # A colour counts as a gradient of one colour.
    if isinstance(a, Gradient):
        other = b if isinstance(b, Gradient) else _flatten_gradient(a, b)
        return _mix_gradients(a, other, share), opacity
    if isinstance(b, Gradient):
        return _mix_gradients(_flatten_gradient(b, a), b, share), opacity
    return (None if a is None or b is None else mix_colours(a, b, share)), opacity


def _mean_colour(gradient: Gradient) -> Colour:
    """Return the mean of a gradient's stops, in Oklab."""
    mean: Points = np.mean([colour_to_oklab(stop.colour) for stop in gradient.stops], axis=0)
    return oklab_to_colour(mean)


def _flatten_gradient(gradient: Gradient, colour: Colour | None, opacity: float = 1.0) -> Gradient:
    """Return a gradient with one colour and opacity at all its stops."""
    if colour is None:
        return gradient
    stops = tuple(Stop(stop.offset, colour, opacity) for stop in gradient.stops)
    return replace(gradient, stops=stops)


def _mix_gradients(a: Gradient, b: Gradient, share: float) -> Gradient:
    """Return the gradient between two of one kind; share: 0 gives a, 1 gives b.

    Stops pair by their order. If their numbers differ, both get stops at the other's offsets, too.
    """
    stops_a, stops_b = a.stops, b.stops
    if len(stops_a) != len(stops_b):
        stops_a, stops_b = _add_stops(a, b), _add_stops(b, a)
    stops = tuple(
        Stop(
            _mix(one.offset, other.offset, share),
            mix_colours(one.colour, other.colour, share),
            _mix(one.opacity, other.opacity, share),
        )
        for one, other in zip(stops_a, stops_b, strict=True)
    )
    matrix = (1 - share) * np.array(a.matrix) + share * np.array(b.matrix)
    focus = _mix(a.focus[0], b.focus[0], share), _mix(a.focus[1], b.focus[1], share)
    spread = (a if share < 0.5 else b).spread
    return Gradient(a.kind, stops, _to_matrix(matrix), focus, spread)


def _add_stops(gradient: Gradient, other: Gradient) -> tuple[Stop, ...]:
    """Return a gradient's stops, and more at another one's offsets that change nothing of it.

    Where one of them has a hard edge, two stops at one offset, there are two: before and after it.
    """
    offsets = [[stop.offset for stop in one.stops] for one in (gradient, other)]
    stops = list[Stop]()
    for offset in sorted({*offsets[0], *offsets[1]}):
        own = [stop for stop in gradient.stops if stop.offset == offset]
        if not own:
            red, green, blue, opacity = colours_at(gradient, np.array(offset)).tolist()
            own = [Stop(offset, (round(red), round(green), round(blue)), opacity)]
        is_edge = max(one.count(offset) for one in offsets) > 1
        stops += [own[0], own[-1]] if is_edge else own
    return tuple(stops)


def colours_at(gradient: Gradient, offsets: Points) -> Points:
    """Return a gradient's colour (…, 4) at offsets (…): red, green, blue 0 … 255, opacity 0 … 1.

    Between two stops, colours change evenly in sRGB, as SVG says.
    """
    places = [stop.offset for stop in gradient.stops]
    channels = np.array([[*stop.colour, stop.opacity] for stop in gradient.stops]).T
    return np.stack([np.interp(offsets, places, channel) for channel in channels], axis=-1)


# --- gradients in the plane


def _to_matrix(values: Points) -> tuple[float, float, float, float, float, float]:
    """Convert an array of six numbers to the matrix of a gradient, a tuple of floats."""
    a, b, c, d, e, f = values.tolist()
    return a, b, c, d, e, f


def move_fill(fill: Fill, turn: Points, shift: Points) -> Fill:
    """Return a fill whose gradient moves as points do: p → p @ turn + shift; colours stay.

    turn: (2, 2); shift: (2,), in units of the drawing.
    """
    if not isinstance(fill, Gradient):
        return fill
    rows = np.reshape(fill.matrix, (3, 2)) @ turn + [[0, 0], [0, 0], shift]
    return replace(fill, matrix=_to_matrix(rows.ravel()))


def move_paint(paint: Paint, turn: Points, shift: Points) -> Paint:
    """Return a paint whose gradients move as points do: p → p @ turn + shift."""
    fill, stroke = (move_fill(fill, turn, shift) for fill in (paint.fill, paint.stroke))
    return replace(paint, fill=fill, stroke=stroke)


def scale_paint(paint: Paint, scale: float, shift: Points) -> Paint:
    """Return the paint of a shape that is scaled and then shifted; shift: (2,)."""
    return replace(
        move_paint(paint, scale * np.eye(2), shift),
        width=scale * paint.width,
        dashes=tuple(scale * length for length in paint.dashes),
        dash_offset=scale * paint.dash_offset,
    )


def gradient_offsets(gradient: Gradient, points: Points) -> Points:
    """Return the offsets (…), 0 … 1, at which a gradient colours points (…, 2) of the drawing.

    A gradient without length or radius has the colour of its last stop everywhere.
    """
    rows = np.reshape(gradient.matrix, (3, 2))
    if abs(np.linalg.det(rows[:2])) < 1e-12 * max(1.0, float(np.abs(rows[:2]).max()) ** 2):
        return np.ones(points.shape[:-1])
    own = (points - rows[2]) @ np.linalg.inv(rows[:2])
    if gradient.kind == "linear":
        offset = own[..., 0]
    else:
        # At offset t, a circle of radius t whose centre moves from the focus to 0: the greatest t
        # with |focus + (p − focus) / t| = 1.
        focus = np.array(gradient.focus)
        way = own - focus
        along, left = way @ focus, 1 - focus @ focus
        offset = (along + np.sqrt(along**2 + left * (way**2).sum(axis=-1))) / left
    if gradient.spread == "pad":
        return np.clip(offset, 0, 1)
    if gradient.spread == "repeat":
        return offset % 1
    return 1 - np.abs(1 - offset % 2)
