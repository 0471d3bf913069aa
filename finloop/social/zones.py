"""Zones of repulsion, alignment and attraction (Couzin et al. 2002).

Three zones lie around a fish, one around the other. The fish turns away from fish in the zone of
repulsion. If that is empty, it aligns with fish in the zone of alignment and turns towards fish in
the zone of attraction. It sees nothing in the blind angle behind it, but it senses the zone of
repulsion on all sides, as in the paper.

The paper adds up the neighbours of a zone and takes the direction of the sum. Here each zone pulls
with the mean of its neighbours' unit vectors, times a weight: one neighbour pulls as strongly as
many that agree, and neighbours that disagree pull less. The fish's own direction has weight 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from finloop.base.arrays import Complex, Floats, Mask
from finloop.base.errors import FinloopError
from finloop.social.neighbours import Neighbours


@dataclass(frozen=True)
class Zones:
    """Three zones around a fish: outer radii in body lengths, blind angle in degrees, and weights.

    A zone lies outside the one before it. A radius that is not larger than the one before leaves no
    zone. FinloopError if a number is negative or the blind angle is above 360°.
    """

    repulsion: float
    alignment: float
    attraction: float
    blind_deg: float
    repulsion_weight: float
    alignment_weight: float
    attraction_weight: float

    def __post_init__(self) -> None:
        """Raise FinloopError if a number is out of its range."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        wrong = [f"{name}={value}" for name, value in values.items() if not 0 <= value < np.inf]
        if wrong or self.blind_deg > 360:
            raise FinloopError(
                f"zones with {', '.join(wrong) or f'blind_deg={self.blind_deg}'}",
                "radii and weights of 0 or more, a blind angle of 0 to 360 degrees",
                "correct calibrate.repulsion_radius_bl, .alignment_radius_bl, "
                ".attraction_radius_bl, .blind_angle_deg, or ..._weight",
            )

    @property
    def radii(self) -> tuple[float, float, float]:
        """Return the outer radii of repulsion, alignment and attraction, in body lengths."""
        return self.repulsion, self.alignment, self.attraction

    @property
    def widths(self) -> tuple[float, float, float]:
        """Return the widths of repulsion, alignment and attraction [BL]; 0 for a missing zone."""
        inner, middle, outer = self.radii
        middle = max(inner, middle)
        return inner, middle - inner, max(middle, outer) - middle

    @property
    def weights(self) -> tuple[float, float, float]:
        """Return the weights of repulsion, alignment and attraction."""
        return self.repulsion_weight, self.alignment_weight, self.attraction_weight


COUZIN = Zones(1.0, 6.0, 14.0, 90.0, 1.0, 1.0, 1.0)
"""The zones of a film that shows too few fish together: about the middle of the paper's ranges
(Table 1: radius of repulsion 1, widths of the others 0-15 body lengths, blind angle 0-160°, all
weights equal)."""

NO_ZONES = Zones(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""The zones of a fish that ignores the others."""


def zone_pulls(seen: Neighbours, radii: tuple[float, float, float], blind_deg: float) -> Complex:
    """Return the unweighted pulls (…, 3) of other fish: repulsion, alignment, attraction.

    Each pull is the mean of the neighbours' unit vectors in a zone, complex, relative to the body.
    Alignment and attraction are 0 while a fish is in the zone of repulsion. seen: the others (…,
    n); radii: outer ones of the zones in body lengths, ascending; blind_deg: blind angle behind the
    fish, in which it is only repelled.
    """
    inner, middle, outer = radii
    # Bearing is a unit vector, 1 = ahead: a fish straight behind has the real part −1.
    sees = seen.bearing.real >= -np.cos(np.radians(blind_deg) / 2)
    near = seen.distance < inner
    aligning = sees & ~near & (seen.distance < middle)
    attracting = sees & ~near & ~aligning & (seen.distance < outer)
    is_unrepelled = ~near.any(axis=-1)
    pulls = [
        -_masked_mean(seen.bearing, near),
        is_unrepelled * _masked_mean(seen.heading, aligning),
        is_unrepelled * _masked_mean(seen.bearing, attracting),
    ]
    return np.stack(pulls, axis=-1)


def _masked_mean(vectors: Complex, mask: Mask) -> Complex:
    """Return the mean (…) of vectors (…, n) that a mask (…, n) selects; 0 if it selects none."""
    return np.where(mask, vectors, 0).sum(axis=-1) / np.maximum(mask.sum(axis=-1), 1)


def pull_of_others(seen: Neighbours, zones: Zones) -> Complex:
    """Return the weighted pull (…) of other fish on a fish, complex, relative to its body.

    seen: where the others are (…, n). A pull of 1 counts as much as the fish's own direction.
    """
    return weigh_zone_pulls(zone_pulls(seen, zones.radii, zones.blind_deg), zones.weights)


def weigh_zone_pulls(means: Complex, weights: Sequence[float] | Floats) -> Complex:
    """Return the weighted sum (…) of the pulls (…, 3) of the three zones.

    Unlike `means @ weights`, this sum rounds alike on every processor and for any number of rows.
    """
    return np.asarray((means * np.asarray(weights, float)).sum(axis=-1))
