"""Parameters of the stage `gait`: where limbs come from, and what their gait then drives."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Gait:
    """See conf/gait/default.yaml."""

    limbs: Literal["dog", "regions"]
    regions: str | None
    regions_rate_hz: Positive | None
    dog_frames: Annotated[int, Field(ge=24, le=10_000)]
    dog_rate_hz: Positive
    dog_cycles: Positive
    dog_width_px: Annotated[int, Field(ge=160, le=1920)]
    dog_noise: Annotated[float, Field(ge=0, le=60)]
    seed: Annotated[int, Field(ge=0)]
    points: Annotated[int, Field(ge=64, le=1024)]
    split: Annotated[float, Field(gt=0, lt=0.5)]
    wavelet: str
    coarse: Annotated[int, Field(ge=1, le=64)]
    per_scale: bool
    dog_1: str
    dog_2: str
    fish_1: str
    fish_2: str
    fish_gait: str | None
    frame_rate_hz: Annotated[float, Field(gt=0, le=240)]
    size_px: Annotated[int, Field(ge=16, le=2048)]

    def __post_init__(self) -> None:
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")
        if self.coarse & (self.coarse - 1):
            raise ValueError("coarse is no power of two")
        if self.limbs == "regions" and (self.regions is None or self.regions_rate_hz is None):
            raise ValueError("limbs=regions needs regions, a folder, and regions_rate_hz")


OPTIONS = {"default": Gait}
