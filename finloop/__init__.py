"""finloop: film a fish once, steer it for ever.

The verbs of `finloop.verbs` are here, too; `examples/ten_lines.py` goes from a film to a video.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"
__all__ = [
    "compare", "draw_carp", "find_gateways", "find_jumps", "find_loops", "find_poses", "find_zones",
    "learn", "make_sprites", "measure", "open_film", "steer", "track", "train_forecast",
    "write_video",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a verb when it is used (PEP 562): a part of finloop does not import the others."""
    if name in __all__:
        return getattr(import_module("finloop.verbs"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
