"""Parameters of `clip`: which film is read; one class for each kind of source."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Crf, NotNegative, Positive, check_values
from finloop.drawn.carp.settings import CarpFilm

Repair = Literal["auto", "always", "never"]
CIRCLE, RECTANGLE = 3, 4
"""How many numbers an arena of that shape has."""


@dataclass(frozen=True)
class ZebrafishSettings:
    """Eight real zebrafish from above: two clips of a Python package, downloaded once."""

    source: Literal["zebrafish"]  # names this variant
    parts: Literal["A", "B", "AB"]
    mm_per_px: Positive | None

    crf: ClassVar[int] = 0  # of the clip's H.264: so short a film is stored without loss


@dataclass(frozen=True)
class CarpSettings(CarpFilm):
    """Drawn carp from above, with exact ground truth, from a seed."""

    source: Literal["carp"]  # names this variant
    crf: Crf

    mm_per_px: ClassVar[None] = None  # a drawn tank has no size in mm


@dataclass(frozen=True)
class FootageSettings:
    """The user's own footage: films, folders of pictures, or TIFF stacks.

    Pixels are those of the upright picture: x right, y down from the centre of the upper left one.
    """

    source: Literal["file"]  # names this variant
    path: Annotated[str | tuple[str | dict[str, Any], ...], "path or list of paths"]
    start_s: NotNegative
    end_s: Positive | None
    frame_rate_hz: Annotated[float, Field(gt=0, le=1e6)] | None
    colour: Literal["auto", "always", "never"]
    deinterlace: Repair
    drop_repeated_frames: Repair
    correct_light: Repair
    stabilize: Repair
    arena: str | tuple[float, ...] | None
    mm_per_px: Positive | None
    crf: Crf
    RENAMED: ClassVar = {
        "undouble": "drop_repeated_frames",
        "even_light": "correct_light",
        "steady": "stabilize",
        **dict.fromkeys(
            (
                "arena_left_px", "arena_top_px", "arena_width_px", "arena_height_px", "arena_x_px",
                "arena_y_px", "arena_radius_px", "arena_mask",
            ),
            "arena",
        ),
    }  # fmt: skip

    def __post_init__(self) -> None:
        """Raise ValueError for an empty range of time or an invalid arena."""
        problems = []
        if self.end_s is not None and self.end_s <= self.start_s:
            problems.append(f"end_s {self.end_s:g} is not after start_s {self.start_s:g}")
        if isinstance(self.arena, tuple):
            sizes = self.arena[2:]
            if len(self.arena) not in (CIRCLE, RECTANGLE) or min(sizes) <= 0:
                problems.append(
                    "arena should be [x, y, radius] or [left, top, width, height] in px, radius, "
                    f"width and height above 0, got {[*self.arena]}"
                )
        paths = [self.path] if isinstance(self.path, str) else self.path
        if not paths or any(isinstance(path, str) and not path.strip() for path in paths):
            problems.append("path is empty")
        for path in paths:
            if isinstance(path, dict):
                problems += self._settings_of_film(path)[1]
        if problems:
            raise ValueError("; ".join(problems))

    @property
    def film(self) -> Path:
        """Return the path of the film if it is a single one; else raise ValueError."""
        if not isinstance(self.path, str):
            raise ValueError(f"several films: {self.path}")
        return Path(self.path).expanduser()

    def settings_by_path(self) -> list[tuple[str, "FootageSettings"]]:
        """Return the path and the parameters of each film that `path` lists."""
        if isinstance(self.path, str):
            return [(self.path, self)]
        films = []
        for entry in self.path:
            if isinstance(entry, str):
                films.append((entry, replace(self, path=entry)))
            else:
                films.append((entry["path"], self._settings_of_film(entry)[0]))
        return films

    def _settings_of_film(self, values: dict[str, Any]) -> tuple[Any, list[str]]:
        """Return these settings changed by one film's own values, and a list of problems.

        values: the film's path, and parameters that differ. The first result is None if there are
        problems.
        """
        if not isinstance(values.get("path"), str):
            return None, [f"a film of the list needs a path, got {values!r}"]
        return check_values("clip", {"file": FootageSettings}, {**vars(self), **values})


ClipSettings = ZebrafishSettings | CarpSettings | FootageSettings
