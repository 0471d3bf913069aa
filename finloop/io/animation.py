"""Morphs as files, by their ending: animated SVG, WebP, MP4, plain JSON, Lottie JSON.

A file appears under its name when it is complete. SVG and both JSONs hold the morph's numbers digit
for digit, so the frames have exactly the counted folds.
"""

import json
from collections.abc import Callable, Iterator
from fractions import Fraction
from math import ceil
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from finloop.base.arrays import Ints, Picture
from finloop.base.drawing import Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import Colour, Paint, Shape, group_contours, paint_layers
from finloop.base.parallel import Threads, ordered_map
from finloop.io.atomic import save_bytes
from finloop.io.movie import FilmWriter, Mp4Writer, WebpWriter
from finloop.io.video import THREADS

CRF, QUALITY = 18, 85
SLOWEST, FASTEST = 0.1, 1000  # frames per second: the limits of a film's clock
LARGEST_PX = 2048
Json = dict[str, Any]


def save_animation(
    path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int = 512
) -> None:
    """Write a morph to `path`: as SVG, Lottie JSON, plain JSON, WebP or MP4, by the path's ending.

    frame_rate: frames per second. longer_side_px: of the pictures in WebP and MP4. FinloopError if
    the ending is not one of `ENDINGS`, or if rate or side are out of their ranges.
    """
    write = find_morph_writer(path)
    if not SLOWEST <= frame_rate <= FASTEST:
        raise FinloopError(
            f"{float(frame_rate):g} frames per second",
            f"{SLOWEST:g} … {FASTEST} frames per second",
            "set --fps 30",
        )
    if not 16 <= longer_side_px <= LARGEST_PX:
        raise FinloopError(
            f"a film {longer_side_px} px large", f"16 … {LARGEST_PX} px", "set --size 512"
        )
    write(path, morph, frame_rate, longer_side_px)


def find_morph_writer(path: Path) -> "Writer":
    """Return the function that writes morphs in the file format that the ending of `path` names.

    FinloopError if no format has this ending.
    """
    name = path.name.lower()
    for ending, write in ENDINGS.items():
        if name.endswith(ending) and name != ending:
            return write
    raise FinloopError(
        f"{path} has the ending {path.suffix or 'of no format'!r}",
        f"one of {', '.join(ENDINGS)}",
        "name the output after the format you want",
    )


