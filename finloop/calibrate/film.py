"""The fish of a film: their places in every frame, and where each fish is some time later."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd

from finloop.base.arrays import Complex, Ints, Mask
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.features.memory import measure_memory_frames
from finloop.social.measures import FrameSlots, frame_slots, measure_group, middle_frame
from finloop.social.neighbours import Neighbours, complex_vectors, relative_neighbours
from finloop.social.walls import Walls

_PART = 4  # the measured horizon is at most 1 / _PART of the longest track
LEAST = 50  # rows with other fish that each half must have for a fit


@dataclass(frozen=True)
class FilmGroup:
    """The fish of a film as a group: n rows (a fish in a frame), with their neighbours.

    Vectors are complex, in body lengths, as in `finloop.social.neighbours`. place, heading, frame
    (n,): of each row. later, earlier (n,): row of the same track `horizon_frames` later and
    earlier, or −1. slots: where each row stands in places, headings (frames, m), which are NaN for
    absent fish. table: `measure_group`.
    """

    place: Complex
    heading: Complex
    frame: Ints
    later: Ints
    earlier: Ints
    slots: FrameSlots
    places: Complex
    headings: Complex
    horizon_frames: int
    walls: Walls
    table: pd.DataFrame

    @property
    def visible_counts(self) -> Ints:
        """Return the number of fish (frames,) in each frame that shows any."""
        return np.asarray(np.isfinite(self.headings).sum(axis=1))

    @property
    def typical_fish_count(self) -> int:
        """Return the median number of fish in a frame that shows any."""
        return int(np.median(self.visible_counts))

    @property
    def first_half(self) -> Mask:
        """Return a mask (n,) of the rows in the first half of the film, in time."""
        return self.frame < middle_frame(self.frame)

    def measures_of_half(self, first: bool) -> pd.DataFrame:
        """Return the measures (`SCHOOL`) of the first half of the film, or of the second."""
        return self.table[self.first_half == first]

    def rows_for_fit(self, first: bool, most: int) -> Ints:
        """Return at most `most` rows (k,) of one half of the film, evenly spread, to fit zones to.

        Each row has other fish in its frame, and the same fish is seen `horizon_frames` later in
        the same half.
        """
        in_half = self.first_half == first
        # slots.row: the line of a fish's frame in arrays that have a line per frame
        has_others = self.visible_counts[self.slots.row] > 1
        has_later = (self.later >= 0) & in_half[self.later]
        return spread_rows(np.flatnonzero(in_half & has_others & has_later), most)

    def rows_with_whole_steps(self, most: int) -> Ints:
        """Return at most `most` rows (k,) whose fish is also seen a horizon before and one after.

        They are evenly spread over the first half, or over the whole film if that has none.
        """
        whole = (self.later >= 0) & (self.earlier >= 0)
        first = np.flatnonzero(whole & self.first_half & self.first_half[self.later])
        return spread_rows(first if len(first) else np.flatnonzero(whole), most)

    def visible_neighbours(self, rows: Ints) -> Neighbours:
        """Return the other fish that those in k rows see: distance, bearing and heading (k, m)."""
        frames = self.slots.row[rows]  # lines of `places`, of all fish in a frame
        places = self.places[frames]
        places[np.arange(len(rows)), self.slots.fish[rows]] = np.nan  # no fish is its own neighbour
        return relative_neighbours(
            self.place[rows, None], self.heading[rows, None], places, self.headings[frames]
        )

    def relative_headings(self, rows: Ints) -> Complex:
        """Return the later headings of the fish in k rows, relative to now: unit vectors (k,).

        They are complex: 1 = not turned, i = turned left by 90°. Later is `horizon_frames` later:
        every row must have a `later` one.
        """
        return self.heading[self.later[rows]] * self.heading[rows].conj()


def build_film_group(
    features: pd.DataFrame, arena: Mask, delta: int, horizon: float | Literal["auto"]
) -> FilmGroup:
    """Return the group of all fish of a film, with their neighbours, from the feature table.

    arena (h, w): where animals can be; delta: Δ in frames; horizon: time between seeing and
    responding, in units of Δ, or "auto" to measure it. FinloopError if a given horizon is longer
    than half the longest track.
    """
    walls = Walls(arena, float(np.median(features["body_length_px"])))
    frame, track = (features[name].to_numpy(np.int64) for name in ("frame", "track_id"))
    places_px = features[["x_px", "y_px"]].to_numpy(float)
    headings_deg = features["heading_deg"].to_numpy(float)
    place_by_row, heading_by_row = complex_vectors(places_px, headings_deg, walls.length)
    # Tables (frames, slots): the fish of each frame side by side, NaN where there are fewer.
    slots = frame_slots(frame)
    place_by_slot, heading_by_slot = slots.to_array(place_by_row), slots.to_array(heading_by_row)
    if horizon == "auto":
        horizon_frames = measure_horizon_frames(heading_by_row, track, delta)
    else:
        horizon_frames = max(1, round(horizon * delta))
    later, earlier = _rows_later_and_earlier(
        frame, track, horizon_frames
    )  # rows of the same fish, −1: none
    if horizon != "auto" and not ((later >= 0) & (earlier >= 0)).any():
        longest = _longest_track_rows(track)
        raise FinloopError(
            f"horizon={horizon:g} is {horizon_frames} frames, and the film's longest track has "
            f"{longest}",
            f"a horizon of at most {max(0, longest - 1) // 2 / delta:.3g}, half the longest track",
            "take a shorter one, auto, or a film with longer tracks",
        )
    return FilmGroup(
        place=place_by_row, heading=heading_by_row, frame=frame, later=later, earlier=earlier,
        slots=slots, places=place_by_slot, headings=heading_by_slot,
        horizon_frames=horizon_frames, walls=walls,
        table=measure_group(frame, places_px, headings_deg, walls),
    )  # fmt: skip


def measure_horizon_frames(heading: Complex, track: Ints, delta: int) -> int:
    """Return after how many frames fish have half forgotten their headings, within limits.

    The result is limited to a quarter of the longest track, then raised to at least `delta` (Δ, in
    frames), and last limited to half of the longest track; it is 1 or more. heading (n,): complex;
    track (n,): each row's track.
    """
    memory = measure_memory_frames(np.stack([heading.real, heading.imag], axis=1), track)
    longest = _longest_track_rows(track)
    wanted = max(delta, round(min(memory, longest / _PART)))
    return max(1, min(wanted, (longest - 1) // 2))


def _longest_track_rows(track: Ints) -> int:
    """Return how many rows the longest track has; track (n,): number of each row's track."""
    return int(np.unique(track, return_counts=True)[1].max())


def _rows_later_and_earlier(frame: Ints, track: Ints, gap: int) -> tuple[Ints, Ints]:
    """Return, for each row, the rows of the same track `gap` frames later and earlier; else −1.

    It is also −1 where a frame in between is missing. frame, track (n,): frame and track number of
    each row, sorted by track and frame.
    """
    later, earlier = np.full((2, len(frame)), -1)
    is_linked = (track[gap:] == track[:-gap]) & (frame[gap:] == frame[:-gap] + gap)
    first = np.flatnonzero(is_linked)
    later[first], earlier[first + gap] = first + gap, first
    return later, earlier
