"""Pictures of the forecast: its learning, its spread, and a fish that swims freely."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from finloop.forecast.assess import autocorrelation
from finloop.forecast.film import FilmStates

_FILM, _PREDICTED, _TRAIN = "0.35", "#D55E00", "#0072B2"
_CHANNELS = (  # a column of the predictions, its number in the film's states, and its label
    ("forward", -3, "forward speed (body lengths/s)"),
    ("turning", -1, "turning speed (rad/s)"),
    ("pose", 0, "first code of the pose (rad, root mean square)"),
)
_RANKS = ("pose_rank", "forward_rank", "sideways_rank", "turning_rank")
_SPAN_S = 1.0  # of the autocorrelations


def draw_learning(curve: pd.DataFrame, held_out: pd.DataFrame) -> Figure:
    """Draw the forecast's error per epoch, and how the true values rank among its predictions.

    curve: columns epoch, train_error, held_out_error. held_out: a row per held-out row, columns
    pose_rank, forward_rank and others: the share of predicted next states below the true one.
    """
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    errors, ranks = figure.subplots(1, 2)
    # The errors.
    for side, colour, label in (
        ("train", _TRAIN, "learnt from"), ("held_out", _PREDICTED, "held out"),
    ):  # fmt: skip
        errors.plot(curve["epoch"], curve[f"{side}_error"], color=colour, label=label)
    errors.set(xlabel="epoch", ylabel="mean square / that of persistence", ylim=(0, 1.2))
    errors.grid(alpha=0.3)
    errors.legend(frameon=False)
    # The ranks; a tenth of the rows is expected in each bin.
    bins = np.linspace(0, 1, 11)
    for name in _RANKS:
        share = 10 * np.histogram(held_out[name], bins)[0] / max(len(held_out), 1)
        ranks.plot((bins[1:] + bins[:-1]) / 2, share, "o-", ms=3, label=name.removesuffix("_rank"))
    ranks.axhline(1, color=_FILM, lw=0.9)
    ranks.set(
        xlabel="share of the predicted next states below the true one",
        ylabel="frequency / expected frequency", ylim=(0, 2.5), title="held-out rows (line: true)",
    )  # fmt: skip
    ranks.legend(frameon=False)
    return figure


def draw_free_swimming(film: FilmStates, predicted: pd.DataFrame) -> Figure:
    """Draw the motion of a fish that only the forecast moves, beside that of the film.

    Above are distributions, below autocorrelations. film: states of the film. predicted: columns
    forward, turning and pose, a row per predicted frame.
    """
    figure = Figure(figsize=(12, 6.5), layout="constrained")
    panels = figure.subplots(2, 3)
    # The states that follow usable rows of the film, without mirror images.
    rows = film.rows[film.rows < film.count] + 1
    follows = np.diff(rows) == 1  # whether the next of these rows is the next of the film
    lags = max(2, round(_SPAN_S * film.rate_hz))
    for (name, number, label), above, below in zip(_CHANNELS, *panels, strict=True):
        filmed, free = film.states[rows, number], predicted[name].to_numpy(float)
        low, high = np.quantile(filmed, [0.002, 0.998])
        bins = np.linspace(low, high, 60).tolist()
        # The distributions.
        above.hist(filmed, bins, density=True, color=_FILM, alpha=0.35, label="film")
        above.hist(
            free, bins, density=True, histtype="step", color=_PREDICTED, lw=1.6, label="free"
        )
        above.set_yscale("log")
        above.legend(frameon=False)
        above.set(xlabel=label, ylabel="density")
        # The autocorrelations.
        times = np.arange(lags) / film.rate_hz
        below.plot(times, autocorrelation(filmed, follows, lags), color=_FILM, label="film")
        unbroken = np.ones(len(free) - 1, bool)
        below.plot(times, autocorrelation(free, unbroken, lags), color=_PREDICTED, label="free")
        below.axhline(0, color="0.8", lw=0.8)
        below.set(xlabel="s", ylabel=f"autocorrelation of {name}")
        below.legend(frameon=False)
    return figure
