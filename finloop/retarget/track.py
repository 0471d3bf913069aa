"""A recorded track: points along one animal's body, frame by frame, as in its file."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses
from finloop.extract.backbone import resample_line
from finloop.extract.given import HEADS, TAILS, find_keypoint
from finloop.features.area import interpolate_lines
from finloop.retarget.settings import RetargetSettings

_CENTRES = ("centre", "center", "centroid", "mass", "wcentroid")
"""Names of points that have no fixed place along the body."""
_BESIDE = 0.05  # of the distance from head to tail; fins and eyes are farther from that line
_FINE = 4  # times as many samples of a spline as points of the line
_ZIGZAG = 1.5  # times the distance from head to tail; a longer line has its points out of order


class Track(NamedTuple):
    """A recorded track: points along one animal's body, head first, in px of its file.

    frame (t,): numbers in the file, ascending; points (t, m, 2), NaN where not given; along (m,):
    where along the body they are, 0 = head, 1 = tail, NaN = the middle of the animal; length_px: of
    its body, None for a single point. A track of the drawn film also has pose codes (t, c) and its
    rows (t,).
    """

    name: str
    rate_hz: float
    frame: Ints
    points: Floats
    along: Floats
    length_px: float | None
    codes: Floats | None = None
    rows: Ints | None = None

    @property
    def has_postures(self) -> bool:
        """Return whether the track has enough points, 3, to show how the animal is bent."""
        return len(self.along) > 2


def track_from_poses(poses: Poses, rate_hz: float, steps: int, p: RetargetSettings) -> Track:
    """Return the track of one animal, chosen by the settings, in a file of poses.

    rate_hz: frames per second of the file; steps: number of segments of a backbone in the film that
    is to be drawn. A track of three keypoints or more is resampled at the points of such a backbone
    that lie within `p.keypoint_range`. FinloopError if the file has no such animal or keypoint, or
    no usable values of them.
    """
    name, frame, points = _select_animal(poses, p)
    order = body_keypoint_numbers(poses.keypoints, points, p)
    first, last = p.keypoint_range  # shares of the body at which these keypoints begin and end
    if len(order) > 2:
        body_shares = np.arange(steps + 1) / steps
        along = body_shares[(body_shares >= first - 1e-9) & (body_shares <= last + 1e-9)]
        share = (along - first) / (last - first)
        body = resample_body_lines(points[:, order], share, name)
    else:
        head = find_keypoint(poses.keypoints, "auto", HEADS, "retarget.body_keypoints")
        # A single point is the head, or the middle of the animal, which is NaN (`Track`).
        single = 0.0 if poses.keypoints[order[0]] == head else np.nan
        along = np.array([first, last] if len(order) == 2 else [single])
        body = points[:, order]
    complete = np.isfinite(body).all((1, 2))
    if not complete.any():
        raise FinloopError(
            f"{name} has no frame with {', '.join(poses.keypoints[k] for k in order)} at a "
            f"confidence of {p.min_confidence:g} or more",
            "at least one frame with all of them",
            "name visible points (retarget.body_keypoints), or lower retarget.min_confidence",
        )
    return Track(name, rate_hz, frame, body, along, _body_length_px(body[complete], along))


def track_from_backbones(
    name: str, rate_hz: float, frame: Ints, backbone: Floats, steps: int
) -> Track:
    """Return a track of backbones (t, k, 2) px, resampled to steps + 1 points.

    name: of the film they come from, for messages; rate_hz: frames per second of that film; frame
    (t,): their frame numbers; backbone: its k points are equally far apart, head first; steps:
    number of segments of a backbone in the film that is to be drawn.
    """
    along = np.arange(steps + 1) / steps
    points = interpolate_lines(backbone, along * (backbone.shape[1] - 1))
    length_px = _body_length_px(backbone, np.array([0.0, 1.0]))
    return Track(name, rate_hz, frame, points, along, length_px)


def _select_animal(poses: Poses, p: RetargetSettings) -> tuple[str, Ints, Floats]:
    """Return name, frames (t,) and points (t, keypoints, 2) of the animal in the settings.

    Points that are not given, or not confident enough, are NaN. FinloopError if no point is
    confident enough, or there is no such animal.
    """
    confident = ~(poses.confidence < p.min_confidence)  # NaN: unknown
    points = np.where(confident[..., None], poses.places, np.nan)
    is_visible = np.asarray(np.isfinite(points).all(2)).any(1)
    if not is_visible.any():
        raise FinloopError(
            f"no point of the tracks has a confidence of {p.min_confidence:g} or more",
            "points with a higher confidence",
            "lower retarget.min_confidence",
        )
    counts = np.bincount(poses.individual[is_visible], minlength=len(poses.individuals))
    number = choose_animal(p.animal, poses.individuals, counts)
    rows = is_visible & (poses.individual == number)
    return poses.individuals[number], poses.frame[rows], points[rows]


def choose_animal(animal: str | None, names: Sequence[str], counts: Ints) -> int:
    """Return the number of the animal with a name; without one, of the animal in most frames.

    counts: the frames that show each animal. FinloopError if no animal has the name.
    """
    if animal is None:
        return int(np.argmax(counts))
    if animal not in names:
        longest = [names[number] for number in np.argsort(-counts, kind="stable")[:8]]
        raise FinloopError(
            f"the tracks have no animal {animal!r}",
            f"one of their {len(names)} animals; longest visible: {', '.join(longest)}",
            "correct retarget.animal",
        )
    return list(names).index(animal)


def body_keypoint_numbers(keypoints: Sequence[str], points: Floats, p: RetargetSettings) -> Ints:
    """Return the numbers (m,) of the keypoints that lie along the body, head first.

    keypoints: their names; points (t, keypoints, 2) px. Without `retarget.body_keypoints` these are
    head, tail, and the points near the line between them, in the median of all frames; eyes and
    fins lie beside it. Without head or tail it is one point. FinloopError if a named keypoint is
    missing.
    """
    if p.body_keypoints is not None:
        missing = [name for name in p.body_keypoints if name not in keypoints]
        if missing or not p.body_keypoints:
            raise FinloopError(
                f"the tracks have no keypoint {', '.join(missing) or '(the list is empty)'}",
                f"keypoints out of {', '.join(keypoints)}",
                "correct retarget.body_keypoints",
            )
        return np.array([keypoints.index(name) for name in p.body_keypoints])
    head = find_keypoint(keypoints, "auto", HEADS, "retarget.body_keypoints")
    tail = find_keypoint(keypoints, "auto", TAILS, "retarget.body_keypoints")
    if head is None or tail is None or head == tail:
        centre = next((k for k, name in enumerate(keypoints) if _letters_of(name) in _CENTRES), 0)
        return np.array([centre if head is None else keypoints.index(head)])
    first, last = keypoints.index(head), keypoints.index(tail)
    others = [
        k
        for k, name in enumerate(keypoints)
        if k not in (first, last) and _letters_of(name) not in _CENTRES
    ]
    between = _find_points_between(points[:, first], points[:, last], points[:, others])
    return np.array([first, *(others[number] for number in between), last])


def _find_points_between(head: Floats, tail: Floats, points: Floats) -> list[int]:
    """Return which points lie near the line from head to tail, in order along it.

    head, tail (t, 2); points (t, m, 2) px in t frames, NaN where they are not seen. In the median
    of the frames a point must be near the line, and not near an end: there it is the end itself by
    another name.
    """
    chord = tail - head
    square = (chord**2).sum(-1)
    place_of_point = {}  # along the line from head to tail, 0 … 1
    for number in range(points.shape[1]):
        offset = points[:, number] - head
        along = (offset * chord).sum(-1) / square
        beside = (offset[:, 0] * chord[:, 1] - offset[:, 1] * chord[:, 0]) / square
        if np.isfinite(along).any():
            place, is_on_line = np.nanmedian(along), abs(np.nanmedian(beside)) < _BESIDE
            if 0.02 < place < 0.98 and is_on_line:
                place_of_point[number] = place
    return sorted(place_of_point, key=lambda number: place_of_point[number])


def _letters_of(name: str) -> str:
    """Return only the letters of a keypoint's name, in lower case."""
    return "".join(letter for letter in name.lower() if letter.isalpha())


