"""The world of every mode: the tank, and what the film teaches of swimming."""

from dataclasses import dataclass

from finloop.animate.arena import Tank
from finloop.animate.motion import MotionStatistics


@dataclass(frozen=True)
class World:
    """The tank, the motion statistics of the film, and sizes.

    At legal places of the tank pictures fit at any heading. touch_px: radius of a goal; head_px:
    distance of the head from the centre.
    """

    tank: Tank
    motion: MotionStatistics
    touch_px: float
    head_px: float
