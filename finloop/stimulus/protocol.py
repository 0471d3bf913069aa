"""A protocol: what is shown to animals, in which conditions, how often, and in which order.

It is a YAML file that `load_protocol` reads; examples/protocol.yaml is one. Every field has its
unit and range here. Types are strict, unknown keys are refused, and all problems of a file are
reported at once, each with its line.

Conditions with the same motion show the very same motion: the seed of a trial's motion depends only
on the protocol's seed, the motion's own text and the number of the repeat. So a control differs
from its stimulus in its look or its change, and in nothing else.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Discriminator, Field, Tag, ValidationError

from finloop.base.errors import FinloopError
from finloop.stimulus.parts import (
    Animals,
    Change,
    Condition,
    Display,
    Look,
    Motion,
    Name,
    Part,
    Start,
    Trigger,
)
from finloop.stimulus.rules import RuleSpec
from finloop.stimulus.tracker import Pair, calibration
from finloop.stimulus.yaml_text import Place, Text, read_yaml

MOST_FISH = 64
MOST_TRIALS = 10_000
MOST_BYTES = 1_000_000
MOST_FISH_SECONDS = 100_000
"""The longest motion that is planned before it is shown, so that it fits into memory."""
LINES = (".csv", ".parquet", ".svg")
"""Kinds of files that hold a path."""
Problem = tuple[Place, str]
"""A place, and what is wrong there."""
_MODELS: dict[str | int, type[BaseModel]] = {
    "display": Display, "animals": Animals, "start": Start, "triggers": Trigger,
    "points": Pair, "motion": Motion, "rule": RuleSpec, "look": Look, "change": Change,
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


class Protocol(Part):
    """All that is shown, and in which order. Made by `load_protocol` or `protocol_of`."""

    version: Literal[1]
    """Version of this format: 1."""
    name: Name
    """Name of the protocol: up to 80 characters."""
    seed: Annotated[int, Field(ge=0, lt=2**53)]
    """Seed of the order and of all motions: 0..2^53 - 1."""
    fish: Annotated[int, Field(ge=1, le=MOST_FISH)] = 1
    """How many fish are shown: 1..64."""
    display: Display = Display()
    """Requirements of the display."""
    animals: Animals | None = None
    """Live animals; null: there are none, and no rule towards one."""
    pause_s: Annotated[float, Field(ge=0, le=86_400)] = 0.0
    """Between two trials, s, 0..86400: the empty tank."""
    repeats: Annotated[int, Field(ge=1, le=MOST_TRIALS)] = 1
    """How often each condition is shown: 1..10000."""
    order: Literal["given", "shuffled", "blocks"] = "given"
    """Order of the trials: as listed, again and again; all shuffled; or in blocks, each with every
    condition once, shuffled, and none twice in a row."""
    start: Annotated[
        Annotated[Literal["auto"], Tag("auto")] | Annotated[Start, Tag("wait")],
        Discriminator(lambda start: "auto" if isinstance(start, str) else "wait"),
    ] = "auto"
    """What starts each trial: auto, after the pause; {key: space}; or {message: its name}."""
    fade_s: Annotated[float, Field(ge=0, le=60)] = 0.0
    """Time for which the fish fade in and out at both ends of a trial, s, 0..60."""
    triggers: Annotated[tuple[Trigger, ...], Field(max_length=20)] = ()
    """Messages that are sent, 0..20."""
    conditions: Annotated[dict[Name, Condition], Field(min_length=1, max_length=200)]
    """By their names, 1..200."""

    @property
    def start_key(self) -> str | None:
        """Return the key that starts a trial, by its name in the browser; None: no key does."""
        return None if self.start == "auto" else self.start.key

    @property
    def start_message(self) -> str | None:
        """Return the name of the message that starts a trial; None: no message does."""
        return None if self.start == "auto" else self.start.message

    @property
    def keys(self) -> list[str]:
        """Return the keys with a meaning at the display, by their names in the browser."""
        return [self.start_key] if self.start_key else []

    @property
    def looks(self) -> list[Look]:
        """Return all looks of the conditions, each once; a state names a look by its index."""
        looks: list[Look] = []
        for condition in self.conditions.values():
            looks += [condition.look] * (condition.look not in looks)
        return looks


def motion_seed(protocol: Protocol, condition: str, repeat: int) -> int:
    """Return the seed (53 bits) of a trial's motion, from protocol seed, motion and repeat.

    condition: its name; repeat: of the condition, from 1.
    """
    motion = protocol.conditions[condition].motion.text
    text = json.dumps([protocol.seed, motion, repeat])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()) >> (256 - 53)


def load_protocol(path: Path) -> Protocol:
    """Read a protocol from a YAML file; FinloopError lists all that is wrong, line by line."""
    text = _read(path)
    if text.values is None:
        raise _refusal(str(path), text.problems)
    protocol, problems = _check_values(text.values, path.parent)
    problems = sorted(problems, key=lambda problem: text.line(problem[0]))
    lines = [f"line {text.line(at)}: {_format_problem(at, what)}" for at, what in problems]
    if protocol is None or text.problems or lines:
        raise _refusal(str(path), text.problems + lines)
    return protocol


def protocol_of(values: Mapping[str, Any], folder: Path = Path()) -> Protocol:
    """Return the protocol with the values of a YAML file; FinloopError lists all that is wrong.

    folder: where its relative paths begin.
    """
    protocol, problems = _check_values(values, folder)
    if protocol is None or problems:
        raise _refusal("what was given", [_format_problem(*problem) for problem in problems])
    return protocol


def _refusal(name: str, problems: list[str]) -> FinloopError:
    return FinloopError(
        f"{name} is no protocol:\n    " + "\n    ".join(problems),
        "a protocol as in docs/stimulus.md; examples/protocol.yaml is one",
        "correct these places",
    )


def _read(path: Path) -> Text:
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FinloopError(
            f"{path} cannot be read ({error.strerror})",
            "a protocol, a YAML file",
            "correct its name",
        ) from error
    if len(raw) > MOST_BYTES:
        return Text(None, {}, [f"larger than {MOST_BYTES / 1e6:g} MB"])
    try:
        return read_yaml(raw.decode())
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        return Text(None, {}, [f"line {line}: no UTF-8; save it as UTF-8"])


def _check_values(values: Any, folder: Path) -> tuple[Protocol | None, list[Problem]]:
    """Return the protocol, None where types are wrong, and every problem with its place."""
    protocol, problems = None, list[Problem]()
    try:
        protocol = _parse_protocol(values)
    except ValidationError as error:
        problems = [_problem(dict(detail)) for detail in error.errors(include_url=False)]
    # The valid parts are checked for contradictions, whatever is wrong elsewhere.
    sound = protocol or _sound(values, [place for place, _ in problems])
    if sound is not None:
        for condition in sound.conditions.values():
            condition.motion._folder = folder
        problems += contradictions(sound, list(values["conditions"]))
    return protocol, problems


def _parse_protocol(values: Any) -> Protocol:
    return Protocol.model_validate_json(json.dumps(values))


def _sound(values: Any, places: list[Place]) -> Protocol | None:
    """Return a protocol without what is wrong at some places; None where nothing is left."""
    if not isinstance(values, dict) or not isinstance(values.get("conditions"), dict):
        return None
    wrong = {place[0] for place in places if place}
    bad = {place[1] for place in places if place[:1] == ("conditions",) and len(place) > 1}
    kept = {key: value for key, value in values.items() if key not in wrong}
    kept |= {key: value for key, value in _HARMLESS.items() if key in wrong}
    kept["conditions"] = {
        name: one for name, one in values["conditions"].items() if name not in bad
    }
    try:
        return _parse_protocol(kept)
    except ValidationError:
        return None


_GONE: dict[Place, str] = {("mode",): "leave it out: the stimulus is always of mode matching"}
"""Removed keys of protocols, and what to do about them."""


def _problem(detail: dict[str, Any]) -> Problem:
    """Return a complaint of pydantic in plain words, with its place."""
    place: Place = tuple(step for step in detail["loc"] if step != "[key]")
    if place[:1] == ("start",):
        place = place[:1] + place[2:]  # without the name of the alternative
    if detail["type"] == "extra_forbidden" and place in _GONE:
        return place, f"unknown; {_GONE[place]}"
    if detail["type"] == "extra_forbidden":
        names = [field.alias or name for name, field in _model(place).model_fields.items()]
        near = get_close_matches(str(place[-1]), names, 1)
        return place, "unknown; " + (
            f"did you mean {near[0]}?" if near else f"known: {', '.join(names)}"
        )
    said = str(detail["msg"]).removeprefix("Value error, ").removeprefix("Input ")
    said = _WORDS.get(detail["type"], said)
    came = json.dumps(detail["input"], ensure_ascii=False)
    came = came if len(came) <= 60 else came[:57] + "..."
    # A complaint about a group of keys itself names the value.
    of_keys = detail["type"] == "missing" or (detail["type"] == "value_error" and came[:1] == "{")
    return place, said if of_keys else f"{said}, got {came}"


def _model(place: Place) -> type[BaseModel]:
    if place[0] == "conditions" and len(place) == 3:
        return Condition
    around = [step for step in place[:-1] if step in _MODELS]
    return _MODELS[around[-1]] if around else Protocol


def _format_problem(place: Place, what: str) -> str:
    where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return f"{where.removeprefix('.')}: {what}" if where else what


def contradictions(protocol: Protocol, names: list[str]) -> Iterator[Problem]:
    """Yield the place and a description of each problem between fields that are valid alone.

    names: of all conditions of the file, valid or not.
    """
    if len(names) * protocol.repeats > MOST_TRIALS:
        yield ("repeats",), f"gives more than {MOST_TRIALS} trials"
    if protocol.display.fish_mm is not None and not protocol.display.calibrated:
        yield ("display", "fish_mm"), "requires a calibrated display (calibrated: true)"
    if protocol.animals is not None:
        try:
            calibration(protocol.animals, 1.0)  # whether the film has a scale is not known yet
        except FinloopError as error:
            yield ("animals",), f"{' '.join(error.came.split())}; wanted: {error.wanted}"
    for name, condition in protocol.conditions.items():
        place = ("conditions", name)
        if 2 * protocol.fade_s > condition.seconds:
            yield (*place, "seconds"), f"should be at least two fades of {protocol.fade_s:g} s"
        for at, what in _motion_problems(protocol, condition):
            yield (*place, *at), what
        if condition.motion.again is not None:
            for at, what in _repeat_problems(protocol, names, name):
                yield (*place, *at), what


def _motion_problems(protocol: Protocol, condition: Condition) -> Iterator[Problem]:
    """Yield the problems of a condition's motion, at places within the condition."""
    motion, change = condition.motion, condition.change or Change()
    if motion.rule is not None:
        if protocol.animals is None:
            yield ("motion", "rule"), "requires live animals; describe them under animals"
        if condition.change is not None:
            yield ("change",), "requires a motion that is known beforehand; a rule's is not"
    elif not change.still and (
        protocol.fish * condition.seconds * change.speed > MOST_FISH_SECONDS
    ):
        yield (
            ("seconds",),
            (
                f"is too long for {protocol.fish} fish: a motion that is planned beforehand has at "
                f"most {MOST_FISH_SECONDS} s of all fish together"
            ),
        )
    if motion.company and protocol.fish < 2:
        yield ("motion", "company"), "requires at least two fish; there is one"
    if motion.path is not None:
        if motion.file.suffix.lower() not in LINES:
            yield ("motion", "path"), f"should be a file {', '.join(LINES)}, got {motion.path}"
        elif not _is_file(motion.file):
            yield ("motion", "path"), f"there is no file {motion.file}"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name too long for the disk
        return False


