"""Gateways (fish paper §4.2, Fig. 14): sprite ↔ most similar frame of the film, both directions.

*Row*: row of the feature table. *In*: a sprite is on screen, a row of the film is drawn next.
*Out*: a row is on screen, a sprite is drawn next. The distance of both is Eq. 5 between the picture
that would have come next and the one that does.

In the pose BODY pictures are compared with the measured heading to the right, so a sprite and its
own frame are equal. A sprite is drawn by the line it swims along, some degrees off that, and turns
while it is on screen: `turn_deg` is the turn of the film that fits it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, repeat

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.schema import Column, Schema
from finloop.distance.picture import BODY, distance
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
1; 0 = any (pose BODY).

turn_deg: a sprite drawn at heading h and the film drawn turned by h + turn_deg, anticlockwise as
seen, fit each other; in the pose FILM that turn of the film is 0. Out, the sprite replaces the
row + 1; the whole film is turned alike.
"""

Ints = NDArray[np.intp]


@dataclass(frozen=True)
class Nearness:
    """Picture distances (Eq. 5) between s sprites and n rows of the feature table.

    rows (n,): rising. ahead (s, n): from the film's frame after a sprite. own (s, n): from the
    sprite itself. orientation (n,): of the row, 0 = any (pose BODY). pose_deg (n,): the heading
    that was turned to the right, BODY: as measured; FILM: that of the orientation. ahead_deg,
    own_deg (s,): the same of the other two, with the sprite drawn at 0°.
    """

    rows: Ints
    ahead: Floats
    own: Floats
    ahead_deg: Floats
    own_deg: Floats
    pose_deg: Floats
    orientation: NDArray[np.int8]


def nearness(
    reel: Reel, rows: Ints, size: int, pose: str, advance: Callable[[int], object] = lambda _: None
) -> Nearness:
    """Measure the picture distances (Eq. 5) between all sprites and rows (n,) of the film, rising.

    size: px, side of the pictures; pose: BODY, the measured heading points right, or FILM, each row
    as filmed and the sprites in its orientation as they are drawn. advance(k): called when k more
    rows are done. At most `_BLOCK` pictures are held at once.
    """
    features, sprites = reel.features, reel.sprites
    row, after = _rows_of(reel)
    if pose == BODY:
        orientation = np.zeros(len(rows), np.int8)
        heading = features["heading_deg"].to_numpy(float)
        pose_deg = heading[rows]
        ahead_deg, own_deg = (_heading(sprites, heading[at]) for at in (after, row))
    else:
        orientation = features["orientation"].to_numpy()[rows]
        pose_deg = orientation_heading_deg(orientation, count_orientations(features))
        ahead_deg = np.where(after > row, sprites["turn_deg"], 0.0)
        own_deg = np.zeros(len(sprites))
    ahead, own = np.empty((2, len(sprites), len(rows)))
    for number in np.unique(orientation):
        next_pictures, own_pictures = sprite_pictures(reel, size, pose, int(number))
        mine = np.flatnonzero(orientation == number)
        for block in np.split(mine, range(_BLOCK, len(mine), _BLOCK)):
            filmed = reel.frames(rows[block], size, pose)
            ahead[:, block] = distance(next_pictures, filmed).round(_DIGITS)
            own[:, block] = distance(own_pictures, filmed).round(_DIGITS)
            advance(len(block))
    return Nearness(rows, ahead, own, ahead_deg, own_deg, pose_deg, orientation)


