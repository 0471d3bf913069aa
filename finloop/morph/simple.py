"""Morph between two simple curves so that every frame is simple (claim of curve paper §4.1).

It is also one between two regions, each a curve and the holes in it, none of which meet
(see the module `regions`). A path between two curves always exists; holes may block each other.

If the linear morph from a to b is simple, it is the result. Otherwise both curves are simplified
step by step into poses a_i and b_j, and the result is the shortest path a → a_i → b_j → b without
folds. Between curves it exists, because the last poses can be joined: two polygons by turning and
stretching about their centres, two lines by turning. Then the motion is smoothed in time, and its
frames are distorted less (`relax`), each vertex by itself; both as far as the motion stays simple.
Closed frames are scaled so that their areas lie between those of the ends, which makes no folds.
Finally every frame is tested exactly.

A curve is simplified by one of three methods. Vertex i stays vertex i, between poses the vertices
move straight, and a step counts only if it is proved free of contact (`morph.folds.stays_simple`).

- `round_off_contours`, closed: curve shortening, x_t = x_uu / |x_u|², makes a simple closed curve
  round before it vanishes, and keeps it simple (Gage 1984, Gage and Hamilton 1986, Grayson 1987).
  The tangential part of this form spreads the vertices evenly. Each step restores the area. The
  theorems hold for smooth curves; for polygons each step is checked.
- `cut_ears`, closed: a polygon of more than three corners has a corner whose triangle with its two
  neighbours is empty (two ears theorem, Meisters 1975). Moved onto the opposite side, it leaves
  one corner less. Every polygon ends as a triangle. This is not pretty, so it only takes over
  where `round_off_contours` fails.
- `straighten_curve`, open: a part of a simple curve is simple, and so is that part enlarged.
  Shorter and shorter parts about the middle end at a line without bends.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import scipy

from finloop.base.arrays import Floats, Ints, Mask, Points
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.curve.contour import Curve, area_centroids, next_corners, signed_area
from finloop.morph.folds import (
    ContourLayout,
    contours_stay_simple,
    count_contour_folds,
    count_folds_unchecked,
    find_contacts,
    stays_simple_unchecked,
)
from finloop.morph.match import FULL, Resolution, match_curves, misfit_by_start
from finloop.morph.regions import SMALL, match_regions, move_holes_inside, pair_regions
from finloop.morph.relax import find_relaxing_moves

GROWTH = 1.3  # factor of the time step, from one pose to the next
STEP = 0.1  # longest time step, in areas of the curve
ROUND = 0.97  # 4π area / length² at which a polygon counts as round; a circle has 1
HALVINGS = 40  # halvings of a time step before giving up
MOST_POSES = 200  # from a polygon to a round one
SHRINK = 0.9  # factor of an open curve's length, from one part to the next
SLOWEST = 0.999  # largest such factor, where the curve meets itself
JOIN = 64  # poses from one round or straight shape to another
PARTS = 16  # steps of a straight motion: small boxes, few pairs to compare
SMOOTHING = (1 / 6, 1 / 12, 1 / 18, 1 / 25, 1 / 40)  # widths in time, as shares of it, widest first
RELAX = 0.7  # factor of the moves to rigid frames, near a fold, again and again until none is left
RELAX_EDGES, RELAX_FRAMES = 5.0, 1.0  # how far from a fold: standard deviations of a Gaussian
RELAX_ROUNDS = 100  # of such factors; if folds are left, no frame is moved
RELAX_SHARE, RELAX_TIMES = 0.9, 2
"""Frames are moved again, so many times in all, where they take less than this share of a move."""
REACH = 10  # edges: width of the mean along a curve
NUDGE = 0.1  # edges: how far a proof may stray from the straight motion between two frames


def morph_without_folds(
    a: Curve, b: Curve, frames: int, points: int, resolution: Resolution = FULL
) -> Points:
    """Return a morph (frames, points, 2) between two curves in which no frame crosses itself.

    The ends are a and b, resampled, at a resolution. FinloopError if one curve is open and the
    other closed, if a curve, resampled, meets itself, or if its parts are too near each other.
    """
    layout = ContourLayout((points,), a.closed)
    return morph_contours(*match_curves(a, b, points, resolution), layout, frames)


def morph_regions_without_folds(
    a: Sequence[Curve],
    b: Sequence[Curve],
    frames: int,
    points: int,
    resolution: Resolution = FULL,
) -> list[Points]:
    """Return a morph between two shapes without folds: (frames, points, 2) for each contour.

    a, b: the closed contours of the shapes, in any order: regions, each one contour and its holes.
    The result has the regions one after the other, the outer contour of each first. In no frame
    does a contour of a region meet itself or another one of that region. A hole without a partner
    grows from a point, or shrinks to one. FinloopError if the shapes have not as many regions,
    their contours meet, or they are too near each other.
    """
    stacks: list[Points] = []
    for first, second in pair_regions(a, b):
        contours_a, contours_b = match_regions(first, second, points, resolution)
        layout = ContourLayout((points,) * len(contours_a))
        stack = morph_contours(
            np.concatenate(contours_a), np.concatenate(contours_b), layout, frames
        )
        stacks += [stack[:, part] for part in layout.parts]
    return stacks


def morph_contours(
    first: Points, second: Points, layout: ContourLayout, frames: int, pinned: bool = False
) -> Points:
    """Return a morph (frames, n, 2) between contours (n, 2) that never meet.

    pinned: whether every point keeps its number; else another point may be the first of the outer
    contour, if the path is shorter.

    FinloopError if the first or the second ones meet, or their parts are too near each other.
    """
    for name, contours in (("first", first), ("second", second)):
        count = count_contour_folds(contours, layout)[0]
        if count:
            raise FinloopError(
                f"the {name} curve, at {layout.sizes[0]} points, meets itself {count} times",
                "a curve that does not meet itself",
                "correct the drawing, set more points, or use the method linear",
            )
    tau = np.linspace(0, 1, frames)[:, None, None]
    linear = (1 - tau) * first + tau * second
    following = layout.following
    has_fold = any(count_folds_unchecked(pose, following, first_only=True) for pose in linear)
    if not has_fold and _has_simple_motion(linear, layout):
        return linear
    stack = _frames_along_path(_find_simple_path(first, second, layout, pinned), frames, layout)
    if count_contour_folds(stack, layout).any():
        raise FinloopError(
            "a morph with frames too narrow to be distinguished from folded frames",
            "curves with some room between their parts",
            "set fewer points (morph.contour_points), or morph.method=linear",
        )
    return stack


def path_lengths(poses: Points) -> Points:
    """Return how far vertices have moved, on average, up to each of the poses (k, n, 2): (k,)."""
    steps = np.hypot(*np.moveaxis(np.diff(poses, axis=0), 2, 0)).mean(axis=1)
    return np.r_[0.0, np.cumsum(steps)]


def _find_simple_path(first: Points, second: Points, layout: ContourLayout, pinned: bool) -> Points:
    """Return poses (k, n, 2) between contours (n, 2), with straight motion without folds.

    Both ends are simplified step by step, and the path is the shortest one on which a straight
    motion joins a pose of each. If none can be joined, it leads through the last, simplest ones.
    pinned: as in `morph_contours`.
    """
    a, b = _simplify_contours(first, layout), _simplify_contours(second, layout)
    length: float = np.inf
    path: Points | None = None
    outer = layout.parts[0]
    keeps_start = pinned or not layout.closed
    for start in [0] if keeps_start else _candidate_starts(a[:, outer], b[:, outer]):
        rolled = b.copy()
        rolled[:, outer] = np.roll(b[:, outer], -start, axis=1)
        shorter = _find_short_path(a, rolled, layout, limit=length)
        if shorter is not None:
            length, path = shorter
    if path is not None:
        return path
    between = _join_simplified_contours(a[-1], b[-1], layout)[1:-1]
    return np.concatenate([a, between, b[::-1]])


def _candidate_starts(a: Points, b: Points) -> list[int]:
    """Return numbers of points of polygon b that may correspond to point 0 of a: at most seven.

    They are 0, and those at which the polygons fit best, if they are more than 1/32 of the points
    apart. a, b (k, n, 2): poses of both, simplified step by step; first, middle and last ones
    count.
    """
    n, starts = a.shape[1], [0]
    for share in (0.0, 0.5, 1.0):  # the curves themselves, half simplified, and simplified
        first, second = (poses[int(share * (len(poses) - 1))] for poses in (a, b))
        misfit = misfit_by_start(first, second)
        is_minimum = (misfit <= np.roll(misfit, 1)) & (misfit < np.roll(misfit, -1))
        minima = np.flatnonzero(is_minimum)
        two_best = minima[np.argsort(misfit[minima], kind="stable")][:2]
        starts += two_best.tolist()
    different: list[int] = []
    for start in starts:
        # At least 1/32 of the polygon apart: nearer ones give nearly the same path.
        if all(min((start - other) % n, (other - start) % n) > n // 32 for other in different):
            different.append(start)
    return different


def _find_short_path(
    a: Points, b: Points, layout: ContourLayout, limit: float
) -> tuple[float, Points] | None:
    """Return length and poses (m, n, 2) of a nearly shortest path a → a_i → b_j → b without folds.

    a, b (k, n, 2): poses of both curves, simplified step by step. The length is that of the
    shortest path; the poses may leave both curves one pose later, where that has no folds either.
    None if no path is shorter than `limit`. If two poses cannot be joined, all pairs of less
    simplified poses are skipped too.
    """
    before, after = path_lengths(a), path_lengths(b)
    length = before[:, None] + _pose_distances(a, b) + after
    possible, following = length < limit, layout.following

    def try_to_join(i: int, j: int) -> bool:
        """Return whether poses a_i and b_j can be joined without folds."""
        if _straight_motion_is_simple(a[i], b[j], following):
            return True
        possible[: i + 1, : j + 1] = False
        return False

    # Only to rule out many pairs soon: bisect how simple poses of equal number must be to join.
    low, high = 0, min(len(a), len(b)) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if try_to_join(middle, middle) else (middle + 1, high)
    for flat_index in np.argsort(length, axis=None):
        i, j = divmod(int(flat_index), len(b))
        if possible[i, j] and try_to_join(i, j):
            shortest_length = float(length[i, j])
            # One pose simpler if that is free too: the shortest free path almost folds.
            is_inside = i + 1 < len(a) and j + 1 < len(b)
            if is_inside and _straight_motion_is_simple(a[i + 1], b[j + 1], following):
                i, j = i + 1, j + 1
            return shortest_length, np.concatenate([a[: i + 1], b[j::-1]])
    return None


def _simplify_contours(points: Points, layout: ContourLayout) -> Points:
    """Return poses (k, n, 2) from contours (n, 2) to ever simpler ones, without folds in between.

    The last is a round polygon with small round holes, or a triangle; of an open curve, a line.
    FinloopError if the contours' parts are too near each other to be kept apart.
    """
    if not layout.closed:
        poses, is_done = straighten_curve(points)
    else:
        poses, is_done = round_off_contours(points, layout)
        if not is_done and len(layout.sizes) == 1:
            poses, is_done = cut_ears(points)
    if not is_done:
        raise FinloopError(
            "a curve whose parts are too near each other to stay separate while it moves",
            "a curve with some room between its parts",
            "set fewer points (morph.contour_points), or morph.method=linear",
        )
    return poses


@kernel
def _pose_distances(a: Points, b: Points) -> Points:
    """Return the mean vertex distances (k, m) between poses a (k, n, 2) and b (m, n, 2)."""
    distances = np.zeros((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            for v in range(a.shape[1]):
                x, y = a[i, v, 0] - b[j, v, 0], a[i, v, 1] - b[j, v, 1]
                distances[i, j] += np.sqrt(x * x + y * y)
    return distances / a.shape[1]


@kernel
def _straight_motion_is_simple(first: Points, second: Points, following: Ints) -> bool:
    """Return whether contours (n, 2) that move straight to others are proved never to meet.

    first, second: both ends of the motion; following (n,): as in `folds`. The motion is tested in
    PARTS steps.
    """
    path = np.empty((PARTS + 1, len(first), 2))
    for k in range(PARTS + 1):
        share = k / PARTS
        for v in range(len(first)):
            for axis in range(2):
                path[k, v, axis] = (1 - share) * first[v, axis] + share * second[v, axis]
    # Of PARTS = 16 steps; most motions that fold do so here: a quick first test.
    for k in (8, 4, 12, 2, 14):
        if count_folds_unchecked(path[k], following, first_only=True):
            return False
    return stays_simple_unchecked(path, following)


def _frames_along_path(poses: Points, frames: int, layout: ContourLayout) -> Points:
    """Return frames (frames, n, 2) at constant speed along poses (k, n, 2), smoothed in time.

    The smoothing is the widest of SMOOTHING that makes no fold; none if all do. The areas within
    the outer contours of closed frames are kept between those of the ends.
    """
    along = path_lengths(poses)
    marks = np.linspace(0, along[-1], frames)
    last = np.clip(np.searchsorted(along, marks, side="right") - 1, 0, len(along) - 2)
    length = along[last + 1] - along[last]  # 0 only at the end, where the last two poses are equal
    share = ((marks - along[last]) / np.where(length > 0, length, 1.0))[:, None, None]
    stack = (1 - share) * poses[last] + share * poses[last + 1]
    stack[0], stack[-1] = poses[0], poses[-1]
    for width in SMOOTHING:
        smooth = smooth_in_time(stack, width * frames)
        smooth[0], smooth[-1] = poses[0], poses[-1]
        if contours_stay_simple(smooth, layout):
            stack = smooth
            break
    return _limit_areas(_relax_frames(stack, layout), layout) if layout.closed else stack


def _relax_frames(stack: Points, layout: ContourLayout) -> Points:
    """Return frames (f, n, 2) of closed contours with less distortion, still without folds.

    Each vertex takes as large a share of its move to a shape as rigid as possible as makes no fold.
    Where vertices meet, the shares fall, there and smoothly around: along the contours and in time.
    """
    for _ in range(RELAX_TIMES):
        moves = find_relaxing_moves(stack, layout)
        if moves is None:
            break
        share = _find_free_shares(stack, moves, layout)
        stack = stack + share[:, :, None] * moves
        if share.mean() >= RELAX_SHARE:
            break
    return stack


def _find_free_shares(stack: Points, moves: Points, layout: ContourLayout) -> Floats:
    """Return how far vertices can go along their moves (f, n, 2) without a fold: shares (f, n).

    stack (f, n, 2): f frames. The shares, 0 … 1, are lowered around each fold until there is none;
    all are 0 if RELAX_ROUNDS do not suffice.
    """
    following, share = layout.following, np.ones(stack.shape[:2])
    changed = np.ones(stack.shape[:2], np.bool_)  # since the last test
    in_time = _spread(np.eye(len(stack)), RELAX_FRAMES, "nearest")
    for _ in range(RELAX_ROUNDS):
        moved = stack + share[:, :, None] * moves
        near = _mark_contacts(moved, following, changed)
        folded = np.flatnonzero(near.any(axis=1))
        if not len(folded):
            return share
        for part in layout.parts:
            near[folded, part] = _spread(near[folded, part], RELAX_EDGES, "wrap")
        near = np.minimum(1.0, in_time[:, folded] @ near[folded])
        share *= 1 - (1 - RELAX) * near
        changed = near > 0
    return np.zeros_like(share)


@kernel
def _mark_contacts(stack: Points, following: Ints, changed: Mask) -> Floats:
    """Return where frames (f, n, 2) have contacts on the way to the next: 1, elsewhere 0, (f, n).

    Both frames count. Only contacts of vertices that are changed (f, n) are looked for.
    """
    near = np.zeros(changed.shape)
    for k in range(len(stack) - 1):
        tested = changed[k] | changed[k + 1]
        if tested.any():
            is_met = find_contacts(stack[k], stack[k + 1], following, tested, first_only=False)
            for v in range(len(is_met)):
                if is_met[v]:
                    near[k, v] = near[k + 1, v] = 1.0
    return near


def _spread(values: Floats, width: float, mode: str) -> Floats:
    """Return values (…, n), 0 to 1, spread to their neighbours by a Gaussian of height 1.

    width: its standard deviation; mode: as in `scipy.ndimage.gaussian_filter1d`.
    """
    spread = scipy.ndimage.gaussian_filter1d(values, width, mode=mode)
    return np.minimum(1.0, np.sqrt(2 * np.pi) * width * spread)


def smooth_in_time(stack: Points, width: float) -> Points:
    """Return the frames (f, n, 2) of a motion smoothed by a Gaussian in time; both ends stay.

    width: its standard deviation in frames.
    """
    smooth = _smoothing_weights(len(stack), width) @ stack.reshape(len(stack), -1)
    return smooth.reshape(stack.shape)


@lru_cache(maxsize=64)
def _smoothing_weights(frames: int, width: float) -> Floats:
    """Return the weights (f, f) of frames in each frame smoothed by a Gaussian in time.

    Beyond an end the motion goes on as its own image under reflection in that end.
    """
    reach = min(int(3 * width) + 1, frames - 1)
    beyond = ((reach, reach), (0, 0))
    # Smoothing is linear: what it does to one number a frame says it for all points.
    extended = np.pad(np.eye(frames), beyond, mode="reflect", reflect_type="odd")
    weights = scipy.ndimage.gaussian_filter1d(extended, width, axis=0, radius=reach)
    return np.asarray(weights[reach:-reach])


def _limit_areas(frames: Points, layout: ContourLayout) -> Points:
    """Return frames (f, n, 2), each scaled to an area between those of the first and the last.

    Only the first contour's area counts; all contours are scaled about the mean of its vertices.
    """
    contours = frames[:, layout.parts[0]]
    x, y = np.moveaxis(contours - contours[:, :1], 2, 0)
    areas = (x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1) / 2
    goals = np.clip(areas, min(areas[0], areas[-1]), max(areas[0], areas[-1]))
    middle = contours.mean(axis=1, keepdims=True)
    resized = middle + (frames - middle) * np.sqrt(goals / areas)[:, None, None]
    return np.where((areas == goals)[:, None, None], frames, resized)


def _has_simple_motion(stack: Points, layout: ContourLayout) -> bool:
    """Return whether the motion from frame to frame (f, n, 2) is proved to make no fold.

    In a straight motion an edge that turns round has length 0 for a moment, which is a fold. So the
    motion may also be one that strays from the straight one by up to NUDGE of the mean edge length.
    """
    following = layout.following
    for k in range(len(stack) - 1):
        pair = stack[k : k + 2]
        if stays_simple_unchecked(pair, following):
            continue
        middle = pair.mean(axis=0)
        smooth = [_smooth_contour(middle[part], layout.closed) for part in layout.parts]
        away = np.concatenate(smooth) - middle
        edge = np.hypot(*np.diff(middle, axis=0).T).mean()
        for stray in (NUDGE / 100, NUDGE / 10, NUDGE):
            factor = stray * edge / abs(away).max()
            detour = np.stack([pair[0], middle + factor * away, pair[1]])
            if stays_simple_unchecked(detour, following):
                break
        else:
            return False
    return True


def _smooth_contour(points: Points, closed: bool) -> Points:
    """Return a smoothed polygon (n, 2): each edge becomes a mean of neighbouring edges.

    The mean of the vertices stays. points (n, 2): the polygon; closed: whether it is.
    """
    doubled = np.r_[points, points[:1]] if closed else np.r_[points, points[-2::-1]]
    edges = np.diff(doubled, axis=0)
    if not closed:
        edges[len(points) - 1 :] *= -1  # the second half mirrors the first
    # A factor for each frequency: in the mean, weights fall off by e over REACH edges.
    angle = np.pi * np.arange(len(edges)) / len(edges)
    factor = 1 / (1 + 4 * REACH**2 * np.sin(angle) ** 2)
    mean_edges = np.fft.ifft(np.fft.fft(edges @ [1, 1j]) * factor)[: len(points) - 1]
    z = np.r_[0, np.cumsum(mean_edges)]
    smooth = np.stack([z.real, z.imag], axis=1)
    return smooth - smooth.mean(axis=0) + points.mean(axis=0)


# --- simplifying one curve


def _resize_polygon(points: Points, area: float) -> Points:
    """Return a polygon (n, 2) scaled about its mean vertex to a given signed area."""
    return _resize_contours(points, slice(None), area)


def _resize_contours(points: Points, outer: slice, area: float) -> Points:
    """Return contours (n, 2) scaled together so that the contour `outer` has a given signed area.

    They are scaled about the mean of its vertices.
    """
    middle = points[outer].mean(axis=0)
    factor = np.sqrt(area / signed_area(Curve(points[outer], closed=True)))
    return middle + (points - middle) * factor


def round_off_contours(points: Points, layout: ContourLayout) -> tuple[Points, bool]:
    """Return poses (k, n, 2) that round off closed contours, and whether they become round.

    The steps are curve shortening of all contours at once, which keeps them apart. All poses have
    the same area within the first contour. A hole shrinks until it is small; from then on it keeps
    its size, and gives way to the contour around it. No step makes a fold. The last pose is not
    round if a step folds after HALVINGS halvings, or if there are MOST_POSES poses.
    """
    poses = [np.ascontiguousarray(points, np.float64)]
    parts, following = layout.parts, layout.following
    outer, *holes = parts
    area = signed_area(Curve(poses[0][outer], closed=True))
    least = np.array([
        min(SMALL * abs(area), abs(signed_area(Curve(poses[0][hole], closed=True))))
        for hole in holes
    ])  # fmt: skip
    edges = _edge_lengths(poses[0][outer])
    step, halvings = edges.mean() ** 2, 0
    # 4π area / length² is 1, without ROUND, in a circle
    while 4 * np.pi * abs(area) <= ROUND * edges.sum() ** 2 or not _are_small_and_round(
        poses[-1], holes, least
    ):
        shorter = np.concatenate([_implicit_step(poses[-1][part], step) for part in parts])
        pose = _resize_contours(shorter, outer, area)
        for hole, least_area in zip(holes, least, strict=True):
            hole_area = signed_area(Curve(pose[hole], closed=True))
            if abs(hole_area) < least_area:
                pose[hole] = _resize_polygon(pose[hole], np.copysign(least_area, hole_area))
        if holes:
            move_holes_inside(pose, outer, holes)
        if stays_simple_unchecked(np.stack([poses[-1], pose]), following):
            poses.append(pose)
            edges = _edge_lengths(pose[outer])
            step, halvings = min(step * GROWTH, STEP * abs(area)), 0
        elif halvings < HALVINGS:
            step, halvings = step / 2, halvings + 1
        if halvings == HALVINGS or len(poses) == MOST_POSES:
            return np.stack(poses), False
    return np.stack(poses), True


def _edge_lengths(points: Points) -> Floats:
    """Return the lengths (n,) of the edges of a closed polygon (n, 2)."""
    return np.hypot(*(next_corners(points) - points).T)


def _are_small_and_round(pose: Points, holes: Sequence[slice], least: Floats) -> bool:
    """Return whether all holes of a pose (n, 2) are round, and not much larger than least (h,)."""
    for hole, least_area in zip(holes, least, strict=True):
        area = abs(signed_area(Curve(pose[hole], closed=True)))
        length = _edge_lengths(pose[hole]).sum()
        if area > 1.01 * least_area or 4 * np.pi * area <= ROUND * length**2:
            return False
    return True


@kernel
def _implicit_step(points: Points, step: float) -> Points:
    """Return a polygon (n, 2) after one implicit step of curve shortening, of the time `step`.

    It solves (1 + 2 q_i) x_i − q_i (x_{i−1} + x_{i+1}) = points_i, q_i = step / |x_u|². The system
    is tridiagonal but for two corners, which Sherman and Morrison's formula adds. The diagonal
    dominates, so no pivots are needed.
    """
    n = len(points)
    edges = np.empty(n)  # from the vertex before
    for i in range(n):
        x, y = points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1]
        edges[i] = np.sqrt(x * x + y * y)
    q = np.empty(n)
    for i in range(n):
        q[i] = step / ((edges[i] + edges[(i + 1) % n]) / 2) ** 2
    # The matrix is B + u vᵀ with a tridiagonal B, u = (corner, 0 … 0, −q_{n−1}) and
    # v = (1, 0 … 0, ratio).
    corner = -(1 + 2 * q[0])
    ratio = -q[0] / corner
    diagonal = 1 + 2 * q
    diagonal[0] -= corner
    diagonal[-1] += q[-1] * ratio
    solved = np.zeros((n, 3))
    solved[:, :2] = points
    solved[0, 2], solved[-1, 2] = corner, -q[-1]
    for i in range(1, n):
        factor = q[i] / diagonal[i - 1]
        diagonal[i] -= factor * q[i - 1]
        for column in range(3):
            solved[i, column] += factor * solved[i - 1, column]
    for i in range(n - 1, -1, -1):
        for column in range(3):
            if i < n - 1:
                solved[i, column] += q[i] * solved[i + 1, column]
            solved[i, column] /= diagonal[i]
    share = (solved[0] + ratio * solved[-1]) / (1 + solved[0, 2] + ratio * solved[-1, 2])
    shorter = np.empty((n, 2))
    for i in range(n):
        for axis in range(2):
            shorter[i, axis] = solved[i, axis] - share[axis] * solved[i, 2]
    return shorter


def cut_ears(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) that turn a simple polygon into a triangle, and whether they do.

    Each step straightens one corner (an "ear") and restores the area, so k is n − 2. Only rounding
    can stop the method before the triangle.
    """
    pose = np.ascontiguousarray(points, np.float64)
    area, n = signed_area(Curve(pose, closed=True)), len(pose)
    following = ContourLayout((n,)).following
    poses, corners = [pose], np.arange(n)  # corners: the vertices that are not yet straightened
    while len(corners) > 3:
        before, after = np.roll(corners, 1), np.roll(corners, -1)
        # Twice the area of each corner's triangle, < 0 if it lies outside.
        (x, y), (u, v) = (pose[corners] - pose[before]).T, (pose[after] - pose[corners]).T
        ear_area = np.sign(area) * (x * v - y * u)
        for k in np.argsort(ear_area):  # the smallest move that makes no fold
            first, last = before[k], after[k]
            span = np.arange(1, (last - first) % n)  # the vertices between go onto the line
            share = span[:, None] / (len(span) + 1)
            cut = pose.copy()
            cut[(first + span) % n] = pose[first] + (pose[last] - pose[first]) * share
            if ear_area[k] >= 0 and stays_simple_unchecked(np.stack([pose, cut]), following):
                break
        else:
            return np.stack(poses), False
        pose, corners = cut, np.delete(corners, k)
        poses.append(_resize_polygon(pose, area))
    return np.stack(poses), True


