"""Trajectories of idtracker.ai, of a session, a folder or a file: .npy, .h5, .csv, .parquet.

They hold the centre of every animal in every frame of the film, x and y in px, and its name.
"""

import io
import json
import pickle
import re
from pathlib import Path, PurePosixPath
from typing import IO, Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, poses_from_arrays
from finloop.io.poses.extra import import_extra, unreadable_error
from finloop.io.poses.text import read_plain_csv

SOFTWARE, CENTRE = "idtracker.ai", "centre"
# In the order that the program itself prefers: corrected by hand, then with gaps closed.
_NAMES = (
    "trajectories", "validated", "without_gaps", "with_gaps", "trajectories_validated",
    "trajectories_wo_gaps", "trajectories_wo_identification",
)  # fmt: skip
# HDF5 needs an optional package: it is read only where there is nothing else.
_ENDINGS = (".npy", ".pickle", "_csv", "_tidy.csv", ".parquet", ".h5", ".hdf5")
_PLAIN_KINDS = re.compile(r"[<>|=]?(?:[biufc][1248]?|[biufc]16|[SU]\d{1,4}|O8?)")
"""Kinds of numbers and words of which arrays are built: none has fields, and none an address."""


def read_idtracker(path: Path) -> Poses:
    """Load poses of idtracker.ai from a session's folder, its folder `trajectories`, or a file.

    The only keypoint is each animal's centre. FinloopError if nothing there can be read.
    """
    path = _find_file(path)
    try:
        loaded, facts = _load_places(path)
        places, labels = np.asarray(loaded), facts.get("identities_labels")
        names = [] if labels is None else [str(label) for label in labels]
    except FinloopError:
        raise
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


def _find_file(path: Path) -> Path:
    """Return the best file of trajectories at a path: itself, or the first of a session's files."""
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
    """Return places (frames, animals, 2) in px, and the facts that are stored with them by name.

    path: a file, or a folder of CSV files. FinloopError for a file with another ending.
    """
    if path.is_dir():
        return _load_places(path / "trajectories.csv")[0], _load_facts(path / "attributes.json")
    match path.suffix.lower():
        case ".npy":
            with path.open("rb") as file:
                version, read_header = (
                    np.lib.format.read_magic(file),
                    np.lib.format.read_array_header_1_0,
                )
                if version != (1, 0):
                    read_header = np.lib.format.read_array_header_2_0
                shape, _, dtype = read_header(file)
                if dtype.hasobject and shape == ():  # a pickled dictionary follows
                    return _unpickle(file)
            return np.load(path, allow_pickle=False), {}
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
        case ".csv":
            wide = pd.read_csv(io.StringIO(read_plain_csv(path)))
            if "individual" in wide:
                return _to_places(wide), _load_facts(path.with_name("attributes_tidy.json"))
            return wide.drop(columns="time").to_numpy(float).reshape(len(wide), -1, 2), {}
    raise unreadable_error(path, SOFTWARE, "its ending is another")


def _load_facts(path: Path) -> dict[str, Any]:
    """Load the facts in a JSON file, by name; {} if there is no such file."""
    return json.loads(path.read_text("utf-8")) if path.exists() else {}


class _PickledKind:
    """A kind of numbers or words, as a pickle names it; UnpicklingError for any other.

    numpy itself would take kinds whose arrays point to any place in memory.
    """

    def __init__(self, name: str, *_: object) -> None:
        """Keep the name of a plain kind, such as "f8"."""
        if not (isinstance(name, str) and _PLAIN_KINDS.fullmatch(name)):
            raise pickle.UnpicklingError(f"it holds an array of {name!r}")
        self.name, self.order = name, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Take the byte order of the kind; refuse fields and other additions."""
        if any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("it holds an array with fields")
        self.order = "=" if state[1] == "|" else str(state[1])

    def to_array(self, data: bytes) -> np.ndarray:
        """Return the numbers or words that bytes hold; ValueError for words of Python."""
        kind = np.dtype(self.name)
        return np.frombuffer(data, kind.newbyteorder(">") if self.order == ">" else kind)


class _PickledArray:
    """An array as a pickle holds it: `value` is a numpy array, or a list of Python's things."""

    value: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Build the array from version, shape, kind, order of the axes, and data."""
        _, shape, kind, is_fortran, data = state
        if kind.name.lstrip("<>|=").startswith("O"):
            self.value = list(data)
        else:
            order = "F" if is_fortran else "C"
            self.value = kind.to_array(bytes(data)).reshape(shape, order=order)


def _encode_latin1(text: str, _: str = "latin1") -> bytes:
    """Return the bytes that a pickle of protocol 2 writes as text."""
    return text.encode("latin1")


def _array_from_buffer(
    data: Any, kind: _PickledKind, shape: tuple[int, ...], order: str
) -> np.ndarray:
    """Return the array that a pickle of protocol 5 holds; order: of its axes, "C" or "F"."""
    return kind.to_array(bytes(data)).reshape(shape, order="F" if order == "F" else "C")


def _scalar(kind: _PickledKind, data: bytes) -> Any:
    """Return the number or word that a pickle holds as a scalar of numpy."""
    return kind.to_array(data)[0]


_BUILDERS: dict[tuple[str, str], Any] = {
    ("_codecs", "encode"): _encode_latin1, ("builtins", "set"): set,
    ("collections", "OrderedDict"): dict,
    ("numpy", "dtype"): _PickledKind, ("numpy", "ndarray"): _PickledArray,
    **{(f"numpy.{core}.{module}", name): builder for core in ("core", "_core")
       for module, name, builder in (
           ("multiarray", "_reconstruct", lambda *_: _PickledArray()),
           ("multiarray", "scalar", _scalar), ("numeric", "_frombuffer", _array_from_buffer),
       )},
}  # fmt: skip
"""What is called in place of what a pickle names: none of it runs a program."""


class _HarmlessUnpickler(pickle.Unpickler):
    """Reader of pickles that hold only arrays, numbers and words; others could run any program."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for the class or function that a pickle names; refuse all others."""
        if module.split(".")[0] == "pathlib":
            return PurePosixPath
        if (module, name) not in _BUILDERS:
            raise pickle.UnpicklingError(f"it would run {module}.{name}")
        return _BUILDERS[module, name]


def _unpickle(file: IO[bytes]) -> tuple[Any, dict[str, Any]]:
    """Return the places in an open pickle file, and all facts stored with them."""
    record = _unwrap(_HarmlessUnpickler(file).load())
    record = record[0] if isinstance(record, list) else record
    facts = {name: _unwrap(value) for name, value in record.items()}
    return facts["trajectories"], facts


def _unwrap(value: Any) -> Any:
    """Return the value of an array that was read from a pickle; anything else as it is."""
    return value.value if isinstance(value, _PickledArray) else value


def _to_places(table: pd.DataFrame) -> np.ndarray:
    """Convert a table with a row per frame and animal to places (frames, animals, 2), NaN: none."""
    frame, animal = (table[name].to_numpy(int) for name in ("frame", "individual"))
    places = np.full((frame.max() + 1, animal.max() + 1, 2), np.nan)
    places[frame, animal] = table[["x", "y"]].to_numpy(float)
    return places
