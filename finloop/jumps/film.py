"""The jumps of a film, and numbers about them."""

import numpy as np
import pandas as pd

from finloop.jumps.search import nearest
from finloop.jumps.settings import Settings
from finloop.jumps.sides import sides_apart
from finloop.jumps.signature import Straight, parts, signatures
from finloop.pose.film import FilmPoses
from finloop.reel import Reel


def film_jumps(
    reel: Reel, poses: FilmPoses, rate_hz: float, settings: Settings
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Where a film can go on, columns of `JUMPS`, and numbers about it.

    poses: of the reel's rows. A fish whose sides differ is not mirrored, unless it is asked for.
    """
    track = reel.features["track_id"].to_numpy()
    sides = sides_apart(Straight(reel, poses, settings.look_px), track)
    mirror = settings.mirror == "yes" or (settings.mirror == "auto" and sides < settings.sides_most)
    values = signatures(parts(reel, poses, rate_hz, settings), reel.goes_on, settings)
    least = max(1, round(settings.least_s * rate_hz))
    jumps = nearest(values, track, settings.neighbours, least, mirror)
    step = np.linalg.norm(np.diff(values[0], axis=0), axis=-1)[reel.goes_on[:-1]]
    best = jumps.groupby("row")["seam"].min()
    return jumps, {
        "jumps": len(jumps),
        "rows_with_jumps_pct": 100 * len(best) / len(track),
        "seam_median_steps": float(jumps["seam"].median()),
        "nearest_seam_median_steps": float(best.median()),
        "nearest_seam_p95_steps": float(best.quantile(0.95)),
        "natural_p95_steps": float(np.quantile(step, 0.95)),
        "sides_apart": sides,
        "mirrored": float(mirror),
        "jumps_to_mirror_images_pct": 100 * float(jumps["mirrored"].mean()),
    }
