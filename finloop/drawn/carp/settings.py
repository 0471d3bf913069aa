"""Parameters of a film of drawn carp; `clip` has them all, and its own."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Count, NotNegative, Seed

SizePx = Annotated[int, Field(ge=32, le=8192)]


@dataclass(frozen=True)
class CarpFilm:
    """What to film.

    Attributes
    ----------
    frames : frames, >= 2
        Duration of the film.
    fish : fish, >= 1
        How many swim.
    width_px, height_px : pixels, 32-8192
        Size of the film.
    body_length_px : pixels, >= 12
        Length of a carp.
    frame_rate_hz : frames per second, 1-1000
        Of the film.
    noise : grey levels, >= 0
        Deviation of the grey level.
    light_drift : relative, 0-1
        Largest change of the light.
    fins : share of the time, 0-1
        How long the pectoral fins are open.
    shadow : share of the light, 0-1
        What the shadow takes away.
    seed : >= 0
        For motion, floor, skin, noise and light.
    colour : true or false
        Colours, or grey.
    """

    frames: Annotated[int, Field(ge=2)]
    fish: Count
    width_px: SizePx
    height_px: SizePx
    body_length_px: Annotated[float, Field(ge=12)]
    frame_rate_hz: Annotated[float, Field(ge=1, le=1000)]
    noise: NotNegative
    light_drift: Annotated[float, Field(ge=0, lt=1)]
    fins: Annotated[float, Field(ge=0, le=1)]
    shadow: Annotated[float, Field(ge=0, lt=1)]
    seed: Seed
    colour: bool
