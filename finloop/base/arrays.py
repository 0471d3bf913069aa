"""Names of the array types that packages exchange; docstrings give their shapes."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]  # floats of any width
Points = NDArray[np.float64]  # x and y in the last axis
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]  # (h, w) grey, (h, w, 3) RGB or (h, w, 4) RGBA
