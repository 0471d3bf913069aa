"""Parameters of `identity`: how tracks are joined to animals."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from finloop.base.settings import Count, Seed, Share


@dataclass(frozen=True)
class IdentitySettings:
    """How tracks are joined to animals, by motion and by appearance."""

    looked_at: Annotated[int, Field(ge=4)]  # pictures of a track for its descriptors
    size_px: Annotated[int, Field(ge=8)]  # px, sides of these pictures
    components: Count  # principal components of the pictures, at most
    # share of the ends of tracks at which an animal comes or goes for good. The 36 tracks of
    # eight zebrafish become 9 animals at 0.01, 10 at 0.05; no trial gap is joined wrong
    strangers: Share
    least_probability: Share  # a join that is less probable is not made
    # joins at least as probable are made before the others are looked at again. With 0.8 to 0.99
    # the tracks of eight zebrafish become 8 animals, without 9
    sure: Share
    seed: Seed  # of the noise that gives probabilities
