"""Exports for other programs (no section of the papers): pictures with alpha, edit lists, tracks.

Films of the fish alone, sprite cycles, the edit list in plain columns, and tracks as poses in
DeepLabCut's layout.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "pictures": ["cut_out", "sprite_cycle", "add_film_source", "bounding_box"],
    "tracks": ["poses", "deeplabcut"],
})  # fmt: skip
