"""Films as arrays: a NumPy file, or a dataset of an HDF5 file; frames first, then rows, columns."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.io.poses.extra import import_extra

_HDF5, _NORPIX = b"\x89HDF\r\n\x1a\n", b"\xed\xfe\0\0"  # first bytes of files
_OLD_MATLAB = b"MATLAB 5.0 MAT-file"
_USER_BLOCK = 512  # bytes before the beginning of a file of MATLAB 7.3, which is HDF5
_LEAST_SIDE = 16  # px; smaller arrays are tables
_CHANNELS = (1, 3, 4)
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


@contextmanager
def open_film_array(path: Path) -> Iterator[tuple[Any, float | None]]:
    """Open a NumPy or HDF5 file for a block; yield its array of pictures and its frames per second.

    Nothing is read yet. The array is (frames, h, w), (frames, h, w, c) or (frames, c, h, w); in a
    file of MATLAB w comes before h. The rate is that of an attribute, else None. FinloopError if
    the file is damaged, or holds no such array or several.
    """
    with ExitStack() as stack:
        try:
            if path.suffix.lower() == ".npy":
                array, rate = np.load(path, mmap_mode="r", allow_pickle=False), None
            else:
                file = stack.enter_context(import_extra("h5py", path).File(path))
                array, rate = _find_dataset(path, file)
        except (EOFError, OSError, ValueError) as error:
            raise FinloopError(
                f"{path} cannot be read: {error}", _WANTED, "save or copy it again"
            ) from error
        if not _can_be_film(array):
            raise _no_film_error(path, {"its array": array})
        yield array, rate


def frame_of_array(array: Any, number: int) -> Picture:
    """Return one frame of a film array as a picture, (h, w) grey or (h, w, 3) RGB.

    array: from `open_film_array`. number: of the frame, from 0.
    """
    frame = np.asarray(array[number])
    if frame.ndim == 3 and frame.shape[2] not in _CHANNELS:  # channels first
        frame = np.moveaxis(frame, 0, -1)
    if frame.ndim == 3:
        frame = frame[..., 0] if frame.shape[2] == 1 else frame[..., :3]
    if "MATLAB_class" in getattr(array, "attrs", ()):  # MATLAB stores columns before rows
        frame = frame.swapaxes(0, 1)
    if frame.dtype == bool:  # a mask
        frame = frame * np.uint8(255)
    return np.ascontiguousarray(frame)


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
        channels = shape.pop(3 if shape[3] in _CHANNELS else 1)
        if channels not in _CHANNELS:
            return False
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
