"""Trajectories of idtracker.ai, of a session, a folder or a file: .npy, .h5, .csv, .parquet.

They hold the centre of every animal in every frame of the film, x and y in px, and its name.
"""

import io
import json
import pickle
import re
from pathlib import Path
from typing import IO, Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from finloop.base.poses import Poses, poses_from_arrays
from finloop.io.poses.extra import import_extra, unreadable_error
from finloop.io.poses.pickled import load_harmless_pickle, unwrap_array
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
    try:
        loaded, facts = _load_places(path)
        places, labels = np.asarray(loaded), facts.get("identities_labels")
        names = [] if labels is None else [str(label) for label in labels]
    except (
        ArithmeticError, AttributeError, EOFError, LookupError, OSError, TypeError, ValueError,
        pickle.UnpicklingError,
    ) as error:  # fmt: skip
        raise unreadable_error(path, SOFTWARE, error) from error
    if places.ndim != 3 or places.shape[2] != 2:
        raise unreadable_error(path, SOFTWARE, f"its trajectories have the shape {places.shape}")
    count = places.shape[1]
    names = names if len(names) == count else [str(number) for number in range(1, count + 1)]
    return poses_from_arrays(
        tuple(names), (CENTRE,), np.arange(len(places)), places[:, :, None].astype(float)
    )


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
    """Return places (frames, animals, 2) in px, and the facts stored beside them, by name.

    path: a file, or a folder of CSV files. FinloopError for a file with another ending.
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
            with import_extra("h5py", path).File(path) as file:
                return file["trajectories"][()], dict(file.attrs)
        case ".parquet":
            table = pq.read_table(path)
            facts = (table.schema.metadata or {}).get(b"idtrackerai_attributes", b"{}")
            return _to_places(table.to_pandas()), json.loads(facts)
        case ".csv" | ".tsv" | ".txt":
            wide = pd.read_csv(io.StringIO(read_plain_csv(path)))
            if "individual" in wide:
                return _to_places(wide), _load_facts(path.with_name("attributes_tidy.json"))
            # The columns are time or seconds, x1, y1, x2, y2, …, and perhaps probabilities.
            places = [name for name in wide if re.fullmatch(r"[xy]\d+", name)]
            if not places:
                raise ValueError("it has no columns x1, y1, …")
            return wide[places].to_numpy(float).reshape(len(wide), -1, 2), {}
    raise unreadable_error(path, SOFTWARE, "its ending is another")


def _load_npy(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return the places (frames, animals, 2) in a .npy file, and facts by name.

    The file holds an array, and so no facts, or a pickled dictionary: UnpicklingError if that has
    more than plain values and arrays.
    """
    with path.open("rb") as file:
        npy = np.lib.format
        is_first_version = npy.read_magic(file) == (1, 0)
        read_header = npy.read_array_header_1_0 if is_first_version else npy.read_array_header_2_0
        shape, _, dtype = read_header(file)
        if dtype.hasobject and shape == ():  # a pickled dictionary follows
            return _unpickle(file)
    return np.load(path, allow_pickle=False), {}


def _load_facts(path: Path) -> dict[str, Any]:
    """Load the facts in a JSON file, by name; {} if there is no such file."""
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


def _unpickle(file: IO[bytes]) -> tuple[Any, dict[str, Any]]:
    """Return the places in an open pickle file, and all facts stored with them by name."""
    record = load_harmless_pickle(file)
    record = record[0] if isinstance(record, list) else record
    facts = {name: unwrap_array(value) for name, value in record.items()}
    return facts["trajectories"], facts


def _to_places(table: pd.DataFrame) -> np.ndarray:
    """Convert a table with a row per frame and animal to places (frames, animals, 2).

    Places without a row are NaN.
    """
    frame, animal = (table[name].to_numpy(int) for name in ("frame", "individual"))
    places = np.full((frame.max() + 1, animal.max() + 1, 2), np.nan)
    places[frame, animal] = table[["x", "y"]].to_numpy(float)
    return places
