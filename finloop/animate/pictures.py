"""Pictures behind an edit list: what is drawn from tick to tick, and how well it joins (Eq. 5)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.base.cutout import Cutouts
from finloop.distance.picture import FILM, film_pictures, picture
from finloop.features.table import orientations_of

SIZE = 64  # px of a centred picture
_PAIRS, _LOT = 3000, 500  # natural steps that are looked at, and at once

Floats = NDArray[np.float64]
Picture = NDArray[np.float32]


def film_steps(features: pd.DataFrame, film: Cutouts) -> Floats:
    """Eq. 5 between successive frames of the film, at most `_PAIRS` of them spread over it."""
    table = features[["track_id", "frame"]].to_numpy()
    starts = np.flatnonzero((np.diff(table, axis=0) == (0, 1)).all(1))
    starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _PAIRS)).astype(int)]
    steps = []
    for lot in np.array_split(starts, max(1, -(-len(starts) // _LOT))):  # few pictures at a time
        before, after = (film_pictures(features, film, SIZE, FILM, lot + k) for k in (0, 1))
        steps.append(np.linalg.norm((after - before).reshape(len(lot), -1), axis=1))
    return np.concatenate(steps).astype(float)


class Place(NamedTuple):
    """A mass centre, px of the film."""

    x_px: float
    y_px: float


@dataclass(frozen=True)
class Pictures:
    """Centred pictures of what an edit list names, at the drawn size.

    sprites: the table of n; headed (n, SIZE, SIZE, c): each headed right; after: what the film
    shows after it, turned as the sprite's next one would be.
    """

    sprites: pd.DataFrame
    store: Cutouts
    headed: Picture
    after: Picture
    features: pd.DataFrame
    film: Cutouts

    def __call__(self, kind: str, source: int, rotation_deg: float, scale: float) -> Picture:
        """The picture of a sprite or frame, turned as asked."""
        if kind == FRAME:
            one, cutout = self._places[FRAME][int(source)], self.film[int(source)]
        else:
            one = self._places[SPRITE][int(source) // orientations_of(self.sprites)]
            cutout = self.store[int(source)]
        return picture(cutout, one, self._length_px / scale, SIZE, float(rotation_deg))

    @cached_property
    def _length_px(self) -> float:
        return float(self.features["body_length_px"].median())

    @cached_property
    def _places(self) -> dict[str, list[Place]]:
        tables = {FRAME: self.features, SPRITE: self.sprites}
        return {
            kind: [Place(x, y) for x, y in table[["x_px", "y_px"]].to_numpy()]
            for kind, table in tables.items()
        }

    def following(self, row: int) -> int | None:
        """The frame after a frame of the same track."""
        track = self.features["track_id"].to_numpy()
        goes_on = row + 1 < len(track) and track[row] == track[row + 1]
        return row + 1 if goes_on else None


def apart(row: Any, pictures: Pictures) -> float:
    """Eq. 5 between the two pictures of a cross-fade, a row of an edit list."""
    shown = pictures(row.kind, row.source, row.rotation_deg, row.scale)
    partner = pictures(row.partner_kind, row.partner, row.partner_rotation_deg, row.partner_scale)
    return float(np.linalg.norm(shown - partner))


def without_ghosts(edit: pd.DataFrame, pictures: Pictures, most: float) -> pd.DataFrame:
    """The edit list without what fades out while it is farther than `most` from what fades in.

    Two unlike fish on one another look like ghosts.
    """
    ghosts: list[int] = []
    for row in edit[edit["weight"] > 0].itertuples():
        before = bool(ghosts) and ghosts[-1] == row.Index - 1  # once gone, it does not come back
        if before or apart(row, pictures) > most:
            ghosts.append(row.Index)
    clean = edit.copy()
    clean.loc[ghosts, "weight"] = 0.0
    clean.loc[ghosts, ["partner_kind", "partner"]] = None
    clean.loc[ghosts, ["partner_rotation_deg", "partner_scale"]] = np.nan
    return clean


def drawn_steps(edit: pd.DataFrame, pictures: Pictures) -> Floats:
    """Eq. 5 between what is drawn at successive ticks, cross-fades and all."""
    shown = _drawn(edit, pictures)
    before = next(shown)
    steps = []
    for after in shown:
        steps.append(float(np.linalg.norm(after - before)))
        before = after
    return np.array(steps)


def _drawn(edit: pd.DataFrame, pictures: Pictures) -> Iterator[Picture]:
    for row in edit.itertuples():
        shown = pictures(row.kind, row.source, row.rotation_deg, row.scale)
        if row.weight > 0:
            partner = pictures(
                row.partner_kind, row.partner, row.partner_rotation_deg, row.partner_scale
            )
            shown = (1 - row.weight) * shown + row.weight * partner
        yield shown


def seams(edit: pd.DataFrame, pictures: Pictures) -> tuple[Floats, NDArray[np.intp]]:
    """D(i + 1, j) of every jump i → j of an edit list, without its cross-fade, and its tick.

    What the film shows after the picture on screen, turned as that is, against what is drawn.
    """
    next_sprite, count = film_next(pictures.sprites), orientations_of(pictures.sprites)
    found, ticks = [], []
    rows = list(edit.itertuples())
    for tick in range(1, len(rows)):
        before, now = rows[tick - 1], rows[tick]
        turn = -float(now.heading_deg)
        if before.kind == FRAME:
            follows = pictures.following(before.source)
            if follows is None:
                follows = before.source
            elif now.kind == FRAME and now.source == follows:
                continue
            expected = pictures(FRAME, follows, before.rotation_deg + turn, before.scale)
        else:
            number = before.source // count
            if now.kind == SPRITE and now.source // count == next_sprite[number]:
                continue
            expected = pictures.after[number]
        if now.kind == FRAME:
            drawn = pictures(FRAME, now.source, now.rotation_deg + turn, now.scale)
        else:
            drawn = pictures.headed[now.source // count]
        found.append(float(np.linalg.norm(drawn - expected)))
        ticks.append(tick)
    return np.array(found), np.array(ticks, np.intp)


def film_next(sprites: pd.DataFrame) -> NDArray[np.int64]:
    """For every sprite the sprite of the film's next frame, −1 where there is none."""
    step = sprites["step"].to_numpy()
    follows = np.append((np.diff(sprites["frame"]) == 1) & (np.diff(step) == 1), False)
    return np.where(follows, np.arange(1, len(sprites) + 1), -1)
