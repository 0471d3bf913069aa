"""The graph of video loops, and its dead ends (fish paper Figs. 10, 12).

An *end* is a row of the feature table at which a loop begins or ends. There the fish has a choice:
to play on, or to jump to the other end of one of its loops. The film from an end to the next end of
its track is a *segment*; the number of a segment is that of its first end.
"""

import heapq
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from finloop.base.arrays import Floats, Mask
from finloop.base.kernel import kernel

PLAY, JUMP = "play", "jump"
_FREE = 1e-9  # frames: a sparse graph cannot hold an edge of cost 0


class Leg(NamedTuple):
    """A part of a route, from one feature row to another: film that is played on, or a jump.

    kind: PLAY or JUMP.
    """

    from_row: int
    to_row: int
    kind: str


@dataclass(frozen=True)
class LoopGraph:
    """A film's video loops as a graph: m loop ends (frames to jump from), and e jumps between them.

    Each loop gives two jumps, one in each direction.
    """

    ends: NDArray[np.int32]  # (m,) rows of the feature table, rising
    ahead: NDArray[np.int32]  # (m,) index of the next end of the same track, −1 where there is none
    # start, to, distance: instead of end k the film can show any end `to[start[k]:start[k + 1]]`,
    # nearest first; `distance` is D of the two. (m + 1,), (e,), (e,)
    start: NDArray[np.int32]
    to: NDArray[np.int32]
    distance: NDArray[np.float32]
    # (m,) strongly connected component of each segment; 0 holds the most film. Segment k is
    # followed by segment `ahead[k]`, or by one that the end `ahead[k]` has a jump to. A segment
    # that cannot be reached again has a component of its own
    component: NDArray[np.int32]
    cyclic: Mask  # (m,) whether the segment can be reached again from itself
    # (m,) whether the film can play for ever from the start of the segment. So at end k: play on
    # if `endless[k]`, jump to t if `endless[t]`
    endless: Mask

    def jump_targets(self, end: int) -> NDArray[np.int32]:
        """Return the loop ends (k,), by number, to which an end allows a jump, nearest first."""
        return self.to[self.start[end] : self.start[end + 1]]

    @property
    def segment_frames(self) -> NDArray[np.int32]:
        """Return the frames (m,) from each loop end to the next of its track; 0 after the last."""
        return np.where(self.ahead >= 0, self.ends[self.ahead] - self.ends, 0).astype(np.int32)


def build_loop_graph(loops: pd.DataFrame, track_id: NDArray[np.integer]) -> LoopGraph:
    """Build the graph of all video loops of a film: frames to jump from, and jumps between them.

    loops: columns a, b (feature rows) and distance (Eq. 5); track_id (n,): of every feature row.
    """
    a, b = loops["a"].to_numpy(), loops["b"].to_numpy()
    # Every loop is two jumps, first all from a to b, then all from b to a.
    distance = np.tile(loops["distance"].to_numpy(np.float32), 2)
    ends, source = np.unique(np.r_[a, b].astype(np.int32), return_inverse=True)
    to = np.r_[source[len(a) :], source[: len(a)]]
    # The next end of the same track, −1 for none; then the jumps, by their source, nearest first.
    ahead = np.full(len(ends), -1, np.int32)
    has_end_ahead = np.flatnonzero(np.diff(track_id[ends]) == 0)
    ahead[has_end_ahead] = has_end_ahead + 1
    order = np.lexsort((to, distance, source))
    start = np.searchsorted(source[order], np.arange(len(ends) + 1)).astype(np.int32)
    jumps = to[order].astype(np.int32)
    # Which segments can be reached again from themselves: segment k is the film from end k on, up
    # to the next end.
    successors = _segment_successors(ahead, start, jumps)
    _, component_of_segment = connected_components(successors, directed=True, connection="strong")
    has_others = np.bincount(component_of_segment)[component_of_segment] > 1
    cyclic = has_others | (successors.diagonal() > 0)
    cyclic_frames = np.where(cyclic & (ahead >= 0), ends[ahead] - ends, 0)
    return LoopGraph(
        ends, ahead, start, jumps,
        distance=distance[order],
        component=renumber_groups(component_of_segment, cyclic_frames),
        cyclic=cyclic,
        endless=_has_endless_future(track_id, ends, start, jumps)[ends],
    )  # fmt: skip


def _segment_successors(
    ahead: NDArray[np.int32], start: NDArray[np.int32], to: NDArray[np.int32]
) -> csr_array:
    """Return a sparse matrix (m, m), > 0 where a segment (column) can follow another one (row).

    ahead, start, to: as in `LoopGraph`.
    """
    m = len(ahead)
    # A segment is played to the next end; from there the film plays on, or jumps once.
    played = np.flatnonzero(ahead >= 0)
    play = csr_array((np.ones(len(played), np.int32), (played, ahead[played])), (m, m))
    jump = csr_array((np.ones(len(to), np.int32), to, start), (m, m))
    return play + play @ jump


def renumber_groups(
    group: NDArray[np.integer], weight: NDArray[Any] | None = None
) -> NDArray[np.int32]:
    """Renumber groups by their weight, the heaviest 0; return the group numbers of members (n,).

    group (n,): the old numbers, 0 … k − 1; weight (n,): of each member, None: 1. Groups of equal
    weight are ordered by their first member.
    """
    total, first = np.bincount(group, weight), np.unique(group, return_index=True)[1]
    rank = np.empty(len(total), np.int32)
    rank[np.lexsort((first, -total))] = np.arange(len(total))
    return rank[group]


