"""Parameters of `report`: how large the page may be."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Positive, Quality


@dataclass(frozen=True)
class ReportSettings:
    """How large the page and what it holds may be."""

    film_most_mb: Positive  # MB; a larger film is made smaller for the page
    picture_width_px: Annotated[int, Field(ge=200, le=4000)]  # px; pictures are at most so wide
    picture_quality: Quality  # of the pictures, WebP
    most_mb: Positive  # MB; a page that would be larger is refused
