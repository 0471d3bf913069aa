"""Folders of pictures, stacks of TIFF pages, arrays: their order, and their frames."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from fractions import Fraction
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from tifffile import TiffFile

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.base.parallel import Threads, ordered_map
from finloop.base.stretches import spread_rows
from finloop.base.thin import thin_frame
from finloop.io.footage.arrays import open_film_array
from finloop.io.footage.source import (
    CHROMA_FRACTION,
    SAMPLES,
    STRETCHES,
    Footage,
    LostFrames,
    NumberedFrames,
    choose_deep_levels,
    is_in_range,
    measure_chroma_fraction,
    no_rate_error,
    other_size_error,
    stretch_levels,
    too_few_frames_error,
)
from finloop.io.footage.stamps import count_times, times_in_files, times_in_names, times_in_stack
from finloop.io.footage.timing import estimate_frame_rate
from finloop.io.limits import limit_memory, refuse_bomb
from finloop.io.picture import decode_picture
from finloop.io.video import THREADS

TIFF, JPEG = {".tif", ".tiff"}, {".jpg", ".jpeg"}
SUFFIXES = TIFF | JPEG | {
    ".png", ".bmp", ".webp", ".jp2", ".pgm", ".ppm", ".pnm",
}  # fmt: skip
_PARTS = 8  # parts of a film, at its beginning, that are compared
_FEW = 0.05  # of a folder's pictures; so few with another name are left out


class Album(NamedTuple):
    """Pictures of a folder, or pages of a TIFF, in their order."""

    names: list[str]  # for messages
    load: Callable[[int], np.ndarray]  # a picture by its number, from 0: (h, w) or (h, w, 3) RGB
    frame_numbers: Ints  # (n,) of each picture, by its name; the first is 0, gaps are counted
    notes: tuple[str, ...] = ()  # sentences for the user
    times_s: Floats | None = None  # (n,) when each was shot; None: only `frame_numbers` are known


@contextmanager
def _open_album(path: Path, has_rate: bool) -> Iterator[Album]:
    """Open a folder of pictures, a TIFF or an array for a `with` block; yield its pictures.

    has_rate: whether the caller knows their frame rate; then no times are read, and `times_s` of
    the album is None. Else they are read from names, tags or the array's file.
    """
    if path.is_dir():
        yield _list_folder(path, has_rate)
    elif path.suffix.lower() in TIFF:
        with _open_stack(path, has_rate) as album:
            yield album
    else:
        with open_film_array(path) as film:
            numbers = np.arange(len(film))
            names = [f"{path}, frame {k + 1}," for k in numbers]
            times = numbers / film.rate_hz if film.rate_hz and not has_rate else None
            height, width = film.load_frame(0).shape[:2]
            shape = tuple(film.array.shape)
            note = f"the array {shape} is read as {len(film)} frames of {width}×{height} px"
            yield Album(names, film.load_frame, numbers, (note,), times)


def _list_folder(folder: Path, has_rate: bool) -> Album:
    """Return the pictures of a folder in the order of their times, else of their numbers.

    has_rate: whether their frame rate is known; else the times in names or tags are read.
    """
    files, frame_numbers, notes = find_series(folder)
    times = None if has_rate else times_in_names([file.stem for file in files])
    if times is None and not has_rate and files[0].suffix.lower() in TIFF | JPEG:
        times = times_in_files(files)
    if times is not None:
        order = np.argsort(times)
        # Known times are used in place of the frame numbers, so the notes on their gaps are void.
        files, times, notes = [files[k] for k in order], times[order], ()
    load = partial(_load_file, files)
    return Album([str(file) for file in files], load, frame_numbers, notes, times)


@contextmanager
def _open_stack(path: Path, has_rate: bool) -> Iterator[Album]:
    """Open a TIFF for a `with` block; yield its pages.

    has_rate: whether their frame rate is known; else their times are read. FinloopError if the file
    is damaged, or has several pages for each time.
    """
    with ExitStack() as closing:
        try:
            stack = closing.enter_context(TiffFile(path))
            names = [f"{path}, page {k + 1}," for k in range(len(stack.pages))]
            count = count_times(stack)
            times = None if has_rate else times_in_stack(stack, len(names))
        except Exception as error:  # damaged tags make tifffile raise anything
            raise FinloopError(
                came=f"{path} cannot be read as a TIFF: {type(error).__name__}: {error}",
                wanted="a TIFF with a page for each frame",
                do="save it as a folder of pictures",
            ) from error
        if 1 < count < len(names):
            raise FinloopError(
                f"{path} has {len(names)} pages for {count} times: channels or slices",
                "a page for each frame",
                "save one channel and one slice alone",
            )
        yield Album(names, partial(_load_page, stack), np.arange(len(names)), times_s=times)


def open_pictures(
    path: Path, rate: Fraction | None, colour: bool | None
) -> tuple[Footage, np.ndarray]:
    """Inspect a folder of pictures, a TIFF or an array; return facts, and frames' times [s] from 0.

    rate: frames per second; None = by the times in names or tags. colour: whether frames will be
    RGB; None = where they have colours. FinloopError without a rate and times, or for fewer than
    two pictures.
    """
    is_rate_given = rate is not None
    with _open_album(path, is_rate_given) as album:
        names, _, frame_numbers, notes, times = album
        if len(names) < 2:
            raise too_few_frames_error(path, len(names))
        if times is not None:  # only if no rate is given
            rate = estimate_frame_rate(times, [])
            note = f"names or tags say when the pictures were shot: {float(rate):.4g} frames/s"
            notes = (*notes, note)
        if rate is None:
            raise no_rate_error(path, f"{len(names)} pictures")
        if times is None:
            times = frame_numbers / float(rate)
        first = _load_picture(album, 0)
        sampled = spread_rows(np.arange(len(names)), SAMPLES)
        is_deep = first.dtype != np.uint8
        samples = [thin_frame(_load_picture(album, int(k), is_deep)) for k in sampled]
    levels = choose_deep_levels(samples) if is_deep else None
    if colour is None:
        rgb = (_to_uint8(sample, colour=True, levels=levels) for sample in samples)
        colour = measure_chroma_fraction(rgb) > CHROMA_FRACTION
    footage = Footage(
        path=path, width_px=first.shape[1], height_px=first.shape[0], frame_rate=rate,
        colour=colour, levels=levels, frames_expected=len(times), frames_in_source=len(times),
        last_s=float(times[-1]), reader=_read_picture_frames,
        sampler=_sample_pictures, notes=notes,
        renumbered=is_rate_given,  # then a frame's time is its number / rate
    )  # fmt: skip
    return footage, times


def find_series(folder: Path) -> tuple[list[Path], Ints, tuple[str, ...]]:
    """Find the pictures of one film in a folder, by the numbers in their names.

    Returns the pictures in their order; their frame numbers (n,), the first 0, gaps counted; and
    notes on gaps and on pictures left out: a few with other names. FinloopError if there are no
    pictures, or several series.
    """
    files = [
        file
        for file in folder.iterdir()
        if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
    ]
    if not files:
        raise FinloopError(
            came=f"the folder {folder} holds no pictures",
            wanted=f"the frames of one film, all of one kind: {' '.join(sorted(SUFFIXES))}",
            do="name that folder, or the film itself",
        )
    parts = 0
    if hexadecimal := _read_hexadecimal_names(files):
        pattern, pictures, frame_numbers = hexadecimal
    else:
        pattern, pictures = _choose_series(folder, files)
        frame_numbers, parts = _find_frame_numbers(folder, pictures)
    notes = []
    if parts:
        notes.append(f"the names count anew in each of {parts} parts: one follows the other")
    if others := sorted(file.name for file in set(files) - set(pictures)):
        listed = ", ".join(others[:5]) + (", …" if len(others) > 5 else "")
        notes.append(f"left out of {len(files)} pictures, as not named {pattern}: {listed}")
    if len({_name_pattern(file) for file in pictures}) > 1 and not hexadecimal:
        notes.append("the names do not number the pictures: they follow in alphabetical order")
    if gaps := int(frame_numbers[-1]) + 1 - len(frame_numbers):
        before_gap = pictures[int(np.diff(frame_numbers).argmax())].name
        notes.append(
            f"{gaps} pictures are missing by the numbers in the names, most after "
            f"{before_gap}; their time is kept"
        )
    return pictures, frame_numbers, tuple(notes)


def _read_hexadecimal_names(files: list[Path]) -> tuple[str, list[Path], Ints] | None:
    """Read names that end in hexadecimal numbers, such as frame_00ff.png; None for other names.

    Returns how they are named, the pictures in their order, and their frame numbers (n,), the first
    0, gaps counted. The numbers have equally many digits, of which some are letters, and at most
    half of them are missing.
    """
    letters_by_place = zip(*(file.stem for file in files), strict=False)
    start = next((k for k, letters in enumerate(letters_by_place) if len(set(letters)) > 1), 0)
    digits = [file.stem[start:] for file in files]
    if len(files) < 2 or len(set(map(len, digits))) > 1 or all(map(str.isdecimal, digits)):
        return None
    if not all(re.fullmatch("[0-9a-f]{1,15}", text, re.IGNORECASE) for text in digits):
        return None
    values = np.array([int(text, 16) for text in digits])
    order = np.argsort(values, kind="stable")
    steps = np.diff(values[order])
    step = np.median(steps)
    if (
        step == 0
        or (steps == 0).any()
        or (steps % step).any()
        or steps.sum() > 2 * step * len(steps)
    ):
        return None
    frame_numbers = np.cumsum([0, *steps // int(step)])
    return f"{files[0].stem[:start]}#", [files[k] for k in order], frame_numbers


def _choose_series(folder: Path, files: list[Path]) -> tuple[str, list[Path]]:
    """Return the name pattern and the sorted files of a film among a folder's pictures.

    The names in a series differ only in numbers. If no such series has more than two pictures and
    more than 5 % of all, the pictures with one ending are a series. FinloopError if there are
    several series, or if more than a few pictures belong to none.
    """
    few = max(2, _FEW * len(files))
    series = _group_files(files, _name_pattern)
    large = [name for name in series if len(series[name]) > few]
    if not large:
        series = _group_files(files, _ending_of)
        large = list(series)
    if len(large) > 1:
        raise _several_series_error(folder, {name: len(series[name]) for name in large})
    pattern, pictures = large[0], sorted(series[large[0]], key=natural_sort_key)
    if len(files) - len(pictures) > few:
        others = {"with other names": len(files) - len(pictures)}
        raise _several_series_error(folder, {pattern: len(pictures)} | others)
    return pattern, pictures


def _name_pattern(file: Path) -> str:
    """Return the name of a picture with # for each number."""
    return re.sub(r"\d+", "#", file.stem) + _ending_of(file)


