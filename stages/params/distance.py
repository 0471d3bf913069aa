"""Parameters of the stage `distance`: which frames are compared, and how (fish paper §4.1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True)
class Distance:
    """The fields are those of conf/distance/default.yaml."""

    pose: Literal["body", "film"]
    size: Annotated[int, Field(ge=8, le=256)]
    area_threshold: Annotated[float, Field(ge=0, le=1)]
    keep: Annotated[float, Field(gt=0)] | None
    picture_frames: Annotated[int, Field(ge=2, le=8000)]


OPTIONS = {"default": Distance}
