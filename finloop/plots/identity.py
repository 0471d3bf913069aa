"""Picture of `identity`: the tracks of each animal over time."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_MOST = 40  # animals drawn: those seen longest
_SURE = "viridis"


def draw_timeline(table: pd.DataFrame, features: pd.DataFrame, rate_hz: float) -> Figure:
    """Draw one row per animal with a bar per track over time; dots mark joins of two tracks.

    A dot's colour is the join's probability. table: columns of `IDENTITIES`. features: track_id and
    frame of every row. rate_hz: frames per second.
    """
    span = features.groupby("track_id")["frame"].agg(["min", "max"]).loc[table["track_id"]]
    start, stop = (span[end].to_numpy() / rate_hz for end in ("min", "max"))
    on_page = table["identity"].to_numpy() < _MOST
    rows = table["identity"].to_numpy()
    count = min(int(rows.max()) + 1, _MOST)
    figure = Figure(figsize=(10, 1.6 + 0.22 * count), layout="constrained")
    axes = figure.subplots()
    axes.barh(
        rows[on_page], (stop - start)[on_page] + 1 / rate_hz, left=start[on_page], height=0.7,
        color=np.where(rows[on_page] % 2, "#5b7f95", "#9db4c0"),
    )  # fmt: skip
    at = {track: k for k, track in enumerate(table["track_id"])}
    later = [k for k in np.flatnonzero(on_page) if table["after_track"].iloc[k] >= 0]
    before = [at[table["after_track"].iloc[k]] for k in later]
    # In the middle of the gap, which may be much shorter than a point.
    points = axes.scatter(
        [(stop[a] + start[b]) / 2 for a, b in zip(before, later, strict=True)], rows[later],
        c=table["probability"].iloc[later], vmin=0.5, vmax=1, cmap=_SURE, s=22, zorder=3,
        edgecolors="white", linewidths=0.5,
    )  # fmt: skip
    figure.colorbar(points, ax=axes, label="probability of a join")
    axes.set(xlabel="time (s)", ylabel="animal", ylim=(count - 0.4, -0.6), xlim=(0, stop.max()))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    left = int(rows.max()) + 1 - count
    axes.set_title(f"{count} animals" + (f", and {left} seen more shortly" if left else ""))
    return figure
