"""Check that another program's tracks belong to the film, and match them with silhouettes.

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
from finloop.extract.segment import SegmentedFish
from finloop.extract.settings import ExtractSettings
from finloop.extract.tracks import SilhouettePlace

HEADS = ("nosetip", "nose", "snout", "rostrum", "mouth", "headtip", "head")
TAILS = ("tailtip", "tailend", "tailfin", "caudalfin", "caudal", "tail", "tailbase", "peduncle")
"""Common names of keypoints, without case and signs; the first one that exists counts."""
_MOST_NORMALISED = 1.5  # px; if all places are nearer to the corner, they are shares of the picture
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
    """Another program's positions of animals, in the order of the clip's frames.

    names: of the animals; individual: (rows,) number of the animal; points: (rows, k, 2) px, NaN
    where a point is missing; head, tail: (rows, 2) px, NaN where missing; start, stop: (frames of
    the clip,) rows start … stop − 1 belong to a frame; film: size of the one that was tracked.
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
        """Return the slice of the rows that belong to one frame of the clip."""
        return slice(int(self.start[frame]), int(self.stop[frame]))

    def find_rows(
        self, frames: NDArray[np.integer], individuals: NDArray[np.integer]
    ) -> NDArray[np.int64]:
        """Return the row of each of n animals, each in a given frame of the clip: (n,).

        frames, individuals: (n,), numbers of frames and of animals; every pair must have a row.
        """
        row = self.start[frames].copy()
        while (wrong := self.individual[row] != individuals).any():
            row[wrong] += 1
        return row


class FilmSize(NamedTuple):
    """The size of the film that was tracked: number of frames, and sides of its pictures [px]."""

    frames: int
    width_px: int
    height_px: int


def map_poses_to_clip(
    poses: Poses, clip_frames: NDArray[np.integer], film: FilmSize, p: ExtractSettings
) -> ExternalTracks:
    """Return another program's poses as tracks in the clip: rows sorted by the clip's frames.

    Points of low confidence become NaN, and rows without any point are left out. poses: in the
    order of their frames; clip_frames: the film's frame that each frame of the clip shows.
    FinloopError if a named keypoint is missing, no point is confident enough, the frames do not fit
    film and clip (`_refuse_unfitting_frames`), or the places are not in px of the picture.
    """
    head = find_keypoint(
        poses.keypoints, p.tracks_head_keypoint, HEADS, "extract.tracks_head_keypoint"
    )
    tail = find_keypoint(
        poses.keypoints, p.tracks_tail_keypoint, TAILS, "extract.tracks_tail_keypoint"
    )
    confident = ~(poses.confidence < p.tracks_least_confidence)  # also where it is unknown, NaN
    points = np.where(confident[..., None], poses.places * p.tracks_px_per_unit, np.nan)
    is_known: Mask = np.all(np.isfinite(points), axis=2)
    has_points = np.any(is_known, axis=1)
    points, frame = points[has_points], poses.frame[has_points]
    if not len(frame):
        raise FinloopError(
            f"no point of the tracks has a confidence of {p.tracks_least_confidence:g} or more",
            "points of high confidence",
            "take tracks of a better trained model, or export them without confidences",
        )
    _refuse_unfitting_frames(frame, clip_frames, film)
    _refuse_unless_px(points, film)
    unknown = np.full((len(points), 2), np.nan)
    return ExternalTracks(
        names=poses.individuals,
        individual=poses.individual[has_points],
        points=points,
        head=unknown if head is None else points[:, poses.keypoints.index(head)],
        tail=unknown if tail is None else points[:, poses.keypoints.index(tail)],
        # the rows of each frame of the clip: the first, and the one after the last
        start=np.searchsorted(frame, clip_frames, side="left"),
        stop=np.searchsorted(frame, clip_frames, side="right"),
        film=film,
    )


