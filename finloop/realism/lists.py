"""The edit lists that are compared: animations as `animate` makes them, and the film itself."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count

import numpy as np
import pandas as pd

from finloop.animate.planner import Planner
from finloop.animate.settings import Settings as AnimateSettings
from finloop.animate.swim import NoRoom, random_goals
from finloop.base.arrays import Floats, Ints
from finloop.base.stretches import stretches
from finloop.edit.schema import EDIT, FRAME, LOOPS, by_fish

Work = tuple[pd.DataFrame, Sequence[int]]
"""An edit list, and its ticks at which another fish begins."""

_SEEDS = 100  # that are tried for one animation: in a nearly full tank few have room for all fish


def animations(planner: Planner, mode: str, seconds: float, p: AnimateSettings) -> Iterator[Work]:
    """Animations of so many seconds of one fish in all, with other seeds and goals than `animate`.

    Each is `animate.seconds` long: to random goals first, then fish wander. Fish that swim together
    have an edit list each. A seed whose places leave no room for all fish is passed over; NoRoom
    after `_SEEDS` of them in a row.
    """
    seeds = count(p.seed + 1)
    for number in range(int(np.ceil(seconds / p.seconds / p.fish))):
        rest = seconds / p.fish - number * p.seconds
        edit = _with_room(planner, mode, replace(p, seconds=min(p.seconds, rest)), seeds)
        for fish in by_fish(edit):
            yield fish, ()


def _with_room(
    planner: Planner, mode: str, p: AnimateSettings, seeds: Iterator[int]
) -> pd.DataFrame:
    """The edit list of an animation with the first of the seeds that has room for all fish."""
    for _ in range(_SEEDS - 1):
        with suppress(NoRoom):
            return _animation(planner, mode, replace(p, seed=next(seeds)))
    return _animation(planner, mode, replace(p, seed=next(seeds)))


def _animation(planner: Planner, mode: str, p: AnimateSettings) -> pd.DataFrame:
    """The edit list of an animation to random goals."""
    waters = replace(planner.waters, settings=p)
    goals = random_goals(waters, p.trial_goals * p.fish, np.random.default_rng(p.seed))
    near = [goal._replace(radius_px=waters.touch_px) for goal in goals]
    return replace(planner, waters=waters).plan(mode, near)[1]


def filmed(tracks: pd.DataFrame, longest: int, most: int, seed: int) -> list[Work]:
    """The film to compare with as edit lists, each of about `longest` ticks."""
    places = tracks[["x_px", "y_px"]].to_numpy()
    works: list[Work] = []
    rows: list[np.ndarray] = []
    parts = stretches(tracks["track_id"].to_numpy(), longest, most, seed)
    for part in parts:
        rows.append(np.arange(part.start, part.stop))
        if sum(map(len, rows)) >= longest or part is parts[-1]:
            every = np.concatenate(rows)
            cuts = np.cumsum([len(piece) for piece in rows])[:-1].tolist()
            works.append((as_filmed(every, places[every]), cuts))
            rows = []
    return works


def as_filmed(source: Ints, places_px: Floats) -> pd.DataFrame:
    """An edit list (columns of `EDIT`) that shows rows (n,) of the film at their places (n, 2)."""
    empty = {"string": "", "bool": False}
    rest = {
        column.name: None if column.nullable else empty.get(column.dtype, 0)
        for column in EDIT.columns
    }
    own = {
        "tick": np.arange(len(source)),
        "kind": FRAME,
        "source": source,
        "scale": 1.0,
        "x_px": places_px[:, 0],
        "y_px": places_px[:, 1],
        "mode": LOOPS,
    }
    return pd.DataFrame(rest | own, index=np.arange(len(source)))
