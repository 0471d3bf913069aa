"""Parameters of `morph`: which drawings, and how one becomes the other (curve paper §2-4.1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class MorphSettings:
    """Which drawings, how one becomes the other, and how that is filmed."""

    a: str  # path of an SVG, the first drawing
    b: str  # path of an SVG, the last drawing; contours belong together by their ids
    hoop: str  # path of an SVG: one closed contour, bent and let go (Figs. 6, 7)
    # a character; its outline at every scale (Fig. 2)
    glyph: Annotated[str, Field(min_length=1, max_length=1)]
    method: Literal["linear", "physical", "simple"]  # Eq. 4.1 | Fig. 5 | never folds
    frames: Annotated[int, Field(ge=2, le=10_000)]  # both drawings among them
    points: Annotated[int, Field(ge=16, le=4096)]  # of a contour; a power of two
    # linear: from 1/2^level of the points; null = all scales
    level: Annotated[int, Field(ge=0)] | None
    elastic: NotNegative  # physical: e0, of the stiffness
    damping: NotNegative  # physical: c, of the mass
    mass: NotNegative  # physical: ρ, the density
    # of the linear morph with a level, and of Figs. 2, 3, 6, 7; a name of PyWavelets: orthogonal,
    # smooth enough for a stiffness: db3 or longer, coif1 …, sym4 …
    wavelet: str
    back: bool  # the film goes there and back again
    frame_rate_hz: Positive  # frames/s, of the films
    size_px: Annotated[int, Field(ge=16, le=2048)]  # px, longer side of the films

    def __post_init__(self) -> None:
        """Refuse a number of points that the wavelet transform cannot halve."""
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")
