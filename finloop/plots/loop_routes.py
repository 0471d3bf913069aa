"""Fig. 10 of the fish paper: four loops of the film, and three routes from G to F."""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints
from finloop.distance.reel import Reel
from finloop.loops.graph import JUMP, PLAY, Leg, build_loop_graph, find_routes
from finloop.loops.positions import LETTERS, merge_play_legs
from finloop.plots.loops import SIZE_PX, arc_points, fish_rows, on_light, sample

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # Okabe-Ito, of L1 … L4
_HALO = [withStroke(linewidth=3, foreground="white")]
_TRACKS = 40  # those with the most loops
_PER_TRACK = 24  # loops of a track, of which all combinations of four are examined
_ENOUGH = 40  # routes from G to F; the three of the figure are among the shortest
_G, _F = 6, 5  # in time order

Rows = NDArray[np.integer]


class ThreeWays(NamedTuple):
    """Four loops of one track, ordered by their first ends, and three routes from G to F.

    loops: their rows of the table of loops; ends (8,): rows of the feature table, A … H; cases: the
    three routes, each a list of legs (from, to, PLAY or JUMP).
    """

    loops: pd.DataFrame
    ends: Rows
    cases: list[list[Leg]]


def find_three_ways(loops: pd.DataFrame, track_id: Rows) -> ThreeWays | None:
    """Return the four loops that lie as in the fish paper's Fig. 10a, and their three routes.

    They belong to one track. H, G and F, the last of their eight ends in time, have loops with
    earlier ends. So from G the film can jump at once to before F, or play on to H and jump from
    there. The fourth loop lies between there and F, so that the route can include it. Of all such
    loops, these have the ends that are farthest from each other in time. None: no track has four
    such loops.
    """
    within = loops[loops["length_s"].notna()]
    track = track_id[within["a"].to_numpy()]
    best, chosen = 0.0, None
    names, count = np.unique(track, return_counts=True)
    for one in names[np.argsort(-count, kind="stable")[:_TRACKS]]:
        mine = sample(within[track == one], _PER_TRACK)
        if len(mine) < 4:
            continue
        fours = np.array(list(combinations(range(len(mine)), 4)))
        spread = _spread(mine[["a", "b"]].to_numpy()[fours])
        if spread.max() > best:
            best, chosen = float(spread.max()), mine.iloc[fours[spread.argmax()]]
    if chosen is None:
        return None
    chosen = chosen.sort_values("a", ignore_index=True)
    graph = build_loop_graph(chosen, track_id)
    return ThreeWays(chosen, graph.ends, choose_cases(find_routes(graph, _G, _F, _ENOUGH)))


def _spread(pairs: Ints) -> Floats:
    """Return the least time between two ends of four loops (n, 4, 2), as a share of all their time.

    0 where the loops do not lie as in the paper.
    """
    n = len(pairs)
    ends = pairs.reshape(n, 8)
    order = ends.argsort(axis=1, kind="stable")
    rank = np.argsort(order, axis=1)  # of each end in time, 0 for A … 7 for H
    partner = np.empty_like(rank)
    np.put_along_axis(partner, rank, rank[:, [1, 0, 3, 2, 5, 4, 7, 6]], axis=1)
    time = np.take_along_axis(ends, order, axis=1)
    least = np.diff(time, axis=1).min(axis=1) / (time[:, -1] - time[:, 0])
    earlier = (partner[:, 5:] < 5).all(axis=1)  # H, G and F have loops with ends before F
    early = np.arange(5)
    between = (partner[:, :5] < early) & (early > partner[:, 7:])  # an E after C, back to B
    return np.where(earlier & between.any(axis=1), least, 0.0)


def choose_cases(ways: Sequence[list[Leg]]) -> list[list[Leg]]:
    """Return the three routes of the fish paper's Fig. 10b, chosen from many, shortest first.

    Case 1 plays on and then jumps once. Case 2 jumps at once. Case 3 is case 1 with one more loop
    on the route: a second jump, back in time.
    """
    once = [way for way in ways if len(jumps_of(way)) == 1]
    first = next(way for way in once if way[0][2] == PLAY)
    second = next(way for way in once if way[0][2] == JUMP)
    third = next(
        way
        for way in ways
        if (jumps := jumps_of(way))[:1] == jumps_of(first)
        and len(jumps) == 2
        and jumps[1][1] < jumps[1][0]
    )
    return [first, second, third]


def jumps_of(way: Sequence[Leg]) -> list[Leg]:
    """Return the legs of a route that are jumps."""
    return [leg for leg in way if leg[2] == JUMP]


def spell(way: Sequence[Leg], ends: Rows) -> str:
    """Return a route as the fish paper writes it, as GHCDEF; ends: rows of A, B …, rising."""
    rows = [way[0][0], *(to for _, to, _ in way)]
    return "".join(LETTERS[int(np.searchsorted(ends, row))] for row in rows)


