"""Pickles of other programs, read without running anything that they name."""

import pickle
import re
from pathlib import PurePosixPath
from typing import IO, Any

import numpy as np

_PLAIN_KINDS = re.compile(r"[<>|=]?(?:[biufc][1248]?|[biufc]16|[SU]\d{1,4}|O8?)")
"""Kinds of numbers and words of which arrays are built: none has fields, and none an address."""


class _PickledDtype:
    """Stand-in for a NumPy dtype in a pickle: only dtypes of numbers or words are allowed.

    numpy itself would take dtypes whose arrays point to any place in memory.
    """

    def __init__(self, name: str, *_: object) -> None:
        """Keep the name of a plain dtype, such as "f8"; UnpicklingError for any other."""
        if not (isinstance(name, str) and _PLAIN_KINDS.fullmatch(name)):
            raise pickle.UnpicklingError(f"it holds an array of {name!r}")
        self.name, self.order = name, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Take the byte order from the state that NumPy pickles of a dtype.

        UnpicklingError if the dtype has fields, or is itself an array.
        """
        _, order, subarray, names, fields, *_ = state
        if any(part is not None for part in (subarray, names, fields)):
            raise pickle.UnpicklingError("it holds an array with fields")
        self.order = "=" if order == "|" else str(order)

    def to_array(self, data: bytes) -> np.ndarray:
        """Convert bytes to an array of this dtype; ValueError if the dtype is object."""
        dtype = np.dtype(self.name)
        return np.frombuffer(data, dtype.newbyteorder(">") if self.order == ">" else dtype)


class _PickledArray:
    """Stand-in for an array in a pickle: `value` is a NumPy array, or a list of objects."""

    value: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        """Set `value` from version, shape, dtype, order of the axes, and data."""
        _, shape, dtype, is_fortran, data = state
        if dtype.name.lstrip("<>|=").startswith("O"):
            self.value = list(data)
        else:
            order = "F" if is_fortran else "C"
            self.value = dtype.to_array(bytes(data)).reshape(shape, order=order)


def _encode_latin1(text: str, _: str = "latin1") -> bytes:
    """Return text as the bytes that it stands for, in pickles of protocol 2 (`_codecs.encode`)."""
    return text.encode("latin1")


def _array_from_buffer(
    data: Any, dtype: _PickledDtype, shape: tuple[int, ...], order: str
) -> np.ndarray:
    """Return the array that a pickle of protocol 5 holds as bytes; order: "C" or "F"."""
    return dtype.to_array(bytes(data)).reshape(shape, order="F" if order == "F" else "C")


def _scalar_from_bytes(dtype: _PickledDtype, data: bytes) -> Any:
    """Return the number or word that a pickle holds as a NumPy scalar."""
    return dtype.to_array(data)[0]


_BUILDERS: dict[tuple[str, str], Any] = {
    ("_codecs", "encode"): _encode_latin1, ("builtins", "set"): set,
    ("collections", "OrderedDict"): dict,
    ("numpy", "dtype"): _PickledDtype, ("numpy", "ndarray"): _PickledArray,
    **{(f"numpy.{core}.{module}", name): builder for core in ("core", "_core")
       for module, name, builder in (
           ("multiarray", "_reconstruct", lambda *_: _PickledArray()),
           ("multiarray", "scalar", _scalar_from_bytes),
           ("numeric", "_frombuffer", _array_from_buffer),
       )},
}  # fmt: skip
"""What is called in place of what a pickle names: none of it runs a program."""


class _HarmlessUnpickler(pickle.Unpickler):
    """Unpickler that accepts arrays, numbers and words only, so that a file cannot run code."""

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
    """Return the value of a `_PickledArray`; return any other value unchanged.

    The value is a NumPy array, or a list if the array held Python objects.
    """
    return value.value if isinstance(value, _PickledArray) else value