def find_keypoint(
    keypoints: Sequence[str], name: str, common_names: Sequence[str], parameter: str
) -> str | None:
    """Return the keypoint that a parameter names; for `auto` the one with the best common name.

    name: the parameter's value; the result is None for `none`, and if `auto` finds nothing.
    common_names: such as "nose", the best first, only letters a … z; signs and capitals of
    keypoints are ignored. FinloopError if a named keypoint does not exist; parameter: its name, for
    the message.
    """
    if name == "auto":  # of keypoints with the same letters the first remains
        by_letters = {re.sub(r"[^a-z]", "", key.lower()): key for key in reversed(keypoints)}
        return next((by_letters[word] for word in common_names if word in by_letters), None)
    if name == "none" or name in keypoints:
        return None if name == "none" else name
    raise FinloopError(
        f"the tracks have no keypoint {name!r}",
        f"one of {', '.join(keypoints)}; or auto, or none",
        f"correct {parameter}",
    )


def _refuse_unfitting_frames(
    tracked_frames: NDArray[np.integer], clip_frames: NDArray[np.integer], film: FilmSize
) -> None:
    """Raise FinloopError if tracks go on after the film's end, or do not fit the clip.

    They must share a frame with the clip, and must not end before half of it. tracked_frames:
    (rows,) ascending; clip_frames: the film's frame that each frame of the clip shows.
    """
    first, last = tracked_frames[0], tracked_frames[-1]
    if last >= film.frames + _AT_THE_END:
        raise FinloopError(
            f"the tracks continue to frame {last}, and the film has {film.frames} frames",
            "tracks of this film, whose frames are counted from 0",
            "use the film that was tracked, or this film's own tracks",
        )
    common = np.isin(clip_frames, tracked_frames)
    share_before_end = float((clip_frames <= last).mean())
    if not common.any() or share_before_end < 0.5:
        raise FinloopError(
            f"the tracks have frames {first} … {last} of the film, and the clip shows "
            f"its frames {clip_frames.min()} … {clip_frames.max()}",
            "tracks that show frames of the clip, and continue to at least its middle",
            "set clip.start_s and clip.end_s to the range that was tracked; frames count from the "
            "beginning of the film, not from clip.start_s",
        )


def _refuse_unless_px(points: Floats, film: FilmSize) -> None:
    """Raise FinloopError if positions are not in px: outside the picture, or all in a corner.

    points: (rows, k, 2), the given points of an animal in a row; its place is their mean.
    """
    place = np.nanmean(points, axis=1)
    (x0, y0), (x1, y1) = place.min(axis=0), place.max(axis=0)
    if max(-x0, -y0, x1, y1) <= _MOST_NORMALISED:
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
    """Return distances (animals, silhouettes) [px] between animals and silhouettes of a frame.

    A distance is the mean over an animal's points, 0 for points inside the silhouette. It is
    infinite where even the silhouette's box is farther than `most_px`. points: (animals, k, 2) px,
    NaN where missing.
    """
    result = np.full((len(points), len(silhouettes)), np.inf)
    for j, spot in enumerate(silhouettes):
        low, high = np.array(spot.box[:2]), np.array(spot.box[2:])
        outside = np.maximum(np.maximum(low - points, points - high), 0)
        box_distance = np.nanmean(np.hypot(*outside.transpose(2, 0, 1)), axis=1)
        assert spot.outline is not None
        for i in np.flatnonzero(box_distance <= most_px):
            known = points[i][np.isfinite(points[i]).all(axis=1)]
            signed = [cv2.pointPolygonTest(spot.outline, (x, y), True) for x, y in known.tolist()]
            result[i, j] = np.mean(np.maximum(0.0, np.negative(signed)))
    return result


