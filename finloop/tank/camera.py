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
_LAZY_S = 0.8  # the camera that follows smooths the way of the fish by this much
_SCENES = ((ORBIT, 4.0), (FOLLOW, 4.0), (SIDE, 4.0))
_BLEND_S = 2.0


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
        """Middle of the water, (3,) px: x right, y up (below 0), z above the floor."""
        return np.array([(self.width - 1) / 2, -(self.height - 1) / 2, self.depth / 2])


def camera_views(
    camera: str, room: TankRoom, head: Floats, heading: Floats, rate_hz: float
) -> CameraViews:
    """Return the place and the aim of a camera, one of CAMERAS, at every tick.

    head (ticks, 3): px; heading (ticks,): rad, without jumps of 2π; rate_hz: ticks per second.
    """
    ticks = len(head)
    if camera == TOP:
        half = max(room.height, room.width / room.aspect) / 2 * 1.04
        aim = np.tile(room.middle * (1, 1, 0), (ticks, 1))
        return CameraViews(aim + np.array([0, 0, 4 * room.width]), aim, half)
    if camera == SIDE:
        return _view_from_edge(room, head, rate_hz)
    if camera == CORNER:
        return _view_from_outside(room, np.full(ticks, -58.0), 24.0)
    if camera == ORBIT:
        azimuth = -70 + 360 / _TURN_S / rate_hz * np.arange(ticks, dtype=float)
        return _view_from_outside(room, azimuth, 22.0)
    if camera == FOLLOW:
        return _view_following_fish(room, head, heading, rate_hz)
    return _view_touring(room, head, heading, rate_hz)


def _view_from_outside(room: TankRoom, azimuth_deg: Floats, elevation_deg: float) -> CameraViews:
    """Return a view from outside, as near as possible with the whole tank in the picture.

    azimuth_deg (ticks,), elevation_deg: direction from the tank to the camera.
    """
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    east, north, zero = np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))
    level, up = np.cos(elevation), zero + np.sin(elevation)
    ahead = -np.stack([east * level, north * level, up], -1)
    right = np.stack([-north, east, zero], -1)
    tall = np.tan(np.radians(VIEW_DEG / 2)) * _FILLS
    sides = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5]), -1).reshape(-1, 3)
    corners = sides * (room.width, room.height, room.depth)
    up = np.cross(right, ahead)
    across, high, deep = (part @ corners.T for part in (right, up, ahead))
    lift = np.zeros((len(azimuth), 1))
    for _ in range(4):  # as much room above the tank as below, then as near as that allows
        wide = np.maximum(np.abs(across) / room.aspect, np.abs(high - lift)) / tall
        far = (wide - deep).max(1, keepdims=True)
        slope = (high - lift) / (far + deep)
        lift = lift + far * (slope.max(1, keepdims=True) + slope.min(1, keepdims=True)) / 2
    aim = room.middle + lift * up
    return CameraViews(aim - far * ahead, aim)


def _view_following_fish(
    room: TankRoom, head: Floats, heading: Floats, rate_hz: float
) -> CameraViews:
    """Return a view from behind, above and beside a fish, smoother than its path.

    Arguments as in `camera_views`.
    """
    lazy = _LAZY_S * rate_hz
    way = scipy.ndimage.gaussian_filter1d(head, lazy / 3, axis=0, mode="nearest")
    turn = scipy.ndimage.gaussian_filter1d(heading, lazy, mode="nearest") + np.radians(28)
    back = np.stack([-np.cos(turn), -np.sin(turn), np.full(len(turn), 0.33)], -1)
    return CameraViews(way + 2.5 * room.length * back, way - (0, 0, 0.33 * room.length))


def _view_from_edge(room: TankRoom, head: Floats, rate_hz: float) -> CameraViews:
    """Return a view from the film's lower edge, which moves along with the fish.

    Arguments as in `camera_views`.
    """
    way = scipy.ndimage.gaussian_filter1d(head, _LAZY_S * rate_hz, axis=0, mode="nearest")
    away = np.array([0.7, -5.2, 0.0]) * room.length
    place = way + away
    place[:, 2] = 0.7 * room.depth
    return CameraViews(place, way - (0, 0, 0.1 * room.depth))


def _view_touring(room: TankRoom, head: Floats, heading: Floats, rate_hz: float) -> CameraViews:
    """Return a view that passes smoothly from one of `_SCENES` to the next, again and again.

    Arguments as in `camera_views`.
    """
    time = np.arange(len(head)) / rate_hz
    scenes = [camera_views(name, room, head, heading, rate_hz) for name, _ in _SCENES]
    ends = np.cumsum([length for _, length in _SCENES])
    moment = time % ends[-1]
    number = np.searchsorted(ends, moment, side="right")
    into = moment - np.r_[0.0, ends][number]
    share = np.clip(into / _BLEND_S, 0, 1)
    share = np.where(time < ends[0], 1.0, share * share * (3 - 2 * share))[:, None]

    def mix_scenes(each: list[Floats]) -> Floats:
        stack, ticks = np.stack(each), np.arange(len(head))
        here, before = stack[number, ticks], stack[number - 1, ticks]
        return before + share * (here - before)

    return CameraViews(mix_scenes([s.place for s in scenes]), mix_scenes([s.aim for s in scenes]))
