"""Parameters of `gait`: motion fitted from film drives a drawn character (curve paper §4.2)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Positive

Sharing = Literal["limb", "scale", "coefficient", "coordinate"]
"""What has a γ of its own: a limb, a scale of it, a wavelet coefficient, or its x and y each."""
Symmetry = Literal["swap", "mirror", "none"]
"""What half a cycle later is like: limbs exchanged, the animal mirrored, or nothing known of it."""


@dataclass(frozen=True)
class GaitSettings:
    """Parameters of `gait`: where limbs come from, how a gait is fitted, what it then drives."""

    regions: str | None
    regions_rate_hz: Positive | None
    regions_cycle_frames: Positive | None
    symmetry: Literal["swap", "none"]
    contour_points: Annotated[int, Field(ge=64, le=1024), "a power of two, ≥ 64, ≤ 1024"]
    gamma: Sharing
    level: Annotated[int, Field(ge=0, le=8)]
    wavelet: str
    walker_drawings: Annotated[tuple[str, ...], Field(min_length=2, max_length=4)]
    swimmer_drawings: tuple[str, str]
    swimmer_gait: str | None

    dog_frames: ClassVar[int] = 72  # length of the drawn dog's film; three steps
    dog_rate_hz: ClassVar[float] = 24.0  # frames/s of that film, as films have
    dog_cycles: ClassVar[float] = 3.0  # how often the dog steps in it: one a second
    dog_width_px: ClassVar[int] = 480  # px, of that film; a leg is wide enough to be traced
    dog_noise: ClassVar[float] = 2.0  # grey levels, SD of the camera noise that is drawn
    seed: ClassVar[int] = 1  # of that noise
    # phase of key 2: subcycle A ends there, C half a cycle later; even quarters, as Figs. 8-10
    split: ClassVar[float] = 0.25
    coarse: ClassVar[int] = 4  # coefficients of the coarsest scale, a power of two: the rough shape
    # frames/s of a drawing in motion, about: whole frames make up a cycle
    frame_rate_hz: ClassVar[float] = 40.0
    size_px: ClassVar[int] = 512  # px, longer side of the films; the SVG has any size
    RENAMED: ClassVar = {
        "limbs": "limbs are those of regions, a folder; without one, the drawn dog's",
        "points": "contour_points",
        "per_scale": "gamma",
        "gamma_per_scale": "gamma",
        "dog_1": "walker_drawings",
        "dog_2": "walker_drawings",
        "fish_1": "swimmer_drawings",
        "fish_2": "swimmer_drawings",
        "fish_gait": "swimmer_gait",
    }

    def __post_init__(self) -> None:
        """Raise ValueError if values contradict each other, or points are no power of two."""
        if self.contour_points & (self.contour_points - 1):
            raise ValueError("contour_points is no power of two")
        if self.contour_points >> self.level < 4:
            raise ValueError("level leaves a contour fewer than 4 control points")
        if self.regions is not None and self.regions_rate_hz is None:
            raise ValueError("regions needs regions_rate_hz, the frame rate of their film")
        if self.regions is None and self.regions_cycle_frames is not None:
            raise ValueError("regions_cycle_frames needs regions, a folder")
        if self.regions is None and self.symmetry == "none":
            raise ValueError("symmetry=none needs regions, a folder: the drawn dog walks")
        poses = 4 if self.symmetry == "none" else 2
        if len(self.walker_drawings) != poses:
            raise ValueError(f"walker_drawings needs {poses} key poses: symmetry={self.symmetry}")
