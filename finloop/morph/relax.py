"""Make the frames of a morph less distorted: as-rigid-as-possible shapes between two shapes.

Every triangle of a shape becomes one of the other by a rotation and a stretch S. In the frame at
the share τ of the way its map should be (1 − τ) I + τ S and a rotation, any one. The frame
minimises how far all maps J are from that, ∫ ‖J − R ((1 − τ) I + τ S)‖² (Alexa, Cohen-Or and Levin,
"As-rigid-as-possible shape interpolation", 2000; rotations are found as by Sorkine and Alexa,
2007). Triangles of both shapes count, those of the first 1 − τ times, of the second τ times. Of a
stretch only the share STRETCHED is wanted half-way, so that shapes are strained less.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from finloop.base.arrays import Complex, Floats, Ints, Points
from finloop.base.kernel import kernel
from finloop.base.triangles import cross_products, triangulate
from finloop.morph.folds import ContourLayout

COARSE = (64, 128, 256)
"""Points of a contour for which frames are solved: the fewest that leave all contours apart."""
KNOTS = 8  # frames that are solved, evenly in time
STEPS = 12  # of each solution; each lowers the energy
STRETCHED = 0.9  # with 1, frames have 6 to 18 % more strain than other tools', with less, deviation
FLAT = 1e-9  # area of a triangle, as a share of its shape's, that counts as none


class Triangles(NamedTuple):
    """The t triangles of a shape, and the derivatives of functions that are linear in each.

    gradients: row t times the values at the three corners is ∂x + i ∂y. So for places of a map,
    complex, half of its conjugate times these is how the map turns and stretches the triangle, and
    half of it times these is how it mirrors: z ↦ turning z + mirroring z̄.
    """

    corners: Ints  # (t, 3) vertices
    gradients: Complex  # (t, 3)
    areas: Floats  # (t,)


def find_relaxing_moves(stack: Points, layout: ContourLayout) -> Points | None:
    """Return displacements (f, n, 2) that make frames of closed contours less distorted.

    The first and the last frame stay. Nothing keeps the moved contours from folding. None if the
    contours are too near each other for triangles between any number in COARSE of points of each.
    """
    frames, count = stack.shape[:2]
    for most in COARSE:
        coarse = [
            np.arange(part.start, part.stop, max(1, (part.stop - part.start) // most))
            for part in layout.parts
        ]
        vertices, sizes = np.concatenate(coarse), [len(part) for part in coarse]
        start = _triangle_gradients(stack[0, vertices], sizes)
        end = _triangle_gradients(stack[-1, vertices], sizes)
        if start is not None and end is not None:
            break
    else:
        return None
    knots = np.unique(np.round(np.linspace(0, frames - 1, KNOTS + 2)).astype(int))
    tau = (knots / (frames - 1))[1:-1]
    z = stack[:, vertices] @ [1, 1j]
    goals = [
        _blend_stretches(start, z[-1], STRETCHED * tau),
        _blend_stretches(end, z[0], STRETCHED * (1 - tau)),
    ]
    places = z[knots[1:-1]].T
    relaxed = _relax_places(
        places,
        Triangles(*(np.concatenate(parts) for parts in zip(start, end, strict=True))),
        np.concatenate([start.areas[:, None] * (1 - tau), end.areas[:, None] * tau]),
        *(np.concatenate(parts) for parts in zip(*goals, strict=True)),
    )
    moves = np.zeros((len(knots), len(vertices)), complex)
    moves[1:-1] = (relaxed - places).T
    in_time = _spline_weights(tuple(knots.tolist()), frames) @ moves
    result = np.empty((frames, count), complex)
    splits = np.cumsum(sizes)[:-1]
    for part, points, some in zip(
        layout.parts, coarse, np.split(in_time, splits, axis=1), strict=True
    ):
        marks = tuple((points - part.start).tolist())
        result[:, part] = some @ _spline_weights(marks, part.stop - part.start, periodic=True).T
    result[[0, -1]] = 0.0  # but for rounding they are
    return np.stack([result.real, result.imag], axis=-1)


@lru_cache(maxsize=64)
def _spline_weights(marks: tuple[int, ...], count: int, periodic: bool = False) -> Floats:
    """Return weights (count, k) of values at k marks, which sum to their cubic spline.

    Row i is for the mark i. periodic: whether the mark `count` is the first one again, which is 0.
    """
    values = np.eye(len(marks))
    if periodic:
        marks, values = (*marks, count), np.concatenate([values, values[:1]])
    bounds = "periodic" if periodic else "not-a-knot"
    return np.asarray(scipy.interpolate.CubicSpline(marks, values, bc_type=bounds)(range(count)))


def _blend_stretches(triangles: Triangles, other: Complex, tau: Floats) -> tuple[Floats, Complex]:
    """Return how triangles are stretched at shares tau (k,): turning and mirroring parts (t, k).

    other (n,): the vertices in the other shape. The stretch S of each triangle grows evenly, from
    none to that of the other shape: (1 − τ) I + τ S.
    """
    places = other[triangles.corners]
    turning = (triangles.gradients.conj() * places).sum(axis=1) / 2
    mirroring = (triangles.gradients * places).sum(axis=1) / 2
    size = abs(turning)
    unturned = mirroring * turning.conj() / np.maximum(size, 1e-300)
    return 1 - tau + tau * size[:, None], tau * unturned[:, None]


def _relax_places(
    places: Complex,
    triangles: Triangles,
    weights: Floats,
    turning_goals: Floats,
    mirroring_goals: Complex,
) -> Complex:
    """Return the vertices (n, k) of k frames after STEPS steps that lower their energy.

    weights (t, k): areas of triangles times the weight of their shape in a frame; goals (t, k):
    stretches, up to a rotation. A step finds the rotations first, then all places by one matrix,
    which is at least the energy's in every frame: no step raises it.
    """
    corners, gradients, areas = triangles
    matrix = np.zeros((len(places), len(places)))
    products = (gradients.conj()[:, :, None] * gradients[:, None]).real * areas[:, None, None]
    np.add.at(matrix, (corners[:, :, None], corners[:, None]), products)
    # Else it is singular: the energy knows neither place nor vertices without a triangle.
    matrix[np.diag_indices(len(matrix))] += 1e-6 * np.median(np.diag(matrix))
    inverse = scipy.linalg.inv(matrix)
    places = np.ascontiguousarray(places)
    for _ in range(STEPS):
        slope = _energy_slope(places, corners, gradients, weights, turning_goals, mirroring_goals)
        # Real products are half of complex ones.
        places = places - (inverse @ slope.view(float)).view(complex)
    return places


@kernel
def _energy_slope(
    places: Complex,
    corners: Ints,
    gradients: Complex,
    weights: Floats,
    turning_goals: Floats,
    mirroring_goals: Complex,
) -> Complex:
    """Return the derivative (n, k) of the energy by the places of vertices, with best rotations.

    places (n, k): complex; corners, gradients: fields of `Triangles`; the rest as in
    `_relax_places`.
    """
    slope = np.zeros_like(places)
    for t in range(len(corners)):
        a, b, c = corners[t]
        at_a, at_b, at_c = gradients[t]
        for k in range(places.shape[1]):
            z_a, z_b, z_c = places[a, k], places[b, k], places[c, k]
            turning = (at_a.conjugate() * z_a + at_b.conjugate() * z_b + at_c.conjugate() * z_c) / 2
            mirroring = (at_a * z_a + at_b * z_b + at_c * z_c) / 2
            goal, mirroring_goal = turning_goals[t, k], mirroring_goals[t, k]
            rotation = turning * goal + mirroring * mirroring_goal.conjugate()
            rotation /= max(abs(rotation), 1e-300)
            turning = weights[t, k] * (turning - rotation * goal)
            mirroring = weights[t, k] * (mirroring - rotation * mirroring_goal)
            slope[a, k] += at_a * turning + at_a.conjugate() * mirroring
            slope[b, k] += at_b * turning + at_b.conjugate() * mirroring
            slope[c, k] += at_c * turning + at_c.conjugate() * mirroring
    return slope


def _triangle_gradients(points: Points, sizes: list[int]) -> Triangles | None:
    """Return the triangles within contours (n, 2), but those without an area.

    sizes: numbers of vertices of the contours. None if no triangles cover the area within them.
    """
    triangles, is_whole = triangulate(points, sizes)
    areas = cross_products(points, points, triangles) / 2
    if not is_whole:
        return None
    if areas.sum() < 0:
        triangles, areas = triangles[:, ::-1], -areas
    has_area = areas > FLAT * areas.sum()
    triangles, areas = triangles[has_area], areas[has_area]
    corners = (points @ [1, 1j])[triangles]
    across = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    return Triangles(triangles, 1j * across / (2 * areas[:, None]), areas)
