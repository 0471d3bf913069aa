"""Parameters of the stage `animate`: where the fish is sent, how it decides, what it weighs."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Whole = Annotated[int, Field(ge=1)]


@dataclass(frozen=True)
class Settings:
    """Where the fish is sent, how it decides, and what it weighs.

    Attributes
    ----------
    goals : x and y of each, in the unit of `goals_in`
        A, B, C …, reached one after the other; afterwards the fish wanders.
    goals_in : tank or px
        tank: shares of its width and height, from the upper left; px: pixels of the clip.
    goal_radius : body lengths, > 0
        A goal is reached when the head or the centre comes so near.
    seconds : seconds, > 0
        Duration of the animation, in every mode.
    seed : >= 0
        For every choice that is left to chance.
    trials : animations, >= 0
        Further animations to random goals, for the measures alone.
    trial_goals : goals, >= 1
        Random goals of each of them.
    fade_s : seconds, >= 0
        Cross-fade at a jump; 0 = a cut.
    fade_steps : natural steps, >= 0
        Pictures farther apart (Eq. 5) are not cross-faded.
    reach_quantile : 0 to 1
        Quantile of the frames' reach; frames that reach farther, mostly faults, are not shown.
    still : share, 0 to 1
        Fig. 18: a tail counts as still below this share of a beating tail's movement.
    steady : per second, >= 0
        A speed that changes by a smaller share of itself is steady.
    phase_drift_deg : degrees, > 0
        A phase whose heading drifts farther is a turn and is left out.
    phase_ticks : ticks, >= 1
        Shorter phases belong to the one before.
    speed_low, speed_high : 0 to 1
        Quantiles of the film's speeds within which a fish swims.
    alike : phases or turns, >= 1
        One is drawn from so many of the film's that are most alike.
    turn_quantile : 0 to 1
        An error of the heading below this quantile of the film's turns is left to the drift.
    turn_least_deg : degrees, >= 0
        A larger error is never left to the drift.
    unbend_deg : degrees, >= 0
        A fish that was stopped in a turn turns on where the error is larger.
    near : body lengths, >= 0
        Nearer to the goal than this, the fish turns if it would pass it.
    miss : share of the goal's radius, >= 0
        A course that passes the goal farther off misses it.
    arrived : share of the goal's radius, >= 0
        So near to the place in the tank nearest to a goal, the fish heads for the goal itself.
    ease : shares, 0 to 1
        Shares of a turn's displacement, tried one after the other until the turn has room.
    hold : Δ, >= 0
        The strongest bend of a turn is held for at most so long.
    brake : share, 0 to 1
        Share of the speed that is left after each tick before a wall.
    pace_low, pace_high : times as fast as filmed, > 0
        Slowest and fastest playing of a tail beat.
    turn_floor : share, > 0
        Each tick of a turn turns at least this share of it.
    turn_more, turn_less : factors, >= 1 and <= 1
        Sprites play a turn if they turned, in the film, by 1/turn_more to 1/turn_less of it.
    stay_s : seconds, > 0
        Figs. 10, 17: a jump comes at least so long after the one before.
    look_ahead_s : seconds, > 0
        Ways through the film are followed so far ahead.
    stride_s : seconds, > 0
        Loop ends nearer to the last decision are passed by.
    beam : ways, >= 1
        So many are followed at once.
    seam_s : seconds, >= 0
        So long a detour equals a seam of one natural step.
    jerk_s : seconds, >= 0
        So long a detour equals a change of speed by one body length/s.
    again_s : seconds, >= 0
        So long a detour equals frames that were on screen just now.
    memory_s : seconds, > 0
        What was on screen so long ago costs nothing any more.
    free_s : seconds, > 0
        Ways whose cost differs by about so much are equally good.
    most_error_deg : degrees, 0 to 180
        Third test of Fig. 19: a way must not end heading farther off the goal.
    spot_deg : degrees per tick, > 0
        A fish without a way turns on the spot at most so fast.
    network_s : seconds, >= 0
        Fig. 19: a fish stays in network mode at least so long, and waits for a gateway as long.
    gain : share, >= 0
        A way of the film must lead to the goal at such a share of a brisk pace.
    """

    goals: list[list[float]]
    goals_in: Literal["tank", "px"]
    goal_radius: Positive
    seconds: Positive
    seed: Annotated[int, Field(ge=0)]
    trials: Annotated[int, Field(ge=0)]
    trial_goals: Whole
    fade_s: NotNegative
    fade_steps: NotNegative
    reach_quantile: Share
    still: Share
    steady: NotNegative
    phase_drift_deg: Positive
    phase_ticks: Whole
    speed_low: Share
    speed_high: Share
    alike: Whole
    turn_quantile: Share
    turn_least_deg: NotNegative
    unbend_deg: NotNegative
    near: NotNegative
    miss: NotNegative
    arrived: NotNegative
    ease: Annotated[tuple[Share, ...], Field(min_length=1)]
    hold: Annotated[int, Field(ge=0)]
    brake: Share
    pace_low: Positive
    pace_high: Positive
    turn_floor: Positive
    turn_more: Annotated[float, Field(ge=1)]
    turn_less: Annotated[float, Field(gt=0, le=1)]
    stay_s: Positive
    look_ahead_s: Positive
    stride_s: Positive
    beam: Whole
    seam_s: NotNegative
    jerk_s: NotNegative
    again_s: NotNegative
    memory_s: Positive
    free_s: Positive
    most_error_deg: Annotated[float, Field(ge=0, le=180)]
    spot_deg: Positive
    network_s: NotNegative
    gain: NotNegative
