"""Find which animal each track of a film shows, with its probability."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints
from finloop.base.schema import Column, Schema, columns, lists_to_array, lists_to_points
from finloop.base.stretches import spread_rows
from finloop.distance.picture import BODY
from finloop.distance.reel import Reel
from finloop.features.head import begins_at_tail
from finloop.features.table import track_slices
from finloop.identity import appearance, motion
from finloop.identity.joins import (
    Chains,
    TrackJoins,
    TrackPairs,
    find_best_joins,
    join_in_passes,
    simultaneous_pairs,
    successor_pairs,
)
from finloop.identity.settings import IdentitySettings

IDENTITIES = Schema(
    *columns("int32", "1", "track_id", "identity"),
    Column("after_track", "int32", "1"),  # the same animal's previous track; −1: none
    Column("gap_frames", "int32", "1"),  # from the end of that one; 0 where there is none
    Column("probability", "float32", "1"),  # that it is that animal; 1 where there is none before
)
_LEAST_HALF = 10  # least frames on either side of a trial gap
_EVERY = 4  # a backbone's points from one measured width to the next
USED = ["backbone_x_px", "backbone_y_px", "half_width_px", "length_px", "area_px", "contrast"]


@dataclass(frozen=True)
class IdentityEvidence:
    """The evidence by which tracks of a film are joined to animals.

    measures (n, d): of every row's body. segment (n,): the part of the film between two cuts;
    tracks of different parts are never joined.
    """

    reel: Reel
    measures: Floats
    segment: NDArray[np.intp]
    settings: IdentitySettings


def collect_evidence(
    reel: Reel, tracks: pd.DataFrame, cuts: Sequence[int], p: IdentitySettings
) -> IdentityEvidence:
    """Return the evidence by which tracks are joined: pictures, body measures, and cuts.

    tracks: `USED` columns of the table of tracks, row by row of the reel; cuts: first frames of the
    film's further segments.
    """
    segment = np.searchsorted(np.array(cuts, int), reel.features["frame"], side="right")
    # Body widths at some points of the backbone; its ends have none.
    widths = lists_to_array(tracks["half_width_px"])[:, ::_EVERY][:, 1:-1]
    tail_first = begins_at_tail(lists_to_points(tracks, "backbone"), reel.features)
    widths = np.where(tail_first[:, None], widths[:, ::-1], widths)  # from head to tail
    body = tracks[["length_px", "area_px", "contrast"]].to_numpy(float)
    return IdentityEvidence(reel, np.hstack([body, widths]), segment, p)


def identify_animals(evidence: IdentityEvidence) -> pd.DataFrame:
    """Return the animal of each track (schema IDENTITIES); animal 0 has the most frames."""
    features = evidence.reel.features
    slices = track_slices(features)
    first, last = np.array([(rows.start, rows.stop - 1) for rows in slices]).T
    joins = _join_tracks(evidence, [np.arange(rows.start, rows.stop) for rows in slices])
    frame, track_id = features["frame"].to_numpy(), features["track_id"].to_numpy()
    # The last row of each track's predecessor; without one the value is not used.
    has_predecessor, previous = joins.predecessor >= 0, last[joins.predecessor]
    return pd.DataFrame(
        {
            "track_id": track_id[first],
            "identity": _number_animals(joins, (last - first + 1).tolist()),
            "after_track": np.where(has_predecessor, track_id[previous], -1),
            "gap_frames": np.where(has_predecessor, frame[first] - frame[previous], 0),
            "probability": joins.probability,
        }
    ).astype(IDENTITIES.pandas_dtypes)


def identities_from_names(features: pd.DataFrame, animals: pd.Series) -> pd.DataFrame:
    """Return the animal of each track (schema IDENTITIES) from another program's names of animals.

    animals (rows,): the name of the animal in each row of the feature table. Animal 0 has the most
    rows, and every probability is 1.
    """
    by_track = features.assign(animal=animals.to_numpy()).groupby("track_id", as_index=False)
    table = by_track.agg(
        animal=("animal", "first"), start=("frame", "min"), stop=("frame", "max"),
        rows=("frame", "size"),
    )  # fmt: skip
    totals = table.groupby("animal")["rows"].sum().sort_values(ascending=False, kind="stable")
    table["identity"] = table["animal"].map({animal: k for k, animal in enumerate(totals.index)})
    ordered = table.sort_values(["identity", "start"])
    ordered["after_track"] = ordered.groupby("identity")["track_id"].shift(fill_value=-1)
    previous_stop = ordered.groupby("identity")["stop"].shift()
    ordered["gap_frames"] = (ordered["start"] - previous_stop).fillna(0)
    result = ordered.sort_index().assign(probability=1.0)
    return result[IDENTITIES.names].astype(IDENTITIES.pandas_dtypes)


def measure_trial_gaps(
    evidence: IdentityEvidence, gap_frames: NDArray[np.intp], rng: np.random.Generator
) -> Floats:
    """Return the shares (2,) of artificial gaps that are joined right, and wrong; NaN without gaps.

    Every track that is long enough is cut in two: as many frames are removed from its middle as a
    gap of the film has. Then all tracks are joined anew. A gap that stays open counts as neither.
    gap_frames (k,): the gaps of the film, from which one is drawn for each track; 1 if there are
    none.
    """
    # The rows of each piece, a whole track or half of one; and the number of each first half.
    pieces, first_halves = list[NDArray[np.intp]](), list[int]()
    frame = evidence.reel.features["frame"].to_numpy()
    for rows in track_slices(evidence.reel.features):
        gap = int(rng.choice(gap_frames)) if len(gap_frames) else 1
        pieces_of_track = _cut_gap(frame, np.arange(rows.start, rows.stop), gap)
        if len(pieces_of_track) == 2:
            first_halves.append(len(pieces))
        pieces += pieces_of_track
    if not first_halves:
        return np.full(2, np.nan)
    predecessor = _join_tracks(evidence, pieces).predecessor
    joined_to = predecessor[np.array(first_halves) + 1]  # of each second half
    is_right, is_open = joined_to == first_halves, joined_to < 0
    return np.array([is_right.mean(), (~is_right & ~is_open).mean()])


def _cut_gap(frame: Ints, rows: NDArray[np.intp], gap_frames: int) -> list[NDArray[np.intp]]:
    """Return a track's rows before and after a gap of `gap_frames` cut into its middle.

    Where a part would have fewer than `_LEAST_HALF` rows, all rows are returned as one part. frame:
    of every row of the film; rows (k,): of the track, in their order.
    """
    frames = frame[rows]
    first_gap_frame = (frames[0] + frames[-1] - gap_frames) // 2
    start = int(np.searchsorted(frames, first_gap_frame))
    stop = int(np.searchsorted(frames, frames[start - 1] + gap_frames))
    if min(start, len(rows) - stop) < _LEAST_HALF:
        return [rows]
    return [rows[:start], rows[stop:]]


def _join_tracks(evidence: IdentityEvidence, track_rows: list[NDArray[np.intp]]) -> TrackJoins:
    """Return which track continues which other, by motion and appearance.

    track_rows: the feature rows of each track, rising. Tracks are joined to chains, chains to
    longer ones; a pair is likely if its ends fit in motion, and its animals look alike.
    """
    reel, p = evidence.reel, evidence.settings
    features = reel.features
    frame = features["frame"].to_numpy()
    place = features[["x_px", "y_px"]].to_numpy(float) / reel.length_px
    drift = motion.measure_drift(
        features[["track_id", "frame"]].assign(x=place[:, 0], y=place[:, 1])
    )
    ends = motion.measure_track_ends(
        [frame[rows] for rows in track_rows], [place[rows] for rows in track_rows],
        drift.velocity_frames,
    )  # fmt: skip
    segment = np.array([evidence.segment[rows[0]] for rows in track_rows])
    descriptors = _describe_tracks(evidence, track_rows)

    def score_pairs(chains: Chains) -> tuple[TrackPairs, Floats]:
        """Return pairs of chains that may be one animal, and log(P(one animal) / P(two))."""
        chain_ends = motion.select_chain_ends(ends, chains)
        start, stop = chain_ends.start, chain_ends.stop
        pairs = successor_pairs(start, stop, segment[[chain[0] for chain in chains]])
        by_chain = [np.concatenate([descriptors[k] for k in chain]) for chain in chains]
        look_ratio = appearance.appearance_log_ratios(
            by_chain, simultaneous_pairs(start, stop), pairs
        )
        return pairs, motion.motion_log_ratios(chain_ends, drift, pairs) + look_ratio

    find_joins = partial(
        find_best_joins, stranger_probability=p.new_animal_probability,
        least_probability=p.min_join_probability, rng=np.random.default_rng(p.seed),
    )  # fmt: skip
    return join_in_passes(len(track_rows), score_pairs, p.sure_probability, find_joins)


def _describe_tracks(
    evidence: IdentityEvidence, track_rows: list[NDArray[np.intp]]
) -> list[Floats]:
    """Return descriptors (k, d) of the animal's looks, of each track, in k rows spread over it.

    track_rows: the feature rows of each track, rising.
    """
    reel, p = evidence.reel, evidence.settings
    samples = [spread_rows(rows, p.pictures_per_track) for rows in track_rows]
    sampled_rows = np.concatenate(samples)
    descriptors = appearance.appearance_descriptors(
        evidence.measures[sampled_rows],
        lambda rows: reel.draw_rows(sampled_rows[rows], p.size_px, BODY).reshape(len(rows), -1),
        p.components,
    )
    return np.split(descriptors, np.cumsum([len(rows) for rows in samples])[:-1])


def _number_animals(joins: TrackJoins, row_counts: list[int]) -> NDArray[np.intp]:
    """Return the number (n,) of each track's animal; animal 0 has the most rows."""
    root = np.arange(len(row_counts))  # becomes the first track of each track's animal
    while (has_earlier := joins.predecessor[root] >= 0).any():
        root = np.where(has_earlier, joins.predecessor[root], root)
    animal_rows = np.bincount(root, weights=row_counts, minlength=len(row_counts))
    by_size = np.argsort(-animal_rows, kind="stable")
    return np.argsort(by_size)[root]  # the rank of each animal
