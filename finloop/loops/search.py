"""Video loops: pairs of similar frames between which the film can jump (fish paper §4.1).

A loop (a, b) is two rows of the feature table, a < b. It allows two jumps: from row a − 1 to b
instead of a, and from row b − 1 to a instead of b. The cost of a jump is D(a, b), the distance of
the film's next frame from the frame that replaces it.

Glossary: D the distance of Eq. 5; *filtered* D the mean of D along the diagonal, which is small
only if two fish also move alike; *step* the median of D between consecutive frames.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from finloop.base.arrays import Floats, Ints, Mask
from finloop.base.errors import FinloopError
from finloop.base.kernel import kernel
from finloop.base.schema import Column, Schema, columns
from finloop.distance.map import MapFacts
from finloop.distance.picture import typical_lengths_px
from finloop.features.current import places_through_water
from finloop.features.table import infer_delta_frames, wrap_deg
from finloop.loops.graph import (
    LoopGraph,
    can_play_for_ever,
    renumber_groups,
    rows_of_largest_component,
)
from finloop.loops.settings import LoopsSettings

TRAVEL = 0.05  # body lengths from which a fish has a direction of travel
RESULTANT = 0.3  # length of the mean heading vector; with less, the fish turned round


class NoLoopsError(FinloopError):
    """The film has no loops; the message names the parameter to change."""


LOOPS = Schema(
    Column("loop", "int32", "1"),
    *columns("int32", "row", "a", "b"),
    *columns("float32", "1", "distance", "filtered"),
    Column("length_s", "float64", "s", nullable=True),
    Column("group", "int32", "1"),
)

Rows = NDArray[np.integer]


class SparseDistanceMap(NamedTuple):
    """A sparse distance map: row i has columns `j[start[i]:start[i + 1]]`, ascending, all > i."""

    start: Ints
    j: NDArray[np.int32]
    distance: NDArray[np.float32]


def to_sparse_map(table: pd.DataFrame, rows: int) -> SparseDistanceMap:
    """Convert a table of pairs of rows to a sparse distance map.

    table: columns i, j (feature rows), distance, sorted by i, then by j; rows: how many
    feature rows there are.
    """
    start = np.searchsorted(table["i"].to_numpy(), np.arange(rows + 1))
    # Copies: a kernel is compiled anew for arrays that are read-only, as those of a file are.
    return SparseDistanceMap(
        start, np.array(table["j"], np.int32), np.array(table["distance"], np.float32)
    )


def find_video_loops(
    pairs: SparseDistanceMap, features: pd.DataFrame, rate_hz: float, step_median: float,
    settings: LoopsSettings,
) -> tuple[pd.DataFrame, dict[str, float]]:  # fmt: skip
    """Find a film's video loops (§4.1, Figs. 8, 12, 13), best first, and count what tests left.

    pairs: distances D of comparable rows (Eq. 6); step_median: the film's median step, in the unit
    of D. The loops have the columns of `LOOPS`; the counts are those of `find_loop_candidates`.
    NoLoopsError if there is none.
    """
    most_distance = settings.distance_threshold * step_median
    candidates, counts = find_loop_candidates(pairs, features, most_distance, settings)
    loops = candidates[~candidates["improper"]]
    if loops.empty:
        raise _explain_no_loops(pairs, features, step_median, settings)
    a, b = (np.array(loops[end], np.int32) for end in "ab")
    kept = choose_best_loops(a, b, settings.max_loops_per_end)
    loops = loops[kept].reset_index(drop=True)
    track = features["track_id"].to_numpy()
    a, b = loops["a"].to_numpy(), loops["b"].to_numpy()
    loops["loop"] = np.arange(len(loops))
    loops["length_s"] = np.where(track[a] == track[b], (b - a) / rate_hz, np.nan)
    loops["group"] = group_overlapping_loops(a, b, track)
    return loops[LOOPS.names], counts


def least_loop_frames(delta_frames: int, settings: LoopsSettings) -> int:
    """Return the least number of frames between two ends of a loop in one track.

    delta_frames: Δ, the time over which motion is measured.
    """
    return max(1, round(settings.min_length_deltas * delta_frames))


def find_loop_candidates(
    pairs: SparseDistanceMap, features: pd.DataFrame, most_distance: float, settings: LoopsSettings
) -> tuple[pd.DataFrame, dict[str, float]]:
    """Find pairs of frames that look and move alike, best first, and count what each test left.

    They are local minima of filtered D, the picture distance of two frames and their neighbours.
    The table has columns a, b (feature rows, a < b), distance, filtered, improper (Fig. 13: the
    fish travels against its heading). The counts are pairs, pairs_below_threshold, minima,
    improper_dropped. pairs: picture distances D of comparable rows; most_distance: of filtered D.
    """
    track = np.array(features["track_id"], np.int32)
    weight = binomial_weights(settings.compared_neighbour_frames)
    filtered = filter_diagonals(pairs, track, weight, most_distance)
    delta = infer_delta_frames(features)
    radius = max(1, round(settings.min_deltas_between_ends * delta))
    least = least_loop_frames(delta, settings)
    minima = np.flatnonzero(find_local_minima(pairs, filtered, track, radius, least))
    a = (np.searchsorted(pairs.start, minima, side="right") - 1).astype(np.int32)
    b = pairs.j[minima]
    is_improper = find_improper_loops(a, b, features, settings.improper_angle_deg)
    table = pd.DataFrame({
        "a": a, "b": b, "distance": pairs.distance[minima], "filtered": filtered[minima],
        "improper": is_improper,
    })  # fmt: skip
    counts = {
        "pairs": float(len(pairs.j)),  # a float, so rounded when saved: its last digit varies
        "pairs_below_threshold": int(np.isfinite(filtered).sum()),
        "minima": len(minima),
        "improper_dropped": int(is_improper.sum()),
    }
    return table.sort_values(["filtered", "a", "b"], ignore_index=True), counts


def binomial_weights(n: int) -> Floats:
    """Return weights (2n + 1,), with sum 1, for the pairs along a diagonal of the distance map.

    They are binomial, so the pairs near the middle one count most.
    """
    return scipy.special.comb(2 * n, np.arange(2 * n + 1)) / 4.0**n


@kernel
def filter_diagonals(
    pairs: SparseDistanceMap, track: NDArray[np.int32], weight: Floats, most_distance: float
) -> NDArray[np.float32]:
    """Return the filtered distance of every stored pair: Σ w_k D(a+k, b+k), k = −n … n (§4.1).

    track: of every feature row; weight: w, (2 n + 1,). The value is inf where it exceeds
    `most_distance`, where one of the pairs along the diagonal is not in the map, or where one lies
    beyond the end of either track.
    """
    start, column, distance = pairs
    n, rows = len(weight) // 2, len(track)
    filtered = np.full(len(column), np.inf, np.float32)
    for a in range(n, rows - n):
        if track[a - n] != track[a] or track[a + n] != track[a]:
            continue
        for pair in range(start[a], start[a + 1]):
            b = column[pair]
            if b + n >= rows or track[b - n] != track[b] or track[b + n] != track[b]:
                continue
            total = weight[n] * distance[pair]
            for k in range(-n, n + 1):
                if k == 0 or total > most_distance:
                    continue
                first, end = start[a + k], start[a + k + 1]
                neighbour = first + np.searchsorted(column[first:end], b + k)
                if neighbour == end or column[neighbour] != b + k:
                    total = np.inf
                else:
                    total += weight[k + n] * distance[neighbour]
            if total <= most_distance:
                filtered[pair] = total
    return filtered


@kernel
def find_local_minima(
    pairs: SparseDistanceMap, filtered: NDArray[np.float32], track: NDArray[np.int32],
    radius_frames: int, least_frames: int,
) -> Mask:  # fmt: skip
    """Return a mask (pairs,) of the pairs (a, b) that are local minima of the filtered distance.

    filtered: from `filter_diagonals`; track: of every feature row. Each is the smallest within
    `radius_frames` along a and along b, inside the two tracks; of equal ones the first. In one
    track b is at least `least_frames` after a; nearer pairs are no loops, but a pair on a slope
    down to them is no minimum.
    """
    start, column = pairs.start, pairs.j
    minimum = np.zeros(len(column), np.bool_)
    for a in range(len(track)):
        for pair in range(start[a], start[a + 1]):
            b = column[pair]
            if np.isinf(filtered[pair]) or (track[a] == track[b] and b - a < least_frames):
                continue
            smallest = True
            for row in range(max(0, a - radius_frames), min(len(track), a + radius_frames + 1)):
                if track[row] != track[a]:
                    continue
                first, end = start[row], start[row + 1]
                skipped = np.searchsorted(column[first:end], b - radius_frames)  # too early ones
                for neighbour in range(first + skipped, end):
                    if column[neighbour] > b + radius_frames:
                        break
                    # Pairs are visited in order, so an equal one that is a minimum comes before.
                    less = filtered[neighbour] < filtered[pair] or (
                        filtered[neighbour] == filtered[pair] and minimum[neighbour]
                    )
                    if less and track[column[neighbour]] == track[b]:
                        smallest = False
                        break
                if not smallest:
                    break
            minimum[pair] = smallest
    return minimum


@kernel
def choose_best_loops(a: Rows, b: Rows, most_per_end: int) -> Mask:
    """Return a mask (n,) of the loops to keep so that no frame is an end of too many of them.

    a, b (n,): the loops' ends (feature rows), the best loop first.
    """
    keep, count = np.zeros(len(a), np.bool_), np.zeros(b.max() + 1, np.int32)
    for loop in range(len(a)):
        if count[a[loop]] < most_per_end and count[b[loop]] < most_per_end:
            keep[loop] = True
            count[a[loop]] += 1
            count[b[loop]] += 1
    return keep


def group_overlapping_loops(a: Rows, b: Rows, track: Rows) -> NDArray[np.int32]:
    """Return the group number (n,) of each loop; loops that overlap form a group (Fig. 12).

    a, b (n,): the loops' ends, feature rows; track: of every feature row. A loop within a track
    covers the film between its ends; one across tracks only its two ends. Group 0 has the most
    loops.
    """
    n = len(a)
    # Rows first … last that each end covers: end a all the film up to b, if that is its track.
    first = np.r_[a, b]
    last = np.r_[np.where(track[a] == track[b], b, a), b]
    order = np.lexsort((-last, first))
    # A stretch is film that overlapping loops cover; a new one begins beyond all that came before.
    reach = np.maximum.accumulate(last[order])  # the last row covered so far
    stretch_of_end = np.empty(2 * n, np.int64)
    stretch_of_end[order] = np.r_[0, np.cumsum(first[order][1:] > reach[:-1])]
    # A loop joins the stretches of its two ends; stretches that are joined form a group.
    joins = np.ones(n, np.int8), (stretch_of_end[:n], stretch_of_end[n:])
    count = int(stretch_of_end.max()) + 1
    _, group_of_stretch = connected_components(coo_array(joins, (count, count)), directed=False)
    return renumber_groups(group_of_stretch[stretch_of_end[:n]])


def _explain_no_loops(
    pairs: SparseDistanceMap, features: pd.DataFrame, step_median: float, settings: LoopsSettings
) -> NoLoopsError:
    """Return the error for a film without loops, which says what to change.

    step_median: the median natural step, in the unit of the pairs.
    """
    goal = "at least one pair of similar frames between which the film can jump"
    track = features["track_id"].to_numpy()
    longest = int(np.unique(track, return_counts=True)[1].max())
    least = least_loop_frames(infer_delta_frames(features), settings)
    if len(np.unique(track)) == 1 and longest <= least:
        return NoLoopsError(
            f"one track of {longest} frames, and the ends of a loop are at least {least} apart "
            f"(loops.min_length_deltas {settings.min_length_deltas:g} Δ)",
            goal,
            "take a longer clip, or a smaller loops.min_length_deltas",
        )
    if len(pairs.j) == 0:
        return NoLoopsError(
            "no video loops: the distance map holds no pair of frames at all",
            goal,
            "let more be compared: a greater distance.max_distance_steps or "
            "distance.motion_area_threshold, or distance.frame_of_reference=body; or take a longer "
            "clip",
        )
    at_any_distance, _ = find_loop_candidates(pairs, features, np.inf, settings)
    at_any_distance = at_any_distance[~at_any_distance["improper"]]
    if len(at_any_distance):
        least_steps = at_any_distance["filtered"].iloc[0] / step_median
        enough = np.ceil(100 * least_steps) / 100  # rounded up to two digits
        return NoLoopsError(
            f"no video loops with loops.distance_threshold {settings.distance_threshold:g} "
            "(median natural steps)",
            goal,
            f"loops.distance_threshold={enough:g} would have given the first; natural steps are 1",
        )
    return NoLoopsError(
        f"no video loops at any threshold: of {len(pairs.j)} pairs of similar frames none passes "
        f"loops.min_length_deltas {settings.min_length_deltas:g}, "
        f"loops.compared_neighbour_frames {settings.compared_neighbour_frames}, "
        f"loops.improper_angle_deg {settings.improper_angle_deg:g}",
        goal,
        "a smaller loops.min_length_deltas, loops.compared_neighbour_frames=0, "
        "loops.improper_angle_deg=180, a greater distance.max_distance_steps; or take a "
        "longer clip",
    )


# --- Fig. 13


def find_improper_loops(a: Rows, b: Rows, features: pd.DataFrame, most_deg: float) -> Mask:
    """Return a mask (n,) of the improper loops: the fish travels against its heading (Fig. 13).

    a, b (n,): the loops' ends, feature rows. Travel and heading differ by more than `most_deg` over
    the loop, at its end a or at its end b: head and tail may be swapped there, or the fish drifts.
    """
    angles = measure_travel(a, b, features).off_deg
    return np.asarray((angles > most_deg).any(axis=-1))


class LoopTravel(NamedTuple):
    """Directions of travel and headings of n loops: between their ends, at end a and at end b.

    travel_deg, heading_deg (n, 3): anticlockwise as seen; travel is NaN where there is none.
    """

    travel_deg: Floats
    heading_deg: Floats

    @property
    def off_deg(self) -> Floats:
        """Return the angle (n, 3) [°] between travel and heading, 0 … 180; NaN without travel."""
        return np.abs(wrap_deg(self.travel_deg - self.heading_deg))


def measure_travel(a: Rows, b: Rows, features: pd.DataFrame) -> LoopTravel:
    """Measure in which direction fish travel along n loops, and where they head (Fig. 13).

    a, b (n,): the loops' ends, feature rows. Between its ends, a loop within one track travels from
    a to b, whatever route the fish takes; its heading is the mean over it (travel is NaN where the
    fish turns round). At either end the fish travels from Δ/2 before to Δ/2 after it. A fish that
    moved less than `TRAVEL` body lengths has no direction of travel.
    """
    track = features["track_id"].to_numpy()
    x, y = places_through_water(features).T
    place = x - 1j * y  # y up, so that angles are anticlockwise as seen
    length = typical_lengths_px(features).to_numpy(float)
    heading_vector = np.exp(1j * np.radians(features["heading_deg"].to_numpy(float)))

    def direction_of_travel(low: Rows, high: Rows, known: Mask) -> Floats:
        """Return the direction (…) [°] from low to high rows, anticlockwise; NaN if unknown.

        It is unknown where `known` says so, or where the fish hardly moved.
        """
        displacement = place[high] - place[low]
        known = known & (np.abs(displacement) >= TRAVEL * length[low])
        return np.where(known, np.degrees(np.angle(displacement)), np.nan)

    # Between the ends.
    heading_sum = np.r_[0, np.cumsum(heading_vector)]
    mean_heading = (heading_sum[b + 1] - heading_sum[a]) / (b + 1 - a)
    known = (track[a] == track[b]) & (np.abs(mean_heading) >= RESULTANT)
    travels = [direction_of_travel(a, b, known)]
    # At either end.
    delta = infer_delta_frames(features)
    first = np.searchsorted(track, track)  # tracks lie one after another, their numbers rise
    last = np.searchsorted(track, track, side="right") - 1
    for end in (a, b):
        low = np.maximum(end - delta // 2, first[end])
        high = np.minimum(low + delta, last[end])
        travels.append(direction_of_travel(low, high, np.ones(len(end), bool)))
    headings = [
        np.degrees(np.angle(vector))
        for vector in (mean_heading, heading_vector[a], heading_vector[b])
    ]
    return LoopTravel(np.stack(travels, axis=-1), np.stack(headings, axis=-1))


# --- metrics


def loop_metrics(
    loops: pd.DataFrame, counts: dict[str, float], graph: LoopGraph, features: pd.DataFrame,
    facts: MapFacts, compared: Ints,
) -> dict[str, float]:  # fmt: skip
    """Return the metrics of a film's loops, by their names in metrics.json.

    counts: from `find_video_loops`; facts: median and 95th percentile of the film's natural steps;
    compared: rows of the distance map, of which the shares of the film are given. A seam is the
    picture distance of a jump in median steps. A component of the graph counts if the film can play
    in it for ever. From a dead end every route leads to the end of a track.
    """
    track = features["track_id"].to_numpy()
    seam = loops["distance"].to_numpy(float) / facts.step_median
    within = loops["length_s"].notna()
    largest = rows_of_largest_component(graph, len(features))
    sizes = loops["group"].value_counts()
    return {
        **counts,
        "loops": len(loops),
        "loops_within_tracks": int(within.sum()),
        "length_median_s": float(loops["length_s"].median()),
        "ends": len(graph.ends),
        "loops_per_end_max": int(np.diff(graph.start).max()),
        "groups": len(sizes),
        "largest_group_pct": float(100 * sizes.max() / len(loops)),
        "components": int(np.unique(graph.component[graph.cyclic]).size),
        "largest_component_film_pct": float(100 * largest[compared].mean()),
        "largest_component_tracks": int(np.unique(track[largest]).size),
        "dead_ends": int((~graph.endless).sum()),
        "endless_film_pct": float(100 * can_play_for_ever(graph, track)[compared].mean()),
        "seam_median_steps": float(np.median(seam)),
        "seam_p95_steps": float(np.quantile(seam, 0.95)),
        "seams_above_p95_of_natural_pct": float(100 * (loops["distance"] > facts.step_p95).mean()),
    }
