"""Trajectories of idtracker.ai, of a session, a folder or a file: .npy, .h5, .csv, .parquet.

They hold the centre of every animal in every frame of the film, x and y in px, and its name.
"""

import io
import json
import re
from pathlib import Path
from typing import IO, Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from finloop.base.poses import Poses, poses_from_arrays, poses_from_rows
from finloop.io.limits import refuse_bomb
from finloop.io.poses.extra import unreadable_error
from finloop.io.poses.hdf5 import open_hdf5, read_values
from finloop.io.poses.pickled import load_plain_pickle, unwrap_array
from finloop.io.poses.text import read_plain_csv

SOFTWARE, CENTRE = "idtracker.ai", "centre"
# In the order that the program itself prefers: corrected by hand, then with gaps closed.
_NAMES = (
    "trajectories", "validated", "without_gaps", "with_gaps", "trajectories_validated",
    "trajectories_wo_gaps", "trajectories_wo_identification",
)  # fmt: skip
# HDF5 needs an optional package: it is read only where there is nothing else.
_ENDINGS = (".npy", ".pickle", "_csv", "_tidy.csv", ".parquet", ".h5", ".hdf5")


def read_idtracker(path: Path) -> Poses:
    """Load poses of idtracker.ai from a session's folder, its folder `trajectories`, or a file.

    The only keypoint is each animal's centre. FinloopError if nothing there can be read.
    """
    path = _find_trajectories(path)
    loaded, facts = _load_places(path)
    labels = facts.get("identities_labels")
    names = [] if labels is None else [_read_label(label) for label in labels]
    if isinstance(loaded, pd.DataFrame):  # a row for each animal in each frame
        frame, animal = (loaded[name].to_numpy(int) for name in ("frame", "individual"))
        places = loaded[["x", "y"]].to_numpy(float)[:, None]
        count = max(animal.max() + 1, len(names))
        if animal.min() < 0 or count > max(len(names), len(animal)):
            raise ValueError(f"its animals have the numbers {animal.min()} to {animal.max()}")
        return poses_from_rows(_name_animals(names, count), (CENTRE,), frame, animal, places)
    if not isinstance(loaded, np.ndarray) or loaded.dtype.kind not in "iuf":
        raise ValueError("its trajectories are no array of numbers")
    if loaded.ndim != 3 or loaded.shape[2] != 2:
        raise ValueError(f"its trajectories have the shape {loaded.shape}")
    animals = _name_animals(names, loaded.shape[1])
    return poses_from_arrays(
        animals, (CENTRE,), np.arange(len(loaded)), loaded[:, :, None].astype(float)
    )


def _read_label(label: object) -> str:
    """Return an animal's name; ValueError if it is neither word nor number."""
    if not isinstance(label, str | int | float | np.generic):
        raise ValueError("its identities_labels are no names")
    return str(label)


def _name_animals(names: list[str], count: int) -> tuple[str, ...]:
    """Return the names of so many animals; their numbers, from 1, if the names are not so many."""
    return tuple(names if len(names) == count else map(str, range(1, count + 1)))


def _find_trajectories(path: Path) -> Path:
    """Return the path of idtracker.ai's trajectories: `path` itself, or the best one of a session.

    The best is the first in the order of `_NAMES`, then of `_ENDINGS`. A folder <name>_csv holds
    the trajectories as several CSV files. FinloopError if there is none.
    """
    if path.is_file() and path.parent.name.endswith("_csv"):
        return path.parent
    if path.is_file() or path.name.endswith("_csv"):
        return path
    home = path / "trajectories" if (path / "trajectories").is_dir() else path
    for name in _NAMES:
        for ending in _ENDINGS:
            if (home / f"{name}{ending}").exists():
                return home / f"{name}{ending}"
    raise unreadable_error(path, SOFTWARE, "the folder holds no trajectories")


def _load_places(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return places in px, and the facts stored beside them, by name.

    The places are an array (frames, animals, 2), or a table with the columns frame, individual, x
    and y. path: a file, or a folder of CSV files. FinloopError for a file with another ending.
    """
    if path.is_dir():
        return _load_places(path / "trajectories.csv")[0], _load_facts(path / "attributes.json")
    match path.suffix.lower():
        case ".npy":
            return _load_npy(path)
        case ".pickle":
            with path.open("rb") as file:
                return _unpickle(file)
        case ".h5" | ".hdf5":
            with open_hdf5(path) as file:
                labels = file.attrs.get("identities_labels")
                return read_values(file["trajectories"]), {"identities_labels": labels}
        case ".parquet":
            return _load_parquet(path)
        case ".csv" | ".tsv" | ".txt":
            wide = pd.read_csv(io.StringIO(read_plain_csv(path)))
            if "individual" in wide:
                return wide, _load_facts(path.with_name("attributes_tidy.json"))
            # The columns are time or seconds, x1, y1, x2, y2, …, and perhaps probabilities.
            places = [name for name in wide if re.fullmatch(r"[xy]\d+", name)]
            if not places:
                raise ValueError("it has no columns x1, y1, …")
            return wide[places].to_numpy(float).reshape(len(wide), -1, 2), {}
    raise unreadable_error(path, SOFTWARE, "its ending is another")


def _load_npy(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return the places (frames, animals, 2) in a .npy file, and facts by name.

    The file holds an array, and so no facts, or a pickled dictionary: ValueError if that has more
    than plain values and arrays.
    """
    with path.open("rb") as file:
        npy = np.lib.format
        is_first_version = npy.read_magic(file) == (1, 0)
        read_header = npy.read_array_header_1_0 if is_first_version else npy.read_array_header_2_0
        shape, _, dtype = read_header(file)
        if dtype.hasobject and shape == ():  # a pickled dictionary follows
            return _unpickle(file)
    return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)), {}


def _load_parquet(path: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return the table of places in a Parquet file, and facts by name.

    FinloopError if the file declares far more rows than it can hold.
    """
    with pq.ParquetFile(path) as file:
        rows, columns = file.metadata.num_rows, ["frame", "individual", "x", "y"]
        name = f"{path}, {rows} rows,"
        refuse_bomb(name, rows * len(columns) * 8, path.stat().st_size, "export the tracks again")
        facts = (file.schema_arrow.metadata or {}).get(b"idtrackerai_attributes", b"{}")
        table = file.read(columns, use_pandas_metadata=False)
        return table.to_pandas(ignore_metadata=True), json.loads(facts)


def _load_facts(path: Path) -> dict[str, Any]:
    """Load the facts in a JSON file, by name; {} if there is no such file."""
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def _unpickle(file: IO[bytes]) -> tuple[Any, dict[str, Any]]:
    """Return the places in an open pickle file, and all facts stored with them by name."""
    record = load_plain_pickle(file)
    record = record[0] if isinstance(record, list) else record
    if not isinstance(record, dict):
        raise ValueError("it holds no dictionary of trajectories")
    facts = {name: unwrap_array(value) for name, value in record.items()}
    return facts["trajectories"], facts
