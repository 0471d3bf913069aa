"""Cameras of the tank: presets, an orbit, one that follows the fish, and a tour of these.

Coordinates of the tank: px, x right, y up (−y of the film), z above the floor.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.floating]

TOP, SIDE, CORNER, FOLLOW, ORBIT, TOUR = "top", "side", "corner", "follow", "orbit", "tour"
PRESETS = (TOP, SIDE, CORNER, FOLLOW)
CAMERAS = (*PRESETS, ORBIT, TOUR)
VIEW_DEG = 32.0  # vertical field of view
_TURN_S = 40.0  # an orbit
_FILLS = 0.94  # how much of the picture the tank fills at most
_SMOOTHING_S = 0.8  # by which a camera that follows smooths the path of the fish
_SCENES = ((ORBIT, 4.0), (FOLLOW, 4.0), (SIDE, 4.0))  # of a tour, and how many s each takes
_BLEND_S = 2.0  # from one scene of a tour to the next


class CameraViews(NamedTuple):
    """A camera at every tick: its place and the point that it looks at, both (ticks, 3) px.

    height_px: half the height of what a parallel view shows; None where the view is perspective.
    """

    place: Floats
    aim: Floats
    height_px: float | None = None


class TankRoom(NamedTuple):
    """Sizes of the tank, px: width and height of the film, depth of the water, body length.

    aspect: width / height of the pictures.
    """

    width: float
    height: float
    depth: float
    length: float
    aspect: float = 16 / 9

    @property
    def middle(self) -> Floats:
        """Return the middle of the water, (3,) px: x right, y up (below 0), z above the floor."""
        return np.array([(self.width - 1) / 2, -(self.height - 1) / 2, self.depth / 2])


def camera_views(
    camera: str, room: TankRoom, fish: Floats, heading: Floats, rate_hz: float
) -> CameraViews:
    """Return the place and the aim of a camera, one of CAMERAS, at every tick.

    fish (ticks, 3): its place, px; heading (ticks,): rad, without jumps of 2π; both of the
    fish that some cameras follow. rate_hz: ticks per second.
    """
    ticks = len(fish)
    if camera == TOP:
        half_height = max(room.height, room.width / room.aspect) / 2 * 1.04  # a little margin
        aim = np.tile(room.middle * (1, 1, 0), (ticks, 1))
        return CameraViews(aim + np.array([0, 0, 4 * room.width]), aim, half_height)
    if camera == SIDE:
        return _view_from_edge(room, fish, rate_hz)
    if camera == CORNER:
        return _view_from_outside(room, np.full(ticks, -58.0), elevation_deg=24.0)
    if camera == ORBIT:
        azimuth = -70 + 360 / _TURN_S / rate_hz * np.arange(ticks, dtype=float)
        return _view_from_outside(room, azimuth, elevation_deg=22.0)
    if camera == FOLLOW:
        return _view_following_fish(room, fish, heading, rate_hz)
    return _view_touring(room, fish, heading, rate_hz)


def _view_from_outside(room: TankRoom, azimuth_deg: Floats, elevation_deg: float) -> CameraViews:
    """Return views from outside, as near as possible with the whole tank in the picture.

    azimuth_deg (ticks,), elevation_deg: direction from the tank to the camera, anticlockwise from
    x, and above the floor.
    """
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    east, north, zero = np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))
    level, rise = np.cos(elevation), zero + np.sin(elevation)
    ahead = -np.stack([east * level, north * level, rise], -1)  # from the camera to the tank
    right = np.stack([-north, east, zero], -1)
    up = np.cross(right, ahead)
    half_picture = np.tan(np.radians(VIEW_DEG / 2)) * _FILLS  # its half height at distance 1
    units = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), -1).reshape(-1, 3)
    corners = units * (room.width, room.height, room.depth)
    # Each corner of the tank about its middle, as the camera sees it: (ticks, 8).
    across, high, deep = (axis @ corners.T for axis in (right, up, ahead))
    lift = np.zeros((len(azimuth), 1))  # of the aim above the tank's middle
    for _ in range(4):  # nearly as much room above the tank as below after four rounds
        # As near as each corner can be and is still in the picture; then how high it appears there.
        needed = np.maximum(np.abs(across) / room.aspect, np.abs(high - lift)) / half_picture
        distance = (needed - deep).max(1, keepdims=True)
        slope = (high - lift) / (distance + deep)
        lift = lift + distance * (slope.max(1, keepdims=True) + slope.min(1, keepdims=True)) / 2
    aim = room.middle + lift * up
    return CameraViews(aim - distance * ahead, aim)


def _view_following_fish(
    room: TankRoom, fish: Floats, heading: Floats, rate_hz: float
) -> CameraViews:
    """Return views from behind, above and beside a fish, smoother than its path.

    fish (ticks, 3): its place, px; heading (ticks,): rad; rate_hz: ticks per second. Angle and
    distances are chosen for the looks.
    """
    smoothing = _SMOOTHING_S * rate_hz
    path = scipy.ndimage.gaussian_filter1d(fish, smoothing / 3, axis=0, mode="nearest")
    turn = scipy.ndimage.gaussian_filter1d(heading, smoothing, mode="nearest") + np.radians(28)
    back = np.stack([-np.cos(turn), -np.sin(turn), np.full(len(turn), 0.33)], -1)
    return CameraViews(path + 2.5 * room.length * back, path - (0, 0, 0.33 * room.length))


def _view_from_edge(room: TankRoom, fish: Floats, rate_hz: float) -> CameraViews:
    """Return views from the side of the film's lower edge, which move along with the fish.

    fish (ticks, 3): its place, px; rate_hz: ticks per second.
    """
    smoothing = _SMOOTHING_S * rate_hz
    path = scipy.ndimage.gaussian_filter1d(fish, smoothing, axis=0, mode="nearest")
    place = path + np.array([0.7, -5.2, 0.0]) * room.length  # chosen for the looks
    place[:, 2] = 0.7 * room.depth
    return CameraViews(place, path - (0, 0, 0.1 * room.depth))


def _view_touring(room: TankRoom, fish: Floats, heading: Floats, rate_hz: float) -> CameraViews:
    """Return views that pass smoothly from one of `_SCENES` to the next, again and again.

    fish (ticks, 3), heading (ticks,): the fish's place and direction, px and rad; rate_hz: ticks/s.
    """
    time_s = np.arange(len(fish)) / rate_hz
    scenes = [camera_views(name, room, fish, heading, rate_hz) for name, _ in _SCENES]
    ends_s = np.cumsum([seconds for _, seconds in _SCENES])
    round_s = time_s % ends_s[-1]  # since the tour last began
    number = np.searchsorted(ends_s, round_s, side="right")
    scene_s = round_s - np.r_[0.0, ends_s][number]  # since the scene began
    share = np.clip(scene_s / _BLEND_S, 0, 1)
    # The very first scene has none before it; all others are blended in smoothly.
    share = np.where(time_s < ends_s[0], 1.0, share * share * (3 - 2 * share))[:, None]

    def mix_scenes(points: list[Floats]) -> Floats:
        """Blend the points (ticks, 3) of every scene, a scene with the one before it."""
        stack, ticks = np.stack(points), np.arange(len(fish))
        present, before = stack[number, ticks], stack[number - 1, ticks]
        return before + share * (present - before)

    places, aims = [scene.place for scene in scenes], [scene.aim for scene in scenes]
    return CameraViews(mix_scenes(places), mix_scenes(aims))
