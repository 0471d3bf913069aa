"""Find the best set of joins between tracks, and how probable each join is."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching

from finloop.base.arrays import Floats, Reals

_DRAWS = 500  # best sets under noise; a probability is a share of them
# Candidates for a join: so many tracks that begin soonest after an end. From 16 on the zebrafish's
# trial gaps are joined the same. In a film of hours there would be too many pairs.
_SOONEST = 64

Tracks = NDArray[np.intp]
Chains = list[list[int]]
"""Tracks of one animal each, in the order of time."""


class TrackPairs(NamedTuple):
    """Pairs of tracks, by their numbers a and b (e,)."""

    a: Tracks
    b: Tracks


class TrackJoins(NamedTuple):
    """Each track's predecessor, and the probability of that join.

    predecessor (n,): its number, −1 for none; probability (n,): 1 where there is none.
    """

    predecessor: Tracks
    probability: Floats


def successor_pairs(
    start: Reals, stop: Reals, segment: Tracks, most_successors: int = _SOONEST
) -> TrackPairs:
    """Return pairs of each track with the tracks that begin soonest after its end.

    start, stop (n,): first and last frame of each track; segment (n,): its part of the film between
    cuts, ascending with the frames. In a pair, `a` is the earlier track. most_successors: how many
    a track is paired with at most.
    """
    order = np.argsort(start, kind="stable")
    first_after = np.searchsorted(start[order], stop, side="right")  # places in `order`
    segment_end = np.searchsorted(segment[order], segment, side="right")
    return _pair_with_ranges(
        order, first_after, np.minimum(segment_end, first_after + most_successors)
    )


def simultaneous_pairs(start: Reals, stop: Reals) -> TrackPairs:
    """Return all pairs a < b of tracks that have a frame in common.

    start, stop (n,): first and last frame of each track.
    """
    order = np.argsort(start, kind="stable")
    next_to_begin = np.argsort(order) + 1  # place in `order` of the track that begins after each
    stops = np.searchsorted(start[order], stop, side="right")
    a, b = _pair_with_ranges(order, next_to_begin, stops)
    return TrackPairs(np.minimum(a, b), np.maximum(a, b))


def _pair_with_ranges(order: Tracks, low: Tracks, high: Tracks) -> TrackPairs:
    """Return pairs of each track k with all tracks in order[low[k]:high[k]]."""
    partners = [order[first:stop] for first, stop in zip(low, high, strict=True)]
    counts = [len(tracks) for tracks in partners]
    return TrackPairs(
        np.repeat(np.arange(len(order)), counts), np.concatenate([order[:0], *partners])
    )


def find_best_joins(
    tracks: int, pairs: TrackPairs, log_ratio: Floats, stranger_probability: float,
    least_probability: float, rng: np.random.Generator,
) -> TrackJoins:  # fmt: skip
    """Return the most probable joins between tracks, and the probability of each.

    log_ratio (e,): log(probability of one animal / of two), for each of the `pairs`; only these can
    be joined. stranger_probability: that an animal comes or goes. Joins less probable than
    `least_probability` are left out.

    The probability of a join is its share of the best sets when all scores are disturbed by noise
    (Papandreou and Yuille, Perturb-and-MAP random fields, ICCV 2011). The noise of a join is the
    mean of two Gumbel variables, one for each of its tracks.
    """
    search = _JoinSearch(pairs, tracks)
    no_join = np.full((2, tracks), np.log(stranger_probability))
    predecessor = search.find_best(log_ratio, no_join)
    draws_with_join = np.zeros(tracks)
    for _ in range(_DRAWS):
        noise = rng.gumbel(size=(2, len(log_ratio))).mean(0)
        drawn = search.find_best(log_ratio + noise, no_join + rng.gumbel(size=no_join.shape))
        draws_with_join += predecessor == drawn
    probability = np.where(predecessor >= 0, draws_with_join / _DRAWS, 1.0)
    is_kept = probability >= least_probability
    return TrackJoins(np.where(is_kept, predecessor, -1), np.where(is_kept, probability, 1.0))


def join_in_passes(
    tracks: int,
    score_pairs: Callable[[Chains], tuple[TrackPairs, Floats]],
    sure_probability: float,
    find_joins: Callable[[int, TrackPairs, Floats], TrackJoins],
) -> TrackJoins:
    """Return the joins between tracks, found in several passes, the most certain first.

    Tracks that a join of at least `sure_probability` connects are one chain in the next pass: a
    chain shows more of an animal, and fewer ends stay open. The pass that finds no such join is the
    last; all its joins are accepted. score_pairs: returns pairs of chains and the log ratio of
    each; find_joins: returns the best joins of a number of chains, from these pairs and ratios.
    """
    predecessor, probability = np.full(tracks, -1), np.ones(tracks)
    chains: Chains = [[track] for track in range(tracks)]
    while True:
        joins = find_joins(len(chains), *score_pairs(chains))
        is_join = joins.predecessor >= 0
        is_sure = is_join & (joins.probability >= sure_probability)
        accepted = is_sure if is_sure.any() else is_join
        first = np.array([chain[0] for chain in chains], np.intp)
        last = np.array([chain[-1] for chain in chains], np.intp)
        predecessor[first[accepted]] = last[joins.predecessor[accepted]]
        probability[first[accepted]] = joins.probability[accepted]
        if not is_sure.any():
            return TrackJoins(predecessor, probability)
        chains = _chain_tracks(predecessor)


def _chain_tracks(predecessor: Tracks) -> Chains:
    """Return chains of joined tracks, from each track's predecessor (n,); −1 is none."""
    successor = np.full(len(predecessor), -1)
    successor[predecessor[predecessor >= 0]] = np.flatnonzero(predecessor >= 0)
    chains: Chains = [[int(track)] for track in np.flatnonzero(predecessor < 0)]
    for chain in chains:
        while (track := int(successor[chain[-1]])) >= 0:
            chain.append(track)
    return chains


