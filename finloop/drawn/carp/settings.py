"""Parameters of a film of drawn carp; `clip` has them all, and its own."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Seed

SizePx = Annotated[int, Field(ge=32, le=8192)]


@dataclass(frozen=True)
class CarpFilm:
    """What to film."""

    frames: Annotated[int, Field(ge=2)]  # length of the film
    fish: Count  # how many swim
    width_px: SizePx  # px, of the film
    height_px: SizePx  # px, of the film
    body_length_px: Annotated[float, Field(ge=12)]  # px, of a carp
    frame_rate_hz: Annotated[float, Field(ge=1, le=1000)]  # frames/s, of the film
    noise: NotNegative  # grey levels, standard deviation
    light_drift: Annotated[float, Field(ge=0, lt=1)]  # largest change of the light, as a share
    fins: Annotated[float, Field(ge=0, le=1)]  # share of the time that the pectoral fins are open
    shadow: Annotated[float, Field(ge=0, lt=1)]  # share of the light that the shadow takes away
    seed: Seed  # for motion, floor, skin, noise and light
    colour: bool  # colours, or grey
