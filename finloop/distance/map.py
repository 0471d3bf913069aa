"""Distance maps of a film (fish paper §4.1, Fig. 9): every pair (Eq. 5), or similar pairs (Eq. 6).

Glossary: x (n, k) float32, a picture a row, about their mean; *kind* (n,) a number that frames of
one orientation and swimming type share (Eq. 7); *area* (n,) the motion area (Eq. 8).

‖a − b‖² = ‖a‖² + ‖b‖² − 2ab turns a map into a matrix product. Against cancellation, pictures are
taken about their mean, and pairs too close for float32 are computed again.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Mask, Reals
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema
from finloop.distance.picture import FILM

EXACT = 1e-4
"""Largest error of a distance between pictures of values 0 … 1."""

_SIDE = 1024  # side of a block of the full map; in smaller ones threads wait for each other
_BAND = 128  # frames of a band; more would compute more pairs that differ too much in area
_LOSS = 16 * np.finfo(np.float32).eps  # error of a squared distance, over ‖a‖² + ‖b‖²; half occurs
_CHUNK = 2**22  # numbers gathered at a time for pairs measured one by one
_MANY = 1 / 64  # share of a block; if more pairs are close, the whole block is computed again

Ints = NDArray[np.intp]
Picture = NDArray[np.float32]

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

step: to the frame a natural step later (`features.table.step_of`), in the pose of the map; its
median over the film is the unit of loops and gateways. headed: to the same frame, both headed to
the right; its median is the unit of the seams of an animation. as_filmed: to the next frame,
without turning the fish.
"""


@dataclass(frozen=True)
class MapFacts:
    """How a distance map was made, and its unit: the median natural step.

    pose: FILM or BODY; size: px, side of the pictures; keep: largest distance stored, in median
    natural steps, None: all pairs that Eq. 6 compares; step_median, step_p95: distances (Eq. 5).
    """

    pose: str
    size: int
    area_threshold: float
    keep: float | None
    step_median: float
    step_p95: float


class Block(NamedTuple):
    """A rectangle of a distance map: its range of rows and its range of columns."""

    rows: slice
    columns: slice


class PicturePairs(NamedTuple):
    """Pairs of pictures (k,): the row numbers a and b in x, and their picture distance (Eq. 5)."""

    a: Ints
    b: Ints
    distance: NDArray[np.float32]


def about_mean(pictures: Picture) -> Picture:
    """Return x (n, k): pictures (n, …) as rows, minus their mean; the input is overwritten.

    That saves the memory of a copy.
    """
    x = pictures.reshape(len(pictures), -1)
    x -= x.mean(axis=0)
    return x


