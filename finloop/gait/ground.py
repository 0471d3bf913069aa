"""Keep feet on the ground: between key frames drawn by hand they slide and sink a little.

While a foot is on the ground, the body passes over it at a constant speed. In the body frame the
foot moves straight back at that speed, the same for every foot. If a foot moves differently, its
limb is sheared: the top, on the body, stays; the foot moves as a whole and keeps its shape.

The points of a contour slide along it a little when parts of the limb become longer or shorter, so
they do not move as the foot does. Instead a rigid motion is fitted to the points' motion across the
contour. Its value at the point of contact counts: a foot that rolls over its toes does not slide.

Contours of one cycle (f, n, 2), frame k at phase k / f, x right, y down.
"""

from collections.abc import Mapping, Sequence
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
Limbs = Mapping[str, Sequence[str]]
"""By limb: the ids of its contours."""


class FootPath(NamedTuple):
    """How a foot moves in one contact with the ground.

    frames (k,): numbers of the frames; displacement (k,): of the foot in x, drawing units.
    """

    frames: Ints
    displacement: Points


Paths = dict[str, list[FootPath]]
"""By id of a limb: a path for each of its times on the ground in a cycle."""


class Ground(NamedTuple):
    """The speed of the ground under a walking animal, and how far each foot slides on it."""

    # speed of the ground in the body frame, drawing units a frame; negative to the left
    speed: float
    # by id: largest deviation of the foot from the ground's motion in a support, peak to peak,
    # drawing units
    slide: dict[str, float]


def support_frames(spans: tuple[tuple[float, float], ...], frames: int) -> list[Ints]:
    """Return the numbers of the frames in which a foot is on the ground, an array for each span.

    spans: of phase, (from, to) in cycles, both ends included; frames: how many a cycle has. Numbers
    from `frames` on belong to the next cycle. A span in which no frame lies gives no array.
    """
    rounding = 1e-9  # cycles: a span that ends at a frame includes it
    runs = []
    for start, end in spans:
        first = int(np.ceil((start - rounding) * frames))
        last = int(np.floor((end + rounding) * frames))
        if last >= first:
            runs.append(np.arange(first, last + 1))
    return runs


def measure_ground(
    contours: Mapping[str, Points], support: Support, limbs: Limbs | None = None
) -> Ground:
    """Return the ground speed that fits all feet on the ground best, and how far each foot slides.

    contours: (frames, n, 2) of one cycle by id; support: spans of phase on the ground by limb;
    limbs: see `plant_feet`.
    """
    return _fit_ground(_foot_paths(_collect_limbs(contours, limbs), support))


def plant_feet(
    contours: Mapping[str, Points], support: Support, limbs: Limbs | None = None
) -> dict[str, Points]:
    """Return contours, each limb sheared so that its foot neither slides nor sinks into the ground.

    contours: (frames, n, 2) of one cycle by id; support: spans of phase on the ground by limb;
    limbs: the contours of each limb, which are sheared as one; without it, each is a limb. While a
    foot is lifted, the correction changes smoothly from one span to the next. Limbs outside
    `support` are unchanged. FinloopError if a limb has no height.
    """
    stacks = _collect_limbs(contours, limbs)
    paths = _foot_paths(stacks, support)
    speed = _fit_ground(paths).speed
    planted = dict(contours)
    for limb, foot_paths in paths.items():
        sheared = _shear_limb(limb, stacks[limb], foot_paths, speed)
        planted |= dict(zip((limbs or {}).get(limb, [limb]), sheared, strict=True))
    return planted


def _collect_limbs(contours: Mapping[str, Points], limbs: Limbs | None) -> dict[str, list[Points]]:
    """Return the contours (frames, n, 2) of each limb; by default, each contour is a limb."""
    if limbs is None:
        return {name: [stack] for name, stack in contours.items()}
    return {limb: [contours[name] for name in names] for limb, names in limbs.items()}


def foot_displacement(*contours: Points) -> Points:
    """Return how far (frames,) a limb's foot has moved in x since frame 0.

    contours: of the limb, (frames, n, 2) each.
    """
    frames = list(zip(*contours, strict=True))
    steps = [_foot_shift(frame, next_frame) for frame, next_frame in pairwise(frames)]
    return np.concatenate([[0.0], np.cumsum(steps)])