def _ending_of(file: Path) -> str:
    """Return a picture's file ending in lower case, with .tif for .tiff and .jpg for .jpeg."""
    ending = file.suffix.lower()
    return ".tif" if ending in TIFF else ".jpg" if ending in JPEG else ending


def _group_files(files: list[Path], name_of: Callable[[Path], str]) -> dict[str, list[Path]]:
    """Return files grouped by the name that `name_of` gives each."""
    groups = defaultdict[str, list[Path]](list)
    for file in files:
        groups[name_of(file)].append(file)
    return groups


def _several_series_error(folder: Path, sizes: dict[str, int]) -> FinloopError:
    """Return the error for a folder of several series; sizes: name and number of pictures."""
    return FinloopError(
        came=f"{folder} holds pictures of several kinds: "
        + ", ".join(f"{count} {kind}" for kind, count in sorted(sizes.items())),
        wanted="the frames of one film and no other picture",
        do="move the others away (another camera, a mask, a background, a preview); if all are of "
        "one film, number them: 0001.png, 0002.png, …",
    )


def _find_frame_numbers(folder: Path, pictures: list[Path]) -> tuple[Ints, int]:
    """Return pictures' frame numbers (n,), the first 0, and the film's number of parts or 0.

    pictures: of one series, in order. The numbers are those in the files' names. They are
    consecutive unless the names differ in one number, whose steps are whole multiples of the usual
    one. 0 parts: the names do not tell, see `_count_parts`. FinloopError for the pictures of two
    cameras, and for two pictures of one number.
    """
    numbers_in_names = [[*map(int, re.findall(r"\d+", file.stem))] for file in pictures]
    consecutive = np.arange(len(pictures))
    if not numbers_in_names[0] or len({len(numbers) for numbers in numbers_in_names}) > 1:
        return consecutive, 0
    whole = np.array(numbers_in_names, object)  # times can have more digits than a float
    columns = (whole - whole.min(axis=0)).astype(np.float64)
    differ = np.flatnonzero(np.ptp(columns, axis=0))
    if len(differ) == 2:
        return consecutive, _count_parts(folder, pictures, *columns[:, differ].T)
    if len(differ) != 1:
        return consecutive, 0
    number = columns[:, differ[0]]
    steps = np.diff(number)
    if not steps.all():
        first, second = pictures[int(np.flatnonzero(steps == 0)[0]) :][:2]
        raise FinloopError(
            came=f"{first} and {second.name} have the same number",
            wanted="one picture for each frame",
            do="move one of them away",
        )
    step = np.median(steps)
    if (steps <= 0).any() or (steps % step).any():
        return consecutive, 0
    return np.rint((number - number[0]) / step).astype(np.int64), 0


