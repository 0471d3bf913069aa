"""Parameters of `animate`, common to all modes: where the fish is sent, how it is drawn."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class AnimateSettings:
    """Parameters of every mode: goals and tank, size and duration, and how pictures are joined."""

    goals: list[list[float]]
    goal_unit: Literal["tank", "px"]
    goal_radius_bl: Positive
    tank: Literal["auto", "arena", "filmed"]
    fish_scale: Literal["auto"] | Annotated[float, Field(ge=0.05, le=20)]
    seconds: Positive
    seed: Seed
    trials: Annotated[int, Field(ge=0)]
    trial_goals: Count
    join_time_deltas: Literal["auto"] | Positive
    cross_fade_deltas: NotNegative

    join_frames: ClassVar[int] = 4
    """Ticks that a join takes at least where `join_time_deltas` is auto: a shorter one is seen."""
    join_least: ClassVar[float] = 0.75  # Δ, the shortest join that auto takes: nearly a turn
    join_most: ClassVar[float] = 2.0  # Δ, the longest: a longer join would hide the film's motion
    rest: ClassVar[float] = 0.03
    """Of the film's movement from frame to frame (RMS): where it moves less, the animal rests, and
    neither joins nor forecasts move it."""
    fade_steps: ClassVar[float] = 1.5
    """Natural steps: pictures farther apart (Eq. 5) are not mixed where joins are fades, as they
    would look like two fish."""
    reach_quantile: ClassVar[float] = 0.99
    """Of the frames' reach: wider frames, mostly faults, are not shown."""

    RENAMED: ClassVar[dict[str, str]] = {
        "goals_in": "goal_unit",
        "goal_radius": "goal_radius_bl",
        "size": "fish_scale",
        "join_time": "join_time_deltas",
        "fade": "cross_fade_deltas",
    }
