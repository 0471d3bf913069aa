"""The motion graph: film played forward along its tracks, and across at its loops (Figs. 8, 10).

A fish is at a row of the feature table, drawn `rotation_deg` anticlockwise of the film. Playing
forward moves it as the fish of the film moved, turned by that angle. At the end of a loop another
row may be shown instead. Where pictures are compared headed right (BODY), the heading goes on
across a jump, so `rotation_deg` changes; where they are compared as filmed (FILM), it stays.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from finloop.animate.arena import Tank
from finloop.animate.kinematics import wrap
from finloop.animate.motion import MotionStatistics
from finloop.animate.state import Fish
from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.kernel import kernel, kernel_part, leaf_kernel
from finloop.distance.picture import BODY, typical_lengths_px
from finloop.edit.schema import FILM
from finloop.features.current import places_through_water
from finloop.forecast.sampling import Sampler, Similar
from finloop.loops.graph import LoopGraph, find_endless_rows

ROW = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("dx", "f8"), ("dy", "f8"), ("heading", "f8"), ("speed", "f8"),
        ("area", "f8"), ("scale", "f8"), ("rarity_sum", "f8"), ("lag_sum", "f8"),
        ("jump_slot", "i4"), ("has_next", "?"), ("recurrent", "?"),
    ],
    align=True,
)  # fmt: skip
"""A row of the feature table to swim by.