def straighten_curve(points: Points) -> tuple[Points, bool]:
    """Return poses (k, n, 2) that turn an open curve into a line, and whether they do.

    A line is a curve whose edges all run within 45° of its chord. The poses are ever shorter parts
    about the curve's middle, enlarged to its length.
    """
    points = np.ascontiguousarray(points, np.float64)
    following = ContourLayout((len(points),), closed=False).following
    along = np.r_[0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T))]
    # The last pose shows the share `length_share` of the curve, the next one `shrink` times that.
    poses, length_share, shrink = [points], 1.0, SHRINK
    while not _is_straight(poses[-1]):
        share = shrink * length_share
        marks = along[-1] * (0.5 + share * (np.linspace(0, 1, len(points)) - 0.5))
        x, y = (np.interp(marks, along, values) for values in points.T)
        pose = np.stack([x - x.mean(), y - y.mean()], axis=1) / share
        pose += points.mean(axis=0)
        if stays_simple_unchecked(np.stack([poses[-1], pose]), following):
            poses.append(pose)
            length_share, shrink = share, max(SHRINK, shrink**2)  # twice the step again
        elif shrink < SLOWEST:
            shrink = shrink**0.5  # half the step
        else:
            return np.stack(poses), False
    return np.stack(poses), True


def _is_straight(points: Points) -> bool:
    """Return whether every edge of an open curve (n, 2) runs within 45° of its chord."""
    edges, chord = np.diff(points, axis=0), points[-1] - points[0]
    ahead, aside = edges @ chord, edges @ [-chord[1], chord[0]]
    return bool((ahead > abs(aside)).all())


