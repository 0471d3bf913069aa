"""Parameters of `distance`: which frames are compared, and how (fish paper §4.1, Eqs. 5-8)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Positive


@dataclass(frozen=True)
class DistanceSettings:
    """How pictures of two frames are compared."""

    frame_of_reference: Literal["body", "film"]
    picture_size_px: Annotated[int, Field(ge=8, le=256)]
    motion_area_threshold: Annotated[float, Field(ge=0, le=1)]
    max_distance_steps: Positive | None
    max_rows: Annotated[int, Field(ge=2)]

    picture_frames: ClassVar[int] = 1200  # drawn in the maps of Fig. 9, at most: a pixel each
    RENAMED: ClassVar = {
        "pose": "frame_of_reference",
        "size": "picture_size_px",
        "area_threshold": "motion_area_threshold",
        "keep": "max_distance_steps",
        "most_pictures": "max_rows",
        "max_pictures": "max_rows",
    }
