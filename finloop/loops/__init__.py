"""Video loops (fish paper §4.1–4.2; Figs. 8, 10–13): where the film may jump to a similar frame.

A loop joins two frames whose filtered distance is a local minimum below the threshold. All loops
form a graph; the position table gives distance and direction between their ends.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "search": ["NoLoopsError", "to_sparse_map", "find_video_loops"],
    "graph": ["LoopGraph", "build_loop_graph", "find_routes"],
    "positions": ["quadrant_of_displacement", "position_table"],
})  # fmt: skip
