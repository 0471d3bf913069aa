"""Parameters of the stage `animate`: where the fish is sent, how it decides, what it weighs."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed

Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Settings:
    """Where the fish is sent, how it decides, and what it weighs."""

    # x and y of A, B, C …, reached one after the other; afterwards the fish wanders; of several
    # fish see `fish`
    goals: list[list[float]]
    # their unit: shares of the tank's width and height, from the upper left; or px of the clip
    goals_in: Literal["tank", "px"]
    # where the fish may be: in the clip's arena, or where animals were filmed; auto: the arena if
    # one was given, else where animals were filmed if they filled a quarter of the picture and
    # the film is long enough to show the tank, or the floor ends there
    tank: Literal["auto", "arena", "filmed"]
    # how many times as large as filmed the fish is drawn; auto: once, but smaller where it could
    # hardly turn between the walls
    size: Literal["auto"] | Annotated[float, Field(ge=0.05, le=20)]
    goal_radius: Positive  # body lengths from a goal at which head or centre have reached it
    seconds: Positive  # s, of the animation, in every mode
    seed: Seed  # for every choice that is left to chance
    # further animations to random goals, for the measures alone
    trials: Annotated[int, Field(ge=0)]
    trial_goals: Count  # random goals of each of them

    # Several fish in one tank.
    # fish; goals are dealt: A to the first, B to the second …; whoever has none left wanders
    fish: Annotated[int, Field(ge=1, le=64)]
    overlap: bool  # whether they may swim through each other
    # zones: they swim in company, by the zones of `calibrate`, in place of goals
    rule: Literal["none", "zones"]
    # who swims after whom, in place of goals: pairs [follower, leader], fish numbered from 1
    follow: list[list[int]]
    # Δ after the end of another's plan; for so long a search takes it that this one stays there
    give_way: NotNegative

    # What is drawn.
    # how a picture follows on another: the pose goes on as it was and the difference dies away, the
    # two pictures are mixed as they are, or neither
    join: Literal["inertial", "fade", "cut"]
    # Δ, after which 5 % of the difference are left; auto: so long as a posture remembers itself
    join_time: Literal["auto"] | Positive
    join_frames: Count  # ticks that a join takes at least where join_time is auto
    join_least: Positive  # Δ, the shortest that is taken then ...
    join_most: Positive  # ... and the longest
    # of the film's movement from frame to frame (RMS); where it moves less, the animal rests, and
    # neither joins nor forecasts move it
    rest: NotNegative
    fade: NotNegative  # Δ, cross-fade of the pictures; 0 = none
    # natural steps; pictures farther apart (Eq. 5) are not mixed where joins are fades
    fade_steps: NotNegative
    reach_quantile: Share  # of the frames' reach; wider frames, mostly faults, are not shown

    # What the film shows of swimming (Fig. 18).
    still: Share  # a tail counts as still below this share of a beating tail's movement
    steady: NotNegative  # a speed that changes by a smaller share of itself in a Δ is steady
    phase_drift_deg: Positive  # a phase whose heading drifts farther is a turn and is left out
    phase_least: NotNegative  # Δ; shorter phases belong to the one before
    speed_low: Share  # quantiles of the film's speeds within which a fish swims: the lower ...
    speed_high: Share  # ... and the upper one
    # quantile of its speeds and turn rates at which a fish is brisk: so fast it is expected to swim
    # what remains of a way, and so fast it turns at most on the spot where there is no way
    brisk: Share
    brisk_least: Share  # of the film's highest; who rests for most of the film is brisk at this

    # of the time for which the film shows no step from picture to picture as large, on average,
    # that showing one costs
    rare: NotNegative

    # Network mode: as is foretold (`finloop.forecast`), or by the paper's sprites and network (Fig.
    # 18), as also where the film shows too little to foretell by
    sprites: Literal["learned", "paper"]
    ahead: Positive  # Δ; ways are looked at so far ahead ...
    # degrees; ... or as long as a brisk fish takes to turn so far, if that is longer, but for
    # `look_ahead` at most
    ahead_turn: Annotated[float, Field(ge=0, le=360)]
    chance: Positive  # Δ; a way that takes so much longer is taken a third as often
    wall: NotNegative  # Δ that a way costs for every Δ that a wall holds it up
    follow_most: Positive  # Δ; a row of the film is followed so long at most
    # Sprites in network mode (Fig. 18).
    alike: Count  # a phase or turn is drawn from so many of the film's that are most alike
    turn_quantile: Share  # of the film's turns; a smaller error of the heading is left to drift
    turn_least_deg: NotNegative  # a larger error is never left to the drift
    unbend_deg: NotNegative  # a fish stopped in a turn turns on where the error is larger
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

    # Loops mode (Figs. 10, 11, 17).
    # who has no goal goes where the film goes, if it stays in the tank, or to random places
    wander: Literal["film", "places"]
    # from frame to frame at the paper's loops, or at a frame's nearest neighbours and mirror images
    jumps: Literal["neighbours", "loops"]
    stay: Positive  # Δ between two jumps, at least
    look_ahead: Positive  # Δ; ways through the film are followed so far ahead
    stride: Positive  # Δ; loop ends nearer to the last decision are passed by
    beam: Count  # ways that are followed at once
    seam: NotNegative  # Δ; so long a detour equals a seam of one natural step ...
    jerk: NotNegative  # ... a change of speed by one body length in a Δ ...
    again: NotNegative  # ... frames that were on screen just now
    # price of a tick on the spot, in ticks, for who wanders and lags behind the film as usual
    tempo: NotNegative
    memory: Positive  # Δ; what was on screen so long ago costs nothing any more
    patience: Positive  # Δ; a fish that has come no nearer to its goal for so long makes a detour
    free: Positive  # Δ; ways whose cost differs by about so much are equally good
    # degrees, third test of Fig. 19: a way must not end heading farther off the goal
    most_error_deg: Annotated[float, Field(ge=0, le=180)]

    # Hybrid mode (Fig. 19).
    # Δ that a fish stays in network mode at least, and waits for a gateway
    network_least: NotNegative
    gain: NotNegative  # a way of the film leads to the goal at such a share of a brisk pace

    # Along a path (`finloop.animate.route`).
    # where a fish swims in place of goals: a CSV, Parquet or SVG file, or a track of the film,
    # `track:8`; null = to goals; a list: the path of each fish, the first ones, or null
    path: str | list[str | None] | None
    # the unit of x and y in a file whose columns do not say it: shares of the tank's width and
    # height (of an SVG its own), from the upper left; px of the clip; or mm, by clip.mm_per_px
    path_in: Literal["tank", "px", "mm"]
    path_times: bool  # whether it is swum at the times that it gives, else at the fish's own pace
    path_film: bool  # of a track of the film: whether its own frames may be shown
    # corrections: of the spread (SD) of the film's turns over Δ, and of the speed, at most
    path_share: Share
    path_reach: Positive  # Δ; steering looks so far ahead
    path_ahead: Positive  # Δ; ways are followed along the path so far beyond what is swum of them
    path_plan: Positive  # Δ of a way that are swum before others are looked at, if no fish is near
    path_stride: Positive  # Δ; jumps nearer to the last one that was looked at are passed by
    path_beam: Count  # ways that are followed at once
    path_again: NotNegative  # in place of `again`: along a path there is less to choose from
    # What a tick costs, in ticks, as a seam does:
    path_across: NotNegative  # a body length beside the path
    path_late: NotNegative  # a body length from the place that is asked for at that time
    path_heading: NotNegative  # at right angles to the heading that is asked for
    path_effort: NotNegative  # corrected as much as may be
    # on the spot, on a path without times, for who lags by as much as is usual (`Tempo`)
    path_pace: NotNegative
    path_left: Positive  # body lengths beside the path, where the fish has left it
