"""Parameters of `render`: how an edit list becomes a film (fish paper Figs. 16, 18)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Crf, NotNegative, Quality


@dataclass(frozen=True)
class Settings:
    """Which edit list is filmed, and how.

    Attributes
    ----------
    mode : nn, loops or hybrid
        The edit list.
    marks : true or false
        Make a second film with goals, way, state and time.
    crf : 0 = best, 51 = worst
        Quality of the films, H.264.
    webp_width_px : pixels, 16-16383
        Width of the animated WebP; with marks if there are.
    webp_seconds : seconds, >= 0
        Its duration; 0 = none.
    webp_quality : 0 = worst, 100 = best
        Its quality.
    """

    mode: Literal["nn", "loops", "hybrid"]
    marks: bool
    crf: Crf
    webp_width_px: Annotated[int, Field(ge=16, le=16383)]
    webp_seconds: NotNegative
    webp_quality: Quality
