"""The film's postures, where the stage `pose` left them."""

from pathlib import Path

import pandas as pd

from finloop.io.mapped import open_array
from finloop.io.record import load_json, made_by
from finloop.io.table import load_lists
from finloop.pose.film import POSES, FilmPoses, restored

DATA = Path("data")


def load_poses(features: pd.DataFrame) -> FilmPoses:
    """The postures of all rows of the feature table.

    FinloopError if a file is missing, damaged, or of another film.
    """
    folder = DATA / "pose"
    (codes,) = load_lists(folder / "poses.parquet", POSES, "codes")
    postures = open_array(folder / "postures.npy", (len(features), None), "float64")
    return load_json(
        folder / "shapes.json",
        lambda facts: restored(features, codes, facts, postures),
        *made_by("pose"),
    )
