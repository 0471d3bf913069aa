"""The nearest neighbours of every row, mirror images too: where the film can go on."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel
from finloop.jumps.table import JUMPS
from finloop.nearest import Nearest

_LOOKED_AT = 8  # times as many nearest rows are looked at, at first, for `count` passages


@dataclass(frozen=True)
class Search:
    """Who looks for the `count` nearest rows of rows, one a passage of film.

    Of rows that follow one another only the nearest is kept, and none less than `least` rows from a
    nearer one. A row that less than `least` rows of its track follow is not jumped to, nor one
    within `least` rows of the same track.

    targets (m, d): of the n rows, and of their mirror images where these are looked at; goals:
    numbers of those that can be jumped to, which are in `index`. track (n,): rising.
    """

    targets: Floats
    goals: Ints
    index: Nearest
    track: Ints
    count: int
    least: int

    @classmethod
    def of(
        cls, values: Floats, track: Ints, count: int, least: int, mirror: bool = True
    ) -> "Search":
        """Values (2, n, d): of rows [0] and mirror images [1]."""
        targets = np.ascontiguousarray(values[: 1 + mirror].reshape(-1, values.shape[-1]))
        stays = np.searchsorted(track, track, "right") - 1 - np.arange(len(track)) >= least
        goals = np.flatnonzero(np.tile(stays, 1 + mirror))
        index = Nearest.of(targets[goals].astype(np.float32))
        return cls(targets, goals, index, np.asarray(track), count, least)

    def __call__(self, rows: Ints) -> pd.DataFrame:
        """Of rows (k,), rising: row, to, mirrored, and how far, the nearest first."""
        to, far = self.index.choose(
            self.targets[rows], _LOOKED_AT * self.count, partial(self._passages, rows)
        )
        at, place = np.nonzero(np.isfinite(far))
        to, n = to[at, place], len(self.track)
        return pd.DataFrame(
            {"row": rows[at], "to": to % n, "mirrored": to >= n, "far": far[at, place]}
        )

    def _passages(self, rows: Ints, some: Ints, near: Ints) -> tuple[tuple[Ints, Floats], Mask]:
        """Targets (k, count) of different passages, how far they are, ∞: none left; are they all?

        near (k, l): numbers of the goals nearest to rows[some] (k,).
        """
        rows = rows[some]
        near = np.sort(np.where(near < 0, -1, self.goals[near]), axis=1)
        threads = numba.get_num_threads()
        with ThreadPoolExecutor(threads) as pool:
            made = pool.map(
                lambda part: _minima(
                    self.targets, self.track, rows[part], near[part], self.least, self.count
                ),
                np.array_split(np.arange(len(rows)), threads),
            )
            to, far = (np.concatenate(one) for one in zip(*made, strict=True))
        return (to, far), np.isfinite(far[:, -1])


def chosen(near: pd.DataFrame, seen: Floats, count: int) -> pd.DataFrame:
    """Jumps, columns of `JUMPS`: of every row the `count` with the least seams.

    What is seen counts squared: below a natural step it is hidden in the motion, above it shows the
    more. near: as `Search` gives them; seen: (k,) natural steps.
    """
    table = near.assign(seam=np.maximum(near["far"], np.square(seen)))
    table = table.sort_values(["row", "seam", "to"]).groupby("row").head(count)
    return table[JUMPS.names].astype(JUMPS.kinds).reset_index(drop=True)


@kernel
def _minima(
    targets: Floats, track: Ints, rows: Ints, near: Ints, least: int, count: int
) -> tuple[Ints, Floats]:
    """For rows (k,) the nearest of their `near` targets (k, l), rising, one a passage of film.

    Of rows that follow one another only the nearest, with no nearer one beside, and none within
    `least` of a nearer one. Those of the same passage as the row itself are left out.
    """
    d = targets.shape[1]
    to, far = np.full((len(rows), count), -1), np.full((len(rows), count), np.inf)
    apart = np.empty(near.shape[1])
    for k in range(len(rows)):
        row = rows[k]
        for c in range(near.shape[1]):
            other = near[k, c]
            apart[c] = np.inf
            if other >= 0 and not _beside(track, row, other, least):
                square = 0.0
                for i in range(d):
                    square += (targets[row, i] - targets[other, i]) ** 2
                apart[c] = np.sqrt(square)
        many = 0
        for c in np.argsort(apart, kind="mergesort"):
            if many == count or apart[c] == np.inf:
                break
            before = c > 0 and near[k, c - 1] == near[k, c] - 1
            after = c + 1 < len(apart) and near[k, c + 1] == near[k, c] + 1
            if (before and apart[c - 1] <= apart[c]) or (after and apart[c + 1] < apart[c]):
                continue
            new = True
            for i in range(many):
                new = new and not _beside(track, to[k, i], near[k, c], least)
            if new:
                to[k, many], far[k, many] = near[k, c], apart[c]
                many += 1
    return to, far


@kernel
def _beside(track, one, other, least):  # type: ignore[no-untyped-def]
    """Whether two targets are of one passage: of one track and side, less than `least` apart."""
    n = len(track)
    same = (one < n) == (other < n) and abs(one - other) < least
    return same and track[one % n] == track[other % n]