def match_silhouettes(
    points: Floats, silhouettes: Sequence[SilhouettePlace], length_px: float
) -> list[tuple[Outcome, int | None]]:
    """Return an outcome and a silhouette's number for each animal tracked in a frame.

    points: (animals, k, 2) px, each animal's points in the tracks, NaN where missing; length_px: a
    body length. Distances are means over an animal's points. First, each animal takes the nearest
    silhouette, if that is at most 0.1 body lengths away. Then each animal without one takes the
    nearest of the remaining silhouettes, if that is at most a body length away. The outcomes are:

    - "used": the animal has a silhouette to itself, which is that of an isolated fish;
    - "not isolated": it has one to itself, which is not that of an isolated fish (`Outcome`);
    - "shared": several animals have taken its silhouette;
    - "no silhouette": it has taken none, so the number is None.
    """
    if not len(points) or not silhouettes:
        return [("no silhouette", None)] * len(points)
    distance = _silhouette_distances(points, silhouettes, length_px)
    centres = np.array([(spot.x_px, spot.y_px) for spot in silhouettes])
    offset = np.nanmean(points, axis=1)[:, None] - centres
    # of overlapping silhouettes the one with the nearest centre
    distance += _TIE * np.hypot(*offset.transpose(2, 0, 1))
    nearest = distance.argmin(axis=1)
    within = distance.min(axis=1) <= _WITHIN * length_px
    distance[:, np.unique(nearest[within])] = np.inf  # not free for animals that are within none
    chosen = np.where(within, nearest, distance.argmin(axis=1))
    has_silhouette = within | (distance.min(axis=1) <= length_px)
    claims = Counter(chosen[has_silhouette].tolist())

    result: list[tuple[Outcome, int | None]] = []
    for j, has in zip(chosen.tolist(), has_silhouette, strict=True):
        if not has:
            result.append(("no silhouette", None))
        elif claims[j] > 1:
            result.append(("shared", j))
        else:
            result.append(("used" if silhouettes[j].isolated else "not isolated", j))
    return result


class ExternalTrackLinker:
    """Links silhouettes to tracks by another program's positions of animals.

    A run is successive frames in which the animal has its own isolated silhouette; at least
    `least_frames` make a track. The animal's k-th run, both from 0, is track animal + k · animals,
    so `track_id % len(names)` is the animal.

    outcomes: counts of (animal, outcome of its place); short: number of places in runs that are too
    short. Both are complete after the last frame.
    """

    def __init__(self, given: ExternalTracks, length_px: float, least_frames: int) -> None:
        """Start without tracks; length_px: a body length; least_frames: shortest track."""
        self._given, self._length, self._least = given, length_px, least_frames
        self.outcomes: Counter[tuple[int, Outcome]] = Counter()
        self.short = 0

    def outcome_counts(self) -> Counter[Outcome]:
        """Return how many positions of all animals had each outcome."""
        counts = Counter[Outcome]()
        for (_, outcome), count in self.outcomes.items():
            counts[outcome] += count
        return counts

    def link_frames(
        self, detections: Iterable[Detections], cuts: Sequence[int] = ()
    ) -> Iterator[tuple[Counter[Verdict], list[TrackedFish]]]:
        """Yield for each frame the verdict counts, and the fish of tracks that are long enough.

        When a run becomes long enough, all its fish until then are yielded. cuts: numbers of frames
        before which the film is cut, and runs end.
        """
        waiting: dict[int, list[TrackedFish]] = {}  # by animal, runs that are still too short
        running: dict[int, int] = {}  # animal → its track, of runs that are long enough
        runs: Counter[int] = Counter()  # long runs so far, by animal
        for number, detected in enumerate(detections):
            seen = {
                animal: TrackedFish(0, number, fish)  # the track is set below
                for animal, fish in self._find_animals(number, detected)
            }
            if number in cuts:
                self._end_runs(set(), waiting, running)
            self._end_runs(set(seen), waiting, running)
            ready: list[TrackedFish] = []
            for animal, tracked in seen.items():
                waiting.setdefault(animal, []).append(tracked)
                if animal not in running and len(waiting[animal]) >= self._least:
                    # A number that no other run of this or another animal has.
                    running[animal] = animal + runs[animal] * len(self._given.names)
                    runs[animal] += 1
                if animal in running:
                    ready += [f._replace(track_id=running[animal]) for f in waiting.pop(animal)]
            yield Counter(detected.verdicts), ready
        self._end_runs(set(), waiting, running)

    def _find_animals(
        self, number: int, detected: Detections
    ) -> Iterator[tuple[int, SegmentedFish]]:
        """Yield each animal that has a silhouette to itself in a frame, with its measures.

        The outcomes of all animals are counted. number: of the frame; detected: in it.
        """
        rows = self._given.rows_of_frame(number)
        animals = self._given.individual[rows].tolist()
        matches = match_silhouettes(self._given.points[rows], detected.spots, self._length)
        for animal, (outcome, silhouette) in zip(animals, matches, strict=True):
            self.outcomes[animal, outcome] += 1
            fish = None if silhouette is None else detected.fish[silhouette]
            if outcome == "used" and fish is not None:  # it has a backbone
                yield animal, fish

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
        """Return how well another program's positions match silhouettes, by name."""
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
        """End the runs of animals that are not seen in a frame; count fish of short runs.

        waiting: fish of runs that are too short so far; running: number of the track of long ones;
        both by animal, and changed.
        """
        for animal in [animal for animal in waiting if animal not in seen]:
            self.short += len(waiting.pop(animal))
        for animal in [animal for animal in running if animal not in seen]:
            del running[animal]


