"""Sweeps that people do: conf/experiment/<name>.yaml, and the runs that one of them asks for."""

import json
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any

import yaml
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from finloop.errors import FinloopError
from finloop.settings import WORDS
from stages.settings import CONF

FOLDER = "experiment"  # below conf/; no group of params.yaml
Name = Annotated[str, Field(pattern=r"^[a-z]+\.[a-z0-9_]+$")]


@dataclass(frozen=True)
class Experiment:
    """See conf/experiment/learning_rate.yaml."""

    title: str
    why: str
    sweep: Annotated[dict[Name, Annotated[list[Any], Field(min_length=1)]], Field(min_length=1)]
    until: str  # the last stage to run
    measures: list[Name]  # <stage>.<number> of its metrics, beside those that every sweep has

    def __post_init__(self) -> None:
        for name in (self.until, *(one.partition(".")[0] for one in (*self.sweep, *self.measures))):
            if name not in WORDS:
                raise ValueError(f"{name} is no stage")

    def runs(self, name: str) -> dict[str, list[str]]:
        """Every combination: the name of its run and its overrides, the last key varying first."""
        found = {}
        for values in product(*self.sweep.values()):
            told = "-".join(str(value) for value in values)
            found[f"{name}-{told}"] = [
                f"{key}={value}" for key, value in zip(self.sweep, values, strict=True)
            ]
        return found


def experiment(name: str) -> Experiment:
    """One of conf/experiment/; FinloopError that lists them, or says what is wrong in it."""
    path = CONF / FOLDER / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(one.stem for one in path.parent.glob("*.yaml")))
        raise FinloopError(f"there is no {path}", f"one of {known}", "make sweep experiment=…")
    strict = ConfigDict(extra="forbid", strict=True)
    kind: TypeAdapter[Any] = TypeAdapter(checked(Experiment, frozen=True, config=strict))
    try:  # as JSON: see finloop.settings.check
        return kind.validate_json(json.dumps(yaml.safe_load(path.read_text(encoding="utf-8"))))
    except (ValidationError, yaml.YAMLError) as error:
        said = str(error)
        if isinstance(error, ValidationError):
            said = "; ".join(
                ".".join(map(str, one["loc"])) + f": {one['msg']}" for one in error.errors()
            )
        raise FinloopError(
            f"{path} is no experiment: {said}",
            "title, why, sweep, until and measures, with stages that there are",
            f"correct {path}",
        ) from error
