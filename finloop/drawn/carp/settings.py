"""Parameters of a film of drawn carp."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Seed

SizePx = Annotated[int, Field(ge=32, le=8192)]


@dataclass(frozen=True)
class CarpFilm:
    """Parameters of a film of drawn carp: its size and length, the fish, the noise."""

    frames: Annotated[int, Field(ge=2)]
    fish: Count
    width_px: SizePx
    height_px: SizePx
    body_length_px: Annotated[float, Field(ge=12)]
    frame_rate_hz: Annotated[float, Field(ge=1, le=1000)]
    noise_grey: NotNegative
    fins_open_ratio: Annotated[float, Field(ge=0, le=1)]
    seed: Seed
    colour: bool

    light_drift: ClassVar[float] = 0.03  # largest change of the light, as a share: that of lamps
    # share of the light that a shadow takes away: less than a fish does, so that it is paler
    shadow: ClassVar[float] = 0.15
    RENAMED: ClassVar = {"noise": "noise_grey", "fins": "fins_open_ratio"}
