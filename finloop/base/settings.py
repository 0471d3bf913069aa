"""Parameters: what a stage word declares, the values in conf/, and the check of both.

A parameter is declared once, in the flat frozen dataclass `<Word>Settings` of
`finloop/<word>/settings.py`: its type and range as an annotation. Its value, unit and meaning stand
in `conf/<word>/default.yaml`. Constants beside the parameters are ClassVars; so is `RENAMED`, the
new name of each old one, or a phrase that says what replaces it. Where a word has several variants,
it is the union of their dataclasses, each with a field `source` that names its file in
`conf/<word>/`. `__post_init__` may raise ValueError for values that must not be together.

Types are strict (3.0 is no int, "3" no number, true no 1); NaN and infinity are never allowed.
"""

import json
import re
import sys
from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import yaml
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from finloop.base.errors import FinloopError
from finloop.base.override import quote_override, suggest_override
from finloop.base.program import shipped_folder

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
Count = Annotated[int, Field(ge=1)]
Seed = Annotated[int, Field(ge=0)]
Crf = Annotated[int, Field(ge=0, le=51)]  # quality of H.264: 0 = lossless or best, 51 = worst
Quality = Annotated[int, Field(ge=0, le=100)]  # of WebP: 0 = worst, 100 = best

CONF = shipped_folder() / "conf"
"""The values of this version; a lab's own repository has a conf/ of its own."""


@cache
def default_variants(conf: Path = CONF) -> dict[str, str]:
    """Return the default variant of every group of parameters by name, in config.yaml's order.

    conf: the folder conf/, absolute. Optional entries and those without a variant are left out.
    """
    options = dict[str, str]()
    path = conf / "config.yaml"
    entries = _load_yaml(path).get("defaults")
    if not isinstance(entries, list):
        raise FinloopError(
            f"{path} has no list `defaults`", "the groups of parameters, a line each",
            f"git checkout {path}",
        )  # fmt: skip
    for entry in entries:
        if isinstance(entry, dict):
            for word, option in entry.items():
                if not word.startswith("optional "):
                    options[word] = option
    return options


