"""Parameters of `gateways`: where sprites and film meet (fish paper §4.2, Fig. 14)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class GatewaysSettings:
    """Which frames of the film a sprite leads to, and back."""

    # frames that every sprite leads to, in each orientation
    top_in: Annotated[int, Field(ge=1, le=100)]
    # sprites of each sequence that every frame leads to
    top_out: Annotated[int, Field(ge=1, le=100)]
    threshold: Positive  # median natural steps, the largest distance of a gateway
    apart: NotNegative  # Δ; the least between two frames of one track that a sprite leads to
    least: NotNegative  # Δ; the least film of its track ahead of a frame that a sprite leads to
