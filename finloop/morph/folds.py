"""Test whether polygons cross or touch themselves or each other, in one pose or during a motion.

Several contours, as of a letter with a hole, are tested as one array of vertices (n, 2). Its
`following` (n,) has the vertex to which each vertex has an edge, −1 where an open contour ends.

In one pose (`count_polygon_folds`, `is_simple`) the answer is exact (Shewchuk 1997, *Adaptive
precision floating-point arithmetic and fast robust geometric predicates*): an orientation is
computed in floats, and again without rounding if rounding could change its sign. Products must
neither overflow nor underflow: magnitudes 0 or 1e-70 … 1e70 are safe.

During a motion (`stays_simple`) the vertices move straight from one pose to the next. A simple
polygon stays simple until a vertex touches an edge that does not end at it. Two quadratics in time
decide this. They are bounded by their Bernstein coefficients, with a margin for rounding. So
"simple" is a proof, and "not simple" may mean "too near to decide".

Blocks group consecutive edges, and only blocks with overlapping boxes are compared.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel, leaf_kernel

BLOCK = 16  # edges
_ROUNDING = 64 * 2.0**-52  # margin for a coefficient halved DEPTH times: twice the rounding error
DEPTH = 14  # halvings of the time between two poses before giving up
_SURE = (3 + 16 * 2.0**-53) * 2.0**-53  # Shewchuk's ccwerrboundA
_SPLIT = 134217729.0  # 2^27 + 1


class ContourLayout(NamedTuple):
    """How contours lie one after the other in an array of vertices: the size of each.

    sizes: numbers of vertices of the contours.
    """

    sizes: tuple[int, ...]
    closed: bool = True

    @property
    def parts(self) -> list[slice]:
        """Return the slice of each contour in the array of vertices."""
        ends = np.cumsum(self.sizes).tolist()
        return [slice(end - size, end) for end, size in zip(ends, self.sizes, strict=True)]

    @property
    def following(self) -> Ints:
        """Return the next vertex (n,) to which each vertex has an edge; −1 for none."""
        following = np.arange(1, sum(self.sizes) + 1)
        ends = np.cumsum(self.sizes)
        following[ends - 1] = ends - self.sizes if self.closed else -1
        return following


def count_contour_folds(stack: Reals, layout: ContourLayout) -> Ints:
    """Return the exact number (f,) of folds of contours (f, n, 2): pairs of edges that meet.

    Edges of two contours count as those of one. Neighbouring edges count if they share more than
    their vertex; an edge of length 0 is a fold, too. FinloopError if a coordinate is not finite, or
    a contour has fewer than 3 vertices, 2 if it is open.
    """
    stack = _check_contours(stack, layout)
    following = layout.following
    counts = [count_folds_unchecked(points, following, first_only=False) for points in stack]
    return np.array(counts, np.int64)


def count_polygon_folds(stack: Reals, closed: bool = True) -> Ints:
    """Return the exact number (f,) of folds in each polygon: pairs of its edges that meet.

    stack: polygons (f, n, 2), or one (n, 2); n ≥ 3 (open: 2); the first vertex is not repeated.
    """
    return count_contour_folds(stack, _polygon_layout(stack, closed))


def is_simple(points: Reals, closed: bool = True) -> bool:
    """Return whether a polygon (n, 2) has no fold: none of its edges meet."""
    layout = _polygon_layout(points, closed)
    polygon = _check_contours(points, layout)[0]
    return count_folds_unchecked(polygon, layout.following, first_only=True) == 0


def stays_simple(poses: Reals, closed: bool = True) -> bool:
    """Return whether a polygon that moves straight from pose to pose (k, n, 2) never meets itself.

    True is a proof for every moment, not only for the poses. False may mean that two parts come too
    near each other to decide.
    """
    return contours_stay_simple(poses, _polygon_layout(poses, closed))


def contours_stay_simple(poses: Reals, layout: ContourLayout) -> bool:
    """Return whether contours that move straight from pose to pose (k, n, 2) never meet.

    Neither does one meet itself. True is a proof, as in `stays_simple`.
    """
    poses = _check_contours(poses, layout)
    if count_folds_unchecked(poses[0], layout.following, first_only=True):
        return False
    return bool(stays_simple_unchecked(poses, layout.following))


def _polygon_layout(stack: Reals, closed: bool) -> ContourLayout:
    """Return the layout of an array that holds one polygon, (…, n, 2)."""
    return ContourLayout((np.shape(stack)[-2] if np.ndim(stack) >= 2 else 0,), closed)


def _check_contours(points: Reals, layout: ContourLayout) -> Floats:
    """Return contours as an array (f, n, 2); FinloopError if they are malformed."""
    polygons: Floats = np.ascontiguousarray(points, np.float64)
    polygons = polygons[None] if polygons.ndim == 2 else polygons
    least = 2 + layout.closed
    fits = polygons.ndim == 3 and polygons.shape[1:] == (sum(layout.sizes), 2)
    if not fits or min(layout.sizes, default=0) < least:
        raise FinloopError(
            f"polygons of shape {polygons.shape}",
            f"(frames, points, 2) with at least {least} points",
            "give more points",
        )
    if not np.isfinite(polygons).all():
        raise FinloopError(
            "points that are not finite: NaN or infinite",
            "coordinates that are finite numbers",
            "replace these points or leave them out",
        )
    return polygons


# --- one pose, exactly


@leaf_kernel
def _two_product(a: float, b: float) -> tuple[float, float]:
    """Return the rounded product of two numbers, and its rounding error (Dekker).

    Each factor is the sum of two halves of at most 26 bits, whose products are exact.
    """
    product = a * b
    a_high = _SPLIT * a - (_SPLIT * a - a)
    b_high = _SPLIT * b - (_SPLIT * b - b)
    a_low, b_low = a - a_high, b - b_high
    rest = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)
    return product, rest


@kernel
def _exact_sign(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return the exact sign of (a − c) × (b − c), without rounding its six products.

    The sum is kept as numbers of ascending size that do not overlap, so the last one that is not 0
    has its sign (Shewchuk 1997).
    """
    factors = (ax, -ay, bx, -by, cx, -cy)
    other_factors = (by, bx, cy, cx, ay, ax)
    sums = np.zeros(12)
    count = 0
    for k in range(6):
        high, low = _two_product(factors[k], other_factors[k])
        for term in (low, high):
            carry = term
            for index in range(count):
                total = carry + sums[index]
                added = total - carry
                sums[index] = (carry - (total - added)) + (sums[index] - added)
                carry = total
            sums[count] = carry
            count += 1
    for k in range(11, -1, -1):
        if sums[k] > 0:
            return 1
        if sums[k] < 0:
            return -1
    return 0


