"""Parameters of `tank`: an edit list in three dimensions."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Positive
from finloop.edit.modes import Shown


@dataclass(frozen=True)
class TankSettings:
    """Parameters of `tank`: which edit list is filmed in 3-D, from where, and how large."""

    mode: Shown
    camera: Literal["top", "side", "corner", "follow", "orbit", "tour"]
    seconds: Positive
    width_px: Annotated[int, Field(ge=64, le=7680, multiple_of=2)]
    height_px: Annotated[int, Field(ge=64, le=4320, multiple_of=2)]
    water_depth_bl: Annotated[float, Field(ge=0.5, le=20)]

    crf: ClassVar[int] = 23  # quality of the film, H.264; the default of x264
    RENAMED: ClassVar = {"depth": "water_depth_bl"}
