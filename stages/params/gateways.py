"""Parameters of the stage `gateways`: where sprites and film meet (fish paper §4.2, Fig. 14)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Seconds = Annotated[float, Field(ge=0)]


@dataclass(frozen=True)
class Gateways:
    """The fields are those of `finloop.gateways.find.Settings`."""

    top_in: Annotated[int, Field(ge=1, le=100)]
    top_out: Annotated[int, Field(ge=1, le=100)]
    threshold: Annotated[float, Field(gt=0)]
    apart_s: Seconds
    least_s: Seconds


OPTIONS = {"default": Gateways}
