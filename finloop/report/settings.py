"""Parameters of `report`: how large the page may be."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from pydantic import Field

from finloop.base.settings import Positive


@dataclass(frozen=True)
class ReportSettings:
    """Parameters of the stage `report`: limits on its page and films (MB) and pictures (px)."""

    max_film_mb: Positive
    max_picture_width_px: Annotated[int, Field(ge=200, le=4000)]
    max_page_mb: Positive

    picture_quality: ClassVar[int] = 85  # of the pictures, WebP; letters in them stay sharp
    RENAMED: ClassVar = {
        "film_most_mb": "max_film_mb",
        "picture_width_px": "max_picture_width_px",
        "most_mb": "max_page_mb",
    }
