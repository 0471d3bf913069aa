"""The messages of trackers and other devices, strictly parsed, and their places in the tank.

A message is JSON: one sighting of an animal, or a list of them,

    {"t": 12.48, "id": "1", "x": 310.5, "y": 201.0, "heading": 35.0}

t: seconds of the tracker's own clock, from any zero; id: a whole number or a short name; x, y: in
the tracker's unit; heading: degrees, anticlockwise as seen in the tracker's picture, 0 = along x;
it may be left out. A `token` is allowed; inputs that other machines reach require one.
"""

import math
from collections.abc import Iterator
from itertools import combinations
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, StringConstraints, TypeAdapter
from skimage.transform import AffineTransform, ProjectiveTransform, SimilarityTransform

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.show.message import Number, StrictModel, parse_json

MOST_AT_ONCE = 64
"""The most sightings in a message, and the most animals at once."""
LONGEST = 16_000  # bytes of a message
_LONGEST_TRIGGER = 1000  # bytes
MOST_PAIRS = 16  # pairs of points of a calibration
_CORNER_PX = 2.0  # how far from a corner of the picture a point still means that corner
_HORIZON = 1e-9  # least weight of a place
_FLAT = 1e-3  # points whose triangle is smaller, as a share of their extent², are on one line

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
AnimalId = Number | Annotated[str, StringConstraints(pattern=r"^[\w.: -]{1,40}$")]
Token = Annotated[str, StringConstraints(max_length=200)]


class Sighting(StrictModel):
    """A tracker's report of one animal at a moment; the module's text explains its fields.

    The ids 1 and "1" are the same animal.
    """

    t: Annotated[float, Field(ge=-1e11, le=1e11)]
    id: AnimalId
    x: Coordinate
    y: Coordinate
    heading: Annotated[float, Field(ge=-1e4, le=1e4)] | None = None
    token: Token | None = None


class TriggerMessage(StrictModel):
    """A device's message that begins a trial. name: as the protocol's `start` has it."""

    do: Literal["trigger"]
    name: Annotated[str, Field(max_length=80)]
    token: Token = ""


_SIGHTINGS: TypeAdapter[Sighting | list[Sighting]] = TypeAdapter(
    Sighting | Annotated[list[Sighting], Field(min_length=1, max_length=MOST_AT_ONCE)]
)

_TRIGGER = TypeAdapter(TriggerMessage)


def parse_sightings(text: str | bytes | None) -> list[Sighting] | None:
    """Return the sightings in a tracker's JSON message; None if it is too long or invalid."""
    message = parse_json(_SIGHTINGS, text, LONGEST)
    return [message] if isinstance(message, Sighting) else message


def parse_trigger(text: str | bytes | None) -> str | None:
    """Return the name in a device's JSON message {"do": "trigger", "name": …}; None if invalid."""
    message = parse_json(_TRIGGER, text, _LONGEST_TRIGGER)
    return None if message is None else message.name


# --- calibration


PlaceXY = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]  # a list, in YAML and JSON


class PointPair(StrictModel):
    """One point in two units: the tracker's, and px of the tank's picture."""

    tracker: PlaceXY
    """x, y in the tracker's unit."""
    tank: PlaceXY
    """x, y in px of the tank's picture."""


class TrackerSettings(StrictModel):
    """What a tracker's places mean: their unit, the direction of y, and pairs of known points."""

    unit: Literal["px", "mm"] = "px"
    """Unit of the tracker's places, where no points are given: px of the tank's picture, or mm of
    the real world; the origin is the upper left of the tank's picture."""
    y_axis: Literal["down", "up"] = "down"
    """Whether y grows downwards in the tracker's picture, as px do, or upwards; upwards requires
    points."""
    points: Annotated[tuple[PointPair, ...], Field(strict=False, max_length=MOST_PAIRS)] = ()
    """Pairs {tracker: [x, y], tank: [x, y]}: none; or 2 (turned, scaled, moved), 3 (and sheared or
    mirrored), or 4..16 (seen at an angle)."""


Row3 = tuple[float, float, float]
"""A row of a matrix (3, 3)."""


