"""Find the few principal shapes of a film's postures, and which postures it shows (PCA).

As with the worm in Stephens et al. 2008 ("eigenworms"), a posture is the mean plus a few codes
times the shapes. Every posture counts together with its mirror image, so left and right are equal.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from finloop.base.arrays import Floats, Mask
from finloop.base.errors import FinloopError
from finloop.base.stretches import spread_rows
from finloop.puppet.pose import backbone_directions, backbone_steps, mirror_posture

_SAMPLE = 50_000  # postures whose nearest neighbours are searched; that suffices for a quantile
_EXACT = 1e-5  # accuracy of codes, which files hold as float32
_ROUNDING = 1e-6  # relative difference of a shape's components that counts as equal


class NearestCodes(NamedTuple):
    """Pose codes (…, c) moved close to the film's, and a mask (…) of those that were moved."""

    codes: Floats
    clamped: Mask


@dataclass(frozen=True)
class PoseShapes:
    """The principal shapes of a film's postures (…, d), and the postures' codes.

    mean: (d,) posture. shapes: (c, d) orthonormal, of weighted postures, the most important one
    first. weights: (d,), so that bends count by their mean square along the body, steps by their
    sum. variance: (c,) of the codes; total_variance: of the postures. codes: (2 k, c) of the
    postures and their mirror images. gap: how far from one of these a posture may be.
    """

    mean: Floats
    shapes: Floats
    weights: Floats
    variance: Floats
    total_variance: float
    codes: Floats = field(repr=False)
    gap: float

    @classmethod
    def fit(cls, postures: Floats, share: float, gap_quantile: float = 0.99) -> "PoseShapes":
        """Return the principal shapes that explain a share (0 … 1) of postures' variance.

        postures (k, d): of a film; their mirror images are added, so `codes` has 2 k rows.
        gap_quantile: quantile of the distance from a posture to its nearest other one. It becomes
        the gap, from which on a posture counts as unlike all filmed ones. FinloopError if there are
        fewer than two postures, or one is not finite.
        """
        broken = int((~np.isfinite(postures)).any(1).sum())
        if len(postures) < 2 or broken:
            raise FinloopError(
                f"{len(postures)} postures, {broken} of them not finite",
                "two or more postures of a film",
                "use the postures from `finloop.puppet.poses_from_features`",
            )
        with_mirrored = np.concatenate([postures, mirror_posture(postures)])
        weights = _posture_weights(with_mirrored.shape[1])
        mean = with_mirrored.mean(0)
        weighted = with_mirrored  # in place: in a film of hours these are the largest arrays
        weighted -= mean
        weighted *= weights
        variance, shapes = np.linalg.eigh(weighted.T @ weighted / len(with_mirrored))
        # The largest variance first; rounding can make the smallest negative.
        variance, shapes = np.maximum(variance[::-1], 0), _fix_signs(shapes.T[::-1])
        total_variance = float(variance.sum())
        wanted = min(share, 1 - 1e-12) * total_variance
        shape_count = int(np.searchsorted(variance.cumsum(), wanted)) + 1
        codes = weighted @ shapes[:shape_count].T
        sample = codes[spread_rows(np.arange(len(codes)), _SAMPLE)]
        # The nearest of all is the posture itself.
        nearest = scipy.spatial.cKDTree(codes).query(sample, k=2)[0][:, 1]
        gap = float(np.quantile(nearest, gap_quantile))
        return cls(
            mean, shapes[:shape_count], weights, variance[:shape_count], total_variance, codes, gap
        )

    @property
    def variance_shares(self) -> Floats:
        """Return the share (c,), 0-1, of the postures' variance that each shape explains."""
        return self.variance / (self.total_variance or 1.0)

    @cached_property
    def mirror_matrix(self) -> Floats:
        """Return the matrix (c, c) that mirrors pose codes (…, c): codes @ matrix."""
        signs = mirror_posture(np.ones_like(self.mean))
        return (self.shapes * signs) @ self.shapes.T

    def encode(self, postures: Floats) -> Floats:
        """Return the pose codes (…, c), scores of the principal shapes, of postures (…, d)."""
        deviations = postures - self.mean
        deviations *= self.weights  # in place: a film of hours has a million postures
        return deviations @ self.shapes.T

    def decode(self, codes: Floats) -> Floats:
        """Return the postures (…, d) of pose codes (…, c), the scores of principal shapes."""
        postures = codes @ self.shapes
        postures /= self.weights
        postures += self.mean
        return postures

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        """Return the search tree of the film's pose codes."""
        return scipy.spatial.cKDTree(self.codes)

    def is_far_from_film(self, codes: Floats) -> Mask:
        """Return a mask (…) of pose codes (…, c) that are unlike all filmed ones."""
        return np.asarray(self._tree.query(codes)[0] > (1 - _EXACT) * self.gap - _EXACT)

    def nearest_codes(self, codes: Floats) -> NearestCodes:
        """Return pose codes (…, c) moved close enough to filmed ones, and which were moved.

        Codes that are nearer already stay. Mirror images count as filmed.
        """
        moved, limit = np.array(codes, float), self.gap + _EXACT
        clamped = np.asarray(np.isinf(self._tree.query(moved, distance_upper_bound=limit)[0]))
        if clamped.any():
            far = moved[clamped]
            distance, row = self._tree.query(far)
            from_film = (far - self.codes[row]) * (self.gap / distance)[:, None]
            moved[clamped] = self.codes[row] + from_film
        return NearestCodes(moved, clamped)


def _posture_weights(numbers: int) -> Floats:
    """Return the weights (numbers,) with which a posture's numbers count in the PCA.

    A bend counts by its mean square along the body. A step is about 1 / n of the body's length, and
    counts by the mean square of its share of that.
    """
    weights = np.ones(numbers)
    steps = backbone_directions(weights).size
    backbone_directions(weights)[:] = steps**-0.5  # both are views into the weights
    backbone_steps(weights)[:] = steps**0.5
    return weights


def _fix_signs(shapes: Floats) -> Floats:
    """Return shapes (c, d), each flipped so that its component of greatest size is positive."""
    size = np.abs(shapes)
    # Of sizes that are equal but for rounding, the first counts.
    greatest = (size > (1 - _ROUNDING) * size.max(axis=1, keepdims=True)).argmax(axis=1)
    return shapes * np.sign(np.take_along_axis(shapes, greatest[:, None], axis=1))
