"""Detect the program that made a file of tracks from the file's ending, header and keys."""

import csv
from pathlib import Path
from typing import get_args

from finloop.base.errors import FinloopError
from finloop.base.poses import Software
from finloop.io.poses.extra import import_extra, unreadable

_BY_SUFFIX: dict[str, Software] = {
    ".slp": "SLEAP", ".nwb": "NWB", ".nc": "movement", ".npz": "TRex", ".npy": "idtracker.ai",
    ".pickle": "idtracker.ai", ".parquet": "idtracker.ai",
}  # fmt: skip
_BY_KEY: dict[str, Software] = {  # by a group or dataset of a HDF5 file
    "df_with_missing": "DeepLabCut", "node_names": "SLEAP", "trajectories": "idtracker.ai",
    "specifications": "NWB", "position": "movement",
}  # fmt: skip


def software_of(path: Path) -> Software:
    """Return the name of the tracking program that made a file or folder of tracks.

    FinloopError if it is unknown.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        software = _folder_software(path)
    elif suffix == ".csv":
        software = _csv_software(path)
    elif suffix in (".h5", ".hdf5"):
        software = _hdf5_software(path)
    else:
        software = _BY_SUFFIX.get(suffix)
    if software is None:
        raise FinloopError(
            f"the program that made {path} is unknown",
            f"tracks of {', '.join(get_args(Software))}",
            "name it: extract.tracks_software; or export tracks in one of these formats",
        )
    return software


def _folder_software(path: Path) -> Software | None:
    names = {file.name for file in path.iterdir()}
    if any(name.startswith(("trajectories", "validated", "with")) for name in names):
        return "idtracker.ai"
    suffixes = {Path(name).suffix.lower() for name in names}
    if ".nwb" in suffixes:
        return "NWB"
    if "data" in names or suffixes & {".npz", ".csv"}:
        return "TRex"
    return None


def _csv_software(path: Path) -> Software | None:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header = [name.strip() for name in next(csv.reader(file), [])]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise unreadable(path, "any program", error) from error
    first, names = header[0] if header else "", set(header)
    if first == "scorer":
        return "DeepLabCut"  # LightningPose writes the same
    if {"time", "x1", "y1"} <= names or {"frame", "individual", "x", "y"} <= names:
        return "idtracker.ai"
    if first == "frame" and any(name.startswith("X") for name in names):
        return "TRex"
    if any(name.endswith("_ncams") for name in names):
        return "Anipose"
    return "VIA-tracks" if "region_shape_attributes" in names else None


def _hdf5_software(path: Path) -> Software | None:
    h5py = import_extra("h5py", path)
    try:
        with h5py.File(path) as file:
            keys = set(file)
    except OSError as error:
        raise unreadable(path, "any program", error) from error
    return next((software for key, software in _BY_KEY.items() if key in keys), None)
