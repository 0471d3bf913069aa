"""The animals of a film: each track's identity, with its probability."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.schema import Column, Schema, columns, lists_to_array, lists_to_points
from finloop.base.stretches import spread_rows
from finloop.distance.picture import BODY
from finloop.distance.reel import Reel
from finloop.features.head import tail_first
from finloop.features.table import spans
from finloop.identity import appearance, motion
from finloop.identity.joins import (
    Chains,
    Pairs,
    TrackJoins,
    best_joins,
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
class Evidence:
    """The evidence for the identities in a film.

    reel: its feature table and cut-outs. measures (n, d): of every row's body. segment (n,): each
    row's part of the film, between cuts; no join leads across a cut.
    """

    reel: Reel
    measures: Floats
    segment: NDArray[np.intp]
    settings: IdentitySettings


def collect_evidence(
    reel: Reel, tracks: pd.DataFrame, cuts: Sequence[int], p: IdentitySettings
) -> Evidence:
    """Collect the evidence for the identities in a film: body measures and parts of the film.

    tracks: `USED` columns of the table of tracks, row by row of the reel; cuts: first frames of the
    film's further segments.
    """
    segment = np.searchsorted(np.array(cuts, int), reel.features["frame"], side="right")
    widths = lists_to_array(tracks["half_width_px"])[:, ::_EVERY][:, 1:-1]
    back = tail_first(lists_to_points(tracks, "backbone"), reel.features)
    widths = np.where(back[:, None], widths[:, ::-1], widths)  # from head to tail
    body = tracks[["length_px", "area_px", "contrast"]].to_numpy(float)
    return Evidence(reel, np.hstack([body, widths]), segment, p)


def identities(film: Evidence) -> pd.DataFrame:
    """Return the animal of each track (schema IDENTITIES); animal 0 has the most frames."""
    features = film.reel.features
    rows = np.arange(len(features))
    parts = [rows[span] for span in spans(features)]
    joins = _join_tracks(film, parts)
    frame, track = features["frame"].to_numpy(), features["track_id"].to_numpy()
    first, last = (np.array([rows[k] for rows in parts]) for k in (0, -1))
    has = joins.before >= 0
    return pd.DataFrame(
        {
            "track_id": track[first],
            "identity": _number_animals(joins, [len(rows) for rows in parts]),
            "after_track": np.where(has, track[last[joins.before]], -1),
            "gap_frames": np.where(has, frame[first] - frame[last[joins.before]], 0),
            "probability": joins.probability,
        }
    ).astype(IDENTITIES.kinds)


def identities_from_names(features: pd.DataFrame, animals: pd.Series) -> pd.DataFrame:
    """Return the animal of each track (schema IDENTITIES) from another program's names of animals.

    animals (rows,): the name of the animal in each row of the feature table. Animal 0 has the most
    rows, and every probability is 1.
    """
    span = features.assign(animal=animals.to_numpy()).groupby("track_id", as_index=False)
    table = span.agg(
        animal=("animal", "first"), start=("frame", "min"), stop=("frame", "max"),
        rows=("frame", "size"),
    )  # fmt: skip
    totals = table.groupby("animal")["rows"].sum().sort_values(ascending=False, kind="stable")
    table["identity"] = table["animal"].map({animal: k for k, animal in enumerate(totals.index)})
    ordered = table.sort_values(["identity", "start"])
    ordered["after_track"] = ordered.groupby("identity")["track_id"].shift(fill_value=-1)
    ended = ordered.groupby("identity")["stop"].shift()
    ordered["gap_frames"] = (ordered["start"] - ended).fillna(0)
    result = ordered.sort_index().assign(probability=1.0)
    return result[IDENTITIES.names].astype(IDENTITIES.kinds)


def trial_gaps(film: Evidence, gaps: NDArray[np.intp], rng: np.random.Generator) -> Floats:
    """Return the shares (2,) of trial gaps that are joined right and wrong; NaN without any.

    Frames are removed from the middle of every track that is long enough, as many as in one of the
    film's own `gaps` (k,) [frames], and all tracks are joined anew. A gap that is not joined counts
    as neither.
    """
    parts, halves = list[NDArray[np.intp]](), list[int]()
    frame = film.reel.features["frame"].to_numpy()
    for span in spans(film.reel.features):
        a, b = span.start, span.stop
        gap = int(rng.choice(gaps)) if len(gaps) else 1
        middle = int(np.searchsorted(frame[a:b], (frame[a] + frame[b - 1] - gap) // 2)) + a
        after = int(np.searchsorted(frame[a:b], frame[middle - 1] + gap)) + a
        if middle - a >= _LEAST_HALF <= b - after:
            halves.append(len(parts))
            parts += [np.arange(a, middle), np.arange(after, b)]
        else:
            parts.append(np.arange(a, b))
    before = _join_tracks(film, parts).before
    before_half = before[np.array(halves, int) + 1]
    if not len(before_half):
        return np.full(2, np.nan)
    right = before_half == halves
    return np.array([right.mean(), (~right & (before_half >= 0)).mean()])


def _join_tracks(film: Evidence, parts: list[NDArray[np.intp]]) -> TrackJoins:
    """Return which tracks, given by their rows, are one animal, by motion and appearance."""
    reel, p = film.reel, film.settings
    features = reel.features
    frame = features["frame"].to_numpy()
    place = features[["x_px", "y_px"]].to_numpy(float) / reel.length_px
    whole = features[["track_id", "frame"]].assign(x=place[:, 0], y=place[:, 1])
    drift = motion.measure_drift(whole)
    ends = motion.track_ends(
        [frame[rows] for rows in parts], [place[rows] for rows in parts], drift.before
    )
    segment = np.array([film.segment[rows[0]] for rows in parts])
    some = [spread_rows(rows, p.looked_at) for rows in parts]
    every = np.concatenate(some)
    looks = appearance.descriptors(
        film.measures[every],
        lambda few: reel.frames(every[few], p.size_px, BODY).reshape(len(few), -1),
        p.components,
    )
    by_track = np.split(looks, np.cumsum([len(rows) for rows in some])[:-1])

    def scores(chains: Chains) -> tuple[Pairs, Floats]:
        between = motion.chain_ends(ends, chains)
        pairs = successor_pairs(
            between.start, between.stop, segment[[chain[0] for chain in chains]]
        )
        looks = [np.concatenate([by_track[k] for k in chain]) for chain in chains]
        look_ratio = appearance.log_ratios(
            looks, simultaneous_pairs(between.start, between.stop), pairs
        )
        return pairs, motion.log_ratios(between, drift, pairs) + look_ratio

    best = partial(
        best_joins, strangers=p.new_animal_probability, least=p.min_join_probability,
        rng=np.random.default_rng(p.seed),
    )  # fmt: skip
    return join_in_passes(len(parts), scores, p.sure, best)


def _number_animals(joins: TrackJoins, lengths: list[int]) -> NDArray[np.intp]:
    """Return the number of each track's animal, 0 for the one with the most rows."""
    root = np.arange(len(lengths))
    while (has_before := joins.before[root] >= 0).any():
        root = np.where(has_before, joins.before[root], root)
    rows = np.bincount(root, weights=lengths, minlength=len(lengths))
    order = np.argsort(-rows, kind="stable")
    number = np.empty(len(lengths), np.intp)
    number[order] = np.arange(len(lengths))
    return number[root]
