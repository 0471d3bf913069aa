"""Parameters at the door of a stage: params.yaml is read, checked and becomes a dataclass.

A parameter is defined once, in the stage's module `stages/params/<word>.py`: a frozen dataclass
per option of the Hydra group `conf/<word>/`, without defaults (values live in conf/ alone)::

    @dataclass(frozen=True)
    class Extract:
        noise_sigmas: Annotated[float, Field(gt=0)]  # threshold above the background, in sigmas
        polarity: Literal["auto", "dark", "bright"]

    OPTIONS = {"default": Extract}

and its value in `conf/extract/default.yaml`, whose first lines name the schema made from it::

    defaults:
      - /schema/extract/default@_here_
      - _self_
    noise_sigmas: 5.0
    polarity: auto

Where a group has several options, each dataclass has a field `source` whose value is the option's
name in OPTIONS. `__post_init__` may raise ValueError for what two parameters must not be together.
Types are strict (3.0 is no int, "3" no number, true no 1), NaN and infinity are never allowed.
A group is flat: no dataclass inside a dataclass. `stages.params.whole` lists the groups; Hydra's
schemas are made from the same dataclasses (`hydra_plugins/finloop_schemas.py`).
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from finloop.errors import FinloopError

PARAMS = Path("params.yaml")
CONF = Path("conf")
STAMP = "conf_sha256"  # the key in params.yaml that says which conf/ it was composed from
T = TypeVar("T")


def load(word: str, options: Mapping[str, type[T]]) -> T:
    """The parameters of stage `word` from params.yaml, checked.

    Raises FinloopError that lists every problem by its dotted name, or says that conf/ was edited
    after params.yaml was composed.
    """
    group, problems = check(word, options, read().get(word, {}))
    if group is None:
        raise complaint(problems)
    return group


def read() -> dict[str, Any]:
    """params.yaml, composed from the present conf/; FinloopError where it is not."""
    try:
        values = yaml.safe_load(PARAMS.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise FinloopError(
            f"{PARAMS} cannot be read: {error}", "what `make params` writes", "make params"
        ) from error
    if not isinstance(values, dict):
        raise FinloopError(
            f"{PARAMS} holds no parameters", "what `make params` writes", "make params"
        )
    _refuse_stale(values)
    return values


def _refuse_stale(values: Mapping[str, Any]) -> None:
    if values.get(STAMP) != conf_digest(CONF):
        raise FinloopError(
            f"{CONF}/ is not what {PARAMS} was composed from",
            f"a {PARAMS} composed from the present {CONF}/, so that no old value is used unseen",
            "make params, then dvc repro; or dvc exp run, which composes by itself (a temporary "
            "experiment sees only files that git tracks: git add new ones)",
        )


def conf_digest(conf: Path) -> str:
    """A digest of every .yaml file in a folder, names and contents, whatever the line ends."""
    digest = hashlib.sha256()
    for path in sorted(conf.rglob("*.yaml"), key=lambda path: path.relative_to(conf).as_posix()):
        text = path.read_bytes().replace(b"\r\n", b"\n")
        name = path.relative_to(conf).as_posix().encode()
        digest.update(b"%d %s %d %s" % (len(name), name, len(text), text))
    return digest.hexdigest()[:16]


def check(
    word: str, options: Mapping[str, type[T]], values: Any
) -> tuple[T, list[str]] | tuple[None, list[str]]:
    """One group's values as its dataclass, or None and every problem by its dotted name."""
    if not isinstance(values, Mapping):
        return None, [f"{word}: should be a group of parameters, got {values!r}"]
    values = {key: value for key, value in values.items() if value != "???"}  # not given (Hydra)
    option, *more = options.values()
    if more:
        name = values.get("source")
        if name not in options:
            return None, [f"{word}.source: should be one of {', '.join(options)}, got {name!r}"]
        option = options[name]
    strict = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    adapter: TypeAdapter[Any] = TypeAdapter(checked(option, frozen=True, config=strict))
    try:  # as JSON, where strict still lets a list be a tuple and a name an Enum
        return adapter.validate_json(json.dumps(values, default=str)), []
    except ValidationError as error:
        known = [field.name for field in fields(option)]  # type: ignore[arg-type]
        return None, [_problem(word, known, dict(detail)) for detail in error.errors()]


def _problem(word: str, known: list[str], detail: dict[str, Any]) -> str:
    name = ".".join(map(str, (word, *detail["loc"])))
    if detail["type"] == "missing":
        return f"{name}: has no value"
    if detail["type"] == "unexpected_keyword_argument":
        near = get_close_matches(str(detail["loc"][0]), known, 1)
        hint = f"did you mean {word}.{near[0]}?" if near else f"{word} has {', '.join(known)}"
        return f"{name}: unknown; {hint}"
    message = detail["msg"].removeprefix("Value error, ").removeprefix("Input ")
    return f"{name}: {message}" + (f", got {detail['input']!r}" if detail["loc"] else "")


def complaint(problems: list[str]) -> FinloopError:
    """One message about all problems."""
    count = "a parameter is" if len(problems) == 1 else f"{len(problems)} parameters are"
    return FinloopError(
        f"{count} refused:\n    " + "\n    ".join(problems),
        "the names, types and ranges in stages/params/",
        "correct conf/ and run `make params`, or override: dvc exp run -S name=value",
    )
