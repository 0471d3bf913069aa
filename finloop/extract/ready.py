"""Importing this loads all that a process needs to measure fish, compiled functions too.

The server that worker processes are forked from imports it (`finloop.base.parallel.warm_up`), so
that it is done once, while the film is looked at, and not for every worker.
"""

import cv2
import numpy as np

from finloop.extract.background import Scene
from finloop.extract.segment import measure, silhouettes

cv2.setNumThreads(1)  # a process that is forked lacks the threads, and would wait for them

_POINTS = 33  # of a backbone; any number loads the same

_tank = np.full((48, 96), 255, np.uint8)
_frame = cv2.ellipse(_tank.copy(), (48, 24), (30, 6), 0, 0, 360, 0, cv2.FILLED)
_scene = Scene(_tank, "dark", noise=1.0, threshold=6.0)
for _fish in silhouettes(_frame, _scene, _tank, least_area=20.0, share=0.4):
    measure(_fish, _frame, _scene, _POINTS)