def _repeat_problems(protocol: Protocol, names: list[str], name: str) -> Iterator[Problem]:
    """Yield the problems of a condition that repeats the motion of another one (yoked)."""
    condition = protocol.conditions[name]
    source = condition.motion.again or ""
    if source not in names:
        near = get_close_matches(source, names, 1)
        more = f"; did you mean {near[0]}?" if near else ""
        yield ("motion", "again"), f"there is no condition {source}{more}"
        return
    if name in (chain := _chain(protocol, name)):
        circle = " shows ".join([name, *chain])
        yield ("motion", "again"), f"never has a motion of its own: {circle} again"
        return
    if protocol.order == "given" and names.index(source) > names.index(name):
        what = f"comes before {source} in the order given; list it after, or shuffle"
        yield ("motion", "again"), what
    of, change = protocol.conditions.get(source), condition.change or Change()
    wanted = 0.0 if change.still else condition.seconds * change.speed
    if of is not None and wanted > of.seconds:
        what = f"takes {wanted:g} s of the motion of {source}, which lasts {of.seconds:g} s"
        yield ("seconds",), what


def _chain(protocol: Protocol, name: str) -> list[str]:
    chain: list[str] = []
    while (one := protocol.conditions.get(name)) and (again := one.motion.again):
        if again in chain:
            break
        chain.append(again)
        name = again
    return chain
