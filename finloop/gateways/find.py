"""Gateways (fish paper §4.2, Fig. 14): sprite ↔ most similar frame of the film, both directions.

*Row*: row of the feature table. *In*: a sprite is on screen, a row of the film is drawn next.
*Out*: a row is on screen, a sprite is drawn next. The distance of both is Eq. 5 between the picture
that would have come next and the one that does.

In the frame of reference BODY pictures are compared with the measured heading to the right, so a
sprite and its own frame are equal. A sprite is drawn by the line it swims along, some degrees off
that, and turns while it is on screen: `turn_deg` is the turn of the film that fits it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.schema import Column, Schema
from finloop.distance.picture import BODY, all_distances
from finloop.distance.reel import Reel
from finloop.features.table import (
    count_orientations,
    infer_delta_frames,
    orientation_heading_deg,
    wrap_deg,
)
from finloop.gateways.settings import GatewaysSettings

IN, OUT = "in", "out"
_BLOCK = 256  # rows whose pictures are held at once
_DIGITS = 5  # digits of a distance
_CYCLES = ("straight", "slide")

GATEWAYS = Schema(
    Column("sprite", "int16", "1"),
    Column("orientation", "int8", "1"),
    Column("direction", "string", "1"),
    Column("row", "int32", "1"),
    Column("rank", "int8", "1"),
    Column("distance", "float32", "1"),
    Column("turn_deg", "float32", "deg"),
)
"""sprite: row of the table of sprites. rank: 1 = best. orientation: that of the next picture, from
1; 0 = any (frame of reference BODY).

turn_deg: a sprite drawn at heading h and the film drawn turned by h + turn_deg, anticlockwise as
seen, fit each other; in the frame of reference FILM that turn of the film is 0. Out, the sprite
replaces the row + 1; the whole film is turned alike.
"""

Ints = NDArray[np.intp]


@dataclass(frozen=True)
class SpriteDistances:
    """Picture distances (Eq. 5) between s sprites and n film rows (a fish in a frame).

    rows (n,): ascending. from_sprite (s, n): of a row from a sprite. from_next_frame (s, n): of a
    row from the film's frame after a sprite. row_deg (n,): the heading that was turned to the
    right, in the frame of reference BODY as measured, in FILM that of the orientation. sprite_deg,
    next_frame_deg (s,): this heading of a sprite, and of the frame after it, if the sprite is drawn
    at 0°. orientation (n,): of the row, 0 = any (frame of reference BODY).
    """

    rows: Ints
    from_sprite: Floats
    from_next_frame: Floats
    row_deg: Floats
    sprite_deg: Floats
    next_frame_deg: Floats
    orientation: NDArray[np.int8]


def measure_sprite_distances(
    reel: Reel, rows: Ints, size_px: int, reference: str,
    advance: Callable[[int], object] = lambda _: None,
) -> SpriteDistances:  # fmt: skip
    """Measure the picture distances (Eq. 5) between all sprites and some rows of the film.

    rows (n,): ascending; size_px: side of the compared pictures; reference: BODY, the measured
    heading points right, or FILM, each row as filmed and the sprites in its orientation as they are
    drawn. advance(k): called when k more rows are done.
    """
    features, sprites = reel.features, reel.sprites
    # In which directions the fish are drawn.
    row, next_row = _rows_of_sprites(reel)
    if reference == BODY:
        orientation = np.zeros(len(rows), np.int8)
        row_deg = features["heading_deg"].to_numpy(float)[rows]
        sprite_deg = _headings_relative_to_sprites(reel, row)
        next_frame_deg = _headings_relative_to_sprites(reel, next_row)
    else:
        orientation = features["orientation"].to_numpy()[rows]
        row_deg = orientation_heading_deg(orientation, count_orientations(features))
        sprite_deg = np.zeros(len(sprites))
        next_frame_deg = np.where(next_row > row, sprites["turn_deg"], 0.0)
    # The distances, block by block of the rows of one orientation.
    from_sprite, from_next_frame = np.empty((2, len(sprites), len(rows)))
    for number in np.unique(orientation):
        next_pictures, sprite_pictures = draw_sprites_and_next(
            reel, size_px, reference, int(number)
        )
        columns = np.flatnonzero(orientation == number)
        for block in np.split(columns, range(_BLOCK, len(columns), _BLOCK)):
            filmed = reel.draw_rows(rows[block], size_px, reference)
            from_sprite[:, block] = all_distances(sprite_pictures, filmed).round(_DIGITS)
            from_next_frame[:, block] = all_distances(next_pictures, filmed).round(_DIGITS)
            advance(len(block))
    return SpriteDistances(
        rows, from_sprite, from_next_frame, row_deg, sprite_deg, next_frame_deg, orientation
    )


def draw_sprites_and_next(
    reel: Reel, size_px: int, reference: str, orientation: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draw the film frame that follows each sprite, and the sprites themselves: two arrays.

    Both are (s, size_px, size_px, c), 0 … 1. In the frame of reference FILM they are drawn in
    `orientation`, in BODY the heading measured in the film points right.
    """
    if reference != BODY:
        next_pictures = reel.draw_frames_after_sprites(size_px, orientation)
        return next_pictures, reel.draw_sprites(size_px, orientation)
    row, next_row = _rows_of_sprites(reel)
    next_pictures = reel.draw_rows(next_row, size_px, reference)
    mirrored = reel.sprites["mirrored"].to_numpy()  # so is the frame after a mirrored sprite
    next_pictures[mirrored] = next_pictures[mirrored, ::-1]
    sprite_pictures = [
        reel.draw_sprite(number, size_px, orientation=1, turn_deg=-angle)
        for number, angle in enumerate(_headings_relative_to_sprites(reel, row))
    ]
    return next_pictures, np.stack(sprite_pictures)


