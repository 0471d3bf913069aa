"""Morphs as files, by their ending: animated SVG, WebP, MP4, plain JSON, Lottie JSON.

A file appears under its name when it is complete. SVG and both JSONs hold the morph's numbers digit
for digit, so the frames have exactly the counted folds.
"""

import json
import zlib
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
from finloop.io.movie import Movie, Mp4Writer, WebpWriter
from finloop.io.video import THREADS

CRF, QUALITY = 18, 85
SLOWEST, FASTEST = 0.1, 1000  # frames per second: the limits of a film's clock
LARGEST_PX = 2048
Json = dict[str, Any]


def save_animation(path: Path, morph: Morph, frame_rate: Fraction, size: int = 512) -> None:
    """Write a morph as SVG, Lottie JSON, plain JSON, WebP or MP4: the ending of `path` says which.

    frame_rate: frames per second. size: the longer side [px] of WebP and MP4. FinloopError if the
    ending is not one of `ENDINGS`, or rate or size are out of their ranges.
    """
    write = find_writer(path)
    if not SLOWEST <= frame_rate <= FASTEST:
        raise FinloopError(
            f"{float(frame_rate):g} frames per second",
            f"{SLOWEST:g} … {FASTEST} frames per second",
            "set --fps 30",
        )
    if not 16 <= size <= LARGEST_PX:
        raise FinloopError(f"a film {size} px large", f"16 … {LARGEST_PX} px", "set --size 512")
    write(path, morph, frame_rate, size)


