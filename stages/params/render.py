"""Parameters of the stage `render`: how an edit list is drawn."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field


@dataclass(frozen=True)
class Render:
    """See conf/render/default.yaml."""

    mode: Literal["nn", "loops", "hybrid"]
    marks: bool
    crf: Annotated[int, Field(ge=0, le=51)]
    webp_width_px: Annotated[int, Field(ge=16, le=16383)]
    webp_seconds: Annotated[float, Field(ge=0)]
    webp_quality: Annotated[int, Field(ge=0, le=100)]


OPTIONS = {"default": Render}
