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
from finloop.plots.loops import (
    SIZE_PX,
    arc_points,
    composite_on_light_grey,
    rows_with_fish,
    spread_table_rows,
)

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")  # Okabe-Ito, of L1 … L4
_HALO = [withStroke(linewidth=3, foreground="white")]
_TRACKS = 40  # those with the most loops
_PER_TRACK = 24  # loops of a track, of which all combinations of four are examined
_ENOUGH = 40  # routes from G to F; the three of the figure are among the shortest
_G, _F = 6, 5  # numbers of the ends in time order, from 0 for A

Rows = NDArray[np.integer]


class ThreeRoutes(NamedTuple):
    """Four loops of one track, ordered by their first ends, and three routes from end G to end F.

    loops: their rows of the table of loops. ends (8,): rows of the feature table, A … H. cases: the
    three routes, each a list of legs.
    """

    loops: pd.DataFrame
    ends: Rows
    cases: list[list[Leg]]


def find_three_routes(loops: pd.DataFrame, track_id: Rows) -> ThreeRoutes | None:
    """Return four loops as in Fig. 10a of the fish paper, and three routes; None if there are none.

    The loops belong to one track; A … H are their eight ends, ordered in time. F, G and H jump back
    to before F. So from G the film can jump at once, or play on to H and jump from there. The
    fourth loop lies between F and the end to which H leads, so that a route can include it. Of all
    such fours, the one is taken whose ends are most evenly apart in time, see `_least_gap_shares`.
    track_id (n,): the track of each row.
    """
    # The best four loops of the tracks with the most loops.
    within = loops[loops["length_s"].notna()]  # a loop between two tracks has no length
    track = track_id[within["a"].to_numpy()]
    largest_share, chosen = 0.0, None
    tracks, count = np.unique(track, return_counts=True)
    for number in tracks[np.argsort(-count, kind="stable")[:_TRACKS]]:
        track_loops = spread_table_rows(within[track == number], _PER_TRACK)
        if len(track_loops) < 4:
            continue
        fours = np.array(list(combinations(range(len(track_loops)), 4)))
        shares = _least_gap_shares(track_loops[["a", "b"]].to_numpy()[fours])
        if shares.max() > largest_share:
            largest_share, chosen = float(shares.max()), track_loops.iloc[fours[shares.argmax()]]
    if chosen is None:
        return None
    chosen = chosen.sort_values("a", ignore_index=True)
    graph = build_loop_graph(chosen, track_id)
    return ThreeRoutes(chosen, graph.ends, choose_cases(find_routes(graph, _G, _F, _ENOUGH)))


def _least_gap_shares(pairs: Ints) -> Floats:
    """Return how evenly the ends of four loops lie in time: the least gap / the whole span, (n,).

    pairs (n, 4, 2): rows of one track, the ends of n choices of four loops. The share is 0 where
    the loops do not lie as in the paper, see `find_three_routes`.
    """
    ends = pairs.reshape(-1, 8)
    order = ends.argsort(axis=1, kind="stable")
    rank = np.argsort(order, axis=1)  # of each end in time, 0 for A … 7 for H
    # (n, 8): for each of A … H, the rank of its loop's other end, its neighbour in `ends`.
    partner = np.empty_like(rank)
    np.put_along_axis(partner, rank, rank[:, [1, 0, 3, 2, 5, 4, 7, 6]], axis=1)
    time = np.take_along_axis(ends, order, axis=1)
    least_share = np.diff(time, axis=1).min(axis=1) / (time[:, -1] - time[:, 0])
    leads_back = (partner[:, 5:] < 5).all(axis=1)  # F, G and H have loops with ends before F
    # The fourth loop has both its ends before F, and the later one after the end to which H leads.
    early = np.arange(5)  # A … E
    lies_between = (partner[:, :5] < early) & (early > partner[:, 7:])
    return np.where(leads_back & lies_between.any(axis=1), least_share, 0.0)


