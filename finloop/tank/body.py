"""The body of a fish, lofted from its backbone and half widths: a closed surface of rings.

A film from above shows the width of the body, not its height. The height is a plausible one: that
of a slender fish, with a dorsal, an anal and a forked tail fin, as a share of the greatest width,
the same for every tick.

Points of the surface are a grid (RINGS, AROUND) from head to tail and once around, from below over
the left, above and the right to below again; its first and last column are the same line, the seam
of a skin. A point's place along the backbone is a cubic spline through the film's points, linear in
them: one matrix product makes any number of fish.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Reals

RINGS = 56
_HALF_DEG = (0, 7, 22, 42, 62, 80, 100, 118, 138, 158, 173, 180)  # from the back down to the belly
AROUND = 2 * len(_HALF_DEG) - 1
_HEIGHT = {  # along the body: half the height, as a share of the greatest
    0.0: 0.0, 0.03: 0.3, 0.1: 0.62, 0.2: 0.9, 0.33: 1.0, 0.48: 0.94, 0.62: 0.68, 0.74: 0.42,
    0.82: 0.32, 0.87: 0.36, 0.93: 0.72, 0.98: 0.98, 1.0: 1.0,
}  # fmt: skip
_DORSAL = {0.0: 0.0, 0.42: 0.0, 0.46: 0.55, 0.52: 0.6, 0.6: 0.35, 0.66: 0.0, 1.0: 0.0}
_ANAL = {0.0: 0.0, 0.6: 0.0, 0.63: 0.45, 0.68: 0.4, 0.76: 0.0, 1.0: 0.0}
_FORK = 0.085  # how deep the tail is forked, in body lengths
_CLOSES = 0.05  # the last part of the skin, over which the tail fin closes to an edge
_TAIL = 0.86  # where the tail fin begins
_HEIGHT_PER_WIDTH, _LEAST_BL, _MOST_BL = 1.45, 0.07, 0.13  # of the greatest half height
_NEAR = 0.2  # own half widths are kept this near to the animal's typical ones (fins, noise)


@dataclass(frozen=True)
class SurfaceGrid:
    """A grid of points on a fish's surface, which fits any backbone with p points.

    place, along (RINGS · AROUND, p): matrices; times a backbone (p, 2) they give each point's place
    on it and the direction there. s, angle (RINGS, AROUND): where along the backbone (0 head, 1
    tail) and where around it (rad, 0 = back, left > 0). width_share (RINGS, 1): how much of the
    width is left; 0 at the end of the tail fin.
    """

    place: Reals
    along: Reals
    s: Reals
    angle: Reals
    width_share: Reals


@lru_cache
def surface_grid(backbone_points: int) -> SurfaceGrid:
    """Return the surface grid that fits backbones of `backbone_points` equally spaced points.

    The first point is the head.
    """
    half = np.radians(_HALF_DEG)
    around = np.concatenate([half[::-1], -half[1:]])  # from below over left, above and right
    return build_surface_grid(_ring_positions(), around, backbone_points)


def _ring_positions() -> Reals:
    """Return the positions (RINGS,) of the rings along the body, 0 head … 1 tail.

    They are closer together at both ends.
    """
    return (1 - np.cos(np.pi * np.linspace(0, 1, RINGS))) / 2


def build_surface_grid(ring: Reals, angle: Reals, points: int) -> SurfaceGrid:
    """Return the surface grid with given rings along the body and angles around it.

    ring (r,): 0 head … 1 tail; angle (a,): rad, 0 = back, left > 0; points: of a backbone.
    """
    s, angle = np.meshgrid(ring, angle, indexing="ij")
    tail_share = np.clip((s - _TAIL) / (1 - _TAIL), 0, 1)  # 0 where the tail fin begins
    s = s - _FORK * tail_share**2 * np.sin(angle) ** 2  # a fork: only the upper and lower tip stay
    # A spline is linear in its points. So splines through unit vectors give the matrices that make
    # the place and the direction on any backbone.
    spline = scipy.interpolate.CubicSpline(np.linspace(0, 1, points), np.eye(points))
    # The tail fin closes to an edge at the end of the body.
    width_share = np.sqrt(np.clip((1 - ring) / _CLOSES, 0, 1))[:, None]
    place, along = spline(s.ravel()), spline(s.ravel(), 1)
    return SurfaceGrid(place, along, s, angle, width_share)


def median_half_widths(half_width: Reals, backbone: Reals) -> Reals:
    """Return the median half widths (p,) along the body over n pictures, in body lengths.

    half_width (n, p), backbone (n, p, 2): px, at p points from head to tail.
    """
    return np.median(half_width / arc_lengths(backbone)[:, None], axis=0)


def arc_lengths(backbone: Reals) -> Reals:
    """Return the arc lengths (n,) of backbones (n, p, 2), in the unit of their points."""
    return np.linalg.norm(np.diff(backbone, axis=1), axis=-1).sum(-1)


def fish_surfaces(
    backbone: Reals, half_width: Reals, typical: Reals, length_px: float
) -> tuple[Reals, Reals]:
    """Return the surfaces of n fish: points (px) and unit normals, (n, RINGS, AROUND, 3).

    backbone (n, p, 2), half_width (n, p): px; y up; backbones lie at z = 0. typical (p,): the
    animal's median half widths in body lengths. length_px: its body length, for its height.
    """
    grid = surface_grid(half_width.shape[1])

    def along_body(profile: dict[float, float]) -> Reals:
        """Interpolate a profile (place along the body → value) at the points of the grid."""
        return scipy.interpolate.PchipInterpolator(list(profile), list(profile.values()))(grid.s)

    # A film from above shows no height: it is taken from the greatest width, within limits.
    height_bl = np.clip(_HEIGHT_PER_WIDTH * float(typical.max()), _LEAST_BL, _MOST_BL)
    half_height_px = length_px * height_bl  # where the body is highest
    on_back, on_belly = grid.angle == 0, np.isclose(np.abs(grid.angle), np.pi)
    fins = half_height_px * (on_back * along_body(_DORSAL) - on_belly * along_body(_ANAL))
    width = limit_half_widths(half_width, backbone, typical)
    points = np.empty((len(half_width), RINGS, AROUND, 3))
    points[..., :2] = top_view_points(grid, backbone, width)
    points[..., 2] = half_height_px * along_body(_HEIGHT) * np.cos(grid.angle) + fins
    return points, surface_normals(points)


def limit_half_widths(half_width: Reals, backbone: Reals, typical: Reals) -> Reals:
    """Return half widths (n, p), px, limited to ±20 % around the typical ones: without fins.

    half_width (n, p): px, as filmed; backbone (n, p, 2): px; typical (p,): the animal's median half
    widths, in body lengths.
    """
    typical_px = typical * arc_lengths(backbone)[:, None]
    return np.clip(half_width, (1 - _NEAR) * typical_px, (1 + _NEAR) * typical_px)


def top_view_points(grid: SurfaceGrid, backbone: Reals, half_width: Reals) -> Reals:
    """Return where a grid's points lie on n backbones, seen from above: (n, r, a, 2) px.

    r, a: rings along the body, and points around it; half_width (n, p): px.
    """
    shape = (len(backbone), *grid.s.shape, 2)
    line = (grid.place @ backbone).reshape(shape)
    tailward = (grid.along @ backbone).reshape(shape)
    tailward /= np.maximum(np.linalg.norm(tailward, axis=-1, keepdims=True), 1e-9)
    left = tailward[..., ::-1] * (1, -1)  # facing the tail, the fish's left is to the right
    points = np.linspace(0, 1, half_width.shape[1])
    # Squares are interpolated, so that both ends are round.
    square = scipy.interpolate.PchipInterpolator(points, half_width**2, axis=1)(grid.s.ravel())
    rounded = np.sqrt(np.maximum(square, 0)).reshape(-1, *grid.s.shape)
    across = rounded * grid.width_share * np.sin(grid.angle)
    return line + across[..., None] * left


def surface_normals(points: Reals) -> Reals:
    """Return outward unit normals of surfaces, both (n, RINGS, AROUND, 3).

    Where the surface shrinks to a point, as at the snout, the normal points ahead.
    """
    tailward = np.gradient(points, axis=1)
    # The first and last column are the same line: the ring is continued beyond both.
    ring = np.concatenate([points[:, :, -2:-1], points, points[:, :, 1:2]], axis=2)
    around = ring[:, :, 2:] - ring[:, :, :-2]
    outward = np.cross(tailward, around)
    size = np.linalg.norm(outward, axis=-1, keepdims=True)
    middle = points[:, :2, [0, AROUND // 2]].mean(2, keepdims=True)  # between belly and back
    ahead = middle[:, :1] - middle[:, 1:]
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
    return np.where(size > 1e-9, outward / np.maximum(size, 1e-9), ahead)


@lru_cache
def surface_triangles() -> NDArray[np.int32]:
    """Return the triangles of a surface as point numbers (m, 3), anticlockwise from outside."""
    ring, column = np.meshgrid(np.arange(RINGS - 1), np.arange(AROUND - 1), indexing="ij")
    a = ring * AROUND + column  # each square a b d c of the grid is two triangles
    b, c, d = a + 1, a + AROUND, a + AROUND + 1
    return np.stack([a, c, b, b, c, d], -1).reshape(-1, 3).astype(np.int32)


@lru_cache
def texture_coordinates() -> NDArray[np.float32]:
    """Return texture coordinates (RINGS · AROUND, 2) of a surface's points, 0–1: along, around."""
    angle = surface_grid(4).angle[0]  # the same for any number of backbone points
    u, v = np.meshgrid(_ring_positions(), (np.pi - angle) / (2 * np.pi), indexing="ij")
    return np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)
