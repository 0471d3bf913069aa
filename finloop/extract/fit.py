"""Prepare another program's poses for a clip, and check whether they belong to this film."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses
from finloop.extract.given import SHOWN_ALONE, Given, distances
from finloop.extract.settings import ExtractSettings
from finloop.extract.tracks import SilhouettePlace

HEADS = ("nosetip", "nose", "snout", "rostrum", "mouth", "headtip", "head")
TAILS = ("tailtip", "tailend", "tailfin", "caudalfin", "caudal", "tail", "tailbase", "peduncle")
"""Common names of keypoints, without case and signs; the first one that exists counts."""
_MOST_NORMAL = 1.5  # px; if all places are nearer to the corner, they are shares of the picture
_AT_THE_END = 12  # frames by which two decoders may disagree about the end of a film
_MOST_NEEDED = 0.9  # share of places, see `SilhouetteFit.least_share`


class FilmSize(NamedTuple):
    """The size of the film that was tracked: its frames, and its picture."""

    frames: int
    width_px: int
    height_px: int


def map_poses_to_clip(
    poses: Poses, clip_frames: NDArray[np.integer], film: FilmSize, p: ExtractSettings
) -> tuple[Given, str | None, str | None]:
    """Return another program's poses by frames of the clip, and its head and tail keypoints.

    The names of these keypoints are None where it has none. clip_frames: (frames of the clip,) the
    film's frame that each shows. FinloopError if a named keypoint is missing, the file has places
    beyond the film's end or none in the clip, or the places are not in px of the picture.
    """
    head = keypoint(poses.keypoints, p.tracks_head_keypoint, HEADS, "extract.tracks_head_keypoint")
    tail = keypoint(poses.keypoints, p.tracks_tail_keypoint, TAILS, "extract.tracks_tail_keypoint")
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
    tracks = Given(
        poses.individuals,
        poses.individual[rows],
        points,
        none if head is None else points[:, poses.keypoints.index(head)],
        none if tail is None else points[:, poses.keypoints.index(tail)],
        np.searchsorted(frame, clip_frames, side="left"),
        np.searchsorted(frame, clip_frames, side="right"),
    )
    return tracks, head, tail


def keypoint(
    keypoints: Sequence[str], name: str, common: Sequence[str], parameter: str
) -> str | None:
    """Return the keypoint called `name`; for `auto` the first one that has a common name.

    It is None for `none`, and where `auto` finds nothing. keypoints: names in the file; common:
    common names, the best first. FinloopError if a named keypoint does not exist; it mentions
    `parameter`.
    """
    if name == "auto":
        plain = {re.sub(r"[^a-z]", "", one.lower()): one for one in reversed(keypoints)}
        return next((plain[one] for one in common if one in plain), None)
    if name == "none" or name in keypoints:
        return None if name == "none" else name
    raise FinloopError(
        f"the tracks have no keypoint {name!r}",
        f"one of {', '.join(keypoints)}; or auto, or none",
        f"correct {parameter}",
    )


def _refuse_other_length(
    frame: NDArray[np.integer], clip_frames: NDArray[np.integer], film: FilmSize
) -> None:
    if frame[-1] >= film.frames + _AT_THE_END:
        raise FinloopError(
            f"the tracks continue to frame {frame[-1]}, and the film has {film.frames} frames",
            "tracks of this film, whose frames are counted from 0",
            "use the film that was tracked, or this film's own tracks",
        )
    common = np.isin(clip_frames, frame)
    reached = float((clip_frames <= frame[-1]).mean())
    if not common.any() or reached < 0.5:
        raise FinloopError(
            f"the tracks have frames {frame[0]} … {frame[-1]} of the film, and the clip shows "
            f"its frames {clip_frames.min()} … {clip_frames.max()}",
            "tracks of at least half of the clip",
            "set clip.start_s and clip.end_s to the range that was tracked; frames count from the "
            "beginning of the film, not from clip.start_s",
        )


def _refuse_other_units(points: Floats, film: FilmSize) -> None:
    """Raise FinloopError if most places lie outside the picture, or all in its first pixels."""
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


class SilhouetteFit(NamedTuple):
    """How well given places agree with silhouettes in sample frames.

    share: of the places, those with a silhouette of any kind within a body length, 0 … 1; chance:
    the same share with silhouettes of other moments; places: their number; lost: numbers of the
    animals that have three places or more, and never a silhouette; seen: most silhouettes in a
    frame.
    """

    share: float
    chance: float
    places: int
    lost: tuple[int, ...]
    seen: int

    @property
    def least_share(self) -> float:
        """Return the `share` that tracks of this film need: midway from `chance` to 1, at most 0.9.

        Tracks of another film agree by chance alone. So do this film's tracks where animals rest,
        which then must agree nearly always.
        """
        return min(_MOST_NEEDED, (1 + self.chance) / 2)


def fit_to_silhouettes(
    tracks: Given,
    frames: Sequence[int],
    spots: Sequence[Sequence[SilhouettePlace]],
    length_px: float,
) -> SilhouetteFit:
    """Return how well given places agree with the silhouettes of sample frames.

    frames: numbers of the sample frames; spots: the silhouettes of each; length_px: a body length.
    """
    shift = len(frames) // 2
    own, other = [], []
    for number, frame in enumerate(frames):
        points = tracks.points[tracks.rows(frame)]
        own.append(_near(points, spots[number], length_px))
        if shift:
            other.append(_near(points, spots[(number + shift) % len(frames)], length_px))
    near = np.concatenate(own)
    animals = np.concatenate([tracks.individual[tracks.rows(frame)] for frame in frames])
    lost = tuple(
        int(animal)
        for animal in np.unique(animals)
        if (animals == animal).sum() > 2 and not near[animals == animal].any()
    )
    chance = float(np.concatenate(other).mean()) if other else 0.0
    return SilhouetteFit(float(near.mean()), chance, len(near), lost, max(map(len, spots)))


def _near(points: Floats, spots: Sequence[SilhouettePlace], length_px: float) -> NDArray[np.bool_]:
    if not spots or not len(points):
        return np.zeros(len(points), bool)
    return distances(points, spots, length_px).min(axis=1) <= length_px


def refuse_other_film(tracks: Given, agreement: SilhouetteFit, film: FilmSize) -> None:
    """Raise FinloopError if fewer given places have a silhouette than tracks of this film need."""
    if agreement.share >= agreement.least_share:
        return
    place = np.nanmean(tracks.points, axis=1)
    (x0, y0), (x1, y1) = place.min(axis=0), place.max(axis=0)
    lost = ", ".join(tracks.names[animal] for animal in agreement.lost[:8])
    raise FinloopError(
        f"of {agreement.places} places of {len(tracks.names)} animals in sample frames "
        f"{agreement.share:.0%} show an animal; at other moments of the film it is "
        f"{agreement.chance:.0%}. At most {agreement.seen} silhouettes are seen in a frame; "
        f"places lie at x {x0:.4g} … {x1:.4g}, y {y0:.4g} … {y1:.4g} of a picture of "
        f"{film.width_px}×{film.height_px}" + (f"; never at an animal: {lost}" if lost else ""),
        f"tracks of this film: at least {agreement.least_share:.0%}, midway between chance and all",
        "use this film's tracks, in px (extract.tracks_px_per_unit), without animals that are not "
        f"there; where they are this film's, {SHOWN_ALONE}",
    )
