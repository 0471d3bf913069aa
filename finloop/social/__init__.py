"""How fish of one tank act on each other, as rules and as measures.

Zones of repulsion, alignment and attraction (Couzin et al. 2002, J. theor. Biol. 218, 1-11), leader
and follower, steps of the film's fish, and measures of a school: distances, alignment, bearings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "leader": ["leaders_by_follower"],
    "measures": ["SCHOOL", "measure_group", "wasserstein_distances"],
    "rule": ["SocialSteps"], "walls": ["Walls"], "zones": ["Zones", "pull_of_others"],
})  # fmt: skip
