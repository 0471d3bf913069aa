"""How much a film changes from frame to frame (Eq. 5 on whole pictures), drawn and filmed."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.render.gallery import Gallery
from finloop.render.painter import Box, Painter, TurnedPicture


class FrameChangeMeter:
    """Measures how much the picture changes from one drawn frame to the next (Eq. 5).

    ‖F_t − F_(t−1)‖₂ over the whole picture in grey levels, colours by their root mean square.
    `film_frame_changes` measures the film alike.
    """

    def __init__(self, painter: Painter) -> None:
        """Measure the canvas of this painter."""
        self._painter = painter
        self._last: tuple[Box, NDArray[np.uint8]] | None = None

    def measure_change(self, box: Box) -> float:
        """Return the canvas's change since the last call, in grey levels; NaN at first.

        box: holds all that is drawn now.
        """
        canvas, last = self._painter.canvas, self._last
        self._last = box, canvas[box.slices].copy()
        if last is None:
            return math.nan
        before, patch = last
        filled = [one for one in (before, box) if not one.is_empty]
        if not filled:
            return 0.0
        both, was = Box.enclose(filled).slices, self._painter.floor.copy()
        was[before.slices] = patch
        change = canvas[both].astype(np.float32) - was[both]
        return math.sqrt(float(np.vdot(change, change)) / canvas.shape[2])


def film_frame_changes(
    painter: Painter, gallery: Gallery, tracks: pd.DataFrame, most: int = 400
) -> NDArray[np.float64]:
    """Return how much the fish change from frame to frame of the film, (n,), in grey levels.

    tracks: track_id, frame and mass centre, a row per frame; most: pairs of consecutive frames at
    most, spread over the film.
    """
    track, frame = (tracks[name].to_numpy() for name in ("track_id", "frame"))
    first = np.flatnonzero((np.diff(track) == 0) & (np.diff(frame) == 1))
    chosen = first[np.unique(np.linspace(0, len(first) - 1, min(most, len(first))).astype(int))]
    places = tracks[["x_px", "y_px"]].to_numpy(float)
    found = []
    for pair in zip(chosen, chosen + 1, strict=True):
        steps = FrameChangeMeter(painter)
        for row in pair:
            x, y = places[row]
            painter.wipe()
            step = steps.measure_change(
                painter.draw(x, y, TurnedPicture(gallery.film_picture(int(row))))
            )
        found.append(step)
    painter.wipe()
    return np.array(found)


def frame_change_metrics(drawn: Sequence[float], film: NDArray[np.float64]) -> dict[str, float]:
    """Return metrics that compare an animation's frame changes with those of the film.

    drawn: from `FrameChangeMeter`, the first one NaN; film: from `film_frame_changes`; both in grey
    levels.
    """
    steps = np.asarray(drawn)[1:]
    if not len(steps) or not len(film):
        return {}
    return {
        "picture_step_median_grey": float(np.median(steps)),
        "picture_step_p95_grey": float(np.quantile(steps, 0.95)),
        "film_picture_step_median_grey": float(np.median(film)),
        "film_picture_step_p95_grey": float(np.quantile(film, 0.95)),
        "picture_step_ratio": float(np.median(steps) / np.median(film)),
        "picture_steps_above_film_p95_share": float(np.mean(steps > np.quantile(film, 0.95))),
    }
