"""Parameters of `tank`: an edit list in three dimensions."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Crf, Positive


@dataclass(frozen=True)
class Settings:
    """Which edit list is filmed in three dimensions, from where, and how large.

    Attributes
    ----------
    mode : nn, loops or hybrid
        The edit list.
    camera : top, side, corner, follow, orbit or tour
        Of tank.mp4; tour: all of them, one after the other.
    seconds : seconds, > 0
        Of the edit list, at most.
    width_px, height_px : pixels, even, 64-7680 and 64-4320
        Of the film.
    depth : body lengths, 0.5-20
        Of the water.
    crf : 0 = best, 51 = worst
        Quality of the film, H.264.
    """

    mode: Literal["nn", "loops", "hybrid"]
    camera: Literal["top", "side", "corner", "follow", "orbit", "tour"]
    seconds: Positive
    width_px: Annotated[int, Field(ge=64, le=7680, multiple_of=2)]
    height_px: Annotated[int, Field(ge=64, le=4320, multiple_of=2)]
    depth: Annotated[float, Field(ge=0.5, le=20)]
    crf: Crf
