"""Drawn animals that know their truth: carp from above, a dog from the side.

They stand in for film where the true answer must be known: of tracking and features (fish paper §2)
and of gaits (curve paper §4.2).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "carp.film": ["CarpFilm"], "dog.walk": ["DogFilm"], "truth": ["TRUTH"],
})  # fmt: skip
