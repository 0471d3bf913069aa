"""How much a film changes from frame to frame (Eq. 5 on whole pictures), drawn and filmed."""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.stretches import spread_rows
from finloop.render.gallery import Gallery
from finloop.render.painter import Box, Painter, TurnedPicture


class FrameChangeMeter:
    """Measures how much the picture changes from one drawn frame to the next.

    The measure is the Euclidean distance (Eq. 5) ‖F_t − F_(t−1)‖₂ over the whole picture in grey
    levels, colours by their root mean square. `film_frame_changes` measures the film alike.
    """

    def __init__(self, painter: Painter) -> None:
        """Begin without a frame; painter: its canvas is measured."""
        self._painter = painter
        self._last: tuple[Box, NDArray[np.uint8]] | None = None

    def measure_change(self, box: Box) -> float:
        """Return the Euclidean distance of the canvas from that of the last call; NaN at the first.

        It is in grey levels: the root of the sum over all pixels, of the mean over channels of the
        squared change. box: encloses all that is drawn now; outside of it the canvas shows the
        empty floor.
        """
        canvas, last = self._painter.canvas, self._last
        self._last = box, canvas[box.slices].copy()
        if last is None:
            return math.nan
        last_box, last_pixels = last
        drawn_boxes = [drawn for drawn in (last_box, box) if not drawn.is_empty]
        if not drawn_boxes:
            return 0.0
        both, last_canvas = Box.enclose(drawn_boxes).slices, self._painter.floor.copy()
        last_canvas[last_box.slices] = last_pixels
        change = canvas[both].astype(np.float32) - last_canvas[both]
        return math.sqrt(float(np.vdot(change, change)) / canvas.shape[2])


def film_frame_changes(
    painter: Painter, gallery: Gallery, tracks: pd.DataFrame, most: int = 400
) -> NDArray[np.float64]:
    """Return how much the fish change from frame to frame of the film, (n,), in grey levels.

    tracks: track_id, frame and mass centre, a row per frame; most: largest number n of pairs of
    consecutive frames, spread over the film. Each fish is drawn alone on the painter's floor.
    """
    track, frame = tracks["track_id"].to_numpy(), tracks["frame"].to_numpy()
    has_next = np.flatnonzero((np.diff(track) == 0) & (np.diff(frame) == 1))
    places = tracks[["x_px", "y_px"]].to_numpy(float)
    changes = []
    for first in spread_rows(has_next, most):
        meter = FrameChangeMeter(painter)
        for row in (first, first + 1):
            x, y = places[row]
            painter.wipe()
            box = painter.draw(x, y, TurnedPicture(gallery.film_picture(int(row))))
            change = meter.measure_change(box)  # NaN for the first of the two
        changes.append(change)
    painter.wipe()
    return np.array(changes)


def frame_change_metrics(drawn: Sequence[float], film: NDArray[np.float64]) -> dict[str, float]:
    """Return metrics that compare an animation's frame changes with those of the film.

    drawn: change of each drawn frame, the first one NaN; film (n,): those of the film; both in grey
    levels. The metrics are medians, 95th percentiles and their comparison; {} without a change.
    """
    changes = np.asarray(drawn)[1:]
    if not len(changes) or not len(film):
        return {}
    return {
        "picture_step_median_grey": float(np.median(changes)),
        "picture_step_p95_grey": float(np.quantile(changes, 0.95)),
        "film_picture_step_median_grey": float(np.median(film)),
        "film_picture_step_p95_grey": float(np.quantile(film, 0.95)),
        "picture_step_ratio": float(np.median(changes) / np.median(film)),
        "picture_steps_above_film_p95_share": float(np.mean(changes > np.quantile(film, 0.95))),
    }
