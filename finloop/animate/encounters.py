"""How near the fish of a tank come to each other: overlapping outlines, nearest neighbours.

An outline is that of the picture, at the heading of the edit list, without the bends and turns that
transitions add.
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
    """The columns of an edit list that determine the outline of a fish on screen.

    kind: SPRITE or FRAME; source: sprite or film row; x_px, y_px, heading_deg: of the fish.
    """

    kind: str
    source: int
    mirrored: bool
    x_px: float
    y_px: float
    heading_deg: float


def place_outline(
    outline: Floats, x_px: float, y_px: float, heading_deg: float, mirrored: bool
) -> Floats:
    """Return an outline as it is on screen, x, y px (p, 2).

    outline (p, 2): px ahead of and to the left of the mass centre; x_px, y_px, heading_deg: of the
    fish; mirrored: whether left is right.
    """
    # A function for screen to body serves here, too: it is its own inverse, a reflection.
    offsets = to_body_axes(outline * (1, -1 if mirrored else 1), np.radians(heading_deg))
    return np.asarray(offsets + np.array([x_px, y_px]))


def outline_on_screen(player: AnyPlayer, edit_row: Any) -> Floats:
    """Return the outline (p, 2) on screen, x, y px, of a row of an edit list.

    edit_row: has the fields of `PlacedPicture`.
    """
    mirrored = edit_row.kind == FRAME and edit_row.mirrored
    outline = player.silhouettes.outline(edit_row.kind, edit_row.source)
    return place_outline(outline, edit_row.x_px, edit_row.y_px, edit_row.heading_deg, mirrored)


def do_outlines_overlap(first: Floats, second: Floats) -> bool:
    """Return whether two outlines (p, 2), px on screen, share a pixel, apart from their edges."""
    low, high = np.maximum(first.min(0), second.min(0)), np.minimum(first.max(0), second.max(0))
    if (low > high).any():
        return False
    corner = np.minimum(first.min(0), second.min(0))
    size = np.ceil(np.maximum(first.max(0), second.max(0)) - corner).astype(int) + 1
    masks = np.zeros((2, *size[::-1]), np.uint8)
    for mask, polygon in zip(masks, (first, second), strict=True):
        sixteenths = np.rint(16 * (polygon - corner)).astype(np.int32)  # of a px: 4 binary digits
        cv2.fillPoly(mask, [sixteenths], 1, shift=4)
    return bool((masks[0] & masks[1]).any())


def fish_places(edit: pd.DataFrame) -> Floats:
    """Return the places (fish, ticks, 2), x, y px, of all fish of an edit list."""
    return edit[["x_px", "y_px"]].to_numpy(float).reshape(edit["fish"].nunique(), -1, 2)


def count_overlaps(edit: pd.DataFrame, player: AnyPlayer) -> Ints:
    """Return how many pairs of fish overlap at each tick (ticks,) of an edit list."""
    places = fish_places(edit)
    fish_count, ticks = places.shape[:2]
    columns = [edit[name].to_numpy() for name in PlacedPicture._fields]

    def outline_at(fish: int, tick: int) -> Floats:
        """Return the outline (p, 2) of a fish on screen at a tick, px."""
        row = PlacedPicture(*(column[fish * ticks + tick] for column in columns))
        return outline_on_screen(player, row)

    pairs = np.zeros(ticks, np.int64)
    for first, second in combinations(range(fish_count), 2):
        distance = np.hypot(*(places[first] - places[second]).T)
        for tick in np.flatnonzero(distance < 2 * player.silhouettes.discs.reach).tolist():
            pairs[tick] += do_outlines_overlap(outline_at(first, tick), outline_at(second, tick))
    return pairs


def nearest_distances(places: Floats) -> Floats:
    """Return the distance (n,) of each of n ≥ 2 places (n, 2) from its nearest neighbour."""
    distances = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(distances, np.inf)
    return np.asarray(distances.min(axis=1))


def measure_clearance(edit: pd.DataFrame, player: AnyPlayer) -> dict[str, float]:
    """Return, by name, how near the fish of an edit list come to each other; {} for a single fish.

    Keys: `overlapping_pairs_per_1000_ticks`, and those of `distance_quantiles`.
    """
    places = fish_places(edit)
    if len(places) < 2:
        return {}
    distances = [nearest_distances(at_tick) for at_tick in places.transpose(1, 0, 2)]
    return {
        "overlapping_pairs_per_1000_ticks": 1000 * float(count_overlaps(edit, player).mean()),
        **distance_quantiles(np.concatenate(distances) / player.world.motion.body_length_px),
    }


def measure_film_clearance(features: pd.DataFrame) -> dict[str, float]:
    """Return, by name, how near a film's animals come to each other; {} if no frame shows several.

    Keys and units are those of `distance_quantiles`.
    """
    distances = film_nearest_distances(features)
    return distance_quantiles(distances) if len(distances) else {}


def film_nearest_distances(features: pd.DataFrame) -> Floats:
    """Return how far, in body lengths, each animal of a film is from its nearest neighbour.

    (k,): one for each row of the feature table whose frame shows several animals.
    """
    length = typical_lengths_px(features).to_numpy(float)
    places = features[["x_px", "y_px"]].to_numpy(float)
    together = [rows for rows in features.groupby("frame").indices.values() if len(rows) > 1]
    return np.concatenate(
        [np.zeros(0), *(nearest_distances(places[rows]) / length[rows] for rows in together)]
    )


def distance_quantiles(distances: Floats) -> dict[str, float]:
    """Return the quantiles 1 %, 5 % and 50 % of distances (k,) to the nearest neighbour, by name.

    The keys are `nearest_1pct_body_lengths`, `nearest_5pct_body_lengths` and
    `nearest_median_body_lengths`. Distances and quantiles are in body lengths.
    """
    values = np.quantile(distances, [0.01, 0.05, 0.5])
    names = ("nearest_1pct", "nearest_5pct", "nearest_median")
    return {f"{name}_body_lengths": float(value) for name, value in zip(names, values, strict=True)}
