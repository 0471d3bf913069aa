"""Parameters of `features`: what is measured of each fish (fish paper §2.2-2.3)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Positive


@dataclass(frozen=True)
class Settings:
    """How motion is measured, and when a fish turns.

    A fish turns where the mean of (change of heading in Δ / `turn_threshold_deg`) and (signed bend
    / `bend_threshold`) reaches 1.

    Attributes
    ----------
    delta_s : seconds, > 0
        Δ, the time over which displacement and included angle are measured.
    turn_threshold_deg : degrees in Δ, > 0
        The change of heading that makes a turn.
    bend_threshold : squared body lengths, > 0
        The signed motion area that makes a turn.
    release : share of the threshold, 0-1
        A turn lasts as long as the mean stays above.
    orientations : sectors, 4-120
        Sectors of heading: frames are compared (Eq. 7), and sprites drawn, in each.
    """

    delta_s: Positive
    turn_threshold_deg: Positive
    bend_threshold: Positive
    release: Annotated[float, Field(gt=0, le=1)]
    orientations: Annotated[int, Field(ge=4, le=120)]
