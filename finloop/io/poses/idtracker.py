"""Trajectories of idtracker.ai, of a session, a folder or a file: .npy, .h5, .csv, .parquet.

They hold the centre of every animal in every frame of the film, x and y in px, and its name.
"""

import json
import pickle
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, poses_from_arrays
from finloop.io.poses.extra import import_extra, unreadable

SOFTWARE, CENTRE = "idtracker.ai", "centre"
# In the order that the program itself prefers: corrected by hand, then with gaps closed.
_NAMES = (
    "trajectories", "validated", "without_gaps", "with_gaps", "trajectories_validated",
    "trajectories_wo_gaps", "trajectories_wo_identification",
)  # fmt: skip
# HDF5 needs an optional package: it is read only where there is nothing else.
_ENDINGS = (".npy", ".pickle", "_csv", "_tidy.csv", ".parquet", ".h5", ".hdf5")
_HARMLESS = {  # the parts of a pickle of arrays, numbers and words; none of them runs a program
    ("_codecs", "encode"), ("builtins", "set"), ("collections", "OrderedDict"),
    ("numpy", "dtype"), ("numpy", "ndarray"),
    *((f"numpy.{core}.{module}", name) for core in ("core", "_core") for module, name in (
        ("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"),
    )),
}  # fmt: skip


def read_idtracker(path: Path) -> Poses:
    """Load poses of idtracker.ai from a session's folder, its `trajectories`, or a file in it.

    The only keypoint is each animal's centre. FinloopError if nothing there can be read.
    """
    path = _find_file(path)
    try:
        places, names = _load_places(path)
    except FinloopError:
        raise
    except (
        ArithmeticError, AttributeError, EOFError, LookupError, OSError, TypeError, ValueError,
        pickle.UnpicklingError,
    ) as error:  # fmt: skip
        raise unreadable(path, SOFTWARE, error) from error
    if places.ndim != 3 or places.shape[2] != 2:
        raise unreadable(path, SOFTWARE, f"its trajectories have the shape {places.shape}")
    count = places.shape[1]
    names = names if len(names) == count else [str(number) for number in range(1, count + 1)]
    return poses_from_arrays(
        tuple(names), (CENTRE,), np.arange(len(places)), places[:, :, None].astype(float)
    )


def _find_file(path: Path) -> Path:
    if path.is_file() and path.parent.name.endswith("_csv"):
        return path.parent
    if path.is_file() or path.name.endswith("_csv"):
        return path
    home = path / "trajectories" if (path / "trajectories").is_dir() else path
    for name in _NAMES:
        for ending in _ENDINGS:
            if (home / f"{name}{ending}").exists():
                return home / f"{name}{ending}"
    raise unreadable(path, SOFTWARE, "the folder holds no trajectories")


def _load_places(path: Path) -> tuple[np.ndarray, list[str]]:
    """Return places (frames, animals, 2) px, and the animals' names, if they have any."""
    readers: dict[str, Callable[[Path], tuple[Any, dict[str, Any]]]] = {
        ".npy": _load_npy, ".pickle": _load_pickle, ".h5": _load_hdf5, ".hdf5": _load_hdf5,
        ".parquet": _load_parquet, ".csv": _load_csv,
    }  # fmt: skip
    reader = _load_csv_folder if path.is_dir() else readers.get(path.suffix.lower())
    if reader is None:
        raise unreadable(path, SOFTWARE, "its ending is another")
    places, facts = reader(path)
    names = facts.get("identities_labels")
    return np.asarray(places), [] if names is None else [str(name) for name in names]


class _Arrays(pickle.Unpickler):
    """Read pickles of arrays, numbers and words; refuse a pickle that would call anything else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return the class or function with that name, if it is harmless."""
        if module.split(".")[0] == "pathlib":
            return PurePosixPath
        if (module, name) not in _HARMLESS:
            raise pickle.UnpicklingError(f"it would run {module}.{name}")
        return super().find_class(module, name)


def _load_npy(path: Path) -> tuple[Any, dict[str, Any]]:
    with path.open("rb") as file:
        version = np.lib.format.read_magic(file)
        headers = np.lib.format.read_array_header_1_0, np.lib.format.read_array_header_2_0
        shape, _, dtype = headers[version != (1, 0)](file)
        if dtype.hasobject and shape == ():
            return _unpickle(file)
    return np.load(path, allow_pickle=False), {}


def _load_pickle(path: Path) -> tuple[Any, dict[str, Any]]:
    with path.open("rb") as file:
        return _unpickle(file)


def _unpickle(file: IO[bytes]) -> tuple[Any, dict[str, Any]]:
    record = _Arrays(file).load()
    record = record.item() if isinstance(record, np.ndarray) else record
    return record["trajectories"], record


def _load_hdf5(path: Path) -> tuple[Any, dict[str, Any]]:
    with import_extra("h5py", path).File(path) as file:
        return file["trajectories"][()], dict(file.attrs)


def _load_parquet(path: Path) -> tuple[Any, dict[str, Any]]:
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    facts = json.loads((table.schema.metadata or {}).get(b"idtrackerai_attributes", b"{}"))
    return _to_places(table.to_pandas()), facts


def _load_csv(path: Path) -> tuple[Any, dict[str, Any]]:
    table = pd.read_csv(path)
    if "individual" not in table:
        return table.drop(columns="time").to_numpy(float).reshape(len(table), -1, 2), {}
    facts = path.with_name("attributes_tidy.json")
    return _to_places(table), json.loads(facts.read_text("utf-8")) if facts.exists() else {}


def _load_csv_folder(path: Path) -> tuple[Any, dict[str, Any]]:
    places, _ = _load_csv(path / "trajectories.csv")
    facts = path / "attributes.json"
    return places, json.loads(facts.read_text("utf-8")) if facts.exists() else {}


def _to_places(table: pd.DataFrame) -> np.ndarray:
    """Convert a table with a row per frame and animal to an array (frames, animals, 2)."""
    frame, animal = (table[name].to_numpy(int) for name in ("frame", "individual"))
    places = np.full((frame.max() + 1, animal.max() + 1, 2), np.nan)
    places[frame, animal] = table[["x", "y"]].to_numpy(float)
    return places
