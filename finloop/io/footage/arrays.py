"""Films as arrays: a NumPy file, or a dataset of an HDF5 file."""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.base.errors import FinloopError
from finloop.io.limits import DEFLATE_RATIO, call_aside, limit_memory, refuse_bomb
from finloop.io.poses.extra import import_extra

_HDF5, _NORPIX = b"\x89HDF\r\n\x1a\n", b"\xed\xfe\0\0"  # first bytes of files
_OLD_MATLAB = b"MATLAB 5.0 MAT-file"
_USER_BLOCK = 512  # bytes before the beginning of a file of MATLAB 7.3, which is HDF5
_LEAST_SIDE = 16  # px; smaller arrays are tables
_CHANNELS = (1, 3, 4)
_MOST_BYTES = 2**26  # of frames that are read at a time, if there is more than one
_GRID = 192  # most places along each axis at which levels are read
_SAMPLE = 64  # most slices of an axis, and most rows and columns of a slice
_TYPICAL = 0.9  # share of the slices; the others may be far too dark, or saturated
# Least ratio of the change along the first axis and along the one that is taken instead. Drawn
# films of plain tanks have 2.1 to 8 between the other axes and that of the frames, 1.2 and more
# where light flickers by 30 %; real films have far more.
_SURE = 2.0
_RATES = ("fps", "framerate", "rate", "frameratehz", "ratehz")
_WANTED = "one array of pictures: frames × height × width, or × 3 for RGB"


def is_array_file(path: Path) -> bool:
    """Return whether `open_film_array` can open a file: .npy, or HDF5, as MATLAB 7.3 writes it.

    HDF5 is known by its ending or its first bytes. FinloopError for what must be converted first:
    .npz of NumPy, older files of MATLAB, and recordings of Norpix.
    """
    if path.suffix.lower() in (".npy", ".h5", ".hdf5", ".hdf"):
        return True
    try:
        with path.open("rb") as file:
            first_bytes = file.read(_USER_BLOCK + len(_HDF5))
    except OSError:  # it may not be read: FFmpeg says so
        return False
    if first_bytes.startswith(_NORPIX):
        raise FinloopError(
            f"{path} is a recording of Norpix StreamPix (.seq), which FFmpeg does not read",
            "a film that FFmpeg can read",
            "export it as AVI in StreamPix; or pip install pims 'imageio[ffmpeg]', then "
            "python -c \"import imageio, pims; film = pims.NorpixSeq('film.seq'); "
            "imageio.mimwrite('film.mp4', film, fps=film.frame_rate, quality=10)\"",
        )
    wanted = f"{_WANTED}, in an .npy file, an HDF5 file or a .mat file of version 7.3"
    if path.suffix.lower() == ".npz":
        do = "save the film alone: numpy.save('film.npy', array)"
        raise FinloopError(f"{path} is an archive of NumPy arrays", wanted, do)
    if first_bytes.startswith(_OLD_MATLAB):
        do = "save it again in MATLAB: save('film.mat', 'film', '-v7.3')"
        raise FinloopError(f"{path} is a file of MATLAB older than 7.3", wanted, do)
    return _HDF5 in (first_bytes[: len(_HDF5)], first_bytes[_USER_BLOCK:])


