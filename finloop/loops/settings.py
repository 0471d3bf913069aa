"""Parameters of `loops`: which pairs of frames the film can jump between (fish paper §4.1-4.2)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class Settings:
    """Which pairs of frames become loops.

    Attributes
    ----------
    threshold : median natural steps, >= 0
        The largest distance along a loop; 1 = as far as from one frame of the film to the next.
    least_s : seconds, > 0
        The ends of a loop within one track are at least so far apart.
    apart_s : seconds, > 0
        Of loops whose ends are nearer to each other than this, the best is kept.
    dynamics : frames, 0-50
        So many frames before and after are compared, too; 0 = none.
    improper_deg : degrees, 0-180
        A loop that travels farther from the fish's heading is dropped (Fig. 13).
    most_per_end : loops, >= 1
        So many loops of a frame are kept, the best.
    horizon_s : seconds, > 0
        The position table holds ends that are at most so far apart.
    """

    threshold: NotNegative
    least_s: Positive
    apart_s: Positive
    dynamics: Annotated[int, Field(ge=0, le=50)]
    improper_deg: Annotated[float, Field(gt=0, le=180)]
    most_per_end: Count
    horizon_s: Positive