def find_writer(path: Path) -> "Writer":
    """Return the function that writes a morph in the format that the ending of `path` names.

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


def _save_plain(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    """Write a morph as `{"frames": [{"tau": t, "layers": {id: [[x, y], …]}}]}`."""
    layers = {name: frames.tolist() for name, frames in morph.layers.items()}
    frames = [
        {"tau": float(tau), "layers": {name: frames[k] for name, frames in layers.items()}}
        for k, tau in enumerate(morph.tau)
    ]
    _save_json(path, {"frames": frames})


def _save_json(path: Path, content: Json) -> None:
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    save_bytes(path, f"{text}\n".encode())


# --- animated SVG (SMIL): it plays by itself in every browser, without a script


def _save_svg(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    """Write a morph as an SVG with an animated path for every shape, repeated for ever.

    Points are whole numbers on the morph's grid, each after the first relative to the previous one.
    That is exact, and half as long as decimals.
    """
    grid = 10.0**morph.decimals
    seconds = len(morph.tau) / frame_rate  # as films last
    # The frame after the last: itself, or the first of a morph that goes there and back.
    after = 0 if morph.tau[-1] < morph.tau.max() else -1
    width, height = f"{morph.width:.10g}", f"{morph.height:.10g}"
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}"'
        f' viewBox="0 0 {width} {height}">',
        f'<g transform="scale({1 / grid:.10g})" stroke-linejoin="round" stroke-linecap="round"'
        ' fill-rule="evenodd">',
    ]
    for shape in _shapes(morph):
        parts = [np.round(morph.layers[name] * grid).astype(np.int64) for name in shape.layers]
        frames = [
            "".join(map(_svg_path, frame, shape.closed)) for frame in zip(*parts, strict=True)
        ]
        lines.append(
            f"<path id={quoteattr(shape.name)} {_svg_style(shape.paint, grid)}"
            f' d={quoteattr(frames[0])}><animate attributeName="d" dur="{float(seconds):.6g}s"'
            f' repeatCount="indefinite" values="{";".join([*frames, frames[after]])}"/></path>'
        )
    save_bytes(path, "\n".join([*lines, "</g>", "</svg>", ""]).encode())


def _shapes(morph: Morph) -> list[Shape]:
    return group_contours(morph.closed, morph.styles, max(morph.width, morph.height))


def _svg_path(points: Ints, closed: bool) -> str:
    text = " ".join(map(str, np.diff(points, axis=0).ravel().tolist())).replace(" -", "-")
    return f"M{points[0, 0]} {points[0, 1]}l{text}{'z' if closed else ''}"


def _svg_style(paint: Paint, grid: float) -> str:
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


def _save_lottie(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    """Write a morph as Lottie JSON: a layer for each shape, a keyframe for each frame.

    The topmost shape is first. Players interpolate linearly between keyframes.
    """
    layers = [_lottie_layer(morph, shape, k) for k, shape in enumerate(_shapes(morph)[::-1], 1)]
    _save_json(path, {
        "v": "5.7.0", "fr": float(frame_rate), "ip": 0, "op": len(morph.tau),
        "w": ceil(morph.width), "h": ceil(morph.height), "nm": "morph", "ddd": 0, "assets": [],
        "layers": layers,
    })  # fmt: skip


def _lottie_layer(morph: Morph, shape: Shape, index: int) -> Json:
    transform = {"o": 100, "r": 0, "p": [0, 0], "a": [0, 0], "s": [100, 100]}  # changes nothing
    still = {key: _constant(value) for key, value in transform.items()}
    items = [
        *(_lottie_path(morph, *part) for part in zip(shape.layers, shape.closed, strict=True)),
        *_lottie_paints(shape.paint),
        {"ty": "tr", **still},
    ]
    return {
        "ddd": 0, "ind": index, "ty": 4, "nm": shape.name, "sr": 1, "ks": still, "ao": 0,
        "shapes": [{"ty": "gr", "nm": shape.name, "it": items}],
        "ip": 0, "op": len(morph.tau), "st": 0, "bm": 0,
    }  # fmt: skip


def _lottie_path(morph: Morph, name: str, closed: bool) -> Json:
    frames = morph.layers[name].tolist()
    straight = [[0, 0]] * len(frames[0])
    keys: list[Json] = [
        {"t": k, "s": [{"i": straight, "o": straight, "v": points, "c": closed}]}
        for k, points in enumerate(frames)
    ]
    for key in keys[:-1]:  # players take a keyframe with easing for the start of another step
        key |= {"i": {"x": 1, "y": 1}, "o": {"x": 0, "y": 0}}
    return {"ty": "sh", "nm": name, "ks": {"a": 1, "k": keys}}


def _lottie_paints(paint: Paint) -> list[Json]:
    """Return stroke before fill: the first lies on top."""

    def paint_item(kind: str, colour: Colour, opacity: float) -> Json:
        rgb = [round(c / 255, 4) for c in colour]
        return {"ty": kind, "c": _constant([*rgb, 1]), "o": _constant(100 * opacity)}

    paints: list[Json] = []
    if paint.stroke is not None:
        stroke = paint_item("st", paint.stroke, paint.stroke_opacity)
        paints.append(stroke | {"w": _constant(paint.width), "lc": 2, "lj": 2})
    if paint.fill is not None:
        paints.append(paint_item("fl", paint.fill, paint.fill_opacity) | {"r": 2})
    return paints


def _constant(value: object) -> Json:
    return {"a": 0, "k": value}


# --- films


def _save_film(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    scale = size / max(morph.width, morph.height)
    # Both formats need even sides.
    height, width = (2 * max(1, round(s * scale / 2)) for s in (morph.height, morph.width))
    shape = height, width, 3
    film: Movie = WebpWriter(path, shape, frame_rate, width, QUALITY)
    if path.suffix.lower() == ".mp4":
        film = Mp4Writer(path, shape, frame_rate, CRF)
    with film:
        for picture in _paint_frames(morph, shape[:2], scale):
            film.write(picture)


def _paint_frames(morph: Morph, shape: tuple[int, int], scale: float) -> Iterator[Picture]:
    """Yield the picture (h, w, 3) of every frame; paint equal frames once."""
    forms = _shapes(morph)

    def paint_frame(frame: int) -> Picture:
        contours = [(form, [morph.layers[name][frame] for name in form.layers]) for form in forms]
        return paint_layers(contours, shape, scale)

    points = np.hstack([frames.reshape(len(frames), -1) for frames in morph.layers.values()])
    first, alike = np.unique(points, axis=0, return_index=True, return_inverse=True)[1:]
    equal = first[alike.ravel()]  # of each frame, the first that is equal
    again = {*equal[equal != np.arange(len(equal))].tolist()}
    new = ordered_map(paint_frame, np.sort(first).tolist(), Threads(THREADS))
    packed = dict[int, bytes]()  # repeated pictures; flat colours compress well
    for frame, first_equal in enumerate(equal.tolist()):
        if first_equal == frame:
            picture = next(new)
            if frame in again:
                packed[frame] = zlib.compress(picture.tobytes(), 1)
        else:
            pixels = np.frombuffer(zlib.decompress(packed[first_equal]), np.uint8)
            picture = pixels.reshape(*shape, 3)
        yield picture


Writer = Callable[[Path, Morph, Fraction, int], None]
ENDINGS: dict[str, Writer] = {
    ".svg": _save_svg,
    ".lottie.json": _save_lottie,
    ".json": _save_plain,
    ".webp": _save_film,
    ".mp4": _save_film,
}
