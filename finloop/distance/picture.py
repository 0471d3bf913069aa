"""Distance between pictures of fish (fish paper Eq. 5): D = ‖F − F′‖₂ over centred cut-outs."""

from typing import Protocol

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from finloop.base.cutout import Cutout, Cutouts

FILM, BODY = "film", "body"
"""Poses in which pictures are compared: as filmed, or turned to heading 0°."""

SPAN = 1.5  # body lengths across a centred picture: a fish in any direction, its bends too


class Place(Protocol):
    """Anything with a mass centre, in px of the film."""

    @property
    def x_px(self) -> float: ...
    @property
    def y_px(self) -> float: ...


def centred(
    pixels: NDArray[np.uint8],
    centre: tuple[float, float],
    length_px: float,
    size: int,
    turn_deg: float = 0.0,
) -> NDArray[np.float32]:
    """A premultiplied cut-out (h, w, c), 0 … 1, its mass centre in the middle of (size, size, c).

    `centre` is x, y in the cut-out, `length_px` its body length: all fish come out equally long.
    `turn_deg` turns it anticlockwise as seen.
    """
    scale = size / (SPAN * length_px)
    matrix = cv2.getRotationMatrix2D(centre, turn_deg, scale)
    matrix[:, 2] += (size - 1) / 2 - np.array(centre)
    # A linear filter thins out where it shrinks: blur first, as an area filter would.
    source = pixels.astype(np.float32) / 255
    if scale < 0.75:
        source = cv2.GaussianBlur(source, (0, 0), 0.4 / scale)
    return cv2.warpAffine(source, matrix, (size, size), flags=cv2.INTER_LINEAR)


def picture(
    cutout: Cutout, at: Place, length_px: float, size: int, turn_deg: float = 0.0
) -> NDArray[np.float32]:
    """A cut-out whose mass centre is `at.x_px`, `at.y_px` of the film, centred."""
    centre = at.x_px - cutout.x0_px, at.y_px - cutout.y0_px
    return centred(cutout.pixels, centre, length_px, size, turn_deg)


def film_pictures(
    features: pd.DataFrame, film: Cutouts, size: int, pose: str, rows: NDArray[np.intp]
) -> NDArray[np.float32]:
    """Centred pictures (n, size, size, c) of some rows of the feature table, at least one.

    A track's typical length is that of all its pictures. `pose` FILM: as filmed; BODY: headed to
    the right.
    """
    length = typical_length(features).to_numpy()
    turn = -features["heading_deg"].to_numpy(float) * (pose == BODY)
    places = features[["x_px", "y_px"]].iloc[rows].itertuples(index=False)
    channels = film[0].pixels.shape[2]
    shown = np.empty((len(rows), size, size, channels), np.float32)  # a list would hold it twice
    for number, (row, one) in enumerate(zip(rows, places, strict=True)):
        shown[number] = picture(film[int(row)], one, length[row], size, turn[row])
    return shown


def typical_length(features: pd.DataFrame) -> pd.Series:
    """The median body length [px] of the track, for every row of the feature table."""
    return features.groupby("track_id")["body_length_px"].transform("median")


def distance(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float64]:
    """Eq. 5 between pictures (n, …) and (m, …) of one size, as (n, m)."""
    return cdist(a.reshape(len(a), -1), b.reshape(len(b), -1))


def steps(pictures: NDArray[np.float32]) -> NDArray[np.float64]:
    """Eq. 5 from each picture (n, …) to the next, as (n − 1,)."""
    flat = pictures.reshape(len(pictures), -1)
    return np.linalg.norm(np.diff(flat, axis=0), axis=1).astype(float)
