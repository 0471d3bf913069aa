"""Parameters of mode `matching`: what is shown, what a way costs, several fish, paths."""

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from pydantic import Field

from finloop.animate.settings import AnimateSettings as CommonSettings
from finloop.base.settings import Count, NotNegative, Positive

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class MatchingSettings:
    """What the planner of `matching` may use, and what it weighs."""

    # Motion that may be shown. film: frames and their mirror images, played on, or joined where
    # they are alike; forecast: film frames in the poses that the forecast predicts.
    uses: Annotated[tuple[Literal["film", "forecast"], ...], Field(min_length=1)]
    # How one picture follows another. inertial: the pose goes on and the difference fades; fade:
    # the pictures are cross-faded; cut: neither.
    join: Literal["inertial", "fade", "cut"]
    # Number of fish, 1-64. Goals are dealt in turn: A to the first, B to the second …
    fish: Annotated[int, Field(ge=1, le=64)]
    overlap: bool  # Whether fish may swim through each other.
    # What fish do in place of goals. zones: they keep together by the zones of stage `calibrate`.
    rule: Literal["none", "zones"]
    # Who swims after whom, in place of goals: pairs [follower, leader]; fish count from 1.
    follow: list[list[int]]
    # Δ. How long a search takes it that another fish stays where its plan ends.
    give_way: NotNegative
    # What a fish without a goal does. film: it goes where the film goes; places: it swims to
    # random points.
    wander: Literal["film", "places"]
    # Quantile, 0-1, of the film's speeds and turn rates that is typical of a lively fish: so fast
    # it is expected to come to its goal, and so fast it turns on the spot where it has no way on.
    typical_speed_quantile: Share
    # Share, 0-1, of the film's highest speed that the typical one is at least, for animals that
    # rest for most of the film.
    typical_speed_least: Share
    stride: Positive  # Δ. Length of the steps of a search; after each a fish may jump.
    commit: Positive  # Δ. How much of a plan is swum before the fish looks again.
    look_ahead: Positive  # Δ. How far a search looks beyond what is swum.
    beam: Count  # How many ways a search follows at once.
    seam_cost: NotNegative  # Δ a natural step of discontinuity between two pictures.
    repeat_cost: NotNegative  # Δ for showing film that was on screen just now.
    repeat_memory: Positive  # Δ after which film that was on screen costs nothing any more.
    # Weight of rarity. A step that the film shows once in n frames costs weight × n ticks.
    rarity_weight: NotNegative
    # Ticks that a tick on the spot costs a fish that lags behind the film's mean speed as far as
    # the film's own fish usually do.
    lag_cost: NotNegative
    # Δ. Spread of the random cost of each choice: ways that cost about the same are all taken.
    choice_noise: Positive
    # Where fish swim in place of goals: a CSV, Parquet or SVG file, or a track of the film, as
    # track:8; null: nowhere; a list: one for each fish, the first ones, or null.
    path: str | list[str | None] | None
    # Unit of x and y in a file that does not say it. tank: shares of the tank's width and height
    # (of an SVG its own), from the upper left; px of the clip; mm, by clip.mm_per_px.
    path_in: Literal["tank", "px", "mm"]
    path_times: bool  # Whether the fish keeps to the times of the file, else to its own pace.
    path_film: bool  # Of a track of the film: whether its own frames may be shown.
    # Most correction, 0-1, as a share of the spread (SD) of the film's turns over Δ, and of its
    # speed.
    path_correction: Share
    path_steer_ahead: Positive  # Δ. How far ahead steering looks.
    path_commit: Positive  # Δ. In place of `commit`, where no other fish is near.
    path_offset_cost: NotNegative  # Ticks a tick, one body length beside the path.
    path_late_cost: NotNegative  # Ticks a tick, one body length from where it should be by now.
    path_heading_cost: NotNegative  # Ticks a tick, at right angles to the heading asked for.
    path_correction_cost: NotNegative  # Ticks a tick, corrected as much as may be.
    # Ticks a tick on the spot, on a path without times, for a fish that lags as far as usual.
    path_lag_cost: NotNegative
    # Body lengths beside the path at which the fish has left it: the report lists where, and
    # predictions are looked at.
    path_left: Positive


@dataclass(frozen=True)
class AllSettings(MatchingSettings, CommonSettings):
    """The groups `animate` and `matching` in one."""


def merge_settings(common: CommonSettings, own: MatchingSettings) -> AllSettings:
    """Return the parameters of both groups in one."""
    both = (common, own)
    return AllSettings(
        **{field.name: getattr(one, field.name) for one in both for field in fields(one)}
    )
