"""Parameters of the stage `report`: how large the page may be."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Report:
    """See conf/report/default.yaml."""

    film_most_mb: Positive
    picture_width_px: Annotated[int, Field(ge=200, le=4000)]
    picture_quality: Annotated[int, Field(ge=0, le=100)]
    most_mb: Positive


OPTIONS = {"default": Report}
