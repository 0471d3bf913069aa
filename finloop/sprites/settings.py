"""Parameters of `sprites`: which frames become sprites, and their atlas (fish paper §3.3)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import NotNegative, Positive, Share


@dataclass(frozen=True)
class SpritesSettings:
    """Which stretches of the film become sprites, and how large an atlas picture may be.

    Of all candidates the one with the smallest sum of faults is taken. Each fault is measured in
    units of what is just acceptable.
    """

    straight_frames: str | None
    slide_frames: str | None
    left_frames: str | None
    right_frames: str | None
    min_head_confidence: Share
    min_neighbour_distance_bl: Positive
    min_tail_swing_bl: Positive
    max_tail_swing_bl: Positive
    min_turn_deg: Positive
    track_change_cost: NotNegative
    page_px: Annotated[int, Field(ge=256, le=16384)]

    # of the track's median length: how far a usable frame's may be from it; 98 % of the zebrafish's
    # frames are within
    length_off: ClassVar[float] = 0.08

    # What counts as a slide, as a tail beat, as a turn.
    slide_least: ClassVar[float] = 2.0  # Δ; shorter slides repeat too soon
    slide_most: ClassVar[float] = 5.0  # Δ; longer slides drift
    beat_least: ClassVar[float] = 0.75  # Δ; shorter tail beats may be flicker
    beat_most: ClassVar[float] = 7.5  # Δ; longer tail beats may be drift
    beat_frames: ClassVar[int] = 5  # frames; fewer show no wave
    # of the tail's variance that the fundamental has in one beat; with less it is several waves
    one_wave: ClassVar[float] = 0.75
    # degrees; a turn that goes back by less in all is made not to: half a sector of 24, as small as
    # the head's own motion and noise
    turn_back_deg: ClassVar[float] = 8.0
    # of the largest bend; a fish that bends less is straight, and a turn starts or ends there
    straight_bend: ClassVar[float] = 0.2
    hold: ClassVar[float] = 0.9  # of the largest bend; a fish that bends more holds its turn
    # of the strongest turn's bend; turns below a share count only if there are none above it
    strong: ClassVar[tuple[float, ...]] = (0.9, 0.75, 0.5, 0.25, 0.0)

    # Faults: a candidate with this value is just acceptable.
    drift_deg: ClassVar[float] = 6.0  # degrees along a straight stretch; less than half a sector
    speed_change: ClassVar[float] = 0.4  # of the mean speed: second half against first
    area_change: ClassVar[float] = 0.1  # of the mean area: a silhouette whose fins open
    size_off: ClassVar[float] = 0.1  # of the film's median length: an animal of another size
    flicker_frames: ClassVar[float] = 10.0  # frames; with 4 one sees the extremes, nothing between
    lopsided: ClassVar[float] = 0.25  # of the tail's range: its mean, off the axis
    tail_motion_bl: ClassVar[float] = 0.05  # body lengths: range of a still tail; about its width
    weaker: ClassVar[float] = 0.1  # of the strongest turn's bend: what a turn lacks of it
    # of the largest bend: the bend at a turn's ends, and bends besides the largest
    extra_bend: ClassVar[float] = 0.25
    jump_deg: ClassVar[float] = 25.0  # degrees between two frames of a turn; more looks like a jump
    blur: ClassVar[float] = 0.25  # of the film's median sharpness: what the pictures lack of it

    # The choice.
    candidates: ClassVar[int] = 120  # of a sequence, compared as pictures: the best without them
    candidates_per_track: ClassVar[int] = 4  # so that one long track leaves room for the others
    picture_px: ClassVar[int] = 64  # px, side of the pictures compared: shape, no details
    cycle_weight: ClassVar[float] = 2.0  # of the tail beat's faults: it is on screen most

    RENAMED: ClassVar[dict[str, str]] = {
        "straight": "straight_frames",
        "slide": "slide_frames",
        "left": "left_frames",
        "right": "right_frames",
        "head_confidence": "min_head_confidence",
        "alone": "min_neighbour_distance_bl",
        "swing_least": "min_tail_swing_bl",
        "swing_most": "max_tail_swing_bl",
        "turn_least_deg": "min_turn_deg",
        "other_track": "track_change_cost",
    }

    def __post_init__(self) -> None:
        if self.min_tail_swing_bl > self.max_tail_swing_bl:
            raise ValueError("min_tail_swing_bl is more than max_tail_swing_bl")
