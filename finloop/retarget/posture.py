"""Find the film's postures for requested body lines: probabilistic PCA, and alignment.

A body keeps its proportions: only the bends of a recorded animal are used, not the lengths of its
parts. Bends are some of the components of a posture. With the film's principal shapes as a
probabilistic model (Tipping and Bishop, Probabilistic Principal Component Analysis, 1999), its
codes are the most probable ones given these bends:

    c = argmin |W (b − m) − S c|² / σ² + Σ c² / λ,

with b the bends; m, W, S their mean, weights and (weighted) shapes; λ the variance of the codes;
and σ² the variance that the shapes leave. Place and heading bring the drawn backbone nearest to the
requested line (Kabsch 1976, in the plane).
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Mask, Points
from finloop.puppet import Pose, PoseShapes
from finloop.puppet.pose import backbone_directions, backbone_steps

_ROUNDS = 4  # of bends relative to a heading, then the heading of the resulting posture
_FLOOR = 1e-9  # of the total variance: least noise, where the shapes leave none
_HEAD = 1 / 3  # of the body: the chord of this part is the first heading


class FittedPostures(NamedTuple):
    """Postures that the film can show at T ticks (pose), and their codes (T, c).

    clamped (T,): which were changed, as the film shows nothing like them.
    """

    pose: Pose
    codes: Floats
    clamped: Mask


def fit_postures(
    points: Points, along: Floats, shapes: PoseShapes, size_px: float, codes: Floats | None = None
) -> FittedPostures:
    """Return the film's postures nearest to recorded body lines (T, m, 2) px, head first.

    along (m,): where along the body the points are, 0 = head, 1 = tail; size_px: typical length of
    the animal to draw; codes (T, c): the pose codes (principal-component scores), None if unknown.
    Postures unlike all of the film are changed to the nearest ones of the film.
    """
    if codes is not None:
        shown, clamped = shapes.nearest_codes(codes)
        return FittedPostures(
            align_postures(shapes.decode(shown), points, along, size_px), shown, clamped
        )
    # The codes depend on the heading, and this on the posture: they are estimated in turn.
    head_direction, directions = _directions_from_head(points, along)
    heading_from_head = np.zeros(len(points))  # by how much the heading differs from the head's
    for _ in range(_ROUNDS):
        likely = most_likely_codes(directions - heading_from_head[:, None], along, shapes)
        shown, clamped = shapes.nearest_codes(likely)
        pose = align_postures(shapes.decode(shown), points, along, size_px)
        heading_from_head = np.angle(np.exp(1j * (pose.heading_rad - head_direction)))
    return FittedPostures(pose, shown, clamped)


def _directions_from_head(points: Points, along: Floats) -> tuple[Floats, Floats]:
    """Return the direction of the head (T,), and of each body step relative to it, in radians.

    Both are radians, anticlockwise on screen; the steps (T, m − 1) lead towards the head, without
    jumps of 2 π along the body. The head points from a third of the body to its first point.
    points, along: as in `fit_postures`.
    """
    neck = max(1, int(np.argmin(np.abs(along - _HEAD))))
    head = points[:, 0] - points[:, neck]
    head_direction = np.arctan2(-head[:, 1], head[:, 0])
    step = points[:, :-1] - points[:, 1:]
    angles = np.arctan2(-step[..., 1], step[..., 0]) - head_direction[:, None]
    angles[:, 0] = np.angle(np.exp(1j * angles[:, 0]))  # within ±π
    return head_direction, np.unwrap(angles, axis=1)


def most_likely_codes(directions: Floats, along: Floats, shapes: PoseShapes) -> Floats:
    """Return the most probable pose codes (T, c) for directions (T, m − 1) of body steps.

    Directions are in radians relative to the heading, towards the head. along (m,): where along the
    body the ends of the steps are, 0 = head, 1 = tail; each lies on a point of the film's
    backbones.

    Probabilistic principal components (Tipping and Bishop 1999): codes c minimise
    |deviations − components c|² / noise + Σ c² / variance.
    """
    bend_count = backbone_directions(shapes.mean).size
    first = round(along[0] * bend_count)
    is_given = np.zeros(len(shapes.mean), bool)  # of the numbers of a posture, among them bends
    backbone_directions(is_given)[first : first + directions.shape[1]] = True  # changes `is_given`
    deviations = (directions - shapes.mean[is_given]) * shapes.weights[is_given]
    components = shapes.shapes[:, is_given]
    # The noise is the variance that the shapes leave, spread over the numbers that they leave free.
    variance_left = max(shapes.total_variance - float(shapes.variance.sum()), 0.0)
    free_numbers = max(len(shapes.mean) - len(shapes.shapes), 1)
    noise = max(variance_left / free_numbers, _FLOOR * shapes.total_variance)
    prior = np.diag(noise / np.maximum(shapes.variance, 1e-30))
    return np.linalg.solve(components @ components.T + prior, components @ deviations.T).T


def align_postures(
    postures: Floats, points: Points, along: Floats, size_px: float,
    heading_rad: Floats | None = None,
) -> Pose:  # fmt: skip
    """Return postures (T, d) placed and turned so that they lie nearest to points (T, m, 2) px.

    along (m,): where along the body the points are, 0 = head, 1 = tail, NaN = the mass centre.
    size_px: typical length of the animal. heading_rad (T,): needed where a single point determines
    no heading.
    """
    zeros = np.zeros(len(postures))
    unplaced = Pose(zeros, zeros, zeros, zeros + size_px, postures)
    on_body = places_on_body(unplaced, along)
    # As complex numbers x − iy, whose angles are anticlockwise on screen, the best rotation is the
    # angle of one sum (Kabsch 1976, in the plane).
    body, line = on_body[..., 0] - 1j * on_body[..., 1], points[..., 0] - 1j * points[..., 1]
    body_centre, line_centre = body.mean(1), line.mean(1)
    if heading_rad is None:
        heading_rad = np.angle(
            ((body - body_centre[:, None]).conj() * (line - line_centre[:, None])).sum(1)
        )
    centre = line_centre - body_centre * np.exp(1j * heading_rad)
    return unplaced.move_to(centre.real, -centre.imag, heading_rad, size_px)


def places_on_body(pose: Pose, along: Floats) -> Points:
    """Return the points (T, m, 2) px at shares (m,) of the backbones of poses (T).

    along: 0 = head, 1 = tail, NaN = the mass centre.
    """
    line = pose.backbone_px()
    place = np.nan_to_num(along) * (line.shape[1] - 1)
    low = np.minimum(place.astype(int), line.shape[1] - 2)
    share = (place - low)[:, None]
    places = (1 - share) * line[:, low] + share * line[:, low + 1]
    centre = np.stack([pose.x_px, pose.y_px], -1)[:, None]
    return np.where(np.isnan(along)[:, None], centre, places)


def backbone_length_share(shapes: PoseShapes) -> float:
    """Return the backbone's length in the mean posture, in typical lengths (`size_px`)."""
    return float(backbone_steps(shapes.mean).sum())


def straight_distance_share(shapes: PoseShapes, along: Floats) -> float:
    """Return the straight distance of two body points in the mean posture, in typical lengths.

    along (2,): the points, 0 = head, 1 = tail. The unit is `size_px`.
    """
    zeros = np.zeros(1)
    ends = places_on_body(Pose(zeros, zeros, zeros, zeros + 1, shapes.mean[None]), along)[0]
    return float(np.hypot(*(ends[-1] - ends[0])))