x, y: px of the row's track at the drawn size; dx, dy: px to the next row, as filmed; heading in
degrees; speed in body lengths/s; area: relative motion area; scale: drawn size / filmed size;
rarity_sum: ticks that showing all rows up to it costs; lag_sum: ticks by which all rows up to it
lag behind the film's mean speed; jump_slot: number of the row among those that jumps can replace,
−1 if none can; has_next: whether there is a next row to play; recurrent: whether the film can play
on from the row for ever."""


class MotionGraph(NamedTuple):
    """The rows of the film (n,), of dtype `ROW`, and the jumps between them; kernels take it whole.

    start, to, seam: instead of the row of jump slot k, rows `to[start[k]:start[k + 1]]` can be
    shown, after which the film can play for ever; seam: their discontinuity in natural steps, the
    film's median steps, rising for each row. jumps_keep_heading: whether a jump keeps the fish's
    heading, by turning the film, or else keeps the film's rotation. filmed_count: how many rows are
    the film's own; row filmed_count + i is the mirror image of row i.
    """

    rows: NDArray[np.void]
    start: NDArray[np.int32]
    to: NDArray[np.int32]
    seam: Floats
    jumps_keep_heading: bool
    filmed_count: int

    def __getattr__(self, name: str) -> NDArray[Any]:
        """Return a column (n,) of the rows, by its name in `ROW`."""
        if name in (ROW.names or ()):
            return self.rows[name]
        raise AttributeError(name)

    def can_play_on(self, rows: NDArray[np.integer]) -> Mask:
        """Return after which of rows (k,) the film can play on for ever, as a mask (k,)."""
        goes_on: Mask = self.has_next[rows].copy()
        goes_on[goes_on] = self.recurrent[rows[goes_on] + 1]
        return goes_on

    @property
    def lasting_rows(self) -> Ints:
        """Return the rows (k,) after which the film can play on for ever."""
        return np.flatnonzero(self.has_next[:-1] & self.recurrent[1:])

    def keep_jumps_to(self, allowed: Mask) -> "MotionGraph":
        """Return the graph with only its jumps to the rows that `allowed` (n,) marks."""
        start, to, seam = _jumps_to_rows(allowed, self.start, self.to, self.seam)
        return self._replace(start=start, to=to, seam=seam)


@kernel
def _jumps_to_rows(allowed, start, to, seam):  # type: ignore[no-untyped-def]
    """Return start, to and seam of a `MotionGraph` with only its jumps to allowed rows (n,)."""
    new_start, new_to, new_seam = np.empty_like(start), np.empty_like(to), np.empty_like(seam)
    kept = 0
    for slot in range(len(start) - 1):
        new_start[slot] = kept
        for jump in range(start[slot], start[slot + 1]):
            if allowed[to[jump]]:
                new_to[kept], new_seam[kept] = to[jump], seam[jump]
                kept += 1
    new_start[-1] = kept
    return new_start, new_to[:kept], new_seam[:kept]


class Jumps(NamedTuple):
    """The jumps between m rows: those of the film, or those and then their mirror images.

    jump_slot (m,): number of a row among those that jumps can replace, −1 if none can; instead of
    the row of slot k rows `to[start[k]:start[k + 1]]` can be shown; seam: their discontinuity in
    natural steps, rising for each row.
    """

    jump_slot: NDArray[np.int32]
    start: NDArray[np.int32]
    to: NDArray[np.int32]
    seam: Floats


def loop_jumps(loops: LoopGraph, row_count: int, natural_step: float) -> Jumps:
    """Return the jumps of the paper's video loops (Fig. 10): between the ends of loops.

    row_count: number of rows of the film; natural_step: median distance between one picture and the
    next, by which distances are divided.
    """
    jump_slot = np.full(row_count, -1, np.int32)
    jump_slot[loops.ends] = np.arange(len(loops.ends))
    return Jumps(
        jump_slot, loops.start, loops.ends[loops.to], loops.distance.astype(float) / natural_step
    )


def index_jumps(jumps: pd.DataFrame, row_count: int) -> Jumps:
    """Index a table of jumps by row: return them as arrays, those of a row side by side.

    jumps: table with the columns of `JUMPS`, already sorted by row and then by seam; row_count:
    number n of rows of the film. If some jumps lead to mirror images, those from the mirror images,
    rows n … 2 n − 1, are included.
    """
    source, to, to_mirror, seam = (
        jumps[name].to_numpy() for name in ("row", "to", "mirrored", "seam")
    )
    sides = 1 + bool(to_mirror.any())
    if sides == 2:  # a mirror image jumps to the mirror image of where its row jumps
        source = np.concatenate([source, source + row_count])
        to = np.concatenate([to + row_count * to_mirror, to + row_count * ~to_mirror])
        seam = np.tile(seam, 2)
    # The jumps of a row lie together; the first of each begins a slot.
    first = np.flatnonzero(np.append(len(source) > 0, source[1:] != source[:-1]))
    jump_slot = np.full(sides * row_count, -1, np.int32)
    jump_slot[source[first]] = np.arange(len(first))
    start = np.append(first, len(source)).astype(np.int32)
    return Jumps(jump_slot, start, to.astype(np.int32), seam.astype(float))


def motion_graph(
    features: pd.DataFrame, jumps: Jumps, motion: MotionStatistics, reference: str, barred: Mask,
    rarity_sum: Floats,
) -> MotionGraph:  # fmt: skip
    """Return the motion graph of a feature table (n rows) and its jumps.

    motion: gives Δ and the drawn body length; reference: BODY where a jump keeps the heading, FILM
    where it keeps the rotation; barred (n,): rows that must not be shown; rarity_sum (n,): ticks
    that showing all rows up to each costs. Where `jumps` has mirror images, row n + i is that of
    row i: the film upside down. Jumps to barred rows are left out, and those after which the film
    would have to stop.
    """
    n = len(features)
    scale = motion.body_length_px / typical_lengths_px(features).to_numpy(float)
    places = places_through_water(features) * scale[:, None]
    track_ids = features["track_id"].to_numpy()
    has_next = rows_with_next(track_ids, barred)
    steps = np.zeros((n, 2))
    steps[:-1] = np.diff(places, axis=0)
    steps[~has_next] = 0.0
    rows = np.zeros(n, ROW)
    rows["x"], rows["y"] = places.T
    rows["dx"], rows["dy"] = steps.T
    rows["heading"], rows["area"] = features["heading_deg"], features["motion_area_rel"]
    speeds_px = _speeds_over_delta(places, track_ids, motion.delta)
    rows["speed"] = speeds_px * motion.rate_hz / motion.body_length_px
    rows["scale"], rows["has_next"], rows["rarity_sum"] = scale, has_next, rarity_sum
    rows["lag_sum"][1:] = row_lags(rows).cumsum()[:-1]
    if len(jumps.jump_slot) > n:
        rows = np.concatenate([rows, _mirror_rows(rows)])
    rows["jump_slot"] = jumps.jump_slot
    graph = MotionGraph(rows, jumps.start, jumps.to, jumps.seam, reference == BODY, n)
    # Columns of their own, as elsewhere: for a view of `rows` numba would compile it once more.
    has_next, jump_slot = rows["has_next"].copy(), rows["jump_slot"].copy()
    rows["recurrent"] = find_endless_rows(has_next, jump_slot, graph.start, graph.to)
    can_lead = rows["has_next"] & np.append(rows["recurrent"][1:], False)
    return graph.keep_jumps_to(can_lead)


def rows_with_next(track_ids: Ints, barred: Mask) -> Mask:
    """Return after which rows (n,) the next is of the same track, and both may be shown.

    track_ids (n,): rising; barred (n,): rows that must not be shown.
    """
    has_next = np.append(track_ids[1:] == track_ids[:-1], False)
    return np.asarray(has_next & ~barred & ~np.append(barred[1:], True))


def random_fish_in_film(film: MotionGraph, tank: Tank, rng: np.random.Generator) -> Fish:
    """Return a fish at a random place, in a row after which the film can play on for ever.

    Where jumps keep the heading, the row is turned by a random angle.
    """
    x, y = tank.random_point(rng)
    row = int(rng.choice(film.lasting_rows))
    rotation_deg = float(rng.uniform(-180, 180)) if film.jumps_keep_heading else 0.0
    heading = float(wrap(film.heading[row] + rotation_deg))
    return Fish(x, y, heading, speed=0.0, state=FILM, sprite=-1, row=row, rotation_deg=rotation_deg)


@leaf_kernel
def row_can_play_on(rows, row):  # type: ignore[no-untyped-def]
    """Return whether the film can play on for ever after showing a row. rows (n,): dtype `ROW`."""
    return rows[row].has_next and rows[row + 1].recurrent


@kernel
def drawn_rotations(film_rows: NDArray[np.void], rows: Ints, trajectory: Floats) -> Floats:
    """Return by how many degrees (n,) each row is turned when a fish shows it on its trajectory.

    film_rows: all rows, of dtype `ROW`; rows (n,): those shown; trajectory (n, 3): x, y px, heading
    in degrees.
    """
    rotations_deg = np.empty(len(trajectory))
    for t in range(len(trajectory)):
        rotations_deg[t] = wrap(trajectory[t, 2] - film_rows[rows[t]].heading)
    return rotations_deg


@kernel_part
def jump_range(film: MotionGraph, row: int):  # type: ignore[no-untyped-def]
    """Return the first jump that can replace a row, and one past the last; 0, 0 for none."""
    slot = film.rows[row].jump_slot
    if slot >= 0:
        return np.int64(film.start[slot]), np.int64(film.start[slot + 1])
    return np.int64(0), np.int64(0)


def mean_step_px(rows: NDArray[np.void]) -> float:
    """Return the mean distance, px, that a fish moves from row to row; 1 if there is none.

    rows (n,): of dtype `ROW`.
    """
    steps = np.hypot(rows["dx"], rows["dy"])[rows["has_next"]]
    return max(float(steps.mean()), 1e-9) if len(steps) else 1.0


def farthest_distances(film: MotionGraph, most_ticks: int) -> Floats:
    """Return the largest distances (most_ticks + 1,), px, that filmed fish cover in 0, 1 … ticks.

    They are computed for powers of two; in between each is the distance of the next power.
    """
    rows, farthest_px = film.rows[: film.filmed_count], np.zeros(most_ticks + 1)
    ticks_left, ticks = ticks_to_film_end(rows["has_next"]), 1  # ticks: a power of two
    while ticks < 2 * most_ticks:
        first = np.flatnonzero(ticks_left >= ticks)
        offset = (rows[axis][first + ticks] - rows[axis][first] for axis in "xy")
        farthest_px[ticks // 2 + 1 : ticks + 1] = np.hypot(*offset).max(initial=0.0)
        ticks *= 2
    return np.maximum.accumulate(farthest_px)


def row_lags(rows: NDArray[np.void]) -> Floats:
    """Return by how many ticks (n,) each row's step falls behind one at the film's mean speed.

    rows (n,): of dtype `ROW`. 0 where no row is next; < 0 where the fish is faster than the mean.
    """
    lags = 1 - np.hypot(rows["dx"], rows["dy"]) / mean_step_px(rows)
    return np.asarray(np.where(rows["has_next"], lags, 0.0))


def _mirror_rows(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Return the mirror images of rows (n,), dtype `ROW`: the film upside down."""
    mirrored = rows.copy()
    for name in ("y", "dy", "heading"):
        mirrored[name] *= -1
    return mirrored


