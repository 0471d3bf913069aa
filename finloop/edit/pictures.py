"""The pictures of an edit list: what is drawn from tick to tick, and how well it joins (Eq. 5)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints
from finloop.distance.picture import SPAN, centre_cutout, distance_pair_by_pair
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies, Body
from finloop.edit.schema import FRAME, SPRITE
from finloop.puppet import Pose, blend, draw

Picture = NDArray[np.float32]
_HELPS = 100_000  # pairs of rows that are remembered


@dataclass(frozen=True)
class Pictures:
    """Draws what an edit list shows: one animal, centred, as (size, size, channels), 0 … 1.

    All animals come out at the size at which they are drawn. size: px.
    """

    reel: Reel
    size: int
    bodies: Bodies

    def __call__(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float,
        mirrored: bool,
    ) -> Picture:  # fmt: skip
        """Draw a sprite in an orientation, or a frame, which has none, turned by `rotation_deg`."""
        reel, turn = self.reel, float(rotation_deg)
        if kind == FRAME:
            centre, cutout = reel.centres_px[source], reel.film[source]
        else:
            centre, cutout = reel.sprite_centres_px[source], reel.sprite(source, orientation)
        if kind == FRAME and mirrored:
            heading = float(self.bodies.heading_deg[source])
            turn = -turn - 2 * heading
            return centre_cutout(cutout, centre, reel.length_px / scale, self.size, turn)[::-1]
        return centre_cutout(cutout, centre, reel.length_px / scale, self.size, turn)

    def target(self, body: Body, scale: float, codes: Floats, turn_deg: float = 0.0) -> Pose:
        """Return the pose, in px of the picture, that draws a body in the posture of codes (c,).

        scale: drawn size / filmed size; turn_deg: turns it further than its heading on screen.
        """
        middle = (self.size - 1) / 2
        pose = self.bodies.poses.pose_from_codes(int(body.row), codes)
        size = float(pose.size_px) * scale * self.size / (SPAN * self.reel.length_px)
        return pose.move_to(middle, middle, np.radians(float(body.heading_deg) + turn_deg), size)

    def draw_body(self, body: Body, target: Pose) -> Picture:
        """Draw a filmed body in a target pose; return the picture (size, size, channels)."""
        row, size = int(body.row), (self.size, self.size)
        cutout, pose = self.reel.film[row], self.bodies.poses.pose[row]
        return draw(cutout, pose, target, size, mirrored=bool(body.mirrored), sharp=False)

    @cached_property
    def helps(self) -> Callable[[int, int, bool, bool], bool]:
        """Return a test: whether a row looks more like another in that one's posture.

        Its arguments: the two row numbers, and whether each row is mirrored.
        """
        return lru_cache(_HELPS)(self._helps)

    def _helps(self, row: int, other: int, mirrored: bool, other_mirrored: bool) -> bool:
        middle, size = (self.size - 1) / 2, self.size / SPAN
        one, two = (
            Body(np.array(number), np.array(flip), np.zeros(()))
            for number, flip in ((row, mirrored), (other, other_mirrored))
        )
        own, its = (
            self.bodies.poses.pose_from_codes(int(body.row), self.bodies.codes(body))
            for body in (one, two)
        )
        there = its.move_to(middle, middle, 0, size)
        wanted = self.draw_body(two, there)
        plain = self.draw_body(one, own.move_to(middle, middle, 0, size))
        return bool(
            distance_pair_by_pair(self.draw_body(one, there), wanted)
            < distance_pair_by_pair(plain, wanted)
        )

    @cached_property
    def right_facing_sprites(self) -> Picture:
        """Return pictures (s, size, size, channels) of all sprites, headed right."""
        return self.reel.sprite_pictures(self.size)

    @cached_property
    def sprite_successors(self) -> Picture:
        """Return pictures (s, size, size, channels) of what the film shows after each sprite.

        Each is turned as the next sprite would be if the first one heads right.
        """
        return self.reel.after_sprites(self.size)


def fade_distance(row: Any, pictures: Pictures) -> float:
    """Return the distance (Eq. 5) between the picture of a tick and the partner that fades out.

    row: a row of an edit list as a named tuple, with `weight` > 0.
    """
    return float(distance_pair_by_pair(_row_picture(row, pictures), _partner(row, pictures)))


def _row_picture(row: Any, pictures: Pictures) -> Picture:
    return pictures(
        row.kind, row.source, row.orientation, row.rotation_deg, row.scale, row.mirrored
    )


def _partner(row: Any, pictures: Pictures) -> Picture:
    return pictures(
        row.partner_kind, row.partner, row.partner_orientation, row.partner_rotation_deg,
        row.partner_scale, row.partner_mirrored,
    )  # fmt: skip


def _body(row: Any, pictures: Pictures) -> Body:
    own = row.kind, row.source, row.orientation, row.rotation_deg, row.mirrored
    return pictures.bodies.edit_row_body(*own)


def _partner_body(row: Any, pictures: Pictures) -> Body:
    return pictures.bodies.edit_row_body(
        row.partner_kind, row.partner, row.partner_orientation, row.partner_rotation_deg,
        row.partner_mirrored,
    )  # fmt: skip


def without_ghosts(edit: pd.DataFrame, pictures: Pictures, most: float) -> pd.DataFrame:
    """Return the edit list without partners farther than `most` from the picture they fade into.

    most: a distance (Eq. 5). Two unlike fish on top of each other look like ghosts. A partner once
    removed does not come back in the same cross-fade.
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
    clean.loc[ghosts, "partner_mirrored"] = False
    return clean


