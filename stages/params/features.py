"""Parameters of the stage `features`."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Features:
    """The fields are those of `finloop.features.table.Settings`."""

    delta_s: Positive
    turn_threshold_deg: Positive
    bend_threshold: Positive
    release: Annotated[float, Field(gt=0, le=1)]
    orientations: Annotated[int, Field(ge=4, le=120)]


OPTIONS = {"default": Features}
