"""Which rows a forecast learns from, and which are held out."""

from dataclasses import dataclass

import numpy as np

from finloop.base.arrays import Ints
from finloop.base.errors import FinloopError
from finloop.features.memory import block_frames
from finloop.forecast.film import FilmStates
from finloop.forecast.settings import ForecastSettings


@dataclass(frozen=True)
class Partition:
    """The numbers of a film's rows to learn from, (k,), and of those held out, (q,)."""

    train: Ints
    held_out: Ints


def split_held_out(film: FilmStates, p: ForecastSettings) -> Partition:
    """Split usable rows by stretches of time, of all fish together; the sides share no past.

    Each side has at most `p.most_rows`: in a long film a random sample. FinloopError if the film is
    shorter than two stretches.
    """
    rows, least = film.rows, int(film.lags[-1]) + 2
    block = block_frames(
        p.held_out_block_deltas, p.held_out_ratio, film.delta, film.frame[rows], least
    )
    first, last = (film.frame[rows] - film.lags[-1]) // block, (film.frame[rows] + 1) // block
    blocks = np.unique(first)
    count = min(max(1, round(p.held_out_ratio * len(blocks))), len(blocks) - 1)
    sample = np.random.default_rng((p.seed, 0)).permutation(blocks)[:count]
    begins, ends = np.isin(first, sample), np.isin(last, sample)
    parts = Partition(rows[~begins & ~ends], rows[begins & ends])
    if min(len(parts.train), len(parts.held_out)) == 0:
        raise FinloopError(
            f"{len(parts.train)} rows to learn from and {len(parts.held_out)} to test with, in "
            f"stretches of {block} frames",
            "at least one row of each kind",
            "lower forecast.held_out_block_deltas, or take a longer film",
        )
    rng = np.random.default_rng((p.seed, 2))
    return Partition(*(
        np.sort(rng.choice(part, p.most_rows, replace=False)) if len(part) > p.most_rows else part
        for part in (parts.train, parts.held_out)
    ))  # fmt: skip
