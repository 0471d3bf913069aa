"""Parameters of `export`: what is handed to other programs, and how fine."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import NotNegative, Quality


@dataclass(frozen=True)
class Settings:
    """Which edit list and which tracks are handed on, and how fine.

    Attributes
    ----------
    mode : nn, loops or hybrid
        The edit list that is exported and filmed.
    webm_crf : 0 = best, 63 = worst
        Quality of the films with alpha, VP9.
    webp_seconds : seconds, >= 0
        Duration of the animated WebP, shorter than the WebM; 0 = none of the animation.
    webp_quality : 0 = worst, 100 = best
        Of its colours; alpha is kept without loss.
    body_points : points, 0-31
        Points of tracks.csv along the backbone, between head and tail.
    tracks_least_s : seconds, >= 0
        Shorter tracks are left out of tracks.csv.
    tracks_most : tracks, 1-1000
        Of the others the longest so many are in it: each has columns of its own.
    """

    mode: Literal["nn", "loops", "hybrid"]
    webm_crf: Annotated[int, Field(ge=0, le=63)]
    webp_seconds: NotNegative
    webp_quality: Quality
    body_points: Annotated[int, Field(ge=0, le=31)]
    tracks_least_s: NotNegative
    tracks_most: Annotated[int, Field(ge=1, le=1000)]
