"""Parameters of `retarget`: whose motion is taken, and how it is brought into this tank."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class RetargetSettings:
    """Parameters of `retarget`: which track the fish follows, where, and with which film frames."""

    tracks: str | None
    animal: str | None
    body_keypoints: tuple[str, ...] | None
    keypoint_range: tuple[
        Annotated[float, Field(ge=0, lt=0.3)], Annotated[float, Field(gt=0.6, le=1)]
    ]
    min_confidence: Annotated[float, Field(ge=0, lt=1)]
    allow_backwards: bool
    tracks_rate_hz: Positive | None
    start_s: NotNegative
    end_s: Positive | None
    smooth_s: NotNegative
    scale: Positive | Literal["auto"]
    placement: Literal["fit", "shrink", "given"]
    allow_own_frames: bool

    # s; shorter gaps are filled, longer ones end a stretch: within about one Δ a spline is right
    gap_s: ClassVar[float] = 0.2
    candidates: ClassVar[int] = 40  # nearest rows weighed at a tick; time grows with its square
    # natural steps; cost of a jump. A distance of this size from the track, kept up for one Δ,
    # costs the same; less and rows change often, more and they follow less closely
    switch: ClassVar[float] = 2.0
    RENAMED: ClassVar = {
        "points": "body_keypoints",
        "first_share": "keypoint_range",
        "last_share": "keypoint_range",
        "least_confidence": "min_confidence",
        "backwards": "allow_backwards",
        "rate_hz": "tracks_rate_hz",
        "place": "placement",
        "own_frames": "allow_own_frames",
        "head": "body_keypoints",
        "tail": "body_keypoints",
        "software": "the file shows which program made it",
        "mirrored": "mirror the file of tracks",
    }
