"""Pickles of other programs, read as data: nothing that they name is looked up, run or imported.

A pickle is a program for a stack machine. The machine here knows the instructions that build words,
numbers, lists, dictionaries and arrays. A name in a pickle stays a name; the few that NumPy and
pathlib write are known, and every other one is refused.
"""

import pickletools
import re
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_PLAIN_KINDS = re.compile(r"[<>|=]?(?:[biufc][1248]?|[biufc]16|[SU]\d{1,4}|O8?)")
"""Kinds of numbers and words of which arrays are built: none has fields, and none an address."""
_CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
_ATOMS = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "STRING",
    "BINSTRING", "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8",
    "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "BYTEARRAY8",
}  # fmt: skip
"""Instructions that push the number or word that follows them."""
_EMPTY = {"EMPTY_LIST": list, "EMPTY_TUPLE": tuple, "EMPTY_DICT": dict, "EMPTY_SET": set}
_SHORT_TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class _Name(NamedTuple):
    """A class or function that a pickle names; it is never looked up."""

    module: str
    name: str


class _Kind:
    """The kind of an array's values: a number or a word, or an object."""

    def __init__(self, code: object) -> None:
        """Keep NumPy's code of a kind, such as "f8"; ValueError for any but a plain one."""
        if not (isinstance(code, str) and _PLAIN_KINDS.fullmatch(code)):
            raise ValueError(f"it holds an array of {code!r}")
        self.code, self.is_big_endian = code, code[0] == ">"
        self.is_object = code.lstrip("<>|=").startswith("O")

    def build(self, state: Any) -> None:
        """Take the byte order from NumPy's state; ValueError if the kind has fields or parts."""
        _, order, subarray, names, fields, *_ = state
        if any(part is not None for part in (subarray, names, fields)):
            raise ValueError("it holds an array with fields")
        self.is_big_endian = order == ">"

    def read_array(self, data: object) -> NDArray[Any]:
        """Return bytes as an array of this kind; ValueError for objects, which have no bytes."""
        if self.is_object or not isinstance(data, bytes | bytearray):
            raise ValueError("it holds an array of objects")
        plain = np.dtype(self.code.lstrip("<>|="))
        return np.frombuffer(bytes(data), plain.newbyteorder(">") if self.is_big_endian else plain)


class _Array:
    """An array that a pickle builds: `value` is a NumPy array, or a list of what it holds."""

    value: Any = None

    def build(self, state: Any) -> None:
        """Set `value` from version, shape, kind, order of the axes, and data."""
        _, shape, kind, is_fortran, data = state
        self.value = (
            list(data)
            if kind.is_object
            else _shape_array(kind, data, shape, "CF"[bool(is_fortran)])
        )


def _shape_array(kind: _Kind, data: object, shape: Any, order: object) -> NDArray[Any]:
    """Return bytes as an array of a shape; order: of its axes, "C" or "F"."""
    return kind.read_array(data).reshape(shape, order="F" if order == "F" else "C")


def _call(name: object, arguments: Any) -> Any:
    """Return what a call in a pickle stands for; ValueError, with the name, if it is not known."""
    if not isinstance(name, _Name) or not isinstance(arguments, tuple):
        raise ValueError("it calls what is no function")
    match re.sub(r"^numpy\._?core\.", "", name.module), name.name:
        case "_codecs", "encode":  # bytes in protocols 0 to 2
            return arguments[0].encode("latin1")
        case "collections", "OrderedDict":
            return {}
        case (("builtins" | "__builtin__"), "set"):
            return _plain_keys(arguments[0])
        case "numpy", "dtype":
            return _Kind(arguments[0])
        case "multiarray", "_reconstruct":
            return _Array()
        case "multiarray", "scalar":
            return arguments[0].read_array(arguments[1])[0].item()
        case "numeric", "_frombuffer":  # protocol 5
            data, kind, shape, order = arguments
            return _shape_array(kind, data, shape, order)
        case module, _ if module.split(".")[0] == "pathlib":
            return "/".join(arguments)
    raise ValueError(f"it would run {name.module}.{name.name}")


def _plain_keys(keys: Any) -> set[Any]:
    """Return words and numbers as a set; ValueError for anything else."""
    if not all(isinstance(key, str | bytes | int | float | None) for key in keys):
        raise ValueError("it has a key that is neither word nor number")
    return set(keys)


