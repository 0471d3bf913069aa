"""The clip stage: arena, check and repair of the film (fish paper §2.1).

Reading film of any kind is `io.footage`; writing the clip is `io.movie`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "arena": ["circle_arena", "rectangle_arena"], "quality": ["Tally", "psnr_db"],
    "verdict": ["findings"],
})  # fmt: skip
