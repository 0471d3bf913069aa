"""Parameters of `morph`: which drawings, and how one becomes the other (curve paper §2-4.1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import NotNegative, Positive


@dataclass(frozen=True)
class Settings:
    """Which drawings, how one becomes the other, and how that is filmed.

    Attributes
    ----------
    a, b : paths of SVG files
        The drawings; contours belong together by their ids.
    hoop : path of an SVG file
        One closed contour, bent and let go (Figs. 6, 7).
    glyph : one character
        Its outline at every scale (Fig. 2).
    method : linear, physical or simple
        Eq. 4.1; Fig. 5; or without a fold.
    frames : frames, 2-10000
        Both drawings among them.
    points : points, 16-4096, a power of two
        Of a contour.
    level : >= 0, or null = all scales
        linear: from 1/2^level of the points.
    elastic : e0, >= 0
        physical: of the stiffness.
    damping : c, >= 0
        physical: of the mass.
    mass : rho, >= 0
        physical: density.
    wavelet : a name of PyWavelets
        Orthogonal, smooth enough for a stiffness: db3 or longer, coif1 …, sym4 ….
    back : true or false
        The film goes there and back again.
    frame_rate_hz : frames per second, > 0
        Of the films.
    size_px : pixels, 16-2048
        Longer side of the films.
    """

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
        """Refuse a number of points that the wavelet transform cannot halve."""
        if self.points & (self.points - 1):
            raise ValueError("points is no power of two")
