"""Tracks of another program: check that they belong to the film, and match them with silhouettes.

The program defines who is where; silhouette, backbone and cut-out are those found here. A place is
an animal's given points; its distance from a silhouette is the mean distance of these points from
it, 0 for a point inside. A place *within* a silhouette is nearer than a tenth of a body length, as
points at the tips of head and tail are; it takes the nearest. Every other place takes the nearest
silhouette that no place is within, up to a body length away.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import cv2
import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses
from finloop.extract.film import Detections, NoTrackError, TrackedFish
from finloop.extract.samples import Verdict
from finloop.extract.settings import ExtractSettings
from finloop.extract.tracks import SilhouettePlace

HEADS = ("nosetip", "nose", "snout", "rostrum", "mouth", "headtip", "head")
TAILS = ("tailtip", "tailend", "tailfin", "caudalfin", "caudal", "tail", "tailbase", "peduncle")
"""Common names of keypoints, without case and signs; the first one that exists counts."""
_MOST_NORMAL = 1.5  # px; if all places are nearer to the corner, they are shares of the picture
_AT_THE_END = 12  # frames by which two decoders may disagree about the end of a film
_MOST_NEEDED = 0.9  # share of places, see `SilhouetteFit.least_share`
_WITHIN = 0.1  # body lengths; a place farther from a silhouette is not within it
_TIE = 1e-6  # of a distance from a centre; it decides where other distances are equal

Outcome = Literal["used", "no silhouette", "shared", "not isolated"]
"""The outcome of a place: it has its own isolated silhouette, none is near, two places share one,
or the silhouette is no isolated fish (at the border, too large, too small, too pale)."""

SHOWN_ALONE = (
    "see what is found without the file: extract.tracks_path=null, then "
    "reports/film/extract/detections.png"
)
"""Advice where a film and its tracks disagree: a run that fails draws no picture."""


@dataclass(frozen=True)
class ExternalTracks:
    """Where another tracking program places animals, in the order of the clip's frames.

    names: of the animals; individual: (rows,) number of the animal; points: (rows, k, 2) px, NaN
    where a point is missing; head, tail: (rows, 2) px, NaN where missing; start, stop: (frames of
    the clip,) rows start … stop − 1 belong to a frame; film: that was tracked.
    """

    names: tuple[str, ...]
    individual: NDArray[np.int64]
    points: Floats
    head: Floats
    tail: Floats
    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    film: "FilmSize"

    def rows_of_frame(self, frame: int) -> slice:
        """Return the rows that belong to one frame of the clip, as a slice."""
        return slice(int(self.start[frame]), int(self.stop[frame]))

    def find_rows(
        self, frames: NDArray[np.integer], individuals: NDArray[np.integer]
    ) -> NDArray[np.int64]:
        """Return the row (n,) of each animal in a frame of the clip; every pair must exist.

        frames, individuals: (n,), numbers of frames and of animals.
        """
        row = self.start[frames].copy()
        while (wrong := self.individual[row] != individuals).any():
            row[wrong] += 1
        return row


class FilmSize(NamedTuple):
    """Number of frames, and sides of the picture, of the film that was tracked."""

    frames: int
    width_px: int
    height_px: int


def map_poses_to_clip(
    poses: Poses, clip_frames: NDArray[np.integer], film: FilmSize, p: ExtractSettings
) -> ExternalTracks:
    """Sort another program's tracked poses by the frames of the clip.

    clip_frames: the film's frame that each frame of the clip shows. FinloopError if a named
    keypoint is missing, the file has places beyond the film's end or none in the clip, or the
    places are not in px of the picture.
    """
    head = find_keypoint(
        poses.keypoints, p.tracks_head_keypoint, HEADS, "extract.tracks_head_keypoint"
    )
    tail = find_keypoint(
        poses.keypoints, p.tracks_tail_keypoint, TAILS, "extract.tracks_tail_keypoint"
    )
    sure = ~(poses.confidence < p.tracks_least_confidence)  # NaN: unknown
    points = np.where(sure[..., None], poses.places * p.tracks_px_per_unit, np.nan)
    there: Mask = np.all(np.isfinite(points), axis=2)
    rows = np.any(there, axis=1)
    points, frame = points[rows], poses.frame[rows]
    if not len(frame):
        raise FinloopError(
            f"no point of the tracks has a confidence of {p.tracks_least_confidence:g} or more",
            "points of high confidence",
            "take tracks of a better trained model, or export them without confidences",
        )
    _refuse_other_length(frame, clip_frames, film)
    _refuse_other_units(points, film)
    none = np.full((len(points), 2), np.nan)
    return ExternalTracks(
        poses.individuals,
        poses.individual[rows],
        points,
        none if head is None else points[:, poses.keypoints.index(head)],
        none if tail is None else points[:, poses.keypoints.index(tail)],
        np.searchsorted(frame, clip_frames, side="left"),
        np.searchsorted(frame, clip_frames, side="right"),
        film,
    )


def find_keypoint(
    keypoints: Sequence[str], name: str, common_names: Sequence[str], parameter: str
) -> str | None:
    """Return the keypoint that a parameter names; for `auto` the first one that has a common name.

    name: the parameter's value; the result is None for `none`, and where `auto` finds nothing.
    common_names: of this keypoint, the best first. FinloopError, which mentions `parameter`, if a
    named keypoint does not exist.
    """
    if name == "auto":
        plain = {re.sub(r"[^a-z]", "", one.lower()): one for one in reversed(keypoints)}
        return next((plain[one] for one in common_names if one in plain), None)
    if name == "none" or name in keypoints:
        return None if name == "none" else name
    raise FinloopError(
        f"the tracks have no keypoint {name!r}",
        f"one of {', '.join(keypoints)}; or auto, or none",
        f"correct {parameter}",
    )


def _refuse_other_length(
    tracked_frames: NDArray[np.integer], clip_frames: NDArray[np.integer], film: FilmSize
) -> None:
    """Raise FinloopError for places beyond the film's end, or in less than half of the clip.

    tracked_frames: (rows,) ascending; clip_frames: the film's frame that each frame of the clip
    shows.
    """
    first, last = tracked_frames[0], tracked_frames[-1]
    if last >= film.frames + _AT_THE_END:
        raise FinloopError(
            f"the tracks continue to frame {last}, and the film has {film.frames} frames",
            "tracks of this film, whose frames are counted from 0",
            "use the film that was tracked, or this film's own tracks",
        )
    common = np.isin(clip_frames, tracked_frames)
    reached = float((clip_frames <= last).mean())
    if not common.any() or reached < 0.5:
        raise FinloopError(
            f"the tracks have frames {first} … {last} of the film, and the clip shows "
            f"its frames {clip_frames.min()} … {clip_frames.max()}",
            "tracks of at least half of the clip",
            "set clip.start_s and clip.end_s to the range that was tracked; frames count from the "
            "beginning of the film, not from clip.start_s",
        )


def _refuse_other_units(points: Floats, film: FilmSize) -> None:
    """Raise FinloopError if places are not in px: outside the picture, or all in its first pixels.

    points: (rows, k, 2).
    """
    place = np.nanmean(points, axis=1)
    (x0, y0), (x1, y1) = place.min(axis=0), place.max(axis=0)
    if max(-x0, -y0, x1, y1) <= _MOST_NORMAL:
        raise FinloopError(
            f"all places lie at x {x0:.3g} … {x1:.3g}, y {y0:.3g} … {y1:.3g}: shares of the "
            "picture, not px",
            f"places in px of a picture of {film.width_px}×{film.height_px}",
            "export them in px; extract.tracks_px_per_unit multiplies x and y by one number",
        )
    outside = ((place < -0.5) | (place > np.array([film.width_px, film.height_px]) - 0.5)).any(1)
    if outside.mean() > 0.5:
        raise FinloopError(
            f"{outside.mean():.0%} of the places lie outside the picture: they are at x {x0:.4g} … "
            f"{x1:.4g}, y {y0:.4g} … {y1:.4g}",
            f"places in px of a picture of {film.width_px}×{film.height_px}, from its upper left",
            "correct extract.tracks_px_per_unit, or use this film's tracks",
        )


def _silhouette_distances(
    points: Floats, silhouettes: Sequence[SilhouettePlace], most_px: float
) -> Floats:
    """Return the distances (animals, silhouettes) [px] between animals and silhouettes of a frame.

    points: (animals, k, 2) px. Beyond `most_px` the distance is infinite.
    """
    result = np.full((len(points), len(silhouettes)), np.inf)
    for j, spot in enumerate(silhouettes):
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
    points: Floats, silhouettes: Sequence[SilhouettePlace], length_px: float
) -> list[tuple[Outcome, int | None]]:
    """Match the tracked animals of a frame with silhouettes: an outcome and a number for each.

    points: (animals, k, 2) px, where the animals are; length_px: a body length. The number is that
    of the silhouette, None where none is near.
    """
    if not len(points) or not silhouettes:
        return [("no silhouette", None)] * len(points)
    apart = _silhouette_distances(points, silhouettes, length_px)
    centres = np.array([(spot.x_px, spot.y_px) for spot in silhouettes])
    off = np.hypot(*(np.nanmean(points, axis=1)[:, None] - centres).transpose(2, 0, 1))
    apart += _TIE * off  # of overlapping silhouettes the one with the nearest centre
    nearest = apart.argmin(axis=1)
    within = apart.min(axis=1) <= _WITHIN * length_px
    apart[:, np.unique(nearest[within])] = np.inf  # for those that are within none
    own = np.where(within, nearest, apart.argmin(axis=1))
    some = within | (apart.min(axis=1) <= length_px)
    claims = Counter(own[some].tolist())

    result: list[tuple[Outcome, int | None]] = []
    for j, has in zip(own.tolist(), some, strict=True):
        if not has:
            result.append(("no silhouette", None))
        elif claims[j] > 1:
            result.append(("shared", j))
        else:
            result.append(("used" if silhouettes[j].isolated else "not isolated", j))
    return result


class ExternalTrackLinker:
    """Links silhouettes to tracks by another program's places; a track is a run of one animal.

    A run is successive frames in which the animal has its own isolated silhouette; at least
    `least_frames` make a track. The animal's k-th run, both from 0, is track animal + k · animals,
    so `track_id % len(names)` is the animal.

    outcomes: counts of (animal, outcome of its place); short: number of places in runs that are too
    short. Both are complete after the last frame.
    """

    def __init__(self, given: ExternalTracks, length_px: float, least_frames: int) -> None:
        """Begin without runs; length_px: a body length."""
        self._given, self._length, self._least = given, length_px, least_frames
        self.outcomes: Counter[tuple[int, Outcome]] = Counter()
        self.short = 0

    def outcome_counts(self) -> Counter[Outcome]:
        """Count the places of all animals by their outcome."""
        counts = Counter[Outcome]()
        for (_, outcome), count in self.outcomes.items():
            counts[outcome] += count
        return counts

    def link_frames(
        self, detections: Iterable[Detections], cuts: Sequence[int] = ()
    ) -> Iterator[tuple[Counter[Verdict], list[TrackedFish]]]:
        """Yield for each frame the counts of its verdicts, and the fish of long enough runs.

        When a run becomes long enough, all its fish until then are yielded. cuts: numbers of frames
        before which the film is cut, and runs end.
        """
        waiting: dict[int, list[TrackedFish]] = {}  # by animal, runs that are still too short
        running: dict[int, int] = {}  # animal → its track
        runs: Counter[int] = Counter()
        for number, (verdicts, spots, fish) in enumerate(detections):
            rows = self._given.rows_of_frame(number)
            animals = self._given.individual[rows].tolist()
            found = match_silhouettes(self._given.points[rows], spots, self._length)
            seen: dict[int, TrackedFish] = {}
            for animal, (outcome, j) in zip(animals, found, strict=True):
                self.outcomes[animal, outcome] += 1
                one = fish[j] if outcome == "used" and j is not None else None
                if one is not None:
                    seen[animal] = TrackedFish(0, number, one)
            if number in cuts:
                self._end_runs(set(), waiting, running)
            self._end_runs(set(seen), waiting, running)
            ready: list[TrackedFish] = []
            for animal, tracked in seen.items():
                waiting.setdefault(animal, []).append(tracked)
                if animal not in running and len(waiting[animal]) >= self._least:
                    running[animal] = animal + runs[animal] * len(self._given.names)
                    runs[animal] += 1
                if animal in running:
                    ready += [f._replace(track_id=running[animal]) for f in waiting.pop(animal)]
            yield Counter(verdicts), ready
        self._end_runs(set(), waiting, running)

    def no_track_error(self) -> NoTrackError:
        """Return the error to raise where no animal can be followed long enough for a track."""
        given, least = self._given, self._least
        longest, without = longest_run_frames(given), int((given.stop == given.start).sum())
        became = ", ".join(f"{count} {outcome}" for outcome, count in self.outcome_counts().items())
        do = SHOWN_ALONE
        if longest < least:
            do = (
                f"fill the gaps (a place that is NaN, infinite or of a confidence below "
                f"{ExtractSettings.tracks_least_confidence:g} is none) and export the tracks again"
            )
        return NoTrackError(
            f"no animal of the file of tracks has a silhouette for {least} frames on end "
            f"(places: {became}); the places of an animal in the file of tracks continue for "
            f"{longest} frames at most, and {without} of {len(given.start)} frames have no place",
            f"an animal with a place in {least} frames on end, and its own silhouette there",
            f"{do}; or allow shorter tracks (extract.min_track_frames)",
        )

    def metrics(self, fit: "SilhouetteFit") -> dict[str, float]:
        """Count how another program's places matched silhouettes: numbers and shares, by name."""
        given, counts = self._given, self.outcome_counts()
        return {
            "places": counts.total(),
            **{f"places_{what.replace(' ', '_')}": counts[what] for what in get_args(Outcome)},
            "places_in_short_runs": self.short,
            "places_used_share": (counts["used"] - self.short) / max(1, counts.total()),
            "places_near_a_silhouette_share": fit.share,
            "places_near_by_chance_share": fit.chance,
            "animals": len({animal for animal, _ in self.outcomes}),
            "animals_used": len({animal for animal, what in self.outcomes if what == "used"}),
            "frames_without_place": int((given.stop == given.start).sum()),
            "places_with_head_share": float(np.isfinite(given.head).all(axis=1).mean()),
        }

    def _end_runs(
        self, seen: set[int], waiting: dict[int, list[TrackedFish]], running: dict[int, int]
    ) -> None:
        """End the runs of all animals that are not in `seen`; count those that are too short.

        waiting: fish of runs that are too short; running: number of the track of long ones; both by
        animal.
        """
        for animal in [animal for animal in waiting if animal not in seen]:
            self.short += len(waiting.pop(animal))
        for animal in [animal for animal in running if animal not in seen]:
            del running[animal]


