"""A fish thinned with every pixel above the noise: its side branches (fish paper §2.2.1)."""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
import skimage
from numpy.typing import NDArray
from scipy import ndimage

from finloop.base.arrays import Floats, Ints, Mask, Picture
from finloop.extract.backbone import longest_geodesic, trace_backbone, without_notches
from finloop.extract.background import Scene, in_light_of
from finloop.extract.samples import Typical, judge
from finloop.extract.segment import Silhouette, SilhouetteEdge, silhouettes
from finloop.extract.settings import ExtractSettings

_MARGIN = 6  # px of tank around a fish
_NEAR = np.ones((3, 3), np.uint8)


class SkeletonBranch(NamedTuple):
    """A branch of a skeleton, with the number of each of its m pixels.

    path (m, 2): x, y px, from the joint with an earlier branch to its end; numbers (m,): rising by
    1, the first is the joint's.
    """

    path: Ints
    numbers: Ints


class ThinnedFish(NamedTuple):
    """One fish, thinned with every pixel above the noise; places are px of `film`.

    label: film and frame; film: (h, w) or (h, w, 3); body, whole, skeleton (h, w): the silhouette,
    every pixel above the noise, and these thinned; half_width (h, w): px to the edge of `whole`;
    branches: by the paper's rule, the kept one first; kept (m, 2): x, y of the path with the
    greatest length × width; backbone (n, 2): x, y as in finloop, None if the silhouette has none;
    body_ends: ends of the silhouette thinned alone, 2 without side branches.
    """

    label: str
    film: Picture
    body: Mask
    whole: Mask
    skeleton: Mask
    half_width: NDArray[np.float32]
    branches: list[SkeletonBranch]
    kept: Ints
    backbone: Floats | None
    body_ends: int

    @property
    def side_branches(self) -> list[SkeletonBranch]:
        """The branches that leave the fish: longer than the fish is wide at their joint."""
        return [
            branch
            for branch in self.branches[1:]
            if len(branch.path) - 1 > self.half_width[branch.path[0, 1], branch.path[0, 0]]
        ]

    @property
    def difference_px(self) -> int:
        """The number of pixels by which the paper's and finloop's kept paths differ.

        A pixel counts if no pixel of the other path touches it.
        """
        return _count_beyond(self.branches[0].path, self.kept) + _count_beyond(
            self.kept, self.branches[0].path
        )


def _count_beyond(path: Ints, other: Ints) -> int:
    """Return the number of points of a path (m, 2) that no point of another (k, 2) touches."""
    far = np.abs(path[:, None] - other).max(-1).min(1)
    return int((far > 1).sum())


def number_pixels(skeleton: Mask, start: tuple[int, int]) -> Ints:
    """Return the number of each pixel of a skeleton (h, w) from `start`, as in fish paper Fig. 4.

    Returns (h, w). start: x, y, which has 0. Each pixel has one more than its lowest neighbour, so
    at a joint all branches continue with the same number. −1: not connected, or no skeleton.
    """
    number = np.full(skeleton.shape, -1, np.int64)
    ring = np.zeros(skeleton.shape, np.uint8)
    ring[start[1], start[0]] = 1
    count = 0
    while ring.any():
        number[ring > 0] = count
        ring = cv2.dilate(ring, _NEAR) * (skeleton & (number < 0))
        count += 1
    return number


def find_ends(skeleton: Mask) -> list[tuple[int, int]]:
    """Return the ends (x, y) of a skeleton (h, w): pixels with at most one neighbour."""
    pixels = skeleton.astype(np.uint8)
    neighbours = cv2.filter2D(pixels, -1, _NEAR, borderType=cv2.BORDER_CONSTANT) - pixels
    return [(int(x), int(y)) for y, x in np.argwhere(skeleton & (neighbours <= 1))]


