"""Parameters of `distance`: which frames are compared, and how (fish paper §4.1, Eqs. 5-8)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Positive


@dataclass(frozen=True)
class DistanceSettings:
    """How pictures of two frames are compared."""

    # film: as filmed, within one orientation, the paper's way; body: every fish turned to 0°
    pose: Literal["body", "film"]
    # px, width and height of a compared picture, which is 1.5 body lengths
    size: Annotated[int, Field(ge=8, le=256)]
    # frames whose relative motion areas differ by more are not compared (Eq. 8)
    area_threshold: Annotated[float, Field(ge=0, le=1)]
    # median natural steps; pairs farther apart are not stored; null = all are
    keep: Positive | None
    # pictures that are compared: the most; of a longer film they are stretches spread over it. Time
    # and disk grow with their square
    most_pictures: Annotated[int, Field(ge=2)]
    # the most frames in the pictures of both maps (Fig. 9)
    picture_frames: Annotated[int, Field(ge=2, le=8000)]
