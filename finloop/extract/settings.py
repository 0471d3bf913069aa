"""Parameters of `extract`: how fish are found in the tank, and linked (fish paper §2.1-2.2.1)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.poses import Software
from finloop.base.settings import Count, Positive, Share

Ratio = Annotated[float, Field(ge=1)]


@dataclass(frozen=True)
class ExtractSettings:
    """Parameters of `extract`: how fish are found in the tank, and linked into tracks.

    With `tracks_path` another program's tracks say who is where; without, finloop links them.
    """

    background: Literal["auto", "median", "threshold", "mog2"]
    polarity: Literal["auto", "dark", "bright", "both"]
    noise_sigmas: Positive
    outline_contrast_ratio: Share
    fins: Literal["auto", "keep", "drop"]
    min_area_ratio: Share
    max_area_ratio: Ratio
    min_contrast_ratio: Annotated[float, Field(ge=0, lt=1)]
    max_link_distance_bl: Positive
    min_track_frames: Count
    tracks_path: str | None
    tracks_software: Software | Literal["auto"]
    tracks_px_per_unit: Positive
    tracks_head_keypoint: str
    tracks_tail_keypoint: str

    # frames over the clip from which tank, noise and a typical fish are learnt: enough that a fish
    # that moves is not in their median
    samples: ClassVar[int] = 25
    least_contrast: ClassVar[float] = 6.0  # grey levels; the threshold is never below
    # of the tank's light that a shadow takes at most; of fish that are brighter and darker than the
    # tank, what lacks more is dark skin
    shadow: ClassVar[float] = 0.45
    # thin parts that are paler than a silhouette's edge, like the tail of a mouse or a larva: keep,
    # drop, or keep if lengths differ far less from frame to frame with them, which is measured
    thin: ClassVar[Literal["auto", "keep", "drop"]] = "auto"
    least_area_px: ClassVar[float] = 20.0  # px²; smaller patches show no backbone
    # a silhouette's area changes by less than this factor from frame to frame; more is a touch
    step_area_ratio: ClassVar[float] = 1.4
    points: ClassVar[int] = 33  # of the backbone, ends included
    # a point of less confidence counts as not given; points without one are all taken
    tracks_least_confidence: ClassVar[float] = 0.2

    RENAMED: ClassVar[dict[str, str]] = {
        "outline_share": "outline_contrast_ratio",
        "least_area_ratio": "min_area_ratio",
        "most_area_ratio": "max_area_ratio",
        "least_contrast_ratio": "min_contrast_ratio",
        "gate_body_lengths": "max_link_distance_bl",
        "least_frames": "min_track_frames",
        "tracks": "tracks_path",
        "tracks_scale": "tracks_px_per_unit",
        "tracks_head": "tracks_head_keypoint",
        "tracks_tail": "tracks_tail_keypoint",
    }
