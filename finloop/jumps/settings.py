"""Parameters of `jumps`: from which frame to which the film can jump, mirror images too."""

from dataclasses import dataclass
from typing import Literal

from finloop.base.settings import Count, NotNegative, Positive, Share


@dataclass(frozen=True)
class JumpsSettings:
    """Which frames are neighbours."""

    candidates: Count  # nearest frames of every frame that are drawn, one a passage of the film
    neighbours: Count  # of these, the jumps of a frame: those with the least seams
    # of a film of more than 20,000 rows, the jumps to the nearest frames of all: these go on much
    # alike. The others lead to a part of the film, where frames lie as far apart as in a short one
    nearest: Count
    # Δ; the least film that a jump skips, that follows a jump, and that lies between candidates
    least: Positive
    # weights in the signature, 1 = equal: of the pose, ...
    pose: NotNegative
    change: NotNegative  # ... of its change, ...
    motion: NotNegative  # ... of speed ahead, aside and of turning, ...
    look: NotNegative  # ... of light and skin, drawn in one pose
    look_px: Count  # pixels: side of the pictures of light and skin
    look_numbers: Count  # principal components of these pictures
    # whether a fish is shown mirrored; auto: if its sides look alike, and it uses them alike
    mirror: Literal["auto", "yes", "no"]
    # alike: the distance to its mirror image over that of its pictures is at most this, and ...
    sides_most: Positive
    handed_most: Share  # ... the mean of its bends and turns over their size at most this
    block: Positive  # Δ; what a fish does within so long a time tells its handedness once
