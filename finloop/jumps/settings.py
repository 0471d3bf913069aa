"""Parameters of `jumps`: from which frame to which the film can jump, mirror images too."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from finloop.base.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class JumpsSettings:
    """How many jumps a frame has, how far they lead in time, and what is compared to find them."""

    jumps_per_frame: Count
    min_jump_deltas: Positive
    motion_weight: NotNegative
    appearance_weight: NotNegative
    mirror: Literal["auto", "yes", "no"]

    candidates: ClassVar[int] = 30  # nearest frames that are drawn, more than twice the jumps kept
    nearest: ClassVar[int] = 4
    """Jumps to the nearest frames of all, in a film of more than 20,000 rows: these go on much
    alike. The others lead to a part of the film, where frames lie as far apart as in a short one.
    """
    pose_weight: ClassVar[float] = 1.0  # the unit of the weights, of which only the ratios count
    change: ClassVar[float] = 1.0  # weight of the change of pose; 1 = as the pose itself
    look_px: ClassVar[int] = 32  # side of pictures of light and skin: coarse, nobody sees them
    look_numbers: ClassVar[int] = 8  # their principal components: the first hold the most variance
    sides_most: ClassVar[float] = 1.5
    """The most by which a fish may differ from its mirror image, over what its pictures differ by:
    1 is alike, and some more is noise."""
    handed_most: ClassVar[float] = 0.3
    """The most by which bends and turns may prefer a side, as a share of their size."""
    block: ClassVar[float] = 10.0  # Δ; a fish that circles so long tells its handedness only once

    RENAMED: ClassVar[dict[str, str]] = {
        "neighbours": "jumps_per_frame",
        "least": "min_jump_deltas",
        "pose": "pose_weight",
        "motion": "motion_weight",
        "look": "appearance_weight",
    }
