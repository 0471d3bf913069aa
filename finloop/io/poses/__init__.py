"""Tracks of another program as poses: which program made them, and where animals are in each frame.

A file may come from a stranger: it runs nothing, and takes memory as its size justifies
(`finloop.io.limits`). Text is read by pandas, HDF5 by h5py in a process of its own, a pickle as
data (`pickled`).
"""

import csv
import io
import sys
from collections.abc import Callable
from contextlib import redirect_stderr
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np
import pyarrow as pa

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, Software
from finloop.io.limits import call_aside, limit_memory
from finloop.io.poses.extra import import_extra, unreadable_error
from finloop.io.poses.hdf5 import (
    open_hdf5,
    read_movement,
    read_nwb,
    read_sleap_analysis,
    read_sleap_project,
)
from finloop.io.poses.idtracker import read_idtracker
from finloop.io.poses.keypoints import (
    FASTTRACK_NAME,
    read_deeplabcut,
    read_fasttrack,
    read_sleap_csv,
    read_via,
)
from finloop.io.poses.text import TEXTS, first_lines, read_plain_csv
from finloop.io.poses.trex import read_trex

A = TypeVar("A")
B = TypeVar("B")

_BY_SUFFIX: dict[str, Software] = {
    ".slp": "SLEAP", ".nwb": "NWB", ".nc": "movement", ".npz": "TRex", ".npy": "idtracker.ai",
    ".pickle": "idtracker.ai", ".parquet": "idtracker.ai",
}  # fmt: skip
_MOST_FRAMES = 10**9
_HDF5 = (".h5", ".hdf5", ".slp", ".nwb", ".nc")  # endings of files that h5py reads
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
    files = [file for file in path.rglob("*") if file.is_file()] if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files)
    is_aside = any(file.suffix.lower() in _HDF5 for file in files)
    if path.suffix.lower() in _HDF5:
        import_extra("h5py", path)
    program = software
    try:
        found: Software = (
            _call(_find_program, (path, size), size, is_aside) if software is None else software
        )
        program = found
        poses, remarks = _call(_read_source, (path, found, rate_hz, size), size, is_aside)
    except FinloopError:
        raise
    except Exception as error:  # damage can make any library raise anything
        name = program or "any program"
        why = error if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
        raise unreadable_error(path, name, why) from error
    print(remarks, end="", file=sys.stderr)
    _check_poses(path, found, poses)
    return poses


def _call(function: Callable[[A], B], argument: A, size: int, is_aside: bool) -> B:
    """Return function(argument), called in a process of its own if `is_aside`."""
    return call_aside(function, argument, size) if is_aside else function(argument)


def _find_program(source: tuple[Path, int]) -> Software:
    """Return the program that made tracks of so many bytes; any error if they are damaged."""
    path, size = source
    _reserve_arrow_memory()
    with limit_memory(size):
        return _detect_software(path)


def _reserve_arrow_memory() -> None:
    """Let Arrow, with which pandas stores text, reserve its GiB of addresses before the limit."""
    pa.allocate_buffer(1)


def _read_source(source: tuple[Path, Software, float, int]) -> tuple[Poses, str]:
    """Return the poses of a file or folder, and remarks for the user; any error if it is damaged.

    source: the path, its program, frames per second, and bytes of all files.
    """
    path, software, rate_hz, size = source
    _reserve_arrow_memory()
    with limit_memory(size), redirect_stderr(io.StringIO()) as remarks:
        poses = _read_poses(path, software, rate_hz)
    return poses, remarks.getvalue()


def _read_poses(path: Path, software: Software, rate_hz: float) -> Poses:
    """Return the poses in a file or folder of a tracking program; any error if it is damaged."""
    is_text = path.suffix.lower() in TEXTS
    match software:
        case "idtracker.ai":
            return read_idtracker(path)
        case "TRex":
            return read_trex(path)
        case "FastTrack":
            return read_fasttrack(path)
        case "DeepLabCut" | "LightningPose":
            return read_deeplabcut(path, software)
        case "SLEAP" if is_text:
            return read_sleap_csv(path)
        case "SLEAP" if path.suffix.lower() == ".slp":
            return read_sleap_project(path)
        case "SLEAP":
            return read_sleap_analysis(path)
        case "NWB":
            return read_nwb(path)
        case "movement":
            return read_movement(path, rate_hz)
        case "VIA-tracks":
            return read_via(path)
    raise _dimensions_error(path, 3)  # Anipose


def _check_poses(path: Path, software: Software, poses: Poses) -> None:
    """Raise FinloopError if poses are no tracks: without places, in space, or contradictory."""
    if not len(poses.frame):
        raise FinloopError(
            f"{path} does not say where any animal is",
            "tracks with at least one place",
            "export them again",
        )
    if (dimensions := poses.places.shape[-1]) != 2:
        raise _dimensions_error(path, dimensions)
    if poses.frame.min() < 0 or poses.frame.max() >= _MOST_FRAMES:
        numbers = f"{poses.frame.min()} to {poses.frame.max()}"
        raise unreadable_error(path, software, f"its frames have the numbers {numbers}")
    rows = poses.frame * len(poses.individuals) + poses.individual
    if len(twice := np.flatnonzero(np.diff(rows) == 0)):  # rows are sorted
        animal = poses.individuals[poses.individual[twice[0]]]
        raise FinloopError(
            f"{path} has several places of the animal {animal} in frame {poses.frame[twice[0]]}",
            f"one place for each animal in each frame, as {software} writes with tracks",
            f"track the animals in {software}, so that each has a name, and export again",
        )


def _dimensions_error(path: Path, dimensions: int) -> FinloopError:
    """Return the error for places that are not in a picture."""
    return FinloopError(
        f"{path} holds places in {dimensions} dimensions",
        "places in the picture of one camera, x and y in px",
        "give the tracks that were made in this film, before they were triangulated",
    )


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
    """Return the program that made a CSV of tracks, by its header; None if unknown."""
    header = [name.strip() for name in next(csv.reader(io.StringIO(read_plain_csv(path))), [])]
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
    """Return the names of an HDF5 file's groups and datasets."""
    with open_hdf5(path) as file:
        return list(file)
