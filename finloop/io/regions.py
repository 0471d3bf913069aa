"""Regions of limbs in the frames of a film: folders of masks, or traced SVG drawings.

Masks: a folder for each id with a black and white PNG for each frame, `fore_left/0007.png`; regions
may overlap. Traces: an SVG for each frame, `0007.svg`, with a closed path for each id. The number
in the name is the frame's; the lowest number is frame 0. A hidden limb has a black mask or none, or
no path.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import cv2
import numpy as np

from finloop.base.arrays import Mask
from finloop.base.drawing import Curve
from finloop.base.errors import FinloopError
from finloop.io.atomic import whole_folder
from finloop.io.picture import load_picture
from finloop.io.svg import load_svg

T = TypeVar("T")
DIGITS = 4
MOST_FRAMES = 100_000
"""Frames from the first number to the last: an hour of film. A wrong number reaches further."""
BRIGHT = 128  # of 255: least level of a pixel of the mask
_WANTED = "a folder for each limb with a PNG for each frame, or an SVG for each frame"


class Regions(NamedTuple, Generic[T]):
    """Where limbs are in consecutive frames: a mask or an outline for each limb and frame."""

    frames: list[dict[str, T | None]]  # a value by limb, such as its contour; None where hidden
    first: int  # the number in the first frame's file name


def save_masks(folder: Path, frames: Iterable[Mapping[str, Mask]]) -> None:
    """Write the masks of limbs as pictures `folder`/<limb>/<frame>.png; the folder is replaced.

    frames: for each frame, from 0, the boolean mask (h, w) of each limb by name.
    """
    with whole_folder(folder) as part:
        for number, frame in enumerate(frames):
            for limb, mask in frame.items():
                path = part / limb / f"{number:0{DIGITS}}.png"
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(cv2.imencode(".png", mask * np.uint8(255))[1].tobytes())


def load_regions(
    folder: Path,
    convert_mask: Callable[[Mask], T],
    convert_trace: Callable[[Curve, float, float], T],
) -> Regions[T]:
    """Load the region of each limb in each frame from a folder of masks or of SVG traces.

    folder: holds a folder of numbered PNG masks for each limb, or a numbered SVG for each frame, in
    which each limb is a closed path with its id. convert_mask: turns a boolean mask (h, w) into
    what the caller wants of a region, such as its contour. convert_trace: does so with a closed
    path and the width and height of its picture [px]. FinloopError if there is no folder or nothing
    in it, masks and traces are mixed, a file's name has no number, two have the same, they are too
    far apart, a file cannot be read, a path is open, sizes differ, or all masks of a limb are too
    dark but not all black.
    """
    if not folder.is_dir():
        raise FinloopError(f"{folder} is no folder", _WANTED, "give the folder of the regions")
    inside = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    traces = [path for path in inside if path.suffix.lower() == ".svg"]
    masks = {
        path.name: [file for file in sorted(path.iterdir()) if file.suffix.lower() == ".png"]
        for path in inside
        if path.is_dir()
    }
    masks = {name: paths for name, paths in masks.items() if paths}
    if bool(traces) == bool(masks):
        raise FinloopError(
            f"{folder} holds {len(traces)} SVG files and {len(masks)} folders with PNG files",
            _WANTED,
            "keep one kind" if traces else "put the masks or the traces there",
        )
    return _load_traces(traces, convert_trace) if traces else _load_masks(masks, convert_mask)


def _load_masks(paths: Mapping[str, list[Path]], convert_mask: Callable[[Mask], T]) -> Regions[T]:
    """Load the regions of limbs from mask pictures, see `load_regions`.

    paths: of each limb's pictures, by limb; convert_mask: turns a mask (h, w) into a region. A
    frame without a picture of a limb has None for it.
    """
    numbered = {name: _paths_by_number(files) for name, files in paths.items()}
    first, last = _frame_span(
        {number: path for files in numbered.values() for number, path in files.items()}
    )
    frames: list[dict[str, T | None]] = [dict.fromkeys(paths) for _ in range(first, last + 1)]
    sizes = dict[tuple[int, ...], Path]()
    for name, files in numbered.items():
        brightest = 0
        for number, path in files.items():
            mask = load_picture(path)
            mask = mask if mask.ndim == 2 else mask[..., :3].max(axis=2)  # of red, green, blue
            _require_one_size(sizes, mask.shape, path)
            brightest = max(brightest, int(mask.max()))
            frames[number - first][name] = convert_mask(mask >= BRIGHT)
        if 0 < brightest < BRIGHT:
            raise FinloopError(
                f"no mask of {name} has a pixel brighter than {brightest} of 255",
                "the limb white, 255, and all else black, 0",
                f"multiply the masks by {255 // brightest}",
            )
    return Regions(frames, first)


def _load_traces(
    paths: list[Path], convert_trace: Callable[[Curve, float, float], T]
) -> Regions[T]:
    """Load the regions of limbs from SVG files, one per frame, see `load_regions`.

    A frame without a path of a limb has None for it.
    """
    numbered = _paths_by_number(paths)
    first, last = _frame_span(numbered)
    frames: list[dict[str, T]] = [{} for _ in range(first, last + 1)]
    sizes = dict[tuple[int, ...], Path]()
    for number, path in numbered.items():
        drawing = load_svg(path)
        _require_one_size(sizes, (round(drawing.height), round(drawing.width)), path)
        for name, curve in drawing.curves.items():
            if not curve.closed:
                raise FinloopError(
                    f"the path {name} of {path} is open",
                    "closed paths: a limb is a region",
                    "close it in a drawing program",
                )
            frames[number - first][name] = convert_trace(curve, drawing.width, drawing.height)
    names = dict.fromkeys(name for frame in frames for name in frame)
    return Regions([{name: frame.get(name) for name in names} for frame in frames], first)


def _paths_by_number(paths: list[Path]) -> dict[int, Path]:
    """Return files by the last number in their names; FinloopError for none or a repeated one."""
    by_number = dict[int, Path]()
    for path in paths:
        numbers = re.findall(r"\d+", path.stem)
        if not numbers or int(numbers[-1]) in by_number:
            raise FinloopError(
                f"{path} has {'a number that another has' if numbers else 'no number in its name'}",
                "the number of its frame, such as 0007",
                "number the files as the frames",
            )
        by_number[int(numbers[-1])] = path
    return by_number


def _frame_span(paths: Mapping[int, Path]) -> tuple[int, int]:
    """Return the first and the last number of files; FinloopError if they are too far apart.

    paths: files by their numbers.
    """
    numbers = sorted(paths)
    if numbers[-1] - numbers[0] >= MOST_FRAMES:
        before, after = max(pairwise(numbers), key=lambda pair: pair[1] - pair[0])
        raise FinloopError(
            f"between {paths[before]} and {paths[after]}, {after - before - 1} frames have no file",
            f"numbers of at most {MOST_FRAMES} frames, from the first to the last",
            "number the files as the frames, such as 0007",
        )
    return numbers[0], numbers[-1]


def _require_one_size(
    sizes: dict[tuple[int, ...], Path], size: tuple[int, ...], path: Path
) -> None:
    """Raise FinloopError if a picture has another (height, width) than those before it.

    sizes: size → the first file of that size; this picture is added. path: of the picture.
    """
    sizes.setdefault(size, path)
    if len(sizes) > 1:
        came = ", ".join(f"{path} {shape[1]}×{shape[0]}" for shape, path in sizes.items())
        raise FinloopError(
            f"regions of different sizes: {came}",
            "the size of the film's picture in all of them",
            "save them all at that size",
        )
