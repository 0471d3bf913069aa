"""Fig. 12 of the fish paper: groups of loops that never overlap in time, and dead ends."""

from heapq import nlargest
from itertools import cycle, pairwise

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from finloop.base.arrays import Mask
from finloop.loops.graph import LoopGraph, can_play_for_ever, rows_of_largest_component
from finloop.loops.search import group_overlapping_loops
from finloop.plots.loops import DEAD, LARGEST, OTHER, arc_points, spread_table_rows

_IN_TURN = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
_ARCS, _PER_GROUP = 160, 8  # loops that a viewer can distinguish in one picture and one group
_LINES = 9  # groups with a line of their own
_NAMED = 8  # dead ends
_NARROW = 0.02  # of the film; a group over less of it has no number at its bar

Rows = NDArray[np.integer]


def find_runs(inside: Mask, track_id: Rows) -> list[tuple[int, int]]:
    """Return the unbroken runs of True in `inside` (n,), as pairs (first row, row after the last).

    A run ends where the track ends. track_id (n,): the track of each row.
    """
    track_inside = np.where(inside, track_id, -1)
    edges = np.flatnonzero(np.diff(track_inside, prepend=-1, append=-1))
    return [(int(start), int(stop)) for start, stop in pairwise(edges) if inside[start]]


def rows_within_loops(loops: pd.DataFrame, track_id: Rows) -> Mask:
    """Return a mask (n,) of the rows that lie between the ends of any loop, the ends included.

    Of a loop between two tracks only its ends count. track_id (n,): the track of each row.
    """
    # By how much the number of loops that cover a row differs from that of the row before.
    change = np.zeros(len(track_id) + 1, np.int64)
    a, b = loops["a"].to_numpy(), loops["b"].to_numpy()
    within = track_id[a] == track_id[b]
    # Each loop covers a to b; or, between two tracks, a and b.
    for first, last in ((a, np.where(within, b, a)), (b, b)):
        np.add.at(change, first, 1)
        np.add.at(change, last + 1, -1)
    return np.cumsum(change)[:-1] > 0


def figure12(
    loops: pd.DataFrame, graph: LoopGraph, features: pd.DataFrame, rate_hz: float
) -> Figure:
    """Draw Fig. 12 of the fish paper: groups of loops along the film, and its dead ends.

    At the top are the loops within a track, as in the paper. Below are a line for each group of all
    loops, and the parts of the film that can be played for ever. graph: of all loops.
    """
    track_id = features["track_id"].to_numpy()
    heights = (3.2, 0.45 + 0.28 * _count_group_lines(loops["group"].nunique()), 1.5)
    figure = Figure(figsize=(12.5, sum(heights) + 1.6), layout="constrained")
    track_panel, group_panel, ends_panel = figure.subplots(3, 1, sharex=True, height_ratios=heights)
    _draw_track_loops(track_panel, loops, track_id, rate_hz)
    _draw_groups(group_panel, loops, track_id, rate_hz)
    _draw_dead_ends(ends_panel, graph, features, rate_hz)
    ends_panel.set(xlim=(0, len(track_id) / rate_hz))
    # The last panel's key, moved below the figure.
    key = ends_panel.get_legend()
    figure.legend(handles=key.legend_handles, loc="outside lower center", ncols=3, frameon=False)
    key.remove()
    return figure