def resample_body_lines(points: Floats, share: Floats, name: str) -> Floats:
    """Return body lines resampled to points (t, m, 2) px, at shares (m,) of their lengths.

    points (t, k, 2) px, in order along the body; share: 0 = first, 1 = last point; name: for
    messages. The line is a cubic spline by the length of the chords between given points. NaN where
    an end is missing, or fewer than three points are given. FinloopError if the line goes back and
    forth.
    """
    is_given = np.asarray(np.isfinite(points).all(2))
    usable = is_given[:, 0] & is_given[:, -1] & (is_given.sum(1) >= 3)
    places = np.full((len(points), len(share), 2), np.nan)
    length_ratios = []  # of each line to the distance between its ends
    for t in np.flatnonzero(usable):
        given = points[t, is_given[t]]
        chords = np.hypot(*np.diff(given, axis=0).T)
        given = given[np.append(True, chords > 0)]
        if len(given) < 3:
            continue
        arc_px = np.append(0.0, np.cumsum(chords[chords > 0]))
        curve = make_interp_spline(arc_px, given, min(3, len(given) - 1))
        dense = curve(np.linspace(0, arc_px[-1], _FINE * len(share) + 1))
        length_ratios.append(arc_px[-1] / max(float(np.hypot(*(given[-1] - given[0]))), 1e-9))
        even_line = resample_line(dense, _FINE * len(share) + 1)
        places[t] = interpolate_lines(even_line[None], share * (len(even_line) - 1))[0]
    if length_ratios and np.median(length_ratios) > _ZIGZAG:
        raise FinloopError(
            f"the line through the points of {name} is {np.median(length_ratios):.1f} times as "
            "long as the distance from the first to the last point: it goes back and forth",
            "points in their order along the body, from head to tail",
            "name them in that order (retarget.body_keypoints)",
        )
    return places


def _body_length_px(points: Floats, along: Floats) -> float | None:
    """Return an animal's body length [px] from its points; None for a single point."""
    if len(along) == 1:
        return None
    lengths_px = np.hypot(*np.moveaxis(np.diff(points, axis=1), -1, 0)).sum(1)
    return float(np.median(lengths_px) / (along[-1] - along[0]))