def longest_run_frames(given: ExternalTracks) -> int:
    """Return for how many successive frames of the clip an animal has a place, at most."""
    frame = np.repeat(np.arange(len(given.start)), given.stop - given.start)
    row = np.concatenate([np.arange(a, b) for a, b in zip(given.start, given.stop, strict=True)])
    animal = given.individual[row]
    order = np.lexsort((frame, animal))
    new = (np.diff(frame[order]) != 1) | (np.diff(animal[order]) != 0)
    edges = np.flatnonzero(np.concatenate([[True], new, [True]]))
    return int(np.diff(edges).max())


class SilhouetteFit(NamedTuple):
    """How well another program's places agree with silhouettes in sample frames.

    share: of places with a silhouette within a body length, 0 … 1; chance: the same with
    silhouettes of other moments; places: their number; lost: numbers of animals that have three
    places or more, and never a silhouette; seen: most silhouettes in a frame.
    """

    share: float
    chance: float
    places: int
    lost: tuple[int, ...]
    seen: int

    @property
    def least_share(self) -> float:
        """Return the least `share` at which tracks are taken to be of this film.

        It is midway from `chance` to 1, at most 0.9. Tracks of another film agree by chance alone.
        So do this film's tracks where animals rest, which then must agree nearly always.
        """
        return min(_MOST_NEEDED, (1 + self.chance) / 2)


