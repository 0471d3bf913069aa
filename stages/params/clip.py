"""Parameters of the stage `clip`: where the film comes from."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Crf = Annotated[int, Field(ge=0, le=51)]  # 0 = lossless, 51 = worst


@dataclass(frozen=True)
class ZebrafishClip:
    """Eight real zebrafish from above; two clips of a Python package, downloaded once."""

    source: Literal["zebrafish"]
    parts: Literal["A", "B", "AB"]  # 501, 508 or all 1009 frames
    crf: Crf


@dataclass(frozen=True)
class CarpClip:
    """Drawn carp with exact ground truth, from a seed; the fields are those of `CarpFilm`."""

    source: Literal["carp"]
    frames: Annotated[int, Field(ge=2)]
    fish: Annotated[int, Field(ge=1)]
    width_px: Annotated[int, Field(ge=32, le=8192)]
    height_px: Annotated[int, Field(ge=32, le=8192)]
    body_length_px: Annotated[float, Field(ge=12)]
    frame_rate_hz: Annotated[float, Field(ge=1, le=1000)]
    noise: NotNegative  # deviation of the grey level
    light_drift: Annotated[float, Field(ge=0, lt=1)]  # of the light, at most, relative
    fins: Annotated[float, Field(ge=0, le=1)]  # part of the time that pectoral fins are open
    shadow: Annotated[float, Field(ge=0, lt=1)]  # part of the light that the shadow takes
    seed: Annotated[int, Field(ge=0)]
    colour: bool
    crf: Crf  # above 0, so that the drawing has gone through a codec as film has


@dataclass(frozen=True)
class FileClip:
    """Own footage: a film, a folder of pictures, or a TIFF stack.

    Distances are pixels of the upright picture, x right, y down from the centre of the upper left
    pixel; times are seconds.
    """

    source: Literal["file"]
    path: str
    start_s: NotNegative
    end_s: Positive | None  # null = to the end
    frame_rate_hz: Annotated[float, Field(gt=0, le=1e6)] | None  # null = the file's own
    colour: Literal["auto", "always", "never"]
    arena: Literal["none", "rectangle", "circle", "mask"]
    arena_left_px: float | None  # rectangle
    arena_top_px: float | None
    arena_width_px: Positive | None
    arena_height_px: Positive | None
    arena_x_px: float | None  # circle: its centre
    arena_y_px: float | None
    arena_radius_px: Positive | None
    arena_mask: str | None  # mask: a picture of the film's size, bright inside
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

OPTIONS: dict[str, type] = {"zebrafish": ZebrafishClip, "carp": CarpClip, "file": FileClip}
