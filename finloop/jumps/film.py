"""The jumps of a film, how its rows look, and numbers about them."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.schema import ANY, Column, Schema
from finloop.jumps.search import chosen, nearest
from finloop.jumps.seen import Seen
from finloop.jumps.settings import Settings
from finloop.jumps.sides import handedness, sides_apart
from finloop.jumps.signature import Straight, parts, scaled, signatures
from finloop.pose.film import FilmPoses
from finloop.reel import Reel

LOOK = Schema(Column("look", "float32", "1", length=ANY))
"""Light and skin of the n rows of a film, and then of their n mirror images; without these where
the fish is not to be mirrored. As in `signature.Parts`, together of the deviation 1."""


class FilmJumps(NamedTuple):
    """jumps: columns of `JUMPS`; look: (n, k), or (2 n, k) with mirror images.

    seen: how far any two rows are apart to the eye; numbers: about jumps and looks, for metrics.
    """

    jumps: pd.DataFrame
    look: NDArray[np.float32]
    seen: Seen
    numbers: dict[str, float]


def film_jumps(reel: Reel, poses: FilmPoses, rate_hz: float, settings: Settings) -> FilmJumps:
    """Where a film can go on; poses: of the reel's rows.

    A fish whose sides differ is not mirrored, unless it is asked for.
    """
    track = reel.features["track_id"].to_numpy()
    made = parts(reel, poses, rate_hz, settings)
    sides, hand = sides_apart(Straight(reel, poses, settings.look_px), track), handedness(made)
    alike = sides < settings.sides_most and hand < settings.handed_most
    mirror = settings.mirror == "yes" or (settings.mirror == "auto" and alike)
    values = signatures(made, reel.goes_on, settings)
    least = max(1, round(settings.least_s * rate_hz))
    near = nearest(values, track, settings.candidates, least, mirror)
    seen = Seen.of(reel, poses, settings.look_px)
    apart = seen(near["row"], near["to"], near["mirrored"])
    jumps = chosen(near, apart, settings.neighbours)
    step = np.linalg.norm(np.diff(values[0], axis=0), axis=-1)[reel.goes_on[:-1]]
    best = jumps.groupby("row")["seam"].min()
    look = scaled(made.look)[: 1 + mirror].reshape(-1, made.look.shape[-1])
    return FilmJumps(jumps, look.astype(np.float32), seen, {
        "jumps": len(jumps),
        "rows_with_jumps_pct": 100 * len(best) / len(track),
        "seam_median_steps": float(jumps["seam"].median()),
        "nearest_seam_median_steps": float(best.median()),
        "nearest_seam_p95_steps": float(best.quantile(0.95)),
        "seen_median_steps": float(pd.Series(apart).median()),
        "natural_p95_steps": float(np.quantile(step, 0.95)),
        "sides_apart": sides,
        "handedness": hand,
        "mirrored": float(mirror),
        "jumps_to_mirror_images_pct": 100 * float(jumps["mirrored"].mean()),
    })  # fmt: skip
