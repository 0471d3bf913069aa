"""A morph as SVG that plays by itself (SMIL), in every browser and without a script."""

from fractions import Fraction
from xml.sax.saxutils import quoteattr

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.drawing import Morph
from finloop.base.paint import Paint, Shape, group_contours


def to_svg(morph: Morph, frame_rate: Fraction) -> str:
    """Return the text of an SVG that plays a morph for ever: an animated path for every shape.

    frame_rate: frames per second. Points are whole numbers on the morph's grid, each after the
    first relative to the previous one. That is exact, and half as long as decimals.
    """
    grid = 10.0**morph.decimals
    seconds = len(morph.tau) / frame_rate  # as films last
    # The frame after the last: itself, or the first of a morph that goes there and back.
    after = 0 if morph.tau[-1] < morph.tau.max() else -1
    size = f"{morph.width:.10g} {morph.height:.10g}".split()
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}" height="{size[1]}"'
        f' viewBox="0 0 {size[0]} {size[1]}">',
        f'<g transform="scale({1 / grid:.10g})" stroke-linejoin="round" stroke-linecap="round"'
        ' fill-rule="evenodd">',
    ]
    for shape in group_contours(morph.closed, morph.styles, max(morph.width, morph.height)):
        frames, style = _frames(morph, shape, grid), _style(shape.paint, grid)
        lines.append(
            f"<path id={quoteattr(shape.name)} {style} d={quoteattr(frames[0])}>"
            f'<animate attributeName="d" dur="{float(seconds):.6g}s" repeatCount="indefinite"'
            f' values="{";".join([*frames, frames[after]])}"/></path>'
        )
    return "\n".join([*lines, "</g>", "</svg>"])


def _frames(morph: Morph, shape: Shape, grid: float) -> list[str]:
    parts = [
        (np.round(morph.layers[name] * grid).astype(np.int64), closed)
        for name, closed in zip(shape.layers, shape.closed, strict=True)
    ]
    return [
        "".join(_path(frames[k], closed) for frames, closed in parts) for k in range(len(morph.tau))
    ]


def _path(points: Ints, closed: bool) -> str:
    first, moves = points[0], np.diff(points, axis=0).ravel()
    text = " ".join(map(str, moves.tolist())).replace(" -", "-")
    return f"M{first[0]} {first[1]}l{text}{'z' if closed else ''}"


def _style(paint: Paint, grid: float) -> str:
    style = {"fill": _hex(paint.fill), "stroke": _hex(paint.stroke)}
    if paint.fill is not None and paint.fill_opacity < 1:
        style["fill-opacity"] = f"{paint.fill_opacity:.4g}"
    if paint.stroke is not None:
        style["stroke-width"] = f"{paint.width * grid:.6g}"
        if paint.stroke_opacity < 1:
            style["stroke-opacity"] = f"{paint.stroke_opacity:.4g}"
    return " ".join(f'{key}="{value}"' for key, value in style.items())


def _hex(colour: tuple[int, int, int] | None) -> str:
    return "none" if colour is None else "#{:02x}{:02x}{:02x}".format(*colour)
