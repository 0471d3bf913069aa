"""The jumps of a film, the looks of its rows, and metrics about them."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Ints
from finloop.base.parallel import ALONE, Workers, ordered_map
from finloop.features.table import delta_of
from finloop.jumps.search import Search, best_jumps
from finloop.jumps.settings import JumpsSettings
from finloop.jumps.sides import handedness, sides_apart
from finloop.jumps.signature import (
    StraightPictures,
    blocks,
    signature_parts,
    signatures,
    standardize,
)
from finloop.jumps.source import RowSource
from finloop.jumps.visible import VisibleDistance

_LOT = 2000  # rows at a time
_TURN = 2000  # rows whose jumps lead to one part of a long film


class FilmJumps(NamedTuple):
    """The jumps of a film of n rows, how its rows look, and metrics.

    jumps: the table `JUMPS`; look: (n, k), or (2 n, k) with mirror images, the table `LOOK`;
    visible: measures the visible distance of any two rows; numbers: metrics by name.
    """

    jumps: pd.DataFrame
    look: NDArray[np.float32]
    visible: VisibleDistance
    numbers: dict[str, float]


def film_jumps(
    source: RowSource, settings: JumpsSettings, workers: Workers = ALONE,
    advance: Callable[[int], None] = lambda _: None,
) -> FilmJumps:  # fmt: skip
    """Find the jumps from every row of a film, and measure how its rows look.

    A fish whose sides differ is not mirrored, unless the settings say so. advance(n): called when n
    more rows are done.
    """
    reel, _ = source.film()
    track = reel.features["track_id"].to_numpy()
    row_parts = signature_parts(source, settings, workers)
    block = max(1, round(settings.block * delta_of(reel.features)))
    sides = sides_apart(StraightPictures(source, settings.look_px), track)
    hand = handedness(row_parts, block)
    alike = sides < settings.sides_most and hand < settings.handed_most
    mirror = settings.mirror == "yes" or (settings.mirror == "auto" and alike)
    values = signatures(row_parts, reel.step_ends, settings)
    least = max(1, round(settings.min_jump_deltas * delta_of(reel.features)))
    search = Search.from_values(values, track, settings.candidates, least, mirror)
    visible, tables = VisibleDistance.from_source(source, workers), []
    rows = blocks(len(track), _LOT)
    counts = settings.jumps_per_frame, min(settings.nearest, settings.jumps_per_frame)
    best_of = partial(_best_jumps, source, search, visible.natural, counts)
    for lot, table in zip(rows, ordered_map(best_of, rows, workers), strict=True):
        tables.append(table)
        advance(len(lot))
    jumps = pd.concat(tables, ignore_index=True)
    first, later = reel.step_ends
    step = np.linalg.norm(values[0, later] - values[0, first], axis=-1)
    best = jumps.groupby("row")["seam"].min()
    look = standardize(row_parts.look)[: 1 + mirror].reshape(-1, row_parts.look.shape[-1])
    return FilmJumps(jumps, look.astype(np.float32), visible, {
        "jumps": len(jumps),
        "rows_with_jumps_pct": 100 * len(best) / len(track),
        "seam_median_steps": float(jumps["seam"].median()),
        "nearest_seam_median_steps": float(best.median()),
        "nearest_seam_p95_steps": float(best.quantile(0.95)),
        "recall_pct": 100 * search.index.recall,
        "natural_p95_steps": float(np.quantile(step, 0.95)),
        "sides_apart": sides,
        "handedness": hand,
        "mirrored": float(mirror),
        "jumps_to_mirror_images_pct": 100 * float(jumps["mirrored"].mean()),
    })  # fmt: skip


def _best_jumps(
    source: RowSource, search: Search, natural: float, counts: tuple[int, int], rows: Ints
) -> pd.DataFrame:
    """Return the best jumps of rows. natural: see `VisibleDistance`.

    counts: their number; and in a film of several parts, how many of them lead to the nearest rows
    of all. The others lead to one part, of `_TURN` successive rows to the same one, then to the
    next.
    """
    visible = VisibleDistance(source.pictures(), source.film()[1].pose.posture, natural)
    (count, few), parts = counts, search.parts

    def best(near: pd.DataFrame, most: int) -> pd.DataFrame:
        return best_jumps(near, visible.best(near, most), most)

    if parts == 1 or few == count:
        return best(search(rows), count)
    tables = [best(search(rows), few)]
    for turn, some in pd.Series(rows).groupby(rows // _TURN):
        near = search.in_part(some.to_numpy(), int(turn) % parts)
        tables.append(best(near, count - few))
    both = pd.concat(tables).drop_duplicates(["row", "to", "mirrored"])
    return both.sort_values(["row", "seam", "to"], ignore_index=True)