def prediction_graph(film: MotionGraph, sampler: Sampler) -> MotionGraph:
    """Return the motion graph whose only jumps are to rows that the forecast finds similar.

    Its rows are those of the film and its mirror images that the sampler knows; the jumps have no
    discontinuity.
    """
    n = min(len(film.rows), len(sampler.usable))
    rows, start = film.rows[:n].copy(), sampler.start[: n + 1].astype(np.int32)
    # Usable rows, which a fish can follow, and similar rows lead on for ever (`remove_dead_ends`).
    has_similar = np.diff(start) > 0
    rows["has_next"] = sampler.usable[:n]
    rows["has_next"][-1:] = False
    rows["recurrent"] = sampler.usable[:n] | has_similar
    rows["jump_slot"] = np.where(has_similar, np.arange(n), -1)
    to = sampler.to[: start[-1]]
    return film._replace(
        rows=rows, start=start, to=to, seam=np.zeros(len(to)), jumps_keep_heading=True
    )


def ticks_to_film_end(has_next: Mask) -> NDArray[np.int64]:
    """Return for how many ticks (n,) the film plays on from each row, until `has_next` is False."""
    last_rows = np.append(np.flatnonzero(~has_next[:-1]), len(has_next) - 1)
    rows = np.arange(len(has_next))
    return np.asarray(last_rows[np.searchsorted(last_rows, rows)] - rows)


