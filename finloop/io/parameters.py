"""params.yaml: the parameters of a run, checked and converted to dataclasses."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from finloop.base.errors import FinloopError
from finloop.base.settings import GROUPS, check_values, variants
from finloop.base.yaml_limits import refuse_yaml_bomb


def read_parameters(path: Path) -> dict[str, Any]:
    """Return the content of params.yaml, stage → its parameters; FinloopError if unreadable."""
    hint = "a file as `make params` writes it", "run `make params`"
    try:
        text = path.read_text(encoding="utf-8")
        refuse_yaml_bomb(text)
        values = yaml.load(text, yaml.CSafeLoader)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise FinloopError(f"{path} cannot be read: {error}", *hint) from error
    if not isinstance(values, dict):
        raise FinloopError(f"{path} holds no parameters", *hint)
    return values


def build_settings(stage: str, values: Mapping[str, Any]) -> Any:
    """Return the checked settings of one stage as a dataclass, from the values of params.yaml.

    stage: its key in params.yaml, such as "extract". FinloopError lists all parameters that are
    refused, by dotted name.
    """
    # A stage has one dataclass of settings or several variants; the values decide which.
    checked, problems = check_values(stage, variants(stage), values.get(stage, {}))
    if problems:
        raise refusal_error(problems)
    return checked


def refusal_error(problems: list[str]) -> FinloopError:
    """Return the error that lists all refused parameters.

    problems: a sentence about each, which begins with its dotted name, such as clip.start_s.
    """
    count = "a parameter is" if len(problems) == 1 else f"{len(problems)} parameters are"
    groups = dict.fromkeys(re.split(r"[.:]", problem)[0] for problem in problems)
    help_words = " ".join(f"help={stage}" for stage in groups if stage in GROUPS) or "help=clip"
    return FinloopError(
        f"{count} refused:\n    " + "\n    ".join(problems),
        f'names, types and ranges as make params S="{help_words}" prints them',
        "correct what you typed: make params S=\"name=value\", dvc exp run -S 'name=value'; or "
        "correct conf/, and run `make params`",
    )
