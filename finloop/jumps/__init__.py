"""Jumps between frames that look and move alike, found as nearest neighbours.

The paper's loops (§4.1) compare whole pictures. A jump that is joined in the pose of the fish is
compared differently: by the pose and its change, by speed and turning, by light and skin. A frame
can jump to its nearest neighbours in these numbers, including mirror images.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["JumpSearch", "find_film_jumps"], "visible": ["VisibleDistance"],
    "signature": ["measure_side_difference"], "table": ["JUMPS", "LOOK"],
})  # fmt: skip
