"""Parameters of `retarget`: whose motion is taken, and how it is brought into this tank."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.poses import Software
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

    # the program that made the file; auto: the file shows it, and no file is read otherwise
    software: ClassVar[Software | Literal["auto"]] = "auto"
    head: ClassVar[str] = "auto"  # keypoint at the head, found by its name; body_keypoints names it
    tail: ClassVar[str] = "auto"  # keypoint at the tail, found by its name; body_keypoints names it
    # s; shorter gaps are filled, longer ones end a stretch: within about one Δ a spline is right
    gap_s: ClassVar[float] = 0.2
    mirrored: ClassVar[bool] = False  # whether left and right are exchanged; mirror the file
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
    }