def pair_distances(x: Picture, a: Ints, b: Ints) -> NDArray[np.float32]:
    """Return the picture distances (k,) (Eq. 5) between rows a (k,) and b (k,) of x."""
    distances = np.empty(len(a), np.float32)
    lot = max(1, _CHUNK // x.shape[1])
    for start in range(0, len(a), lot):
        here = slice(start, start + lot)
        distances[here] = np.linalg.norm(x[a[here]] - x[b[here]], axis=1)
    return distances


# --- Eq. 5, all pairs


def full_distance_map(pictures: Picture) -> Picture:
    """Return the complete distance map (n, n) of pictures (n, …): Eq. 5 for all pairs."""
    x = pictures.reshape(len(pictures), -1)
    x = x - x.mean(axis=0)
    norms = _norms(x)
    distances = np.empty((len(x), len(x)), np.float32)
    for rows in _lots(0, len(x), _SIDE):
        for columns in _lots(rows.start, len(x), _SIDE):  # the map is symmetric
            block = _distance_squares(x, norms, Block(rows, columns))
            if rows == columns:
                np.fill_diagonal(block, np.inf)  # not measured again
            _sharpen(x, norms, Block(rows, columns), block)
            if rows == columns:  # a kernel may round a product and its transpose differently
                block = np.triu(block, 1)
                block += block.T
            np.sqrt(block, out=block)
            distances[rows, columns] = block
            distances[columns, rows] = block.T
    return distances


def _lots(start: int, stop: int, most: int) -> Iterator[slice]:
    yield from (slice(a, min(a + most, stop)) for a in range(start, stop, most))


def _norms(x: Picture) -> NDArray[np.float32]:
    """Return squared norms (n,), summed in float64: einsum's float32 sums lose three digits."""
    return np.einsum("nk,nk->n", x, x, dtype=np.float64).astype(np.float32)


def _distance_squares(x: Picture, norms: NDArray[np.float32], at: Block) -> Picture:
    """Return the squares of Eq. 5 in a block, as a matrix product leaves them."""
    columns = x[at.columns].T
    if at.rows == at.columns:
        columns = columns.copy()  # numpy is slow for a product with the same memory
    block = x[at.rows] @ columns
    block *= -2
    block += norms[at.rows, None] + norms[at.columns]
    return np.maximum(block, 0, out=block)


def _sharpen(x: Picture, norms: NDArray[np.float32], at: Block, block: Picture) -> None:
    """Compute again, in place, the squares whose root would be off by more than EXACT.

    An error e of a square d² is an error e / 2d of its root.
    """
    share = _LOSS / (2 * EXACT)
    if block.min() >= (share * (norms[at.rows].max() + norms[at.columns].max())) ** 2:
        return
    limit = norms[at.rows, None] + norms[at.columns]
    limit *= share
    close = block < np.square(limit, out=limit)
    count = np.count_nonzero(close)
    if count > _MANY * block.size:  # a fish that does not move
        wide = x[at.rows].astype(np.float64), x[at.columns].astype(np.float64)
        squares = [np.einsum("nk,nk->n", w, w) for w in wide]
        exact = squares[0][:, None] + squares[1] - 2 * (wide[0] @ wide[1].T)
        block[close] = np.maximum(exact[close], 0)
    elif count:
        a, b = np.nonzero(close)
        block[close] = pair_distances(x, a + at.rows.start, b + at.columns.start) ** 2


# --- Eq. 6: like with like


def frame_kinds(features: pd.DataFrame, pose: str) -> Ints:
    """Return a number (n,) for each row's kind: Eq. 6 compares only frames of equal kind (Eq. 7).

    It stands for the swimming type; in the pose FILM also for the orientation, for there pictures
    differ because a fish is turned.
    """
    swims = features["swimming_type"].to_numpy(np.intp)
    return 3 * features["orientation"].to_numpy(np.intp) * (pose == FILM) + swims


def comparable_pairs(kind: Ints, area: Reals, threshold: float) -> Mask:
    """Return which pairs (n, n) Eq. 6 compares: equal kinds (Eq. 7), similar motion areas (Eq. 8).

    kind (n,): from `frame_kinds`; area (n,): relative motion areas; threshold: their largest
    difference.
    """
    return (kind[:, None] == kind) & _near(area, area, threshold)


def _near(a: Reals, b: Reals, threshold: float) -> Mask:
    return np.abs(a.astype(float)[:, None] - b.astype(float)) <= threshold


def sort_by_kind_and_area(kind: Ints, area: Reals) -> Ints:
    """Return row numbers (n,) sorted by kind, then motion area: Eq. 6 becomes a diagonal band."""
    return np.lexsort((area, kind))


def comparison_blocks(kind: Ints, area: Reals, threshold: float) -> Iterator[Block]:
    """Yield the blocks of the map that hold every pair a < b that Eq. 6 compares, each pair once.

    kind, area (n,): of frames sorted by `sort_by_kind_and_area`; threshold: largest difference of
    motion area.
    """
    area = area.astype(float)
    edges = [0, *(np.flatnonzero(np.diff(kind)) + 1), len(kind)]
    for start, stop in pairwise(edges):
        for rows in _lots(start, stop, _BAND):
            # Slightly wider than the threshold: the exact test comes after the product.
            far = np.nextafter(area[rows.stop - 1] + threshold, np.inf)
            end = start + int(np.searchsorted(area[start:stop], far, "right"))
            yield from (Block(rows, c) for c in _lots(rows.start, end, 8 * _BAND))


def count_pairs(blocks: Iterable[Block]) -> int:
    """Count the pairs a < b (row number less than column number) that lie in blocks."""
    count = 0
    for rows, columns in blocks:
        a = np.arange(rows.start, rows.stop)
        count += int((columns.stop - np.maximum(a + 1, columns.start)).clip(0).sum())
    return count


def find_similar_pairs(
    x: Picture, kind: Ints, area: Reals, threshold: float, most: float = np.inf
) -> Iterator[PicturePairs]:
    """Yield, block by block, the pairs a < b that Eq. 6 compares and that are at most `most` apart.

    x: from `about_mean`; kind, area (n,): of its frames, which are sorted by
    `sort_by_kind_and_area`; threshold: of the motion area (Eq. 8); most: a distance (Eq. 5). Memory
    does not grow with the number of pairs.
    """
    norms = _norms(x)
    for at in comparison_blocks(kind, area, threshold):
        block = _distance_squares(x, norms, at)
        rows, columns = (np.arange(part.start, part.stop) for part in at)
        compared = _near(area[at.rows], area[at.columns], threshold) & (rows[:, None] < columns)
        block[~compared] = np.inf
        _sharpen(x, norms, at, block)
        a, b = np.nonzero(compared & (block <= most**2))
        yield PicturePairs(rows[a], columns[b], np.sqrt(block[a, b]))


def pair_table(pairs: Iterable[PicturePairs], rows: Ints) -> pd.DataFrame:
    """Return pairs as a table (schema `PAIRS`): i < j are feature rows, sorted by i, then by j.

    pairs: numbers of compared frames; rows: the feature row of each of these.
    """
    row = rows.astype(np.int32)  # before indexing: a long film has tens of millions of pairs
    parts = [(row[a], row[b], distance) for a, b, distance in pairs]
    a, b, distance = map(np.concatenate, zip(*parts, strict=True))
    del parts
    i, j = np.minimum(a, b), np.maximum(a, b)
    del a, b
    first = np.argsort(i * (rows.max() + np.int64(1)) + j)
    return pd.DataFrame({"i": i[first], "j": j[first], "distance": distance[first]})


# --- natural steps


def step_table(features: pd.DataFrame, x: Picture, place: Ints, frames: int = 1) -> pd.DataFrame:
    """Return the natural steps: Eq. 5 from each row to that `frames` later in its track.

    features (n rows); x: pictures as rows; place (n,): each row's place in x. Columns: track_id,
    frame, step; step is NaN where the track has no such frame.
    """
    here = features[["track_id", "frame"]]
    follows = here["track_id"].diff(frames).eq(0) & here["frame"].diff(frames).eq(frames)
    after = np.flatnonzero(follows)
    step = np.full(len(here), np.nan, np.float32)
    step[after - frames] = pair_distances(x, place[after - frames], place[after])
    return here.assign(step=step)


def map_rows(features: pd.DataFrame, steps: pd.DataFrame) -> Ints:
    """Return the feature rows (k,) that the distance map holds: those that STEPS lists."""
    here, there = (
        table["track_id"].to_numpy(np.int64) << 32 | table["frame"].to_numpy(np.int64)
        for table in (features, steps)
    )
    return np.flatnonzero(np.isin(here, there))


def usual_steps(steps: pd.DataFrame) -> tuple[float, float]:
    """Return the median and the 95th percentile of the natural steps (Eq. 5), column step of STEPS.

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
