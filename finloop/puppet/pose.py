"""A pose: an animal's position, heading, size, and posture (how it is bent).

A posture is a vector, so postures can be added, averaged and faded. It has the head's place from
the mass centre, ahead and to the left, in sizes of the animal (its typical length); then the
directions of the backbone's n steps from head to tail, pointing towards the head, in radians
against the heading, + = turned to the animal's left; then the lengths of these steps, in sizes.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from finloop.base.arrays import Floats, Points, Reals
from finloop.base.axes import to_body_axes
from finloop.distance.picture import typical_lengths_px

_AHEAD, _LEFT, _STEPS = 0, 1, 2


@dataclass(frozen=True)
class Pose:
    """One pose or several: position, heading, size and posture (how the body is bent) of animals.

    All fields may be arrays with the leading axes (…). x_px, y_px: (…) mass centre, y down.
    heading_rad: (…) anticlockwise as seen, 0 = to the right. size_px: (…) typical length of the
    animal. posture: (…, 2 + 2 n), see the module's text.
    """

    x_px: Floats
    y_px: Floats
    heading_rad: Floats
    size_px: Floats
    posture: Floats

    def __len__(self) -> int:
        return len(self.posture)

    def __getitem__(self, rows: Any) -> "Pose":
        return Pose(
            self.x_px[rows], self.y_px[rows], self.heading_rad[rows], self.size_px[rows],
            self.posture[rows],
        )  # fmt: skip

    def move_to(
        self, x_px: ArrayLike, y_px: ArrayLike, heading_rad: ArrayLike, size_px: ArrayLike
    ) -> "Pose":
        """Return the same postures at other positions, headings and sizes.

        A single number applies to all poses.
        """
        place, shape = (x_px, y_px, heading_rad, size_px), self.posture.shape[:-1]
        x, y, heading, size = (np.broadcast_to(np.asarray(part, float), shape) for part in place)
        return Pose(x, y, heading, size, self.posture)

    def mirror(self) -> "Pose":
        """Return the poses mirrored about the animal's own axis: left and right exchanged."""
        return replace(self, posture=mirror_posture(self.posture))

    @property
    def head_px(self) -> Points:
        """Return the head's position (…, 2), the first end of the backbone: x, y in px."""
        ahead, left = self.posture[..., _AHEAD], self.posture[..., _LEFT]
        cos, sin = np.cos(self.heading_rad), np.sin(self.heading_rad)
        x = self.x_px + self.size_px * (cos * ahead - sin * left)
        y = self.y_px - self.size_px * (sin * ahead + cos * left)
        return np.stack([x, y], -1)

    @property
    def steps_px(self) -> Floats:
        """Return the lengths (…, n) of the backbone's steps, in px."""
        return backbone_steps(self.posture) * self.size_px[..., None]

    def backbone_px(self) -> Points:
        """Return the backbone's n + 1 points (…, n + 1, 2), from head to tail: x, y in px."""
        angles = backbone_directions(self.posture) + self.heading_rad[..., None]
        # The angles point to the head, the steps to the tail; y is down.
        steps = np.stack([-np.cos(angles), np.sin(angles)], -1) * self.steps_px[..., None]
        head = self.head_px[..., None, :]
        return np.concatenate([head, head + steps.cumsum(-2)], -2)


def backbone_directions(posture: Floats) -> Floats:
    """Return the direction (…, n) of each backbone step in postures, radians from the heading.

    They point towards the head and count from the heading, + = to the animal's left. The result is
    a view, so writing to it changes the postures.
    """
    return posture[..., _STEPS : _STEPS + posture.shape[-1] // 2 - 1]


def backbone_steps(posture: Floats) -> Floats:
    """Return the length (…, n) of each backbone step in postures, in typical body lengths."""
    return posture[..., posture.shape[-1] // 2 + 1 :]


def mirror_posture(posture: Floats) -> Floats:
    """Return postures (…, 2 + 2 n) with left and right exchanged, as a copy."""
    mirrored = posture.copy()
    mirrored[..., _LEFT] *= -1
    backbone_directions(mirrored)[...] *= -1  # a view
    return mirrored


def poses_from_features(features: pd.DataFrame, backbones: Reals) -> Pose:
    """Return the poses (k) of the fish in the k rows of a feature table, with their backbones.

    features: x_px, y_px, heading_deg and lengths of the k rows; backbones: (k, n + 1, 2) px, head
    first. For an animal with a thin tail they come from `puppet.tail.align_body_and_tail`.
    """
    lines = np.asarray(backbones, float)
    headward_steps = -np.diff(lines, axis=1)
    x, y = features["x_px"].to_numpy(float), features["y_px"].to_numpy(float)
    heading = np.radians(features["heading_deg"].to_numpy(float))
    size = typical_lengths_px(features).to_numpy(float)
    angles = np.arctan2(-headward_steps[..., 1], headward_steps[..., 0]) - heading[:, None]
    # The first angle is wrapped to ±π; the others follow it without jumps of 2π.
    angles[:, 0] = np.angle(np.exp(1j * angles[:, 0]))
    length = np.hypot(headward_steps[..., 0], headward_steps[..., 1]) / size[:, None]
    head = to_body_axes((lines[:, 0] - np.stack([x, y], -1)) / size[:, None], heading)
    posture = np.concatenate([head, np.unwrap(angles, axis=1), length], 1)
    return Pose(x, y, heading, size, posture)
