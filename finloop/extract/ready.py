"""Load the compiled kernels that measure a fish: importing this module makes them ready.

Loading takes half a second. The server from which workers are forked imports it, so they inherit
the kernels. OpenCV uses one thread from then on: its threads do not survive a fork, and a worker
would wait for them for ever.
"""

import cv2
import numpy as np

from finloop.extract.background import Scene, match_scene_to_light
from finloop.extract.segment import SilhouetteEdge, find_silhouettes, measure_fish

_TONE, _NOISE, _POINTS = 200, 6.0, 21


def _measure_drawn_fish() -> None:
    """Find and measure a fish in a drawn frame, so that every compiled kernel is loaded."""
    tank = np.full((48, 96), _TONE, np.uint8)
    film = np.asarray(cv2.ellipse(tank.copy(), (48, 24), (30, 6), 0, 0, 360, (40,), cv2.FILLED))
    scene = match_scene_to_light(Scene(tank, "dark", noise=1.0, threshold=_NOISE), film)
    arena, edge_rule = np.full(tank.shape, 255, np.uint8), SilhouetteEdge(0.4, 0.5, fins="all")
    for silhouette in find_silhouettes(film, scene, arena, 50.0, edge_rule):
        measure_fish(silhouette, film, scene, _POINTS)


cv2.setNumThreads(1)
_measure_drawn_fish()
