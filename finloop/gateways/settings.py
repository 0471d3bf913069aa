"""Parameters of `gateways`: where sprites and film meet (fish paper §4.2, Fig. 14)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import NotNegative, Positive


@dataclass(frozen=True)
class Settings:
    """Which frames of the film a sprite leads to, and back.

    Attributes
    ----------
    top_in : frames, 1-100
        Frames that every sprite leads to, in each orientation.
    top_out : sprites, 1-100
        Sprites of each sequence that every frame leads to.
    threshold : median natural steps, > 0
        The largest distance of a gateway.
    apart_s : seconds, >= 0
        Two frames of one track that a sprite leads to are so far apart.
    least_s : seconds, >= 0
        A frame that is led to has so much of its track ahead.
    """

    top_in: Annotated[int, Field(ge=1, le=100)]
    top_out: Annotated[int, Field(ge=1, le=100)]
    threshold: Positive
    apart_s: NotNegative
    least_s: NotNegative