def _foot_shift(contours: Sequence[Points], next_contours: Sequence[Points]) -> float:
    """Return how far in x a limb's foot moves between two frames, where it touches the ground.

    The contours (n, 2) are those of a limb, y down. A rigid motion (x, y, turn about the place of
    contact) is fitted to the points' motion across the contours; along them they slide without the
    foot.
    """
    middles = [(one + other) / 2 for one, other in zip(contours, next_contours, strict=True)]
    along = np.concatenate([np.roll(m, -1, axis=0) - np.roll(m, 1, axis=0) for m in middles])
    middle, step = np.concatenate(middles), np.concatenate(next_contours) - np.concatenate(contours)
    # The normal at each point. Its length, that of the point's piece of contour, weights the point.
    normal = along[:, ::-1] * [1, -1]
    y = middle[:, 1]
    is_foot = y >= y.max() - PAW * np.ptp(y)
    contact = middle[y >= y.max() - SOLE * np.ptp(y)].mean(axis=0)
    arm = middle - contact
    motion_per_radian = arm[:, 0] * normal[:, 1] - arm[:, 1] * normal[:, 0]
    # Motion across the contour: by 1 in x, by 1 in y and by a turn of 1 rad; then the true one.
    unit_motions = np.column_stack([normal, motion_per_radian])[is_foot]
    motion = (step * normal).sum(axis=1)[is_foot]
    x, _y, _turn = np.linalg.lstsq(unit_motions, motion, rcond=None)[0]
    return float(x)


def _foot_paths(limbs: Mapping[str, list[Points]], support: Support) -> Paths:
    """Return the path of each limb's foot in each of its contacts with the ground.

    Limbs that are never on the ground are left out. limbs: contours (frames, n, 2) of one cycle by
    limb; support: spans of phase on the ground by limb.
    """
    paths: Paths = {}
    for name, stacks in limbs.items():
        if runs := support_frames(support.get(name, ()), len(stacks[0])):
            paths[name] = [
                FootPath(run, foot_displacement(*(stack[run % len(stack)] for stack in stacks)))
                for run in runs
            ]
    return paths


def _fit_ground(paths: Paths) -> Ground:
    """Return the ground speed that fits all foot paths best, and how far each foot slides.

    The speed, in drawing units a frame, is the common slope of straight lines through the paths
    (least squares); 0 without paths. A slide is measured from peak to peak, in drawing units.
    """
    time_squares, products = [], []
    for paths_of_foot in paths.values():
        for path in paths_of_foot:
            time = path.frames - path.frames.mean()
            time_squares.append(float(time @ time))
            products.append(float(time @ (path.displacement - path.displacement.mean())))
    speed = sum(products) / sum(time_squares) if any(time_squares) else 0.0
    slide = {
        name: max(float(np.ptp(path.displacement - speed * path.frames)) for path in paths_of_foot)
        for name, paths_of_foot in paths.items()
    }
    return Ground(speed, slide)


def _shear_limb(
    name: str, stacks: list[Points], foot_paths: list[FootPath], speed: float
) -> list[Points]:
    """Return a limb's contours (frames, n, 2), sheared so that its foot moves with the ground.

    The top of the limb stays. name: of the limb, for messages; foot_paths: one for each time on the
    ground; speed: of the ground, drawing units a frame. FinloopError if the limb has no height.
    """
    contours = np.concatenate(stacks, axis=1)
    frames = len(contours)
    top, low = contours[..., 1].min(axis=1), contours[..., 1].max(axis=1)
    if not (low - top > FLAT * (low - top).max()).all():
        raise FinloopError(
            f"the limb {name!r} has no height", "a limb that stands on its foot", "draw it upright"
        )
    standing = np.concatenate([path.frames for path in foot_paths]) % frames
    ground_y = float(low[standing].max())
    # How far to move the foot right and down, at first only where it is on the ground: back by what
    # it moves more than the ground does, but for the mean of that, and onto the ground.
    foot_shift = np.full((frames, 2), np.nan)
    for path in foot_paths:
        frame, slide = path.frames % frames, path.displacement - speed * path.frames
        foot_shift[frame] = np.stack([slide.mean() - slide, ground_y - low[frame]], axis=1)
    foot_shift = _fill_shifts(foot_shift)
    foot_shift[:, 1] = np.minimum(foot_shift[:, 1], ground_y - low)  # never below the ground
    # 0 at the top of the limb, 1 in the whole foot, which keeps its shape
    share = (contours[..., 1] - top[:, None]) / (low - top)[:, None] / (1 - FOOT)
    sheared = contours + np.minimum(share, 1)[..., None] * foot_shift[:, None]
    return np.split(sheared, np.cumsum([stack.shape[1] for stack in stacks])[:-1], axis=1)


def _fill_shifts(shift: Points) -> Points:
    """Return the shifts (frames, 2) of a repeating cycle, NaN replaced by smooth values."""
    frames, known = len(shift), np.flatnonzero(~np.isnan(shift[:, 0]))
    filled = shift.copy()
    # After the last known frame comes the first again, a cycle later.
    for start, end in pairwise([*known, known[0] + frames]):
        between = np.arange(start + 1, end)
        time = (between - start) / (end - start)
        share = (time * time * (3 - 2 * time))[:, None]  # from 0 to 1, level at both
        filled[between % frames] = (1 - share) * shift[start] + share * shift[end % frames]
    return filled
