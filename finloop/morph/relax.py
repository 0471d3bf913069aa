"""Make the frames of a morph less distorted: as-rigid-as-possible shapes between two shapes.

Every triangle of a shape becomes one of the other by a rotation and a stretch S. In the frame at
the share τ of the way its map should be (1 − τ) I + τ S and a rotation, any one. The frame
minimises how far all maps J are from that, ∫ ‖J − R ((1 − τ) I + τ S)‖² (Alexa, Cohen-Or and Levin,
"As-rigid-as-possible shape interpolation", 2000; rotations are found as by Sorkine and Alexa,
2007). Triangles of both shapes count, those of the first 1 − τ times, of the second τ times.
"""

import numpy as np
import scipy

from finloop.base.arrays import Complex, Floats, Points
from finloop.base.triangles import cross_products, triangulate
from finloop.morph.folds import ContourLayout

COARSE = (64, 128, 256)
"""Points of a contour for which frames are solved: the fewest that leave all contours apart."""
KNOTS = 8  # frames that are solved, evenly in time
STEPS = 12  # of each solution; each lowers the energy
FLAT = 1e-9  # area of a triangle, as a share of its shape's, that counts as none


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
        start = _shape_gradients(stack[0, vertices], sizes)
        end = _shape_gradients(stack[-1, vertices], sizes)
        if start is not None and end is not None:
            break
    else:
        return None
    (first, first_areas), (last, last_areas) = start, end
    knots = np.unique(np.round(np.linspace(0, frames - 1, KNOTS + 2)).astype(int))
    tau = (knots / (frames - 1))[1:-1]
    z = stack[:, vertices] @ [1, 1j]
    goals = [_blend_stretches(first, z[-1], tau), _blend_stretches(last, z[0], 1 - tau)]
    places = z[knots[1:-1]].T
    relaxed = _relax_places(
        places,
        np.concatenate([first, last]),
        np.r_[first_areas, last_areas],
        np.concatenate([first_areas[:, None] * (1 - tau), last_areas[:, None] * tau]),
        *(np.concatenate(parts) for parts in zip(*goals, strict=True)),
    )
    moves = np.zeros((len(knots), len(vertices)), complex)
    moves[1:-1] = (relaxed - places).T
    in_time = scipy.interpolate.CubicSpline(knots, moves)(np.arange(frames))
    result = np.empty((frames, count), complex)
    splits = np.cumsum(sizes)[:-1]
    for part, points, some in zip(
        layout.parts, coarse, np.split(in_time, splits, axis=1), strict=True
    ):
        along = scipy.interpolate.CubicSpline(
            np.r_[points, part.stop], np.c_[some, some[:, :1]], axis=1, bc_type="periodic"
        )
        result[:, part] = along(np.arange(part.start, part.stop))
    result[[0, -1]] = 0.0  # but for rounding they are
    return np.stack([result.real, result.imag], axis=-1)


def _blend_stretches(gradients: Complex, other: Complex, tau: Floats) -> tuple[Floats, Complex]:
    """Return how triangles are stretched at shares tau (k,): turning and mirroring parts (t, k).

    gradients (t, n): of a shape; other (n,): its vertices in the other shape. The stretch S of each
    triangle grows evenly, from none to that of the other shape: (1 − τ) I + τ S.
    """
    turning, mirroring = gradients.conj() @ other / 2, gradients @ other / 2
    size = abs(turning)
    unturned = mirroring * turning.conj() / np.maximum(size, 1e-300)
    return 1 - tau + tau * size[:, None], tau * unturned[:, None]


def _relax_places(
    places: Complex,
    gradients: Complex,
    areas: Floats,
    weights: Floats,
    turning_goals: Floats,
    mirroring_goals: Complex,
) -> Complex:
    """Return the vertices (n, k) of k frames after STEPS steps that lower their energy.

    gradients (t, n): see `_shape_gradients`; areas (t,): of triangles; weights (t, k): their areas
    times the weight of their shape in a frame; goals (t, k): stretches, up to a rotation. A step
    finds the rotations first, then all places by one matrix, which is at least the energy's in
    every frame: no step raises it.
    """
    # Real matrices: half the products of complex ones. ∂x and ∂y of all triangles, (2 t, n)
    derivatives = np.concatenate([gradients.real, gradients.imag])
    matrix = derivatives.T @ (np.r_[areas, areas][:, None] * derivatives)
    # Else it is singular: the energy knows neither place nor vertices without a triangle.
    matrix[np.diag_indices(len(matrix))] += 1e-6 * np.median(np.diag(matrix))
    inverse = scipy.linalg.solve(matrix, derivatives.T, assume_a="pos")
    places = np.ascontiguousarray(places)
    for _ in range(STEPS):
        along_x, along_y = np.split((derivatives @ places.view(float)).view(complex), 2)
        turning, mirroring = (along_x - 1j * along_y) / 2, (along_x + 1j * along_y) / 2
        rotation = turning * turning_goals + mirroring * mirroring_goals.conj()
        rotation /= np.maximum(abs(rotation), 1e-300)
        turning -= rotation * turning_goals
        mirroring -= rotation * mirroring_goals
        slope = np.concatenate([
            weights * (turning + mirroring), 1j * weights * (turning - mirroring)
        ])  # fmt: skip
        places = places - (inverse @ slope.view(float)).view(complex)
    return places


def _shape_gradients(points: Points, sizes: list[int]) -> tuple[Complex, Floats] | None:
    """Return gradients (t, n) and areas (t,) of triangles within contours (n, 2); None if none.

    Row t times the values at the vertices is ∂x + i ∂y of the linear function in triangle t. A map
    z ↦ w, both complex, turns and stretches by half its conjugate times w, and mirrors by half of
    it times w. sizes: of the contours. None if there are no triangles that cover the area.
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
    gradients = np.zeros((len(triangles), len(points)), complex)
    np.put_along_axis(gradients, triangles, 1j * across / (2 * areas[:, None]), axis=1)
    return gradients, areas
