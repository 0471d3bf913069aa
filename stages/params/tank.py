"""Parameters of the stage `tank`: an edit list in three dimensions."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True)
class Tank:
    """See conf/tank/default.yaml."""

    mode: Literal["nn", "loops", "hybrid"]
    camera: Literal["top", "side", "corner", "follow", "orbit", "tour"]
    seconds: Annotated[float, Field(gt=0)]
    width_px: Annotated[int, Field(ge=64, le=7680, multiple_of=2)]
    height_px: Annotated[int, Field(ge=64, le=4320, multiple_of=2)]
    depth: Annotated[float, Field(ge=0.5, le=20)]
    crf: Annotated[int, Field(ge=0, le=51)]


OPTIONS = {"default": Tank}
