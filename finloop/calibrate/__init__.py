"""The zones of a film's own fish: what they turn by, where their neighbours are.

The zones of `finloop.social` are fitted to one half of the film in time: the direction of a fish
some time later, given where the others are now (`fit`). Fish that are points swim by them, each
step one of the film's own (`points`). How far they are from the film's other half is said beside
how far that is from the first.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["FilmShoal", "film_shoal"], "fit": ["Fitted", "fit_zones"], "points": ["swum_points"],
    "rule": ["film_rule", "shortage"],
})  # fmt: skip
