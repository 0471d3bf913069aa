"""Drawings: contours by id, y down as on a screen and in SVG; and morphs, drawings in motion."""

from dataclasses import dataclass, field, replace

import numpy as np

from finloop.base.arrays import Ints, Mask, Points
from finloop.base.errors import FinloopError
from finloop.base.style import Paint

LARGEST = 1e100
"""Largest coordinate; the squares of larger ones overflow in areas and energies."""


@dataclass(frozen=True)
class Curve:
    """A curve through points (n, 2), x right and y down.

    A closed curve returns from its last point to its first, which is not repeated at the end.
    """

    points: Points
    closed: bool


@dataclass(frozen=True)
class Drawing:
    """A drawing: its contours by id in drawing order, the lowest layer first."""

    curves: dict[str, Curve]
    width: float  # of the picture, in the units of the points
    height: float
    styles: dict[str, Paint] = field(default_factory=dict)  # by id; some may lack one
    # by id: the ids of the groups around a contour, from the nearest to the outermost
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    # by id of a shape: points (k, 2) that go to those of the same shape in another drawing
    pins: dict[str, Points] = field(default_factory=dict)
    # by id: ends (k, 2, 2) of the edges where a shape was cut into pieces, which no line shows
    cuts: dict[str, Points] = field(default_factory=dict)
    # ids of the shapes that are pieces of one shape, in this drawing or the one that it becomes
    families: tuple[tuple[str, ...], ...] = ()
    # ids of shapes whose fill-rule paints areas that the even-odd rule, which is used, leaves out
    unpainted: tuple[str, ...] = ()


def clean_curve(curve: Curve, name: str) -> Curve:
    """Return a curve without points that repeat the previous one.

    name: of the curve, for messages. FinloopError if `points` is no array (n, 2), if a coordinate
    is NaN or beyond ±LARGEST, or if fewer than 3 points of a closed curve (2 of an open one) are
    left.
    """
    points = np.asarray(curve.points, np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise FinloopError(
            f"the points of the curve {name} have shape {points.shape}",
            "an array (n, 2) of x and y",
            f"give {name} as n points in the plane",
        )
    bad = np.flatnonzero(~(np.abs(points) <= LARGEST).all(axis=1))
    if len(bad):
        x, y = points[bad[0]]
        raise FinloopError(
            f"point {bad[0]} of the curve {name} is ({x:g}, {y:g}); {len(bad)} such points",
            f"coordinates that are numbers of size {LARGEST:g} at most",
            f"correct these points of {name} or leave them out",
        )
    count = len(points)
    if count:
        differs = (np.diff(points, axis=0) != 0).any(axis=1)
        points = points[np.r_[True, differs]]
        if curve.closed and len(points) > 1 and (points[0] == points[-1]).all():
            points = points[:-1]
    kind, least = ("closed", 3) if curve.closed else ("open", 2)
    if len(points) < least:
        raise FinloopError(
            f"the {kind} curve {name} has {len(points)} different points of {count}"
            + (": its length is 0" if len(points) < 2 else ""),
            f"at least {least} different points of a {kind} curve",
            f"draw {name} again or leave it out",
        )
    return Curve(points, curve.closed)


@dataclass(frozen=True)
class Morph:
    """A drawing that changes into another: its contours, n points each, in f frames."""

    tau: Points  # (f,), 0 = the first drawing, 1 = the second
    # (f, n, 2) by id, in drawing order; in units of the first drawing, rounded to `decimals`
    layers: dict[str, Points]
    closed: dict[str, bool]  # by id
    # (f,) by id: pairs of edges that cross; the first contour of a shape has the crossings of its
    # contours, too
    folds: dict[str, Ints]
    # by id: whether it is proved that no contour of the shape crosses itself or another one between
    # the frames either, where points move straight from each frame to the next
    continuous: dict[str, bool]
    styles: dict[str, tuple[Paint, ...]]  # by id, f paints; some may lack them
    width: float  # of the picture
    height: float
    decimals: int  # digits after the point that coordinates have
    # (f,) by id: whether this piece of a cut shape and another one of that shape cover each other;
    # those that never do are left out
    covers: dict[str, Mask] = field(default_factory=dict)

    @property
    def end_frame(self) -> int:
        """Return the index of the frame after the last: 0 for a morph there and back, else −1.

        −1 stands for the last frame itself, which stays.
        """
        return 0 if self.tau[-1] < self.tau.max() else -1

    def take_frames(self, frames: Ints) -> "Morph":
        """Return a morph of only the given frames (g,), numbers from 0, in the given order."""
        return replace(
            self,
            tau=self.tau[frames],
            layers={name: stack[frames] for name, stack in self.layers.items()},
            folds={name: count[frames] for name, count in self.folds.items()},
            covers={name: is_covered[frames] for name, is_covered in self.covers.items()},
            styles={
                name: tuple(paints[frame] for frame in frames)
                for name, paints in self.styles.items()
            },
        )

    def paints_at(self, frame: int) -> dict[str, Paint]:
        """Return how each contour is painted in a frame, by id; some may lack a paint."""
        return {name: paints[frame] for name, paints in self.styles.items()}

    def count_fold_frames(self) -> dict[str, int]:
        """Return in how many frames a contour crosses itself, by contour id; zeros are left out."""
        return {name: int((count > 0).sum()) for name, count in self.folds.items() if any(count)}

    def count_cover_frames(self) -> dict[str, int]:
        """Return in how many frames a piece of a cut shape and another cover each other, by id."""
        return {name: int(is_covered.sum()) for name, is_covered in self.covers.items()}