def _join_simplified_contours(first: Points, second: Points, layout: ContourLayout) -> Points:
    """Return poses (JOIN, n, 2) without folds between two simplified sets of contours (n, 2).

    Small holes keep their place in the round contour around them, or move straight or round in it
    to their place in the other one. FinloopError if they meet on every such course.
    """
    holes = layout.parts[1:]
    joined = [
        join_simplified_poses(first[part], second[part], layout.closed) for part in layout.parts
    ]
    if not holes:
        return joined[0]
    discs = np.stack([_disc(pose) for pose in joined[0]])  # centre x, y and radius of the outer one
    share = np.linspace(0, 1, JOIN)
    for turns in (None, 0, 1, -1):  # straight, or round the centre with so many more turns
        poses = list(joined)
        for k, hole in enumerate(holes, start=1):
            ends = [
                complex(*(area_centroids(pose[hole]) - disc[:2]) / disc[2])
                for pose, disc in ((first, discs[0]), (second, discs[-1]))
            ]
            if turns is None:
                place = (1 - share) * ends[0] + share * ends[1]
            else:
                angle = np.angle(ends[1] / ends[0]) + 2 * np.pi * turns
                radius = (1 - share) * abs(ends[0]) + share * abs(ends[1])
                place = radius * np.exp(1j * (np.angle(ends[0]) + share * angle))
            centres = discs[:, :2] + discs[:, 2:] * np.stack([place.real, place.imag], axis=1)
            own = np.stack([area_centroids(pose) for pose in joined[k]])
            poses[k] = joined[k] + (centres - own)[:, None]
        stack = np.concatenate(poses, axis=1)
        stack[0], stack[-1] = first, second
        if contours_stay_simple(stack, layout):
            return stack
    raise FinloopError(
        "holes that meet each other or the contour around them on their way to the other region",
        "holes that can pass each other",
        "give each hole a path and an id of its own, or use morph.method=linear",
    )


