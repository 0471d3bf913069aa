"""Whether fish of one tank keep clear of each other, and what that costs them.

`python -m benchmarks.company FOLDER …` takes working copies in which the pipeline was run, of a
film each (none: the one that it is called in), and writes benchmarks/company.csv. Eight fish, or as
many as there is room for, swim in the live tank for a minute of film, each to a random place and
at once to the next: clear of each other, and with `animate.overlap=true`. Outlines are those of the
pictures, at the heading that is planned, without what joins still bend and turn. A fish that moves
less than a twentieth of a body length in a second is still. Beside it stands what the animals of
the film do.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import sys
import time
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.animate.edit_list import FRAME
from finloop.animate.planner import Planner, planner
from finloop.animate.settings import Settings
from finloop.animate.swim import Player
from finloop.base.axes import ahead_left
from finloop.distance.picture import typical_length
from finloop.live.fish import Row
from finloop.live.tank import LiveTank
from stages.animate import material
from stages.settings import load

FISH, SECONDS, STILL = 8, 60.0, 0.05


def outline(player: Player, row: Row) -> np.ndarray:
    """The outline (p, 2) of a fish on screen, px."""
    hull = player.hull(row.kind, row.source) * (1, -1 if row.kind == FRAME and row.mirrored else 1)
    place = ahead_left(hull, np.radians(row.heading_deg))  # it is its own inverse
    return place + np.array([row.x_px, row.y_px])


def overlap(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two outlines have a pixel in common, but for their edges."""
    low, high = np.maximum(one.min(0), other.min(0)), np.minimum(one.max(0), other.max(0))
    if (low > high).any():
        return False
    corner = np.minimum(one.min(0), other.min(0))
    size = np.ceil(np.maximum(one.max(0), other.max(0)) - corner).astype(int) + 1
    masks = np.zeros((2, *size[::-1]), np.uint8)
    for mask, polygon in zip(masks, (one, other), strict=True):
        cv2.fillPoly(mask, [np.rint(16 * (polygon - corner)).astype(np.int32)], 1, shift=4)
    return bool((masks[0] & masks[1]).any())


def nearest(places: np.ndarray) -> np.ndarray:
    """How far (n,) each of n ≥ 2 places (n, 2) is from the one nearest to it."""
    far = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(far, np.inf)
    return np.asarray(far.min(axis=1))


def summary(near: list[np.ndarray], speeds: np.ndarray, rate_hz: float) -> dict[str, float]:
    """Distances to the nearest, body lengths, and how still; speeds (ticks, n), NaN unknown."""
    still = np.where(np.isnan(speeds), False, speeds < STILL)
    longest = run = np.zeros(still.shape[1], int)
    for tick in still:
        run = np.where(tick, run + 1, 0)
        longest = np.maximum(longest, run)
    quantiles = np.quantile(np.concatenate(near), [0.01, 0.05, 0.5]) if near else [np.nan] * 3
    names = ("nearest_1pct", "nearest_5pct", "nearest_median")
    return {
        **dict(zip(names, map(float, quantiles), strict=True)),
        "still_pct": 100 * float(still.sum() / np.isfinite(speeds).sum()),
        "longest_still_s": float(longest.max() / rate_hz),
    }


def swum(mode: str, plans: Planner) -> dict[str, object]:
    """What fish do in a mode."""
    waters, player = plans.waters, plans.players[mode]
    length, rate = waters.motion.body_length_px, waters.motion.rate_hz
    tank, rng = LiveTank(plans.players, mode, FISH, 0), np.random.default_rng(1)
    y, x = np.nonzero(waters.tank.legal)
    count, ticks = len(tank.fish), round(SECONDS * rate)
    places, near, met, reached, took = np.empty((ticks, count, 2)), [], 0, 0, 0.0
    for tick in range(ticks):
        for number, fish in enumerate(tank.fish):
            reached += fish.reached
            if fish.reached or fish.goal is None:
                place = rng.integers(len(x))
                tank.send(number, float(x[place]), float(y[place]))
        begin = time.process_time()
        tank.on()
        took += time.process_time() - begin
        rows = [row for fish in tank.fish if (row := fish.at(tank.tick)) is not None]
        places[tick] = [(row.x_px, row.y_px) for row in rows]
        near += [nearest(places[tick]) / length] if count > 1 else []
        outlines = [outline(player, row) for row in rows]
        met += sum(overlap(one, other) for one, other in combinations(outlines, 2))
    speeds = np.hypot(*np.diff(places, axis=0).transpose(2, 0, 1)) / length * rate
    return {
        "mode": mode, "overlap": waters.settings.overlap, "fish": count,
        "overlapping_pairs_per_1000_ticks": 1000 * met / ticks,
        "goals_per_fish_min": reached / count / SECONDS * 60,
        **summary(near, speeds, rate), "real_times": ticks / rate / took,
    }  # fmt: skip


def filmed(features: pd.DataFrame, rate_hz: float) -> dict[str, object]:
    """What the animals of the film do; outlines of animals that touch it does not tell apart."""
    length = typical_length(features).to_numpy(float)
    places = features[["x_px", "y_px"]].to_numpy(float)
    near = [
        nearest(places[rows]) / length[rows]
        for rows in features.groupby("frame").indices.values() if len(rows) > 1
    ]  # fmt: skip
    step = np.hypot(*np.diff(places, axis=0, append=np.nan).T) / length * rate_hz
    tracks = features["track_id"].to_numpy()
    step[np.append(tracks[1:] != tracks[:-1], True)] = np.nan
    animals = features.groupby("frame").size().mean()
    return {"mode": "film", "fish": animals, **summary(near, step[:, None], rate_hz)}


def film_rows(film: str) -> Iterator[dict[str, object]]:
    """All modes on the film in the present folder."""
    p: Settings = replace(load("animate"), path=None)
    with material(p) as made:
        yield {"film": film, **filmed(made.reel.features, made.rate_hz)}
        for through in (False, True):
            plans = planner(made, replace(p, overlap=through))
            for mode in plans.players:
                yield {"film": film, **swum(mode, plans)}


def main() -> None:
    """Print and write the table."""
    rows: list[dict[str, object]] = []
    for folder in map(Path, sys.argv[1:] or ["."]):
        name = folder.resolve().name
        with chdir(folder):
            rows += list(film_rows(name))
    table = pd.DataFrame(rows)
    print(table.round(3).to_string())
    table.to_csv(Path(__file__).with_name("company.csv"), index=False, float_format="%.3g")


if __name__ == "__main__":
    main()
