"""How fish of one tank act on each other, as rules and as measures.

Zones of repulsion, alignment and attraction (Couzin et al. 2002, J. theor. Biol. 218, 1-11), leader
and follower, steps as the film's fish make them, and what tells a shoal: distances, alignment,
bearings.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "leader": ["leaders"], "measures": ["SHOAL", "apart", "shoal_table"], "steps": ["SocialSteps"],
    "walls": ["Walls"], "zones": ["Zones", "pull"],
})  # fmt: skip
