"""Morphs between drawings: linear, physical, and fold-free (curve paper §4.1).

Corresponding points (`match`), a morph without folds (`simple`), frames as rigid as possible
(`relax`), counting and excluding folds (`folds`), whole drawings and the paper's methods
(`layers`), drawings that forces move (`in_forces`), a trial page (`trial`). `tool` is the
command line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "folds": ["is_simple", "stays_simple"],
    "layers": ["Morph", "PhysicalOptions", "morph_drawings", "there_and_back"],
    "match": ["Resolution", "match_curves"],
})  # fmt: skip
