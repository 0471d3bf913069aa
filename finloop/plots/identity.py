"""Picture of `identity`: the tracks of each animal over time."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_MOST = 40  # animals drawn: those seen longest


def draw_timeline(table: pd.DataFrame, features: pd.DataFrame, rate_hz: float) -> Figure:
    """Draw one row per animal with a bar per track over time; dots mark joins of two tracks.

    A dot's colour is the join's probability. table: columns track_id, identity (the animal, from
    0), after_track (the track before, −1 without), probability; a row per track. features: track_id
    and frame of every row. rate_hz: frames per second.
    """
    span = features.groupby("track_id")["frame"].agg(["min", "max"]).loc[table["track_id"]]
    start_s, stop_s = (span[end].to_numpy() / rate_hz for end in ("min", "max"))
    animals = table["identity"].to_numpy()
    is_shown = animals < _MOST
    count = min(int(animals.max()) + 1, _MOST)
    figure = Figure(figsize=(10, 1.6 + 0.22 * count), layout="constrained")
    axes = figure.subplots()
    axes.barh(
        animals[is_shown], (stop_s - start_s)[is_shown] + 1 / rate_hz, left=start_s[is_shown],
        height=0.7, color=np.where(animals[is_shown] % 2, "#5b7f95", "#9db4c0"),
    )  # fmt: skip
    # The joins: rows of the later tracks, and of those before these. A point lies amid the gap,
    # which may be much shorter.
    later = np.flatnonzero(is_shown & (table["after_track"] >= 0).to_numpy())
    earlier = pd.Index(table["track_id"]).get_indexer(table["after_track"].iloc[later])
    points = axes.scatter(
        (stop_s[earlier] + start_s[later]) / 2, animals[later],
        c=table["probability"].iloc[later], vmin=0.5, vmax=1, cmap="viridis", s=22, zorder=3,
        edgecolors="white", linewidths=0.5,
    )  # fmt: skip
    figure.colorbar(points, ax=axes, label="probability of a join")
    axes.set(xlabel="time (s)", ylabel="animal", ylim=(count - 0.4, -0.6), xlim=(0, stop_s.max()))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    hidden = int(animals.max()) + 1 - count
    axes.set_title(f"{count} animals" + (f", and {hidden} seen more shortly" if hidden else ""))
    return figure
