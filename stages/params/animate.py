"""Parameters of the stage `animate`: where the fish is sent, and how it decides."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Animate:
    """See conf/animate/default.yaml."""

    goals: list[list[float]]
    goals_in: Literal["tank", "px"]
    goal_radius: Positive
    seconds: Positive
    seed: Annotated[int, Field(ge=0)]
    stay_s: Positive
    fade_s: Annotated[float, Field(ge=0)]
    trials: Annotated[int, Field(ge=0)]


OPTIONS = {"default": Animate}
