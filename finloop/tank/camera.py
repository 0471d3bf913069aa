"""Cameras of the tank: presets, an orbit, one that follows the fish, and a tour of these.

Coordinates of the tank: px, x right, y up (−y of the film), z above the floor.
"""

from typing import NamedTuple

import numpy as np
import scipy

from finloop.base.arrays import Reals

TOP, SIDE, CORNER, FOLLOW, ORBIT, TOUR = "top", "side", "corner", "follow", "orbit", "tour"
PRESETS = (TOP, SIDE, CORNER, FOLLOW)
CAMERAS = (*PRESETS, ORBIT, TOUR)
VIEW_DEG = 32.0  # vertical field of view
GLASS_PER_DEPTH = 1.08  # height of the glass, in depths of the water
_TURN_S = 40.0  # an orbit
_FILLS = 0.94  # how much of the picture the tank fills at most
_SMOOTHING_S = 0.8  # by which a camera that follows smooths the path of the fish
_SCENES = ((ORBIT, 4.0), (FOLLOW, 4.0), (SIDE, 4.0))  # of a tour, and how many s each takes
_BLEND_S = 2.0  # from one scene of a tour to the next


class CameraViews(NamedTuple):
    """A camera at every tick: its place and the point that it looks at, both (ticks, 3) px.

    half_height_px: half the height of what a parallel view shows; None: the view is perspective.
    """

    place: Reals
    aim: Reals
    half_height_px: float | None = None


class TankSize(NamedTuple):
    """Sizes of the tank, px: width and height of the film, depth of the water, length of a fish.

    aspect: width / height of the pictures.
    """

    width: float
    height: float
    depth: float
    body_length: float
    aspect: float = 16 / 9

    @property
    def corners(self) -> Reals:
        """Return the four corners of the film on the floor, (4, 2) px, anticlockwise, y up."""
        left, top = -0.5, 0.5  # the film's first pixel has its centre at 0, 0
        right, bottom = left + self.width, top - self.height
        return np.array([[left, bottom], [right, bottom], [right, top], [left, top]])

    @property
    def middle(self) -> Reals:
        """Return the middle of the water, (3,) px: x right, y up (below 0), z above the floor."""
        return np.array([(self.width - 1) / 2, -(self.height - 1) / 2, self.depth / 2])


def camera_views(
    camera: str, tank: TankSize, fish: Reals, heading: Reals, rate_hz: float
) -> CameraViews:
    """Return a camera's place and aim at every tick; `camera` is one of CAMERAS.

    fish (ticks, 3), heading (ticks,): place [px], and direction [rad] without jumps of 2π, of the
    fish that some cameras follow; rate_hz: ticks per second. Angles are chosen for the looks.
    """
    ticks = len(fish)
    if camera == TOP:
        half_height = max(tank.height, tank.width / tank.aspect) / 2 * 1.04  # 4 % of margin
        aim = np.tile(tank.middle * (1, 1, 0), (ticks, 1))
        # In a parallel view any height will do that is above the water.
        return CameraViews(aim + np.array([0, 0, 4 * tank.width]), aim, half_height)
    if camera == SIDE:
        return _view_from_side(tank, fish, rate_hz)
    if camera == CORNER:
        return _view_from_outside(tank, azimuth_deg=np.full(ticks, -58.0), elevation_deg=24.0)
    if camera == ORBIT:
        azimuth_deg = -70 + 360 / _TURN_S / rate_hz * np.arange(ticks, dtype=float)
        return _view_from_outside(tank, azimuth_deg, elevation_deg=22.0)
    if camera == FOLLOW:
        return _view_following_fish(tank, fish, heading, rate_hz)
    return _view_tour(tank, fish, heading, rate_hz)


