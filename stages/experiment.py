"""A sweep as conf/experiment/ declares it, and its runs."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Annotated

from pydantic import Field

from finloop.base.settings import WORDS

FOLDER = "experiment"  # below conf/; no group of params.yaml
Name = Annotated[str, Field(pattern=r"^[a-z]+\.[a-z0-9_]+$")]


@dataclass(frozen=True)
class Experiment:
    """A sweep, as `hydra.sweeper` in conf/experiment/<name>.yaml declares it."""

    # title, why: text. On the page that compares the runs
    title: str
    why: str
    seen: str  # text; what was seen when it was run, in a sentence, on which film
    # parameter → values in Hydra's notation, "0.1, 0.2" or "range(1, 4)". What varies; every
    # combination is a run
    params: Annotated[dict[Name, Annotated[str, Field(min_length=1)]], Field(min_length=1)]
    # <stage>.<number> of its metrics. What is compared, beside the measures that every comparison
    # has; a run makes these stages, and what they need
    measures: Annotated[list[Name], Field(min_length=1)]

    def __post_init__(self) -> None:
        """Raise ValueError if a parameter or measure belongs to no stage."""
        for word in (name.partition(".")[0] for name in (*self.params, *self.measures)):
            if word not in WORDS:
                raise ValueError(f"{word} is no stage")

    @property
    def stages(self) -> list[str]:
        """Return the stages whose numbers are compared, each once."""
        return list(dict.fromkeys(name.partition(".")[0] for name in self.measures))

    def list_runs(self, name: str) -> dict[str, list[str]]:
        """Return every run of this sweep: name of the run → overrides `key=value`.

        name: of the sweep. The last parameter varies first.
        """
        runs = {}
        for values in product(*map(parse_values, self.params.values())):
            pairs = zip(self.params, values, strict=True)
            runs["-".join((name, *values))] = [f"{key}={value}" for key, value in pairs]
        return runs


def parse_values(values: str) -> Iterator[str]:
    """Yield the values in a text such as "0.1, 0.2" or "range(1, 4)", in Hydra's notation.

    The values are texts.
    """
    from hydra.core.override_parser.overrides_parser import OverridesParser

    override = OverridesParser.create().parse_override(f"swept={values}")
    if override.is_sweep_override():
        yield from override.sweep_string_iterator()
    else:
        yield override.get_value_string()
