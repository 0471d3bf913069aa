"""Triangles that cover the area within contours, for players that show only triangles."""

from collections.abc import Sequence

import numpy as np
import skimage.measure
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkFiltersGeneral import vtkContourTriangulator

from finloop.base.arrays import Floats, Ints, Points
from finloop.base.kernel import kernel

MOST_ROUNDS = 100  # of flipping edges; a few are enough
_SURE = 1e-9  # a point is within a circle if it is so by more than this share of its size


def triangulate(points: Points, sizes: Sequence[int]) -> tuple[Ints, bool]:
    """Return triangles (t, 3) of the area within contours (n, 2), and whether they cover it all.

    sizes: numbers of vertices of the contours, one after the other. By the even-odd rule a contour
    within another is a hole. The triangles turn anticlockwise, y up. They do not cover it all where
    contours meet. They are Delaunay triangles but for the contours: no sliver without need, so they
    bear much motion.
    """
    following = np.arange(1, len(points) + 1)
    ends = np.cumsum(sizes)
    following[ends - 1] = ends - sizes
    lines, vertices, outline = vtkCellArray(), vtkPoints(), vtkPolyData()
    edges = np.stack([np.arange(len(points)), following], axis=1).ravel()
    lines.SetData(2, numpy_to_vtk(edges, deep=True, array_type=VTK_ID_TYPE))
    vertices.SetData(numpy_to_vtk(np.c_[points, np.zeros(len(points))], deep=True))
    outline.SetPoints(vertices)
    outline.SetLines(lines)
    triangulator = vtkContourTriangulator()
    triangulator.SetInputData(outline)
    triangulator.TriangulationErrorDisplayOff()
    triangulator.Update()
    found = triangulator.GetOutput().GetPolys().GetConnectivityArray()
    triangles = np.asarray(vtk_to_numpy(found), np.int64).reshape(-1, 3)
    area = cross_products(points, points, triangles)
    is_one_way = bool((area >= 0).all() or (area <= 0).all()) and bool(area.any())
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    contours = np.split(points, ends[:-1])
    expected = len(points)
    for contour in contours:
        around = sum(
            bool(skimage.measure.points_in_poly(contour[:1], other)[0])
            for other in contours
            if other is not contour
        )
        expected += 2 if around % 2 else -2  # a hole needs 2 triangles more, an area has 2 fewer
    is_whole = is_one_way and len(triangles) == expected
    if is_whole:
        _flip_to_delaunay(np.ascontiguousarray(points, np.float64), triangles)
    return triangles, is_whole


def cross_products(points: Points, others: Points, triangles: Ints) -> Floats:
    """Return the cross product u × w (t,) of two edges of each triangle (t, 3).

    u: from its first vertex to its second in `points` (n, 2); w: from its first to its third in
    `others` (n, 2). If both are the same points, the result is twice the signed area.
    """
    u = points[triangles[:, 1]] - points[triangles[:, 0]]
    w = others[triangles[:, 2]] - others[triangles[:, 0]]
    return np.asarray(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0])


@kernel
def _flip_to_delaunay(points: Points, triangles: Ints) -> None:
    """Flip edges between triangles (t, 3) of points (n, 2) until they are Delaunay, in place.

    Two triangles a, b, p and b, a, q get the edge pq instead of ab where q is within the circle
    through a, b, p (Lawson 1977). Edges of one triangle are the contour: they stay.
    """
    for _ in range(MOST_ROUNDS):
        owner = {(-1, -1): -1}  # edge → its triangle, on whose left side it runs
        for k in range(len(triangles)):
            for corner in range(3):
                owner[(triangles[k, corner], triangles[k, (corner + 1) % 3])] = k
        is_flipped = np.zeros(len(triangles), np.bool_)
        for k in range(len(triangles)):
            for corner in range(3):
                a, b = triangles[k, corner], triangles[k, (corner + 1) % 3]
                p = triangles[k, (corner + 2) % 3]
                if is_flipped[k] or (b, a) not in owner or is_flipped[owner[(b, a)]]:
                    continue
                other = owner[(b, a)]
                q = triangles[other].sum() - a - b
                ax, ay = points[a, 0] - points[q, 0], points[a, 1] - points[q, 1]
                bx, by = points[b, 0] - points[q, 0], points[b, 1] - points[q, 1]
                px, py = points[p, 0] - points[q, 0], points[p, 1] - points[q, 1]
                aa, bb, pp = ax * ax + ay * ay, bx * bx + by * by, px * px + py * py
                inside = aa * (bx * py - by * px) - bb * (ax * py - ay * px)
                inside += pp * (ax * by - ay * bx)
                # both new triangles, p a q and q b p, must have an area
                if (
                    inside > _SURE * max(aa, bb, pp) ** 2
                    and px * ay - py * ax > 0
                    and bx * py - by * px > 0
                ):
                    triangles[k, 0], triangles[k, 1], triangles[k, 2] = p, a, q
                    triangles[other, 0], triangles[other, 1], triangles[other, 2] = q, b, p
                    is_flipped[k] = is_flipped[other] = True
        if not is_flipped.any():
            return