class _Machine:
    """The stack, the marks on it, and the values that a pickle refers to again."""

    def __init__(self) -> None:
        """Begin with an empty stack."""
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memo: dict[int, Any] = {}

    def run(self, instruction: str, argument: Any) -> None:
        """Carry out one instruction; ValueError if it is not one of those that build data."""
        stack = self.stack
        if instruction in _ATOMS:
            stack.append(argument)
        elif instruction in _CONSTANTS:
            stack.append(_CONSTANTS[instruction])
        elif instruction in _EMPTY:
            stack.append(_EMPTY[instruction]())
        elif instruction in _SHORT_TUPLES:
            self._replace(_SHORT_TUPLES[instruction], tuple)
        else:
            self._run_other(instruction, argument)

    def _run_other(self, instruction: str, argument: Any) -> None:
        """Carry out an instruction that marks, refers, collects, names or calls."""
        stack, memo = self.stack, self.memo
        match instruction:
            case "PROTO" | "FRAME":
                pass
            case "MARK":
                self.marks.append(len(stack))
            case "POP":
                stack.pop()
            case "PUT" | "BINPUT" | "LONG_BINPUT":
                memo[argument] = stack[-1]
            case "MEMOIZE":
                memo[len(memo)] = stack[-1]
            case "GET" | "BINGET" | "LONG_BINGET":
                stack.append(memo[argument])
            case "TUPLE" | "LIST":
                stack.append((tuple if instruction == "TUPLE" else list)(self._pop_marked()))
            case "DICT":
                stack.append(_add_pairs({}, self._pop_marked()))
            case "APPEND":
                value = stack.pop()
                _require(stack[-1], list).append(value)
            case "APPENDS":
                values = self._pop_marked()
                _require(stack[-1], list).extend(values)
            case "ADDITEMS":
                values = self._pop_marked()
                _require(stack[-1], set).update(_plain_keys(values))
            case "SETITEM":
                value, key = stack.pop(), stack.pop()
                _add_pairs(stack[-1], [key, value])
            case "SETITEMS":
                pairs = self._pop_marked()
                _add_pairs(stack[-1], pairs)
            case "GLOBAL":
                stack.append(_Name(*argument.split(" ", 1)))
            case "STACK_GLOBAL":
                self._replace(2, lambda words: _Name(*words))
            case "REDUCE":
                self._replace(2, lambda call: _call(*call))
            case "BUILD":
                state = stack.pop()
                _require(stack[-1], _Kind | _Array).build(state)
            case _:
                raise ValueError(f"it is a pickle with {instruction}, which is more than data")

    def _pop_marked(self) -> list[Any]:
        """Take the values above the last mark off the stack, and return them."""
        start = self.marks.pop()
        values = self.stack[start:]
        del self.stack[start:]
        return values

    def _replace(self, count: int, convert: Any) -> None:
        """Replace the last `count` values on the stack by what `convert` makes of them."""
        if len(self.stack) < count:
            raise ValueError("it is a damaged pickle")
        values = self.stack[-count:]
        self.stack[-count:] = [convert(values)]


def _require(value: Any, kind: Any) -> Any:
    """Return a value; ValueError if it is not of a kind."""
    if not isinstance(value, kind):
        raise ValueError("it is a damaged pickle")
    return value


def _add_pairs(values: Any, pairs: list[Any]) -> dict[Any, Any]:
    """Add keys and values, which follow one another, to a dictionary; return it."""
    _require(values, dict)
    _plain_keys(pairs[::2])
    values.update(zip(pairs[::2], pairs[1::2], strict=True))
    return values


def load_plain_pickle(file: IO[bytes]) -> Any:
    """Return what an open pickle file holds: words, numbers, lists, tuples, dictionaries, arrays.

    An array of objects is a list. Arrays inside lists, tuples and dictionaries need `unwrap_array`.
    ValueError, IndexError, KeyError or TypeError for anything else.
    """
    machine = _Machine()
    for opcode, argument, _ in pickletools.genops(file):
        if opcode.name == "STOP":
            break
        machine.run(opcode.name, argument)
    return unwrap_array(machine.stack[-1])


def unwrap_array(value: Any) -> Any:
    """Return the array, or list of objects, that a pickle built; any other value unchanged."""
    return value.value if isinstance(value, _Array) else value
