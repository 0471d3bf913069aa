"""A film's company: who is where in every frame, and where each fish is a while later."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from finloop.base.arrays import Complex, Ints, Mask
from finloop.base.errors import FinloopError
from finloop.features.memory import memory_frames
from finloop.social.measures import by_frame, middle, shoal_table, slots_of
from finloop.social.neighbours import Neighbours, relative_neighbours, vectors
from finloop.social.steps import last_rows
from finloop.social.walls import Walls

_PART = 4  # of the longest track, at most, is the while after which a fish is looked at again
LEAST = 50  # rows with company in each half; fewer teach nothing


@dataclass(frozen=True)
class FilmShoal:
    """A film's fish. Vectors are complex, in body lengths, as `finloop.social.neighbours` has them.

    place, heading (n,): of the rows of the feature table; frame (n,); later, before (n,): the row
    of the same track `horizon` frames later and before, −1 where there is none; slot (n,): its
    number in its frame; index (n,): of its frame among those seen; places, headings (frames, m): of
    each of these, NaN of who is absent; table: of `shoal_table`.
    """

    place: Complex
    heading: Complex
    frame: Ints
    later: Ints
    index: Ints
    slot: Ints
    places: Complex
    headings: Complex
    horizon: int
    walls: Walls
    table: pd.DataFrame

    @property
    def visible_counts(self) -> Ints:
        """Return how many fish (frames,) each frame shows."""
        return np.asarray(np.isfinite(self.headings).sum(axis=1))

    @property
    def fish(self) -> int:
        """How many are seen at once, in the median of the frames."""
        return int(np.median(self.visible_counts))

    @property
    def first_half(self) -> Mask:
        """Which rows (n,) are of the first half of the film, in time."""
        return self.frame < middle(self.frame)

    def half(self, first: bool) -> pd.DataFrame:
        """The measures of one half."""
        return self.table[self.first_half == first]

    def lessons(self, first: bool, most: int) -> Ints:
        """Rows of one half with company and a later row in it, evenly spread, `most` at most."""
        half = self.first_half == first
        company = self.visible_counts[self.index] > 1
        return _spread(np.flatnonzero(half & company & (self.later >= 0) & half[self.later]), most)

    def whole_steps(self, most: int) -> Ints:
        """Rows of the first half, or else of the film, that have one before and a later one."""
        whole = (self.later >= 0) & (last_rows(self.later) >= 0)
        first = np.flatnonzero(whole & self.first_half & self.first_half[self.later])
        return _spread(first if len(first) else np.flatnonzero(whole), most)

    @property
    def teaches(self) -> bool:
        """Whether both halves show enough company to learn from, and the film a whole step."""
        halves = [len(self.lessons(first, LEAST)) for first in (True, False)]
        return min(halves) == LEAST and len(self.whole_steps(1)) > 0

    def visible_neighbours(self, rows: Ints) -> Neighbours:
        """Return what the fish of some rows see of the others."""
        own = self.index[rows]
        places = self.places[own]
        places[np.arange(len(rows)), self.slot[rows]] = np.nan
        others = places, self.headings[own]
        return relative_neighbours(self.place[rows, None], self.heading[rows, None], others)

    def moves(self, rows: Ints) -> Complex:
        """Displacements (n,) from some rows to those a while later, in the frame of the body."""
        way = self.place[self.later[rows]] - self.place[rows]
        return way * self.heading[rows].conj()

    def directions(self, rows: Ints) -> Complex:
        """Headings (n,) a while after some rows, in the frame of the body then."""
        return self.heading[self.later[rows]] * self.heading[rows].conj()


def film_shoal(
    features: pd.DataFrame, arena: Mask, delta: int, horizon: float | Literal["auto"]
) -> FilmShoal:
    """The company of a feature table. delta: Δ in frames; horizon: in Δ, auto: measured.

    FinloopError if a horizon in Δ is longer than the tracks: no row has one before and a later one.
    """
    walls = Walls(arena, float(np.median(features["body_length_px"])))
    frame, track = (features[name].to_numpy(np.int64) for name in ("frame", "track_id"))
    where = features[["x_px", "y_px"]].to_numpy(float), features["heading_deg"].to_numpy(float)
    place, heading = vectors(*where, walls.length)
    by = by_frame(frame)
    ticks = (
        horizon_frames(heading, track, delta)
        if horizon == "auto"
        else max(1, round(horizon * delta))
    )
    later = _later(frame, track, ticks)
    if horizon != "auto" and not ((later >= 0) & (last_rows(later) >= 0)).any():
        longest = longest_track(track)
        raise FinloopError(
            f"horizon={horizon:g} is {ticks} frames, and the film's longest track has {longest}",
            "a horizon that the longest track holds twice, at most "
            f"{max(0, longest - 1) // 2 / delta:.3g}",
            "take a shorter one, auto, or a film with longer tracks",
        )
    return FilmShoal(
        place, heading, frame, later, by[0], by[1], slots_of(place, *by), slots_of(heading, *by),
        ticks, walls, shoal_table(frame, *where, walls),
    )  # fmt: skip


def horizon_frames(heading: Complex, track: Ints, delta: int) -> int:
    """After how many frames headings (n,) are half forgotten; at least Δ, if the tracks allow it.

    No longer than a quarter of the longest track, or half of it where that is less than Δ.
    """
    memory = memory_frames(np.stack([heading.real, heading.imag], axis=1), track)
    longest = longest_track(track)
    ticks = max(delta, round(min(memory, longest / _PART)))
    return max(1, min(ticks, (longest - 1) // 2))


def longest_track(track: Ints) -> int:
    """How many rows the longest track has, of the track of each row (n,)."""
    return int(np.unique(track, return_counts=True)[1].max())


def _later(frame: Ints, track: Ints, ticks: int) -> Ints:
    """The row (n,) of the same track so many frames later, −1 where there is none."""
    later = np.full(len(frame), -1)
    if ticks < len(frame):
        same = (track[ticks:] == track[:-ticks]) & (frame[ticks:] == frame[:-ticks] + ticks)
        later[:-ticks] = np.where(same, np.arange(ticks, len(frame)), -1)
    return later


def _spread(rows: Ints, most: int) -> Ints:
    """So many of some rows at most, evenly spread."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(most, len(rows))).astype(int))]
