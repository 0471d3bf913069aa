"""What each fish of a tank sees of the others, in the frame of its own body.

Vectors are complex numbers. In the tank, real points right and imaginary points up. In the body's
frame, real points ahead and imaginary points left. Lengths are body lengths.
"""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Complex, Floats, Reals


class Neighbours(NamedTuple):
    """Where each fish (…) sees n other fish, from its own body; arrays (…, n).

    distance: body lengths, inf for an absent fish; bearing: unit vectors to the others; heading:
    unit vectors of the others' headings. Both are complex, 1 = ahead, i = left, 0 for an absent
    fish.
    """

    distance: Floats
    bearing: Complex
    heading: Complex


def complex_vectors(places: Reals, headings_deg: Reals, length: float) -> tuple[Complex, Complex]:
    """Return places as complex numbers in BL (y up), and headings as complex unit vectors.

    places (…, m, 2): px, y down; headings_deg (…, m): anticlockwise; length: a body length in px.
    Both results are (…, m).
    """
    places = np.asarray(places, float) / length
    return places[..., 0] - 1j * places[..., 1], np.exp(1j * np.radians(headings_deg))


def all_neighbours(place: Complex, heading: Complex) -> Neighbours:
    """Return how each of m fish sees each of the others, as `Neighbours` (…, m, m).

    place, heading (…, m): complex, body lengths and unit vectors, NaN for absent fish. A fish
    counts as absent for itself.
    """
    itself = np.eye(place.shape[-1], dtype=bool)
    others = np.where(itself, np.nan, place[..., None, :])
    return relative_neighbours(
        place[..., :, None], heading[..., :, None], others, heading[..., None, :]
    )


def relative_neighbours(
    place: Complex, heading: Complex, other_place: Complex, other_heading: Complex
) -> Neighbours:
    """Return distance (BL), bearing and heading (unit vectors) of others, seen from each fish.

    All but distances are complex. In the result real is ahead, imaginary is left; an absent fish
    has distance inf, bearing and heading 0j. Places are in body lengths, NaN of an absent fish, and
    headings unit vectors, both as this file's text says. All four arrays are broadcast against each
    other.
    """
    offset = (other_place - place) * heading.conj()  # real: ahead, imaginary: left
    distance = np.abs(offset)
    present = np.isfinite(distance)
    bearing = np.where(present, offset, 0j) / np.where(present & (distance > 0), distance, 1)
    return Neighbours(
        np.where(present, distance, np.inf),
        np.asarray(bearing, complex),
        np.where(present, other_heading * heading.conj(), 0j),
    )
