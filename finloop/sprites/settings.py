"""Parameters of `sprites`: which frames become sprites, and their atlas (fish paper §3.3)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Share


@dataclass(frozen=True)
class SpritesSettings:
    """Which stretches of the film become sprites, and how large an atlas picture may be.

    Of all candidates the one with the smallest sum of faults is taken. Each fault is measured in
    units of what is just acceptable.
    """

    # "track:first-last" for each sequence, or null = picked automatically
    straight: str | None  # one full tail beat, swum straight: the cycle
    slide: str | None  # gliding with a still tail
    left: str | None  # a turn, from straight through the bend back to straight
    right: str | None  # the same to the other side

    # Frames that may be used.
    head_confidence: Share  # the least
    length_off: Positive  # of the track's median length: the most that a frame's may differ by
    alone: Positive  # body lengths: the least to the nearest mass centre of another fish

    # What counts as a slide, as a tail beat, as a turn.
    slide_least: Positive  # Δ: the shortest slide
    slide_most: Positive  # Δ: the longest slide
    beat_least: Positive  # Δ: the shortest tail beat; shorter ones may be flicker
    beat_most: Positive  # Δ: the longest tail beat; longer ones may be drift
    beat_frames: Annotated[int, Field(ge=3)]  # frames: the fewest of a beat; five show a wave
    swing_least: Positive  # body lengths from side to side: the smallest tail beat
    swing_most: Positive  # body lengths from side to side: the largest tail beat
    one_wave: Share  # of the tail's variance: the least that the fundamental has in one beat
    turn_least_deg: Positive  # degrees: the smallest turn
    turn_back_deg: NotNegative  # degrees; a turn that goes back by less in all is made not to
    straight_bend: Share  # of the largest bend; a fish bent less is straight: a turn starts or ends
    hold: Share  # of the largest bend; a fish bent more holds its turn
    # of the strongest turn's bend: turns below the first share count only if there are none above
    # it, and so on
    strong: Annotated[tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=1)]

    # Faults: a candidate with this value is just acceptable.
    drift_deg: Positive  # degrees: change of heading along a straight stretch
    speed_change: Positive  # of the mean speed: second half against first
    area_change: Positive  # of the mean area: changes of the silhouette, such as fins that open
    size_off: Positive  # of the clip's median length: an animal of another size
    flicker_frames: Positive  # frames of a beat or a turn; fewer flicker
    lopsided: Positive  # of the tail's range: its mean, off the axis
    still: Positive  # body lengths: range of a still tail; about its width
    weaker: Positive  # of the strongest turn's bend: what a turn lacks of it
    bent: Positive  # of the largest bend: bend at a turn's ends, and bends besides the largest
    jump_deg: Positive  # degrees: largest change of heading between two frames of a turn
    soft: Positive  # of the clip's median sharpness: what the pictures lack of it

    # The choice.
    candidates: Count  # of a sequence, compared as pictures: the best by their other faults
    candidates_per_track: Count  # the most of these from one track
    picture_px: Annotated[int, Field(ge=16, le=1024)]  # pixels: side of the pictures compared
    other_track: NotNegative  # faults: the cost of a sequence from another track than the cycle's
    cycle_weight: Positive  # of the straight cycle's faults: it is on screen most

    page_px: Annotated[int, Field(ge=256, le=16384)]  # pixels: largest side of an atlas picture

    def __post_init__(self) -> None:
        """Refuse an empty range."""
        for name in ("slide_{}", "beat_{}", "swing_{}"):
            least, most = name.format("least"), name.format("most")
            if getattr(self, least) > getattr(self, most):
                raise ValueError(f"{least} is more than {most}")
