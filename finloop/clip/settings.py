"""Parameters of `clip`: where the film comes from; one variant a source."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from finloop.drawn.carp.settings import CarpFilm
from finloop.settings import Crf, NotNegative, Positive


@dataclass(frozen=True)
class Zebrafish:
    """Eight real zebrafish from above: two clips of a Python package, downloaded once.

    Attributes
    ----------
    source : zebrafish
        Names this variant.
    parts : A, B or AB
        501, 508 or all 1009 frames.
    crf : 0 = lossless, 51 = worst
        Quality of the normalised clip.
    """

    source: Literal["zebrafish"]
    parts: Literal["A", "B", "AB"]
    crf: Crf


@dataclass(frozen=True)
class Carp(CarpFilm):
    """Drawn carp from above, with exact ground truth, from a seed.

    Attributes
    ----------
    source : carp
        Names this variant.
    crf : 0 = lossless, 51 = worst
        Above 0, so that the drawing has gone through a codec as film has.
    """

    source: Literal["carp"]
    crf: Crf


@dataclass(frozen=True)
class File:
    """Own footage: a film, a folder of pictures, or a TIFF stack.

    Pixels are those of the upright picture: x right, y down from the centre of the upper left one.

    Attributes
    ----------
    source : file
        Names this variant.
    path : path
        Whatever FFmpeg opens, a folder of pictures, or a TIFF stack.
    start_s : seconds, >= 0
        The clip begins there.
    end_s : seconds, > start_s, or null = to the end
        The clip ends there.
    frame_rate_hz : frames per second, 0-1e6, or null = the file's own
        A value keeps every frame and re-reads its time.
    colour : auto, always or never
        Whether the clip keeps colours.
    arena : none, rectangle, circle or mask
        Shape of the place where animals can be.
    arena_left_px, arena_top_px, arena_width_px, arena_height_px : pixels, or null
        The rectangle.
    arena_x_px, arena_y_px, arena_radius_px : pixels, or null
        Centre and radius of the circle.
    arena_mask : path of a picture, or null
        The mask: of the film's size, bright inside.
    crf : 0 = lossless, 51 = worst
        Quality of the normalised clip.
    """

    source: Literal["file"]
    path: str
    start_s: NotNegative
    end_s: Positive | None
    frame_rate_hz: Annotated[float, Field(gt=0, le=1e6)] | None
    colour: Literal["auto", "always", "never"]
    arena: Literal["none", "rectangle", "circle", "mask"]
    arena_left_px: float | None
    arena_top_px: float | None
    arena_width_px: Positive | None
    arena_height_px: Positive | None
    arena_x_px: float | None
    arena_y_px: float | None
    arena_radius_px: Positive | None
    arena_mask: str | None
    crf: Crf

    def __post_init__(self) -> None:
        """Refuse an empty range of time, and an arena of which too little or too much is given."""
        problems = []
        if self.end_s is not None and self.end_s <= self.start_s:
            problems.append(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        for shape, names in _ARENA_NUMBERS.items():
            for name in names:
                given = getattr(self, name) is not None
                if given != (self.arena == shape):
                    kind = "needs" if self.arena == shape else f"has no use (arena={shape} has) for"
                    problems.append(f"arena={self.arena} {kind} {name}")
        if not self.path.strip():
            problems.append("path is empty")
        if problems:
            raise ValueError("; ".join(problems))

    def arena_values(self) -> tuple[Any, ...]:
        """The values that belong to the arena's shape, none of them None."""
        return tuple(getattr(self, name) for name in _ARENA_NUMBERS.get(self.arena, ()))


_ARENA_NUMBERS = {
    "rectangle": ("arena_left_px", "arena_top_px", "arena_width_px", "arena_height_px"),
    "circle": ("arena_x_px", "arena_y_px", "arena_radius_px"),
    "mask": ("arena_mask",),
}

Settings = Zebrafish | Carp | File
