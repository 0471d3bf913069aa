"""Compare a film's pictures with one another: similar pairs and natural steps (Eqs. 5-8)."""

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
import pandas as pd

from finloop.base.stretches import sample_stretches
from finloop.distance.map import (
    Block,
    Ints,
    MapFacts,
    Picture,
    PicturePairs,
    about_mean,
    comparison_blocks,
    find_similar_pairs,
    frame_kinds,
    pair_table,
    sort_by_kind_and_area,
    step_table,
    usual_steps,
)
from finloop.distance.picture import BODY, FILM
from finloop.distance.settings import DistanceSettings
from finloop.features.table import step_of

_STRETCHES = 20  # least stretches of a film that is too long for a complete map


class PictureSource(Protocol):
    """Pictures of a film's animals by feature row, as `finloop.distance.reel.Reel` has them."""

    @property
    def features(self) -> pd.DataFrame:
        """Return the feature table: a row for each of the n animals in frames."""
        ...

    def frames(self, rows: Ints, size: int, pose: str) -> Picture:
        """Return pictures (k, size, size, channels), 0 … 1, of rows (k,); pose: FILM or BODY."""
        ...

    def steps(self, size: int, pose: str, rows: Ints) -> np.ndarray:
        """Return the picture distance (k,) (Eq. 5) from each row to the next one; NaN at a gap."""
        ...


class FrameComparison(NamedTuple):
    """The comparison of a film's frames: similar pairs, natural steps, and how they were made.

    pairs: schema `PAIRS`; steps: schema `STEPS`.
    """

    pairs: pd.DataFrame
    steps: pd.DataFrame
    facts: MapFacts


def select_rows_to_compare(features: pd.DataFrame, most: int) -> Ints:
    """Return the feature rows (k,) to compare: all, or stretches spread over a longer film.

    most: the largest number of rows.
    """
    track = features["track_id"].to_numpy()
    every = sample_stretches(track, max(2, most // _STRETCHES), most, seed=0)
    return np.concatenate([np.arange(stretch.start, stretch.stop) for stretch in every])


def map_blocks(features: pd.DataFrame, p: DistanceSettings) -> list[Block]:
    """Return the blocks of the distance map that `compare_frames` computes, one after the other.

    Their rows and columns count the compared rows, sorted by `sort_by_kind_and_area`.
    """
    features = features.iloc[select_rows_to_compare(features, p.max_pictures)]
    kind, area = frame_kinds(features, p.frame_of_reference), features["motion_area_rel"].to_numpy()
    rows = sort_by_kind_and_area(kind, area)
    return list(comparison_blocks(kind[rows], area[rows], p.motion_area_threshold))


def headed_steps(film: PictureSource, rows: Ints, size: int) -> Picture:
    """Return picture distances (k,) (Eq. 5) from rows (k,) to those a natural step later.

    The pictures, size px wide, are turned so that the fish heads right. NaN where `rows` lacks the
    later one.
    """
    features = film.features.iloc[rows]
    x = about_mean(film.frames(rows, size, BODY))
    table = step_table(features, x, np.arange(len(rows)), step_of(film.features))
    return np.asarray(table["step"], np.float32)


def compare_frames(
    film: PictureSource, p: DistanceSettings, advance: Callable[[], object] = lambda: None
) -> FrameComparison:
    """Return the film's pairs of similar frames (Eqs. 5-8), and its natural steps.

    advance(): called after each block. In a film of more than `p.max_pictures` frames only
    stretches are compared, see `select_rows_to_compare`.

    FinloopError if the film does not move.
    """
    mapped = select_rows_to_compare(film.features, p.max_pictures)
    features = film.features.iloc[mapped]
    kind, area = frame_kinds(features, p.frame_of_reference), features["motion_area_rel"].to_numpy()
    # Pictures are in this order, so a band is a slice and needs no copy.
    places = sort_by_kind_and_area(kind, area)
    rows = mapped[places]
    x = about_mean(film.frames(rows, p.picture_size_px, p.frame_of_reference))
    steps = step_table(features, x, np.argsort(places), step_of(film.features))
    steps["headed"] = (
        steps["step"]
        if p.frame_of_reference == BODY
        else headed_steps(film, mapped, p.picture_size_px)
    )
    steps["as_filmed"] = film.steps(p.picture_size_px, FILM, mapped)
    median, p95 = usual_steps(steps)
    most = np.inf if p.max_distance_steps is None else p.max_distance_steps * median

    def with_progress() -> Iterator[PicturePairs]:
        for pairs in find_similar_pairs(
            x, kind[places], area[places], p.motion_area_threshold, most
        ):
            yield pairs
            advance()

    facts = MapFacts(
        p.frame_of_reference,
        p.picture_size_px,
        p.motion_area_threshold,
        p.max_distance_steps,
        median,
        p95,
    )
    return FrameComparison(pair_table(with_progress(), rows), steps, facts)
