"""Parameters of the stage `export`: what is handed to other programs, and how fine."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True)
class Export:
    """See conf/export/default.yaml."""

    mode: Literal["nn", "loops", "hybrid"]
    webm_crf: Annotated[int, Field(ge=0, le=63)]
    webp_seconds: Annotated[float, Field(ge=0)]
    webp_quality: Annotated[int, Field(ge=0, le=100)]
    body_points: Annotated[int, Field(ge=0, le=31)]
    tracks_least_s: Annotated[float, Field(ge=0)]
    tracks_most: Annotated[int, Field(ge=1, le=1000)]


OPTIONS = {"default": Export}