def measure_silhouette_fit(
    tracks: ExternalTracks,
    frames: Sequence[int],
    silhouettes: Sequence[Sequence[SilhouettePlace]],
    length_px: float,
) -> SilhouetteFit:
    """Measure how well another program's places agree with the silhouettes of sample frames.

    frames: numbers of the sample frames; silhouettes: those of each; length_px: a body length.
    """
    shift = len(frames) // 2
    own, other = [], []
    for number, frame in enumerate(frames):
        points = tracks.points[tracks.rows_of_frame(frame)]
        own.append(_have_near_silhouette(points, silhouettes[number], length_px))
        if shift:
            other.append(
                _have_near_silhouette(
                    points, silhouettes[(number + shift) % len(frames)], length_px
                )
            )
    near = np.concatenate(own)
    animals = np.concatenate([tracks.individual[tracks.rows_of_frame(frame)] for frame in frames])
    lost = tuple(
        int(animal)
        for animal in np.unique(animals)
        if (animals == animal).sum() > 2 and not near[animals == animal].any()
    )
    chance = float(np.concatenate(other).mean()) if other else 0.0
    return SilhouetteFit(float(near.mean()), chance, len(near), lost, max(map(len, silhouettes)))


def _have_near_silhouette(
    points: Floats, silhouettes: Sequence[SilhouettePlace], length_px: float
) -> Mask:
    """Return which animals (animals,) have a silhouette within a body length of their place.

    points: (animals, k, 2) px, where they are; length_px: a body length.
    """
    if not silhouettes or not len(points):
        return np.zeros(len(points), bool)
    return _silhouette_distances(points, silhouettes, length_px).min(axis=1) <= length_px


def refuse_other_film(tracks: ExternalTracks, fit: SilhouetteFit) -> None:
    """Raise FinloopError if so few places have a silhouette that the tracks are of another film."""
    if fit.share >= fit.least_share:
        return
    film = tracks.film
    place = np.nanmean(tracks.points, axis=1)
    (x0, y0), (x1, y1) = place.min(axis=0), place.max(axis=0)
    lost = ", ".join(tracks.names[animal] for animal in fit.lost[:8])
    raise FinloopError(
        f"of {fit.places} places of {len(tracks.names)} animals in sample frames "
        f"{fit.share:.0%} show an animal; at other moments of the film it is "
        f"{fit.chance:.0%}. At most {fit.seen} silhouettes are seen in a frame; "
        f"places lie at x {x0:.4g} … {x1:.4g}, y {y0:.4g} … {y1:.4g} of a picture of "
        f"{film.width_px}×{film.height_px}" + (f"; never at an animal: {lost}" if lost else ""),
        f"tracks of this film: at least {fit.least_share:.0%}, midway between chance and all",
        "use this film's tracks, in px (extract.tracks_px_per_unit), without animals that are not "
        f"there; where they are this film's, {SHOWN_ALONE}",
    )
