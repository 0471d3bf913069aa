"""Parameters of `identity`: how tracks are joined to animals."""

from dataclasses import dataclass
from typing import ClassVar

from finloop.base.settings import Share


@dataclass(frozen=True)
class IdentitySettings:
    """Parameters of `identity`: how tracks are joined by motion and by appearance."""

    min_join_probability: Share
    new_animal_probability: Share

    seed: ClassVar[int] = 0  # of the noise that probabilities are estimated by: 500 draws suffice
    pictures_per_track: ClassVar[int] = 60  # for its descriptors, at most
    size_px: ClassVar[int] = 24  # px, sides of these pictures: colours and shape, no details
    components: ClassVar[int] = 32  # principal components of the pictures, at most
    # Joins at least as probable are made before the others are judged again. With 0.8 to 0.99 the
    # tracks of eight zebrafish become 8 animals; without this, 9.
    sure_probability: ClassVar[float] = 0.9

    RENAMED: ClassVar[dict[str, str]] = {
        "least_probability": "min_join_probability",
        "strangers": "new_animal_probability",
    }
