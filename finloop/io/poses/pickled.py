"""Pickles of other programs, read without running anything that they name."""

import pickle
import re
from pathlib import PurePosixPath
from typing import IO, Any

import numpy as np

_PLAIN_KINDS = re.compile(r"[<>|=]?(?:[biufc][1248]?|[biufc]16|[SU]\d{1,4}|O8?)")
"""Kinds of numbers and words of which arrays are built: none has fields, and none an address."""


class _PickledKind:
    """The dtype of an array, as a pickle names it: of numbers or words only.

    numpy itself would take dtypes whose arrays point to any place in memory.
    """

    def __init__(self, name: str, *_: object) -> None:
        """Keep the name of a plain dtype, such as "f8"; UnpicklingError for any other."""
        if not (isinstance(name, str) and _PLAIN_KINDS.fullmatch(name)):
            raise pickle.UnpicklingError(f"it holds an array of {name!r}")
        self.name, self.order = name, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Take the byte order from the state that numpy pickles of a dtype.

        UnpicklingError if the dtype has fields, or is itself an array.
        """
        _, order, subarray, names, fields, *_ = state
        if any(part is not None for part in (subarray, names, fields)):
            raise pickle.UnpicklingError("it holds an array with fields")
        self.order = "=" if order == "|" else str(order)

    def to_array(self, data: bytes) -> np.ndarray:
        """Return the numbers or words that bytes hold; ValueError if the dtype is object."""
        kind = np.dtype(self.name)
        return np.frombuffer(data, kind.newbyteorder(">") if self.order == ">" else kind)


class _PickledArray:
    """An array as a pickle holds it: `value` is a numpy array, or a list of Python's objects."""

    value: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Set `value` from version, shape, dtype, order of the axes, and data."""
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
    """Return the number or word that a pickle holds as a NumPy scalar."""
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
        """Return the harmless stand-in for what a pickle names; UnpicklingError if there is none.

        A pickle names classes and functions, which unpickling then calls.
        """
        if module.split(".")[0] == "pathlib":
            return PurePosixPath
        if (module, name) not in _BUILDERS:
            raise pickle.UnpicklingError(f"it would run {module}.{name}")
        return _BUILDERS[module, name]


def load_harmless_pickle(file: IO[bytes]) -> Any:
    """Return what an open pickle file holds: words, numbers, lists, tuples, dictionaries, arrays.

    Arrays inside the others need `unwrap_array`. UnpicklingError for anything else.
    """
    return unwrap_array(_HarmlessUnpickler(file).load())


def unwrap_array(value: Any) -> Any:
    """Return an array that was read from a pickle, as numpy's, or as a list if of Python's objects.

    Any other value is returned as it is.
    """
    return value.value if isinstance(value, _PickledArray) else value
