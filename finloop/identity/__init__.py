"""Identify animals: join their tracks across touches, by motion and appearance.

A track ends where an animal touches another. Motion (`motion`) and appearance (`appearance`) give
the probability that a later track is the same animal; `joins` finds the best set of joins.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["IDENTITIES", "identify_animals"],
})  # fmt: skip
