"""The zones of a film's own fish: how its fish turn in response to their neighbours.

The zones of `finloop.social` are fitted to the first half of the film: the direction of a fish some
time later, given the present places of the others (`fit`). Simulated point fish swim by them, each
step one of the film's own (`rule`). Their distance from the second half of the film is reported
beside the distance between the two halves.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "film": ["FilmGroup", "build_film_group"], "fit": ["ZoneFit", "fit_zones"],
    "rule": ["fit_school_rule", "explain_missing_fit", "simulate_point_fish"],
})  # fmt: skip