@dataclass
class FilmArray:
    """An array of pictures that is not read yet.

    path: of its file. array: of NumPy or HDF5. frames_axis, channels_axis: its axes of frames and
    of channels; the others are rows and columns, in a file of MATLAB columns and rows. rate_hz:
    frames per second. Where a frame lies scattered in the file, blocks of frames are read and the
    last one is kept.
    """

    path: Path
    array: Any
    frames_axis: int = 0
    channels_axis: int | None = None
    rate_hz: float | None = None
    _kept: tuple[int, NDArray[Any]] | None = None  # a block's number and its frames

    def __len__(self) -> int:
        """Return the number of frames."""
        return int(self.array.shape[self.frames_axis])

    def load_frame(self, number: int) -> Picture:
        """Return a frame by its number, from 0, as a picture (h, w) grey or (h, w, 3) RGB."""
        frame, channels = self._read_frame(number), self.channels_axis
        if channels is not None:
            frame = np.moveaxis(frame, channels - (channels > self.frames_axis), -1)
            frame = frame[..., 0] if frame.shape[2] == 1 else frame[..., :3]
        if "MATLAB_class" in getattr(self.array, "attrs", ()):  # columns before rows
            frame = frame.swapaxes(0, 1)
        if frame.dtype == bool:  # a mask
            frame = frame * np.uint8(255)
        return np.ascontiguousarray(frame)

    def _read_frame(self, number: int) -> NDArray[Any]:
        """Return a frame with its axes as they are in the array."""
        axis, length = self.frames_axis, self._block_length()
        block, k = divmod(number, length)
        if self._kept is None or self._kept[0] != block:
            start = block * length
            self._kept = block, _read_frames(self.path, self.array, axis, start, length)
        return self._kept[1].take(k, axis)

    def _block_length(self) -> int:
        """Return how many frames are read at a time: those of a chunk, at most `_MOST_BYTES`.

        It is 1 where each frame lies in one piece.
        """
        array, axis = self.array, self.frames_axis
        most = max(1, _MOST_BYTES // (array.nbytes // len(self)))
        if getattr(array, "chunks", None):  # of HDF5
            return min(most, array.chunks[axis])
        outer = np.argmax(array.strides) if isinstance(array, np.ndarray) else 0
        return 1 if axis == outer else most


@contextmanager
def open_film_array(path: Path) -> Iterator[FilmArray]:
    """Open a NumPy or HDF5 file for a block; yield its film.

    Axes are frames, rows, columns, perhaps with channels after the frames or at the end; in a file
    of MATLAB columns come before rows. Frames may be another axis, if the levels show it
    (`_find_frames_axis`). The rate is that of an attribute, else None. FinloopError if the file is
    damaged, holds no such array or several, or its axis of frames is unsure.
    """
    with ExitStack() as stack:
        try:
            if path.suffix.lower() == ".npy":
                array, rate = np.load(path, mmap_mode="r", allow_pickle=False), None
            else:
                h5py = import_extra("h5py", path)
                call_aside(_walk_chunks, path, path.stat().st_size)
                file = stack.enter_context(h5py.File(path))
                array, rate = _find_dataset(path, file)
        except FinloopError:
            raise
        except Exception as error:  # damage makes h5py raise anything
            raise _unreadable_error(path, error) from error
        if not _can_be_film(array):
            raise _no_film_error(path, {"its array": array})
        axis = _find_frames_axis(path, array)
        yield FilmArray(path, array, axis, _channels_axis(array.shape), rate)


def _walk_chunks(path: Path) -> None:
    """Visit all that an HDF5 file holds, and where its pictures are, but not the pictures.

    A damaged file can send h5py into an endless loop here, or crash it: call it in another process.
    FinloopError if the file does not hold one film.
    """
    with import_extra("h5py", path).File(path) as file:
        array, _ = _find_dataset(path, file)
        if array.chunks:
            array.id.get_num_chunks()
        name = f"{path}, {' × '.join(map(str, array.shape))} values,"
        do = "save the frames that there are"  # HDF5 fills the others
        refuse_bomb(name, array.nbytes, path.stat().st_size, do, DEFLATE_RATIO)


def _unreadable_error(path: Path, error: Exception) -> FinloopError:
    """Return the error for a damaged file of an array."""
    why = (
        str(error)
        if isinstance(error, OSError | ValueError)
        else f"{type(error).__name__}: {error}"
    )
    return FinloopError(f"{path} cannot be read: {why}", _WANTED, "save or copy it again")


def _read_frames(path: Path, array: Any, axis: int, start: int, count: int) -> NDArray[Any]:
    """Return some frames of a film's array; FinloopError if they are damaged, or far too large.

    axis: of the frames. start: number of the first. Fewer than `count` are read at the end.
    """
    size = path.stat().st_size
    frame_bytes = math.prod(array.shape) * array.dtype.itemsize // array.shape[axis]
    name = f"{path}, {' × '.join(map(str, array.shape))} values,"
    refuse_bomb(name, frame_bytes * min(count, array.shape[axis]), size, "save it uncompressed")
    return _read_part(path, array, (slice(None),) * axis + (slice(start, start + count),))


def _read_part(path: Path, array: Any, index: tuple[Any, ...]) -> NDArray[Any]:
    """Return a part of a film's array; FinloopError if it is damaged or fills the memory."""
    try:
        with limit_memory(path.stat().st_size):
            return np.asarray(array[index])
    except Exception as error:  # damage makes h5py raise anything
        raise _unreadable_error(path, error) from error


def _channels_axis(shape: Sequence[int]) -> int | None:
    """Return the axis of channels of a film's array by its shape; None if it has three axes."""
    if len(shape) < 4:
        return None
    return next((axis for axis in (3, 1, 2) if shape[axis] in _CHANNELS), None)


def _find_frames_axis(path: Path, array: Any) -> int:
    """Return the axis along which a film's array has its frames, by a sample of its levels.

    The tank is still and keeps its histogram: along the right axis, slices differ least from their
    median, and so do their sorted levels. Before, the slices of every axis are made equally bright:
    that takes out flicker, and gradients of the tank. The first axis is taken unless another is far
    better, as nearly every program saves films so. FinloopError if both others are far better, and
    about as good.
    """
    channels = _channels_axis(array.shape)
    axes = [axis for axis in range(array.ndim) if axis != channels]
    # An axis shorter than a picture's side must be that of the frames.
    if array.shape[axes[0]] < _LEAST_SIDE:
        return axes[0]
    grid: list[Any] = [0] * array.ndim  # of the channels, the first
    for axis in axes:
        grid[axis] = slice(None, None, math.ceil(array.shape[axis] / _GRID))
    levels: NDArray[Any] = _read_part(path, array, tuple(grid))  # each chunk is read once
    levels = np.nan_to_num(levels.astype(np.float32), posinf=0.0, neginf=0.0)
    change = np.array([_measure_change(np.moveaxis(levels, axis, 0)) for axis in range(3)])
    best = int(change.argmin())
    if change[0] <= _SURE * change[best]:
        return axes[0]
    if np.sort(change)[1] < _SURE * change[best]:
        raise FinloopError(
            f"which axis of the array {tuple(array.shape)} in {path} are the frames is unsure: "
            "along two of them its slices are equally alike",
            "a film of a still tank: frames × height × width",
            "save its frames as a TIFF: tifffile.imwrite('film.tif', array)",
        )
    return axes[best]


def _measure_change(slices: Floats) -> float:
    """Return how much slices (n, h, w) change from one to the other, in levels squared.

    It is the mean difference from their median times that of their sorted levels. Neighbouring
    levels of a slice are averaged, which lowers noise; those of two slices are not.
    """
    steps = [math.ceil(length / _SAMPLE) for length in slices.shape]
    height, width = (math.ceil(slices.shape[k] / steps[k]) for k in (1, 2))
    sample = np.array(
        [cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
         for part in slices[:: steps[0]]]
    )  # fmt: skip
    for axis in (0, 1, 2, 0, 1, 2):  # the brightness along one axis depends on that along others
        sample = _even_light(sample, axis)
    flat = sample.reshape(len(sample), -1)
    return _mean_deviation(flat) * _mean_deviation(np.sort(flat, axis=1))


def _even_light(levels: Floats, axis: int) -> Floats:
    """Return levels whose slices along an axis have equal medians, but far darker slices."""
    others = tuple(other for other in range(levels.ndim) if other != axis)
    bright = np.abs(np.median(levels, axis=others, keepdims=True))
    typical = np.median(bright)
    gains = np.divide(typical, bright, out=np.ones_like(bright), where=bright > typical / 4)
    return np.asarray(levels * gains)


def _mean_deviation(rows: Floats) -> float:
    """Return the mean absolute difference of rows (n, m) from their median row.

    Only the `_TYPICAL` share of the rows that differ least counts.
    """
    differences = np.sort(np.abs(rows - np.median(rows, axis=0)).mean(axis=1))
    return float(differences[: math.ceil(_TYPICAL * len(rows))].mean())


def _find_dataset(path: Path, file: Any) -> tuple[Any, float | None]:
    """Return the dataset of pictures in an open HDF5 file, and its frames per second.

    The rate is that of an attribute of the dataset, its group or the file; None if none states it.
    FinloopError if there is no such dataset, or several.
    """
    items: dict[str, Any] = {}
    # A visit goes on as long as the function returns None, as `update` does.
    file.visititems(lambda name, item: items.update({name: item}))
    datasets = {name: item for name, item in items.items() if getattr(item, "shape", ())}
    films = {name: dataset for name, dataset in datasets.items() if _can_be_film(dataset)}
    if len(films) != 1:
        raise _no_film_error(path, films or datasets)
    film = next(iter(films.values()))
    for attributes in (film.attrs, film.parent.attrs, file.attrs):
        for name in attributes:
            if name.lower().replace("_", "").replace(" ", "") in _RATES:
                return film, float(np.ravel(attributes[name])[0])
    return film, None


def _can_be_film(array: Any) -> bool:
    """Return whether an array can be a film: two frames or more, of at least 16 px a side.

    Its axes are those of `open_film_array`.
    """
    shape = list(array.shape)
    if len(shape) == 4:
        channels = _channels_axis(shape)
        if channels is None:
            return False
        shape.pop(channels)
    is_number = array.dtype.kind in "buif" and array.dtype.itemsize <= 8
    return len(shape) == 3 and shape[0] > 1 and min(shape[1:]) >= _LEAST_SIDE and is_number


def _no_film_error(path: Path, arrays: dict[str, Any]) -> FinloopError:
    """Return the error for a file that does not hold one film; arrays: what it holds, by name."""
    listed = ", ".join(f"{name} {array.shape} {array.dtype}" for name, array in arrays.items())
    return FinloopError(
        f"{path} holds {len(arrays)} arrays: {listed}" if arrays else f"{path} holds no array",
        _WANTED,
        "save the film alone, as .npy or in an HDF5 file of its own",
    )