def _draw_track_loops(axes: Axes, loops: pd.DataFrame, track_id: Rows, rate_hz: float) -> None:
    """Draw the loops within tracks as arcs over time, with a bar below each group of loops.

    Groups alternate between four colours. track_id (n,): the track of each row of the film.
    """
    within = loops[loops["length_s"].notna()]  # a loop between two tracks has no length
    axes.set(yticks=[], ylim=(-0.28, 1.05))
    if within.empty:
        axes.set_title("no loop lies within one track", loc="left", fontsize=10)
        return
    # The groups, numbered from 0; their colours alternate in time.
    groups = group_overlapping_loops(within["a"].to_numpy(), within["b"].to_numpy(), track_id)
    within = within.assign(track_group=groups).sort_values(["track_group", "length_s"])
    count, drawn = int(groups.max()) + 1, 0
    arcs_per_group = max(1, min(_PER_GROUP, _ARCS // count))
    by_group = within.groupby("track_group")
    groups_in_time = by_group["a"].min().sort_values(kind="stable").index
    colours = dict(zip(groups_in_time, cycle(_IN_TURN), strict=False))
    # By colour: the bars (start, length), s, and the arcs, points as `arc_points` returns them.
    bars: dict[str, list[tuple[float, float]]] = {colour: [] for colour in _IN_TURN}
    arcs: dict[str, list[NDArray[np.float64]]] = {colour: [] for colour in _IN_TURN}
    for number, group in by_group:
        start_s, stop_s = group["a"].min() / rate_hz, (group["b"].max() + 1) / rate_hz
        bars[colours[number]].append((start_s, stop_s - start_s))
        if stop_s - start_s > _NARROW * len(track_id) / rate_hz:
            text = str(len(group))
            axes.text((start_s + stop_s) / 2, -0.2, text, ha="center", va="center", fontsize=8)
        if drawn < _ARCS:
            shown = spread_table_rows(group, arcs_per_group)
            drawn += len(shown)
            a_s, b_s = shown["a"].to_numpy() / rate_hz, shown["b"].to_numpy() / rate_hz
            arcs[colours[number]] += list(arc_points(a_s, b_s, float(within["length_s"].max())))
    for colour in _IN_TURN:
        axes.broken_barh(bars[colour], (-0.12, 0.1), color=colour)
        axes.add_collection(LineCollection(arcs[colour], colors=colour, lw=0.9, alpha=0.8))
    axes.set_title(
        f"{_count_with_noun(len(within), 'loop')} within a track, "
        f"{_count_with_noun(count, 'group')}: a bar a group, with its number of loops; "
        f"arcs: {drawn} of the loops",
        loc="left", fontsize=10,
    )  # fmt: skip


def _draw_groups(axes: Axes, loops: pd.DataFrame, track_id: Rows, rate_hz: float) -> None:
    """Draw a line for each group of loops: the parts of the film that its loops cover.

    Groups are numbered from 0, the largest first. Beyond `_LINES` groups, one line holds all
    others. track_id (n,): the track of each row of the film.
    """
    count = loops["group"].nunique()
    joins_tracks = loops["length_s"].isna()  # a loop between two tracks has no length
    contents = []
    for line in range(_count_group_lines(count)):
        group = loops[loops["group"] == line] if line < _LINES else loops[loops["group"] >= line]
        covered, colour = rows_within_loops(group, track_id), OTHER if line else LARGEST
        parts = [(a / rate_hz, (b - a) / rate_hz) for a, b in find_runs(covered, track_id)]
        axes.broken_barh(parts, (line - 0.3, 0.6), color=colour, lw=1.5 if line else 0)
        if line:  # the largest group joins tracks too often to draw each join
            joins = group[joins_tracks[group.index]][["a", "b"]].to_numpy() / rate_hz
            axes.hlines(np.full(len(joins), line), *joins.T, color=colour, lw=0.8)
        content = (
            f"{_count_with_noun(len(group), 'loop')} over {covered.sum() / rate_hz:.1f} s of film"
        )
        contents.append(content if line < _LINES else f"{count - _LINES} more groups: {content}")
    lines = range(len(contents))
    axes.set(ylim=(len(contents) - 0.4, -0.6), yticks=lines)
    axes.set_yticklabels([str(line + 1) if line < _LINES else "…" for line in lines])
    axes.set_ylabel("group")
    side = axes.secondary_yaxis("right")
    side.set_yticks(lines, contents, fontsize=8)
    side.tick_params(length=0)
    axes.set_title(
        f"all {_count_with_noun(len(loops), 'loop')}: {_count_with_noun(count, 'group')}; "
        f"{int(joins_tracks.sum())} of the loops join two tracks (lines) and lie over their two "
        "ends alone",
        loc="left", fontsize=10,
    )  # fmt: skip


def _count_group_lines(groups: int) -> int:
    """Return the number of lines for groups: one each, and one for all beyond `_LINES`."""
    return min(groups, _LINES + 1)


def _count_with_noun(number: int, noun: str) -> str:
    """Return a count with its noun, such as "1 loop" or "3 loops"."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _draw_dead_ends(axes: Axes, graph: LoopGraph, features: pd.DataFrame, rate_hz: float) -> None:
    """Draw a bar of the film that shows its dead ends, and name the longest of them.

    A dead end is film from which no loop leads on for ever. graph: of all loops.
    """
    track_id = features["track_id"].to_numpy()
    rows = len(track_id)
    # The bar, with a line between two tracks.
    endless, in_largest = can_play_for_ever(graph, track_id), rows_of_largest_component(graph, rows)
    state = np.where(in_largest, 0, np.where(endless, 1, 2))
    axes.imshow(
        state[None], aspect="auto", extent=(0, rows / rate_hz, 0, 1), interpolation="nearest",
        cmap=ListedColormap([LARGEST, OTHER, DEAD]), vmin=0, vmax=2,
    )  # fmt: skip
    for edge in np.flatnonzero(np.diff(track_id)) + 1:
        axes.axvline(edge / rate_hz, ymin=0.6, color="white", lw=0.6)
    words = ("in the largest component", "leads to a loop without end", "dead end")
    handles = [
        Patch(color=colour, label=f"{word}: {100 * (state == number).mean():.1f} % of the film")
        for number, (word, colour) in enumerate(zip(words, (LARGEST, OTHER, DEAD), strict=True))
    ]
    axes.legend(handles=handles)
    dead_ends = find_runs(~endless, track_id)  # of each the first row, and the row after it
    _name_longest_runs(axes, dead_ends, features, rate_hz)
    axes.set(yticks=[], xlabel="film, its tracks one after another (s)")
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.set_title(
        "where the film can be played for ever; below, the longest of "
        f"{_count_with_noun(len(dead_ends), 'dead end')}",
        loc="left", fontsize=10,
    )  # fmt: skip


def _name_longest_runs(
    axes: Axes, runs: list[tuple[int, int]], features: pd.DataFrame, rate_hz: float
) -> None:
    """Write track, frames and duration of the longest runs side by side below a bar of the film.

    runs: pairs (first row, row after the last).
    """
    track_id, frame = features["track_id"].to_numpy(), features["frame"].to_numpy()
    named = sorted(nlargest(_NAMED, runs, key=lambda run: run[1] - run[0]))
    for number, (start, stop) in enumerate(named):
        text = f"track {track_id[start]}\nframes {frame[start]}–{frame[stop - 1]}"
        axes.annotate(
            f"{text}\n{(stop - start) / rate_hz:.1f} s", ((start + stop) / 2 / rate_hz, 0),
            ((number + 0.5) / len(named), -0.55), textcoords="axes fraction", fontsize=8,
            ha="center", va="top", arrowprops={"arrowstyle": "-", "color": DEAD, "lw": 0.8},
        )  # fmt: skip
