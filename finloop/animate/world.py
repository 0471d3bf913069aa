"""What every mode swims in: the tank, and what the film teaches of swimming."""

from dataclasses import dataclass

from finloop.animate.arena import Tank
from finloop.animate.motion import MotionStatistics


@dataclass(frozen=True)
class World:
    """tank: its legal places are those where every picture fits in, whatever its heading.

    touch_px: radius of a goal; head_px: the head is so far before the centre.
    """

    tank: Tank
    motion: MotionStatistics
    touch_px: float
    head_px: float
