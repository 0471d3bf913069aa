"""Tracks of another program as poses: which program made them, and where animals are in each frame.

`movement` reads SLEAP, Anipose, NWB, VIA and its own format; it is optional (the extra `tracks`).
This package itself reads DeepLabCut, LightningPose, the CSV of SLEAP, FastTrack, idtracker.ai and
TRex. No file runs anything: whatever is stored as a pickle may only hold words, numbers and arrays.
"""

import csv
import io
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import numpy as np

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, Software, poses_from_arrays
from finloop.io.poses.extra import import_extra, not_installed_error, unreadable_error
from finloop.io.poses.idtracker import read_idtracker
from finloop.io.poses.keypoints import (
    FASTTRACK_NAME,
    read_deeplabcut,
    read_fasttrack,
    read_sleap_csv,
)
from finloop.io.poses.text import TEXTS, first_lines, read_plain_csv
from finloop.io.poses.trex import read_trex

_BY_SUFFIX: dict[str, Software] = {
    ".slp": "SLEAP", ".nwb": "NWB", ".nc": "movement", ".npz": "TRex", ".npy": "idtracker.ai",
    ".pickle": "idtracker.ai", ".parquet": "idtracker.ai",
}  # fmt: skip
_SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods", ".numbers")
_BY_KEY: dict[str, Software] = {  # by a group or dataset of a HDF5 file
    "df_with_missing": "DeepLabCut", "node_names": "SLEAP", "trajectories": "idtracker.ai",
    "specifications": "NWB", "position": "movement",
}  # fmt: skip


def load_poses(
    path: Path, software: Software | None, rate_hz: float, parameter: str = "extract.tracks_path"
) -> Poses:
    """Load the keypoints of all animals from a file or folder of a tracking program.

    software: the program that made it; None = detect it. rate_hz: of the film, for a file that has
    times and no rate. parameter: the one that names the file, for messages. FinloopError if there
    is nothing, the format is unknown or not that of `software`, or the file is damaged, has places
    in three dimensions, or holds no animal.
    """
    if not path.exists():
        raise FinloopError(
            f"there is nothing at {path.absolute()}",
            f"tracks of {', '.join(get_args(Software))}",
            f"correct {parameter}, or make it absolute: an experiment may run in another folder",
        )
    software = _detect_software(path) if software is None else software
    if software == "idtracker.ai":
        poses = read_idtracker(path)
    elif software == "TRex":
        poses = read_trex(path)
    elif software == "FastTrack":
        poses = read_fasttrack(path)
    elif software in ("DeepLabCut", "LightningPose") and path.is_file():
        poses = read_deeplabcut(path, software)
    elif software == "SLEAP" and path.suffix.lower() in TEXTS:
        poses = read_sleap_csv(path)
    else:
        poses = _read_by_movement(path, software, rate_hz)
    if not len(poses.frame):
        raise FinloopError(
            f"{path} does not say where any animal is",
            "tracks with at least one place",
            "export them again",
        )
    return poses


def _detect_software(path: Path) -> Software:
    """Return the program that made a file or folder of tracks; FinloopError if it is unknown."""
    suffix, seen = path.suffix.lower(), ""  # seen: what the file shows, for the message
    if suffix in _SPREADSHEETS:
        raise FinloopError(f"{path} is a spreadsheet", "a CSV file", "save its sheet as CSV")
    if path.is_dir():
        software = _folder_software(path)
    elif suffix in TEXTS:
        software = _csv_software(path)
    elif suffix in (".h5", ".hdf5"):
        keys = _hdf5_keys(path)
        software = next((program for key, program in _BY_KEY.items() if key in keys), None)
        seen = f"; it holds {', '.join(keys) or 'nothing'}"
    else:
        software = _BY_SUFFIX.get(suffix)
    if software is None:
        if suffix in TEXTS:
            seen = f"; it begins with {first_lines(path)}"
        raise FinloopError(
            f"the program that made {path} is unknown{seen}",
            f"tracks of {', '.join(get_args(Software))}",
            "name it: extract.tracks_software; or export tracks in one of these formats",
        )
    return software


def _folder_software(path: Path) -> Software | None:
    """Return the program that made a folder of tracks, by its files' names; None if unknown."""
    names = {file.name for file in path.iterdir()}
    if any(name.startswith(("trajectories", "validated", "with")) for name in names):
        return "idtracker.ai"
    if FASTTRACK_NAME in names:
        return "FastTrack"
    suffixes = {Path(name).suffix.lower() for name in names}
    if ".nwb" in suffixes:
        return "NWB"
    if "data" in names or suffixes & {".npz", ".csv"}:
        return "TRex"
    return None