def _count_parts(folder: Path, pictures: list[Path], camera: Floats, number: Floats) -> int:
    """Return how many parts a film has by its names s1_0, s1_1, …, s2_0, …; 0 if they do not tell.

    FinloopError if the pictures are of several cameras. camera, number (n,): two numbers in the
    name of each picture, in which the names differ; the one of fewer values is the camera's.
    Pictures are of several cameras if nearly all numbers occur with every camera, and count by
    ones, unless each camera goes on where the one before ends: then the first number is a second or
    a part of the film. Times of day, such as 59_960, 60_000, also have two numbers, but do not
    count so.
    """
    if len(np.unique(camera)) > len(np.unique(number)):
        camera, number = number, camera
    cameras = np.unique(camera)
    numbers_of = {value: set(number[camera == value]) for value in cameras}
    shared = sorted(set.intersection(*numbers_of.values()))
    most = max(map(len, numbers_of.values()))
    is_counted = len(shared) > max(1, (1 - _FEW) * most) and np.diff(shared).min() == 1
    if not is_counted:
        return 0
    if not _are_parts_consecutive(pictures, camera):
        examples = {value: pictures[int(np.argmax(camera == value))].name for value in cameras}
        sizes = {f"like {name}": len(numbers_of[value]) for value, name in examples.items()}
        raise _several_series_error(folder, sizes)
    return len(cameras)


