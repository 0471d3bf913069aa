"""The clip stage: where animals can be, and how good the normalised clip is (fish paper §2.1).

Reading film of any kind is `io.footage`; writing the clip is `io.movie`.
"""

from finloop.clip.arena import circle_arena, rectangle_arena
from finloop.clip.quality import Tally, psnr_db

__all__ = ["Tally", "circle_arena", "psnr_db", "rectangle_arena"]
