"""The jumps of a film: each row's nearest neighbours, mirror images too, that also look alike."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel
from finloop.base.nearest import Nearest, assign_parts
from finloop.base.parallel import ALONE, Workers, ordered_map
from finloop.features.table import infer_delta_frames
from finloop.jumps.settings import JumpsSettings
from finloop.jumps.signature import (
    RowSource,
    compute_signature_parts,
    compute_signatures,
    draw_straight,
    measure_handedness,
    measure_side_difference,
    split_into_blocks,
    standardize_part,
)
from finloop.jumps.table import JUMPS
from finloop.jumps.visible import VisibleDistance

_BATCH = 2000  # rows whose jumps are sought at a time
_TURN = 2000  # successive rows whose jumps lead to the same part of a long film
_STRETCH = 8  # times `least`: rows of a stretch of film, which are all in one part of it
_SPARE = 8  # times `count`: nearest rows among which `count` passages are sought first


@dataclass(frozen=True)
class JumpSearch:
    """Finds for each row (a fish in a frame) the rows that look and move most alike.

    A row gets `count` neighbours, each of another passage of film: of successive rows only the
    nearest counts, and none within `least` rows of a nearer one. A jump never leads into the last
    `least` rows of a track, nor within `least` rows of where it starts.

    targets (m, d): signatures of the n rows, then of their mirror images if these are searched;
    allowed: numbers of the targets to which a jump may lead; index: of these; track (n,): ids,
    ascending; part (n,): the film's part, from `assign_parts`.
    """

    targets: Floats
    allowed: Ints
    index: Nearest
    track: Ints
    part: Ints
    count: int
    least: int

    @classmethod
    def from_values(
        cls, signatures: Floats, track: Ints, count: int, least: int, mirror: bool = True
    ) -> "JumpSearch":
        """Return the search built from signatures (2, n, d): of rows [0], of mirror images [1].

        A signature is the vector by which rows are compared. track (n,): ascending ids; count:
        neighbours of a row; least: fewest rows between them; mirror: whether jumps may lead to
        mirror images.
        """
        targets = np.ascontiguousarray(signatures[: 1 + mirror].reshape(-1, signatures.shape[-1]))
        track = np.array(track, np.int64)  # writable: one kind of array for the kernels
        can_play_on = np.searchsorted(track, track, "right") - 1 - np.arange(len(track)) >= least
        allowed = np.flatnonzero(np.tile(can_play_on, 1 + mirror))
        index = Nearest.from_vectors(targets[allowed])
        part = assign_parts(len(track), _STRETCH * least)
        return cls(targets, allowed, index, track=track, part=part, count=count, least=least)

    @property
    def part_count(self) -> int:
        """Return the number of parts into which a long film is divided."""
        return 1 + int(self.part.max())

    def __call__(self, rows: Ints) -> pd.DataFrame:
        """Return the nearest neighbours of rows (k,), ascending: a table of row, to, mirrored, far.

        The columns: a row, its neighbour, whether that is mirrored, and the distance of their
        signatures in natural steps (median distance of successive pictures). The nearest neighbour
        of a row comes first.
        """
        return self._find_nearest(rows, self.allowed, self.index)

    def search_part(self, rows: Ints, part: int) -> pd.DataFrame:
        """Return the neighbours of rows (k,) in a part of the film: row, to, mirrored, far."""
        allowed = self.allowed[self.part[self.allowed % len(self.track)] == part]
        index = Nearest.from_vectors(self.targets[allowed], len(allowed))
        return self._find_nearest(rows, allowed, index)

    def _find_nearest(self, rows: Ints, allowed: Ints, index: Nearest) -> pd.DataFrame:
        """Return a table row, to, mirrored, far: the nearest targets of rows (k,), one a passage.

        allowed: the targets to choose from; index: holds their signatures, in the same order.
        """
        choose = partial(self._choose_nearest_by_passage, rows, allowed)
        to, far = index.choose(self.targets[rows], _SPARE * self.count, choose)
        query, rank = np.nonzero(np.isfinite(far))
        to, far, n = to[query, rank], far[query, rank], len(self.track)
        return pd.DataFrame({"row": rows[query], "to": to % n, "mirrored": to >= n, "far": far})

    def _choose_nearest_by_passage(
        self, rows: Ints, allowed: Ints, queries: Ints, near: Ints
    ) -> tuple[tuple[Ints, Floats], Mask]:
        """Return for each row its `count` nearest targets, at most one of each passage of film.

        The result is these targets, their distances, both (k, count), and a mask (k,) of the rows
        that have so many. queries (k,): indices of the rows in `rows`; near (k, l): indices in
        `allowed` of the targets to choose from, −1 for none.
        """
        candidates = np.where(near < 0, -1, allowed[near])
        candidates.sort(axis=1)  # as in the film: a passage is in one piece
        targets, distances = _nearest_by_passage(
            self.targets, self.track, rows[queries], candidates, self.least, self.count
        )
        return (targets, distances), np.isfinite(distances[:, -1])


def choose_best_jumps(
    neighbours: pd.DataFrame, visible_distance: Floats, count: int
) -> pd.DataFrame:
    """Return the `count` least visible jumps of every row: columns of `JUMPS`.

    neighbours: from `JumpSearch`, k jumps, of which `far` is the distance of the signatures;
    visible_distance (k,): Euclidean distance of the pictures in one pose; both in natural steps
    (median steps of the film). The column seam, how visible a jump is, is `far` plus the square of
    the visible distance; the square is small below a natural step, where the motion hides it.
    """
    table = neighbours.assign(seam=neighbours["far"] + np.square(visible_distance))
    table = table.sort_values(["row", "seam", "to"]).groupby("row").head(count)
    return table[JUMPS.names].astype(JUMPS.pandas_dtypes).reset_index(drop=True)


@kernel
def _nearest_by_passage(
    targets: Floats, track: Ints, rows: Ints, targets_near: Ints, least: int, count: int
) -> tuple[Ints, Floats]:
    """Return the nearest targets of rows (k,), one a passage of film at most, and distances.

    Both are (k, count), −1 and infinite where there are fewer. targets (m, d): signatures; track
    (n,): ids; targets_near (k, l): the targets to choose from, ascending, −1 for none. A passage is
    a run of film: only local minima of the distance count, none within `least` rows of a nearer one
    or of the row itself.
    """
    size = targets.shape[1]
    to, far = np.full((len(rows), count), -1), np.full((len(rows), count), np.inf)
    distance = np.empty(targets_near.shape[1])
    for k in range(len(rows)):
        row = rows[k]
        for c in range(targets_near.shape[1]):
            target = targets_near[k, c]
            distance[c] = np.inf
            if target >= 0 and not _is_same_passage(track, row, target, least):
                square_sum = 0.0
                for i in range(size):
                    square_sum += (targets[row, i] - targets[target, i]) ** 2
                distance[c] = np.sqrt(square_sum)
        chosen = 0
        for c in np.argsort(distance, kind="mergesort"):
            if chosen == count or distance[c] == np.inf:
                break
            # No local minimum if a neighbour in the film is nearer; of equal ones the first is.
            has_before = c > 0 and targets_near[k, c - 1] == targets_near[k, c] - 1
            has_after = c + 1 < len(distance) and targets_near[k, c + 1] == targets_near[k, c] + 1
            if (has_before and distance[c - 1] <= distance[c]) or (
                has_after and distance[c + 1] < distance[c]
            ):
                continue
            is_new = True
            for i in range(chosen):
                is_new = is_new and not _is_same_passage(track, to[k, i], targets_near[k, c], least)
            if is_new:
                to[k, chosen], far[k, chosen] = targets_near[k, c], distance[c]
                chosen += 1
    return to, far


@kernel
def _is_same_passage(track: Ints, first: int, second: int, least: int) -> bool:
    """Return whether two targets lie in one track, on one side, less than `least` rows apart.

    track (n,): ids; first, second: numbers of targets: rows of the film, from n on their mirror
    images; the side is film or mirror image.
    """
    n = len(track)
    is_near = (first < n) == (second < n) and abs(first - second) < least
    return is_near and track[first % n] == track[second % n]


class FilmJumps(NamedTuple):
    """The jumps of a film of n rows, how its rows look, and metrics.

    jumps: the table `JUMPS`; look: numbers (n, k) for light and skin, or (2 n, k) with mirror
    images; visible: measures how different two rows look in one pose; numbers: metrics by name.
    """

    jumps: pd.DataFrame
    look: NDArray[np.float32]
    visible: VisibleDistance
    numbers: dict[str, float]


def find_film_jumps(
    source: RowSource, settings: JumpsSettings, workers: Workers = ALONE,
    advance: Callable[[int], None] = lambda _: None,
) -> FilmJumps:  # fmt: skip
    """Return the jumps from every row of a film to rows that look and move alike, and metrics.

    Mirror images are searched if the settings say so; with "auto", if both sides of the fish look
    and move alike. advance(n): called when n more rows are done.
    """
    reel, _ = source.load_film()
    track, delta = reel.features["track_id"].to_numpy(), infer_delta_frames(reel.features)
    row_parts = compute_signature_parts(source, settings, workers)
    # Whether mirror images are searched.
    side_difference = measure_side_difference(
        partial(draw_straight, source, settings.look_px), track
    )
    handedness = measure_handedness(row_parts, max(1, round(settings.block * delta)))
    sides_alike = side_difference < settings.sides_most and handedness < settings.handed_most
    mirror = settings.mirror == "yes" or (settings.mirror == "auto" and sides_alike)
    # The jumps, batch by batch.
    signatures = compute_signatures(row_parts, reel.step_ends, settings)
    least = max(1, round(settings.min_jump_deltas * delta))
    search = JumpSearch.from_values(signatures, track, settings.candidates, least, mirror)
    visible, tables = VisibleDistance.from_source(source, workers), []
    rows = split_into_blocks(len(track), _BATCH)
    find_jumps = partial(
        _find_best_jumps, source, search, visible.natural, settings.jumps_per_frame,
        min(settings.nearest, settings.jumps_per_frame),
    )  # fmt: skip
    for done, table in zip(rows, ordered_map(find_jumps, rows, workers), strict=True):
        tables.append(table)
        advance(len(done))
    jumps = pd.concat(tables, ignore_index=True)
    first, after = reel.step_ends
    steps = np.linalg.norm(signatures[0, after] - signatures[0, first], axis=-1)
    # The looks of all rows; where mirror images are searched, theirs follow.
    look = standardize_part(row_parts.look)[: 1 + mirror].reshape(-1, row_parts.look.shape[-1])
    return FilmJumps(jumps, look.astype(np.float32), visible, {
        **_jump_metrics(jumps, len(track)),
        "recall_pct": 100 * search.index.recall,
        "natural_p95_steps": float(np.quantile(steps, 0.95)),
        "sides_apart": side_difference,
        "handedness": handedness,
        "mirrored": float(mirror),
    })  # fmt: skip


def _jump_metrics(jumps: pd.DataFrame, row_count: int) -> dict[str, float]:
    """Return how many jumps there are, and how visible, by name; jumps: columns of `JUMPS`."""
    best_seams = jumps.groupby("row")["seam"].min()
    return {
        "jumps": len(jumps),
        "rows_with_jumps_pct": 100 * len(best_seams) / row_count,
        "seam_median_steps": float(jumps["seam"].median()),
        "nearest_seam_median_steps": float(best_seams.median()),
        "nearest_seam_p95_steps": float(best_seams.quantile(0.95)),
        "jumps_to_mirror_images_pct": 100 * float(jumps["mirrored"].mean()),
    }


def _find_best_jumps(
    source: RowSource, search: JumpSearch, natural_step: float, jumps_per_row: int,
    jumps_to_any_part: int, rows: Ints,
) -> pd.DataFrame:  # fmt: skip
    """Return the `jumps_per_row` least visible jumps of some rows: columns of `JUMPS`.

    natural_step: unit of the visible distance. In a long film, which has several parts,
    `jumps_to_any_part` of a row's jumps lead to the nearest rows of the whole film. The others lead
    into one part of it, another one after every 2000 rows.
    """
    postures = source.load_film()[1].pose.posture
    visible = VisibleDistance(source.picture_array(), postures, natural_step)
    parts = search.part_count

    def choose_best(neighbours: pd.DataFrame, most: int) -> pd.DataFrame:
        """Return the least visible jumps to some neighbours, at most `most` for each row."""
        return choose_best_jumps(neighbours, visible.measure_best(neighbours, most), most)

    if parts == 1 or jumps_to_any_part == jumps_per_row:
        return choose_best(search(rows), jumps_per_row)
    tables = [choose_best(search(rows), jumps_to_any_part)]
    for turn, turn_rows in pd.Series(rows).groupby(rows // _TURN):
        neighbours = search.search_part(turn_rows.to_numpy(), int(turn) % parts)
        tables.append(choose_best(neighbours, jumps_per_row - jumps_to_any_part))
    jumps = pd.concat(tables).drop_duplicates(["row", "to", "mirrored"])
    return jumps.sort_values(["row", "seam", "to"], ignore_index=True)
