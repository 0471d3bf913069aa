"""How near the fish of a tank come to each other: overlapping outlines, nearest neighbours.

An outline is that of the picture, at the heading of the edit list, without what joins still bend
and turn.
"""

from itertools import combinations
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.animate.protocols import AnyPlayer
from finloop.base.arrays import Floats, Ints
from finloop.base.axes import to_body_axes
from finloop.distance.picture import typical_lengths_px
from finloop.edit.schema import FRAME


class PlacedPicture(NamedTuple):
    """The columns of an edit list that determine the outline of a fish on screen."""

    kind: str
    source: int
    mirrored: bool
    x_px: float
    y_px: float
    heading_deg: float


def place_outline(
    hull: Floats, x_px: float, y_px: float, heading_deg: float, mirrored: bool
) -> Floats:
    """Return an outline (p, 2) on screen, x, y px, from one about the mass centre.

    hull (p, 2): px ahead of and to the left of the mass centre; x_px, y_px, heading_deg: of the
    fish.
    """
    turned = to_body_axes(hull * (1, -1 if mirrored else 1), np.radians(heading_deg))  # its inverse
    return np.asarray(turned + np.array([x_px, y_px]))


def outline_on_screen(player: AnyPlayer, edit_row: Any) -> Floats:
    """Return the outline (p, 2) on screen, x, y px, of a row of an edit list.

    edit_row: one with the fields of `PlacedPicture`.
    """
    mirrored = edit_row.kind == FRAME and edit_row.mirrored
    return place_outline(
        player.hull(edit_row.kind, edit_row.source),
        edit_row.x_px,
        edit_row.y_px,
        edit_row.heading_deg,
        mirrored,
    )


def do_outlines_overlap(one: Floats, other: Floats) -> bool:
    """Return whether two outlines (p, 2) on screen share a pixel, apart from their edges."""
    low, high = np.maximum(one.min(0), other.min(0)), np.minimum(one.max(0), other.max(0))
    if (low > high).any():
        return False
    corner = np.minimum(one.min(0), other.min(0))
    size = np.ceil(np.maximum(one.max(0), other.max(0)) - corner).astype(int) + 1
    masks = np.zeros((2, *size[::-1]), np.uint8)
    for mask, polygon in zip(masks, (one, other), strict=True):
        cv2.fillPoly(mask, [np.rint(16 * (polygon - corner)).astype(np.int32)], 1, shift=4)
    return bool((masks[0] & masks[1]).any())


def fish_places(edit: pd.DataFrame) -> Floats:
    """Return the places (fish, ticks, 2), x, y px, of all fish of an edit list."""
    return edit[["x_px", "y_px"]].to_numpy(float).reshape(edit["fish"].nunique(), -1, 2)


def count_overlaps(edit: pd.DataFrame, player: AnyPlayer) -> Ints:
    """Return how many pairs of fish overlap at each tick (ticks,) of an edit list."""
    where = fish_places(edit)
    fish, ticks = where.shape[:2]
    columns = [edit[name].to_numpy() for name in PlacedPicture._fields]

    def hull_at(one: int, tick: int) -> Floats:
        return outline_on_screen(
            player, PlacedPicture(*(column[one * ticks + tick] for column in columns))
        )

    pairs = np.zeros(ticks, np.int64)
    for one, other in combinations(range(fish), 2):
        apart = np.hypot(*(where[one] - where[other]).T)
        for tick in np.flatnonzero(apart < 2 * player.cast.discs.reach).tolist():
            pairs[tick] += do_outlines_overlap(hull_at(one, tick), hull_at(other, tick))
    return pairs


def nearest_distances(places: Floats) -> Floats:
    """Return the distance (n,) of each of n ≥ 2 places (n, 2) from its nearest neighbour."""
    far = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(far, np.inf)
    return np.asarray(far.min(axis=1))


def measure_clearance(edit: pd.DataFrame, player: AnyPlayer) -> dict[str, float]:
    """Return how near the fish of an edit list come to each other; empty for a single fish.

    Keys: `overlapping_pairs_per_1000_ticks`, and those of `distance_quantiles`.
    """
    where = fish_places(edit)
    if len(where) < 2:
        return {}
    near = [nearest_distances(tick) for tick in where.transpose(1, 0, 2)]
    return {
        "overlapping_pairs_per_1000_ticks": 1000 * float(count_overlaps(edit, player).mean()),
        **distance_quantiles(np.concatenate(near) / player.world.motion.body_length_px),
    }


def measure_film_clearance(features: pd.DataFrame) -> dict[str, float]:
    """Return quantiles of how near a film's animals come to each other; empty for one at a time."""
    near = film_nearest_distances(features)
    return distance_quantiles(near) if len(near) else {}


def film_nearest_distances(features: pd.DataFrame) -> Floats:
    """Return how far, in body lengths, each animal of a film is from its nearest neighbour.

    (k,): one for each row of the feature table whose frame shows several animals.
    """
    length = typical_lengths_px(features).to_numpy(float)
    where = features[["x_px", "y_px"]].to_numpy(float)
    together = [rows for rows in features.groupby("frame").indices.values() if len(rows) > 1]
    return np.concatenate(
        [np.zeros(0), *(nearest_distances(where[rows]) / length[rows] for rows in together)]
    )


def distance_quantiles(distances: Floats) -> dict[str, float]:
    """Return the quantiles 1 %, 5 % and 50 % of distances (k,) to the nearest neighbour, by name.

    distances and results are in body lengths.
    """
    at = np.quantile(distances, [0.01, 0.05, 0.5])
    names = ("nearest_1pct", "nearest_5pct", "nearest_median")
    return {f"{name}_body_lengths": float(q) for name, q in zip(names, at, strict=True)}