def choose_cases(candidates: Sequence[list[Leg]]) -> list[list[Leg]]:
    """Return the three routes of the fish paper's Fig. 10b, each the shortest of its kind.

    Case 1 plays on and then jumps once. Case 2 jumps at once, once. Case 3 is case 1 with one more
    loop on the route: a second jump, back in time. candidates: of all kinds, the shortest first.
    """
    one_jump = [route for route in candidates if len(jump_legs(route)) == 1]
    first = next(route for route in one_jump if route[0].kind == PLAY)
    second = next(route for route in one_jump if route[0].kind == JUMP)

    def has_one_more_loop(route: Sequence[Leg]) -> bool:
        """Return whether a route jumps as case 1, and then once more, back in time."""
        jumps = jump_legs(route)
        goes_back = len(jumps) == 2 and jumps[1].to_row < jumps[1].from_row
        return goes_back and jumps[:1] == jump_legs(first)

    return [first, second, next(route for route in candidates if has_one_more_loop(route))]


def jump_legs(route: Sequence[Leg]) -> list[Leg]:
    """Return the legs of a route that are jumps."""
    return [leg for leg in route if leg.kind == JUMP]


def route_letters(route: Sequence[Leg], ends: Rows) -> str:
    """Return the letters of the loop ends along a route, as in the fish paper: GHCDEF.

    ends: rows of the loop ends A, B …, in rising order.
    """
    rows = [route[0].from_row, *(leg.to_row for leg in route)]
    return "".join(LETTERS[int(np.searchsorted(ends, row))] for row in rows)


def figure10(three: ThreeRoutes, reel: Reel, reference: str, natural_step: float) -> Figure:
    """Draw Fig. 10 of the fish paper: four loops in time (a), and three routes from G to F (b).

    Between are the pictures at the loops' ends. reel: the film's cut-outs and features. reference:
    the frame of reference in which the ends were compared. natural_step: in the unit of the loops'
    distances.
    """
    figure = Figure(figsize=(12.5, 9.8), layout="constrained")
    heights = 3.2, 1.1, 5.6
    parts: NDArray[np.object_] = np.asarray(figure.subfigures(3, 1, height_ratios=heights))
    upper, middle, lower = parts
    # (a) The loops, and the pictures at their ends.
    frame = reel.features["frame"].to_numpy()
    first, last = frame[three.ends[0]], frame[three.ends[-1]]
    margin = 0.04 * (last - first)
    limits = first - margin, last + margin
    time = upper.subplots()
    _draw_loops(time, three, frame)
    time.set(xlim=limits, ylim=(-0.3, 1.2), yticks=[], xlabel="frame of the film")
    track = reel.features["track_id"].iloc[three.ends[0]]
    time.set_title(f"(a) four loops of track {track}", loc="left")
    _draw_fish_at_ends(middle, three, reel, reference, frame)
    # (b) The routes.
    levels = [1 + len(jump_legs(route)) for route in three.cases]  # each jump leads one level down
    panels = lower.subplots(3, 1, sharex=True, height_ratios=levels)
    for number, (axes, route) in enumerate(zip(panels, three.cases, strict=True), start=1):
        _draw_route(axes, route, three.ends, frame)
        axes.set(xlim=limits)
        axes.set_title(_route_title(number, route, three, natural_step), loc="left", fontsize=10)
    words = "(b) three ways from G to F: solid, frames played successively; dotted, a jump"
    lower.suptitle(words, x=0.005, ha="left")
    return figure


def _end_colours(three: ThreeRoutes) -> list[str]:
    """Return the colour of each of the ends A … H: that of its loop."""
    colours = dict.fromkeys(three.ends.tolist(), "")
    for colour, loop in zip(_COLOURS, three.loops.itertuples(), strict=True):
        colours[loop.a] = colours[loop.b] = colour
    return list(colours.values())


