"""Load the course of a clip's light, for animations that have it, too."""

from pathlib import Path

from finloop.base.arrays import Floats
from finloop.clip.check import CHECK, CHECK_NAME
from finloop.io.table import load_table


def load_light_course(clip: Path) -> Floats | None:
    """Return the brightness (frames,) of a clip relative to its mean; None if it is unknown.

    clip: its folder. Between frames whose brightness is known, it is interpolated.
    """
    path = clip / CHECK_NAME
    if not path.exists():
        return None
    light = load_table(path, CHECK, ["light"])["light"].interpolate(limit_direction="both")
    return None if light.isna().any() else (light / light.mean()).to_numpy(float)