def _headings_relative_to_sprites(reel: Reel, rows: Ints) -> Floats:
    """Return the film's heading at a row for each sprite (s,) [°], minus the sprite's heading.

    For a mirrored sprite it has the other sign. rows (s,): of the film, at which the heading is
    measured.
    """
    filmed_deg = reel.features["heading_deg"].to_numpy(float)[rows]
    relative = wrap_deg(filmed_deg - reel.sprites["heading_deg"].to_numpy(float))
    return np.where(reel.sprites["mirrored"], -relative, relative)


def _rows_of_sprites(reel: Reel) -> tuple[Ints, Ints]:
    """Return the film rows (s,) of the sprites, and the rows a frame later."""
    row = reel.sprites["row"].to_numpy(np.intp)
    return row, reel.next_rows(row)


def _count_frames_ahead(features: pd.DataFrame) -> Ints:
    """Return for each row (n,) how many frames of its track come after it."""
    return features.groupby("track_id").cumcount(ascending=False).to_numpy()


def list_gateways(
    distances: SpriteDistances, sprites: pd.DataFrame, features: pd.DataFrame, step_median: float,
    settings: GatewaysSettings,
) -> pd.DataFrame:  # fmt: skip
    """Return all gateways (schema `GATEWAYS`), pairs of a sprite and a film row that look alike.

    First come those from sprite to film, then those back. step_median: the film's median step.

    A sprite leads to its `frames_per_sprite` nearest rows in each orientation. Those of one track
    are at least `min_deltas_between_frames` from each other, and all have `min_deltas_ahead` of
    their track ahead. A row leads to the `sprites_per_frame` sprites of each sequence that are
    nearest to the row after it. The last row of a track leads to no sprite, and no row leads into
    the middle of a turn.
    """
    most_distance = settings.distance_threshold * step_median
    into_film = _find_rows_after_sprites(distances, features, most_distance, settings).assign(
        direction=IN
    )
    out_of_film = _find_sprites_after_rows(
        distances, sprites, features, most_distance, settings.sprites_per_frame
    )
    table = pd.concat([into_film, out_of_film.assign(direction=OUT)], ignore_index=True)
    # The turn of the film that fits the sprite, from the two pictures that were compared. Into the
    # film: the row, and the frame after the sprite. Out of it: the row after, and the sprite.
    sprite, leads_in = table["sprite"].to_numpy(), (table["direction"] == IN).to_numpy()
    column = np.searchsorted(distances.rows, table["row"].to_numpy() + ~leads_in)
    table["orientation"] = distances.orientation[column]
    drawn_deg = np.where(leads_in, distances.next_frame_deg[sprite], distances.sprite_deg[sprite])
    table["turn_deg"] = wrap_deg(drawn_deg - distances.row_deg[column])
    return table[GATEWAYS.names]