def _are_parts_consecutive(pictures: list[Path], part: Floats) -> bool:
    """Return whether each part of a film begins where the part before it ends.

    It does if the pictures on both sides of the border differ about as little as neighbours within
    a part, not as much as a part's first and last one. pictures: in order; part (n,): the number of
    each one's part; False if these do not ascend.
    """
    starts = np.flatnonzero(np.diff(part, prepend=-1))  # the first picture of each part
    if (np.diff(part) < 0).any() or np.diff(starts).min() < 3:
        return False
    for before, start in list(pairwise(starts))[:_PARTS]:
        numbers = start - 1, start - 2, before, start
        last, *others = (
            _to_uint8(_load_file(pictures, int(k)), colour=False, levels=None) for k in numbers
        )
        if any(picture.shape != last.shape for picture in others):
            return False
        step, far, between = (float(cv2.absdiff(last, other).mean()) for other in others)
        if between > (step + far) / 2:
            return False
    return True


def natural_sort_key(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts paths by name, with frame2 before frame10."""
    parts = re.split(r"(\d+)", path.name)
    key = [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]
    return [*key, (0, path.name)]  # the whole name decides between frame2 and frame02


def _load_file(files: Sequence[Path], number: int) -> np.ndarray:
    """Load a picture file as stored: (h, w) grey or (h, w, 3) RGB, upright by its EXIF.

    number: its place in `files`, from 0.
    """
    path = files[number]
    picture = decode_picture(path, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if picture is None:
        raise FinloopError(
            came=f"{path} cannot be read as a picture",
            wanted="a folder whose files are all complete",
            do="copy it again, or move it away",
        )
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def _load_page(stack: TiffFile, number: int) -> np.ndarray:
    """Load one page of a TIFF, from 0, as stored: (h, w) grey or (h, w, 3) RGB."""
    path, size = stack.filehandle.path, stack.filehandle.size
    try:
        page = stack.pages[number]
        name = f"{path}, page {number + 1}, {' × '.join(map(str, page.shape))} values,"
        refuse_bomb(name, page.nbytes, size, "save it as a folder of pictures")
        with limit_memory(size):  # of a compressed page, only unpacking shows the size
            picture = page.asarray()
    except FinloopError:
        raise
    except Exception as error:  # a compression that is not supported, or damage
        raise FinloopError(
            came=f"{path}, page {number + 1}, cannot be read: {type(error).__name__}: {error}",
            wanted="a whole stack, not compressed or by deflate",
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


def _read_picture_frames(footage: Footage, loss: LostFrames) -> NumberedFrames:
    """Yield (time [s], (number, picture)) for each picture in the range of time.

    It is the `reader` of the `Footage` of a folder, TIFF or array; see `Footage.stream_numbered`.
    loss: the frames that the numbering leaves out are counted in `loss.gaps`.
    """
    # Renumbered: the user has given the rate, so no times are read.
    with _open_album(footage.path, footage.renumbered) as album:
        times_s, numbers = _choose_pictures(footage, album)
        if album.times_s is None:
            first, last = album.frame_numbers[numbers[0]], album.frame_numbers[numbers[-1]]
            loss.gaps = int(last - first) + 1 - len(numbers)
        threads = THREADS if footage.path.is_dir() else 1  # one open file is not safe for threads
        load = partial(_load_frame, footage, album)
        pictures = ordered_map(load, numbers, Threads(threads))
        for number, picture in zip(numbers, pictures, strict=True):
            yield float(times_s[number]), (number, picture)


def _sample_pictures(footage: Footage, length: int) -> Iterator[list[np.ndarray]]:
    """Yield runs of `length` consecutive pictures, spread over the range of time.

    It is the `sampler` of the `Footage` of a folder, TIFF or array.
    """
    with _open_album(footage.path, footage.renumbered) as album:
        _, numbers = _choose_pictures(footage, album)
        for start in np.linspace(0, len(numbers) - length, STRETCHES).astype(int):
            yield [_load_frame(footage, album, k) for k in numbers[start : start + length]]


def _choose_pictures(footage: Footage, album: Album) -> tuple[Floats, list[int]]:
    """Return the time [s] (n,) of every picture, and the numbers of those in the time range.

    Two at least: `restrict_time` refuses a range with fewer.
    """
    times_s = album.times_s
    if times_s is None:
        times_s = album.frame_numbers / float(footage.frame_rate)
    return times_s, [k for k in range(len(times_s)) if is_in_range(footage, times_s[k])]


def _load_picture(album: Album, number: int, is_deep: bool | None = None) -> np.ndarray:
    """Load a picture by its number, as stored; FinloopError if it holds NaN or infinity.

    is_deep: whether it shall have more than 8 bits, as earlier ones; FinloopError if it has not.
    """
    picture = album.load(number)
    if is_deep is not None and (picture.dtype != np.uint8) != is_deep:
        raise FinloopError(
            came=f"{album.names[number]} has {picture.dtype} levels, unlike earlier ones",
            wanted="pictures of one depth",
            do="move it away, or convert all alike",
        )
    if picture.dtype.kind == "f" and not np.isfinite(picture).all():
        raise FinloopError(
            came=f"{album.names[number]} holds NaN or infinity",
            wanted="a number for each pixel",
            do="give these pixels the level of the background: numpy.nan_to_num(frames, nan=LEVEL)",
        )
    return picture


def _load_frame(footage: Footage, album: Album, number: int) -> np.ndarray:
    """Load a picture by its number as uint8, after a check of its size and depth."""
    # The film's `levels` are None exactly if its first picture has 8 bits.
    picture = _load_picture(album, number, footage.levels is not None)
    size = footage.width_px, footage.height_px
    if picture.shape[1::-1] != size:
        raise other_size_error(album.names[number], picture.shape[1::-1], size)
    return _to_uint8(picture, footage.colour, footage.levels)
