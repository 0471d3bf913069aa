"""Parameters of `export`: what is handed to other programs, and how fine."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import NotNegative
from finloop.edit.modes import Shown


@dataclass(frozen=True)
class ExportSettings:
    """Parameters of `export`: which edit list and which tracks are exported, and how fine."""

    mode: Shown
    webm_crf: Annotated[int, Field(ge=0, le=63)]
    webp_seconds: NotNegative
    stimulus_seconds: NotNegative
    tracks_body_points: Annotated[int, Field(ge=0, le=31)]
    tracks_min_s: NotNegative
    tracks_netcdf: bool
    tracks_nwb: bool

    webp_quality: ClassVar[int] = 80  # of the colours (100 = best); alpha is kept without loss
    # animals in tracks.csv, those seen longest; each has columns of its own, and wide tables load
    # slowly
    tracks_most: ClassVar[int] = 100
    RENAMED: ClassVar = {"body_points": "tracks_body_points", "tracks_least_s": "tracks_min_s"}