@kernel
def _orientation_sign(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return the exact sign of (a − c) × (b − c): the side of line ab where c lies; 0: on it."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    det = left - right
    if abs(det) > _SURE * (abs(left) + abs(right)):
        return 1 if det > 0 else -1
    return _exact_sign(ax, ay, bx, by, cx, cy)


@kernel
def _segments_meet(points: Floats, a: int, b: int, c: int, d: int) -> bool:
    """Return whether edges ab and cd share a point; their bounding boxes must overlap.

    points (n, 2): the polygon; a, b, c, d: its rows at the ends of the edges.
    """
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    cx, cy, dx, dy = points[c, 0], points[c, 1], points[d, 0], points[d, 1]
    abc = _orientation_sign(ax, ay, bx, by, cx, cy)
    abd = _orientation_sign(ax, ay, bx, by, dx, dy)
    if abc * abd > 0:
        return False
    # If all four lie on one line, overlapping boxes are overlapping segments.
    return (
        _orientation_sign(cx, cy, dx, dy, ax, ay) * _orientation_sign(cx, cy, dx, dy, bx, by) <= 0
    )


@kernel
def _turns_back(px: float, py: float, qx: float, qy: float, rx: float, ry: float) -> bool:
    """Return whether neighbouring edges pq and qr share more than their corner q."""
    if _orientation_sign(px, py, qx, qy, rx, ry) != 0:
        return False
    return ((px > qx) == (rx > qx) and px != qx) or ((py > qy) == (ry > qy) and py != qy)


@kernel
def _edge_boxes(vertices: Floats, following: Ints) -> Floats:
    """Return the bounding boxes (n, 4) of the edges from n vertices: left, top, right, bottom.

    vertices (n, 4): the boxes of the vertices; following (n,): where their edges lead. The box of
    a vertex without an edge overlaps no other.
    """
    n = len(vertices)
    boxes = np.empty((n, 4))
    for i in range(n):
        j = following[i]
        if j < 0:
            boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = np.inf, np.inf, -np.inf, -np.inf
            continue
        for axis in range(2):
            boxes[i, axis] = min(vertices[i, axis], vertices[j, axis])
            boxes[i, 2 + axis] = max(vertices[i, 2 + axis], vertices[j, 2 + axis])
    return boxes


@kernel
def _merge_boxes(boxes: Floats) -> Floats:
    """Return one bounding box for each group of BLOCK consecutive boxes (n, 4).

    Boxes are left, top, right, bottom.
    """
    blocks = np.empty(((len(boxes) + BLOCK - 1) // BLOCK, 4))
    for k in range(len(blocks)):
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for i in range(k * BLOCK, min((k + 1) * BLOCK, len(boxes))):
            left, top = min(left, boxes[i, 0]), min(top, boxes[i, 1])
            right, bottom = max(right, boxes[i, 2]), max(bottom, boxes[i, 3])
        blocks[k, 0], blocks[k, 1], blocks[k, 2], blocks[k, 3] = left, top, right, bottom
    return blocks


@leaf_kernel
def _boxes_overlap(a: Floats, i: int, b: Floats, j: int) -> bool:
    """Return whether row i of the boxes a (n, 4) and row j of the boxes b overlap."""
    # & rather than `and`: four unpredictable branches take ten times as long
    return (a[i, 0] <= b[j, 2]) & (b[j, 0] <= a[i, 2]) & (a[i, 1] <= b[j, 3]) & (b[j, 1] <= a[i, 3])


@kernel
def count_folds_unchecked(points: Floats, following: Ints, first_only: bool) -> int:
    """Return the number of folds of contours (n, 2), without a check of their shape.

    following (n,): as in this file's text. A fold is a pair of edges that meet: neighbours if they
    share more than their vertex; or an edge of length 0. first_only: stop at the first; the result
    then only says whether there is one. Bounding boxes of edges, and of blocks of BLOCK successive
    edges, rule out most pairs.
    """
    n = len(points)
    count = 0
    for i in range(n):  # each edge p-q and the next one, q-r
        j = following[i]
        if j < 0:
            continue
        k = following[j]
        px, py, qx, qy = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        if px == qx and py == qy:
            count += 1
        elif k >= 0 and (qx != points[k, 0] or qy != points[k, 1]):
            count += _turns_back(px, py, qx, qy, points[k, 0], points[k, 1])
    if first_only and count:
        return count
    # All other pairs of edges i < j, by the blocks that they are in.
    boxes = _edge_boxes(np.hstack((points, points)), following)
    blocks = _merge_boxes(boxes)
    for block in range(len(blocks)):
        for partner in range(block, len(blocks)):
            if not _boxes_overlap(blocks, block, blocks, partner):
                continue
            for i in range(block * BLOCK, min((block + 1) * BLOCK, n)):
                if not _boxes_overlap(boxes, i, blocks, partner):
                    continue
                for j in range(max(i + 1, partner * BLOCK), min((partner + 1) * BLOCK, n)):
                    if not _boxes_overlap(boxes, i, boxes, j):
                        continue
                    i_next, j_next = following[i], following[j]
                    is_neighbour = i_next == j or j_next == i
                    if not is_neighbour and _segments_meet(points, i, i_next, j, j_next):
                        count += 1
                        if first_only:
                            return count
    return count


# --- a motion


@kernel
def _stays_apart(before: Floats, after: Floats, v: int, i: int, j: int) -> bool:
    """Return whether it is proved that vertex v never touches edge ij while all move.

    before, after (n, 2): the poses; v, i, j: rows. Let u and w lead from v to i and to j. There is
    no contact while u × w is not 0 or u · w is positive. Both are quadratics in time, with the
    Bernstein coefficients c0, c1, c2 (u × w) and d0, d1, d2 (u · w), between whose extremes the
    quadratic lies. Where these do not decide, the time is halved, up to DEPTH times.
    """
    ax, ay = before[i, 0] - before[v, 0], before[i, 1] - before[v, 1]
    bx, by = after[i, 0] - after[v, 0], after[i, 1] - after[v, 1]
    cx, cy = before[j, 0] - before[v, 0], before[j, 1] - before[v, 1]
    dx, dy = after[j, 0] - after[v, 0], after[j, 1] - after[v, 1]
    c0, c2 = ax * cy - ay * cx, bx * dy - by * dx
    c1 = ((ax * dy - ay * dx) + (bx * cy - by * cx)) / 2
    u_reach = max(abs(ax), abs(ay), abs(bx), abs(by))
    w_reach = max(abs(cx), abs(cy), abs(dx), abs(dy))
    margin = _ROUNDING * u_reach * w_reach  # a smaller number may be 0 but for rounding
    if min(c0, c1, c2) > margin or max(c0, c1, c2) < -margin:
        return True
    d0, d2 = ax * cx + ay * cy, bx * dx + by * dy
    d1 = ((ax * dx + ay * dy) + (bx * cx + by * cy)) / 2
    if min(d0, d1, d2) > margin:
        return True
    # Spans of time that are not yet decided: their coefficients, and how often they were halved.
    stack = np.empty((DEPTH + 2, 7))
    _copy_numbers(stack[0], (c0, c1, c2, d0, d1, d2, 0.0))
    remaining = 1
    while remaining:
        remaining -= 1
        c0, c1, c2, d0, d1, d2, depth = stack[remaining]
        if min(c0, c1, c2) > margin or max(c0, c1, c2) < -margin or min(d0, d1, d2) > margin:
            continue
        if depth >= DEPTH:
            return False
        c01, c12, d01, d12 = (c0 + c1) / 2, (c1 + c2) / 2, (d0 + d1) / 2, (d1 + d2) / 2
        c, d = (c01 + c12) / 2, (d01 + d12) / 2
        if abs(c) <= margin and d <= margin:
            return False
        _copy_numbers(stack[remaining], (c, c12, c2, d, d12, d2, depth + 1))
        _copy_numbers(stack[remaining + 1], (c0, c01, c, d0, d01, d, depth + 1))
        remaining += 2
    return True


@kernel
def _copy_numbers(row, values):  # type: ignore[no-untyped-def]
    """Copy values into a row of an array; numba compiles this loop much faster than a slice."""
    for i in range(len(values)):
        row[i] = values[i]


@kernel
def stays_simple_unchecked(stack: Floats, following: Ints) -> bool:
    """Return whether contours that move straight from pose to pose (k, n, 2) never meet.

    The first pose must have no fold; neither this nor the shape is checked. False may mean that two
    parts come too near each other to decide.
    """
    tested = np.ones(stack.shape[1], np.bool_)
    for k in range(len(stack) - 1):
        if find_contacts(stack[k], stack[k + 1], following, tested, first_only=True).any():
            return False
    return True


@leaf_kernel
def _write_path_box(
    boxes: Floats, row: int, before: Floats, after: Floats, i: int, j: int, x: float, y: float
) -> None:
    """Write the box of what the edge ij passes, seen from a point that moves by (x, y).

    boxes (k, 4): left, top, right, bottom; before, after (n, 2): the poses. j < 0: no edge; its box
    overlaps no other.
    """
    if j < 0:
        boxes[row, 0] = boxes[row, 1] = np.inf
        boxes[row, 2] = boxes[row, 3] = -np.inf
        return
    x_i, x_j, y_i, y_j = after[i, 0] - x, after[j, 0] - x, after[i, 1] - y, after[j, 1] - y
    boxes[row, 0] = min(min(before[i, 0], before[j, 0]), min(x_i, x_j))
    boxes[row, 1] = min(min(before[i, 1], before[j, 1]), min(y_i, y_j))
    boxes[row, 2] = max(max(before[i, 0], before[j, 0]), max(x_i, x_j))
    boxes[row, 3] = max(max(before[i, 1], before[j, 1]), max(y_i, y_j))


@kernel
def find_contacts(
    before: Floats, after: Floats, following: Ints, tested: Mask, first_only: bool
) -> Mask:
    """Return a mask (n,) of vertices in contact in a straight motion between two poses (n, 2).

    A contact is a vertex that meets an edge, or may meet it: the two come too near each other to
    decide. The vertex and both ends of the edge count. tested (n,): only contacts of at least one
    of these vertices are looked for. first_only: stop at the first contact. A vertex and an edge
    can only meet where the boxes of their paths overlap; boxes of BLOCK of them rule out most
    pairs. Within two blocks, paths are seen from a vertex that moves along: neighbours move alike,
    so these paths are short.
    """
    n = len(before)
    is_met = np.zeros(n, np.bool_)
    boxes, reach = np.empty((n, 4)), 0.0  # low x, y, high x, y of each vertex's path
    for i in range(n):
        for axis in range(2):
            boxes[i, axis] = min(before[i, axis], after[i, axis])
            boxes[i, 2 + axis] = max(before[i, axis], after[i, axis])
            reach = max(reach, abs(boxes[i, axis]), abs(boxes[i, 2 + axis]))
    vertex_blocks, edge_blocks = _merge_boxes(boxes), _merge_boxes(_edge_boxes(boxes, following))
    margin = _ROUNDING * reach  # more than the rounding of a place that is seen from another one
    vertices, edges = np.empty((BLOCK, 4)), np.empty((BLOCK, 4))
    is_edge_tested = tested | tested[following]
    for block in range(len(vertex_blocks)):
        low, high = block * BLOCK, min((block + 1) * BLOCK, n)
        middle = (low + high) // 2
        x, y = after[middle, 0] - before[middle, 0], after[middle, 1] - before[middle, 1]
        for v in range(low, high):
            _write_path_box(vertices, v - low, before, after, v, v, x, y)
            vertices[v - low, 0] -= margin
            vertices[v - low, 1] -= margin
            vertices[v - low, 2] += margin
            vertices[v - low, 3] += margin
        near_vertices, is_tested = _merge_boxes(vertices[: high - low]), tested[low:high].any()
        for partner in range(len(edge_blocks)):
            if not _boxes_overlap(vertex_blocks, block, edge_blocks, partner):
                continue
            first, last = partner * BLOCK, min((partner + 1) * BLOCK, n)
            if not (is_tested or is_edge_tested[first:last].any()):
                continue
            for i in range(first, last):
                _write_path_box(edges, i - first, before, after, i, following[i], x, y)
            near_edges = _merge_boxes(edges[: last - first])
            if not _boxes_overlap(near_vertices, 0, near_edges, 0):
                continue
            for v in range(low, high):
                if not _boxes_overlap(vertices, v - low, near_edges, 0):
                    continue
                for i in range(first, last):
                    if v == i or not _boxes_overlap(vertices, v - low, edges, i - first):
                        continue
                    j = following[i]
                    if v == j or not (tested[v] or is_edge_tested[i]):
                        continue
                    if not _stays_apart(before, after, v, i, j):
                        is_met[v] = is_met[i] = is_met[j] = True
                        if first_only:
                            return is_met
    return is_met
