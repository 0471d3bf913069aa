"""Pictures of faults of a film: the part of a frame in which a fault is seen."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Mask, Picture
from finloop.clip.check import BLACK, WHITE
from finloop.clip.light import smooth_light
from finloop.clip.shake import find_landmarks, to_grey
from finloop.extract.background import Scene
from finloop.extract.samples import TypicalFish
from finloop.extract.segment import Edge, Silhouette
from finloop.extract.settings import ExtractSettings
from finloop.plots.extract import judge_silhouettes, trace_outlines
from finloop.plots.parts import convert_to_colour

ReadFrames = Callable[[Sequence[int]], Iterable[Picture]]
Box = tuple[int, int, int, int]  # left, top, width, height, px

MARK = (230, 97, 1)  # RGB; orange is seen on light and on dark tanks
_WIDTH_PX, _HEIGHT_PX = 320, 240  # of a picture
_CLOSEST_PX = 64  # least width of the part of a frame that is shown
_AROUND = 2.0  # how much of the frame is shown, in sizes of the animal
_PLACE_PX = 32  # side of the place in which two frames differ most
_CAPTIONS = {  # of pictures of an animal
    "border": "What is cut off",
    "black": "What is plain black",
    "white": "What is plain white",
    **dict.fromkeys(
        ("size", "sharpness", "contrast", "coding", "parts"), "What counts as an animal"
    ),
}


class FaultPicture(NamedTuple):
    """A small picture (h, w, 3) in which a fault is seen, and a sentence on what it shows."""

    picture: Picture
    caption: str


def draw_film_fault(
    fault: str, table: pd.DataFrame, rate_hz: float, tank: Picture, read_frames: ReadFrames
) -> FaultPicture | None:
    """Return a picture of a fault of light, camera or frames; None if no frame shows it.

    fault: word of the finding; of a fault that is not of light, camera or frames there is no
    picture either. table: columns `check.CHECK`, of all frames. tank: the empty tank (h, w[, 3]).
    read_frames(numbers): yields the frames (h, w[, 3]) of these numbers, which ascend.
    """
    match fault:
        case "flicker":
            later = int(table["light"].diff().abs().idxmax())
            return _draw_light_change([later - 1, later], read_frames)
        case "drift":
            slow = smooth_light(table["light"].interpolate().to_numpy(np.float64), rate_hz)
            return _draw_light_change(sorted([int(slow.argmin()), int(slow.argmax())]), read_frames)
        case "shake":
            return _draw_shake(table[["shift_x", "shift_y"]], tank, read_frames)
        case "doubled":
            return _draw_repeated_frame(table["change"], read_frames)
        case "interlaced":
            number = int(table["field_order"].abs().idxmax())
            before, frame = map(np.copy, read_frames([number - 1, number]))
            picture = _crop_around(frame, _most_changed_place(before, frame))
            return FaultPicture(picture, f"Frame {number}: rows of two moments, enlarged.")
    return None


def draw_animal_fault(
    fault: str, frames: Iterable[tuple[str, Picture]], scene: Scene, typical: TypicalFish,
    arena: Picture, settings: ExtractSettings,
) -> FaultPicture | None:  # fmt: skip
    """Return a picture of the animal that shows a fault best; None if no frame shows it.

    fault: word of the finding; there is no picture either if `_CAPTIONS` lacks it. frames: pairs
    (label, picture) that are searched. scene, typical, arena: as in `judge_silhouettes`. Of animals
    that are cut off, the largest is shown; of those with black or white pixels, the one with the
    most; for other faults, the one whose area is most like that of a typical fish.
    """
    if fault not in _CAPTIONS:
        return None
    best_worth, shown = 0.0, None
    for label, frame in frames:
        for silhouette, verdict in judge_silhouettes(frame, scene, typical, arena, settings):
            worth, marked = _rate_example(fault, silhouette, verdict, frame, typical)
            if worth > best_worth:
                (height, width), corner = marked.shape, (silhouette.x0, silhouette.y0)
                outlines = trace_outlines(marked, corner)
                best_worth, shown = worth, (label, frame.copy(), (*corner, width, height), outlines)
    if shown is None:
        return None
    label, frame, box, outlines = shown
    picture = _crop_around(frame, box, outlines)
    return FaultPicture(picture, f"{_CAPTIONS[fault]}, outlined: {label}.")


def _rate_example(
    fault: str, silhouette: Silhouette, verdict: str, frame: Picture, typical: TypicalFish
) -> tuple[float, Mask]:
    """Return how well a silhouette shows a fault, 0 if not at all, and a mask of what to outline.

    fault, typical: as in `draw_animal_fault`. verdict: of `judge_silhouettes`.
    """
    if fault in ("black", "white"):
        height, width = silhouette.mask.shape
        rows = slice(silhouette.y0, silhouette.y0 + height)
        level = to_grey(frame[rows, silhouette.x0 : silhouette.x0 + width])
        lost = silhouette.mask & (level <= BLACK if fault == "black" else level >= WHITE)
        return float(lost.sum()), lost
    if fault == "border":
        return silhouette.area_px * (verdict == "at border"), silhouette.mask
    ratio = silhouette.area_px / typical.area_px
    return min(ratio, 1 / ratio) * (verdict == "fish"), silhouette.mask


def _draw_light_change(numbers: list[int], read_frames: ReadFrames) -> FaultPicture:
    """Return the left half of one frame beside the right half of another, in other light."""
    left, right = map(np.copy, read_frames(numbers))
    height, width = left.shape[:2]
    halves = np.hstack([left[:, : width // 2], right[:, width // 2 :]])
    caption = f"Left half: frame {numbers[0]}; right half: frame {numbers[1]}."
    return FaultPicture(_crop_around(halves, (0, 0, width, height)), caption)


def _draw_shake(
    shifts: pd.DataFrame, tank: Picture, read_frames: ReadFrames
) -> FaultPicture | None:
    """Return the frame in which the camera has moved farthest, laid over the empty tank.

    None if it has moved by less than a pixel.
    """
    away = shifts - shifts.median()
    distance_px = np.hypot(away["shift_x"], away["shift_y"])
    number = int(distance_px.idxmax())
    if distance_px[number] < 1:  # less than a pixel is not seen
        return None
    (frame,) = read_frames([number])
    moved, marks = to_grey(frame), find_landmarks(tank)
    steepest = int(np.hypot(marks.slope_right, marks.slope_down).argmax())
    left, top = (int(places[steepest]) * marks.reduction for places in (marks.x, marks.y))
    place = left, top, marks.reduction, marks.reduction
    picture = _crop_around(np.dstack([to_grey(tank), moved, moved]), place)
    # Each colour from black to white: pale marks are seen, and other light does not tint them.
    low, high = picture.min(axis=(0, 1)), picture.max(axis=(0, 1))
    picture = (255.0 * (picture - low) / np.maximum(high - low, 1)).astype(np.uint8)
    apart = f"its edges, red and cyan, are {distance_px[number]:.2g} px apart"
    return FaultPicture(picture, f"Frame {number} over the still tank: {apart}.")


def _draw_repeated_frame(change: pd.Series, read_frames: ReadFrames) -> FaultPicture:
    """Return the same detail of three frames, of which the second repeats the first.

    change: by how much each frame differs from the one before; little at a repeat, and much before
    and after it.
    """
    beside = np.minimum(change.shift(), change.shift(-1))  # the lesser of the changes around it
    number = int(((beside + 0.1) / (change + 0.1)).idxmax())  # 0.1: where little moves, no ratio
    numbers = [number - 1, number, number + 1]
    frames = [frame.copy() for frame in read_frames(numbers)]
    place = _most_changed_place(*frames[1:])
    tiles = [_crop_around(frame, place) for frame in frames]
    caption = "Frames {}, {} and {}: the second repeats the first.".format(*numbers)
    return FaultPicture(np.hstack(tiles), caption)


def _most_changed_place(before: Picture, after: Picture) -> Box:
    """Return where two frames (h, w[, 3]) differ most, as a box of one pixel."""
    difference = cv2.absdiff(to_grey(before), to_grey(after)).astype(np.float32)
    *_, (x, y) = cv2.minMaxLoc(cv2.blur(difference, (_PLACE_PX, _PLACE_PX)))
    return x, y, 1, 1


def _crop_around(frame: Picture, box: Box, outlines: Sequence[Edge] = ()) -> Picture:
    """Return a small picture (h, w, 3) of the part of a frame (h, w[, 3]) around a box.

    The part has the shape 4:3, is _AROUND times as large as the box and at least _CLOSEST_PX wide.
    It is moved into the frame, and reduced where the frame is smaller. outlines: drawn into the
    picture, px of the frame.
    """
    left, top, width, height = box
    wanted = max(_CLOSEST_PX, _AROUND * max(width, height * _WIDTH_PX / _HEIGHT_PX))
    part_width = min(frame.shape[1], round(wanted))
    part_height = min(frame.shape[0], round(wanted * _HEIGHT_PX / _WIDTH_PX))
    x = min(max(left + (width - part_width) // 2, 0), frame.shape[1] - part_width)
    y = min(max(top + (height - part_height) // 2, 0), frame.shape[0] - part_height)
    scale = min(_WIDTH_PX / part_width, _HEIGHT_PX / part_height)
    # Enlarged pixels stay squares: what is seen is what was filmed.
    how = cv2.INTER_NEAREST if scale > 1 else cv2.INTER_AREA
    part = convert_to_colour(frame[y : y + part_height, x : x + part_width])
    picture = np.asarray(cv2.resize(part, None, fx=scale, fy=scale, interpolation=how))
    # The centres of pixels, at whole numbers in both pictures, move by half a pixel more.
    lines = [
        np.rint((outline + 0.5 - (x, y)) * scale - 0.5).astype(np.int32) for outline in outlines
    ]
    cv2.polylines(picture, lines, True, MARK, 2, cv2.LINE_AA)
    return picture
