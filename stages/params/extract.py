"""Parameters of the stage `extract`: how fish are told from the tank, and linked."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
Ratio = Annotated[float, Field(ge=1)]


@dataclass(frozen=True)
class Extract:
    """The fields are those of `finloop.extract.film.Settings`."""

    background: Literal["median", "threshold", "mog2"]
    polarity: Literal["auto", "dark", "bright", "both"]
    noise_sigmas: Positive
    least_contrast: Positive
    outline_share: Share
    least_area_px: Annotated[float, Field(ge=4)]
    least_area_ratio: Share
    most_area_ratio: Ratio
    least_contrast_ratio: Annotated[float, Field(ge=0, lt=1)]
    gate_body_lengths: Positive
    step_area_ratio: Ratio
    samples: Annotated[int, Field(ge=3)]
    least_frames: Annotated[int, Field(ge=1)]
    points: Annotated[int, Field(ge=13)]


OPTIONS = {"default": Extract}
