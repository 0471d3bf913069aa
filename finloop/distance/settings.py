"""Parameters of `distance`: which frames are compared, and how (fish paper §4.1, Eqs. 5-8)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Positive


@dataclass(frozen=True)
class Settings:
    """How pictures of two frames are compared.

    Attributes
    ----------
    pose : body or film
        body: every fish turned to heading 0°; film: as filmed, the paper's way.
    size : pixels, 8-256
        Width and height of a compared picture, 1.5 body lengths.
    area_threshold : motion area, 0-1
        Frames whose motion areas differ by more are not compared (Eq. 8).
    keep : median natural steps, > 0, or null = all
        Pairs that are farther apart are not stored.
    picture_frames : frames, 2-8000
        At most so many frames in the pictures of both maps (Fig. 9).
    """

    pose: Literal["body", "film"]
    size: Annotated[int, Field(ge=8, le=256)]
    area_threshold: Annotated[float, Field(ge=0, le=1)]
    keep: Positive | None
    picture_frames: Annotated[int, Field(ge=2, le=8000)]
