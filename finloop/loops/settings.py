"""Parameters of `loops`: which loops the film has, and how they are played (§4.1-4.2)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class LoopsSettings:
    """Which pairs of frames become loops, and how modes `loops` and `hybrid` play them."""

    threshold: NotNegative  # median natural steps: the largest distance along a loop
    least: Positive  # Δ; the least between the ends of a loop within one track
    apart: Positive  # Δ; of loops whose ends are nearer than this to each other, the best stays
    # frames before and after a pair that are compared as well; 0 = none
    dynamics: Annotated[int, Field(ge=0, le=50)]
    # degrees; what travels farther from the heading is no loop, and no way is taken so (Fig. 13)
    improper_deg: Annotated[float, Field(gt=0, le=180)]
    most_per_end: Count  # the most loops of one frame, the best
    # Playing (Figs. 10b, 11, 13), in modes `loops` and `hybrid`:
    # what is preferred at a loop end where several ways pass the tests: the three cases of Fig. 10b
    policy: Literal["play", "jump", "any"]
    stay: NotNegative  # Δ of film between two jumps, at least
    join: Literal["fade", "inertial", "cut"]  # how one picture follows another in mode `loops`
