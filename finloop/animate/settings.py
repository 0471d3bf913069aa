"""Parameters of `animate`, common to all modes: where the fish is sent, how it is drawn."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class AnimateSettings:
    """Where the fish is sent, and how pictures are joined, in every mode."""

    # x and y of A, B, C …, reached one after the other; afterwards the fish wanders; of several
    # fish see `fish`
    goals: list[list[float]]
    # their unit: shares of the tank's width and height, from the upper left; or px of the clip
    goals_in: Literal["tank", "px"]
    # where the fish may be: in the clip's arena, or where animals were filmed; auto: the arena if
    # one was given, else where animals were filmed if they filled a quarter of the picture and
    # the film is long enough to show the tank, or the floor ends there
    tank: Literal["auto", "arena", "filmed"]
    # how many times as large as filmed the fish is drawn; auto: once, but smaller where it could
    # hardly turn between the walls
    size: Literal["auto"] | Annotated[float, Field(ge=0.05, le=20)]
    goal_radius: Positive  # body lengths from a goal at which head or centre have reached it
    seconds: Positive  # s, of the animation, in every mode
    seed: Seed  # for every choice that is left to chance
    # further animations to random goals, for the measures alone
    trials: Annotated[int, Field(ge=0)]
    trial_goals: Count  # random goals of each of them
    # Δ, after which 5 % of the difference are left; auto: so long as a posture remembers itself
    join_time: Literal["auto"] | Positive
    join_frames: Count  # ticks that a join takes at least where join_time is auto
    join_least: Positive  # Δ, the shortest that is taken then ...
    join_most: Positive  # ... and the longest
    # of the film's movement from frame to frame (RMS); where it moves less, the animal rests, and
    # neither joins nor forecasts move it
    rest: NotNegative
    fade: NotNegative  # Δ, cross-fade of the pictures; 0 = none
    # natural steps; pictures farther apart (Eq. 5) are not mixed where joins are fades
    fade_steps: NotNegative
    reach_quantile: Share  # of the frames' reach; wider frames, mostly faults, are not shown
