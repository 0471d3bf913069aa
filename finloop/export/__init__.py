"""Exports for other programs (no section of the papers): pictures with alpha, edit lists, tracks.

Films of the fish alone, sprite cycles, the edit list in plain columns, and tracks as poses in
DeepLabCut's layout.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "pictures": ["cut_out_fish", "sprites_of_sequence", "add_film_sources", "box_of_all_fish"],
    "tracks": ["keypoints_of_tracks", "deeplabcut_tables"],
})  # fmt: skip
