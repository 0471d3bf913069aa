"""Parameters of mode `hybrid`: how network and film are joined (fish paper Fig. 19)."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class HybridSettings:
    """How the hybrid mode changes over."""

    join: Literal["fade", "inertial", "cut"]
