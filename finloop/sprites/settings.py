"""Parameters of `sprites`: which frames become sprites, and their atlas (fish paper §3.3)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Positive


@dataclass(frozen=True)
class Settings:
    """Which stretches of the film become sprites, and how large an atlas picture may be."""

    # each a stretch "track:first-last", or null = picked automatically
    straight: str | None  # one full tail beat, swum straight: the cycle
    slide: str | None  # gliding with a still tail
    left: str | None  # a turn, from straight through the bend back to straight
    right: str | None  # a turn to the other side
    slide_least_s: Positive  # s, of a slide that is picked automatically, at least
    slide_most_s: Positive  # s, at most
    page_px: Annotated[int, Field(ge=256, le=16384)]  # an atlas picture is at most so wide and high

    def __post_init__(self) -> None:
        """Refuse an empty range of durations."""
        if self.slide_least_s > self.slide_most_s:
            raise ValueError("slide_least_s is more than slide_most_s")
