"""Parameters of `render`: how an edit list becomes a film (fish paper Figs. 16, 18)."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import Crf, NotNegative
from finloop.edit.modes import Shown

TankLook = Literal["still", "grain", "film"]
"""How the empty tank looks: it stands still; has the film's grain; has its grain and its light."""


@dataclass(frozen=True)
class RenderSettings:
    """Parameters of `render`: which edit list is filmed, and how."""

    mode: Shown
    tank: TankLook
    marked_film: bool
    crf: Crf
    shadow_darkness: Annotated[float, Field(ge=0, le=1)]
    webp_width_px: Annotated[int, Field(ge=16, le=16383)]
    webp_seconds: NotNegative
    comparison_seconds: NotNegative

    webp_quality: ClassVar[int] = 75  # 100 = best; more makes the file larger, not visibly sharper
    shadow_blur: ClassVar[float] = 0.05  # body lengths, SD of its blur: narrower than a fish
    beside_px: ClassVar[int] = 256  # px, width of a panel of modes.mp4; five fit on a screen
    RENAMED: ClassVar = {
        "marks": "marked_film",
        "shadow": "shadow_darkness",
        "beside_seconds": "comparison_seconds",
    }