class _Component(NamedTuple):
    """A group of tracks that pairs connect, and its assignment problem as a sparse matrix.

    A row is the end of a track. Column k is the start of track k; column m + k stands for the end
    of track k without a join.
    """

    tracks: Tracks  # (m,) their numbers in the film
    entries: slice  # of the matrix, among those of all components
    columns: Tracks  # of the entries, row by row: the `indices` of a CSR matrix
    row_starts: Tracks  # (m + 1,) first entry of each row: its `indptr`


class _JoinSearch:
    """Finds the set of joins with the highest score, one assignment problem per component.

    A component is a group of tracks that pairs connect. That is faster than one assignment of all
    tracks at once.
    """

    def __init__(self, pairs: TrackPairs, tracks: int) -> None:
        self._starts, self._tracks = pairs.b, tracks
        links = coo_array((np.ones(len(pairs.a)), pairs), (tracks, tracks))
        component = connected_components(links, directed=False)[1]  # of each track
        size = np.bincount(component)
        place = pd.Series(component).groupby(component).cumcount().to_numpy()  # in its component
        members = np.split(np.argsort(component, kind="stable"), np.cumsum(size)[:-1])
        # Entries of the matrices, in rows of ends and columns of starts: a join of each pair, and
        # for each track an end without a join; sorted by component, row and column.
        end = np.append(pairs.a, np.arange(tracks))
        column = np.append(place[pairs.b], size[component] + place)
        self._order = np.lexsort((column, place[end], component[end]))
        end, column = end[self._order], column[self._order]
        bounds = np.searchsorted(component[end], np.arange(len(size) + 1))
        self._components = [
            _Component(
                own, slice(low, high), column[low:high],
                np.searchsorted(place[end[low:high]], np.arange(len(own) + 1)),
            )
            for own, low, high in zip(members, bounds[:-1], bounds[1:], strict=True)
            if len(own) > 1
        ]  # fmt: skip

    def find_best(self, score: Floats, no_join: Floats) -> Tracks:
        """Return each track's predecessor (n,) in the joins with the highest score; −1 is none.

        score (e,): of the pairs; no_join (2, n): score of each track's end, and of its start,
        without a join.
        """
        # Rows are ends; columns are starts, and for each end one more, without a join. The score of
        # all starts without a join is a constant, from which a join takes its own start's away.
        weight = np.append(score - no_join[1, self._starts], no_join[0])[self._order]
        # The solver wants costs above 0. Every end has one entry: a constant changes no assignment.
        cost = weight.max() + 1 - weight
        predecessor = np.full(self._tracks, -1)
        for tracks, entries, columns, row_starts in self._components:
            m = len(tracks)
            graph = csr_array((cost[entries], columns, row_starts), (m, 2 * m))
            ends, starts = min_weight_full_bipartite_matching(graph)
            is_join = starts < m
            predecessor[tracks[starts[is_join]]] = tracks[ends[is_join]]
        return predecessor