@kernel
def find_endless_rows(
    has_next: Mask, end: NDArray[np.integer], start: NDArray[np.integer], to: NDArray[np.integer]
) -> Mask:
    """Return a mask (n,) of the rows from which the film can play for ever, on or by jumps.

    has_next (n,): whether a row is followed by another; end (n,): the loop end at a row, −1 for
    none; from end k the film can jump to `to[start[k]:start[k + 1]]`. Rows without a successor are
    removed until nothing changes.
    """
    n = has_next.size
    is_endless = np.ones(n, np.bool_)
    changed = True
    while changed:
        changed = False
        for row in range(n - 1, -1, -1):
            if not is_endless[row]:
                continue
            goes_on = has_next[row] and is_endless[row + 1]
            k = end[row]
            if not goes_on and k >= 0:
                for jump in range(start[k], start[k + 1]):
                    # The film must play on from there, or two ends would swap for ever.
                    if has_next[to[jump]] and is_endless[to[jump] + 1]:
                        goes_on = True
                        break
            if not goes_on:
                is_endless[row] = False
                changed = True
    return is_endless


def _has_endless_future(
    track_id: NDArray[np.integer], ends: NDArray[np.int32], start: NDArray[np.int32],
    to: NDArray[np.int32],
) -> Mask:  # fmt: skip
    """Return a mask (n,) of the feature rows after which the film can play for ever.

    It plays on or jumps. track_id (n,): of every row; ends, start, to: as in `LoopGraph`.
    """
    has_next = np.append(track_id[1:] == track_id[:-1], False)
    end = np.full(len(track_id), -1, np.int32)
    end[ends] = np.arange(len(ends))
    is_endless = find_endless_rows(has_next, end, start, ends[to])
    return has_next & np.append(is_endless[1:], False)


def can_play_for_ever(graph: LoopGraph, track_id: NDArray[np.integer]) -> Mask:
    """Return a mask (n,) of the feature rows after which a film can play for ever.

    It plays on, or takes the jumps of the graph. track_id (n,): of every row.
    """
    return _has_endless_future(track_id, graph.ends, graph.start, graph.to)


def rows_of_largest_component(graph: LoopGraph, row_count: int) -> Mask:
    """Return a mask (row_count,) of the feature rows in the largest component of the loop graph.

    A component is film of which every part can be reached from every other by playing and jumping.
    """
    change = np.zeros(row_count + 1, np.int32)  # of the number of segments that a row lies in
    segments = (graph.component == 0) & (graph.ahead >= 0)
    np.add.at(change, graph.ends[segments], 1)
    np.add.at(change, graph.ends[graph.ahead[segments]], -1)
    return np.cumsum(change)[:-1] > 0


def find_routes(
    graph: LoopGraph, source_end: int, target_end: int, most_routes: int, jump_frames: float = 0
) -> list[list[Leg]]:
    """Return the best routes along film and jumps from one loop end to another (Fig. 10).

    source_end, target_end: numbers of ends. The best route has the fewest frames, where a jump
    counts as `jump_frames`. Each leg of a route leads from one end to the next. A route may pass an
    end twice (GHCDEBCDEF does), but takes no jump twice, and plays some film between two jumps. It
    is an A* search, which follows at most `most_routes` routes through any end.
    """
    least_rest = _least_route_costs(graph, target_end, jump_frames)
    routes: list[list[Leg]] = []
    # (least cost of the whole route, order of arrival, cost so far, end, route so far)
    queue: list[tuple[float, int, float, int, tuple[Leg, ...]]]
    queue = [(least_rest[source_end], 0, 0, source_end, ())]
    visits: dict[tuple[int, bool], int] = {}
    arrival = 0
    while queue and len(routes) < most_routes:
        _, _, cost, end, route = heapq.heappop(queue)
        if route and end == target_end:
            routes.append(list(route))
            continue
        jumped = bool(route) and route[-1].kind == JUMP
        visits[end, jumped] = visits.get((end, jumped), 0) + 1
        if visits[end, jumped] > most_routes:
            continue
        choices = [] if jumped else [(int(to), JUMP, jump_frames) for to in graph.jump_targets(end)]
        if graph.ahead[end] >= 0:
            choices.append((int(graph.ahead[end]), PLAY, float(graph.segment_frames[end])))
        for to, kind, leg_cost in choices:
            leg = Leg(int(graph.ends[end]), int(graph.ends[to]), kind)
            if np.isfinite(least_rest[to]) and not (kind == JUMP and leg in route):
                arrival += 1
                least_whole = cost + leg_cost + least_rest[to]
                heapq.heappush(queue, (least_whole, arrival, cost + leg_cost, to, (*route, leg)))
    return routes


def _least_route_costs(graph: LoopGraph, target_end: int, jump_frames: float) -> Floats:
    """Return the least cost (m,) [frames] of a route from each loop end to `target_end`.

    It is inf where there is no route. jump_frames: what a jump costs.
    """
    m = len(graph.ends)
    played = np.flatnonzero(graph.ahead >= 0)
    jumped = np.repeat(np.arange(m), np.diff(graph.start))
    # A jump costs a little even if it is free: a sparse graph has no edge of cost 0.
    cost = np.r_[graph.segment_frames[played], np.full(len(jumped), max(jump_frames, _FREE))]
    # Every edge is reversed: so one search, from the target, finds the costs of all ends.
    backwards = np.r_[graph.ahead[played], graph.to], np.r_[played, jumped]
    least_cost = dijkstra(coo_array((cost, backwards), (m, m)).tocsr(), indices=target_end)
    return least_cost * (1 - 1e-9)  # not above the true cost in spite of rounding
