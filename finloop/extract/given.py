"""Match places of animals from another program with the silhouettes of the film.

The program defines who is where; silhouette, backbone and cut-out are those found here. A place is
an animal's given points; its distance from a silhouette is the mean distance of these points from
it, 0 for a point inside. A place *within* a silhouette is nearer than a tenth of a body length, as
points at the tips of head and tail are; it takes the nearest. Every other place takes the nearest
silhouette that no place is within, up to a body length away.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.extract.film import Detections, FollowedNoneError, TrackedFish
from finloop.extract.samples import Verdict
from finloop.extract.settings import ExtractSettings
from finloop.extract.tracks import SilhouettePlace

_WITHIN = 0.1  # body lengths; a place farther from a silhouette is not within it

_TIE = 1e-6  # of a distance from a centre; it decides where other distances are equal

Outcome = Literal["used", "no silhouette", "shared", "not isolated"]
"""The outcome of a place: it has its own isolated silhouette, none is near, two places share one,
or the silhouette is no isolated fish (at the border, too large, too small, too pale)."""

SHOWN_ALONE = (
    "see what is found without the file: extract.tracks_path=null, then "
    "reports/extract/detections.png"
)
"""Advice where a film and its tracks disagree: a run that fails draws no picture."""


@dataclass(frozen=True)
class Given:
    """Where another program places animals, by frames of the clip.

    names: of the animals; individual: (rows,) number of the animal; points: (rows, k, 2) px, NaN
    where a point is missing; head, tail: (rows, 2) px, NaN where missing; start, stop: (frames of
    the clip,) the rows start … stop − 1 are those of a frame.
    """

    names: tuple[str, ...]
    individual: NDArray[np.int64]
    points: Floats
    head: Floats
    tail: Floats
    start: NDArray[np.int64]
    stop: NDArray[np.int64]

    def rows(self, frame: int) -> slice:
        """Return the rows that belong to one frame of the clip, as a slice."""
        return slice(int(self.start[frame]), int(self.stop[frame]))

    def row_of(
        self, frame: NDArray[np.integer], individual: NDArray[np.integer]
    ) -> NDArray[np.int64]:
        """Return the row (n,) of an animal (n,) in a frame (n,) of the clip; all must exist."""
        row = self.start[frame].copy()
        while (wrong := self.individual[row] != individual).any():
            row[wrong] += 1
        return row


def distances(points: Floats, spots: Sequence[SilhouettePlace], most_px: float) -> Floats:
    """Return the distances (animals, silhouettes) px of places (animals, k, 2) px from silhouettes.

    Infinite where the box of a silhouette is farther than `most_px`.
    """
    result = np.full((len(points), len(spots)), np.inf)
    for j, spot in enumerate(spots):
        low, high = np.array(spot.box[:2]), np.array(spot.box[2:])
        outside = np.maximum(np.maximum(low - points, points - high), 0)
        least = np.nanmean(np.hypot(*outside.transpose(2, 0, 1)), axis=1)
        assert spot.outline is not None
        for i in np.flatnonzero(least <= most_px):
            known = points[i][np.isfinite(points[i]).all(axis=1)]
            signed = [cv2.pointPolygonTest(spot.outline, (x, y), True) for x, y in known.tolist()]
            result[i, j] = np.mean(np.maximum(0.0, np.negative(signed)))
    return result


def match_silhouettes(
    points: Floats, spots: Sequence[SilhouettePlace], length_px: float
) -> list[tuple[Outcome, int | None]]:
    """Return for each place (animals, k, 2) px its outcome and the number of its silhouette.

    spots: the silhouettes of the same frame; length_px: a body length. The number is None where no
    silhouette is near.
    """
    if not len(points) or not spots:
        return [("no silhouette", None)] * len(points)
    apart = distances(points, spots, length_px)
    centres = np.array([(spot.x_px, spot.y_px) for spot in spots])
    off = np.hypot(*(np.nanmean(points, axis=1)[:, None] - centres).transpose(2, 0, 1))
    apart += _TIE * off  # of overlapping silhouettes the one with the nearest centre
    nearest = apart.argmin(axis=1)
    within = apart.min(axis=1) <= _WITHIN * length_px
    apart[:, np.unique(nearest[within])] = np.inf  # for those that are within none
    own = np.where(within, nearest, apart.argmin(axis=1))
    some = within | (apart.min(axis=1) <= length_px)
    claims = Counter(own[some].tolist())

    def outcome(j: int) -> Outcome:
        if claims[j] > 1:
            return "shared"
        return "used" if spots[j].isolated else "not isolated"

    return [
        (outcome(int(j)), int(j)) if has else ("no silhouette", None)
        for j, has in zip(own, some, strict=True)
    ]


class GivenTrackLinker:
    """Links silhouettes to tracks by another program's places: a track is a run of one animal.

    A run is successive frames in which the animal has its own isolated silhouette; at least
    `least_frames` make a track. The animal's k-th run, both from 0, is track animal + k · animals,
    so `track_id % len(names)` is the animal.

    outcomes: counts of (animal, outcome of its place); short: places in runs that are too short.
    Both are complete after the film has run.
    """

    def __init__(self, given: Given, length_px: float, least_frames: int) -> None:
        self._given, self._length, self._least = given, length_px, least_frames
        self.outcomes: Counter[tuple[int, Outcome]] = Counter()
        self.short = 0  # places in runs that are too short for a track

    def tracks(
        self, detections: Iterable[Detections], cuts: Sequence[int] = ()
    ) -> Iterator[tuple[Counter[Verdict], list[TrackedFish]]]:
        """Yield for each frame the counts of its verdicts, and the fish of runs long enough.

        A run's fish so far come at once when it is long enough. Runs also end at `cuts`, the
        numbers of the first frames of further segments.
        """
        waiting: dict[int, list[TrackedFish]] = {}  # by animal, runs that are still too short
        running: dict[int, int] = {}  # animal → its track
        runs: Counter[int] = Counter()
        for number, (verdicts, spots, fish) in enumerate(detections):
            rows = self._given.rows(number)
            animals = self._given.individual[rows].tolist()
            found = match_silhouettes(self._given.points[rows], spots, self._length)
            seen: dict[int, TrackedFish] = {}
            for animal, (outcome, j) in zip(animals, found, strict=True):
                self.outcomes[animal, outcome] += 1
                one = fish[j] if outcome == "used" and j is not None else None
                if one is not None:
                    seen[animal] = TrackedFish(0, number, one)
            if number in cuts:
                self._end(set(), waiting, running)
            self._end(set(seen), waiting, running)
            ready: list[TrackedFish] = []
            for animal, tracked in seen.items():
                waiting.setdefault(animal, []).append(tracked)
                if animal not in running and len(waiting[animal]) >= self._least:
                    running[animal] = animal + runs[animal] * len(self._given.names)
                    runs[animal] += 1
                if animal in running:
                    ready += [f._replace(track_id=running[animal]) for f in waiting.pop(animal)]
            yield Counter(verdicts), ready
        self._end(set(), waiting, running)

    def _end(
        self, seen: set[int], waiting: dict[int, list[TrackedFish]], running: dict[int, int]
    ) -> None:
        for animal in [animal for animal in waiting if animal not in seen]:
            self.short += len(waiting.pop(animal))
        for animal in [animal for animal in running if animal not in seen]:
            del running[animal]


def no_silhouette_error(
    given: Given, followed: GivenTrackLinker, least_frames: int
) -> FollowedNoneError:
    """Return the error to raise where no animal has silhouettes long enough for a track."""
    counts = Counter[Outcome]()
    for (_, outcome), count in followed.outcomes.items():
        counts[outcome] += count
    longest, without = longest_run(given), int((given.stop == given.start).sum())
    became = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
    of_file = (
        f"the places of an animal in the file of tracks continue for {longest} frames at most, and "
        f"{without} of {len(given.start)} frames have no place"
    )
    do = SHOWN_ALONE
    if longest < least_frames:
        do = (
            f"fill the gaps (a place that is NaN, infinite or of a confidence below "
            f"{ExtractSettings.tracks_least_confidence:g} is none) and export the tracks again"
        )
    return FollowedNoneError(
        f"no animal of the file of tracks has a silhouette for {least_frames} frames on end "
        f"(places: {became}); {of_file}",
        f"an animal with a place in {least_frames} frames on end, and its own silhouette there",
        f"{do}; or allow shorter tracks (extract.min_track_frames)",
    )


def longest_run(given: Given) -> int:
    """Return the largest number of successive frames of the clip in which an animal has a place."""
    frame = np.repeat(np.arange(len(given.start)), given.stop - given.start)
    row = np.concatenate([np.arange(a, b) for a, b in zip(given.start, given.stop, strict=True)])
    animal = given.individual[row]
    order = np.lexsort((frame, animal))
    new = (np.diff(frame[order]) != 1) | (np.diff(animal[order]) != 0)
    edges = np.flatnonzero(np.concatenate([[True], new, [True]]))
    return int(np.diff(edges).max())
