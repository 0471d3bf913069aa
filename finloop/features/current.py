"""Detect a current past an animal that stays on the spot, and how fast it swims.

In a swim tunnel, or in a stream, a fish beats its tail and stays in the same place of the picture.
It is swimming: in the animation, it should move as it would in still water.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Reals
from finloop.features.memory import measure_memory_frames

# Measured: sunfish 0.02, trout 0.03, a drawn shark in a current 0.31; a carp that swims through the
# picture for 1.4 s only 0.79, a carp in a small tub 1.3.
_STAYS = 0.5  # body lengths within which an animal stays in its place
# Measured: trout, sunfish 1.00, the shark 0.99, the carp 0.34.
_STEADY = 0.9  # length of the mean of all headings as unit vectors
_LEAST_BEAT = 0.05  # body lengths from side to side; less may be noise
_STROUHAL = 0.3  # of cruising fish: tail beats/s × their width / speed (Taylor et al. 2003)
_MOST_STRIDE = 0.7  # body lengths in a tail beat (Bainbridge 1958)
_MEMORIES = 6.0  # memories in a beat: a sine is forgotten after a sixth of its period


def measure_current(
    places: Reals, heading_deg: Reals, tail: Reals, bend: Reals, tracks: Sequence[slice],
    rate_hz: float,
) -> float:  # fmt: skip
    """Return the speed [body lengths/s] at which animals swim against a current; 0 without one.

    This is their speed through the water, from how fast and how far the tail beats: fish cruise at
    a Strouhal number of 0.3. They swim on the spot if they stay within half a body length,
    keep their heading, and beat their tails. places (n, 2): of the mass centre, body lengths; tail
    (n,): offset of the tail's tip from the head's axis, body lengths; bend (n,): signed motion
    area; tracks: the rows of each track; rate_hz: frames per second.
    """
    if max(float(np.hypot(*np.ptp(places[rows], axis=0))) for rows in tracks) >= _STAYS:
        return 0.0
    if abs(np.exp(1j * np.radians(heading_deg)).mean()) < _STEADY:
        return 0.0
    beat_width = 2 * np.sqrt(2) * float(np.std(tail))  # of a sine, from side to side
    if beat_width < _LEAST_BEAT:
        return 0.0
    track = np.repeat(np.arange(len(tracks)), [rows.stop - rows.start for rows in tracks])
    memory_frames = measure_memory_frames(np.asarray(bend)[:, None], track)
    beats_per_s = rate_hz / (_MEMORIES * memory_frames)
    # Strouhal's number is beats per second times their width over the speed.
    return beats_per_s * min(beat_width / _STROUHAL, _MOST_STRIDE)


def places_through_water(features: pd.DataFrame) -> Floats:
    """Return positions (n, 2) [px] of all rows as if the fish swam in still water.

    With a current (column `current`, body lengths/s), a fish that stays in place is moved ahead by
    the distance that it swims through the water; then only differences within a track have a
    meaning. Without one, the places are those of the table.
    """
    place = features[["x_px", "y_px"]].to_numpy(float)
    current = features["current"].to_numpy(float)
    if not current.any():
        return place
    length = features.groupby("track_id")["body_length_px"].transform("median").to_numpy(float)
    heading = np.radians(features["heading_deg"].to_numpy(float))
    time_s = features["time_s"].to_numpy(float)
    distance = current * length * np.diff(time_s, append=time_s[-1:])  # until the next row
    steps = distance[:, None] * np.column_stack([np.cos(heading), -np.sin(heading)])
    sum_of_earlier_steps = np.cumsum(steps, axis=0) - steps
    return np.asarray(place + sum_of_earlier_steps)
