"""Parameters of `features`: what is measured of each fish (fish paper §2.2-2.3)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive

HeadRule = Literal["auto", "blunt", "thin", "travel"]
"""How the head is found: by travel and the end that leads in the film, by shape or travel alone."""


@dataclass(frozen=True)
class FeaturesSettings:
    """Parameters of `features`: how motion is measured, and when a fish turns.

    A fish turns where the mean of (change of heading in Δ / `turn_threshold_deg`) and (signed bend
    / `bend_threshold`) reaches 1, until the mean falls to `turn_end_threshold`.
    """

    head: HeadRule
    delta_s: Literal["auto"] | Positive
    water_current_bl_s: Literal["auto"] | NotNegative
    turn_threshold_deg: Literal["auto"] | Positive
    bend_threshold: Literal["auto"] | Positive
    turn_end_threshold: Annotated[float, Field(gt=0, le=1)]
    orientations: Annotated[int, Field(ge=4, le=120)]

    RENAMED: ClassVar[dict[str, str]] = {
        "current": "water_current_bl_s",
        "release": "turn_end_threshold",
    }
