"""Distance maps of a film (fish paper §4.1, Fig. 9): every pair (Eq. 5), or similar pairs (Eq. 6).

Glossary: x (n, k) float32, a picture a row, about their mean; *kind* (n,) a number that frames of
one orientation and swimming type share (Eq. 7); *area* (n,) the motion area (Eq. 8).

‖a − b‖² = ‖a‖² + ‖b‖² − 2ab turns a map into a matrix product. Against cancellation, pictures are
taken about their mean, and pairs too close for float32 are computed again.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Mask, Reals
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema
from finloop.base.stretches import sample_stretches
from finloop.distance.picture import BODY, FILM
from finloop.distance.reel import Reel
from finloop.distance.settings import DistanceSettings
from finloop.features.table import natural_step_frames

EXACT = 1e-4
"""Largest error of a distance between pictures of values 0 … 1."""

_SIDE = 1024  # side of a block of the full map; in smaller ones threads wait for each other
_BAND = 128  # frames of a band; more would compute more pairs that differ too much in area
_LOSS = 16 * np.finfo(np.float32).eps  # error of a squared distance, over ‖a‖² + ‖b‖²; half occurs
_CHUNK = 2**22  # numbers gathered at a time for pairs measured one by one
_MANY = 1 / 64  # share of a block; if more pairs are close, the whole block is computed again
_STRETCHES = 20  # least stretches of a film that is too long for a complete map

Ints = NDArray[np.intp]
Float32s = NDArray[np.float32]

PAIRS = Schema(
    Column("i", "int32", "1"), Column("j", "int32", "1"), Column("distance", "float32", "1")
)
STEPS = Schema(
    Column("track_id", "int32", "1"),
    Column("frame", "int32", "1"),
    Column("step", "float32", "1", nullable=True),
    Column("headed", "float32", "1", nullable=True),
    Column("as_filmed", "float32", "1", nullable=True),
)
"""Eq. 5 from every mapped row to a later frame of its track, null where there is none.

