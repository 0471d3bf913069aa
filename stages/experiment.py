"""A sweep as conf/experiment/ declares it, and its runs."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from itertools import product
from typing import Annotated, Any, Literal

from pydantic import Field

from finloop.base.settings import WORDS, Count, variants

FOLDER = "experiment"  # below conf/; no group of params.yaml
Name = Annotated[str, Field(pattern=r"^[a-z]+\.[a-z0-9_]+$")]

_NETWORK, _MODES = ("bpn", "animate"), ("network", "hybrid")
SEEDED = {
    "bpn.": ("bpn",),
    "forecast.": ("forecast",),
    "identity.": ("identity",),
    "animate.loops": ("animate",),
    **{f"animate.{mode}": _NETWORK for mode in _MODES},
    "animate.matching": ("forecast", "animate"),
    "realism.": ("realism",),
    "realism.loops": ("animate",),
    **{f"realism.{mode}": _NETWORK for mode in _MODES},
    "realism.matching": ("forecast", "animate"),
}
"""How a measure begins → the stages whose seeds it depends on."""


@dataclass(frozen=True)
class Experiment:
    """A sweep, as `hydra.sweeper` in conf/experiment/<name>.yaml declares it."""

    # title, why: text. On the page that compares the runs
    title: str
    why: str
    seen: str  # text; what was seen when it was run, in a sentence, on which film
    # parameter → values in Hydra's notation: "0.1, 0.2" or "range(1, 4)", for Optuna also
    # "interval(0.01, 2)" or "tag(log, interval(0.01, 2))". What varies; every combination is a run
    params: Annotated[dict[Name, Annotated[str, Field(min_length=1)]], Field(min_length=1)]
    # <stage>.<number> of its metrics. What is compared, beside the measures that every comparison
    # has; a run makes these stages, and what they need
    measures: Annotated[list[Name], Field(min_length=1)]

    # runs of each value, that differ in their seeds; a sweep that nothing random measures has one
    seeds: Count = 3
    # grid or optuna. Every combination of the values, or Optuna's choice of them: its TPE sampler
    # proposes values that may improve `goal`, and drops those that are bad at the first seeds
    sweeper: Literal["grid", "optuna"] = "grid"
    trials: Count = 20  # combinations of values that Optuna tries
    # <stage>.<number>, or "" for the first measure with a good direction. What Optuna improves
    goal: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError if a name is unknown, or a parameter has no two different values."""
        for word in (name.partition(".")[0] for name in (*self.params, *self.measures)):
            if word not in WORDS:
                raise ValueError(f"{word} is no stage")
        for name, text in self.params.items():
            word, _, key = name.partition(".")
            known = [item.name for option in variants(word).values() for item in fields(option)]
            if key not in known:
                near = get_close_matches(key, known, 1)
                raise ValueError(
                    f"there is no parameter {name}"
                    + (f"; did you mean {word}.{near[0]}?" if near else "")
                )
            if parse_interval(text):
                if self.sweeper == "grid":
                    raise ValueError(
                        f"{name} has an interval, {text}; give values, or take sweeper: optuna"
                    )
                continue
            values = list(parse_values(text))
            twice = [value for value, count in Counter(values).items() if count > 1]
            if twice:
                raise ValueError(f"{name} has the value {twice[0]} twice")
            if len(values) < 2:
                raise ValueError(f"{name} has one value, {text}; a sweep compares two or more")

    @property
    def stages(self) -> list[str]:
        """Return the stages whose numbers are compared, each once."""
        return list(dict.fromkeys(name.partition(".")[0] for name in self.measures))

    def list_seeds(self) -> list[str]:
        """Return the seeds on which the measures depend, `<stage>.seed`, but for a swept one."""
        words = {
            word
            for measure in self.measures
            for ending, needed in SEEDED.items()
            for word in needed
            if measure.startswith(ending)
        }
        names = [f"{word}.seed" for word in WORDS if word in words]
        return [name for name in names if name not in self.params]

    def list_runs(self, name: str, present: Mapping[str, int]) -> dict[str, list[str]]:
        """Return every run of this sweep: name of the run → overrides `key=value`.

        name: of the sweep. present: value of each of `list_seeds`, that of the first run; further
        ones count up from it. The last parameter varies first and the seed last, so that runs of
        one value find in the cache what no seed changes. Names end in `-seed0`, `-seed1` … if there
        are several seeds.
        """
        runs = dict[str, list[str]]()
        for seed in range(self.seeds if present else 1):
            for values in product(*map(parse_values, self.params.values())):
                pairs = dict(zip(self.params, values, strict=True))
                runs |= self.list_run(name, pairs, present, seed)
        return runs

    def list_run(
        self, name: str, pairs: Mapping[str, str], present: Mapping[str, int], seed: int
    ) -> dict[str, list[str]]:
        """Return one run of this sweep, as `list_runs` returns all: its name → its overrides.

        pairs: parameter → value. seed: which of the seeds, from 0.
        """
        ending = [f"seed{seed}"] if present and self.seeds > 1 else []
        # Git allows few other letters in the name of an experiment.
        words = [re.sub(r"[^\w.+-]+", "_", word) for word in (name, *pairs.values(), *ending)]
        changes = [f"{key}={value}" for key, value in pairs.items()]
        return {
            "-".join(words): changes
            + [f"{key}={value + seed}" for key, value in present.items() if seed]
        }


def parse_sweep(values: str) -> Any:
    """Return a text such as "0.1, 0.2" or "interval(1, 2)", in Hydra's notation, as an override."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    return OverridesParser.create().parse_override(f"swept={values}")


def parse_interval(values: str) -> Any:
    """Return an interval in Hydra's notation, with `start`, `end` and `tags`; None for values."""
    override = parse_sweep(values)
    return override.value() if override.is_interval_sweep() else None


def parse_values(values: str) -> Iterator[str]:
    """Yield the values in a text such as "0.1, 0.2" or "range(1, 4)", in Hydra's notation.

    The values are texts.
    """
    override = parse_sweep(values)
    if override.is_sweep_override():
        yield from override.sweep_string_iterator()
    else:
        yield override.get_value_string()
