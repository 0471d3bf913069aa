"""Parameters of mode `matching`: what is shown, how ways are weighed, several fish, paths."""

from dataclasses import dataclass, fields
from typing import Annotated, Literal

from pydantic import Field

from finloop.animate.settings import Settings as CommonSettings
from finloop.base.settings import Count, NotNegative, Positive

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Settings:
    """What the planner of `matching` may use, and what it weighs."""

    # film: frames and their mirror images, played on and joined where they are alike; forecast:
    # frames in the poses that the forecast predicts
    uses: Annotated[tuple[Literal["film", "forecast"], ...], Field(min_length=1)]
    # how one picture follows another: the pose goes on and the difference dies away, the pictures
    # are cross-faded as they are, or neither
    join: Literal["inertial", "fade", "cut"]
    # fish; goals are dealt: A to the first, B to the second …; whoever has none left wanders
    fish: Annotated[int, Field(ge=1, le=64)]
    overlap: bool  # whether they may swim through each other
    # zones: they swim in company, by the zones of `calibrate`, in place of goals
    rule: Literal["none", "zones"]
    # who swims after whom, in place of goals: pairs [follower, leader], fish numbered from 1
    follow: list[list[int]]
    # Δ after the end of another's plan; for so long a search takes it that this one stays there
    give_way: NotNegative
    # quantile of its speeds and turn rates at which a fish is brisk: so fast it is expected to swim
    # what remains of a way, and so fast it turns at most on the spot where there is no way
    brisk: Share
    brisk_least: Share  # of the film's highest; who rests for most of the film is brisk at this
    # of the time for which the film shows no step from picture to picture as large, on average,
    # that showing one costs
    rare: NotNegative
    # who has no goal goes where the film goes, if it stays in the tank, or to random places
    wander: Literal["film", "places"]
    look_ahead: Positive  # Δ; ways are followed so far beyond what is swum of them
    commit: Positive  # Δ of a way that are swum before others are looked at, if no fish is near
    stride: Positive  # Δ; loop ends nearer to the last decision are passed by
    beam: Count  # ways that are followed at once
    seam: NotNegative  # Δ; so long a detour equals a seam of one natural step ...
    jerk: NotNegative  # ... a change of speed by one body length in a Δ ...
    again: NotNegative  # ... frames that were on screen just now
    # price of a tick on the spot, in ticks, for who wanders and lags behind the film as usual
    tempo: NotNegative
    memory: Positive  # Δ; what was on screen so long ago costs nothing any more
    patience: Positive  # Δ; a fish that has come no nearer to its goal for so long makes a detour
    free: Positive  # Δ; ways whose cost differs by about so much are equally good
    # where a fish swims in place of goals: a CSV, Parquet or SVG file, or a track of the film,
    # `track:8`; null = to goals; a list: the path of each fish, the first ones, or null
    path: str | list[str | None] | None
    # the unit of x and y in a file whose columns do not say it: shares of the tank's width and
    # height (of an SVG its own), from the upper left; px of the clip; or mm, by clip.mm_per_px
    path_in: Literal["tank", "px", "mm"]
    path_times: bool  # whether it is swum at the times that it gives, else at the fish's own pace
    path_film: bool  # of a track of the film: whether its own frames may be shown
    # corrections: of the spread (SD) of the film's turns over Δ, and of the speed, at most
    path_share: Share
    path_reach: Positive  # Δ; steering looks so far ahead
    path_commit: Positive  # in place of `commit`: along a path there is less to choose from
    # What a tick costs, in ticks, as a seam does:
    path_across: NotNegative  # a body length beside the path
    path_late: NotNegative  # a body length from the place that is asked for at that time
    path_heading: NotNegative  # at right angles to the heading that is asked for
    path_effort: NotNegative  # corrected as much as may be
    # on the spot, on a path without times, for who lags by as much as is usual (`Tempo`)
    path_pace: NotNegative
    path_left: Positive  # body lengths beside the path, where the fish has left it


@dataclass(frozen=True)
class AllSettings(Settings, CommonSettings):
    """The groups `animate` and `matching` in one."""


def merge_settings(common: CommonSettings, own: Settings) -> AllSettings:
    """Return the parameters of both groups in one."""
    both = (common, own)
    return AllSettings(
        **{field.name: getattr(one, field.name) for one in both for field in fields(one)}
    )
