"""Protocols read from YAML files as people write them; all problems are reported with their lines.

Scalars are read as in YAML 1.2 and JSON: `no`, `on`, `1:30` and `2026-01-01` are text, and `010` is
no number. PyYAML reads YAML 1.1, where they are false, true, 90, a date and 8. Keys are always
text. A repeated key, a tag, a merge (`<<`), and anchors that would grow to very many values are
problems.
"""

import json
import re
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pydantic import BaseModel, ValidationError
from yaml.nodes import MappingNode, Node, ScalarNode

from finloop.base.errors import FinloopError
from finloop.stimulus.protocol import (
    MOST_TRIALS,
    AnimalSettings,
    Condition,
    DisplayRequirements,
    Look,
    Motion,
    MotionChange,
    Protocol,
    RuleSpec,
    TrialStart,
    Trigger,
)
from finloop.stimulus.tracker import PointPair, fit_calibration

MOST_BYTES = 1_000_000
MOST_FISH_SECONDS = 100_000
"""The longest motion that is planned before it is shown, so that it fits into memory."""
PATH_FILES = (".csv", ".parquet", ".svg")
"""Kinds of files that hold a path."""
_MOST_VALUES, _DEEPEST = 100_000, 20
_TAGS = {f"tag:yaml.org,2002:{kind}" for kind in ("str", "seq", "map")} | {"!"}
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]{0,400})")
_REAL = re.compile(r"[-+]?([0-9]+\.[0-9]*|\.[0-9]+|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?")
_CONSTANTS = {"": None, "~": None, "null": None, "true": True, "false": False}
_MODELS: dict[str | int, type[BaseModel]] = {
    "display": DisplayRequirements, "animals": AnimalSettings, "start": TrialStart,
    "triggers": Trigger, "points": PointPair, "motion": Motion, "rule": RuleSpec, "look": Look,
    "change": MotionChange,
}  # fmt: skip
_HARMLESS = {"version": 1, "name": "-", "seed": 0, "fish": 2, "animals": {}, "order": "shuffled"}
"""Values in place of wrong ones; they contradict nothing."""
_WORDS = {
    "missing": "has no value",
    "dict_type": "should be keys with values",
    "model_type": "should be keys with values",
    "model_attributes_type": "should be keys with values",
    "tuple_type": "should be a list",
}
"""Complaints of pydantic in the words of a protocol."""
Place = tuple[str | int, ...]
"""Where something is in a protocol: keys and numbers of entries, from the outside in."""
_REMOVED: dict[Place, str] = {("mode",): "leave it out: the stimulus is always of mode matching"}
"""Keys that protocols no longer have, and what to do about them."""
Problem = tuple[Place, str]
"""A place, and what is wrong there."""


def load_protocol(path: Path) -> Protocol:
    """Return the protocol in a YAML file; FinloopError lists all problems, line by line."""
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        came, wanted = f"{path} cannot be read ({error.strerror})", "a protocol, a YAML file"
        raise FinloopError(came, wanted, "correct its name") from error
    if len(raw) > MOST_BYTES:
        raise _protocol_error(str(path), [f"larger than {MOST_BYTES / 1e6:g} MB"])
    try:
        parsed = read_yaml(raw.decode())
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        problem = f"line {line}: no UTF-8; save it as UTF-8"
        raise _protocol_error(str(path), [problem]) from error
    if parsed.values is None:
        raise _protocol_error(str(path), parsed.problems)
    protocol, problems = _protocol_and_problems(parsed.values, path.parent)
    problems = sorted(problems, key=lambda problem: parsed.line(problem[0]))
    lines = [
        f"line {parsed.line(place)}: {_format_problem(place, what)}" for place, what in problems
    ]
    if protocol is None or parsed.problems or lines:
        raise _protocol_error(str(path), parsed.problems + lines)
    return protocol


def parse_protocol(values: Mapping[str, Any], folder: Path = Path()) -> Protocol:
    """Return the protocol that the values of a YAML file describe; FinloopError lists all problems.

    folder: where the protocol's relative paths begin.
    """
    protocol, problems = _protocol_and_problems(values, folder)
    if protocol is None or problems:
        lines = [_format_problem(*problem) for problem in problems]
        raise _protocol_error("what was given", lines)
    return protocol


def _protocol_error(name: str, problems: list[str]) -> FinloopError:
    """Return the error that lists all problems of a protocol; name: that of its file."""
    return FinloopError(
        f"{name} is no protocol:\n    " + "\n    ".join(problems),
        "a protocol as in docs/stimulus.md; examples/protocol.yaml is one",
        "correct these places",
    )


# --- YAML


