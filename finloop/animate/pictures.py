"""Pictures behind an edit list: what is drawn from tick to tick, and how well it joins (Eq. 5)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.edit_list import FRAME, SPRITE
from finloop.base.arrays import Floats, Ints
from finloop.distance.picture import apart, picture
from finloop.reel import Reel

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Pictures:
    """Centred pictures of what an edit list names, at the drawn size, `size` px."""

    reel: Reel
    size: int

    def __call__(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float
    ) -> Picture:
        """A sprite in an orientation, or a frame (its orientation does not count), turned."""
        reel = self.reel
        if kind == FRAME:
            one, cutout = reel.places[source], reel.film[source]
        else:
            one, cutout = reel.sprite_places[source], reel.sprite(source, orientation)
        return picture(cutout, one, reel.length_px / scale, self.size, float(rotation_deg))

    @cached_property
    def headed(self) -> Picture:
        """Every sprite headed right."""
        return self.reel.sprite_pictures(self.size)

    @cached_property
    def after(self) -> Picture:
        """What the film shows after every sprite, turned as the sprite's next one would be."""
        return self.reel.after_sprites(self.size)


def fade_distance(row: Any, pictures: Pictures) -> float:
    """Eq. 5 between the two pictures of a cross-fade, a row of an edit list."""
    return float(apart(_own(row, pictures), _partner(row, pictures)))


def _own(row: Any, pictures: Pictures) -> Picture:
    return pictures(row.kind, row.source, row.orientation, row.rotation_deg, row.scale)


def _partner(row: Any, pictures: Pictures) -> Picture:
    return pictures(
        row.partner_kind, row.partner, row.partner_orientation, row.partner_rotation_deg,
        row.partner_scale,
    )  # fmt: skip


def without_ghosts(edit: pd.DataFrame, pictures: Pictures, most: float) -> pd.DataFrame:
    """The edit list without what fades out while it is farther than `most` from what fades in.

    Two unlike fish on one another look like ghosts.
    """
    ghosts: list[int] = []
    for row in edit[edit["weight"] > 0].itertuples():
        before = bool(ghosts) and ghosts[-1] == row.Index - 1  # once gone, it does not come back
        if before or fade_distance(row, pictures) > most:
            ghosts.append(row.Index)
    clean = edit.copy()
    clean.loc[ghosts, "weight"] = 0.0
    clean.loc[ghosts, ["partner_kind", "partner", "partner_orientation"]] = None
    clean.loc[ghosts, ["partner_rotation_deg", "partner_scale"]] = np.nan
    return clean


def drawn_steps(edit: pd.DataFrame, pictures: Pictures) -> Floats:
    """Eq. 5 between what is drawn at successive ticks, cross-fades and all."""
    every = pairwise(_drawn(edit, pictures))
    return np.array([float(apart(after, before)) for before, after in every])


def _drawn(edit: pd.DataFrame, pictures: Pictures) -> Iterator[Picture]:
    for row in edit.itertuples():
        shown = _own(row, pictures)
        if row.weight > 0:
            shown = (1 - row.weight) * shown + row.weight * _partner(row, pictures)
        yield shown


def seams(edit: pd.DataFrame, pictures: Pictures) -> tuple[Floats, NDArray[np.intp]]:
    """D(i + 1, j) of every jump i → j of an edit list, without its cross-fade, and its tick.

    What the film shows after the picture on screen, turned as that is, against what is drawn.
    """
    next_sprite = film_next(pictures.reel.sprites)
    distances, ticks = [], []
    rows = list(edit.itertuples())
    for tick in range(1, len(rows)):
        before, now = rows[tick - 1], rows[tick]
        turn = -float(now.heading_deg)
        if before.kind == FRAME:
            follows = int(pictures.reel.after(before.source))
            if now.kind == FRAME and now.source == follows != before.source:
                continue
            before = before._replace(source=follows, rotation_deg=before.rotation_deg + turn)
            expected = _own(before, pictures)
        else:
            if now.kind == SPRITE and now.source == next_sprite[before.source]:
                continue
            expected = pictures.after[before.source]
        if now.kind == FRAME:
            drawn = _own(now._replace(rotation_deg=now.rotation_deg + turn), pictures)
        else:
            drawn = pictures.headed[now.source]
        distances.append(float(apart(drawn, expected)))
        ticks.append(tick)
    return np.array(distances), np.array(ticks, np.intp)


def film_next(sprites: pd.DataFrame) -> Ints:
    """For every sprite the sprite of the film's next frame, −1 where there is none."""
    step = sprites["step"].to_numpy()
    follows = np.append((np.diff(sprites["frame"]) == 1) & (np.diff(step) == 1), False)
    return np.where(follows, np.arange(1, len(sprites) + 1), -1)