def _view_from_outside(tank: TankSize, azimuth_deg: Reals, elevation_deg: float) -> CameraViews:
    """Return views from outside, as near as the whole tank fits into the picture.

    azimuth_deg (ticks,), elevation_deg: direction from the tank to the camera, anticlockwise from
    x, and above the floor.
    """
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    x, y, zero = np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))
    # The camera's axes: ahead to the tank, right, and up, (ticks, 3) each.
    ahead = -np.stack([x * np.cos(elevation), y * np.cos(elevation), zero + np.sin(elevation)], -1)
    right = np.stack([-y, x, zero], -1)
    up = np.cross(right, ahead)
    # The 8 corners of the tank about its middle, along these axes: (ticks, 8) each.
    units = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), -1).reshape(-1, 3)
    corners = units * (tank.width, tank.height, tank.depth)
    across, high, deep = (axis @ corners.T for axis in (right, up, ahead))
    # The distance at which all corners are in the picture, and how much higher than the tank's
    # middle the aim is (lift): after four rounds the spaces above and below are nearly equal.
    half_picture = np.tan(np.radians(VIEW_DEG / 2)) * _FILLS  # its half height at distance 1
    lift = np.zeros((len(azimuth), 1))
    for _ in range(4):
        needed = np.maximum(np.abs(across) / tank.aspect, np.abs(high - lift)) / half_picture
        distance = (needed - deep).max(1, keepdims=True)
        slope = (high - lift) / (distance + deep)  # how high a corner appears
        lift = lift + distance * (slope.max(1, keepdims=True) + slope.min(1, keepdims=True)) / 2
    aim = tank.middle + lift * up
    return CameraViews(aim - distance * ahead, aim)


def _view_following_fish(
    tank: TankSize, fish: Reals, heading: Reals, rate_hz: float
) -> CameraViews:
    """Return views that follow a fish from behind, above and beside it, smoother than its path.

    fish (ticks, 3): px; heading (ticks,): rad. Angle and distances are chosen for the looks.
    """
    smoothing = _SMOOTHING_S * rate_hz  # ticks, SD
    # The camera keeps closer to the fish's place than to its heading: quick turns are not followed.
    path = scipy.ndimage.gaussian_filter1d(fish, smoothing / 3, axis=0, mode="nearest")
    angle = scipy.ndimage.gaussian_filter1d(heading, smoothing, mode="nearest") + np.radians(28)
    back = np.stack([-np.cos(angle), -np.sin(angle), np.full(len(angle), 0.33)], -1)
    return CameraViews(path + 2.5 * tank.body_length * back, path - (0, 0, 0.33 * tank.body_length))


def _view_from_side(tank: TankSize, fish: Reals, rate_hz: float) -> CameraViews:
    """Return views from beyond the film's lower edge, which move along with the fish."""
    smoothing = _SMOOTHING_S * rate_hz  # ticks, SD
    path = scipy.ndimage.gaussian_filter1d(fish, smoothing, axis=0, mode="nearest")
    place = path + np.array([0.7, -5.2, 0.0]) * tank.body_length  # chosen for the looks
    place[:, 2] = 0.7 * tank.depth
    return CameraViews(place, path - (0, 0, 0.1 * tank.depth))


def _view_tour(tank: TankSize, fish: Reals, heading: Reals, rate_hz: float) -> CameraViews:
    """Return views that pass smoothly through the scenes in `_SCENES`, again and again.

    fish, heading, rate_hz: as in `camera_views`.
    """
    # For each tick: the number of its scene, and its share (ticks, 1), as it is blended in.
    ticks = np.arange(len(fish))
    time_s, ends_s = ticks / rate_hz, np.cumsum([seconds for _, seconds in _SCENES])
    tour_s = time_s % ends_s[-1]  # since the tour last began
    scene = np.searchsorted(ends_s, tour_s, side="right")
    scene_s = tour_s - np.r_[0.0, ends_s][scene]  # since the scene began
    share = np.clip(scene_s / _BLEND_S, 0, 1)
    share = share * share * (3 - 2 * share)  # smooth at both ends
    # The very first scene has none before it from which it could blend.
    share = np.where(time_s < ends_s[0], 1.0, share)[:, None]
    views = [camera_views(name, tank, fish, heading, rate_hz) for name, _ in _SCENES]

    def mix_scenes(points: list[Reals]) -> Reals:
        """Return points (ticks, 3) blended from those of the scenes, a list in their order."""
        stack = np.stack(points)
        present, before = stack[scene, ticks], stack[scene - 1, ticks]
        return before + share * (present - before)

    return CameraViews(mix_scenes([v.place for v in views]), mix_scenes([v.aim for v in views]))
