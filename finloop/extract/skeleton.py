"""The longest path of a skeleton, without its side branches (fish paper §2.2.1, Fig. 4).

Numbering pixels from one end and keeping the branch with the greatest number finds the longest
geodesic of the skeleton graph, with a diagonal step of length √2.
"""

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.base.kernel import kernel

_FORK = 3.0  # half widths from a path's tip within which it is cut off


@kernel
def longest_geodesic(skeleton: Mask, weight: NDArray[np.float32]) -> Floats:
    """Return the longest shortest path (m, 2) x, y through a skeleton (§2.2.1, Fig. 4: A to D).

    skeleton: (h, w), True on it. The length of a step is multiplied by the mean `weight` (h, w) of
    its two pixels. A weight of 1 is the paper's rule. Then an open fin can be longer than the head,
    before which the skeleton ends. With the distance to the outline as weight a path counts by the
    area that it passes through, and thin fins are not chosen.

    Two sweeps: the pixel farthest from any pixel is one end, and the pixel farthest from that end
    is the other. This is exact on a tree, and the skeleton of a silhouette without holes is one. Of
    several separate pieces the one with the most pixels is used.
    """
    height, width = skeleton.shape
    number = np.full((height, width), -1, np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            if skeleton[y, x]:
                number[y, x] = count
                count += 1
    xs, ys = np.empty(count, np.int64), np.empty(count, np.int64)
    for y in range(height):
        for x in range(width):
            if number[y, x] >= 0:
                xs[number[y, x]], ys[number[y, x]] = x, y
    visited = np.zeros(count, np.bool_)
    best_start, best_size = (
        xs.size,
        0,
    )  # none yet; a literal -1 would compile `_geodesic` again
    for start in range(count):
        if not visited[start]:
            distance, size = _geodesic(number, xs, ys, weight, start)[0], 0
            for node in range(count):
                if np.isfinite(distance[node]):
                    visited[node] = True
                    size += 1
            if size > best_size:
                best_start, best_size = start, size
    if best_size == 0:
        return np.empty((0, 2))
    one_end = _farthest(_geodesic(number, xs, ys, weight, best_start)[0])
    distance, previous = _geodesic(number, xs, ys, weight, one_end)
    node = _farthest(distance)
    path = np.empty((count, 2))
    length = 0
    while node >= 0:
        path[length, 0], path[length, 1] = xs[node], ys[node]
        node = previous[node]
        length += 1
    return path[:length].copy()


@kernel
def trim_forks(path: Floats, half_width: NDArray[np.float32]) -> Floats:
    """Return the path (k, 2) x, y of a skeleton's path (m, 2) without its forked ends.

    half_width: (h, w), px from each pixel to the outline. Near a blunt end the skeleton forks into
    the corners of the outline, so the path is cut off within `_FORK` half widths of its ends.
    """
    first, last = 0, len(path) - 1
    while (
        first < len(path) and half_width[int(path[first, 1]), int(path[first, 0])] > _FORK * first
    ):
        first += 1
    while last >= 0 and (
        half_width[int(path[last, 1]), int(path[last, 0])] > _FORK * (len(path) - 1 - last)
    ):
        last -= 1
    return path[first : max(last + 1, first)].copy()


@kernel
def _farthest(distance: Floats) -> int:
    best = 0
    for i in range(distance.size):
        if (np.isfinite(distance[i]) and not distance[i] <= distance[best]) or (
            not np.isfinite(distance[best]) and np.isfinite(distance[i])
        ):
            best = i
    return best


@kernel
def _geodesic(number, xs, ys, weight, start):  # type: ignore[no-untyped-def]
    """Return distances from `start` over the 8-connected skeleton, and each pixel's predecessor."""
    height, width = number.shape
    distance = np.full(xs.size, np.inf)
    previous = np.full(xs.size, -1, np.int64)
    waiting = np.zeros(xs.size, np.bool_)
    queue = np.empty(xs.size + 1, np.int64)  # circular: a pixel waits at most once
    head, tail = 0, 1
    queue[0] = start
    distance[start] = 0.0
    while head != tail:
        node = queue[head]
        head = (head + 1) % queue.size
        waiting[node] = False
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                y, x = ys[node] + dy, xs[node] + dx
                if 0 <= y < height and 0 <= x < width and number[y, x] >= 0:
                    there = number[y, x]
                    step = np.sqrt(2.0) if dx and dy else 1.0
                    here = weight[ys[node], xs[node]]
                    reach = distance[node] + step * 0.5 * (here + weight[y, x])
                    if there != node and reach < distance[there] - 1e-9:
                        distance[there] = reach
                        previous[there] = node
                        if not waiting[there]:
                            waiting[there] = True
                            queue[tail] = there
                            tail = (tail + 1) % queue.size
    return distance, previous