def drawn_steps(edit: pd.DataFrame, pictures: Pictures) -> Floats:
    """Return the distances (ticks − 1,) (Eq. 5) between the drawn pictures of successive ticks.

    Joins, poses and cross-fades are included.
    """
    every = pairwise(draw_edit(edit, pictures))
    return np.array([float(distance_pair_by_pair(after, before)) for before, after in every])


def draw_edit(edit: pd.DataFrame, pictures: Pictures) -> Iterator[Picture]:
    """Yield the picture (size, size, channels) that an edit list shows at each tick."""
    for row in edit.itertuples():
        if row.pose is None:
            first = _row_picture(row, pictures)
        else:
            body = _body(row, pictures)
            target = pictures.target(body, row.scale, row.pose)
            first = pictures.draw_body(body, target)
        if row.weight == 0:
            yield first
        elif row.pose is None:
            yield blend(first, _partner(row, pictures), row.weight)
        else:
            yield blend(first, pictures.draw_body(_partner_body(row, pictures), target), row.weight)


def seams(edit: pd.DataFrame, pictures: Pictures) -> tuple[Floats, NDArray[np.intp]]:
    """Return the discontinuity (k,) (Eq. 5) and the tick (k,) of every join, without cross-fades.

    It compares what the film would show next, turned as the picture on screen, with what is drawn.
    A picture that is held for several ticks has one join, where it comes the second time. Where an
    earlier join has not died away, the pose of the new picture includes what is left of it. There
    only light and skin are compared.
    """
    next_sprite = film_next(pictures.reel.sprites)
    distances, ticks = [], []
    rows = list(edit.itertuples())
    for tick in range(1, len(rows)):
        before, now = rows[tick - 1], rows[tick]
        held = [(one.kind, one.source, one.mirrored) for one in rows[max(tick - 2, 0) : tick + 1]]
        if len(held) == 3 and len(set(held)) == 1:
            continue
        if before.kind == FRAME:
            follows = int(pictures.reel.next_rows(before.source))
            alike = now.kind == FRAME and now.mirrored == before.mirrored
            if alike and now.source == follows != before.source:
                continue
        elif now.kind == SPRITE and now.source == next_sprite[before.source]:
            continue
        distances.append(
            float(distance_pair_by_pair(_new(now, pictures), _next_picture(before, now, pictures)))
        )
        ticks.append(tick)
    return np.array(distances), np.array(ticks, np.intp)


def _new(now: Any, pictures: Pictures) -> Picture:
    turn = -float(now.heading_deg)
    if now.pose is not None:
        body = _body(now, pictures)
        return pictures.draw_body(body, pictures.target(body, now.scale, now.pose, turn))
    if now.kind == FRAME:
        return _row_picture(now._replace(rotation_deg=now.rotation_deg + turn), pictures)
    return pictures.right_facing_sprites[now.source]


def _next_picture(before: Any, now: Any, pictures: Pictures) -> Picture:
    """Draw what the film shows after a row, at the fish's current heading."""
    turn = -float(now.heading_deg)
    if before.pose is not None and now.pose is not None:
        target = pictures.target(_body(now, pictures), now.scale, now.pose, turn)
        return pictures.draw_body(pictures.bodies.next_body(_body(before, pictures)), target)
    if before.kind == SPRITE:
        return pictures.sprite_successors[before.source]
    follows = int(pictures.reel.next_rows(before.source))
    side = 2 * before.mirrored * (
        pictures.bodies.heading_deg[before.source] - pictures.bodies.heading_deg[follows]
    )  # fmt: skip
    return _row_picture(
        before._replace(source=follows, rotation_deg=before.rotation_deg + side + turn), pictures
    )


def film_next(sprites: pd.DataFrame) -> Ints:
    """Return for every sprite (s,) the number of the sprite of the film's next frame, or −1."""
    if not len(sprites):
        return np.zeros(0, np.int64)
    step = sprites["step"].to_numpy()
    follows = np.append((np.diff(sprites["frame"]) == 1) & (np.diff(step) == 1), False)
    return np.where(follows, np.arange(1, len(sprites) + 1), -1)
