"""Morphs as files, by their ending: animated SVG, WebP, MP4, plain JSON, Lottie JSON.

A file appears under its name when it is complete. SVG and both JSONs hold the morph's numbers digit
for digit, so the frames have exactly the counted folds.
"""

import json
import zlib
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.drawing import Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import group_contours, paint_layers
from finloop.base.parallel import Threads, ordered_map
from finloop.io.animation_lottie import to_lottie
from finloop.io.animation_svg import to_svg
from finloop.io.atomic import save_bytes
from finloop.io.movie import Movie, Mp4Writer, WebpWriter
from finloop.io.video import THREADS

CRF, QUALITY = 18, 85
SLOWEST, FASTEST = 0.1, 1000  # frames per second: the limits of a film's clock
LARGEST_PX = 2048


def save_animation(path: Path, morph: Morph, frame_rate: Fraction, size: int = 512) -> None:
    """Write a morph as SVG, Lottie JSON, plain JSON, WebP or MP4: the ending of `path` says which.

    frame_rate: frames per second. size: the longer side [px] of WebP and MP4. FinloopError if the
    ending is not one of `ENDINGS`, the frame rate is not SLOWEST … FASTEST, or the size is not 16 …
    LARGEST_PX.
    """
    write = writer(path)
    if not SLOWEST <= frame_rate <= FASTEST:
        raise FinloopError(
            f"{float(frame_rate):g} frames per second",
            f"{SLOWEST:g} … {FASTEST} frames per second",
            "set --fps 30",
        )
    if not 16 <= size <= LARGEST_PX:
        raise FinloopError(f"a film {size} px large", f"16 … {LARGEST_PX} px", "set --size 512")
    write(path, morph, frame_rate, size)


def writer(path: Path) -> "Writer":
    """Return the function that writes a morph in the format of the ending of `path`.

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


def to_plain(morph: Morph) -> dict[str, Any]:
    """Convert a morph to plain values: `{"frames": [{"tau": t, "layers": {id: [[x, y], …]}}]}`.

    tau: 0 = the first drawing, 1 = the second. x, y: in units of the first drawing.
    """
    layers = {name: frames.tolist() for name, frames in morph.layers.items()}
    return {
        "frames": [
            {"tau": float(tau), "layers": {name: frames[k] for name, frames in layers.items()}}
            for k, tau in enumerate(morph.tau)
        ]
    }


def _save_svg(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    save_bytes(path, f"{to_svg(morph, frame_rate)}\n".encode())


def _save_plain(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    _save_json(path, to_plain(morph))


def _save_lottie(path: Path, morph: Morph, frame_rate: Fraction, size: int) -> None:
    _save_json(path, to_lottie(morph, frame_rate))


def _save_json(path: Path, content: dict[str, Any]) -> None:
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    save_bytes(path, f"{text}\n".encode())


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
    forms = group_contours(morph.closed, morph.styles, max(morph.width, morph.height))

    def paint_frame(frame: int) -> Picture:
        contours = [(form, [morph.layers[name][frame] for name in form.layers]) for form in forms]
        return paint_layers(contours, shape, scale)

    points = np.hstack([frames.reshape(len(frames), -1) for frames in morph.layers.values()])
    first, alike = np.unique(points, axis=0, return_index=True, return_inverse=True)[1:]
    equal = first[alike.ravel()]  # of each frame, the first that is equal
    again = {*equal[equal != np.arange(len(equal))].tolist()}
    new = ordered_map(paint_frame, np.sort(first).tolist(), Threads(THREADS))
    packed = dict[int, bytes]()  # repeated pictures; flat colours compress well
    for frame, one in enumerate(equal.tolist()):
        if one == frame:
            picture = next(new)
            if frame in again:
                packed[frame] = zlib.compress(picture.tobytes(), 1)
        else:
            pixels = np.frombuffer(zlib.decompress(packed[one]), np.uint8)
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