def _draw_loops(axes: Axes, three: ThreeRoutes, frame: Rows) -> None:
    """Draw four loops as arcs over the frame (n,) of each row, with the letters of their ends."""
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
    for row, letter, colour in zip(three.ends, LETTERS, _end_colours(three), strict=False):
        axes.plot(frame[row], 0, "o", color=colour, ms=7, zorder=3)
        axes.text(frame[row], -0.17, letter, ha="center", va="center", fontweight="bold")


def _draw_fish_at_ends(
    subfigure: SubFigure, three: ThreeRoutes, reel: Reel, reference: str, frame: Rows
) -> None:
    """Draw the fish at the eight loop ends A … H, side by side.

    reference: the frame of reference in which they were compared. frame (n,): the frame of each
    row.
    """
    pictures = reel.draw_rows(three.ends.astype(np.intp), SIZE_PX, reference)
    band = rows_with_fish(pictures)
    subfigure.suptitle(
        "the fish at the ends: two of one colour are alike", x=0.005, ha="left", fontsize=10
    )
    panels = subfigure.subplots(1, len(pictures))
    colours = _end_colours(three)
    for axes, picture, letter, row, colour in zip(
        panels, pictures, LETTERS, three.ends, colours, strict=False
    ):
        axes.imshow(composite_on_light_grey(picture[band]))
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(color=colour, linewidth=2.5)
        axes.set_title(f"{letter}: {frame[row]}", fontsize=10, color=colour)


def _draw_route(axes: Axes, route: Sequence[Leg], ends: Rows, frame: Rows) -> None:
    """Draw a route over the film's frames as steps: solid lines are played, dotted arrows jump.

    Each jump leads one level down. Loop ends on the route get their letters. ends: rows of the loop
    ends A … H. frame (n,): the frame of each row.
    """
    # The lines; `level` counts the jumps so far.
    level = 0
    for start, stop, kind in merge_play_legs(route):
        if kind == PLAY:
            x, y = frame[[start, stop]], np.array([-level, -level])
            axes.plot(x, y, color="black", lw=2.5, solid_capstyle="butt")
        else:
            level += 1
            x, y = frame[[start, start, stop, stop]], np.array([1, 0.62, 0.62, 0.14]) - level
            axes.plot(x, y, color="0.3", lw=1.8, ls=":")
            axes.plot(x[-1], y[-1], "v", color="0.3", ms=6)
    # The ends on the route, with their letters.
    level = 0
    names = dict(zip(ends.tolist(), LETTERS, strict=False))
    stations = [(route[0].from_row, PLAY), *((leg.to_row, leg.kind) for leg in route)]
    for number, (row, kind) in enumerate(stations):
        level += kind == JUMP
        is_end = number in (0, len(route))
        colour, size = (_COLOURS[1], 7) if is_end else ("black", 4)
        axes.plot(frame[row], -level, "o", color=colour, ms=size)
        axes.annotate(
            names[row], (frame[row], -level), (-7, 4), textcoords="offset points", ha="right",
            fontweight="bold" if is_end else "normal", path_effects=_HALO,
        )  # fmt: skip
    axes.set(ylim=(-level - 0.4, 0.75))
    axes.axis("off")


def _route_title(number: int, route: Sequence[Leg], three: ThreeRoutes, natural_step: float) -> str:
    """Return a route's title: case number, letters of its ends, frames played, and jump distances.

    number: of the case in the figure, from 1. three: the loops, with their distances, and the ends
    that letters name. natural_step: the unit of the distances.
    """
    jumps = jump_legs(route)
    frames = sum(stop - start for start, stop, kind in route if kind == PLAY)
    distance_of_loop = {
        frozenset((loop.a, loop.b)): loop.distance / natural_step
        for loop in three.loops.itertuples()
    }
    distances = " and ".join(
        f"{distance_of_loop[frozenset((jump.from_row, jump.to_row))]:.2f}" for jump in jumps
    )
    return (
        f"case {number}: {route_letters(route, three.ends)}   {frames} frames, {len(jumps)} jump"
        f"{'s' if len(jumps) > 1 else ''} of {distances} natural steps"
    )
