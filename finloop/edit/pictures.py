"""The pictures of an edit list: what is drawn from tick to tick, and how well it joins (Eq. 5)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints
from finloop.distance.picture import SPAN, draw_centred_cutout, paired_distances
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies, Body
from finloop.edit.schema import FRAME, SPRITE, row_partner, row_picture
from finloop.puppet import Pose, PosedPicture, change_in_pose, mix_pictures, pose_cutout

Picture = NDArray[np.float32]


@dataclass(frozen=True)
class Pictures:
    """Draws the pictures of an edit list: one animal, centred, (size, size, channels), 0 … 1.

    reel: the film's cut-outs; size: px of a picture; bodies: the filmed postures. The animals are
    as large as the edit list draws them.
    """

    reel: Reel
    size: int
    bodies: Bodies

    def __call__(
        self, kind: str, source: int, orientation: int, rotation_deg: float, scale: float,
        mirrored: bool,
    ) -> Picture:  # fmt: skip
        """Return a picture: a sprite in an orientation, or a frame, turned by `rotation_deg`.

        kind: SPRITE or FRAME; source: sprite or film row; scale: drawn size / filmed size;
        mirrored: whether a frame is mirrored; a frame has no orientation.
        """
        reel, turn = self.reel, float(rotation_deg)
        if kind == FRAME:
            centre, cutout = reel.centres_px[source], reel.cutouts[source]
        else:
            centre, cutout = reel.sprite_centres_px[source], reel.read_sprite(source, orientation)
        is_flipped = kind == FRAME and mirrored
        if is_flipped:
            # Upside down, the picture turns the other way, and its heading has the other sign.
            turn = -turn - 2 * float(self.bodies.heading_deg[source])
        picture = draw_centred_cutout(cutout, centre, reel.length_px / scale, self.size, turn)
        return picture[::-1] if is_flipped else picture

    def target_pose(self, body: Body, scale: float, codes: Floats, turn_deg: float = 0.0) -> Pose:
        """Return the pose, in px of the picture, of a body in the posture of codes (c,).

        scale: drawn size / filmed size; turn_deg: added to the body's heading on screen. The body
        is in the middle of the picture.
        """
        middle = (self.size - 1) / 2
        pose = self.bodies.poses.pose_from_codes(int(body.row), codes)
        length_px = float(pose.size_px) * scale * self.size / (SPAN * self.reel.length_px)
        return pose.move_to(
            middle, middle, np.radians(float(body.heading_deg) + turn_deg), length_px
        )

    @property
    def box(self) -> tuple[int, int, int, int]:
        """Return the whole picture as a box: top, left, bottom, right."""
        return 0, 0, self.size, self.size

    def pose_body(self, body: Body, target: Pose) -> PosedPicture:
        """Return the picture of a filmed body, prepared to be drawn in a target pose."""
        cutout, pose = self.reel.cutouts[int(body.row)], self.bodies.poses.pose[int(body.row)]
        return pose_cutout(cutout, pose, target, bool(body.mirrored), sharp=False)

    def draw_body(self, body: Body, target: Pose) -> Picture:
        """Draw a filmed body in a target pose; return the picture (size, size, channels)."""
        return self.pose_body(body, target).draw_part(self.box)

    @cached_property
    def right_facing_sprites(self) -> Picture:
        """Return the pictures (s, size, size, channels) of all sprites, headed to the right."""
        return self.reel.draw_sprites(self.size)

    @cached_property
    def sprite_successors(self) -> Picture:
        """Return pictures of the film frames that follow the sprites, headed to the right.

        They are (s, size, size, channels), each turned as the next sprite would be.
        """
        return self.reel.draw_frames_after_sprites(self.size)


def cross_fade_distance(row: Any, pictures: Pictures) -> float:
    """Return the Euclidean distance (Eq. 5) between the two pictures of a cross-fade.

    row: of an edit list, a named tuple, with `weight` > 0.
    """
    return float(paired_distances(pictures(*row_picture(row)), pictures(*row_partner(row))))


def remove_ghost_fades(edit: pd.DataFrame, pictures: Pictures, most: float) -> pd.DataFrame:
    """Remove the cross-fades of pictures so unlike that two fish are seen; return the edit list.

    most: the largest Euclidean distance (Eq. 5) of pictures that are mixed. A partner once removed
    does not come back in the same cross-fade.
    """
    ghosts: list[int] = []
    for row in edit[edit["weight"] > 0].itertuples():
        removed_before = bool(ghosts) and ghosts[-1] == row.Index - 1
        if removed_before or cross_fade_distance(row, pictures) > most:
            ghosts.append(row.Index)
    clean = edit.copy()
    clean.loc[ghosts, "weight"] = 0.0
    clean.loc[ghosts, ["partner_kind", "partner", "partner_orientation"]] = None
    clean.loc[ghosts, ["partner_rotation_deg", "partner_scale"]] = np.nan
    clean.loc[ghosts, "partner_mirrored"] = False
    return clean


def drawn_step_distances(edit: pd.DataFrame, pictures: Pictures) -> Floats:
    """Return the Euclidean distances (ticks − 1,) (Eq. 5) of the pictures of successive ticks."""
    pairs = pairwise(draw_edit_list(edit, pictures))
    return np.array([float(paired_distances(after, before)) for before, after in pairs])


def draw_edit_list(edit: pd.DataFrame, pictures: Pictures) -> Iterator[Picture]:
    """Yield the picture (size, size, channels) that an edit list shows at each tick."""
    for row in edit.itertuples():
        to_draw = [row_picture(row), row_partner(row)] if row.weight else [row_picture(row)]
        if row.pose is None:
            drawn = [pictures(*picture) for picture in to_draw]
            yield mix_pictures(*drawn, row.weight) if row.weight else drawn[0]
            continue
        bodies = [pictures.bodies.body_in_edit_row(picture) for picture in to_draw]
        target = pictures.target_pose(bodies[0], row.scale, row.pose)
        posed = [pictures.pose_body(body, target) for body in bodies]
        yield (
            change_in_pose(*posed, row.weight, pictures.box)
            if row.weight
            else posed[0].draw_part(pictures.box)
        )


def measure_discontinuities(
    edit: pd.DataFrame, pictures: Pictures
) -> tuple[Floats, NDArray[np.intp]]:
    """Return the Euclidean distance (Eq. 5) of each join (k,), without cross-fades, and its tick.

    What the film would show next, turned as the picture on screen, is compared with what is drawn.
    A picture that is held for several ticks has one join, where it comes the second time. Where an
    earlier join has not died away, both pictures are drawn in the pose that includes what is left
    of it: there only light and skin differ.
    """
    next_sprite = _next_sprites(pictures.reel.sprites)
    distances, ticks = [], []
    rows = list(edit.itertuples())
    shown = [(row.kind, row.source, row.mirrored) for row in rows]
    for tick in range(1, len(rows)):
        before, now = rows[tick - 1], rows[tick]
        if tick > 1 and shown[tick - 2] == shown[tick - 1] == shown[tick]:
            continue  # the picture is held
        if before.kind == FRAME:
            next_row = int(pictures.reel.next_rows(before.source))
            if next_row != before.source and shown[tick] == (FRAME, next_row, before.mirrored):
                continue  # the film plays on
        elif now.kind == SPRITE and now.source == next_sprite[before.source]:
            continue  # so does the sequence of sprites
        distances.append(float(paired_distances(*_draw_join(before, now, pictures))))
        ticks.append(tick)
    return np.array(distances), np.array(ticks, np.intp)


def _draw_join(before: Any, now: Any, pictures: Pictures) -> tuple[Picture, Picture]:
    """Return both pictures of a join, headed right: the new one, and what the film would show.

    before, now: rows of an edit list, a tick apart; the film would show what follows `before`. If
    both rows have a pose, both pictures are drawn in that of `now`.
    """
    turn, bodies = -float(now.heading_deg), pictures.bodies  # turn: heads the fish right
    if now.pose is not None:
        body = bodies.body_in_edit_row(row_picture(now))
        target = pictures.target_pose(body, now.scale, now.pose, turn)
        drawn = pictures.draw_body(body, target)
        if before.pose is not None:
            due = bodies.next_body(bodies.body_in_edit_row(row_picture(before)))
            return drawn, pictures.draw_body(due, target)
    elif now.kind == FRAME:
        drawn = pictures(*row_picture(now._replace(rotation_deg=now.rotation_deg + turn)))
    else:
        drawn = pictures.right_facing_sprites[now.source]
    return drawn, _draw_due_picture(before, turn, pictures)


def _draw_due_picture(before: Any, turn_deg: float, pictures: Pictures) -> Picture:
    """Return the film's next frame after a row of an edit list, drawn in its filmed pose.

    before: that row, as a named tuple. If it shows a frame, the film's next frame is drawn: turned
    as that frame is in the row, and by `turn_deg` more, degrees anticlockwise on screen. If it
    shows a sprite, the film's next frame is drawn with the fish headed to the right; then
    `turn_deg` has no effect.
    """
    if before.kind == SPRITE:
        return pictures.sprite_successors[before.source]
    row, heading = int(pictures.reel.next_rows(before.source)), pictures.bodies.heading_deg
    # Each row is mirrored about its own heading: take back the difference.
    turn_deg += 2 * before.mirrored * (heading[before.source] - heading[row])
    next_frame = before._replace(source=row, rotation_deg=before.rotation_deg + turn_deg)
    return pictures(*row_picture(next_frame))


def _next_sprites(sprites: pd.DataFrame) -> Ints:
    """Return for each sprite (s,) the number of the sprite made of the film's next frame, or −1."""
    if not len(sprites):
        return np.zeros(0, np.int64)
    step = sprites["step"].to_numpy()
    follows = np.append((np.diff(sprites["frame"]) == 1) & (np.diff(step) == 1), False)
    return np.where(follows, np.arange(1, len(sprites) + 1), -1)