def _save_plain(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as plain JSON: the points of every contour in every frame.

    The content is `{"frames": [{"tau": t, "layers": {id: [[x, y], …]}}]}`; tau is the share of the
    morph, 0 … 1. frame_rate and longer_side_px are not used: JSON has neither.
    """
    _save_json(path, {"frames": [
        {"tau": float(tau), "layers": {
            name: points[frame].tolist() for name, points in morph.layers.items()
        }}
        for frame, tau in enumerate(morph.tau)
    ]})  # fmt: skip


def _save_json(path: Path, content: Json) -> None:
    """Write plain values (dictionaries, lists, numbers, text) to a file as compact JSON."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    save_bytes(path, f"{text}\n".encode())


# --- animated SVG (SMIL): it plays by itself in every browser, without a script


def _save_svg(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as an SVG that plays by itself, with one animated path for every shape.

    Points are written as whole numbers, in units of the last decimal of the drawing's coordinates,
    each after the first relative to the previous one. That is exact, and half as long as decimals.
    frame_rate: frames per second. longer_side_px is not used: the picture is scalable.
    """
    grid = 10.0**morph.decimals  # units of a path in a px
    seconds = len(morph.tau) / frame_rate
    # The frame after the last one: the first if the morph goes there and back, else the same again.
    end_frame = 0 if morph.tau[-1] < morph.tau.max() else -1
    width, height = f"{morph.width:.10g}", f"{morph.height:.10g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        f' viewBox="0 0 {width} {height}">',
        f'<g transform="scale({1 / grid:.10g})" stroke-linejoin="round" stroke-linecap="round"'
        ' fill-rule="evenodd">',
    ]
    for shape in _painted_shapes(morph):
        contours = [np.round(morph.layers[name] * grid).astype(np.int64) for name in shape.layers]
        paths = [
            "".join(map(_svg_path_data, frame_contours, shape.closed))
            for frame_contours in zip(*contours, strict=True)
        ]
        lines.append(
            f"<path id={quoteattr(shape.name)} {_svg_paint_attributes(shape.paint, grid)}"
            f' d={quoteattr(paths[0])}><animate attributeName="d" dur="{float(seconds):.6g}s"'
            f' repeatCount="indefinite" values="{";".join([*paths, paths[end_frame]])}"/></path>'
        )
    save_bytes(path, "\n".join([*lines, "</g>", "</svg>", ""]).encode())


def _painted_shapes(morph: Morph) -> list[Shape]:
    """Return the painted shapes of a morph, bottom first; one shape can hold several contours."""
    return group_contours(morph.closed, morph.styles, max(morph.width, morph.height))


def _svg_path_data(points: Ints, closed: bool) -> str:
    """Return the `d` attribute of an SVG path through points (n, 2), whole numbers."""
    text = " ".join(map(str, np.diff(points, axis=0).ravel().tolist())).replace(" -", "-")
    return f"M{points[0, 0]} {points[0, 1]}l{text}{'z' if closed else ''}"


def _svg_paint_attributes(paint: Paint, grid: float) -> str:
    """Return the SVG attributes that paint a shape, fill and stroke; grid: path units per px."""
    style = {
        kind: "none" if colour is None else "#{:02x}{:02x}{:02x}".format(*colour)
        for kind, colour in (("fill", paint.fill), ("stroke", paint.stroke))
    }
    if paint.fill is not None and paint.fill_opacity < 1:
        style["fill-opacity"] = f"{paint.fill_opacity:.4g}"
    if paint.stroke is not None:
        style["stroke-width"] = f"{paint.width * grid:.6g}"
        if paint.stroke_opacity < 1:
            style["stroke-opacity"] = f"{paint.stroke_opacity:.4g}"
    return " ".join(f'{key}="{value}"' for key, value in style.items())


# --- Lottie (version 5.7), the vector animation of apps and web pages


def _save_lottie(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as Lottie JSON, with a layer for each shape and a keyframe for each frame.

    The topmost shape is first. Players interpolate linearly between keyframes. frame_rate: frames
    per second. longer_side_px is not used: the picture is scalable.
    """
    layers = [
        _lottie_layer(morph, shape, k) for k, shape in enumerate(_painted_shapes(morph)[::-1], 1)
    ]
    # fr: frames per second; ip, op: first frame, and the one after the last; ddd: three dimensions.
    _save_json(path, {
        "v": "5.7.0", "fr": float(frame_rate), "ip": 0, "op": len(morph.tau),
        "w": ceil(morph.width), "h": ceil(morph.height), "nm": "morph", "ddd": 0, "assets": [],
        "layers": layers,
    })  # fmt: skip


def _lottie_layer(morph: Morph, shape: Shape, index: int) -> Json:
    """Return the Lottie layer of one shape; index: the layer's number, 1 = topmost."""
    # Opacity, rotation, position, anchor and scale that change nothing.
    transform = {"o": 100, "r": 0, "p": [0, 0], "a": [0, 0], "s": [100, 100]}
    still = {key: _lottie_constant(value) for key, value in transform.items()}
    items = [
        *(_lottie_path(morph, *part) for part in zip(shape.layers, shape.closed, strict=True)),
        *_lottie_paints(shape.paint),
        {"ty": "tr", **still},
    ]
    # Type 4 is a layer of shapes, "gr" a group of them, "tr" its transform.
    return {
        "ddd": 0, "ind": index, "ty": 4, "nm": shape.name, "sr": 1, "ks": still, "ao": 0,
        "shapes": [{"ty": "gr", "nm": shape.name, "it": items}],
        "ip": 0, "op": len(morph.tau), "st": 0, "bm": 0,
    }  # fmt: skip


def _lottie_path(morph: Morph, name: str, closed: bool) -> Json:
    """Return the Lottie path of one contour of a morph, with a keyframe for each frame.

    name: of the contour in `morph.layers`. closed: whether its end joins its beginning.
    """
    frames = morph.layers[name].tolist()
    straight = [[0, 0]] * len(frames[0])  # tangents of length 0: polylines
    keys: list[Json] = [
        {"t": k, "s": [{"i": straight, "o": straight, "v": points, "c": closed}]}
        for k, points in enumerate(frames)
    ]
    # Linear easing to the next keyframe; the last has none, or players would look for one more.
    for key in keys[:-1]:
        key |= {"i": {"x": 1, "y": 1}, "o": {"x": 0, "y": 0}}
    return {"ty": "sh", "nm": name, "ks": {"a": 1, "k": keys}}


def _lottie_paints(paint: Paint) -> list[Json]:
    """Return the Lottie items that paint a shape: its stroke before its fill, which lies below."""

    def paint_item(kind: str, colour: Colour, opacity: float) -> Json:
        """Return one Lottie stroke ("st") or fill ("fl"); opacity: 0 … 1."""
        rgb = [round(level / 255, 4) for level in colour]
        return {"ty": kind, "c": _lottie_constant([*rgb, 1]), "o": _lottie_constant(100 * opacity)}

    paints: list[Json] = []
    if paint.stroke is not None:
        stroke = paint_item("st", paint.stroke, paint.stroke_opacity)
        round_ends = {"lc": 2, "lj": 2}  # caps and joins
        paints.append(stroke | {"w": _lottie_constant(paint.width)} | round_ends)
    if paint.fill is not None:
        even_odd = {"r": 2}
        paints.append(paint_item("fl", paint.fill, paint.fill_opacity) | even_odd)
    return paints


def _lottie_constant(value: object) -> Json:
    """Return the Lottie form of a value that does not change during the animation."""
    return {"a": 0, "k": value}


# --- films


def _save_film(path: Path, morph: Morph, frame_rate: Fraction, longer_side_px: int) -> None:
    """Write a morph as a film: MP4 if the ending of `path` is .mp4, else animated WebP.

    frame_rate: frames per second. longer_side_px: longer side of the pictures.
    """
    scale = longer_side_px / max(morph.width, morph.height)
    # Both formats need even sides.
    height, width = (2 * max(1, round(side * scale / 2)) for side in (morph.height, morph.width))
    shape = height, width, 3
    film: FilmWriter
    if path.suffix.lower() == ".mp4":
        film = Mp4Writer(path, shape, frame_rate, CRF)
    else:
        film = WebpWriter(path, shape, frame_rate, width, QUALITY)
    with film:
        for picture in _paint_frames(morph, (height, width), scale):
            film.write(picture)


def _paint_frames(morph: Morph, shape: tuple[int, int], scale: float) -> Iterator[Picture]:
    """Yield the picture (h, w, 3) of every frame of a morph.

    shape: height and width of the pictures [px]. scale: px of the picture per px of the drawing.
    """
    shapes = _painted_shapes(morph)

    def paint_frame(frame: int) -> Picture:
        """Return the picture (h, w, 3) of the frame with a number."""
        contours = [(item, [morph.layers[name][frame] for name in item.layers]) for item in shapes]
        return paint_layers(contours, shape, scale)

    return ordered_map(paint_frame, range(len(morph.tau)), Threads(THREADS))


Writer = Callable[[Path, Morph, Fraction, int], None]
ENDINGS: dict[str, Writer] = {
    ".svg": _save_svg,
    ".lottie.json": _save_lottie,
    ".json": _save_plain,
    ".webp": _save_film,
    ".mp4": _save_film,
}
