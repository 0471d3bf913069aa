"""Pictures behind an edit list: how alike any two sprites are, what is drawn from tick to tick."""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate_edit import SPRITE
from finloop.distance import film_rows, picture
from finloop.features import ORIENTATIONS
from finloop.files.cutouts import CutoutStore

SIZE = 64  # px of a centred picture
_PAIRS = 3000  # natural steps that are looked at

Floats = NDArray[np.float64]


def film_steps(features: pd.DataFrame, film: CutoutStore, length_px: float) -> Floats:
    """Eq. 5 between successive frames of the film, at most `_PAIRS` of them spread over it."""
    rows = film_rows(film)
    table = features.sort_values(["track_id", "frame"])
    same = (np.diff(table["track_id"]) == 0) & (np.diff(table["frame"]) == 1)
    starts = np.flatnonzero(same)
    starts = starts[np.linspace(0, len(starts) - 1, min(len(starts), _PAIRS)).astype(int)]
    places = list(table[["track_id", "frame", "x_px", "y_px"]].itertuples(index=False))

    def shown(place: int) -> NDArray[np.float32]:
        one = places[place]
        return picture(film[int(rows[one[:2]])], one, length_px, SIZE)

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
        shown = picture_of(row.kind, row.source, row.rotation_deg, row.scale)
        if row.weight > 0:
            partner = picture_of(
                row.partner_kind, row.partner, row.partner_rotation_deg, row.partner_scale
            )
            shown = (1 - row.weight) * shown + row.weight * partner
        yield shown


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
        return picture(store[int(source)], row, length_px / scale, SIZE, float(rotation_deg))

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
