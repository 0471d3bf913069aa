"""Parameters of `retarget`: whose motion is swum, and how it is brought into this tank."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.poses import Software
from finloop.base.settings import Count, NotNegative, Positive


@dataclass(frozen=True)
class RetargetSettings:
    """Which track is swum, where, and which frames of the film it is drawn from."""

    # null: none; a file of another program as for extract.tracks_path; the folder data/ of another
    # film of finloop; track:8, a track of this film
    tracks: str | None
    software: Software | Literal["auto"]  # that made the file; auto: as the file shows
    animal: str | None  # its name, or the number of a track; null: the one seen longest
    head: str  # the keypoint at the head; auto: nose, snout, head …; none: not given
    tail: str  # the keypoint at the tail; auto: tail_tip, tail …; none: not given
    # keypoints along the body from head to tail; null: all near the line from head to tail
    points: tuple[str, ...] | None
    # where the first of them is: a share of the body of this film's fish, from the head, and ...
    first_share: Annotated[float, Field(ge=0, lt=0.3)]
    last_share: Annotated[float, Field(gt=0.6, le=1)]  # ... the last
    # a point of less confidence counts as not given; points without one are all taken
    least_confidence: Annotated[float, Field(ge=0, lt=1)]
    backwards: bool  # whether an animal may swim tail first for most of its way
    rate_hz: Positive | None  # Hz of the file; null: of the film
    start_s: NotNegative  # s of the file; the track is taken from here on
    end_s: Positive | None  # s of the file; null: to its end
    gap_s: NotNegative  # s; shorter gaps are filled, at longer ones a stretch ends
    smooth_s: NotNegative  # s; standard deviation of what smooths the points in time; 0: as given
    # px of this tank per px of the file; auto: a body length is as long as this film's
    scale: Positive | Literal["auto"]
    mirrored: bool  # whether left is swum as right
    # fit: moved to where the drawn fish stays in the tank; shrink: the way smaller until it does;
    # given: as the file says
    place: Literal["fit", "shrink", "given"]
    own_frames: bool  # whether a track of this film may be drawn in its own frames
    candidates: Count  # so many of the rows nearest to a tick are weighed
    # natural steps; the cost of a jump to another row of the film. A distance of this size between
    # the track and the film, kept up for one Δ, costs the same
    switch: NotNegative
