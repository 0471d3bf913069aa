"""From film to tracks of isolated fish: cut-outs, outlines, backbones (fish paper §2.1-2.2.1).

Background and noise (`background`), silhouettes (`segment`), the backbone (`skeleton`, `backbone`),
tracks (`tracks`). `samples` measures sample frames first; `film` combines all of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "background": ["Scene", "median_background"],
    "film": ["Detector", "detect_in_clip"], "samples": ["TypicalFish", "measure_scene_and_fish"],
    "table": ["tracks_schema"],
})  # fmt: skip
