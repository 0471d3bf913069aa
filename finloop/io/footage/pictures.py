"""Folders of pictures and stacks of TIFF pages: their order, and their frames."""

import re
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from tifffile import TiffFile, TiffFileError

from finloop.base.errors import FinloopError
from finloop.base.parallel import Threads, ordered_map
from finloop.io.footage.source import (
    CHROMA_FRACTION,
    SAMPLES,
    Footage,
    LostFrames,
    NumberedFrames,
    choose_deep_levels,
    is_in_range,
    measure_chroma_fraction,
    other_size_error,
    stretch_levels,
    thin_frame,
    too_few_error,
)
from finloop.io.video import THREADS

SUFFIXES = {".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".jp2"}
SUFFIXES |= {".pgm", ".ppm", ".pnm"}


Load = Callable[[int], np.ndarray]
"""Loads a picture by its number, as stored: (h, w) grey or (h, w, 3) RGB."""


@contextmanager
def _open_album(path: Path) -> Iterator[tuple[list[str], Load]]:
    """Open a folder of pictures or a TIFF of several pages.

    Yield the names of the pictures or pages, and a function that loads one by its number, from 0.
    """
    if path.is_dir():
        files = _list_pictures(path)
        yield [str(file) for file in files], lambda k: _load_picture(files[k])
        return
    try:
        with TiffFile(path) as stack:
            names = [f"{path}, page {k + 1}," for k in range(len(stack.pages))]
            yield names, partial(_load_page, stack)
    except (TiffFileError, OSError) as error:
        raise FinloopError(
            came=f"{path} cannot be read as a TIFF: {error}",
            wanted="a TIFF with a page for each frame",
            do="save it as a folder of pictures",
        ) from error


def open_pictures(
    path: Path, rate: Fraction | None, colour: bool | None
) -> tuple[Footage, np.ndarray]:
    """Inspect a folder of pictures or a TIFF; return its facts and its frames' times [s], from 0.

    rate: frames per second, required. colour: whether frames will be RGB; None = where they have
    colours. FinloopError without a rate, or for fewer than two pictures.
    """
    with _open_album(path) as (names, load):
        if len(names) < 2:
            raise too_few_error(path, len(names))
        if rate is None:
            raise FinloopError(
                came=f"{path}: {len(names)} pictures, which do not state how fast they were shot",
                wanted="their frame rate",
                do="give it: -S clip.frame_rate_hz=30.0",
            )
        first = load(0)
        numbers = np.unique(np.linspace(0, len(names) - 1, SAMPLES).astype(int))
        samples = [thin_frame(load(int(k))) for k in numbers]
        times = np.arange(len(names)) / float(rate)
    levels = None if first.dtype == np.uint8 else choose_deep_levels(samples)
    if colour is None:
        rgb = (_to_uint8(sample, True, levels) for sample in samples)
        colour = measure_chroma_fraction(rgb) > CHROMA_FRACTION
    footage = Footage(
        path=path,
        width_px=first.shape[1],
        height_px=first.shape[0],
        frame_rate=rate,
        colour=colour,
        frames_expected=len(times),
        reader=_read_picture_frames,
        frames_in_source=len(times),
        levels=levels,
        renumbered=True,
        last_s=float(times[-1]),
    )
    return footage, times


def _list_pictures(folder: Path) -> list[Path]:
    """Return the pictures of a folder in natural order: 2 before 10.

    FinloopError if there are none, or pictures of several kinds.
    """
    files = [
        file
        for file in folder.iterdir()
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
    ]
    kinds = Counter(file.suffix.lower() for file in files)
    if not files:
        raise FinloopError(
            came=f"the folder {folder} holds no pictures",
            wanted=f"the frames of one film, all of one kind: {' '.join(sorted(SUFFIXES))}",
            do="name that folder, or the film itself",
        )
    if len(kinds) > 1:
        raise FinloopError(
            came=f"{folder} holds pictures of several kinds: "
            + ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())),
            wanted="the frames of one film and no other picture",
            do="move the others away (a mask, a background, a preview)",
        )
    return sorted(files, key=natural_sort_key)


def natural_sort_key(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts paths by name, with frame2 before frame10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts] + [
        (0, path.name)
    ]


def _load_picture(path: Path) -> np.ndarray:
    """Load a picture file as stored: (h, w) grey or (h, w, 3) RGB, upright by its EXIF."""
    data = np.fromfile(path, np.uint8)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
    picture = cv2.imdecode(data, flags) if data.size else None
    if picture is None:
        raise FinloopError(
            came=f"{path} cannot be read as a picture",
            wanted="a folder whose files are all complete",
            do="copy it again, or move it away",
        )
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def _load_page(stack: TiffFile, number: int) -> np.ndarray:
    """Load one page of a TIFF, from 0, as stored: (h, w) grey or (h, w, 3) RGB."""
    try:
        picture = stack.pages[number].asarray()
    except ValueError as error:  # a compression that is not supported
        raise FinloopError(
            came=f"{stack.filehandle.path}, page {number + 1}, cannot be read: {error}",
            wanted="a stack that is not compressed, or by deflate",
            do="save it in one of these ways, or as a folder of pictures",
        ) from error
    if picture.ndim == 3 and picture.shape[2] in (3, 4):
        return picture[..., :3]
    if picture.ndim == 2:
        return picture
    raise FinloopError(
        came=f"{stack.filehandle.path}, page {number + 1}, has the shape {picture.shape}",
        wanted="pages of height × width, grey or RGB",
        do="split its channels, or save it as a folder of pictures",
    )


def _to_uint8(picture: np.ndarray, colour: bool, levels: tuple[float, float] | None) -> np.ndarray:
    """Convert a picture to uint8, RGB if `colour` or else grey.

    levels: those that become 0 and 255, of a picture of more than 8 bits; None for 8 bits.
    """
    if levels:
        picture = stretch_levels(picture, *levels)
    if colour and picture.ndim == 2:
        return cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)
    if not colour and picture.ndim == 3:
        return cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
    return picture


def _read_picture_frames(footage: Footage, _: LostFrames) -> NumberedFrames:
    """Yield the frames of a folder or TIFF, each with its time and number.

    It is the `reader` of their `Footage`; see `Footage.stream_numbered`.
    """
    size = footage.width_px, footage.height_px
    with _open_album(footage.path) as (names, load):

        def load_frame(number: int) -> tuple[float, tuple[int, np.ndarray]]:
            """Load one picture and check its size and depth; return (time, (number, picture))."""
            picture = load(number)
            if picture.shape[1::-1] != size:
                raise other_size_error(names[number], picture.shape[1::-1], size)
            if (picture.dtype == np.uint8) == (footage.levels is not None):
                raise FinloopError(
                    came=f"{names[number]} has {picture.dtype} levels, unlike earlier ones",
                    wanted="pictures of one depth",
                    do="move it away, or convert all alike",
                )
            time_s = number / float(footage.frame_rate)
            return time_s, (number, _to_uint8(picture, footage.colour, footage.levels))

        numbers = [k for k in range(len(names)) if is_in_range(footage, k / footage.frame_rate)]
        threads = THREADS if footage.path.is_dir() else 1  # of a stack pages follow one another
        yield from ordered_map(load_frame, numbers, Threads(threads))
