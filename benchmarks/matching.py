"""Mode `matching` for benchmarks that plan with other parameters, or without some of the film."""

from typing import Any

from finloop.modes.animator import prepare_mode_assets
from finloop.modes.matching import MatchingData
from finloop.plan.load_paths import load_path_lines
from finloop.plan.matching_settings import AllSettings, merge_settings
from finloop.project import Project
from stages.settings import load_settings

MODE = "matching"


def settings_without_path() -> AllSettings:
    """Return the parameters of the present folder, without a path."""
    return replace_settings(
        merge_settings(load_settings("animate"), load_settings("matching")), path=None
    )


def replace_settings(p: AllSettings, **values: Any) -> AllSettings:
    """Return a copy of the settings with other values for parameters or constants.

    ValueError if there is no such parameter or constant.
    """
    if unknown := [name for name in values if not hasattr(p, name)]:
        raise ValueError(f"no parameter or constant {', '.join(unknown)}")
    constants = {name: value for name, value in values.items() if name not in vars(p)}
    kind: type[AllSettings] = type("AllSettings", (type(p),), constants) if constants else type(p)
    return kind(**{name: values.get(name, value) for name, value in vars(p).items()})


def matching_data(project: Project, p: AllSettings) -> MatchingData:
    """Return the data from which the stage `modes-matching` makes its animation."""
    film_data = project.film_data(project.film_reel)
    assets = prepare_mode_assets(film_data, p)  # p may have another fish_scale
    return MatchingData(
        assets, project.jumps, project.forecast_sampler,
        load_path_lines(p, project.features), project.facts.mm_per_px, project.school_rule,
    )  # fmt: skip
