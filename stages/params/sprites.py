"""Parameters of the stage `sprites`: which frames become sprites (fish paper §3.3)."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Sprites:
    """The fields are those of `finloop.sprites.orient.Settings`, and the atlas's own."""

    straight: str | None
    slide: str | None
    left: str | None
    right: str | None
    slide_least_s: Positive
    slide_most_s: Positive
    page_px: Annotated[int, Field(ge=256, le=16384)]

    def __post_init__(self) -> None:
        if self.slide_least_s > self.slide_most_s:
            raise ValueError("slide_least_s is more than slide_most_s")


OPTIONS = {"default": Sprites}
