"""Read a sweep as conf/experiment/ declares it, and list its runs."""

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
"""Beginning of a measure's name → the stages whose seeds the measure depends on."""


@dataclass(frozen=True)
class Experiment:
    """A sweep, as a file conf/experiment/<name>.yaml declares it."""

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
        """Raise ValueError for an unknown stage or parameter, or values that vary nothing.

        Each parameter needs two or more different values, or an interval, which Optuna alone takes.
        """
        for name in (*self.params, *self.measures):
            stage = name.partition(".")[0]
            if stage not in WORDS:
                raise ValueError(f"{stage} is no stage")
        for name, text in self.params.items():
            stage, _, key = name.partition(".")
            known = [item.name for option in variants(stage).values() for item in fields(option)]
            if key not in known:
                near = get_close_matches(key, known, n=1)
                raise ValueError(
                    f"there is no parameter {name}"
                    + (f"; did you mean {stage}.{near[0]}?" if near else "")
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
        """Return the names of the stages whose numbers are compared, each once."""
        return list(dict.fromkeys(name.partition(".")[0] for name in self.measures))

    def list_seeds(self) -> list[str]:
        """Return the names `<stage>.seed` of all seeds that the measures depend on.

        They come in the order of the stages; a seed that the sweep itself varies is left out.
        """
        seeded: set[str] = set()
        for beginning, stages in SEEDED.items():
            if any(measure.startswith(beginning) for measure in self.measures):
                seeded.update(stages)
        names = [f"{stage}.seed" for stage in WORDS if stage in seeded]
        return [name for name in names if name not in self.params]

    def list_runs(self, name: str, present: Mapping[str, int]) -> dict[str, list[str]]:
        """Return all runs of this sweep: name of the run → overrides `key=value`.

        name: of the sweep. present: seed parameter → its present value, for each of `list_seeds`.
        The last parameter varies fastest and the number of the seed slowest, so that later runs of
        the same values find in the cache what no seed changes. Names end in `-seed0`, `-seed1` … if
        there are several seeds.
        """
        runs = dict[str, list[str]]()
        for seed in range(self.seeds if present else 1):
            for values in product(*map(parse_values, self.params.values())):
                pairs = dict(zip(self.params, values, strict=True))
                runs |= self.build_run(name, pairs, present, seed)
        return runs

    def build_run(
        self, name: str, pairs: Mapping[str, str], present: Mapping[str, int], seed: int
    ) -> dict[str, list[str]]:
        """Return the run for one combination of values: its name → overrides `key=value`.

        name: of the sweep. pairs: parameter → value. present: seed parameter → its present value.
        seed: number of the seed, from 0; it is added to each present value.
        """
        ending = [f"seed{seed}"] if present and self.seeds > 1 else []
        # Git allows few other characters in the name of an experiment.
        parts = [re.sub(r"[^\w.+-]+", "_", part) for part in (name, *pairs.values(), *ending)]
        overrides = [f"{key}={value}" for key, value in pairs.items()]
        if seed:
            overrides += [f"{key}={value + seed}" for key, value in present.items()]
        return {"-".join(parts): overrides}


def _parse_override(values: str) -> Any:
    """Return Hydra's override, parsed from values such as "0.1, 0.2" or "interval(1, 2)"."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    return OverridesParser.create().parse_override(f"swept={values}")


def parse_interval(values: str) -> Any:
    """Return the interval in a text such as "interval(1, 2)"; None for a list of values.

    The interval has the attributes `start`, `end` and `tags`.
    """
    override = _parse_override(values)
    return override.value() if override.is_interval_sweep() else None


def parse_values(values: str) -> Iterator[str]:
    """Yield the values, as texts, in a text such as "0.1, 0.2" or "range(1, 4)"."""
    override = _parse_override(values)
    if override.is_sweep_override():
        yield from override.sweep_string_iterator()
    else:
        yield override.get_value_string()
