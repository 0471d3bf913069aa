"""Parameters of mode `matching`: what is shown, what a branch costs, several fish, paths."""

from dataclasses import dataclass, fields
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.animate.settings import Share
from finloop.base.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class MatchingSettings:
    """Parameters of mode `matching`: what may be shown, several fish, the search, and paths."""

    uses: Annotated[tuple[Literal["film", "forecast"], ...], Field(min_length=1)]
    join: Literal["inertial", "fade", "cut"]

    fish: Annotated[int, Field(ge=1, le=64)]
    overlap: bool
    rule: Literal["none", "zones"]
    follow_pairs: list[list[int]]
    wander: Literal["film", "places"]

    expected_speed_quantile: Share
    search_step_deltas: Positive
    replan_interval_deltas: Positive
    look_ahead_deltas: Positive
    beam: Count
    discontinuity_cost: NotNegative
    repeat_cost: NotNegative
    rarity_weight: NotNegative
    rest_cost: NotNegative
    choice_noise: Positive

    path: Annotated[str | list[str | None] | None, "file, track, list of these, or null"]
    path_unit: Literal["tank", "px", "mm"]
    path_keep_times: bool
    path_own_frames: bool
    path_max_correction_ratio: Share
    path_offset_cost: NotNegative
    path_late_cost: NotNegative
    path_max_offset_bl: Positive

    give_way: ClassVar[float] = 3.0
    """Δ for which a search expects another fish to stay where its plan ends: about as long as
    `replan_interval_deltas`, until its next plan."""
    expected_speed_least: ClassVar[float] = 0.1
    """Least expected speed, as a share of the film's highest: where animals rest for most of the
    film, the quantile is about 0."""
    repeat_memory: ClassVar[float] = 300.0
    """Δ after which film that was on screen costs nothing any more: about a minute, as long as an
    animation."""
    path_steer_ahead: ClassVar[float] = 3.0  # Δ that steering looks ahead: about a few turns
    path_commit: ClassVar[float] = 21.0
    """Δ of a plan that a fish swims before the next search, on a path with no other fish near: a
    path does not change, so a long plan holds, and is cheaper."""
    path_heading_cost: ClassVar[float] = 3.0
    """Cost of a heading at right angles to the requested one, ticks a tick: less than of being
    beside the path or late."""
    path_correction_cost: ClassVar[float] = 0.1
    """Cost of the largest steering correction, ticks a tick: of branches as near to the path, the
    one that swims more as filmed is taken."""
    path_rest_cost: ClassVar[float] = 1.0
    """Cost of a tick on the spot, in ticks, on a path without times, for a fish that lags as far as
    usual: the tick itself, which counts nowhere else there."""

    RENAMED: ClassVar[dict[str, str]] = {
        "look_ahead": "look_ahead_deltas",
        "follow": "follow_pairs",
        "stride": "search_step_deltas",
        "commit": "replan_interval_deltas",
        "seam_cost": "discontinuity_cost",
        "path_in": "path_unit",
        "path_times": "path_keep_times",
        "path_film": "path_own_frames",
        "path_correction": "path_max_correction_ratio",
        "path_left": "path_max_offset_bl",
        "typical_speed_quantile": "expected_speed_quantile",
        "lag_cost": "rest_cost",
        "shoaling": "it is the argument school_rule of steer() now",
    }


@dataclass(frozen=True)
class AllSettings(MatchingSettings, CommonSettings):
    """The parameter groups `animate` and `matching` as one object."""


def merge_settings(common: CommonSettings, matching: MatchingSettings) -> AllSettings:
    """Return the parameters of the groups `animate` (common) and `matching` as one object."""
    groups = (common, matching)
    return AllSettings(**{
        field.name: getattr(group, field.name) for group in groups for field in fields(group)
    })  # fmt: skip
