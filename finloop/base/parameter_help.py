"""What each parameter means: its comment in conf/, and the range that its dataclass allows."""

import re
import types
from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

from finloop.base.settings import CONF, GROUPS, read_conf_values, variants

_KEY = re.compile(r"([a-z_0-9]+):(?:\s|$)(?:[^#]*#\s*(.*))?")
_BRACKET = re.compile(r"\s*\[([^\[\]]*)\]$")


class ParameterHelp(NamedTuple):
    """The explanation of one parameter: its comment in conf/<word>/<option>.yaml, and its range."""

    word: str  # its group, such as "clip"
    option: str  # the variant of the group, such as "carp"; mostly "default"
    name: str
    value: Any  # in that file
    meaning: str  # the comment without its last brackets
    brackets: str  # text in these brackets, "unit, range"
    range: str  # the values that its dataclass allows, in words

    @property
    def group(self) -> str:
        """Return the group's name, with the variant if it has several: "extract", "clip=carp"."""
        return self.word if len(variants(self.word)) == 1 else f"{self.word}={self.option}"

    @property
    def unit(self) -> str:
        """Return the parameter's unit, from its comment; "" for a count, a choice or a text."""
        return self.brackets.removesuffix(self.range).rstrip(", ")


def parameter_help(word: str, conf: Path = CONF) -> Iterator[ParameterHelp]:
    """Yield the explanation of each parameter of a group such as "extract", variant by variant.

    conf: the folder conf/, with the comments and values. A parameter without a comment has an empty
    meaning, one without a value has the value "???". `source`, the name of a variant, is left out.
    """
    for option, declared in variants(word).items():
        texts = _read_comments(conf / word / f"{option}.yaml")
        values = read_conf_values(word, option, conf)
        hints = get_type_hints(declared, include_extras=True)
        for field in fields(declared):
            if field.name == "source":
                continue
            text = texts.get(field.name, "")
            brackets = _BRACKET.search(text)
            yield ParameterHelp(
                word, option, field.name, value=values.get(field.name, "???"),
                meaning=_BRACKET.sub("", text), brackets=brackets[1] if brackets else "",
                range=range_text(hints[field.name]),
            )  # fmt: skip


def _read_comments(path: Path) -> dict[str, str]:
    """Return the comment of each parameter in a file of conf/, by the parameter's name.

    The lines above the parameter and the text beside it are joined. No file gives no comments.
    """
    above, comments = list[str](), dict[str, str]()
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        if line.startswith("#"):
            above.append(line[1:].strip())
            continue
        if key := _KEY.match(line):
            comments[key[1]] = " ".join(filter(None, [*above, key[2]]))
        above = []
    return comments


_PLURALS = {"any number": "numbers", "any whole number": "whole numbers", "text": "texts"}


def range_text(hint: Any) -> str:
    """Return in words which values the type annotation `hint` allows, such as "whole, ≥ 1"."""
    if hint is None or hint is type(None):
        return "null"
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _limit_text(parts[0], parts[1:])
    if origin in (Union, types.UnionType):
        return " or ".join(map(range_text, parts))
    if origin is Literal:
        *names, last = map(str, parts)
        return f"{', '.join(names)} or {last}" if names else last
    if origin in (tuple, list):
        inside = [part for part in parts if part is not Ellipsis]
        if origin is tuple and Ellipsis not in parts:
            return "(" + ", ".join(map(range_text, inside)) + ")"
        text = range_text(inside[0])
        return "list of " + _PLURALS.get(text, re.sub("^list of", "lists of", text))
    if origin in (dict, Mapping):
        return "settings by name"
    plain = {bool: "true or false", str: "text", float: "any number", int: "any whole number"}
    return plain.get(hint, "any value")


def _limit_text(base: Any, marks: tuple[Any, ...]) -> str:
    """Return in words which values an `Annotated` type allows, such as "whole, ≥ 1".

    base, marks: the type and its metadata, pydantic's limits. If there is a text among these, it is
    the result.
    """
    if texts := [mark for mark in marks if isinstance(mark, str)]:
        return texts[0]
    words = ["whole"] if base is int else [] if base is float else [range_text(base)]
    for mark in marks:
        for limit in getattr(mark, "metadata", [mark]):  # pydantic's Field holds several limits
            for name, sign in {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}.items():
                if hasattr(limit, name):
                    words.append(f"{sign} {getattr(limit, name):g}")
            if hasattr(limit, "min_length"):
                words.append("not empty")
    return ", ".join(words)


def list_parameters() -> list[ParameterHelp]:
    """Return the explanations of the parameters of all groups, in the order of conf/config.yaml."""
    return [entry for word in GROUPS for entry in parameter_help(word)]
