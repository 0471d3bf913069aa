"""Parameters of `render`: how an edit list becomes a film (fish paper Figs. 16, 18)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Crf, NotNegative, Positive, Quality
from finloop.edit.modes import Shown


@dataclass(frozen=True)
class RenderSettings:
    """Which edit list is filmed, and how."""

    mode: Shown  # the edit list
    marks: bool  # a second film, with goals, way, state and time
    crf: Crf  # quality of the films, H.264
    # of a fish on one that it swims over (matching.overlap): share of the light that it takes away
    shadow: Annotated[float, Field(ge=0, le=1)]
    shadow_blur: Positive  # body lengths, how soft that is: the SD by which it is blurred
    # px, of the animated WebP; it has marks if there are
    webp_width_px: Annotated[int, Field(ge=16, le=16383)]
    webp_seconds: NotNegative  # s, its duration; 0 = none
    webp_quality: Quality  # of WebP
    # s, of the film of all modes side by side, the film's own fish first; 0 = none
    beside_seconds: NotNegative
    beside_px: Annotated[int, Field(ge=32, le=1024)]  # width of one of its panels
