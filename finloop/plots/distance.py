"""Fig. 9 of the fish paper: both distance maps as pictures, dark = similar."""

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

BLANK = "#F0DFA8"  # no shade of grey: nothing was measured there


def rows_of_longest_tracks(features: pd.DataFrame, most: int) -> NDArray[np.intp]:
    """Return the rows (k,) of the film's longest tracks, at most `most` rows, ascending.

    Tracks are added from the longest on; the last one may be cut off.
    """
    track = features["track_id"]
    track_length = track.groupby(track).transform("size").to_numpy()  # of each row's track
    longest_first = np.lexsort((np.arange(len(track)), track, -track_length))
    return np.sort(longest_first[:most])


def figure9(
    distance: NDArray[np.floating], compared: NDArray[np.bool_], track: NDArray[np.integer],
    natural_step: float,
) -> Figure:  # fmt: skip
    """Draw Fig. 9 of the fish paper: distances of (a) all pairs of frames, (b) the compared pairs.

    distance (n, n): Euclidean distances (Eq. 5). compared (n, n): the pairs that Eq. 6 compares,
    those of like motion. track (n,): the track of each frame.
    """
    figure = Figure(figsize=(13, 6.8), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    shades = colormaps["gray"].with_extremes(bad=BLANK)
    # Few pairs are far: without them, shades differ more.
    top = float(np.quantile(distance, 0.99)) / natural_step
    steps = distance / natural_step
    skipped = 100 * (1 - compared.mean())
    titles = (
        "(a) Eq. 5: every pair",
        f"(b) Eq. 6: like with like; {skipped:.1f} % of these pairs skipped (tinted)",
    )
    for ax, values, title in zip(
        axes, (steps, np.where(compared, steps, np.nan)), titles, strict=True
    ):
        image = ax.imshow(values, cmap=shades, vmin=0, vmax=top, interpolation_stage="rgba")
        ax.set(title=title, xlabel="frame j (in time order, track after track)")
        for edge in np.flatnonzero(np.diff(track)) + 0.5:
            ax.axhline(edge, color="#0072B2", lw=0.4)
            ax.axvline(edge, color="#0072B2", lw=0.4)
    axes[0].set_ylabel("frame i")
    bar = figure.colorbar(image, ax=axes, shrink=0.9, extend="max", pad=0.01)
    bar.set_label("distance in median natural steps (dark = similar)")
    return figure
