"""Measures of a group of fish, for a film's feature table and for an animation alike.

Glossary: *nearest-neighbour distance* from mass centre to mass centre, in body lengths;
*polarisation* the length of the mean of the headings' unit vectors, 1 if all head the same way
(Couzin et al. 2002, eq. for p_group); *alignment angle* between a fish's heading and that of its
nearest neighbour; *inter-fish angle* the bearing of the nearest neighbour, 0 = ahead, 180 = behind.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Complex, Floats, Ints, Reals
from finloop.base.distributions import wasserstein_distance
from finloop.base.schema import Column, Schema, columns
from finloop.social.neighbours import all_neighbours, complex_vectors
from finloop.social.walls import Walls

SCHOOL = Schema(
    *columns("int32", "1", "frame", "fish"),
    *columns("float32", "body length", "neighbour_distance", nullable=True),
    *columns("float32", "deg", "alignment_deg", "inter_fish_deg", nullable=True),
    Column("wall_distance", "float32", "body length"),
    Column("polarisation", "float32", "1", nullable=True),
)
"""A row per fish per frame. Columns that need a second fish are null where there is none."""
MEASURES = tuple(SCHOOL.names[2:])

_PAIRS = 1 << 18  # of fish that are compared at a time: 24 MB, about 90 bytes each


def measure_group(frame: Ints, places: Reals, headings_deg: Reals, walls: Walls) -> pd.DataFrame:
    """Measure how fish swim together; return a table (`SCHOOL`) with a row per fish per frame.

    Distances, to the nearest fish and to the wall, are in BL, angles 0 … 180°; polarisation is the
    length of the mean heading vector of a frame's fish, 0 … 1, NaN for a lone fish. frame (n,): of
    each fish; places (n, 2): px, y down; headings_deg (n,): anticlockwise; walls: of the tank. Rows
    keep their order; the fish of a frame are numbered in that order.
    """
    # Arrays of a line per frame and a column per fish in it, NaN where a frame shows fewer.
    slots = frame_slots(frame)
    row_place, row_heading = complex_vectors(places, headings_deg, walls.length)
    place, heading = slots.to_array(row_place), slots.to_array(row_heading)
    distance, alignment, bearing = _measure_nearest_neighbours(place, heading)
    present = np.isfinite(heading)
    count = present.sum(axis=1)
    polarisation = np.abs(np.where(present, heading, 0).sum(axis=1)) / count
    polarisation[count < 2] = np.nan
    return pd.DataFrame({
        "frame": np.asarray(frame),
        "fish": slots.fish,
        "neighbour_distance": distance[slots.row, slots.fish],
        "alignment_deg": alignment[slots.row, slots.fish],
        "inter_fish_deg": bearing[slots.row, slots.fish],
        "wall_distance": walls.wall_distance(row_place),
        "polarisation": polarisation[slots.row],
    }).astype(SCHOOL.pandas_dtypes)[SCHOOL.names]  # fmt: skip


def _measure_nearest_neighbours(place: Complex, heading: Complex) -> tuple[Floats, Floats, Floats]:
    """Return distance [BL], alignment and inter-fish angle [°] of each fish's nearest neighbour.

    Alignment is the angle between both headings, the inter-fish angle that between the heading of
    the fish and the direction to its neighbour; both 0 … 180. place, heading (frames, m): complex,
    BL and unit vectors, NaN for absent fish. The results are (frames, m), NaN where a frame shows
    no other fish.
    """
    distances, alignments, bearings = np.full((3, *place.shape), np.nan)
    block_frames = max(1, _PAIRS // max(1, place.shape[1] ** 2))
    for first in range(0, len(place) if place.shape[1] else 0, block_frames):
        block = slice(first, first + block_frames)
        seen = all_neighbours(place[block], heading[block])
        nearest = seen.distance.argmin(axis=-1)[..., None]
        distance, bearing, other_heading = (
            np.take_along_axis(part, nearest, -1)[..., 0] for part in seen
        )
        has_other = np.isfinite(distance)
        distances[block] = np.where(has_other, distance, np.nan)
        for angles, vector in ((alignments, other_heading), (bearings, bearing)):
            angles[block] = np.where(has_other, np.degrees(np.abs(np.angle(vector))), np.nan)
    return distances, alignments, bearings


class FrameSlots(NamedTuple):
    """The row and column of each of n fish of a table in an array with a row per frame.

    row (n,): of its frame in the array; fish (n,): number of the fish in its frame, from 0; shape:
    of the array, its rows and the most fish in a frame.
    """

    row: Ints
    fish: Ints
    shape: tuple[int, int]

    def to_array(self, values: Complex) -> Complex:
        """Arrange a table's values (n,) in an array with a row per frame and a column per fish.

        It is NaN where a frame shows fewer fish.
        """
        array = np.full(self.shape, np.nan, complex)
        array[self.row, self.fish] = values
        return array


def frame_slots(frame: Ints) -> FrameSlots:
    """Return the row and column of each fish of a table in an array with a row per frame.

    The fish of a frame fill its row from the left.
    """
    frames, row = np.unique(frame, return_inverse=True)
    fish = pd.Series(row).groupby(row).cumcount().to_numpy()
    return FrameSlots(row, fish, (len(frames), int(fish.max()) + 1 if len(fish) else 0))


def wasserstein_distances(first: pd.DataFrame, second: pd.DataFrame) -> dict[str, float]:
    """Return how far the measures of two groups differ, as Wasserstein distances in their units.

    Polarisation counts once a frame. A measure that a group lacks is left out.
    """
    distances = {}
    for name in MEASURES:
        a, b = values_of_measure(first, name), values_of_measure(second, name)
        if len(a) and len(b):
            distances[name] = wasserstein_distance(a, b)
    return distances


def compare_groups(
    films: Mapping[str, pd.DataFrame], shoals: Mapping[str, pd.DataFrame]
) -> pd.DataFrame:
    """Return a table of the distances between the measures of simulated groups and of films.

    It has one row per group, film and measure: shoal, beside (the film), measure, median (of the
    group), distance (Wasserstein's, in the unit of the measure). films, shoals: their tables of
    measures, `SCHOOL`, by name. A measure that a group or film lacks is left out.
    """
    rows = [
        (shoal, film, name, float(np.median(values_of_measure(table, name))), distance)
        for shoal, table in shoals.items()
        for film, filmed in films.items()
        for name, distance in wasserstein_distances(filmed, table).items()
    ]
    return pd.DataFrame(rows, columns=["shoal", "beside", "measure", "median", "distance"])


def split_in_halves(table: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Split a table of `SCHOOL` into the first and the second half of the film's time."""
    first = table["frame"] < middle_frame(table["frame"].to_numpy())
    return table[first], table[~first]


def middle_frame(frame: Ints) -> float:
    """Return the frame number in the middle of the film's time.

    frame (n,): numbers of the frames that show fish.
    """
    return (int(frame.min()) + int(frame.max()) + 1) / 2


def values_of_measure(table: pd.DataFrame, name: str) -> Floats:
    """Return the values (k,) of one measure in a table, without missing ones.

    Polarisation, which is equal for all fish of a frame, counts once a frame.
    """
    rows = table.drop_duplicates("frame") if name == "polarisation" else table
    return rows[name].dropna().to_numpy(float)
