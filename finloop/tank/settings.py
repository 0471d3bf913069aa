"""Parameters of `tank`: an edit list in three dimensions."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Crf, Positive
from finloop.edit.modes import Shown


@dataclass(frozen=True)
class TankSettings:
    """Which edit list is filmed in three dimensions, from where, and how large."""

    mode: Shown  # the edit list
    # of tank.mp4; tour: all of them, one after the other
    camera: Literal["top", "side", "corner", "follow", "orbit", "tour"]
    seconds: Positive  # s of the edit list, at most
    width_px: Annotated[int, Field(ge=64, le=7680, multiple_of=2)]  # px, even, of the film
    height_px: Annotated[int, Field(ge=64, le=4320, multiple_of=2)]  # px, even, of the film
    depth: Annotated[float, Field(ge=0.5, le=20)]  # body lengths, of the water
    crf: Crf  # quality of the film, H.264