class YamlText(NamedTuple):
    """What a YAML text holds: its values, the line of each, and its problems.

    values: None where the text cannot be read at all; lines: number of the line, from 1, of each
    key and entry; problems: a sentence each, with its line.
    """

    values: Any
    lines: dict[Place, int]
    problems: list[str]

    def line(self, place: Place) -> int:
        """Return the line number, from 1, of a place in the values, or of what encloses it."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


class _YamlTooLarge(Exception):
    """Error of a YAML text that has too many values, or nests them too deeply."""


def read_yaml(text: str) -> YamlText:
    """Return what a YAML text holds: its values, the line of each, and all problems."""
    reader = _YamlReader()
    try:
        root = yaml.compose(text, yaml.BaseLoader)
        if root is None:
            return YamlText(None, {}, ["the file is empty"])
        return YamlText(reader.read_node(root, ()), reader.lines, reader.problems)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = f"{place}no YAML: {', '.join(filter(None, (error.context, error.problem)))}"
    except yaml.YAMLError as error:  # a character that is not allowed
        problem = f"no YAML: {' '.join(str(error).split())}"
    except _YamlTooLarge as error:
        problem = str(error)
    except RecursionError:
        problem = "it is nested too deeply"
    return YamlText(None, {}, [problem])


class _YamlReader:
    """Converter of parsed YAML to values; it collects the line of each value, and all problems."""

    def __init__(self) -> None:
        """Begin without lines and problems."""
        self.lines: dict[Place, int] = {}
        self.problems: list[str] = []
        self._left = _MOST_VALUES

    def read_node(self, node: Node, place: Place) -> Any:
        """Return the value of a YAML node, and note its line and its problems.

        _YamlTooLarge if there are too many values, or they are nested too deeply, as anchors within
        themselves are.
        """
        line = node.start_mark.line + 1
        self.lines.setdefault(place, line)
        self._left -= 1
        if self._left < 0:
            raise _YamlTooLarge(f"more than {_MOST_VALUES} values, anchors written out")
        if len(place) > _DEEPEST:
            raise _YamlTooLarge(f"line {line}: nested too deeply, or an anchor within itself")
        if node.tag not in _TAGS:
            self.problems.append(f"line {line}: the tag {node.tag} is not known here")
        if isinstance(node, ScalarNode):  # without a style it is unquoted
            return _scalar_value(node.value) if node.style is None else node.value
        if isinstance(node, MappingNode):
            return self._read_mapping(node, place)
        return [self.read_node(item, (*place, number)) for number, item in enumerate(node.value)]

    def _read_mapping(self, node: MappingNode, place: Place) -> dict[str, Any]:
        """Return the values of the YAML mapping at a place by key; refused keys become problems."""
        values: dict[str, Any] = {}
        for key, value in node.value:
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
                values[key.value] = self.read_node(value, (*place, key.value))
        return values


def _scalar_value(text: str) -> Any:
    """Return what an unquoted YAML word means: null, true, false, a number, or text."""
    if text.lower() in _CONSTANTS:
        return _CONSTANTS[text.lower()]
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _REAL.fullmatch(text) else text


# --- types


def _protocol_and_problems(values: Any, folder: Path) -> tuple[Protocol | None, list[Problem]]:
    """Return the protocol that values describe, None if types are wrong; and all problems.

    folder: where the protocol's relative paths begin.
    """
    protocol, problems = None, list[Problem]()
    try:
        protocol = _build_protocol(values)
    except ValidationError as error:
        problems = [_type_problem(dict(detail)) for detail in error.errors(include_url=False)]
    # The valid parts are checked for contradictions, whatever is wrong elsewhere.
    valid_part = protocol or _keep_valid_parts(values, [place for place, _ in problems])
    if valid_part is not None:
        for condition in valid_part.conditions.values():
            condition.motion._folder = folder
        problems += _find_contradictions(valid_part, list(values["conditions"]))
    return protocol, problems


def _build_protocol(values: Any) -> Protocol:
    """Return the protocol that values describe; ValidationError if they do not fit its format."""
    return Protocol.model_validate_json(json.dumps(values))


def _keep_valid_parts(values: Any, wrong_places: list[Place]) -> Protocol | None:
    """Return a protocol without its invalid values, to check the others; None if none is left.

    Wrong conditions are left out; other wrong values are left out or replaced by harmless ones.
    """
    if not isinstance(values, dict) or not isinstance(values.get("conditions"), dict):
        return None
    wrong_keys = {place[0] for place in wrong_places if place}
    wrong_names = {
        place[1] for place in wrong_places if place[:1] == ("conditions",) and len(place) > 1
    }
    valid = {key: value for key, value in values.items() if key not in wrong_keys}
    valid |= {key: value for key, value in _HARMLESS.items() if key in wrong_keys}
    valid["conditions"] = {
        name: condition
        for name, condition in values["conditions"].items()
        if name not in wrong_names
    }
    try:
        return _build_protocol(valid)
    except ValidationError:
        return None


def _type_problem(detail: dict[str, Any]) -> Problem:
    """Return one of pydantic's validation errors as a place and a sentence in plain words."""
    place: Place = tuple(step for step in detail["loc"] if step != "[key]")
    if place[:1] == ("start",):
        place = place[:1] + place[2:]  # without pydantic's name of the alternative: auto or wait
    if detail["type"] == "extra_forbidden":
        if place in _REMOVED:
            return place, f"unknown; {_REMOVED[place]}"
        fields = _enclosing_model(place).model_fields.items()
        names = [field.alias or name for name, field in fields]
        near = get_close_matches(str(place[-1]), names, 1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(names)}"
        return place, f"unknown; {hint}"
    message = str(detail["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    message = _WORDS.get(detail["type"], message)
    came = json.dumps(detail["input"], ensure_ascii=False)
    came = came if len(came) <= 60 else came[:57] + "..."
    # What came is not repeated if it is nothing, or a group whose wrong key the message names.
    is_group = detail["type"] == "value_error" and came.startswith("{")
    says_enough = detail["type"] == "missing" or is_group
    return place, message if says_enough else f"{message}, got {came}"


def _enclosing_model(place: Place) -> type[BaseModel]:
    """Return the class that describes the group of keys around a place in a protocol."""
    if place[0] == "conditions" and len(place) == 3:  # a key of a condition
        return Condition
    groups = [step for step in place[:-1] if step in _MODELS]
    return _MODELS[groups[-1]] if groups else Protocol


def _format_problem(place: Place, what: str) -> str:
    """Return a problem as text, such as "conditions.a.seconds: has no value"."""
    where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return f"{where.removeprefix('.')}: {what}" if where else what


# --- contradictions


def _find_contradictions(protocol: Protocol, names: list[str]) -> Iterator[Problem]:
    """Yield the places where fields of a protocol, each valid alone, contradict others, and why.

    names: of all conditions in the file, valid or not.
    """
    if len(names) * protocol.repeats > MOST_TRIALS:
        yield ("repeats",), f"gives more than {MOST_TRIALS} trials"
    if protocol.display.fish_mm is not None and not protocol.display.calibrated:
        yield ("display", "fish_mm"), "requires a calibrated display (calibrated: true)"
    if protocol.animals is not None:
        try:
            # Whether the film has a scale is not known yet; any will do.
            fit_calibration(protocol.animals, mm_per_px=1.0)
        except FinloopError as error:
            yield ("animals",), f"{' '.join(error.came.split())}; wanted: {error.wanted}"
    for name, condition in protocol.conditions.items():
        group = ("conditions", name)
        if 2 * protocol.fade_s > condition.seconds:
            yield (*group, "seconds"), f"should be at least two fades of {protocol.fade_s:g} s"
        for place, what in _motion_problems(protocol, condition):
            yield (*group, *place), what
        if condition.motion.again is not None:
            for place, what in _repeat_problems(protocol, names, name):
                yield (*group, *place), what


def _motion_problems(protocol: Protocol, condition: Condition) -> Iterator[Problem]:
    """Yield the problems of a condition's motion: places within the condition, and sentences."""
    motion, change = condition.motion, condition.change or MotionChange()
    fish_seconds = 0 if change.still else protocol.fish * condition.seconds * change.speed
    if motion.rule is not None:
        if protocol.animals is None:
            yield ("motion", "rule"), "requires live animals; describe them under animals"
        if condition.change is not None:
            yield ("change",), "requires a motion that is known beforehand; a rule's is not"
    elif fish_seconds > MOST_FISH_SECONDS:
        what = f"is too long for {protocol.fish} fish: a motion that is planned beforehand has at "
        yield ("seconds",), f"{what}most {MOST_FISH_SECONDS} s of all fish together"
    if motion.company and protocol.fish < 2:
        yield ("motion", "company"), "requires at least two fish; there is one"
    if motion.path is not None:
        if motion.file.suffix.lower() not in PATH_FILES:
            kinds = ", ".join(PATH_FILES)
            yield ("motion", "path"), f"should be a file {kinds}, got {motion.path}"
        elif not _is_file(motion.file):
            yield ("motion", "path"), f"there is no file {motion.file}"


def _is_file(path: Path) -> bool:
    """Return whether a file exists; False if its name is too long for the disk."""
    try:
        return path.is_file()
    except OSError:
        return False


def _repeat_problems(protocol: Protocol, names: list[str], name: str) -> Iterator[Problem]:
    """Yield the problems of a condition that repeats another condition's motion (yoked).

    names: of all conditions in the file; name: of this one.
    """
    condition = protocol.conditions[name]
    source = condition.motion.again or ""
    if source not in names:
        near = get_close_matches(source, names, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        yield ("motion", "again"), f"there is no condition {source}{hint}"
        return
    chain = [source]  # its source, the source of its source, and so on
    while chain[-1] in protocol.conditions:
        next_source = protocol.conditions[chain[-1]].motion.again
        if not next_source or next_source in chain:
            break
        chain.append(next_source)
    if name in chain:
        circle = " shows ".join([name, *chain])
        yield ("motion", "again"), f"never has a motion of its own: {circle} again"
        return
    if protocol.order == "given" and names.index(source) > names.index(name):
        what = f"comes before {source} in the order given; list it after, or shuffle"
        yield ("motion", "again"), what
    repeated, change = protocol.conditions.get(source), condition.change or MotionChange()
    needed = 0.0 if change.still else condition.seconds * change.speed
    if repeated is not None and needed > repeated.seconds:
        what = f"takes {needed:g} s of the motion of {source}, which lasts {repeated.seconds:g} s"
        yield ("seconds",), what
