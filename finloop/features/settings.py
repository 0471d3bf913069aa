"""Parameters of `features`: what is measured of each fish (fish paper §2.2-2.3)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class FeaturesSettings:
    """How motion is measured, and when a fish turns.

    A fish turns where the mean of (change of heading in Δ / `turn_threshold_deg`) and (signed bend
    / `bend_threshold`) reaches 1.
    """

    # s, Δ: the time over which displacement and included angle are measured; auto: the paper's 0.2,
    # or half a tail beat, or a quarter of the longest track, whichever is shortest
    delta_s: Literal["auto"] | Positive
    # body lengths/s, of the water past an animal that stays in its place: it is animated as if it
    # swam so fast; auto: by its tail beat, 0 where animals swim about
    current: Literal["auto"] | NotNegative
    # degrees in Δ, the change of heading that makes a turn; auto: 16, or of a fish that turns more
    # slowly what nine of ten frames are below
    turn_threshold_deg: Literal["auto"] | Positive
    # squared body lengths, the signed motion area that makes a turn; auto: 0.04, or in the same way
    bend_threshold: Literal["auto"] | Positive
    # a turn lasts as long as the mean stays above this
    release: Annotated[float, Field(gt=0, le=1)]
    # sectors of heading: frames are compared (Eq. 7), and sprites drawn, in each
    orientations: Annotated[int, Field(ge=4, le=120)]
