"""Parameters of the stage `loops`: which pairs of frames the film can jump between (§4.1-4.2)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Loops:
    """The fields are those of `finloop.loops.find.Settings`, and the position table's own."""

    threshold: Annotated[float, Field(ge=0)]
    least_s: Positive
    apart_s: Positive
    dynamics: Annotated[int, Field(ge=0, le=50)]
    improper_deg: Annotated[float, Field(gt=0, le=180)]
    most_per_end: Annotated[int, Field(ge=1)]
    horizon_s: Positive


OPTIONS = {"default": Loops}
