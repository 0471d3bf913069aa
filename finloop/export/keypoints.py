"""Poses in DeepLabCut's layout for several animals: a CSV with a header of four rows.

`movement` (`load_poses.from_file`, source "DeepLabCut"), DeepLabCut itself and programs built on it
read that layout. They recognise it by `scorer, individuals, bodyparts, coords` in the first column.
The cells of a fish that is not seen are empty.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from finloop.base.poses import BLOCK, Poses, iterate_blocks

SCORER = "finloop"


def deeplabcut(poses: Poses, block: int = BLOCK) -> Iterator[pd.DataFrame]:
    """Yield tables in DeepLabCut's layout, `block` frames each, a row per frame of the clip.

    Columns: x, y (px) and likelihood (0 … 1) of every keypoint of every individual.
    """
    columns = pd.MultiIndex.from_product(
        [[SCORER], poses.individuals, poses.keypoints, ["x", "y", "likelihood"]],
        names=["scorer", "individuals", "bodyparts", "coords"],
    )
    for start, cells in iterate_blocks(poses, block):
        frames = np.arange(start, start + len(cells))
        yield pd.DataFrame(cells.reshape(len(cells), -1), frames, columns)
