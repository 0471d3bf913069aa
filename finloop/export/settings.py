"""Parameters of `export`: what is handed to other programs, and how fine."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import NotNegative, Quality
from finloop.edit.modes import Shown


@dataclass(frozen=True)
class ExportSettings:
    """Which edit list and which tracks are handed on, and how fine."""

    mode: Shown  # the edit list that is exported and filmed
    # quality of the films with alpha, VP9: 0 = best, 63 = worst
    webm_crf: Annotated[int, Field(ge=0, le=63)]
    # s, of the animated WebP, shorter than the WebM; 0 = none of the animation
    webp_seconds: NotNegative
    # s, of stimulus.html, a page that plays the animation by itself; 0 = no page
    stimulus_seconds: NotNegative
    webp_quality: Quality  # of the colours: 0 = worst, 100 = best; alpha is kept without loss
    # points of tracks.csv along the backbone, between head and tail
    body_points: Annotated[int, Field(ge=0, le=31)]
    tracks_least_s: NotNegative  # s; shorter tracks are left out of tracks.csv
    # the most animals in it, those seen longest: each has columns of its own
    tracks_most: Annotated[int, Field(ge=1, le=1000)]
    # whether tracks.nc of movement is written as well; needs `make tracks`
    tracks_netcdf: bool
    # whether nwb/<animal>.nwb are written as well; needs `make tracks`
    tracks_nwb: bool
