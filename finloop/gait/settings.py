"""Parameters of `gait`: motion fitted from film drives a drawn character (curve paper §4.2)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Positive, Seed


@dataclass(frozen=True)
class Settings:
    """Where limbs come from, how their gait is fitted, and what it then drives.

    Attributes
    ----------
    limbs : dog or regions
        dog: the drawn dog, whose truth is known; regions: limbs of one's own film.
    regions : path, or null
        A folder of masks (fore_left/0007.png …) or of traces (0007.svg …).
    regions_rate_hz : frames per second, > 0, or null
        Of the film of the regions.
    dog_frames : frames, 24-10000
        Of the drawn dog's film.
    dog_rate_hz : frames per second, > 0
        Of the drawn dog's film.
    dog_cycles : cycles, > 0
        How often the dog steps in its film.
    dog_width_px : pixels, 160-1920
        Width of the drawn dog's film.
    dog_noise : grey levels, 0-60
        Deviation of the noise in the drawn dog's film.
    seed : >= 0
        For the drawn dog's film.
    points : points, 64-1024, a power of two
        Of a contour (Fig. 14).
    split : phase, 0-0.5
        Of key 2: subcycle A ends there, and C half a cycle later.
    wavelet : a name of PyWavelets
        Of the descriptor.
    coarse : coefficients, 1-64, a power of two
        In the coarsest scale.
    per_scale : true or false
        One gamma a scale in the gaits that are written.
    dog_1, dog_2 : paths of SVG files
        Key poses that the limbs' gait drives.
    fish_1, fish_2 : paths of SVG files
        Key poses of a fish.
    fish_gait : path of a gait, or null
        What drives the fish; null: the outlines' own gait, fitted from the clip.
    frame_rate_hz : frames per second, 0-240
        Of a drawing in motion, about: whole frames make up a cycle.
    size_px : pixels, 16-2048
        Longer side of the films.
    """

    limbs: Literal["dog", "regions"]
    regions: str | None
    regions_rate_hz: Positive | None
    dog_frames: Annotated[int, Field(ge=24, le=10_000)]
    dog_rate_hz: Positive
    dog_cycles: Positive
    dog_width_px: Annotated[int, Field(ge=160, le=1920)]
    dog_noise: Annotated[float, Field(ge=0, le=60)]
    seed: Seed
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
        """Refuse sizes that cannot be halved, and regions without their rate."""
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")
        if self.coarse & (self.coarse - 1):
            raise ValueError("coarse is no power of two")
        if self.limbs == "regions" and (self.regions is None or self.regions_rate_hz is None):
            raise ValueError("limbs=regions needs regions, a folder, and regions_rate_hz")
