"""Feet on the ground: between key frames drawn by hand, feet slide and sink a little.

While a foot is on the ground, the body passes over it at a constant speed. In the body frame the
foot moves straight back at that speed, the same for every foot. If a foot moves differently, its
limb is sheared: the top, on the body, stays; the foot moves as a whole and keeps its shape.

The points of a contour slide along it a little when parts of the limb become longer or shorter, so
they do not move as the foot does. Instead a rigid motion is fitted to the points' motion across the
contour. Its value at the point of contact counts: a foot that rolls over its toes does not slide.

Contours of one cycle (f, n, 2), frame k at phase k / f, x right, y down.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Ints, Points
from finloop.base.errors import FinloopError

FOOT = 0.25  # share of a limb's height that moves as one
PAW = 0.15  # share of a limb's height whose motion is measured
FLAT = 0.01  # least height of a limb, as a share of its greatest height
SOLE = 0.03  # share of a limb's height that touches the ground

Support = Mapping[str, tuple[tuple[float, float], ...]]
Paths = dict[str, list[tuple[Ints, Points]]]
"""By id: for each support its frames, and the foot's displacement at each frame."""


class Ground(NamedTuple):
    """The speed of the ground under a walking animal, and how far each foot slides on it."""

    # speed of the ground in the body frame, drawing units a frame; negative to the left
    speed: float
    # by id: largest deviation of the foot from the ground's motion in a support, peak to peak,
    # drawing units
    slide: dict[str, float]


def support_frames(spans: tuple[tuple[float, float], ...], frames: int) -> list[Ints]:
    """Return the numbers of the frames in which a foot is on the ground, for each span of phase.

    spans: (from, to) in cycles, both ends included; frames: number of frames of a cycle. A returned
    number may exceed it.
    """
    room = 1e-9
    ends = [(np.ceil((a - room) * frames), np.floor((b + room) * frames)) for a, b in spans]
    return [np.arange(int(a), int(b) + 1) for a, b in ends if b >= a]


def measure_ground(limbs: Mapping[str, Points], support: Support) -> Ground:
    """Return the ground speed that fits all feet on the ground best, and how far each foot slides.

    limbs: contours (frames, n, 2) of one cycle by id; support: spans of phase on the ground by id.
    """
    return _fit_ground(_foot_paths(limbs, support))


def plant_feet(limbs: Mapping[str, Points], support: Support) -> dict[str, Points]:
    """Shear limbs so that feet on the ground do not slide on it, and no foot is below it.

    limbs: contours (frames, n, 2) of one cycle by id; support: spans of phase on the ground by id.
    While a foot is lifted, the correction changes smoothly from one span to the next. Ids outside
    `support` are unchanged. FinloopError if a limb has no height.
    """
    paths = _foot_paths(limbs, support)
    speed = _fit_ground(paths).speed
    return {
        name: _shear_limb(name, stack, paths[name], speed) if name in paths else stack
        for name, stack in limbs.items()
    }


def foot_displacement(limb: Points) -> Points:
    """Return how far the foot of a limb (frames, n, 2) has moved in x since the first frame."""
    return np.concatenate([[0.0], np.cumsum([_foot_shift(*pair) for pair in pairwise(limb)])])


def _foot_shift(contour: Points, next_contour: Points) -> float:
    """Return how far a foot moves in x, where it is on the ground, between two contours (n, 2)."""
    middle = (contour + next_contour) / 2
    along = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    across = along[:, ::-1] * [1, -1]  # length: the point's piece of contour
    y = middle[:, 1]
    foot = y >= y.max() - PAW * np.ptp(y)
    touch = middle[y >= y.max() - SOLE * np.ptp(y)].mean(axis=0)
    arm = middle - touch
    turn = arm[:, 0] * across[:, 1] - arm[:, 1] * across[:, 0]
    motion = np.column_stack([across, turn])[foot]
    displacement = ((next_contour - contour) * across).sum(axis=1)[foot]
    return float(np.linalg.lstsq(motion, displacement, rcond=None)[0][0])


def _foot_paths(limbs: Mapping[str, Points], support: Support) -> Paths:
    """Return, for each foot and each time on the ground, its frames and its displacement in them.

    They are listed by id. limbs, support as in `measure_ground`.
    """
    paths: Paths = {}
    for name, stack in limbs.items():
        if runs := support_frames(support.get(name, ()), len(stack)):
            paths[name] = [(run, foot_displacement(stack[run % len(stack)])) for run in runs]
    return paths


def _fit_ground(paths: Paths) -> Ground:
    """Return the ground speed that fits all foot paths best, and how far each foot slides."""
    runs = [
        (run - run.mean(), displacement - displacement.mean())
        for supports in paths.values()
        for run, displacement in supports
    ]
    spread = sum(float(run @ run) for run, _ in runs)
    speed = sum(float(run @ displacement) for run, displacement in runs) / spread if spread else 0.0
    slide = {
        name: max(float(np.ptp(displacement - speed * run)) for run, displacement in supports)
        for name, supports in paths.items()
    }
    return Ground(speed, slide)


def _shear_limb(
    name: str, contours: Points, foot_paths: list[tuple[Ints, Points]], speed: float
) -> Points:
    """Return a limb's contours (frames, n, 2), sheared so that its foot moves with the ground.

    name: of the limb, for messages; foot_paths: the frames of each span on the ground and the
    foot's displacement in them; speed: of the ground, drawing units a frame.
    """
    frames = len(contours)
    top, low = contours[..., 1].min(axis=1), contours[..., 1].max(axis=1)
    if not (low - top > FLAT * (low - top).max()).all():
        raise FinloopError(
            f"the limb {name!r} has no height", "a limb that stands on its foot", "draw it upright"
        )
    level = float(np.median(low[np.concatenate([run for run, _ in foot_paths]) % frames]))
    shift = np.full((frames, 2), np.nan)
    for run, displacement in foot_paths:
        frame, slid = run % frames, displacement - speed * run
        shift[frame] = np.stack([slid.mean() - slid, level - low[frame]], axis=1)
    shift = _fill_shifts(shift)
    shift[:, 1] = np.minimum(shift[:, 1], level - low)  # never below the ground
    share = (contours[..., 1] - top[:, None]) / (low - top)[:, None] / (1 - FOOT)
    return contours + np.minimum(share, 1)[..., None] * shift[:, None]


def _fill_shifts(shift: Points) -> Points:
    """Interpolate the missing shifts (NaN) of a cycle smoothly: (f, 2)."""
    frames, present = len(shift), np.flatnonzero(~np.isnan(shift[:, 0]))
    out = shift.copy()
    for start, end in zip(present, np.append(present[1:], present[0] + frames), strict=True):
        between = np.arange(start + 1, end)
        s = (between - start) / (end - start)
        s = (s * s * (3 - 2 * s))[:, None]
        out[between % frames] = (1 - s) * shift[start] + s * shift[end % frames]
    return out