step: to the frame a natural step later (`features.table.natural_step_frames`), in the map's
frame of reference; its median over the film is the unit of loops and gateways. headed: to the same
frame, both headed to the right; its median is the unit of the seams of an animation. as_filmed: to
the next frame, without turning the fish.
"""


@dataclass(frozen=True)
class MapFacts:
    """How a map of picture distances was made, and its unit: the film's median step.

    frame_of_reference: FILM or BODY; size: px, side of the pictures; keep: largest distance stored,
    in median steps, None: all pairs that Eq. 6 compares; step_median, step_p95: distances (Eq. 5)
    between successive pictures.
    """

    frame_of_reference: str
    size: int
    area_threshold: float
    keep: float | None
    step_median: float
    step_p95: float


class MapBlock(NamedTuple):
    """A rectangle of a distance map: its range of rows and its range of columns."""

    rows: slice
    columns: slice


class FrameComparison(NamedTuple):
    """Which frames of a film look alike: tables `PAIRS` and `STEPS`, and how they were made."""

    pairs: pd.DataFrame
    steps: pd.DataFrame
    facts: MapFacts


class PicturePairs(NamedTuple):
    """Pairs of pictures, (k,) each: their row numbers a and b in x, and their distance (Eq. 5)."""

    a: Ints
    b: Ints
    distance: Float32s


def subtract_mean_picture(pictures: Float32s) -> Float32s:
    """Subtract the mean picture from pictures (n, …), in place; return a view of them as (n, k)."""
    x = pictures.reshape(len(pictures), -1)
    x -= x.mean(axis=0)
    return x


def _distances_of_pairs(x: Float32s, a: Ints, b: Ints) -> Float32s:
    """Return the picture distances (k,) (Eq. 5) of rows a, b (k,) of the pictures x (n, m)."""
    distances = np.empty(len(a), np.float32)
    batch_size = max(1, _CHUNK // x.shape[1])
    for start in range(0, len(a), batch_size):
        batch = slice(start, start + batch_size)
        distances[batch] = np.linalg.norm(x[a[batch]] - x[b[batch]], axis=1)
    return distances


# --- Eq. 5, all pairs


def full_distance_map(pictures: Float32s) -> Float32s:
    """Return the Euclidean distances (n, n) between all pairs of pictures (n, …) (Eq. 5)."""
    x = pictures.reshape(len(pictures), -1)
    x = x - x.mean(axis=0)
    norms = _squared_norms(x)
    distances = np.empty((len(x), len(x)), np.float32)
    for rows in _split_range(0, len(x), _SIDE):
        for columns in _split_range(rows.start, len(x), _SIDE):  # the map is symmetric
            block = _squared_distances(x, norms, MapBlock(rows, columns))
            if rows == columns:
                np.fill_diagonal(block, np.inf)  # so that it is not recomputed; it becomes 0 below
            _recompute_small_squares(x, norms, MapBlock(rows, columns), block)
            if rows == columns:  # a kernel may round a product and its transpose differently
                block = np.triu(block, 1)
                block += block.T
            np.sqrt(block, out=block)
            distances[rows, columns] = block
            distances[columns, rows] = block.T
    return distances


def _split_range(start: int, stop: int, most_length: int) -> Iterator[slice]:
    """Yield successive slices, at most `most_length` long, from `start` to `stop`."""
    yield from (slice(a, min(a + most_length, stop)) for a in range(start, stop, most_length))


def _squared_norms(x: Float32s) -> Float32s:
    """Return the squared norms (n,) of rows x (n, k).

    They are summed in float64: einsum's float32 sums lose three digits.
    """
    return np.einsum("nk,nk->n", x, x, dtype=np.float64).astype(np.float32)


def _squared_distances(x: Float32s, norms: Float32s, rectangle: MapBlock) -> Float32s:
    """Return the squared picture distances (Eq. 5) in a rectangle of the map, with rounding errors.

    They come from a matrix product.
    """
    columns = x[rectangle.columns].T
    if rectangle.rows == rectangle.columns:
        columns = columns.copy()  # numpy is slow for a product with the same memory
    block = x[rectangle.rows] @ columns
    block *= -2
    block += norms[rectangle.rows, None] + norms[rectangle.columns]
    return np.maximum(block, 0, out=block)


def _recompute_small_squares(
    x: Float32s, norms: Float32s, rectangle: MapBlock, block_squares: Float32s
) -> None:
    """Recompute small squared distances, in place, whose roots rounding errors would spoil.

    block_squares: squared distances in a rectangle of the map; those whose root may be off by more
    than EXACT are replaced. An error e of a square d² is an error e / 2d of its root, and e is up
    to _LOSS (‖a‖² + ‖b‖²): d is too small below least_d = factor (‖a‖² + ‖b‖²).
    """
    rows, columns = rectangle
    # Which squares are too small; mostly none.
    factor = _LOSS / (2 * EXACT)
    if block_squares.min() >= (factor * (norms[rows].max() + norms[columns].max())) ** 2:
        return
    least_d = norms[rows, None] + norms[columns]
    least_d *= factor
    close = block_squares < np.square(least_d, out=least_d)
    count = np.count_nonzero(close)
    if count > _MANY * block_squares.size:  # a fish that does not move: all in float64
        a, b = x[rows].astype(np.float64), x[columns].astype(np.float64)
        a_squares, b_squares = (np.einsum("nk,nk->n", part, part) for part in (a, b))
        exact = a_squares[:, None] + b_squares - 2 * (a @ b.T)
        block_squares[close] = np.maximum(exact[close], 0)
    elif count:
        i, j = np.nonzero(close)
        block_squares[close] = _distances_of_pairs(x, i + rows.start, j + columns.start) ** 2


# --- Eq. 6: like with like


def find_frame_kinds(features: pd.DataFrame, reference: str) -> Ints:
    """Return the kind (n,) of each row as a number; only rows of one kind are compared (Eqs. 6, 7).

    Rows of one kind have the same swimming type (−1, 0 or 1) and, in the frame of reference FILM,
    where turned fish differ, the same orientation.
    """
    swimming_type = features["swimming_type"].to_numpy(np.intp)
    orientation = features["orientation"].to_numpy(np.intp)
    three_kinds_each = 3 * orientation + swimming_type  # the swimming type is −1, 0 or 1
    return three_kinds_each if reference == FILM else swimming_type


def find_comparable_pairs(kind: Ints, area: Reals, threshold: float) -> Mask:
    """Return a mask (n, n) of the pairs to compare: equal kinds and similar motion areas.

    Kinds are those of Eq. 7, areas those of Eq. 8.
    """
    return (kind[:, None] == kind) & _have_similar_areas(area, area, threshold)


def _have_similar_areas(a: Reals, b: Reals, threshold: float) -> Mask:
    """Return a mask (n, m) of the motion areas (n,) and (m,) that differ by at most `threshold`."""
    return np.abs(a.astype(float)[:, None] - b.astype(float)) <= threshold


def sort_by_kind_and_area(kind: Ints, area: Reals) -> Ints:
    """Return row numbers (n,) sorted by kind, then motion area, so comparable rows are near."""
    return np.lexsort((area, kind))


def find_comparison_blocks(kind: Ints, area: Reals, threshold: float) -> Iterator[MapBlock]:
    """Yield blocks of the distance map that hold every pair a < b to be compared (Eq. 6) once.

    kind, area (n,): sorted by `sort_by_kind_and_area`; threshold: of two areas (Eq. 8).
    """
    area = area.astype(float)
    edges = [0, *(np.flatnonzero(np.diff(kind)) + 1), len(kind)]
    for start, stop in pairwise(edges):
        for rows in _split_range(start, stop, _BAND):
            # Slightly wider than the threshold: the exact test comes after the product.
            greatest_area = np.nextafter(area[rows.stop - 1] + threshold, np.inf)
            end = start + int(np.searchsorted(area[start:stop], greatest_area, "right"))
            for columns in _split_range(rows.start, end, 8 * _BAND):  # bounds the memory of a block
                yield MapBlock(rows, columns)


def count_pairs(blocks: Iterable[MapBlock]) -> int:
    """Count the pairs a < b (row number less than column number) that lie in blocks."""
    count = 0
    for rows, columns in blocks:
        a = np.arange(rows.start, rows.stop)
        count += int((columns.stop - np.maximum(a + 1, columns.start)).clip(0).sum())
    return count


def find_similar_pairs(
    x: Float32s, kind: Ints, area: Reals, threshold: float, most_distance: float = np.inf
) -> Iterator[PicturePairs]:
    """Yield, block by block, the pairs a < b that are comparable (Eq. 6) and look alike.

    x (n, k): the pictures, and their kind and area (n,), in the order of `sort_by_kind_and_area`.
    Comparable are pictures of one kind whose
    areas differ by at most `threshold` (Eqs. 6-8); alike are those at most `most_distance` apart
    (Eq. 5). Memory does not grow with the number of pairs.
    """
    norms = _squared_norms(x)
    for rectangle in find_comparison_blocks(kind, area, threshold):
        block = _squared_distances(x, norms, rectangle)
        rows, columns = (np.arange(part.start, part.stop) for part in rectangle)
        is_compared = _have_similar_areas(
            area[rectangle.rows], area[rectangle.columns], threshold
        ) & (rows[:, None] < columns)
        block[~is_compared] = np.inf
        _recompute_small_squares(x, norms, rectangle, block)
        a, b = np.nonzero(is_compared & (block <= most_distance**2))
        yield PicturePairs(rows[a], columns[b], np.sqrt(block[a, b]))


def pair_table(pairs: Iterable[PicturePairs], rows: Ints) -> pd.DataFrame:
    """Return pairs of similar pictures as a table (schema `PAIRS`), sorted by i, then by j.

    rows: the feature row of each picture.
    """
    # A long film has tens of millions of pairs: 32 bits, and arrays no longer needed are deleted.
    row = rows.astype(np.int32)
    parts = [(row[a], row[b], distance) for a, b, distance in pairs]
    a, b, distance = map(np.concatenate, zip(*parts, strict=True))
    del parts
    i, j = np.minimum(a, b), np.maximum(a, b)
    del a, b
    order = np.argsort(i * (rows.max() + np.int64(1)) + j)  # one number for each i and j
    return pd.DataFrame({"i": i[order], "j": j[order], "distance": distance[order]})


# --- natural steps


def natural_step_table(
    features: pd.DataFrame, x: Float32s, picture_row: Ints, step_frames: int
) -> pd.DataFrame:
    """Measure natural steps: the change of the picture from each row to a later frame (Eq. 5).

    features (n rows); x: pictures as rows; picture_row (n,): the row of x with the picture of each
    row of `features`; step_frames: how many frames later. Columns: track_id, frame, and step (the
    distance), which is NaN where the track has no such frame.
    """
    table = features[["track_id", "frame"]]
    follows = (table.diff(step_frames).to_numpy() == (0, step_frames)).all(axis=1)
    later = np.flatnonzero(follows)
    step = np.full(len(table), np.nan, np.float32)
    earlier = later - step_frames
    step[earlier] = _distances_of_pairs(x, picture_row[earlier], picture_row[later])
    return table.assign(step=step)


def find_map_rows(features: pd.DataFrame, steps: pd.DataFrame) -> Ints:
    """Return the numbers (k,) of the feature rows that the table `steps` (schema STEPS) lists."""
    of_features, of_steps = (
        pd.MultiIndex.from_frame(table[["track_id", "frame"]]) for table in (features, steps)
    )
    return np.flatnonzero(of_features.isin(of_steps))


def measure_usual_steps(steps: pd.DataFrame) -> tuple[float, float]:
    """Return the median and the 95th percentile of the steps (Eq. 5) in a table (schema STEPS).

    FinloopError if the film does not move, or no frame follows another: then steps are no unit.
    """
    step = steps["step"].dropna()
    if not len(step) or step.median() == 0:
        raise FinloopError(
            f"of {len(step)} steps from a frame to the next at least half change nothing",
            "a film in which the fish moves, each frame once",
            "use a clip without doubled frames (dvc exp run -S clip.source=...), or raise "
            "distance.picture_size_px where the fish is small",
        )
    return float(step.median()), float(step.quantile(0.95))


# --- the comparison of a film


class SortedRows(NamedTuple):
    """The n rows of a film that are compared, and the order in which they are.

    rows (n,): feature rows, ascending. order (n,): places in `rows`, sorted by kind, then motion
    area. kind, area (n,): in that order.
    """

    rows: Ints
    order: Ints
    kind: Ints
    area: Reals


def list_map_blocks(features: pd.DataFrame, settings: DistanceSettings) -> list[MapBlock]:
    """Return the blocks of the distance map that `compare_frames` computes, in their order.

    Their rows and columns count the compared rows, sorted by `sort_by_kind_and_area`.
    """
    compared = _choose_and_sort_rows(features, settings)
    return list(
        find_comparison_blocks(compared.kind, compared.area, settings.motion_area_threshold)
    )


def _choose_and_sort_rows(features: pd.DataFrame, settings: DistanceSettings) -> SortedRows:
    """Choose the rows to compare, all or stretches of a long film, and sort them.

    Stretches are drawn at random until they have `max_rows` rows.
    """
    most_rows, track = settings.max_rows, features["track_id"].to_numpy()
    stretches = sample_stretches(track, max(2, most_rows // _STRETCHES), most_rows, seed=0)
    rows = np.concatenate([np.arange(stretch.start, stretch.stop) for stretch in stretches])
    features = features.iloc[rows]
    kind = find_frame_kinds(features, settings.frame_of_reference)
    area = features["motion_area_rel"].to_numpy()
    order = sort_by_kind_and_area(kind, area)
    return SortedRows(rows, order, kind[order], area[order])


def compare_frames(
    film: Reel, settings: DistanceSettings, advance: Callable[[], object] = lambda: None
) -> FrameComparison:
    """Return all pairs of similar frames of a film (Eqs. 5-8), and its steps from frame to frame.

    advance(): called after each block. In a film of more than `settings.max_rows` rows only
    stretches are compared. FinloopError if the film does not move.
    """
    size, reference = settings.picture_size_px, settings.frame_of_reference
    rows, order, kind, area = _choose_and_sort_rows(film.features, settings)
    features, later = film.features.iloc[rows], natural_step_frames(film.features)
    # Pictures are sorted by kind and area, so those to be compared are slices: no copy is needed.
    x = subtract_mean_picture(film.draw_rows(rows[order], size, reference))
    # The steps in three frames of reference (see `STEPS`); their median is the unit of distances.
    steps = natural_step_table(features, x, np.argsort(order), later)
    steps["headed"] = steps["step"]
    if reference == FILM:
        headed = subtract_mean_picture(film.draw_rows(rows, size, BODY))
        steps["headed"] = natural_step_table(features, headed, np.arange(len(rows)), later)["step"]
        del headed  # as large as x
    steps["as_filmed"] = film.measure_steps(size, FILM, rows)
    median, p95 = measure_usual_steps(steps)
    # The similar pairs.
    most_steps, threshold = settings.max_distance_steps, settings.motion_area_threshold
    most_distance = np.inf if most_steps is None else most_steps * median

    def report_blocks(blocks: Iterable[PicturePairs]) -> Iterator[PicturePairs]:
        """Yield the blocks of pairs unchanged; call `advance` after each."""
        for block in blocks:
            yield block
            advance()

    blocks = find_similar_pairs(x, kind, area, threshold, most_distance)
    pairs = pair_table(report_blocks(blocks), rows[order])
    facts = MapFacts(reference, size, threshold, most_steps, step_median=median, step_p95=p95)
    return FrameComparison(pairs, steps, facts)
