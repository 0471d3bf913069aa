"""Parameters of `extract`: how fish are told from the tank, and linked (fish paper §2.1-2.2.1)."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.poses import Software
from finloop.base.settings import Count, Positive, Share

Ratio = Annotated[float, Field(ge=1)]


@dataclass(frozen=True)
class ExtractSettings:
    """How fish are told from the tank, and linked into tracks."""

    # the empty tank: the median of spread-out frames; threshold, one even tone, for a fish that
    # stays in its place; mog2, a tank that changes slowly; auto: the median, without the ghost of
    # a fish that moves little, or an even tone
    background: Literal["auto", "median", "threshold", "mog2"]
    polarity: Literal["auto", "dark", "bright", "both"]  # fish against the tank
    noise_sigmas: Positive  # noise levels; what differs from the tank by more is no noise
    least_contrast: Positive  # grey levels; the threshold is never below
    # a silhouette ends where the difference falls to this share of the fish's contrast
    outline_share: Share
    # of the tank's light that a shadow takes at most; of fish that are brighter and darker than the
    # tank, what lacks more is dark skin
    shadow: Share
    # what is paler than a silhouette's edge: keep, drop, or keep if it is fins, no shadow or gloom
    fins: Literal["auto", "keep", "drop"]
    # thin parts that are paler than a silhouette's edge, like the tail of a mouse or a larva: keep,
    # drop, or keep if lengths differ far less from frame to frame with them
    thin: Literal["auto", "keep", "drop"]
    least_area_px: Annotated[float, Field(ge=4)]  # px²; smaller patches are never looked at
    least_area_ratio: Share  # of a typical fish's area; a smaller silhouette is no fish
    # of a typical fish's area; a larger silhouette is several fish that touch
    most_area_ratio: Ratio
    # of a typical fish's; a paler one is a reflection
    least_contrast_ratio: Annotated[float, Field(ge=0, lt=1)]
    # body lengths; a fish farther than this from where it was expected is another
    gate_body_lengths: Positive
    # from frame to frame a silhouette's area changes by less than this factor
    step_area_ratio: Ratio
    # frames over the clip from which tank, noise and a typical fish are learnt
    samples: Annotated[int, Field(ge=3)]
    least_frames: Count  # frames; shorter tracks are dropped
    points: Annotated[int, Field(ge=13)]  # of the backbone
    # own: fish are followed here; file: another program's tracks say who is where
    tracks: Literal["own", "file"]
    # of that file, or of a folder with a file for each animal; of several films a pattern in which
    # {folder} and {name} stand for a film's, such as "{folder}/{name}*.h5"
    tracks_path: str | None
    tracks_software: Software | Literal["auto"]  # that made it; auto: as the file shows
    # px of the film per unit of the file: 2 if a film of half the width was tracked
    tracks_scale: Positive
    # a point of less confidence counts as not given; points without one are all taken
    tracks_least_confidence: Annotated[float, Field(ge=0, lt=1)]
    tracks_head: str  # the keypoint at the head; auto: nose, snout, head …; none: not given
    tracks_tail: str  # the keypoint at the tail; auto: tail_tip, tail …; none: not given

    def __post_init__(self) -> None:
        """Refuse tracks of a file without the file, and a file that nothing reads."""
        if (self.tracks == "file") != bool(self.tracks_path):
            wish = "needs" if self.tracks == "file" else "has no use (tracks=file has) for"
            raise ValueError(f"tracks={self.tracks} {wish} tracks_path")