def longest_run_frames(given: ExternalTracks) -> int:
    """Return the length of the longest gapless run of frames in which one animal is tracked."""
    frame = np.repeat(np.arange(len(given.start)), given.stop - given.start)
    row = np.concatenate([np.arange(a, b) for a, b in zip(given.start, given.stop, strict=True)])
    animal = given.individual[row]
    order = np.lexsort((frame, animal))
    begins_run = (np.diff(frame[order]) != 1) | (np.diff(animal[order]) != 0)
    edges = np.flatnonzero(np.concatenate([[True], begins_run, [True]]))
    return int(np.diff(edges).max())


class SilhouetteFit(NamedTuple):
    """How well another program's positions agree with silhouettes in sample frames.

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
        """Return the smallest `share` with which tracks are accepted as tracks of this film.

        It is midway from `chance` to 1, at most 0.9. Tracks of another film agree by chance alone.
        So do this film's tracks where animals rest, which then must agree nearly always.
        """
        return min(_MOST_NEEDED, (1 + self.chance) / 2)


def measure_silhouette_fit(
    tracks: ExternalTracks, frames: Sequence[int],
    silhouettes: Sequence[Sequence[SilhouettePlace]], length_px: float,
) -> SilhouetteFit:  # fmt: skip
    """Return how well another program's positions agree with silhouettes of sample frames.

    frames: numbers of the sample frames; silhouettes: those of each; length_px: a body length. With
    a single frame, the agreement by chance is 0.
    """
    shift = len(frames) // 2
    near_now, near_by_chance = [], []
    for number, frame in enumerate(frames):
        points = tracks.points[tracks.rows_of_frame(frame)]
        near_now.append(_have_near_silhouette(points, silhouettes[number], length_px))
        if shift:
            elsewhen = silhouettes[(number + shift) % len(frames)]  # half of the film away
            near_by_chance.append(_have_near_silhouette(points, elsewhen, length_px))
    near = np.concatenate(near_now)
    animals = np.concatenate([tracks.individual[tracks.rows_of_frame(frame)] for frame in frames])
    lost = tuple(
        int(animal)
        for animal in np.unique(animals)
        if (animals == animal).sum() > 2 and not near[animals == animal].any()
    )
    chance = float(np.concatenate(near_by_chance).mean()) if near_by_chance else 0.0
    return SilhouetteFit(
        share=float(near.mean()), chance=chance, places=len(near), lost=lost,
        seen=max(map(len, silhouettes)),
    )  # fmt: skip


def _have_near_silhouette(
    points: Floats, silhouettes: Sequence[SilhouettePlace], length_px: float
) -> Mask:
    """Return a mask (animals,) of animals with a silhouette within a body length.

    points: (animals, k, 2) px, where they are; length_px: a body length.
    """
    if not silhouettes or not len(points):
        return np.zeros(len(points), bool)
    return _silhouette_distances(points, silhouettes, length_px).min(axis=1) <= length_px


def refuse_other_film(tracks: ExternalTracks, fit: SilhouetteFit) -> None:
    """Raise FinloopError if tracks seem to be of another film: few positions have a silhouette."""
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
