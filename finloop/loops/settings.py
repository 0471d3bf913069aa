"""Parameters of `loops`: which pairs of frames the film can jump between (fish paper §4.1-4.2)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class Settings:
    """Which pairs of frames become loops."""

    threshold: NotNegative  # median natural steps: the largest distance along a loop
    least: Positive  # Δ; the least between the ends of a loop within one track
    apart: Positive  # Δ; of loops whose ends are nearer than this to each other, the best stays
    # frames before and after a pair that are compared as well; 0 = none
    dynamics: Annotated[int, Field(ge=0, le=50)]
    # degrees; a loop that travels farther from the fish's heading is dropped (Fig. 13)
    improper_deg: Annotated[float, Field(gt=0, le=180)]
    most_per_end: Count  # the most loops of one frame, the best
