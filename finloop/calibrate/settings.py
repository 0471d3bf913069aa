"""Parameters of `calibrate`: zones of repulsion, alignment, attraction, and how they are fitted."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from finloop.base.settings import NotNegative

Fitted = Literal["auto"] | NotNegative
Angle = Annotated[float, Field(ge=0, le=360)]


@dataclass(frozen=True)
class CalibrateSettings:
    """Parameters of the stage `calibrate`: the zones (`finloop.social.zones`).

    "auto": fitted to the film.
    """

    repulsion_radius_bl: Fitted
    alignment_radius_bl: Fitted
    attraction_radius_bl: Fitted
    blind_angle_deg: Literal["auto"] | Angle
    repulsion_weight: Fitted
    alignment_weight: Fitted
    attraction_weight: Fitted

    # Δ, from one look at the neighbours to the next; auto: until headings of the film are half
    # forgotten, so that the film decides
    horizon: ClassVar[float | Literal["auto"]] = "auto"
    # body lengths, tried as radii: fine where fish are near, up to a tank's size
    radii: ClassVar[tuple[float, ...]] = (
        0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0,
    )  # fmt: skip
    # degrees, tried as blind angles: from none to the half behind the fish
    blind_angles_deg: ClassVar[tuple[float, ...]] = (0.0, 45.0, 90.0, 135.0, 180.0)
    rows: ClassVar[int] = 5000  # of each half of the film, evenly spread, at most: bounds the time
    # steps of the film, the most similar by wall and motion, from which one is drawn: few enough to
    # be similar, enough for chance
    similar_steps: ClassVar[int] = 30
    steps: ClassVar[int] = 4000  # that simulated fish swim for the measures: bounds the time
    seed: ClassVar[int] = 0  # of these fish: they check the fit and change no animation
    RENAMED: ClassVar = {
        "repulsion": "repulsion_radius_bl",
        "alignment": "alignment_radius_bl",
        "attraction": "attraction_radius_bl",
        "blind_deg": "blind_angle_deg",
    }

    def __post_init__(self) -> None:
        """Raise ValueError if the given radii do not ascend."""
        radii = [radius for radius in self.zone_radii if radius != "auto"]
        if radii != sorted(radii):
            raise ValueError(
                "the zones lie one round the other: repulsion ≤ alignment ≤ attraction"
            )

    @property
    def zone_radii(self) -> tuple[Fitted, Fitted, Fitted]:
        """Return the radii of repulsion, alignment and attraction in body lengths, or "auto"."""
        return self.repulsion_radius_bl, self.alignment_radius_bl, self.attraction_radius_bl
