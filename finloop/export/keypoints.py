"""Poses as DeepLabCut writes them for several animals: a CSV with a header of four rows.

`movement` (`load_poses.from_file`, source "DeepLabCut"), DeepLabCut itself and what is built on it
read that layout. Programs tell it by `scorer, individuals, bodyparts, coords` in the first column;
a fish that is not seen has empty cells.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from finloop.base.poses import Poses

SCORER = "finloop"
BLOCK = 1024  # frames made at a time, so that a long clip does not have to fit into memory


def deeplabcut(poses: Poses, block: int = BLOCK) -> Iterator[pd.DataFrame]:
    """The rows of the layout, one per frame of the clip, `block` frames at a time."""
    columns = pd.MultiIndex.from_product(
        [[SCORER], poses.individuals, poses.keypoints, ["x", "y", "likelihood"]],
        names=["scorer", "individuals", "bodyparts", "coords"],
    )
    values = np.concatenate([poses.places, poses.confidence[..., None]], axis=2)
    for start in range(0, poses.frames, block):
        frames = np.arange(start, min(start + block, poses.frames))
        first, last = np.searchsorted(poses.frame, [start, start + block])
        cells = np.full((len(frames), len(poses.individuals), *values.shape[1:]), np.nan)
        cells[poses.frame[first:last] - start, poses.individual[first:last]] = values[first:last]
        yield pd.DataFrame(cells.reshape(len(frames), -1), frames, columns)
