"""Centred pictures of fish, and how far they are from each other (fish paper Eq. 5).

D = ‖F − F′‖₂ over all pixels and channels, 0 … 1, of centred cut-outs.
"""

from typing import Any

import cv2
import numpy as np
import pandas as pd
import scipy
from numpy.typing import ArrayLike, NDArray

from finloop.base.arrays import Floats, Reals
from finloop.base.cutout import Cutout

FILM, BODY = "film", "body"
"""Poses in which pictures are compared: as filmed, or turned to heading 0°."""

SPAN = 1.5  # body lengths across a centred picture: room for a fish in any direction


def draw_centred_cutout(
    cutout: Cutout, centre_px: ArrayLike, length_px: float, size_px: int, turn_deg: float = 0.0
) -> NDArray[np.float32]:
    """Return a picture (size_px, size_px, channels), 0 … 1, with a film cut-out in the middle.

    The picture shows SPAN body lengths, so all fish come out equally long. centre_px: x, y of the
    mass centre in the film; length_px: body length there; turn_deg: anticlockwise as seen.
    """
    centre = (np.asarray(centre_px, float) - (cutout.x0_px, cutout.y0_px)).tolist()
    scale = size_px / (SPAN * length_px)
    matrix = cv2.getRotationMatrix2D(centre, turn_deg, scale)
    matrix[:, 2] += (size_px - 1) / 2 - np.array(centre)
    source = blur_for_shrinking(cutout.pixels.astype(np.float32) / 255, scale)
    return cv2.warpAffine(source, matrix, (size_px, size_px), flags=cv2.INTER_LINEAR)


def blur_for_shrinking(pixels: NDArray[Any], scale: float) -> NDArray[Any]:
    """Blur a picture (h, w, channels) so that it can be drawn `scale` times as large, scale < 1.

    A linear filter skips pixels where it shrinks; the blur replaces an area filter, σ = 0.4 px of
    the small picture. From a scale of 0.75 on, no pixel is skipped, and the picture is returned.
    """
    return cv2.GaussianBlur(pixels, (0, 0), 0.4 / scale) if scale < 0.75 else pixels


def typical_lengths_px(features: pd.DataFrame) -> pd.Series:
    """Return the typical body length [px] of the animal in each row of the feature table.

    It is the track's median, drawn towards the mean of all tracks as far as it is uncertain: a
    mouse that is visible for a moment, curled up, is no shorter mouse. With e² the variance of a
    track's median and τ² that between animals (Morris 1983: empirical Bayes),

        length = mean + τ² / (τ² + e²) (median − mean),   e² = κ / rows.

    κ, the variance times the rows that a posture lasts, is a quarter of the mean square difference
    of a track's two halves, times its rows.
    """
    track = features["track_id"]
    tracks = features.groupby("track_id")["body_length_px"]
    rows, medians = tracks.size().astype(float), tracks.median().astype(float)
    is_late = tracks.cumcount() >= track.map(rows) / 2
    halves = features["body_length_px"].groupby([track, is_late]).median().unstack()
    if len(rows) > 1 and halves.shape[1] == 2:  # else nothing shows how uncertain a median is
        square_difference = (halves[True] - halves[False]).fillna(0.0) ** 2
        kappa = float((square_difference * rows**2).sum() / (4 * rows.sum()))
        medians = _shrink_to_mean(medians, kappa / rows) if kappa else medians
    return track.map(medians)


def _shrink_to_mean(values: pd.Series, variance: pd.Series) -> pd.Series:
    """Return values (k,) of known variances, shrunk towards their mean (empirical Bayes).

    τ², the variance between the values, is estimated as by DerSimonian and Laird (1986).
    """
    # τ², from the spread about the mean that the variances do not explain.
    weight = 1 / variance
    mean = float((weight * values).sum() / weight.sum())
    excess = float((weight * (values - mean) ** 2).sum()) - (len(values) - 1)
    tau_squared = max(excess / float(weight.sum() - (weight**2).sum() / weight.sum()), 0.0)
    # The mean again, and the share of each value's deviation from it that is no chance.
    weight = 1 / (tau_squared + variance)
    mean = float((weight * values).sum() / weight.sum())
    return mean + tau_squared * weight * (values - mean)


def paired_distances(a: Reals, b: Reals) -> Floats:
    """Return the distances (…) (Eq. 5) of pictures a, b (…, size, size, channels), pair by pair."""
    return np.linalg.norm((a - b).reshape(*np.shape(a)[:-3], -1), axis=-1).astype(float)


def successive_distances(pictures: Reals) -> Floats:
    """Return the distances (n − 1,) (Eq. 5) from each of n pictures to the next."""
    return paired_distances(pictures[1:], pictures[:-1])


def all_distances(a: NDArray[np.float32], b: NDArray[np.float32]) -> Floats:
    """Return the distances (n, m) (Eq. 5) between all pictures a (n, …) and all b (m, …).

    For whole films `finloop.distance.map` computes them, by matrix products.
    """
    return scipy.spatial.distance.cdist(a.reshape(len(a), -1), b.reshape(len(b), -1))