def sprite_pictures(
    reel: Reel, size: int, pose: str, number: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the film's next picture after every sprite, and the sprites: (s, size, size, c) each.

    number: the orientation they are drawn in; in pose BODY the measured heading points right.
    """
    if pose != BODY:
        return reel.after_sprites(size, number), reel.sprite_pictures(size, number)
    row, after = _rows_of(reel)
    ahead = reel.frames(after, size, pose)
    mirrored = reel.sprites["mirrored"].to_numpy()
    ahead[mirrored] = ahead[mirrored, ::-1]
    turn = -_heading(reel.sprites, reel.features["heading_deg"].to_numpy(float)[row])
    own = [reel.sprite_picture(at, size, 1, angle) for at, angle in enumerate(turn)]
    return ahead, np.stack(own)


def _heading(sprites: pd.DataFrame, filmed_deg: Floats) -> Floats:
    """Return the headings (s,) of the film relative to the sprites', mirrored with the sprite."""
    off = wrap_deg(filmed_deg - sprites["heading_deg"].to_numpy(float))
    return np.where(sprites["mirrored"], -off, off)


def _rows_of(reel: Reel) -> tuple[Ints, Ints]:
    """Return the row of every sprite's frame, and the next one; at a track's end the same."""
    row = reel.sprites["row"].to_numpy(np.intp)
    return row, reel.next_rows(row)


def _frames_ahead(features: pd.DataFrame) -> Ints:
    """Return how many frames of its track follow each row."""
    return features.groupby("track_id").cumcount(ascending=False).to_numpy()


def gateways(
    near: Nearness, sprites: pd.DataFrame, features: pd.DataFrame, step: float,
    settings: GatewaysSettings,
) -> pd.DataFrame:  # fmt: skip
    """Return all gateways (schema `GATEWAYS`): ways in, then ways out.

    step: the median natural step. A sprite leads to its `frames_per_sprite` nearest rows in each
    orientation. These are `apart` apart and have `least` of their track ahead. A row leads to the
    `sprites_per_frame` sprites of each sequence that are nearest to its next row. The last row of a
    track has no way out, and a turn is entered only by its first sprite.
    """
    most = settings.distance_threshold * step
    ways_in = _ways_in(near, features, most, settings).assign(direction=IN)
    ways_out = _ways_out(near, sprites, features, most, settings.sprites_per_frame)
    table = pd.concat([ways_in, ways_out.assign(direction=OUT)], ignore_index=True)
    sprite, leads_in = table["sprite"].to_numpy(), (table["direction"] == IN).to_numpy()
    column = np.searchsorted(near.rows, table["row"].to_numpy() + ~leads_in)
    table["orientation"] = near.orientation[column]
    fits = np.where(leads_in, near.ahead_deg[sprite], near.own_deg[sprite])
    table["turn_deg"] = wrap_deg(fits - near.pose_deg[column])
    return table[GATEWAYS.names]


def _ways_in(
    near: Nearness, features: pd.DataFrame, most: float, settings: GatewaysSettings
) -> pd.DataFrame:
    """Return sprite, row, rank, distance: the best rows of each sprite and orientation."""
    track, frame = (features[name].to_numpy()[near.rows] for name in ("track_id", "frame"))
    delta = infer_delta_frames(features)
    lasts = _frames_ahead(features)[near.rows] >= settings.least * delta
    ways: list[tuple[int, int, int, float]] = []
    for number in np.unique(near.orientation):
        rows = np.flatnonzero(lasts & (near.orientation == number))
        for sprite, far in enumerate(near.ahead[:, rows]):
            order = rows[np.argsort(far, kind="stable")]
            order = order[near.ahead[sprite, order] <= most]
            best: list[int] = []
            while len(order) and len(best) < settings.frames_per_sprite:
                best.append(int(order[0]))
                late = np.abs(frame[order] - frame[best[-1]]) >= settings.apart * delta
                order = order[(late & (order != best[-1])) | (track[order] != track[best[-1]])]
            far = near.ahead[sprite, best]
            ways += zip(repeat(sprite), near.rows[best], count(1), far, strict=False)
    kinds = {"sprite": int, "row": int, "rank": int, "distance": float}
    table = pd.DataFrame(ways, columns=list(kinds)).astype(kinds)
    return table.sort_values("sprite", kind="stable")


def _ways_out(
    near: Nearness, sprites: pd.DataFrame, features: pd.DataFrame, most: float, top: int
) -> pd.DataFrame:
    """Return sprite, row, rank, distance: each row's `top` best sprites of every sequence."""
    # Rows whose next frame is among `near.rows`, and its place there.
    follows = np.append(False, _frames_ahead(features) > 0)[near.rows]
    row, after = near.rows[follows] - 1, np.flatnonzero(follows)
    entries = np.flatnonzero(sprites["sequence"].isin(_CYCLES) | (sprites["step"] == 0))
    ways = []
    for _, sequence in sprites.iloc[entries].groupby("sequence", sort=False):
        far = near.own[np.ix_(sequence.index, after)]
        best = np.argsort(far, axis=0, kind="stable")[:top]
        sprite = sequence.index.to_numpy()[best].T.ravel()
        distance = np.take_along_axis(far, best, 0).T.ravel()
        rows = np.repeat(row, len(best))
        ways.append(pd.DataFrame({"sprite": sprite, "row": rows, "distance": distance}))
    table = pd.concat(ways).query("distance <= @most").sort_values(["row", "distance"])
    return table.assign(rank=table.groupby("row").cumcount() + 1)


def gateway_metrics(
    table: pd.DataFrame, nearest: pd.DataFrame, near: Nearness, features: pd.DataFrame,
    rate_hz: float, step: float,
) -> dict[str, float]:  # fmt: skip
    """Return the metrics of the gateways, by their names in metrics.json.

    table: the gateways; nearest: those without a threshold; step: the median natural step.
    """
    result: dict[str, float] = {}
    for word in (IN, OUT):
        far = table.loc[table["direction"] == word, "distance"] / step
        least = nearest.loc[nearest["direction"] == word, "distance"].min()
        result |= {
            f"ways_{word}": len(far),
            f"distance_{word}_median_steps": far.median(),
            f"distance_{word}_p95_steps": far.quantile(0.95),
            f"nearest_{word}_steps": least / step,
        }
    leads_in, leads_out = (table[table["direction"] == word] for word in (IN, OUT))
    compared = len(near.ahead) * len(np.unique(near.orientation))
    entered = len(leads_in[["sprite", "orientation"]].drop_duplicates())
    out = np.isin(near.rows, leads_out["row"])
    track = features["track_id"].to_numpy()
    without = pd.Series(~out).groupby([track[near.rows], out.cumsum()]).sum()  # runs of rows
    return result | {
        "sprites": len(near.ahead),
        "sprites_in_orientations": compared,
        "sprites_in_orientations_without_way_in": compared - entered,
        "film_rows_led_to": leads_in["row"].nunique(),
        "film_tracks_led_to": len(np.unique(track[leads_in["row"]])),
        "film_rows_with_way_out_pct": 100 * out.mean(),
        "film_longest_without_way_out_s": int(without.max()) / rate_hz,
        "sprites_led_to": leads_out["sprite"].nunique(),
    }