def find_branches(skeleton: Mask) -> list[SkeletonBranch]:
    """Return the branches of a skeleton (h, w) by the paper's rule (§2.2.1), greatest number first.

    The numbering starts at an end from which the greatest number is reached. The first branch, to
    the greatest number, is the paper's backbone. Every other end has a branch, which starts at its
    joint with a branch of a greater number.
    """
    some = tuple(int(k) for k in np.argwhere(skeleton)[0][::-1])
    first = number_pixels(skeleton, (some[0], some[1]))
    far = np.unravel_index(first.argmax(), first.shape)
    start = int(far[1]), int(far[0])
    number = number_pixels(skeleton, start)
    ends = [end for end in find_ends(skeleton & (number >= 0)) if end != start]
    ends.sort(key=lambda end: -number[end[1], end[0]])
    taken = np.zeros(skeleton.shape, bool)
    taken[start[1], start[0]] = True
    branches = []
    for x, y in ends or [start]:
        path = [(x, y)]
        while not taken[y, x]:
            taken[y, x] = True
            x, y = _step_back(number, x, y)
            path.append((x, y))
        xy = np.array(path[::-1])
        branches.append(SkeletonBranch(xy, number[xy[:, 1], xy[:, 0]]))
    return branches


def _step_back(number: Ints, x: int, y: int) -> tuple[int, int]:
    """Return the neighbour whose number is one less; beside the pixel rather than diagonal."""
    steps = ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
    height, width = number.shape
    for dx, dy in steps:
        u, v = x + dx, y + dy
        if 0 <= u < width and 0 <= v < height and number[v, u] == number[y, x] - 1:
            return u, v
    raise ValueError("the numbers of a skeleton fall by 1 towards its start")


def thin_fish(
    frame: Picture,
    label: str,
    scene: Scene,
    typical: Typical,
    arena: Picture,
    settings: ExtractSettings,
) -> Iterator[ThinnedFish]:
    """Yield every isolated fish of a frame (h, w) or (h, w, 3), thinned with its pale pixels.

    label: film and frame, for the figure; arena: 255 inside.
    """
    lit = in_light_of(scene, frame)
    ends = SilhouetteEdge(settings.outline_contrast_ratio, settings.shadow, "all", typical.thin)
    for silhouette in silhouettes(frame, lit, arena, settings.least_area_px, ends):
        if judge(silhouette, typical, settings) == "fish":
            yield _thin(silhouette, frame, label, settings.points, scene.threshold)


def _thin(
    silhouette: Silhouette, frame: Picture, label: str, points: int, floor: float
) -> ThinnedFish:
    pale = silhouette.fins or silhouette  # the box of the pale pixels contains the silhouette's
    left, top = pale.x0 - _MARGIN, pale.y0 - _MARGIN
    size = pale.mask.shape[0] + 2 * _MARGIN, pale.mask.shape[1] + 2 * _MARGIN
    body = _paste(silhouette.mask, silhouette.x0 - left, silhouette.y0 - top, size)
    seen = body | _paste(pale.mask, _MARGIN, _MARGIN, size)
    pieces, _ = ndimage.label(seen, np.ones((3, 3)))
    seen = ndimage.binary_fill_holes(pieces == pieces[body].max())
    rows, columns = (np.flatnonzero(seen.any(axis)) for axis in (1, 0))
    first_row, first_column = rows[0] - _MARGIN, columns[0] - _MARGIN
    window = np.s_[
        max(first_row, 0) : rows[-1] + _MARGIN + 1, max(first_column, 0) : columns[-1] + _MARGIN + 1
    ]
    left, top = left + window[1].start, top + window[0].start
    whole = seen[window]
    skeleton = skimage.morphology.skeletonize(whole)
    half_width = cv2.distanceTransform(whole.astype(np.uint8), cv2.DIST_L2, 3)
    backbone = trace_backbone(silhouette.mask, silhouette.field, points, floor)
    alone, _ = without_notches(silhouette.mask, silhouette.field)
    corner = np.array([silhouette.x0 - left, silhouette.y0 - top])
    y = np.clip(np.arange(whole.shape[0]) + top, 0, frame.shape[0] - 1)
    x = np.clip(np.arange(whole.shape[1]) + left, 0, frame.shape[1] - 1)
    return ThinnedFish(
        label,
        frame[np.ix_(y, x)],
        body[window],
        whole,
        skeleton,
        half_width,
        find_branches(skeleton),
        longest_geodesic(skeleton, half_width).astype(np.int64),
        None if backbone is None else backbone.points_px + corner,
        len(find_ends(skimage.morphology.skeletonize(alone))),
    )


def _paste(mask: Mask, x: int, y: int, size: tuple[int, int]) -> Mask:
    into = np.zeros(size, bool)
    into[y : y + mask.shape[0], x : x + mask.shape[1]] = mask
    return into
