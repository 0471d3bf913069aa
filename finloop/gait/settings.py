"""Parameters of `gait`: motion fitted from film drives a drawn character (curve paper §4.2)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Positive, Seed


@dataclass(frozen=True)
class GaitSettings:
    """Where limbs come from, how their gait is fitted, and what it then drives."""

    # the drawn dog, whose truth is known | limbs of one's own film
    limbs: Literal["dog", "regions"]
    regions: str | None  # a folder of masks (fore_left/0007.png …) or of traces (0007.svg …)
    regions_rate_hz: Positive | None  # frames/s, of the film of the regions
    dog_frames: Annotated[int, Field(ge=24, le=10_000)]  # length of the drawn dog's film
    dog_rate_hz: Positive  # frames/s, of the drawn dog's film
    dog_cycles: Positive  # how often the dog steps in its film
    dog_width_px: Annotated[int, Field(ge=160, le=1920)]  # px, of the drawn dog's film
    # grey levels, standard deviation in the drawn dog's film
    dog_noise: Annotated[float, Field(ge=0, le=60)]
    seed: Seed  # for the drawn dog's film
    points: Annotated[int, Field(ge=64, le=1024)]  # of a contour (Fig. 14); a power of two
    # phase of key 2: subcycle A ends there, and C half a cycle later
    split: Annotated[float, Field(gt=0, lt=0.5)]
    wavelet: str  # of the descriptor, a name of PyWavelets
    coarse: Annotated[int, Field(ge=1, le=64)]  # coefficients in the coarsest scale; a power of two
    per_scale: bool  # one γ a scale in the gaits that are written
    dog_1: str  # path of an SVG: a key pose that the limbs' gait drives
    dog_2: str  # path of an SVG: the other one
    fish_1: str  # path of an SVG: a key pose of a fish
    fish_2: str  # path of an SVG: the other one
    # path of what drives the fish; null = the outlines' own gait, fitted from the clip
    fish_gait: str | None
    # frames/s of a drawing in motion, about: whole frames make up a cycle
    frame_rate_hz: Annotated[float, Field(gt=0, le=240)]
    size_px: Annotated[int, Field(ge=16, le=2048)]  # px, longer side of the films

    def __post_init__(self) -> None:
        """Refuse sizes that cannot be halved, and regions without their rate."""
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")
        if self.coarse & (self.coarse - 1):
            raise ValueError("coarse is no power of two")
        if self.limbs == "regions" and (self.regions is None or self.regions_rate_hz is None):
            raise ValueError("limbs=regions needs regions, a folder, and regions_rate_hz")
