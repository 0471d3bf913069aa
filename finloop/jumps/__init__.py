"""Jumps between frames that look and move alike, found as nearest neighbours.

The paper's loops (§4.1) join pictures that are alike as they are. Where a jump is joined in the
pose of the fish, what counts is what is left to see: the pose and how it changes, how the fish
moves and turns, and its light and skin. Any frame's nearest neighbours in these, mirror images too,
are where it can go on.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["film_jumps"], "search": ["Search"], "seen": ["Seen"],
    "sides": ["sides_apart"], "table": ["JUMPS", "LOOK"],
})  # fmt: skip