def _speeds_over_delta(places_px: Floats, track_ids: NDArray[np.int32], delta: int) -> Floats:
    """Return the speed (n,) of each row, px per tick, over Δ centred on it.

    At the ends of a track it is measured over the part of Δ within the track. places_px (n, 2): x,
    y; track_ids (n,): rising; delta: Δ in ticks.
    """
    edges = np.flatnonzero(np.diff(track_ids, prepend=-1, append=-1))
    rows_of_track = np.diff(edges)
    first = np.repeat(edges[:-1], rows_of_track)
    last = np.repeat(edges[1:] - 1, rows_of_track)
    rows = np.arange(len(track_ids))
    begin, end = np.maximum(rows - delta // 2, first), np.minimum(rows + delta - delta // 2, last)
    return np.hypot(*(places_px[end] - places_px[begin]).T) / np.maximum(end - begin, 1)


def remove_dead_ends(sampler: Sampler, has_next: Mask, at_rest: Mask) -> Sampler:
    """Return a forecast's sampler with only those rows from which a fish can swim for ever.

    They are the largest strongly connected component of the graph, and all rows that lead there;
    rows that only lead to an end of the film, or to a cycle of few frames, are left out. has_next
    (m,): which rows of a `MotionGraph` the film goes on from; at_rest (n,): at which of the film's
    own rows the fish rests. Rows that must not be shown, and missing mirror images, are left out.
    """
    n, m = len(has_next), len(sampler.usable)
    shown = np.zeros(m + 1, bool)
    shown[:n] = sampler.usable[:n] & has_next[:m]
    leads = np.append(_lead_to_largest_component(shown, sampler.start, sampler.to), False) & shown
    usable = leads[:-1] & leads[1:]  # a usable row is followed by showing the next one
    start, to = filter_edges(leads, usable, sampler.start, sampler.to)
    rests = np.resize(at_rest, m)  # mirror images rest, too
    return sampler._replace(usable=usable, start=start, to=to, rests=rests)


def _lead_to_largest_component(shown: Mask, start: Ints, to: Similar) -> Mask:
    """Return which rows (m,) are in the largest strongly connected component, or lead to it.

    A row leads to the next one, and to those after its similar rows. shown (m + 1,): rows that may
    be used; the rows similar to row k are `to[start[k]:start[k + 1]]`.
    """
    m = len(shown) - 1
    is_followed = shown[:-1] & shown[1:]
    start, to = filter_edges(shown, is_followed, start, to)
    rows = np.flatnonzero(is_followed)
    # The first edge of a row that is followed leads to the next row. SciPy takes float64 and int32
    # as they are, without a copy.
    first_edge = np.append(0, np.cumsum(np.diff(start) + is_followed)).astype(np.int32)
    plays_on = np.zeros(first_edge[-1], bool)
    plays_on[first_edge[rows]] = True
    next_rows = np.empty(len(plays_on), np.int32)
    next_rows[plays_on], next_rows[~plays_on] = rows + 1, to + 1
    graph = csr_array((np.ones(len(next_rows)), next_rows, first_edge), shape=(m, m))
    component = connected_components(graph, connection="strong")[1]
    leads = np.asarray(component == np.bincount(component).argmax())
    _mark_rows_that_lead(leads, first_edge, next_rows)
    return leads


@kernel
def _mark_rows_that_lead(marked, first_edge, to):  # type: ignore[no-untyped-def]
    """Mark all rows that lead to marked rows, directly or by others; marked (m,): changed.

    Row k leads to rows `to[first_edge[k]:first_edge[k + 1]]`. Rows are swept from the last to the
    first, as most lead to the next one, until nothing changes.
    """
    has_changed = True
    while has_changed:
        has_changed = False
        for row in range(len(marked) - 1, -1, -1):
            if marked[row]:
                continue
            for edge in range(first_edge[row], first_edge[row + 1]):
                if marked[to[edge]]:
                    marked[row] = has_changed = True
                    break


def filter_edges(leads: Mask, usable: Mask, start: Ints, to: Similar) -> tuple[Ints, Similar]:
    """Return the edges from rows marked in `leads` to usable rows, as start (m + 1,) and to (e,).

    leads (m + 1,), usable (m,): marks of rows; start, to: the edges of row k lead to rows
    `to[start[k]:start[k + 1]]`.
    """
    counts = np.zeros(len(start), np.int64)
    _copy_kept_edges(leads, usable, start, to, counts[1:], to[:0])  # only count them
    new_start = np.cumsum(counts)
    new_to = np.empty(new_start[-1], to.dtype)
    _copy_kept_edges(leads, usable, start, to, np.empty(len(usable), np.int64), new_to)
    return new_start, new_to


@kernel
def _copy_kept_edges(leads, usable, start, to, counts, new_to):  # type: ignore[no-untyped-def]
    """Write how many edges each row keeps to `counts`, and where they lead to `new_to`.

    leads (m + 1,): rows whose edges count; usable (m,): rows that edges may lead to; start, to: the
    edges of row k lead to rows `to[start[k]:start[k + 1]]`. `new_to` is filled as far as it is
    long.
    """
    kept = 0
    for row in range(len(usable)):
        kept_before = kept
        if leads[row]:
            for edge in range(start[row], start[row + 1]):
                if usable[to[edge]]:
                    if kept < len(new_to):
                        new_to[kept] = to[edge]
                    kept += 1
        counts[row] = kept - kept_before
