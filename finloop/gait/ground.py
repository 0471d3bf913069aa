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


def supports(spans: tuple[tuple[float, float], ...], frames: int) -> list[Ints]:
    """Return the frame numbers of each span of support (from, to), ends included.

    spans: phases in cycles; frames: frames of one cycle. A number may exceed `frames`.
    """
    room = 1e-9
    ends = [(np.ceil((a - room) * frames), np.floor((b + room) * frames)) for a, b in spans]
    return [np.arange(int(a), int(b) + 1) for a, b in ends if b >= a]


def ground(limbs: Mapping[str, Points], support: Support) -> Ground:
    """Return the ground speed that fits all supporting feet best, and how far each foot slides.

    limbs: contours (frames, n, 2) of one cycle by id; support: spans of phase by id.
    """
    return _ground(_paths(limbs, support))


def plant_feet(limbs: Mapping[str, Points], support: Support) -> dict[str, Points]:
    """Return the limbs, sheared so that supporting feet move with the ground and none is below it.

    limbs: contours (frames, n, 2) of one cycle by id; support: spans of phase by id. During the
    swing the correction changes smoothly from one support to the next. Ids outside `support` are
    unchanged. FinloopError if a limb has no height.
    """
    paths = _paths(limbs, support)
    speed = _ground(paths).speed
    return {
        name: _shear_limb(name, stack, paths[name], speed) if name in paths else stack
        for name, stack in limbs.items()
    }


def foot_displacement(stack: Points) -> Points:
    """Return how far the foot of a limb (f, n, 2) moves in x since the first frame: (f,)."""
    return np.concatenate([[0.0], np.cumsum([_foot_step(*pair) for pair in pairwise(stack)])])


def _foot_step(here: Points, there: Points) -> float:
    """Return the foot's motion in x at its contact, between two contours (n, 2), closed or open."""
    middle = (here + there) / 2
    along = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    across = along[:, ::-1] * [1, -1]  # length: the point's piece of contour
    y = middle[:, 1]
    foot = y >= y.max() - PAW * np.ptp(y)
    touch = middle[y >= y.max() - SOLE * np.ptp(y)].mean(axis=0)
    arm = middle - touch
    turn = arm[:, 0] * across[:, 1] - arm[:, 1] * across[:, 0]
    motion = np.column_stack([across, turn])[foot]
    displacement = ((there - here) * across).sum(axis=1)[foot]
    return float(np.linalg.lstsq(motion, displacement, rcond=None)[0][0])


def _paths(limbs: Mapping[str, Points], support: Support) -> Paths:
    """Return the frames of each support, and the displacement of the foot in them, by id."""
    paths: Paths = {}
    for name, stack in limbs.items():
        if runs := supports(support.get(name, ()), len(stack)):
            paths[name] = [(run, foot_displacement(stack[run % len(stack)])) for run in runs]
    return paths


def _ground(paths: Paths) -> Ground:
    """Return the ground speed that fits all paths of feet best, and how far each foot slides."""
    runs = [
        (run - run.mean(), way - way.mean()) for supports in paths.values() for run, way in supports
    ]
    spread = sum(float(run @ run) for run, _ in runs)
    speed = sum(float(run @ way) for run, way in runs) / spread if spread else 0.0
    slide = {
        name: max(float(np.ptp(way - speed * run)) for run, way in supports)
        for name, supports in paths.items()
    }
    return Ground(speed, slide)


def _shear_limb(name: str, stack: Points, ways: list[tuple[Ints, Points]], speed: float) -> Points:
    """Return the limb's contours, sheared so that its foot moves with the ground in supports."""
    frames = len(stack)
    top, low = stack[..., 1].min(axis=1), stack[..., 1].max(axis=1)
    if not (low - top > FLAT * (low - top).max()).all():
        raise FinloopError(
            f"the limb {name!r} has no height", "a limb that stands on its foot", "draw it upright"
        )
    level = float(np.median(low[np.concatenate([run for run, _ in ways]) % frames]))
    shift = np.full((frames, 2), np.nan)
    for run, way in ways:
        frame, slid = run % frames, way - speed * run
        shift[frame] = np.stack([slid.mean() - slid, level - low[frame]], axis=1)
    shift = _interpolate_shifts(shift)
    shift[:, 1] = np.minimum(shift[:, 1], level - low)  # never below the ground
    share = (stack[..., 1] - top[:, None]) / (low - top)[:, None] / (1 - FOOT)
    return stack + np.minimum(share, 1)[..., None] * shift[:, None]


def _interpolate_shifts(shift: Points) -> Points:
    """Return the shifts (f, 2) of a cycle, missing ones (NaN) interpolated smoothly."""
    frames, present = len(shift), np.flatnonzero(~np.isnan(shift[:, 0]))
    out = shift.copy()
    for here, there in zip(present, np.append(present[1:], present[0] + frames), strict=True):
        between = np.arange(here + 1, there)
        s = (between - here) / (there - here)
        s = (s * s * (3 - 2 * s))[:, None]
        out[between % frames] = (1 - s) * shift[here] + s * shift[there % frames]
    return out