def figure10(three: ThreeWays, reel: Reel, pose: str, step: float) -> Figure:
    """Draw Fig. 10 of the fish paper: four loops in time (a), and three routes from G to F (b).

    Between are the pictures at the loops' ends. pose: in which they were compared; step: the median
    natural step.
    """
    figure = Figure(figsize=(12.5, 9.8), layout="constrained")
    heights = 3.2, 1.1, 5.6
    parts: NDArray[np.object_] = np.asarray(figure.subfigures(3, 1, height_ratios=heights))
    upper, middle, lower = parts
    frame = reel.features["frame"].to_numpy()
    pad = 0.04 * (frame[three.ends[-1]] - frame[three.ends[0]])
    limits = frame[three.ends[0]] - pad, frame[three.ends[-1]] + pad
    time = upper.subplots()
    _draw_loops(time, three, frame)
    time.set(xlim=limits, ylim=(-0.3, 1.2), yticks=[], xlabel="frame of the film")
    track = reel.features["track_id"].iloc[three.ends[0]]
    time.set_title(f"(a) four loops of track {track}", loc="left")
    _draw_fish(middle, three, reel, pose, frame)
    levels = [1 + len(jumps_of(way)) for way in three.cases]
    panels = lower.subplots(3, 1, sharex=True, height_ratios=levels)
    for number, (axes, way) in enumerate(zip(panels, three.cases, strict=True), start=1):
        _draw_way(axes, way, three.ends, frame)
        axes.set(xlim=limits)
        axes.set_title(_describe_case(number, way, three, step), loc="left", fontsize=10)
    words = "(b) three ways from G to F: solid, frames played successively; dotted, a jump"
    lower.suptitle(words, x=0.005, ha="left")
    return figure


def _colour_of_ends(three: ThreeWays) -> list[str]:
    """Return the colour of the loop that each of the ends A … H belongs to."""
    colours = dict.fromkeys(three.ends.tolist(), "")
    for colour, loop in zip(_COLOURS, three.loops.itertuples(), strict=True):
        colours[loop.a] = colours[loop.b] = colour
    return list(colours.values())


def _draw_loops(axes: Axes, three: ThreeWays, frame: Rows) -> None:
    a, b = frame[three.loops["a"]], frame[three.loops["b"]]
    arcs = arc_points(a.astype(float), b.astype(float))
    for number, (arc, colour) in enumerate(zip(arcs, _COLOURS, strict=True), start=1):
        axes.plot(*arc.T, color=colour, lw=2)
        right, up = arc[len(arc) // 2]
        axes.text(
            right, up, f"L{number}", color=colour, ha="center", va="center",
            fontweight="bold", path_effects=_HALO,
        )  # fmt: skip
    axes.axhline(0, color="black", lw=1.5)
    for row, letter, colour in zip(three.ends, LETTERS, _colour_of_ends(three), strict=False):
        axes.plot(frame[row], 0, "o", color=colour, ms=7, zorder=3)
        axes.text(frame[row], -0.17, letter, ha="center", va="center", fontweight="bold")


def _draw_fish(part: SubFigure, three: ThreeWays, reel: Reel, pose: str, frame: Rows) -> None:
    pictures = reel.draw_rows(three.ends.astype(np.intp), SIZE_PX, pose)
    band = fish_rows(pictures)
    part.suptitle(
        "the fish at the ends: two of one colour are alike", x=0.005, ha="left", fontsize=10
    )
    panels = part.subplots(1, len(pictures))
    colours = _colour_of_ends(three)
    for axes, picture, letter, row, colour in zip(
        panels, pictures, LETTERS, three.ends, colours, strict=False
    ):
        axes.imshow(on_light(picture[band]))
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(color=colour, linewidth=2.5)
        axes.set_title(f"{letter}: {frame[row]}", fontsize=10, color=colour)


def _draw_way(axes: Axes, way: Sequence[Leg], ends: Rows, frame: Rows) -> None:
    level = 0
    for a, b, how in merge_play_legs(way):
        if how == PLAY:
            axes.plot(frame[[a, b]], [-level, -level], color="black", lw=2.5, solid_capstyle="butt")
        else:
            level += 1
            x, y = frame[[a, a, b, b]], np.array([1, 0.62, 0.62, 0.14]) - level
            axes.plot(x, y, color="0.3", lw=1.8, ls=":")
            axes.plot(x[-1], y[-1], "v", color="0.3", ms=6)
    level = 0
    names = dict(zip(ends.tolist(), LETTERS, strict=False))
    for number, (row, how) in enumerate([(way[0][0], PLAY), *((b, how) for _, b, how in way)]):
        level += how == JUMP
        end = number in (0, len(way))
        axes.plot(
            frame[row], -level, "o", color=_COLOURS[1] if end else "black", ms=7 if end else 4
        )
        axes.annotate(
            names[row], (frame[row], -level), (-7, 4), textcoords="offset points", ha="right",
            fontweight="bold" if end else "normal", path_effects=_HALO,
        )  # fmt: skip
    axes.set(ylim=(-level - 0.4, 0.75))
    axes.axis("off")


def _describe_case(number: int, way: Sequence[Leg], three: ThreeWays, step: float) -> str:
    jumps = jumps_of(way)
    frames = sum(b - a for a, b, how in way if how == PLAY)
    distance = {
        frozenset((loop.a, loop.b)): loop.distance / step for loop in three.loops.itertuples()
    }
    costs = " and ".join(f"{distance[frozenset(jump[:2])]:.2f}" for jump in jumps)
    return (
        f"case {number}: {spell(way, three.ends)}   {frames} frames, {len(jumps)} jump"
        f"{'s' if len(jumps) > 1 else ''} of {costs} natural steps"
    )
