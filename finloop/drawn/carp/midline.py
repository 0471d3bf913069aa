"""Compute the midline of the drawn carp in a pose, and measures of a midline.

Lengths are in body lengths, angles in radians, anticlockwise as seen on screen. The screen's y
points down, so a unit vector at angle a is ``(cos a, -sin a)``; ``+`` is left.

The body is an inextensible midline whose curvature is

    travelling wave (grows towards the tail) + C-bend (strongest in mid-body) + small noise

with the front third nearly stiff, as in the fish paper §2.2 ("head ... cannot deform").
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from finloop.base.arrays import Floats
from finloop.drawn.carp.skin import half_width
from finloop.drawn.truth import POINTS

SEGMENTS = POINTS - 1
WAVELENGTH = 1.05  # of the tail beat: one wave on the body


_S = np.arange(1, SEGMENTS) / SEGMENTS  # arc length at the 63 inner points, head to tail
# A C-bend is spread over the inner points, sum 1, strongest in mid-body.
_BEND = np.sin(np.pi * np.clip((_S - 0.16) / 0.80, 0, 1) ** 0.95) ** 2
_BEND /= _BEND.sum()
# The largest bend by the tail beat at each inner point, radians, for amplitude 1, cruising.
_WAVE = 0.18 + 3.1 * np.clip((_S - 0.2) / 0.8, 0, None) ** 1.35
_WAVE *= np.clip(_S / 0.3, 0, 1) ** 2 / SEGMENTS


@cache
def _mass_shares() -> tuple[Floats, Floats]:
    """Return the shares of the body's mass at its 65 points and in its 64 segments."""
    width = half_width(np.linspace(0, 1, POINTS))
    points = width / width.sum()
    segments = points[1:] + points[:-1]
    return points, segments / segments.sum()


def midline_of_pose(
    x: float,
    y: float,
    axis: float,
    beat: float,
    amplitude: float,
    bend: float,
    ripple: Sequence[float] | Floats = (0.0, 0.0),
) -> Floats:
    """Return the midline of a carp in a pose, (65, 2) body lengths, head to tail.

    x, y: mass centre, body lengths, y down; axis: mean direction towards the head, radians
    anticlockwise; beat: phase of the tail beat, cycles; amplitude: of the beat, 1 = cruising; bend:
    the C-bend, direction at the head minus at the tail, radians, + left; ripple: the largest
    curvature of two small random bends, radians per body length.
    Tangents are integrated from curvature, so the line cannot stretch. Then it is moved and turned,
    so the head recoils against the tail as in a fish.
    """
    points, segments = _mass_shares()
    # The change of direction at each inner point: travelling wave, C-bend and ripples.
    ripples = ripple[0] * np.sin(np.pi * _S) + ripple[1] * np.sin(2 * np.pi * _S)
    curvature = (
        amplitude * _WAVE * np.sin(2 * np.pi * (_S / WAVELENGTH - beat))
        + bend * _BEND
        + ripples / SEGMENTS
    )
    angle = np.zeros(SEGMENTS)  # of each segment, pointing to the head
    np.cumsum(curvature, out=angle[1:])
    np.negative(angle, out=angle)  # a left bend turns the head left of what follows
    angle += axis - segments @ angle  # their mean, by mass, is the axis
    line = np.zeros((POINTS, 2))
    np.cumsum(-np.cos(angle) / SEGMENTS, out=line[1:, 0])  # towards the tail, y down
    np.cumsum(np.sin(angle) / SEGMENTS, out=line[1:, 1])
    return line - points @ line + (x, y)  # the mean of its points, by mass, is x, y


def midline_bend(line: Floats) -> float:
    """Return how bent a midline is: signed area between it and its chord, over squared length.

    line (k, 2): head to tail, any unit, y down. The area is positive for a bend to the left.
    """
    x, y = line[:, 0], line[:, 1]
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return area / float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) ** 2


def midline_heading(line: Floats) -> float:
    """Return the heading of a midline: the direction of its front third, degrees (-180, 180].

    line (k, 2): the midline, head to tail, y down. 0 is to the right, + anticlockwise on screen.
    """
    place = (len(line) - 1) / 3
    i = int(place)
    third = line[i] + (place - i) * (line[i + 1] - line[i])
    dx, dy = line[0] - third
    # The signs put the end of the range at +180.
    return -float((-np.degrees(np.arctan2(-dy, dx)) + 180) % 360 - 180)


def midline_curvature(line: Floats) -> float:
    """Return by how many degrees a midline turns from its tail to its head, + to the left.

    line (k, 2): head to tail, y down.
    """
    step = line[:-1] - line[1:]
    angle = np.unwrap(np.arctan2(-step[:, 1], step[:, 0]))
    return float(np.degrees(angle[0] - angle[-1]))