def _find_rows_after_sprites(
    distances: SpriteDistances, features: pd.DataFrame, most_distance: float,
    settings: GatewaysSettings,
) -> pd.DataFrame:  # fmt: skip
    """Return the film rows that may be drawn next after each sprite, in a table.

    Its columns are sprite, row, rank, distance. The rows are those nearest to the sprite's next
    frame in the film, of each orientation, ranked anew from 1 in each. How far they are apart, and
    how much of the film is ahead of them, see `list_gateways`.
    """
    track, frame = (features[name].to_numpy()[distances.rows] for name in ("track_id", "frame"))
    delta = infer_delta_frames(features)
    least_frames = settings.min_deltas_between_frames * delta
    frames_ahead = _count_frames_ahead(features)[distances.rows]
    has_enough_ahead = frames_ahead >= settings.min_deltas_ahead * delta
    found: list[tuple[int, int, int, float]] = []
    for number in np.unique(distances.orientation):
        rows = np.flatnonzero(has_enough_ahead & (distances.orientation == number))
        for sprite, distance in enumerate(distances.from_next_frame):
            candidates = rows[np.argsort(distance[rows], kind="stable")]  # the nearest first
            candidates = candidates[distance[candidates] <= most_distance]
            rank = 0
            while len(candidates) and rank < settings.frames_per_sprite:
                nearest, candidates = candidates[0], candidates[1:]
                rank += 1
                found.append((sprite, distances.rows[nearest], rank, distance[nearest]))
                is_apart = np.abs(frame[candidates] - frame[nearest]) >= least_frames
                is_of_other_track = track[candidates] != track[nearest]
                candidates = candidates[is_apart | is_of_other_track]
    types = {"sprite": int, "row": int, "rank": int, "distance": float}
    table = pd.DataFrame(found, columns=list(types)).astype(types)
    return table.sort_values("sprite", kind="stable")


def _find_sprites_after_rows(
    distances: SpriteDistances, sprites: pd.DataFrame, features: pd.DataFrame, most_distance: float,
    most_sprites: int,
) -> pd.DataFrame:  # fmt: skip
    """Return the sprites that may be drawn next after each row, in a table.

    Its columns are sprite, row, rank, distance. The sprites are those nearest to the film's next
    row, of each sequence, ranked from 1 over all sequences. most_sprites: of a sequence for a row.
    """
    # Rows whose next row, of the same track, is measured; and the column of that next row.
    has_row_before = np.append(False, _count_frames_ahead(features) > 0)[distances.rows]
    row, next_column = distances.rows[has_row_before] - 1, np.flatnonzero(has_row_before)
    # A cycle can be entered at any sprite, a turn only at its first.
    entries = np.flatnonzero(sprites["sequence"].isin(_CYCLES) | (sprites["step"] == 0))
    found = []
    for _, sequence in sprites.iloc[entries].groupby("sequence", sort=False):
        from_next_row = distances.from_sprite[np.ix_(sequence.index, next_column)]
        best = np.argsort(from_next_row, axis=0, kind="stable")[:most_sprites]
        sprite = sequence.index.to_numpy()[best].T.ravel()
        distance = np.take_along_axis(from_next_row, best, 0).T.ravel()
        rows = np.repeat(row, len(best))
        found.append(pd.DataFrame({"sprite": sprite, "row": rows, "distance": distance}))
    table = pd.concat(found).query("distance <= @most_distance").sort_values(["row", "distance"])
    return table.assign(rank=table.groupby("row").cumcount() + 1)


def gateway_metrics(
    table: pd.DataFrame, nearest: pd.DataFrame, distances: SpriteDistances, features: pd.DataFrame,
    rate_hz: float, step_median: float,
) -> dict[str, float]:  # fmt: skip
    """Return metrics of the gateways (pairs of a sprite and a film row), as in metrics.json.

    nearest: the gateways that there would be without a threshold of the distance.
    """
    # How many gateways there are in each direction, and their distances in median steps.
    result: dict[str, float] = {}
    for direction in (IN, OUT):
        steps = table.loc[table["direction"] == direction, "distance"] / step_median
        least = nearest.loc[nearest["direction"] == direction, "distance"].min()
        result |= {
            f"ways_{direction}": len(steps),
            f"distance_{direction}_median_steps": steps.median(),
            f"distance_{direction}_p95_steps": steps.quantile(0.95),
            f"nearest_{direction}_steps": least / step_median,
        }
    # Which sprites and rows have gateways.
    into_film, out_of_film = (table[table["direction"] == direction] for direction in (IN, OUT))
    sprites_in_orientations = len(distances.from_sprite) * len(np.unique(distances.orientation))
    with_way_in = len(into_film[["sprite", "orientation"]].drop_duplicates())
    has_way_out = np.isin(distances.rows, out_of_film["row"])
    track = features["track_id"].to_numpy()
    # Lengths of the runs of rows without a gateway: each follows a row with one, or begins a track.
    run = [track[distances.rows], has_way_out.cumsum()]
    rows_without = pd.Series(~has_way_out).groupby(run).sum()
    return result | {
        "sprites": len(distances.from_sprite),
        "sprites_in_orientations": sprites_in_orientations,
        "sprites_in_orientations_without_way_in": sprites_in_orientations - with_way_in,
        "film_rows_led_to": into_film["row"].nunique(),
        "film_tracks_led_to": len(np.unique(track[into_film["row"]])),
        "film_rows_with_way_out_pct": 100 * has_way_out.mean(),
        "film_longest_without_way_out_s": int(rows_without.max()) / rate_hz,
        "sprites_led_to": out_of_film["sprite"].nunique(),
    }
