"""Parameters of `report`: how large the page may be."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.settings import Positive, Quality


@dataclass(frozen=True)
class Settings:
    """How large the page and what it holds may be.

    Attributes
    ----------
    film_most_mb : MB, > 0
        A larger film is made smaller for the page.
    picture_width_px : pixels, 200-4000
        Pictures are at most so wide.
    picture_quality : 0 = worst, 100 = best
        Of the pictures, WebP.
    most_mb : MB, > 0
        A page that would be larger is refused.
    """

    film_most_mb: Positive
    picture_width_px: Annotated[int, Field(ge=200, le=4000)]
    picture_quality: Quality
    most_mb: Positive