class TrackerPlace(NamedTuple):
    """Where an animal is, as its tracker sends it: x, y in its unit, heading in degrees."""

    x: float
    y: float
    heading: float


class TrackerCalibration(NamedTuple):
    """Conversion of a tracker's places to px of the tank's picture.

    matrix (3, 3): projection in homogeneous coordinates, positive weights where the tank is; up:
    whether the tracker's y grows upwards; error_px: root mean square distance of its points from
    those of the tank.
    """

    matrix: tuple[Row3, Row3, Row3]
    up: bool = False
    error_px: float = 0.0

    def map_place(self, x: float, y: float) -> tuple[float, float]:
        """Return a tracker's place x, y in px of the tank's picture: (x', y') / w.

        (x', y', w) = matrix · (x, y, 1). A place behind the horizon of an oblique view, where w
        would be negative, is very far away.
        """
        (a, b, c), (d, e, f), (g, h, i) = self.matrix
        weight = max(g * x + h * y + i, _HORIZON)
        return (a * x + b * y + c) / weight, (d * x + e * y + f) / weight

    def map_heading_rad(self, x: float, y: float, heading_deg: float) -> float:
        """Return a tracker's heading [degrees] at its place x, y as a heading in the tank [rad]."""
        angle = math.radians(heading_deg)
        y_part = math.sin(angle) * (1 if self.up else -1)
        right, down = self._map_direction(x, y, math.cos(angle), y_part)
        return math.atan2(-down, right)

    def map_to_tracker(self, x_px: float, y_px: float, heading_rad: float) -> TrackerPlace:
        """Return a place [px] and heading [rad] in the tank as the tracker would send them."""
        inverse = TrackerCalibration(_to_rows(np.linalg.inv(np.array(self.matrix))))
        x, y = inverse.map_place(x_px, y_px)
        direction = math.cos(heading_rad), -math.sin(heading_rad)
        x_part, y_part = inverse._map_direction(x_px, y_px, *direction)
        heading_rad = math.atan2(y_part if self.up else -y_part, x_part)
        return TrackerPlace(x, y, math.degrees(heading_rad))

    def _map_direction(self, x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
        """Return a direction dx, dy at a tracker's place x, y as one in the tank, of any length.

        This is the derivative of `map_place` along the direction, times the weight w > 0.
        """
        (a, b, _), (d, e, _), (g, h, _) = self.matrix
        tank_x, tank_y = self.map_place(x, y)
        weight_change = g * dx + h * dy
        return a * dx + b * dy - tank_x * weight_change, d * dx + e * dy - tank_y * weight_change


PX = TrackerCalibration(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
"""The calibration of a tracker that sends px of the tank's picture."""


def fit_calibration(settings: TrackerSettings, mm_per_px: float | None) -> TrackerCalibration:
    """Return the conversion of a tracker's places to px of the tank.

    It follows from the pairs of points, or from the unit if there are none. mm_per_px: mm of the
    real world per px of the tank's picture, None if unknown. FinloopError lists all problems.
    """
    problems = list(_calibration_problems(settings, mm_per_px))
    if not problems and not settings.points:
        scale = 1.0 if settings.unit == "px" or mm_per_px is None else 1 / mm_per_px
        return TrackerCalibration(((scale, 0.0, 0.0), (0.0, scale, 0.0), (0.0, 0.0, 1.0)))
    if not problems:
        fit = _fit_points(settings)
        if fit is not None:
            return fit
        problems = ["no view of the tank shows these points: some are in the wrong order"]
    raise FinloopError(
        "the tracker's calibration is invalid:\n    " + "\n    ".join(problems),
        "a unit; and no points, or 2 pairs at different places, 3 not on one line, or 4 or "
        "more that include the corners of a quadrangle",
        "correct the pairs {tracker: [x, y], tank: [x, y]}; corners of the tank are best",
    )


def refuse_other_tank(settings: TrackerSettings, width: float, height: float) -> None:
    """Raise FinloopError if the points are corners of a tank of another size, in px.

    settings: with points. width, height: of the tank's picture. Points that are no rectangle from
    its upper left are landmarks, which may be anywhere.
    """
    places = np.array([pair.tank for pair in settings.points])
    right, bottom = places.max(axis=0).tolist()
    for corner in ((0, 0), (right, 0), (right, bottom), (0, bottom)):
        if np.abs(places - corner).max(axis=1).min() > _CORNER_PX:
            return
    # Pixel centres are whole numbers: the last one is the size less 1.
    if max(abs(right - (width - 1)), abs(bottom - (height - 1))) > _CORNER_PX:
        raise FinloopError(
            f"the tracker's points are the corners of a tank of {right + 1:g} × {bottom + 1:g} px,"
            f" and this film's is {width:g} × {height:g} px",
            "the corners of this film's tank, or other points in px of its picture",
            f"write its corners: [0, 0], [{width - 1:g}, 0], [{width - 1:g}, {height - 1:g}],"
            f" [0, {height - 1:g}]",
        )


def _calibration_problems(settings: TrackerSettings, mm_per_px: float | None) -> Iterator[str]:
    """Yield a sentence for each problem that prevents a calibration from a tracker's settings."""
    count = len(settings.points)
    if count == 0 and settings.unit == "mm" and mm_per_px is None:
        yield "the tracker sends mm, but neither the film's scale nor points are given"
    if count == 0 and settings.y_axis == "up":
        yield "y grows upwards, but no points define its origin"
    if count == 1:
        yield "there is only one pair of points"
    for side in ("tracker", "tank"):
        points = np.array([getattr(pair, side) for pair in settings.points])
        if count > 1 and not _are_points_sufficient(points):
            what = {2: "are the same", 3: "lie on one line"}.get(count, "lie on lines, or meet")
            yield f"the {count} points of the {side} {what}: {points.tolist()}"


def _are_points_sufficient(points: Floats) -> bool:
    """Return whether points (n, 2), n ≥ 2, suffice to fit a calibration.

    Two must differ. Three must not lie on one line. Of four or more, some four must have no three
    on one line.
    """
    least_area = _FLAT * float(np.ptp(points, axis=0).max()) ** 2

    def are_collinear(three: tuple[Floats, ...]) -> bool:
        """Return whether three points lie on one line: their triangle has hardly any area."""
        (ax, ay), (bx, by) = three[1] - three[0], three[2] - three[0]
        return bool(abs(ax * by - ay * bx) <= least_area)

    if len(points) == 2:
        return least_area > 0
    for corners in combinations(points, min(len(points), 4)):
        if not any(are_collinear(three) for three in combinations(corners, 3)):
            return True
    return False


def _fit_points(settings: TrackerSettings) -> TrackerCalibration | None:
    """Return the calibration that fits the pairs of points; None if no view of the tank does.

    Two points cannot show a mirror image, so y is turned over first where it grows upwards.
    """
    tracker = np.array([pair.tracker for pair in settings.points])
    tank = np.array([pair.tank for pair in settings.points])
    up = settings.y_axis == "up"
    y_sign = -1.0 if up else 1.0
    kinds: dict[int, Any] = {2: SimilarityTransform, 3: AffineTransform}
    kind = kinds.get(len(tank), ProjectiveTransform)
    transform = kind.from_estimate(tracker * [1.0, y_sign], tank)
    if not transform:
        return None
    matrix = np.asarray(transform.params) @ np.diag([1.0, y_sign, 1.0])  # of y as it is sent
    # The points' third homogeneous coordinates: of one sign if all are in front of the camera.
    depths = tracker @ matrix[2, :2] + matrix[2, 2]
    if not np.isfinite(matrix).all() or depths.min() * depths.max() <= 0:
        return None
    fit = TrackerCalibration(_to_rows(matrix / depths.mean()), up)
    errors = np.array([fit.map_place(x, y) for x, y in tracker.tolist()]) - tank
    return fit._replace(error_px=float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))))


def _to_rows(matrix: Floats) -> tuple[Row3, Row3, Row3]:
    """Return the three rows of an array (3, 3), as tuples."""
    a, b, c = matrix.tolist()
    return tuple(a), tuple(b), tuple(c)
