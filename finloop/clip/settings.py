"""Parameters of `clip`: where the film comes from; one variant a source."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from finloop.base.settings import Crf, NotNegative, Positive, check
from finloop.drawn.carp.settings import CarpFilm

Mending = Literal["auto", "always", "never"]


@dataclass(frozen=True)
class Zebrafish:
    """Eight real zebrafish from above: two clips of a Python package, downloaded once."""

    source: Literal["zebrafish"]  # names this variant
    parts: Literal["A", "B", "AB"]  # 501, 508 or all 1009 frames
    mm_per_px: Positive | None  # mm, of a pixel, by a ruler in the picture; null = not known
    crf: Crf  # of the normalised clip


@dataclass(frozen=True)
class Carp(CarpFilm):
    """Drawn carp from above, with exact ground truth, from a seed."""

    source: Literal["carp"]  # names this variant
    mm_per_px: Positive | None  # mm, of a pixel, by a ruler in the picture; null = not known
    crf: Crf  # above 0: the drawing goes through a codec, as film does


@dataclass(frozen=True)
class File:
    """Own footage: films, folders of pictures, or TIFF stacks.

    Pixels are those of the upright picture: x right, y down from the centre of the upper left one.
    """

    source: Literal["file"]  # names this variant
    # whatever FFmpeg opens, a folder of pictures, or a TIFF stack; several films: a folder of them,
    # a pattern (/some/where/*.mp4) or a list, where one with values of its own is
    # {path: b.mp4, start_s: 2.0}
    path: str | tuple[str | dict[str, Any], ...]
    start_s: NotNegative  # s; the clip begins there
    end_s: Positive | None  # s; the clip ends there; null = to the end
    # frames/s, null = the file's own; a value keeps every frame and re-reads its time
    frame_rate_hz: Annotated[float, Field(gt=0, le=1e6)] | None
    colour: Literal["auto", "always", "never"]  # whether the clip keeps colours
    # whether faults of the film are mended; auto: where the check finds them
    deinterlace: Mending  # rows of two moments: every other row is filled in from its neighbours
    undouble: Mending  # doubled pictures are left out, and the rest keeps its time
    even_light: Mending  # every frame is brought to the film's median light
    steady: Mending  # every frame is moved back to where the camera usually stands
    arena: Literal["none", "rectangle", "circle", "mask"]  # where animals can be
    arena_left_px: float | None  # px, of the rectangle
    arena_top_px: float | None  # px, of the rectangle
    arena_width_px: Positive | None  # px, of the rectangle
    arena_height_px: Positive | None  # px, of the rectangle
    arena_x_px: float | None  # px, centre of the circle
    arena_y_px: float | None  # px, centre of the circle
    arena_radius_px: Positive | None  # px, of the circle
    arena_mask: str | None  # path of a picture of the film's size, bright inside
    mm_per_px: Positive | None  # mm, of a pixel, by a ruler in the picture; null = not known
    crf: Crf  # of the normalised clip

    def __post_init__(self) -> None:
        """Refuse an empty range of time, and an arena of which too little or too much is given."""
        problems = []
        if self.end_s is not None and self.end_s <= self.start_s:
            problems.append(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        for shape, names in _ARENA_NUMBERS.items():
            for name in names:
                is_set = getattr(self, name) is not None
                if is_set != (self.arena == shape):
                    kind = "needs" if self.arena == shape else f"has no use (arena={shape} has) for"
                    problems.append(f"arena={self.arena} {kind} {name}")
        paths = [self.path] if isinstance(self.path, str) else self.path
        if not paths or any(isinstance(path, str) and not path.strip() for path in paths):
            problems.append("path is empty")
        for path in paths:
            if isinstance(path, dict):
                problems += self._with(path)[1]
        if problems:
            raise ValueError("; ".join(problems))

    @property
    def film(self) -> Path:
        """The path of a single film."""
        if not isinstance(self.path, str):
            raise ValueError(f"several films: {self.path}")
        return Path(self.path).expanduser()

    def each(self) -> list[tuple[str, "File"]]:
        """Every path, with the parameters of its films."""
        if isinstance(self.path, str):
            return [(self.path, self)]
        return [
            (path, replace(self, path=path)) if isinstance(path, str)
            else (path["path"], self._with(path)[0])
            for path in self.path
        ]  # fmt: skip

    def _with(self, values: dict[str, Any]) -> tuple[Any, list[str]]:
        """These parameters with some values of one film, or what is wrong with those."""
        if not isinstance(values.get("path"), str):
            return None, [f"a film of the list needs a path, got {values!r}"]
        return check("clip", {"file": File}, {**vars(self), **values})

    def arena_values(self) -> tuple[Any, ...]:
        """The values that belong to the arena's shape, none of them None."""
        return tuple(getattr(self, name) for name in _ARENA_NUMBERS.get(self.arena, ()))


_ARENA_NUMBERS = {
    "rectangle": ("arena_left_px", "arena_top_px", "arena_width_px", "arena_height_px"),
    "circle": ("arena_x_px", "arena_y_px", "arena_radius_px"),
    "mask": ("arena_mask",),
}

ClipSettings = Zebrafish | Carp | File
