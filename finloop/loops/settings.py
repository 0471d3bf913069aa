"""Parameters of `loops`: which loops the film has, and how they are played (§4.1-4.2)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class LoopsSettings:
    """Which pairs of frames become loops, and how modes `loops` and `hybrid` play them."""

    distance_threshold: NotNegative
    min_length_deltas: Positive
    compared_neighbour_frames: Annotated[int, Field(ge=0, le=50)]
    improper_angle_deg: Annotated[float, Field(gt=0, le=180)]
    loop_end_choice: Literal["play", "jump", "any"]
    min_deltas_between_jumps: NotNegative
    join: Literal["fade", "inertial", "cut"]

    # Δ; of loops whose ends are nearer, the best stays: one moment
    min_deltas_between_ends: ClassVar[float] = 0.5
    max_loops_per_end: ClassVar[int] = 6  # loops of one frame, the best: bounds the table
    RENAMED: ClassVar = {
        "threshold": "distance_threshold",
        "least": "min_length_deltas",
        "dynamics": "compared_neighbour_frames",
        "improper_deg": "improper_angle_deg",
        "policy": "loop_end_choice",
        "stay": "min_deltas_between_jumps",
        "apart": "min_deltas_between_ends",
        "most_per_end": "max_loops_per_end",
    }