def _csv_software(path: Path) -> Software | None:
    """Return the program that made a CSV of tracks, by its header; None if unknown.

    FinloopError if the file cannot be read.
    """
    try:
        header = [name.strip() for name in next(csv.reader(io.StringIO(read_plain_csv(path))), [])]
    except (OSError, csv.Error) as error:
        raise unreadable_error(path, "any program", error) from error
    first, names = header[0] if header else "", set(header)
    if first == "scorer":
        return "DeepLabCut"  # LightningPose writes the same
    if {"track", "frame_idx"} <= names:
        return "SLEAP"
    if {"xHead", "yHead", "imageNumber"} <= names:
        return "FastTrack"
    has_places = {"x1", "y1"} <= names and names & {"time", "seconds"}
    if has_places or {"frame", "individual", "x", "y"} <= names:
        return "idtracker.ai"
    if first == "frame" and any(name.startswith("X") for name in names):
        return "TRex"
    if any(name.endswith("_ncams") for name in names):
        return "Anipose"
    return "VIA-tracks" if "region_shape_attributes" in names else None


def _hdf5_keys(path: Path) -> list[str]:
    """Return the names of an HDF5 file's groups and datasets; FinloopError if it is damaged."""
    h5py = import_extra("h5py", path)
    try:
        with h5py.File(path) as file:
            return list(file)
    except OSError as error:
        raise unreadable_error(path, "any program", error) from error


def _read_by_movement(path: Path, software: Software, rate_hz: float) -> Poses:
    """Load poses with the package `movement`, from a file or a folder of NWB files, one per animal.

    rate_hz: frames per second, for a file that has times and no rate. FinloopError if a file cannot
    be read, or animals have different keypoints or one name.
    """
    files = sorted(path.glob("*.nwb")) if path.is_dir() else [path]
    datasets = [_load_dataset(file, software) for file in files]
    if len({tuple(dataset.keypoints.values) for dataset in datasets}) > 1:
        raise unreadable_error(path, software, "its animals have different keypoints")
    names = [str(name) for dataset in datasets for name in dataset.individuals.values]
    if len(set(names)) < len(names):
        raise unreadable_error(path, software, f"animals of one name: {', '.join(names)}")
    frames_of_datasets = [_frame_numbers(dataset, rate_hz) for dataset in datasets]
    frames = np.unique(np.concatenate(frames_of_datasets))
    keypoints = tuple(str(name) for name in datasets[0].keypoints.values)
    places = np.full((len(frames), len(names), len(keypoints), 2), np.nan)
    confidence = np.full(places.shape[:-1], np.nan)
    axes = ("time", "individuals", "keypoints")
    first_animal = 0  # number of the dataset's first animal among all
    for dataset, frame in zip(datasets, frames_of_datasets, strict=True):
        rows = np.searchsorted(frames, frame)
        animals = slice(first_animal, first_animal + dataset.sizes["individuals"])
        places[rows, animals] = dataset.position.transpose(*axes, "space").values
        if "confidence" in dataset:
            confidence[rows, animals] = dataset.confidence.transpose(*axes).values
        first_animal = animals.stop
    return poses_from_arrays(tuple(names), keypoints, frames, places, confidence)


def _load_dataset(path: Path, software: Software) -> Any:
    """Load a file with `movement` as an xarray dataset with `position` and perhaps `confidence`.

    `position` has the dimensions time, space (x, y), keypoints and individuals. FinloopError if the
    file cannot be read, or holds places in three dimensions.
    """
    xarray = import_extra("xarray", path)
    load = import_extra("movement.io", path).load_dataset
    import_extra("loguru", path).logger.disable("movement")
    try:
        with warnings.catch_warnings(), TemporaryDirectory() as folder:
            warnings.simplefilter("ignore")
            if software == "movement":
                dataset = xarray.load_dataset(path)
            elif path.suffix.lower() in TEXTS:
                plain = Path(folder) / f"{path.stem}.csv"
                plain.write_text(read_plain_csv(path), encoding="utf-8")
                dataset = load(plain, source_software=software).load()
            else:
                dataset = load(path, source_software=software)
    except ImportError as error:
        raise not_installed_error(path, error) from error
    except Exception as error:  # a library of many formats may raise anything for a damaged file
        raise unreadable_error(path, software, f"{type(error).__name__}: {error}") from error
    if "position" not in dataset or not {"time", "space", "individuals"} <= set(dataset.dims):
        raise unreadable_error(
            path, software, "it holds no positions by time, space and individual"
        )
    if dataset.sizes["space"] != 2:
        raise FinloopError(
            f"{path} holds places in {dataset.sizes['space']} dimensions",
            "places in the picture of one camera, x and y in px",
            "give the tracks that were made in this film, before they were triangulated",
        )
    if "keypoints" not in dataset.dims:  # boxes around animals
        dataset = dataset.expand_dims(keypoints=["centre"])
    return dataset.sel(space=["x", "y"])


def _frame_numbers(dataset: Any, rate_hz: float) -> np.ndarray:
    """Return the frame number (n,) of each time of a dataset, whose times are s or frame numbers.

    rate_hz: frames per second, if the dataset does not state them.
    """
    time = dataset.time.values.astype(float)
    if dataset.attrs.get("time_unit") == "seconds":
        time = time * float(dataset.attrs.get("fps") or rate_hz)
    return np.rint(time).astype(np.int64)
