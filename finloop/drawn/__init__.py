"""Drawn animals with known ground truth: carp from above, a dog from the side.

They replace film where the true answer must be known: for tracking and features (fish paper §2)
and for gaits (curve paper §4.2).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "carp.film": ["CarpFilm"], "dog.walk": ["DogFilm"], "truth": ["TRUTH"],
})  # fmt: skip