def _disc(polygon: Points) -> Floats:
    """Return centre x, y and radius, (3,), of the disc that has a polygon's area and centroid."""
    area = abs(signed_area(Curve(polygon, closed=True)))
    return np.array([*area_centroids(polygon), np.sqrt(area / np.pi)])


def join_simplified_poses(first: Points, second: Points, closed: bool) -> Points:
    """Return poses (JOIN, n, 2) without folds from one simplified pose (n, 2) to another.

    Closed: two round polygons or triangles that run the same way; open: two lines. From a point
    that sees the whole of such a polygon, the vertices lie at increasing angles, less than half a
    turn apart. Means of two polygons' angles and radii keep this, so no pose has a fold.
    """
    share = np.linspace(0, 1, JOIN)[:, None]
    ends = first, second
    centres = [area_centroids(end) if closed else end.mean(axis=0) for end in ends]
    a, b = ((end - centre) @ [1, 1j] for end, centre in zip(ends, centres, strict=True))
    if closed:
        angle_a, angle_b = np.unwrap(np.angle(a)), np.unwrap(np.angle(b))
        angle_b = angle_b - 2 * np.pi * np.round((angle_b - angle_a).mean() / (2 * np.pi))
        angle = (1 - share) * angle_a + share * angle_b
        joined = ((1 - share) * abs(a) + share * abs(b)) * np.exp(1j * angle)
    else:
        turn = np.angle((b[-1] - b[0]) / (a[-1] - a[0]))
        joined = (1 - share) * a * np.exp(1j * share * turn)
        joined += share * b * np.exp(1j * (share - 1) * turn)
    centre_path = centres[0] + share * (centres[1] - centres[0])
    poses = np.stack([joined.real, joined.imag], axis=-1) + centre_path[:, None]
    poses[0], poses[-1] = first, second
    return poses
