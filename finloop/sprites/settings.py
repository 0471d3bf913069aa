"""Parameters of `sprites`: which frames become sprites, and their atlas (fish paper §3.3)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Positive


@dataclass(frozen=True)
class Settings:
    """Which stretches of the film become sprites, and how large an atlas picture may be.

    Attributes
    ----------
    straight : "track:first-last", or null = picked automatically
        One full tail beat, swum straight: the cycle.
    slide : "track:first-last", or null = picked automatically
        Gliding with a still tail.
    left, right : "track:first-last", or null = picked automatically
        A turn, from straight through the bend back to straight.
    slide_least_s, slide_most_s : seconds, > 0
        A slide that is picked automatically is so long.
    page_px : pixels, 256-16384
        An atlas picture is at most so wide and high.
    """

    straight: str | None
    slide: str | None
    left: str | None
    right: str | None
    slide_least_s: Positive
    slide_most_s: Positive
    page_px: Annotated[int, Field(ge=256, le=16384)]

    def __post_init__(self) -> None:
        """Refuse an empty range of durations."""
        if self.slide_least_s > self.slide_most_s:
            raise ValueError("slide_least_s is more than slide_most_s")
