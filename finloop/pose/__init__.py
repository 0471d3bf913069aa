"""The postures of a film's animals: every row as a few codes, so that poses can be joined.

A posture is how an animal is bent (`finloop.puppet.pose`); its codes are the amounts of the film's
principal shapes.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["FilmPoses", "compute_film_poses"],
})  # fmt: skip
