"""Where a video loop travels, against the heading of its fish (fish paper Fig. 13)."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Mask
from finloop.distance.picture import typical_length
from finloop.features.current import through_water
from finloop.features.table import delta_of, wrap_deg

TRAVEL = 0.05  # body lengths from which a fish has a direction of travel
RESULTANT = 0.3  # length of the mean heading vector; with less, the fish turned round

Rows = NDArray[np.integer]


def improper(a: Rows, b: Rows, features: pd.DataFrame, most_deg: float) -> Mask:
    """Return whether each loop (n,) is improper: it travels against the heading (Fig. 13).

    Travel and heading differ by more than `most_deg` over the loop, at its end a or at its end b,
    see `travel_of`: there head and tail may be swapped, or the fish adrift.
    """
    return np.asarray((travel_of(a, b, features).off_deg > most_deg).any(axis=-1))


class Travel(NamedTuple):
    """Directions of travel and headings of n loops, each between its ends, at end a and at end b.

    travel_deg, heading_deg (n, 3): anticlockwise as seen; travel is NaN where there is none.
    """

    travel_deg: Floats
    heading_deg: Floats

    @property
    def off_deg(self) -> Floats:
        """Return the angle (n, 3) [°] between travel and heading, 0 … 180; NaN without travel."""
        return np.abs(wrap_deg(self.travel_deg - self.heading_deg))


def travel_of(a: Rows, b: Rows, features: pd.DataFrame) -> Travel:
    """Return the directions of travel and the headings of n loops (Fig. 13).

    a, b (n,): the loops' ends, feature rows. Between its ends, a loop within one track travels from
    a to b, whatever route the fish takes; its heading is the mean over it (travel is NaN where the
    fish turns round). At either end the fish travels from Δ/2 before to Δ/2 after it. A fish that
    moved less than `TRAVEL` body lengths has no direction of travel.
    """
    track = features["track_id"].to_numpy()
    x, y = through_water(features).T * ((1,), (-1,))
    length = typical_length(features).to_numpy(float)
    unit = np.exp(1j * np.radians(features["heading_deg"].to_numpy(float)))

    def travel(low: Rows, high: Rows, known: Mask) -> Floats:
        way = (x[high] - x[low]) + 1j * (y[high] - y[low])
        known = known & (np.abs(way) >= TRAVEL * length[low])
        return np.where(known, np.degrees(np.angle(way)), np.nan)

    total = np.r_[0, np.cumsum(unit)]
    mean = (total[b + 1] - total[a]) / (b + 1 - a)
    travels = [travel(a, b, (track[a] == track[b]) & (np.abs(mean) >= RESULTANT))]
    delta = delta_of(features)
    first = np.searchsorted(track, track)  # tracks lie one after another, their numbers rise
    last = np.searchsorted(track, track, side="right") - 1
    for end in (a, b):
        low = np.maximum(end - delta // 2, first[end])
        high = np.minimum(low + delta, last[end])
        travels.append(travel(low, high, np.ones(len(end), bool)))
    headings = [np.degrees(np.angle(one)) for one in (mean, unit[a], unit[b])]
    return Travel(np.stack(travels, axis=-1), np.stack(headings, axis=-1))
