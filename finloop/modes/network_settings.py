"""Parameters of mode `network`: how sprites swim (fish paper Fig. 18)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.animate.settings import Share
from finloop.base.settings import NotNegative, Positive


@dataclass(frozen=True)
class NetworkSettings:
    """Parameters of mode `network`: what counts as a phase of the film, and how sprites swim."""

    join: Literal["fade", "inertial", "cut"]
    still_tail_ratio: Share
    steady_speed_ratio: NotNegative
    max_heading_error_deg: NotNegative
    near_goal_bl: NotNegative
    max_bend_hold_deltas: Annotated[int, Field(ge=0)]
    brake_speed_ratio: Share
    min_playback_rate: Positive
    max_playback_rate: Positive

    min_speed_quantile: ClassVar[float] = 0.002
    """Of the film's speeds: the fish never swims slower than this quantile, nor faster than
    `max_speed_quantile`. They keep tracking faults out, and little of the film."""
    max_speed_quantile: ClassVar[float] = 0.998  # see min_speed_quantile
    phase_drift_deg: ClassVar[float] = 20.0
    """A phase whose heading drifts farther is left out: it is a turn, as `max_heading_error_deg`
    has it."""
    phase_least: ClassVar[float] = 0.6  # Δ; shorter phases, single beats, belong to the one before
    alike: ClassVar[int] = 8  # similar phases or turns to draw one from: one alone would repeat
    turn_quantile: ClassVar[float] = 0.05
    """Quantile of the film's turns; a smaller error of the heading is left to drift, as hardly any
    fish turns by less."""
    miss: ClassVar[float] = 0.8  # of the goal's radius; a course that passes farther off misses it
    arrived: ClassVar[float] = 0.3
    """Of the goal's radius; so near to the place in the tank nearest to a goal, the fish heads for
    the goal: it is the end of the way round a wall."""
    ease: ClassVar[tuple[float, ...]] = (1.0, 0.5, 0.25, 0.0)
    """Shares of a turn's displacement, tried one after the other until the turn has room: whole,
    half, a quarter, on the spot."""
    turn_floor: ClassVar[float] = 0.01  # of a turn, in each tick at least: it never stands still
    turn_more: ClassVar[float] = 1.5
    """Sprites play a turn if they turned, in the film, by 1/turn_more to 1/turn_less of it: beyond
    that the bend does not look like the turn."""
    turn_less: ClassVar[float] = 0.6  # see turn_more

    RENAMED: ClassVar[dict[str, str]] = {
        "still": "still_tail_ratio",
        "steady": "steady_speed_ratio",
        "speed_low": "min_speed_quantile",
        "speed_high": "max_speed_quantile",
        "turn_least_deg": "max_heading_error_deg",
        "near": "near_goal_bl",
        "hold": "max_bend_hold_deltas",
        "brake": "brake_speed_ratio",
        "pace_low": "min_playback_rate",
        "pace_high": "max_playback_rate",
    }
