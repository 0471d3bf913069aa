"""Parameters of the stage `morph`: which drawings, and how one becomes the other."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True)
class Morph:
    """See conf/morph/default.yaml."""

    a: str
    b: str
    hoop: str
    glyph: Annotated[str, Field(min_length=1, max_length=1)]
    method: Literal["linear", "physical", "simple"]
    frames: Annotated[int, Field(ge=2, le=10_000)]
    points: Annotated[int, Field(ge=16, le=4096)]
    level: Annotated[int, Field(ge=0)] | None
    elastic: NotNegative
    damping: NotNegative
    mass: NotNegative
    wavelet: str
    back: bool
    frame_rate_hz: Positive
    size_px: Annotated[int, Field(ge=16, le=2048)]

    def __post_init__(self) -> None:
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")


OPTIONS = {"default": Morph}
