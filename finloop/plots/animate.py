"""A figure of an animation against its film: speed, turn rate, share of time in each state."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from finloop.animate.measures import FILM_MOTION, kinematic_distance
from finloop.base.arrays import Floats
from finloop.edit.modes import COLOURS
from finloop.edit.schema import STATES

_FILM = "0.35"


def draw_kinematics(table: pd.DataFrame, numbers: Mapping[str, float]) -> Figure:
    """Draw speeds and turn rates of every mode beside the film's, and the time in each state.

    table: columns mode, speed, turn_rate, a row per moment. numbers: `<mode>_<state>_pct`.
    """
    motion = dict(iter(table.groupby("mode", sort=False)))
    film = motion.pop(FILM_MOTION)
    colours = dict(zip(motion, COLOURS, strict=False))
    figure = Figure(figsize=(12, 4), layout="constrained")
    *distributions, states = figure.subplots(1, 3)
    names = ("speed (body lengths/s)", "turn rate (°/s)")
    for column, axes, name in zip(("speed", "turn_rate"), distributions, names, strict=True):
        of_modes = {mode: motion[mode][column].to_numpy() for mode in colours}
        _draw_distributions(axes, film[column].to_numpy(), of_modes, colours)
        axes.set(xlabel=f"{name}, over Δ")
    # Share of the time in each state.
    place = np.arange(len(STATES))
    width = 0.8 / (1 + len(colours))
    for number, (mode, colour) in enumerate({FILM_MOTION: _FILM, **colours}.items()):
        shares = [numbers.get(f"{mode}_{state}_pct", 0.0) for state in STATES]
        states.bar(place + width * number, shares, width, color=colour, label=mode)
    states.set_xticks(place + width * len(colours) / 2, STATES, rotation=20)
    states.set(ylabel="% of the time")
    states.legend(frameon=False)
    return figure


def _draw_distributions(
    axes: Axes, film: Floats, of_modes: Mapping[str, Floats], colours: Mapping[str, str]
) -> None:
    """Draw the distribution of a quantity in the film and in each mode's animation.

    film: values (n,). of_modes: values by mode. colours: by mode.
    """
    low, high = np.quantile(film, [0.005, 0.995])
    bins = np.linspace(low, high, 60).tolist()
    axes.hist(film, bins, density=True, color=_FILM, alpha=0.35, label="film")
    for mode, values in of_modes.items():
        distance_sd = kinematic_distance(values, film)
        axes.hist(
            values, bins, density=True, histtype="step", color=colours[mode], lw=1.6,
            label=f"{mode}, {distance_sd:.2f} sd away",
        )  # fmt: skip
    axes.set(ylabel="density")
    axes.set_yscale("log")
    axes.set_ylim(top=20 * axes.get_ylim()[1])  # room for the key
    axes.legend(frameon=False, loc="upper right")
