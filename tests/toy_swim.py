"""A drawn fish whose bend and speed follow an autoregressive law, and whose bend turns it.

Shared by the tests of the forecast and of the modes that use it.
"""

import numpy as np
import pandas as pd

from finloop.base.settings import settings
from finloop.features.table import wrap_deg

RATE, DELTA, NOISE = 25.0, 5, 0.3
MIRROR = np.diag([-1.0, 1.0])
HOW = settings("forecast", epochs=12, hidden_units=24, pose_variance_ratio=0.999)


def unseen(rows, to, mirrored):
    """To the eye all rows are alike."""
    return np.zeros(len(rows))


def plain(film):
    """How rows look that all look alike."""
    return np.zeros((len(film.states), 1))


def random_swimmer(count=3000, seed=0, tracks=1):
    """A fish (features, codes) whose bend and speed are autoregressive, and whose bend turns it."""
    rng = np.random.default_rng(seed)
    bend, speed = np.zeros(count), np.full(count, 1.5)
    for t in range(1, count):
        bend[t] = 0.9 * bend[t - 1] + NOISE * rng.normal()
        speed[t] = 1.5 + 0.8 * (speed[t - 1] - 1.5) + 0.1 * rng.normal()
    turning = 4 * bend  # rad/s
    heading = np.cumsum(turning) / RATE
    before = np.append(0.0, heading[:-1])
    length = 60.0
    slip = 0.1 * rng.normal(size=count)
    x = np.cumsum(speed * np.cos(before) - slip * np.sin(before)) / RATE * length
    y = -np.cumsum(speed * np.sin(before) + slip * np.cos(before)) / RATE * length
    track = np.arange(count) * tracks // count
    ends = np.append(track[DELTA:], np.full(DELTA, -1)) != track
    moved = np.hypot(np.roll(x, -DELTA) - x, np.roll(y, -DELTA) - y) / length
    turned = wrap_deg(np.degrees(np.roll(heading, -DELTA) - heading))
    features = pd.DataFrame(
        {
            "track_id": track, "frame": np.arange(count), "x_px": x, "y_px": y,
            "heading_deg": wrap_deg(np.degrees(heading)), "body_length_px": length,
            "displacement": np.where(ends, np.nan, moved),
            "included_angle_deg": np.where(ends, np.nan, turned),
            "swimming_type": np.sign(turned).astype(np.int8),
            "current": 0.0,
        }
    )  # fmt: skip
    codes = np.stack([bend, 0.2 * bend**2 + 0.05 * rng.normal(size=count)], 1)
    return features, codes
