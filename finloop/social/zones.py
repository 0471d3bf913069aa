"""Zones of repulsion, alignment and attraction (Couzin et al. 2002).

Around a fish are three zones, one round the other. It turns away from whoever is in the zone of
repulsion. Nobody there, it turns as those in the zone of alignment head, and towards those in the
zone of attraction. Nobody is seen in the blind angle behind it, but whoever is in the zone of
repulsion is felt on all sides, as in the paper.

The paper adds up the neighbours of a zone and takes the direction of the sum. Here each zone pulls
with the mean of its neighbours' unit vectors, times a weight: one neighbour pulls as strongly as
many that agree, neighbours that disagree pull less. The fish's own direction has weight 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from finloop.base.arrays import Complex, Floats
from finloop.base.errors import FinloopError
from finloop.social.neighbours import Neighbours


@dataclass(frozen=True)
class Zones:
    """Outer radii of the zones in body lengths, the blind angle in degrees, weights.

    A zone lies outside the one before: an outer radius that is not larger than that before leaves
    no zone. FinloopError if a number is negative, or the blind angle is no angle.
    """

    repulsion: float
    alignment: float
    attraction: float
    blind_deg: float
    repulsion_weight: float
    alignment_weight: float
    attraction_weight: float

    def __post_init__(self) -> None:
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        wrong = [f"{name}={value}" for name, value in values.items() if not 0 <= value < np.inf]
        if wrong or self.blind_deg > 360:
            raise FinloopError(
                f"zones of {', '.join(wrong) or f'blind_deg={self.blind_deg}'}",
                "radii and weights of 0 or more, a blind angle of 0 to 360 degrees",
                "correct calibrate.repulsion_radius_bl, .alignment_radius_bl, "
                ".attraction_radius_bl, .blind_angle_deg, or ..._weight",
            )

    @property
    def radii(self) -> tuple[float, float, float]:
        """Outer radii."""
        return self.repulsion, self.alignment, self.attraction

    @property
    def widths(self) -> tuple[float, float, float]:
        """Of the zones; 0 of one that there is not."""
        inner, middle, outer = self.radii
        middle = max(inner, middle)
        return inner, middle - inner, max(middle, outer) - middle

    @property
    def weights(self) -> tuple[float, float, float]:
        """Weights, of the same zones."""
        return self.repulsion_weight, self.alignment_weight, self.attraction_weight


COUZIN = Zones(1.0, 6.0, 14.0, 90.0, 1.0, 1.0, 1.0)
"""Of the ranges that the paper looks at (Table 1: radius of repulsion 1, widths of the others 0-15
body lengths, blind angle 0-160°, all weights equal), about the middle. Where a film has no company
to learn from, these are the zones."""


NO_ZONES = Zones(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Of a fish that pays no attention to others."""


def zone_means(seen: Neighbours, radii: tuple[float, float, float], blind_deg: float) -> Complex:
    """The pull (…, 3) of each zone without its weight, in the frame of the body, |pull| ≤ 1.

    That of alignment and attraction is 0 while anyone is in the zone of repulsion.
    """
    inner, middle, outer = radii
    sees = seen.bearing.real >= -np.cos(np.radians(blind_deg) / 2)
    near = seen.distance < inner
    aligned = sees & ~near & (seen.distance < middle)
    drawn = sees & ~near & ~aligned & (seen.distance < outer)
    free = ~near.any(axis=-1)
    return np.stack(
        [
            -_mean(seen.bearing, near),
            free * _mean(seen.heading, aligned),
            free * _mean(seen.bearing, drawn),
        ],
        axis=-1,
    )


def _mean(vectors: Complex, which: Any) -> Complex:
    """The mean (…) of those of some vectors (…, n) that are chosen; 0 of none."""
    return np.where(which, vectors, 0).sum(axis=-1) / np.maximum(which.sum(axis=-1), 1)


def pull(seen: Neighbours, zones: Zones) -> Complex:
    """What the company wishes of a fish (…), in the frame of its body: 0 = nothing."""
    return weighted_sum(zone_means(seen, zones.radii, zones.blind_deg), zones.weights)


def weighted_sum(means: Complex, weights: Sequence[float] | Floats) -> Complex:
    """The sum (…) of the pulls (…, 3) of the zones, each times its weight.

    Unlike `@` it rounds the same on every processor and for any number of rows.
    """
    return np.asarray((means * np.asarray(weights, float)).sum(axis=-1))