def _load_yaml(path: Path) -> dict[str, Any]:
    """Return the content of a YAML file, a mapping; FinloopError if it is anything else."""
    try:
        values = yaml.load(path.read_text(encoding="utf-8"), yaml.CSafeLoader)
    except (UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise yaml_error(path, error) from error
    if not isinstance(values, dict):
        raise yaml_error(path, ValueError("it holds no `name: value`"))
    return values


def yaml_error(path: Path, error: Exception) -> FinloopError:
    """Return the error for a file that is no YAML of ours; it names the line, where that is known.

    error: what the parser raised.
    """
    mark = getattr(error, "problem_mark", None)
    line = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
    is_deep = isinstance(error, RecursionError)
    why = "it is nested too deeply" if is_deep else getattr(error, "problem", None) or str(error)
    return FinloopError(
        f"{path}{line}: {why:.500}",
        "YAML in UTF-8, `name: value` in each line, without tags (!…)",
        "correct the file; a text with : # { [ ! & * or % stands in quotes",
    )


GROUPS = tuple(default_variants())
"""All groups of parameters, in the order of conf/config.yaml."""
WORDS = tuple(word for word in GROUPS if word != "cluster")
"""Those of the stages; `cluster` says where their work is done, which no result shows."""

OF_MODES = ("network", "loops", "hybrid", "matching", "animate")
"""The groups of the playing modes, and what is common to them: `animate` once held them all."""
_PAPER = "the modes network, loops and hybrid are the paper's; matching.uses says what it may use"
GONE = {
    "sprites": _PAPER,
    "jumps": _PAPER,
    "from": "it is matching.uses now",
    **dict.fromkeys(
        ("stay", "chance", "follow_most", "arrived", "jerk", "patience"), "matching does without it"
    ),
    **{old: f"it is matching.{new} now" for old, new in {
        "rare": "rarity_weight", "again": "repeat_cost", "free": "choice_noise",
        "brisk": "expected_speed_quantile", "seam": "discontinuity_cost", "tempo": "rest_cost",
        "path_share": "path_max_correction_ratio", "path_across": "path_offset_cost",
        "path_late": "path_late_cost", "path_beam": "beam", "path_stride": "search_step_deltas",
        "path_again": "repeat_cost", "path_ahead": "look_ahead_deltas",
    }.items()},
    **{old: f"it is a constant now, MatchingSettings.{new}" for old, new in {
        "brisk_least": "expected_speed_least", "memory": "repeat_memory",
        "path_reach": "path_steer_ahead", "path_effort": "path_correction_cost",
        "path_pace": "path_rest_cost", "path_heading": "path_heading_cost",
        "path_plan": "path_commit",
    }.items()},
}  # fmt: skip
"""Parameters that these groups no longer have under any name, and what stands in their place."""
RENAMED = {"nn": "network"}
"""Values that have another name now."""


def settings(word: str, **values: Any) -> Any:
    """Return a group of parameters as its dataclass, with the values of conf/ or those given.

    word: name of the group, mostly that of a stage. values: parameters to replace, by name.
    `settings("extract", noise_sigmas=6.0)` is a `finloop.extract.settings.ExtractSettings`;
    `settings("clip", source="carp", frames=50)` is a `finloop.clip.settings.CarpSettings`.
    FinloopError lists all names that are unknown, and values of a wrong type or out of range.
    """
    whole = read_conf_values(word, values.get("source", default_variants()[word])) | values
    group, problems = check_values(word, variants(word), whole)
    if problems:
        raise FinloopError(
            "\n    ".join(problems),
            f"names, types and ranges as in finloop/{word}/settings.py",
            "correct the arguments of settings()",
        )
    return group


def variants(word: str) -> dict[str, type]:
    """Return the settings dataclasses of a group by variant; each is a file in conf/<word>/.

    word: name of the group. Most groups have the variant "default" alone.
    """
    declared = getattr(_load_declaration(word), f"{word.capitalize()}Settings")
    union = get_args(declared)
    if not union:
        return {"default": declared}
    # The type of `source` is a Literal with the variant's name.
    return {get_args(get_type_hints(variant)["source"])[0]: variant for variant in union}


def settings_file(word: str) -> str:
    """Return the path below finloop/ of the file that declares the parameters of a group.

    It is `<word>/settings.py`, or `<word>_settings.py` in any package.
    """
    package = Path(__file__).parents[1]
    path = next(package.glob(f"*/{word}_settings.py"), package / word / "settings.py")
    return path.relative_to(package).as_posix()


def _load_declaration(word: str) -> ModuleType:
    """Return the module that declares the parameters of a group; word: name of the group.

    It is loaded without importing its package, which may take long (torch).
    """
    path = settings_file(word)
    name = "finloop." + path.removesuffix(".py").replace("/", ".")
    if name not in sys.modules:
        spec = spec_from_file_location(name, Path(__file__).parents[1] / path)
        assert spec is not None and spec.loader is not None
        sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def read_conf_values(word: str, option: str, conf: Path = CONF) -> dict[str, Any]:
    """Return the values in conf/<word>/<option>.yaml by name; empty if there is no such file.

    word, option: a group of parameters, and a variant of it. conf: the folder conf/.
    """
    path = conf / word / f"{option}.yaml"
    values = _load_yaml(path) if path.is_file() else {}
    return {key: value for key, value in values.items() if key != "defaults"}


class _Group(NamedTuple):
    """A group of parameters, and the values that were given for it."""

    word: str  # its name
    variants: Mapping[str, type]  # its settings dataclasses by variant
    declared: type  # the one of them that the values are for
    values: Mapping[str, Any]  # by name of the parameter


def check_values(
    word: str, options: Mapping[str, type], values: Any
) -> tuple[Any, list[str]] | tuple[None, list[str]]:
    """Check the values of a group; return its settings and [], or None and a list of problems.

    word: name of the group. options: its settings dataclasses by variant. values: by name. A
    problem is a sentence that begins with the parameter's dotted name.
    """
    if not isinstance(values, Mapping):
        return None, [f"{word}: should be a group of parameters, got {values!r}"]
    values = {key: value for key, value in values.items() if value != "???"}  # not given (Hydra)
    declared, *others = options.values()
    if others:
        name = values.get("source")
        if name not in options:
            return None, [f"{word}.source: should be one of {', '.join(options)}, got {name!r}"]
        declared = options[name]
    group = _Group(word, options, declared, values)
    problems = dict[Any, list[dict[str, Any]]]()  # by parameter
    for problem in _find_problems(group):
        problems.setdefault(problem["loc"][:1], []).append(problem)
    if problems:
        texts = [_describe_problems(group, found) for found in problems.values()]
        return None, list(chain.from_iterable(texts))
    valid = _strict_check(declared).validate_json(json.dumps(values, default=str))
    # The dataclass itself, not pydantic's copy of the class, which cannot be pickled.
    return declared(**{field.name: getattr(valid, field.name) for field in fields(declared)}), []


def _find_problems(group: _Group) -> list[dict[str, Any]]:
    """Return the problems that pydantic finds in the values of a group; [] if they are valid."""
    try:  # as JSON, where strict still lets a list be a tuple and a name an Enum
        _strict_check(group.declared).validate_json(json.dumps(group.values, default=str))
    except ValidationError as error:
        return [dict(problem) for problem in error.errors()]
    return []


@cache
def _strict_check(declared: type) -> TypeAdapter[Any]:
    """Return pydantic's check of a settings dataclass, for unknown names, wrong types and NaN."""
    strict = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
    return TypeAdapter(checked(declared, frozen=True, config=strict))


def _describe_problems(group: _Group, problems: list[dict[str, Any]]) -> list[str]:
    """Return sentences on one parameter's problems, or on the group's, with what to type instead.

    problems: pydantic's reports on one parameter, or on the group as a whole (`loc` is empty).
    """
    from finloop.base.parameter_help import range_text  # which imports this module

    key = str(problems[0]["loc"][0]) if problems[0]["loc"] else ""
    hint = get_type_hints(group.declared, include_extras=True).get(key)
    # A value may have one of several types; keep the problems of the type it comes nearest to.
    depth = max(len(problem["loc"]) for problem in problems)
    deepest = [problem for problem in problems if len(problem["loc"]) == depth]
    # One sentence each on the group, on an unknown name (no hint), and on several parts of a value.
    if hint is None or (len(deepest) > 1 and depth > 2):
        return [_describe_problem(group, problem) for problem in deepest]
    if len(deepest) == 1:
        text = _describe_problem(group, deepest[0])
    else:
        text = f"{group.word}.{key}: should be {range_text(hint)}, got {group.values[key]!r}"
    if key not in group.values:  # missing
        return [text]

    def accepts(value: Any) -> bool:
        """Return whether the parameter allows a value."""
        changed = group._replace(values={**group.values, key: value})
        return all(problem["loc"][:1] != (key,) for problem in _find_problems(changed))

    choices = re.findall(r"[a-z]+", f"{range_text(hint)} {text}")
    return [text + suggest_override(f"{group.word}.{key}", group.values[key], choices, accepts)]


def _describe_problem(group: _Group, problem: dict[str, Any]) -> str:
    """Return a sentence on one problem in a group's values; problem: as pydantic reports it."""
    name = ".".join(map(str, (group.word, *problem["loc"])))
    if problem["type"] == "missing":
        return f"{name}: has no value"
    if problem["type"] == "unexpected_keyword_argument":
        key = str(problem["loc"][0])
        variants_with_key = [
            variant
            for variant, declared in group.variants.items()
            if key in [field.name for field in fields(declared)]
        ]
        if variants_with_key:
            line = f"{group.word}={variants_with_key[0]} {quote_override(name, problem['input'])}"
            names = " and ".join(variants_with_key)
            return f"{name}: unknown; {names} of {group.word} have it; type {line}"
        return f"{name}: unknown; {_suggest_name(group.word, group.declared, key)}"
    message = problem["msg"].removeprefix("Value error, ").removeprefix("Input ")
    got = f", got {problem['input']!r}" if problem["loc"] else ""
    if problem["type"] == "literal_error" and (renamed := RENAMED.get(str(problem["input"]))):
        got += f", which is {renamed} now"
    return f"{name}: {message}{got}"


def _suggest_name(word: str, declared: type, key: str) -> str:
    """Return a phrase with the new name or place of an unknown parameter, or with similar names.

    word: name of the group. declared: its settings dataclass. key: the unknown name.
    """
    names = [field.name for field in fields(declared)]
    key = getattr(declared, "RENAMED", {}).get(key, key)
    if key in names:
        return f"it is {word}.{key} now"
    if " " in key:  # no name, but the reason why there is none
        return key
    for base in declared.__mro__:  # a constant has an annotation in its class, and is no field
        if key in vars(base).get("__annotations__", {}):
            return f"it is a constant now, {base.__name__}.{key}"
    if word in OF_MODES:  # groups that were one once: the parameter may have moved to another
        if key in GONE:
            return GONE[key]
        if new_name := full_names(key, OF_MODES):
            return f"it is {new_name} now"
    if near := get_close_matches(key, names, 1):
        return f"did you mean {word}.{near[0]}?"
    if name_elsewhere := full_names(key, GROUPS):
        return f"did you mean {name_elsewhere}?"
    return f"{word} has {', '.join(names)}"


def full_names(key: str, words: tuple[str, ...]) -> str:
    """Return the dotted names of all parameters called `key`, now or formerly, as "a.key or b.key".

    words: names of the groups to search. "" if there is none.
    """
    found = dict[str, None]()  # a set that keeps its order
    for word in words:
        for declared in variants(word).values():
            name = getattr(declared, "RENAMED", {}).get(key, key)
            if any(name == field.name for field in fields(declared)):
                found[f"{word}.{name}"] = None
    *first, last = found or [""]
    return f"{', '.join(first)} or {last}" if first else last
