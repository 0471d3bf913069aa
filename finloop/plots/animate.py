"""A figure of an animation against its film: speed, turn rate, share of time in each state."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.animate.measures import kinematic_distance
from finloop.animate.motion import STATES

Floats = NDArray[np.float64]
Kinematics = tuple[Floats, Floats]
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # Okabe-Ito
_FILM = "0.35"


def kinematics(
    film: Kinematics,
    film_states: Mapping[str, float],
    modes: Mapping[str, tuple[Kinematics, Mapping[str, float]]],
) -> Figure:
    """Distributions of every mode beside the film's; states in per cent of the time."""
    figure = Figure(figsize=(12, 4), layout="constrained")
    *distributions, states = figure.subplots(1, 3)
    names = ("speed (body lengths/s)", "turn rate (°/s)")
    for number, (axes, name) in enumerate(zip(distributions, names, strict=True)):
        low, high = np.quantile(film[number], [0.005, 0.995])
        bins = np.linspace(low, high, 60)
        axes.hist(film[number], bins, density=True, color=_FILM, alpha=0.35, label="film")
        for colour, (mode, (mine, _)) in zip(COLOURS, modes.items(), strict=False):
            far = kinematic_distance(mine[number], film[number])
            axes.hist(
                mine[number], bins, density=True, histtype="step", color=colour, lw=1.6,
                label=f"{mode}, {far:.2f} sd away",
            )  # fmt: skip
        axes.set(xlabel=f"{name}, over Δ", ylabel="density")
        axes.set_yscale("log")
        axes.set_ylim(top=20 * axes.get_ylim()[1])  # room for the key
        axes.legend(frameon=False, loc="upper right")
    place = np.arange(len(STATES))
    width = 0.8 / (1 + len(modes))
    shown = {"film": (_FILM, film_states)} | {
        mode: (colour, share)
        for colour, (mode, (_, share)) in zip(COLOURS, modes.items(), strict=False)
    }
    for number, (mode, (colour, share)) in enumerate(shown.items()):
        values = [share.get(f"{state}_pct", 0.0) for state in STATES]
        states.bar(place + width * number, values, width, color=colour, label=mode)
    states.set_xticks(place + width * len(modes) / 2, STATES, rotation=20)
    states.set(ylabel="% of the time")
    states.legend(frameon=False)
    return figure
