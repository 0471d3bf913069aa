"""The table of swimmers: every fish in every frame, and which frames may become sprites."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Floats, Reals
from finloop.features.current import through_water
from finloop.sprites.settings import SpritesSettings


def swimmers(
    features: pd.DataFrame, tracks: pd.DataFrame, settings: SpritesSettings
) -> pd.DataFrame:
    """Return the table of swimmers: what the choice of frames needs of each fish in each frame.

    Its rows are those of `features` and `tracks`. tail: the tail tip's offset from the head's axis,
    body lengths, + = left. heading: degrees, unwrapped. speed: body lengths a frame. alone: body
    lengths to the nearest other mass centre. usable: whether the frame may become a sprite.
    """
    table = features.assign(area_px=tracks["area_px"], contrast=tracks["contrast"])
    of_track = table.groupby("track_id", sort=False)
    length = of_track["body_length_px"].transform("median").to_numpy()
    back = np.radians(table["heading_deg"].to_numpy(float))
    dx = (table["tail_x_px"] - table["head_x_px"]).to_numpy(float)
    dy = (table["tail_y_px"] - table["head_y_px"]).to_numpy(float)
    heading = of_track["heading_deg"].transform(lambda h: np.unwrap(h.to_numpy(float), period=360))
    way = pd.DataFrame(through_water(table)).groupby(table["track_id"].to_numpy(), sort=False)
    place = way.transform(lambda x: smooth(x.to_numpy(float))).to_numpy()
    travel = np.zeros_like(place)
    travel[:-1] = np.diff(place, axis=0)
    last = (of_track.cumcount(ascending=False) == 0).to_numpy()
    travel[last] = travel[np.maximum(np.flatnonzero(last) - 1, 0)]
    result = pd.DataFrame(
        {
            "track_id": table["track_id"].to_numpy(),
            "frame": table["frame"].to_numpy(),
            "x_px": table["x_px"].to_numpy(),
            "y_px": table["y_px"].to_numpy(),
            "step_x_px": travel[:, 0],
            "step_y_px": travel[:, 1],
            "heading": heading.to_numpy(),
            "bend": table["bend"].to_numpy(float),
            "area_rel": table["motion_area_rel"].to_numpy(float),
            "type": table["swimming_type"].to_numpy(),
            "tail": (-dx * np.sin(back) - dy * np.cos(back)) / length,
            "speed": np.hypot(*travel.T) / length,
            "length_px": length,
            "area_px": table["area_px"].to_numpy(float),
            "contrast": table["contrast"].to_numpy(float),
            "orientations": table["orientations"].to_numpy(),
        }
    )
    result["alone"] = _alone(table) / np.median(length)
    clip = np.median(table["body_length_px"])
    result["animal_off"] = np.abs(length / clip - 1) / settings.size_off
    off = np.abs(table["body_length_px"].to_numpy() / length - 1)
    result["usable"] = (
        (table["head_confidence"].to_numpy() >= settings.min_head_confidence)
        & (off <= settings.length_off)
        & (result["alone"] > settings.min_neighbour_distance_bl)
    )
    return result


def smooth(values: Reals) -> Floats:
    """Return values (frames,) smoothed by the weights ¼, ½, ¼.

    Lines stay lines, and monotone runs stay monotone. The ends are continued in a straight line.
    """
    x = np.array(values, np.float64)
    if len(x) < 3:
        return x
    ends = np.r_[2 * x[0] - x[1], x, 2 * x[-1] - x[-2]]
    return scipy.ndimage.convolve1d(ends, [0.25, 0.5, 0.25])[1:-1]


def _alone(table: pd.DataFrame) -> Floats:
    """Return the distance (rows,) [px] to the frame's nearest other mass centre; inf if none."""
    nearest = np.full(len(table), np.inf)
    place = table[["x_px", "y_px"]].to_numpy()
    for rows in table.groupby("frame").indices.values():
        if len(rows) > 1:
            gaps = np.hypot(*(place[rows, None] - place[None, rows]).transpose(2, 0, 1))
            np.fill_diagonal(gaps, np.inf)
            nearest[rows] = gaps.min(1)
    return nearest


def unbroken_row_slices(table: pd.DataFrame) -> Iterator[slice]:
    """Yield, as a slice of rows, each run of successive frames of one track."""
    broken = (np.diff(table["track_id"]) != 0) | (np.diff(table["frame"]) != 1)
    edges = [0, *(np.flatnonzero(broken) + 1).tolist(), len(table)]
    yield from (slice(a, b) for a, b in pairwise(edges) if b > a)
