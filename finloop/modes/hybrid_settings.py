"""Parameters of mode `hybrid`: how network and film are joined (fish paper Fig. 19)."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class HybridSettings:
    """Parameters of mode `hybrid`. join: how the pictures of network and film are joined."""

    join: Literal["fade", "inertial", "cut"]
