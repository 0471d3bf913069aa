"""Parameters of `morph`: which drawings, and how one becomes the other (curve paper §2-4.1)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.errors import FinloopError
from finloop.base.settings import NotNegative
from finloop.morph.force_list import parse_forces


@dataclass(frozen=True)
class MorphSettings:
    """Parameters of `morph`: the drawings, how one becomes the other, and the film of that."""

    first_drawing: str
    last_drawing: str
    pairs: str | None
    method: Literal["linear", "physical", "fold_free"]  # Eq. 4.1 | Fig. 5 | never folds
    frames: Annotated[int, Field(ge=2, le=10_000)]
    contour_points: Annotated[int, Field(ge=16, le=4096), "a power of two, ≥ 16, ≤ 4096"]
    level: Annotated[int, Field(ge=0, le=10)]
    elasticity: NotNegative
    damping: NotNegative
    mass: NotNegative
    stiffness_damping: NotNegative
    forces: tuple[str, ...]
    wavelet: str

    # path of an SVG: one closed contour, bent and let go as in Figs. 6, 7
    hoop: ClassVar[str] = "data/drawings/hoop.svg"
    glyph: ClassVar[str] = "3"  # a character; Fig. 2 shows its outline at every scale
    back: ClassVar[bool] = True  # the film goes there and back, so that it can be played endlessly
    frame_rate_hz: ClassVar[float] = 30.0  # frames/s of the films; what every player plays
    size_px: ClassVar[int] = 512  # px, longer side of the films; the SVG has any size
    RENAMED: ClassVar = {
        "a": "first_drawing",
        "b": "last_drawing",
        "points": "contour_points",
        "linear_level": "level",
        "elastic": "elasticity",
    }

    def __post_init__(self) -> None:
        """Raise ValueError for points that are no power of two, or a wrong or useless force."""
        if self.contour_points & (self.contour_points - 1):
            raise ValueError("contour_points is no power of two")
        if self.contour_points >> self.level < 4:
            raise ValueError("level leaves a contour fewer than 4 control points")
        try:
            parse_forces(self.forces)
        except FinloopError as error:
            raise ValueError(str(error)) from error
        if self.forces and self.method != "physical":
            raise ValueError("forces move bodies with mass and springs: set method=physical")
        if not self.mass and not self.damping:
            raise ValueError("mass and damping are both 0: nothing resists a shift")
