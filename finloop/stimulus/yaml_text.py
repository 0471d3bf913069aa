"""YAML as people write it: its values, and every problem with its line.

Scalars are read as in YAML 1.2 and JSON: `no`, `on`, `1:30` and `2026-01-01` are text, and `010` is
no number. PyYAML reads YAML 1.1, where they are false, true, 90, a date and 8. Keys are always
text. A repeated key, a tag, a merge (`<<`), and anchors that would grow to very many values are
problems.
"""

import re
from typing import Any, NamedTuple

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode

_MOST_VALUES, _DEEPEST = 100_000, 20
_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "seq", "map")} | {"!"}
_NULL = re.compile(r"~|null|", re.IGNORECASE)
_BOOL = re.compile(r"true|false", re.IGNORECASE)
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]{0,400})")
_REAL = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?")
Place = tuple[str | int, ...]
"""Where something is: keys and numbers of entries, from the outside in."""


class Text(NamedTuple):
    """The content of a YAML text: its values, the line of each, and what is wrong.

    values: None where the text cannot be read at all; lines: number of the line, from 1, of each
    key and entry; problems: a sentence each, with its line.
    """

    values: Any
    lines: dict[Place, int]
    problems: list[str]

    def line(self, place: Place) -> int:
        """Return the number of the line of a place, or of the nearest enclosing one."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


class _TooMuch(Exception):
    """Too many values, or nested too deeply."""


def read_yaml(text: str) -> Text:
    """Return the values of a YAML text, the line of each, and all problems."""
    reader = _Reader()
    try:
        root = yaml.compose(text, yaml.BaseLoader)
        if root is None:
            return Text(None, {}, ["the file is empty"])
        return Text(reader.value(root, ()), reader.lines, reader.problems)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        said = ", ".join(filter(None, (error.context, error.problem)))
        return Text(None, {}, [f"{place}no YAML: {said}"])
    except yaml.YAMLError as error:  # a character that is not allowed
        return Text(None, {}, [f"no YAML: {' '.join(str(error).split())}"])
    except _TooMuch as error:
        return Text(None, {}, [str(error)])
    except RecursionError:
        return Text(None, {}, ["it is nested too deeply"])


class _Reader:
    def __init__(self) -> None:
        self.lines: dict[Place, int] = {}
        self.problems: list[str] = []
        self._left = _MOST_VALUES

    def value(self, node: Node, place: Place) -> Any:
        line = node.start_mark.line + 1
        self.lines.setdefault(place, line)
        self._left -= 1
        if self._left < 0:
            raise _TooMuch(f"more than {_MOST_VALUES} values, anchors written out")
        if len(place) > _DEEPEST:
            raise _TooMuch(f"line {line}: nested too deeply, or an anchor within itself")
        if node.tag not in _TAGS:
            self.problems.append(f"line {line}: the tag {node.tag} is not known here")
        if isinstance(node, ScalarNode):
            return _scalar(node.value) if node.style is None else node.value
        if isinstance(node, MappingNode):
            return self._mapping(node, place)
        return [self.value(one, (*place, number)) for number, one in enumerate(node.value)]

    def _mapping(self, node: MappingNode, place: Place) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for key, one in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, ScalarNode):
                self.problems.append(f"line {line}: a list or a group is no key")
            elif key.value == "<<":
                self.problems.append(f"line {line}: << (a merge) is not known here")
            elif key.value in values:
                first = self.lines[*place, key.value]
                self.problems.append(f"line {line}: {key.value} is repeated, first in line {first}")
            else:
                self.lines[*place, key.value] = line
                values[key.value] = self.value(one, (*place, key.value))
        return values


def _scalar(text: str) -> Any:
    if _NULL.fullmatch(text):
        return None
    if _BOOL.fullmatch(text):
        return text.lower() == "true"
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _REAL.fullmatch(text) else text
