"""Mode `matching` for benchmarks that plan it anew with other parameters, or without some film."""

from typing import Any

from finloop.animate.plan_settings import Settings, merge_settings
from finloop.animate.planner import Material
from finloop.given_path import given_lines
from finloop.project import Project
from stages.settings import load

MODE = "matching"


def settings_without_path() -> Settings:
    """Return the parameters of the present folder, with no path to swim."""
    return changed(merge_settings(load("animate"), load("matching")), path=None)


def changed(p: Settings, **values: Any) -> Settings:
    """Return the parameters with some other values."""
    return Settings(**{**vars(p), **values})


def material(project: Project, p: Settings) -> Material:
    """Return what the stage `modes-matching` makes its animation of."""
    return Material(
        project.rate_hz, project.arena, project.film_reel, project.outlines, project.map_facts,
        project.steps, project.jumps, project.poses, project.forecast,
        given_lines(p, project.features), project.facts.mm_per_px, project.rule,
        project.background,
    )  # fmt: skip
