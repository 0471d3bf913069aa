"""Pictures behind an edit list: how alike any two sprites are, what is drawn from tick to tick."""

from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate_edit import SPRITE
from finloop.distance import centred
from finloop.features import ORIENTATIONS
from finloop.files.cutouts import Cutout, CutoutStore

SIZE = 64  # px of a centred picture
_SOLID = 64  # alpha from which a pixel belongs to the fish
_PAIRS = 3000  # natural steps that are looked at

Floats = NDArray[np.float64]


def pictures(sprites: pd.DataFrame, store: CutoutStore, length_px: float) -> NDArray[np.float32]:
    """Every sprite (n, SIZE, SIZE, c) in orientation 1, at the drawn size."""
    return np.stack(
        [
            _picture(store[number * ORIENTATIONS], row, length_px / row.scale)
            for number, row in enumerate(sprites.itertuples())
        ]
    )


def _picture(
    cutout: Cutout, at: object, length_px: float, turn_deg: float = 0.0
) -> NDArray[np.float32]:
    centre = at.x_px - cutout.x0_px, at.y_px - cutout.y0_px  # type: ignore[attr-defined]
    return centred(cutout.pixels, centre, length_px, SIZE, turn_deg)


def following(
    sprites: pd.DataFrame, features: pd.DataFrame, film: CutoutStore, length_px: float
) -> NDArray[np.float32]:
    """What the film shows after every sprite, turned as the sprite's next one would be.

    At the end of a track, where there is nothing, the frame itself.
    """
    rows = _rows(film)
    places = features.set_index(["track_id", "frame"])[["x_px", "y_px"]]
    found = []
    for sprite in sprites.itertuples():
        key = int(sprite.track_id), int(sprite.frame) + 1
        side = -1 if sprite.mirrored else 1
        turn = -(sprite.heading_deg + side * sprite.turn_deg)
        if key not in rows.index:
            key, turn = (key[0], key[1] - 1), -sprite.heading_deg
        picture = _picture(film[int(rows[key])], places.loc[key], length_px / sprite.scale, turn)
        found.append(picture[::-1] if sprite.mirrored else picture)
    return np.stack(found)


def _rows(film: CutoutStore) -> pd.Series:
    index = film.index
    return pd.Series(index.index, pd.MultiIndex.from_frame(index[["track_id", "frame"]]))


def outlines(sprites: pd.DataFrame, store: CutoutStore) -> list[Floats]:
    """The hull (k, 2) of every sprite, px from the mass centre at the drawn size: ahead, left."""
    found = []
    for number, row in enumerate(sprites.itertuples()):
        cutout = store[number * ORIENTATIONS]
        solid = np.argwhere(cutout.pixels[..., -1] >= _SOLID)[:, ::-1].astype(np.float32)
        hull = cv2.convexHull(solid)[:, 0].astype(float)
        offset = hull + np.array([cutout.x0_px - row.x_px, cutout.y0_px - row.y_px])
        found.append(offset * np.array([row.scale, -row.scale]))
    return found


def film_steps(features: pd.DataFrame, film: CutoutStore, length_px: float) -> Floats:
    """Eq. 5 between successive frames of the film, at most `_PAIRS` of them spread over it."""
    rows = _rows(film)
    table = features.sort_values(["track_id", "frame"])
    same = (np.diff(table["track_id"]) == 0) & (np.diff(table["frame"]) == 1)
    starts = np.flatnonzero(same)
    starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _PAIRS)).astype(int)]
    places = list(table[["track_id", "frame", "x_px", "y_px"]].itertuples(index=False))

    def shown(place: int) -> NDArray[np.float32]:
        one = places[place]
        return _picture(film[int(rows[one[:2]])], one, length_px)

    return np.array([float(np.linalg.norm(shown(a + 1) - shown(a))) for a in starts])


def drawn_steps(
    edit: pd.DataFrame, picture_of: Callable[[str, int, float, float], NDArray[np.float32]]
) -> Floats:
    """Eq. 5 between what is drawn at successive ticks, cross-fades and all.

    `picture_of(kind, source, rotation_deg, scale)` gives a centred picture.
    """
    shown = _drawn(edit, picture_of)
    before = next(shown)
    steps = []
    for after in shown:
        steps.append(float(np.linalg.norm(after - before)))
        before = after
    return np.array(steps)


def _drawn(
    edit: pd.DataFrame, picture_of: Callable[[str, int, float, float], NDArray[np.float32]]
) -> Iterator[NDArray[np.float32]]:
    for row in edit.itertuples():
        picture = picture_of(row.kind, row.source, row.rotation_deg, row.scale)
        if row.weight > 0:
            partner = picture_of(
                row.partner_kind, row.partner, row.partner_rotation_deg, row.partner_scale
            )
            picture = (1 - row.weight) * picture + row.weight * partner
        yield picture


def sprite_pictures(
    sprites: pd.DataFrame, store: CutoutStore, length_px: float
) -> Callable[[str, int, float, float], NDArray[np.float32]]:
    """Centred pictures of sprites as an edit list names them."""
    table = list(sprites.itertuples())

    def picture_of(
        kind: str, source: int, rotation_deg: float, scale: float
    ) -> NDArray[np.float32]:
        if kind != SPRITE:
            raise ValueError(f"a {kind} in an edit list of sprites")
        row = table[int(source) // ORIENTATIONS]
        return _picture(store[int(source)], row, length_px / scale, float(rotation_deg))

    return picture_of


def seams(edit: pd.DataFrame, pose: Floats, following_of: NDArray[np.int64]) -> Floats:
    """D(i + 1, j) of every jump of an edit list of sprites.

    pose (n, n): between what the film shows after sprite i, and sprite j; following_of (n,): the
    sprite that shows what the film shows after i, −1 where none does.
    """
    number = edit["source"].to_numpy() // ORIENTATIONS
    before, after = number[:-1], number[1:]
    jump = after != following_of[before]
    return pose[before[jump], after[jump]]


def film_next(sprites: pd.DataFrame) -> NDArray[np.int64]:
    """For every sprite the sprite of the film's next frame, −1 where there is none."""
    step = sprites["step"].to_numpy()
    follows = np.append((np.diff(sprites["frame"]) == 1) & (np.diff(step) == 1), False)
    return np.where(follows, np.arange(1, len(sprites) + 1), -1)
