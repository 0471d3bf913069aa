"""Parameters of `calibrate`: zones of repulsion, alignment, attraction, and how they are fitted."""

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from finloop.base.settings import Count, NotNegative, Positive, Seed

Fitted = Literal["auto"] | NotNegative
Angle = Annotated[float, Field(ge=0, le=360)]


@dataclass(frozen=True)
class CalibrateSettings:
    """The zones (`finloop.social.zones`); auto: as the film's fish have it."""

    repulsion: Fitted  # body lengths; whoever is nearer is swum away from
    alignment: Fitted  # body lengths; who is nearer than this swims in a direction that is taken on
    attraction: Fitted  # body lengths; who is nearer than this is swum to
    blind_deg: Literal["auto"] | Angle  # degrees behind a fish in which it sees nobody
    repulsion_weight: Fitted  # how strongly it pulls; 1 = as the fish's own direction
    alignment_weight: Fitted  # see repulsion_weight
    attraction_weight: Fitted  # see repulsion_weight

    # Δ; so long a fish swims where its company wishes, before it looks again; auto: until headings
    # of the film are half forgotten
    horizon: Literal["auto"] | Positive
    radii: Annotated[list[NotNegative], Field(min_length=3)]  # body lengths, that are tried
    blind_angles_deg: Annotated[list[Angle], Field(min_length=1)]  # that are tried
    rows: Count  # of each half of the film, evenly spread, that are looked at, at most
    # a step of a fish is drawn from so many of the film that are most alike: by wall and motion
    alike: Count
    steps: Count  # that fish which are points swim, for the measures
    seed: Seed  # of these fish

    def __post_init__(self) -> None:
        radii = [one for one in (self.repulsion, self.alignment, self.attraction) if one != "auto"]
        if radii != sorted(radii):
            raise ValueError(
                "the zones lie one round the other: repulsion ≤ alignment ≤ attraction"
            )
