"""Parameters of `jumps`: from which frame to which the film can jump, mirror images too."""

from dataclasses import dataclass
from typing import Literal

from finloop.base.settings import Count, NotNegative, Positive, Share


@dataclass(frozen=True)
class Settings:
    """Which frames are neighbours."""

    candidates: Count  # so many of every frame are drawn, the nearest, one a passage of the film
    neighbours: Count  # so many of these are kept, those whose seams are seen least
    # Δ; film shorter than this is not jumped over, and is left after a jump and between candidates
    least: Positive
    # what a difference in each counts, 1 = equally: the pose, ...
    pose: NotNegative
    change: NotNegative  # ... how the pose changes, ...
    motion: NotNegative  # ... speed ahead, aside and of turning, ...
    look: NotNegative  # ... light and skin, drawn in one pose
    look_px: Count  # across the pictures that are compared, and light and skin in ...
    look_numbers: Count  # ... by so many principal components
    # whether a fish is shown mirrored; auto: if its sides look alike, and it uses them alike
    mirror: Literal["auto", "yes", "no"]
    # alike: its mirror image is so many times as far from it as its other pictures, at most ...
    sides_most: Positive
    handed_most: Share  # ... and the mean of its bends and turns is such a part of them, at most
