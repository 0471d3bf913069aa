"""The states of a film, and the model that the stage `forecast` learnt from them."""

from pathlib import Path

import pandas as pd

from finloop.base.arrays import Floats
from finloop.forecast.film import FilmStates, film_states, shown_mirror
from finloop.forecast.model import forecast_model
from finloop.forecast.sampling import Sampler, sampler
from finloop.io.mapped import open_array, save_array
from finloop.io.record import load_record
from finloop.io.table import load_lists
from finloop.jumps.table import LOOK
from finloop.pose.film import FilmPoses
from stages.settings import load

FOLDER = Path("data/forecast")


def load_look() -> Floats:
    """Looks of rows, (n, k), or (2 n, k) with mirror images, from the stage `jumps`."""
    return load_lists(Path("data/jumps/look.parquet"), LOOK, "look")[0]


def states_of(features: pd.DataFrame, poses: FilmPoses, look: Floats, rate_hz: float) -> FilmStates:
    """The states of a film, with mirror images if `look` has them.

    features, poses: of the same rows. FinloopError if the film shows too little.
    """
    mirror = shown_mirror(poses, look)
    return film_states(features, poses.codes, mirror, rate_hz, load("forecast"))


def load_forecast(features: pd.DataFrame, poses: FilmPoses, rate_hz: float) -> Sampler | None:
    """The sampler of the stage `forecast`; None where the film showed too little.

    features, poses: of the same rows. FinloopError if a file is missing, damaged, or of another
    film.
    """
    if (FOLDER / "reason.json").exists():
        return None
    film = states_of(features, poses, load_look(), rate_hz)
    model = load_record(FOLDER / "model.json", forecast_model, "forecast")
    rows, numbers = film.states.shape
    start = open_array(FOLDER / "start.npy", (rows + 1,), "int64")
    graph = start, open_array(FOLDER / "neighbours.npy", (int(start[-1]),), "int32")
    mean = open_array(FOLDER / "mean.npy", (rows, numbers), "float64")
    return sampler(film, model, graph, load("forecast"), mean)


def save_graph(folder: Path, swim: Sampler) -> None:
    """Write what `load_forecast` maps: the graph of similar rows, and the foretold states."""
    save_array(folder / "start.npy", swim.start)
    save_array(folder / "neighbours.npy", swim.to)
    save_array(folder / "mean.npy", swim.mean)
