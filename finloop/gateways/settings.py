"""Parameters of `gateways`: where sprites and film meet (fish paper §4.2, Fig. 14)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import Positive


@dataclass(frozen=True)
class GatewaysSettings:
    """Which frames of the film a sprite leads to, and back."""

    frames_per_sprite: Annotated[int, Field(ge=1, le=100)]
    sprites_per_frame: Annotated[int, Field(ge=1, le=100)]
    distance_threshold: Positive

    # Δ, at least between two frames of one track that a sprite leads to: else the best are one
    # moment
    min_deltas_between_frames: ClassVar[float] = 1.0
    # Δ of film, at least, that follow such a frame in its track: as long as the shortest loop
    min_deltas_ahead: ClassVar[float] = 2.5
    RENAMED: ClassVar = {
        "top_in": "frames_per_sprite",
        "top_out": "sprites_per_frame",
        "threshold": "distance_threshold",
        "apart": "min_deltas_between_frames",
        "least": "min_deltas_ahead",
    }
