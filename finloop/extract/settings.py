"""Parameters of `extract`: how fish are told from the tank, and linked (fish paper §2.1-2.2.1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.settings import Count, Positive, Share

Ratio = Annotated[float, Field(ge=1)]


@dataclass(frozen=True)
class Settings:
    """How fish are told from the tank, and linked into tracks.

    Attributes
    ----------
    background : median, threshold or mog2
        The empty tank: the median of spread-out frames; one even tone, for a fish that stays in
        its place; or a tank that changes slowly.
    polarity : auto, dark, bright or both
        How fish stand out of the tank.
    noise_sigmas : noise levels, > 0
        What differs from the tank by more is no noise.
    least_contrast : grey levels, > 0
        The threshold is never below.
    outline_share : share of the fish's contrast, 0-1
        A silhouette ends where the difference falls to this.
    least_area_px : square pixels, >= 4
        Smaller patches are never looked at.
    least_area_ratio : of a typical fish's area, 0-1
        A smaller silhouette is no fish.
    most_area_ratio : of a typical fish's area, >= 1
        A larger silhouette is several fish that touch.
    least_contrast_ratio : of a typical fish's contrast, 0-1
        A paler silhouette is a reflection or a shadow.
    gate_body_lengths : body lengths, > 0
        A fish farther than this from where it was expected is another fish.
    step_area_ratio : ratio of areas, >= 1
        From frame to frame a silhouette changes by less.
    samples : frames, >= 3
        Frames over the clip from which tank, noise and a typical fish are learnt.
    least_frames : frames, >= 1
        Shorter tracks are dropped.
    points : points, >= 13
        Points of the backbone.
    """

    background: Literal["median", "threshold", "mog2"]
    polarity: Literal["auto", "dark", "bright", "both"]
    noise_sigmas: Positive
    least_contrast: Positive
    outline_share: Share
    least_area_px: Annotated[float, Field(ge=4)]
    least_area_ratio: Share
    most_area_ratio: Ratio
    least_contrast_ratio: Annotated[float, Field(ge=0, lt=1)]
    gate_body_lengths: Positive
    step_area_ratio: Ratio
    samples: Annotated[int, Field(ge=3)]
    least_frames: Count
    points: Annotated[int, Field(ge=13)]
