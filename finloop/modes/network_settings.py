"""Parameters of mode `network`: how sprites swim (fish paper Fig. 18)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive

Share = Annotated[float, Field(ge=0, le=1)]

Join = Literal["fade", "inertial", "cut"]


@dataclass(frozen=True)
class NetworkSettings:
    """How the film's swimming is learnt, and how sprites swim."""

    # how one picture follows another: cross-faded as they are (the paper's), the pose going on and
    # the difference dying away, or neither
    join: Join
    still: Share  # a tail counts as still below this share of a beating tail's movement
    steady: NotNegative  # a speed that changes by a smaller share of itself in a Δ is steady
    phase_drift_deg: Positive  # a phase whose heading drifts farther is a turn and is left out
    phase_least: NotNegative  # Δ; shorter phases belong to the one before
    speed_low: Share  # quantiles of the film's speeds within which a fish swims: the lower ...
    speed_high: Share  # ... and the upper one
    alike: Count  # a phase or turn is drawn from so many of the film's that are most alike
    turn_quantile: Share  # of the film's turns; a smaller error of the heading is left to drift
    turn_least_deg: NotNegative  # a larger error is never left to the drift
    near: NotNegative  # body lengths from the goal, where a fish turns if it would pass it
    miss: NotNegative  # of the goal's radius; a course that passes the goal farther off misses it
    # of the goal's radius; so near to the place in the tank nearest to a goal, head for the goal
    arrived: NotNegative
    # shares of a turn's displacement, tried one after the other until the turn has room
    ease: Annotated[tuple[Share, ...], Field(min_length=1)]
    hold: Annotated[int, Field(ge=0)]  # Δ that the strongest bend of a turn is held for, at most
    brake: Share  # of the speed that is left after each Δ before a wall
    pace_low: Positive  # slowest playing of a tail beat; 1 = as filmed ...
    pace_high: Positive  # ... and the fastest
    turn_floor: Positive  # each tick of a turn turns at least this share of it
    # sprites play a turn if they turned, in the film, by 1/turn_more to 1/turn_less of it
    turn_more: Annotated[float, Field(ge=1)]
    turn_less: Annotated[float, Field(gt=0, le=1)]  # see turn_more
