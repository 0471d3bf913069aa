"""What params.yaml says beyond conf/: the overrides that compose it again."""

import json
from collections.abc import Mapping
from typing import Any

import yaml

from stages.params import CONF, STAMP


def changed(values: Mapping[str, Any]) -> list[str]:
    """The Hydra overrides, `clip=carp`, `bpn.hidden=30`, with which conf/ composes to `values`.

    None where nothing was overridden. Groups come in the order of `values`, an option before
    the keys that differ from it.
    """
    usual = {
        word: option
        for entry in _yaml("config")["defaults"]
        if isinstance(entry, dict)
        for word, option in entry.items()
    }
    found = []
    for word, group in values.items():
        if word == STAMP:
            continue
        option = group.get("source", usual[word])
        if option != usual[word]:
            found.append(f"{word}={option}")
        held = _yaml(f"{word}/{option}")
        found += [
            f"{word}.{key}={json.dumps(value, separators=(',', ':'))}"
            for key, value in group.items()
            if held[key] != value
        ]
    return found


def _yaml(name: str) -> dict[str, Any]:
    return yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))
