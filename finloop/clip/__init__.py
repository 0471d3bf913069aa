"""The clip stage: arena, check and repair of the film (fish paper §2.1).

`io.footage` reads films of any kind; `io.movie` writes the clip.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "check": ["ClipTally", "check_film", "psnr_db"], "verdict": ["list_findings"],
    "write": ["circle_arena", "rectangle_arena"],
})  # fmt: skip
