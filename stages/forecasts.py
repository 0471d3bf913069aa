"""The forecast of a film, where the stage `forecast` left it."""

from pathlib import Path

import pandas as pd

from finloop.forecast.film import film_states
from finloop.forecast.model import forecast_model
from finloop.forecast.neighbours import NEIGHBOURS, from_table
from finloop.forecast.sampling import Sampler, sampler
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.pose.film import FilmPoses
from stages.settings import load

FOLDER = Path("data/forecast")


def load_forecast(features: pd.DataFrame, poses: FilmPoses, rate_hz: float) -> Sampler | None:
    """What a fish swims by as is foretold; None where the film showed too little.

    features, poses: of the same rows. FinloopError if a file is missing, damaged, or of another
    film.
    """
    if (FOLDER / "reason.json").exists():
        return None
    p = load("forecast")
    film = film_states(features, poses.codes, poses.shapes.mirror, rate_hz, p)
    model = load_record(FOLDER / "model.json", forecast_model, "forecast")
    edges = load_table(FOLDER / "neighbours.parquet", NEIGHBOURS)
    return sampler(film, model, from_table(edges, len(film.states)), p)
