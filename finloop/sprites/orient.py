"""Sprites: a few frames of the film, turned to fill all orientations (fish paper §3.3).

A cut-out is turned about its mass centre, without fringes and without clipping. Pictures are
premultiplied (h, w, channels) uint8, alpha last: only such neighbours may be mixed, else the colour
under transparent pixels bleeds into the edge. Angles are degrees, anticlockwise as seen; y is down.
Pixel centres lie at integers.
"""

from collections.abc import Iterator

import cv2
import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.axes import to_body_axes
from finloop.base.cutout import Cutout, Cutouts
from finloop.base.schema import Column, Schema, columns
from finloop.distance.reel import Reel
from finloop.features.table import orientation_heading_deg, wrap_deg
from finloop.sprites.choice import (
    SIDES,
    ChosenFrames,
    FrameRun,
    cycle_headings,
    smooth_series,
    turn_phases,
)
from finloop.sprites.settings import SpritesSettings

_REACH = 4  # px that a Lanczos kernel of four lobes reaches beyond a pixel
_SOLID = 64  # alpha from which a pixel belongs to the fish

SPRITES = Schema(
    Column("sprite", "int16", "1"),
    Column("sequence", "string", "1"),
    Column("step", "int16", "1"),
    Column("phase", "string", "1"),
    *columns("int32", "1", "row", "track_id", "frame"),
    Column("mirrored", "bool", "1"),
    *columns("float64", "px", "x_px", "y_px"),
    *columns("float32", "deg", "heading_deg", "head_offset_deg"),
    *columns("float32", "1", "scale", "motion_area_rel"),
    Column("bend", "float32", "body length²"),
    *columns("float32", "body length", "forward", "sideways"),
    Column("turn_deg", "float32", "deg"),
    Column("orientations", "int8", "1"),
)


def sprite_table(
    table: pd.DataFrame, choices: dict[str, ChosenFrames], settings: SpritesSettings
) -> pd.DataFrame:
    """Return the table of sprites (schema `SPRITES`): every chosen frame, its heading, its motion.

    table: from `swimmer_table`.
    """
    rows = pd.concat(
        [_sequence_rows(table, sequence, choice, settings) for sequence, choice in choices.items()]
    )
    rows.insert(0, "sprite", np.arange(len(rows)))
    return rows.reset_index(drop=True)[SPRITES.names]


def _sequence_rows(
    table: pd.DataFrame, sequence: str, choice: ChosenFrames, settings: SpritesSettings
) -> pd.DataFrame:
    """Return a table of one sequence's sprites: columns of `SPRITES` except `sprite`.

    heading_deg is the direction in the film at which a frame is drawn; forward, sideways and
    turn_deg are the motion to the next frame. Of a mirrored choice, what depends on the side has
    the other sign.
    """
    run, sign = choice.run, -1 if choice.mirrored else 1
    frames = table.iloc[run.rows]
    side = sign * SIDES.get(sequence, 0)  # of the turn as filmed; 0: no turn
    heading = _drawn_headings(table, run, side, settings)
    length = frames["length_px"].to_numpy()
    step = frames[["step_x_px", "step_y_px"]].to_numpy()
    forward, sideways = to_body_axes(step, np.radians(heading[:-1])).T / length
    return frames[["track_id", "frame", "x_px", "y_px", "orientations"]].assign(
        sequence=sequence,
        step=np.arange(len(frames)),
        phase=turn_phases(table, run, side, settings.hold) if side else "cycle",
        row=np.arange(run.rows.start, run.rows.stop),
        mirrored=choice.mirrored,
        heading_deg=wrap_deg(heading[:-1]),
        head_offset_deg=sign * wrap_deg(frames["heading"].to_numpy() - heading[:-1]),
        scale=np.median(table["length_px"]) / length,
        motion_area_rel=frames["area_rel"],
        bend=sign * frames["bend"],
        forward=forward,
        sideways=sign * sideways,
        turn_deg=sign * np.diff(heading),
    )


def _drawn_headings(
    table: pd.DataFrame, run: FrameRun, side: int, settings: SpritesSettings
) -> Floats:
    """Return the headings (frames + 1,) [°] at which a run's frames and the next frame are drawn.

    side: of the turn that the run shows, 1 left, −1 right, 0: no turn.
    """
    start, stop = run.rows.start, run.rows.stop
    has_next = stop < len(table) and table["track_id"].iat[stop] == run.track_id
    last = stop if has_next else stop - 1  # the last row whose heading is known
    if side:
        heading = smooth_series(table["heading"].to_numpy()[start : last + 1])
    else:
        heading = cycle_headings(table, start, last - start)
    if not has_next:  # the frame that would come next: the last change is repeated
        heading = np.r_[heading, 2 * heading[-1] - heading[-2]]
    turned_back_deg = -np.minimum(side * np.diff(heading), 0).sum()
    if side and turned_back_deg <= settings.turn_back_deg:  # it is noise, and taken out
        heading = side * scipy.optimize.isotonic_regression(side * heading).x
    return heading


def sprite_cutouts(sprites: pd.DataFrame, film: Cutouts) -> Iterator[Cutout]:
    """Yield the pixels (with alpha) of every sprite in every orientation, for the store of sprites.

    Their order is that of `sprite_store_row`. film: the cut-outs of all rows.
    """
    for row in sprites.itertuples():
        cutout = film[row.row]
        mirror = row.heading_deg if row.mirrored else None
        for orientation in range(1, row.orientations + 1):
            turn = float(orientation_heading_deg(orientation, row.orientations)) - row.heading_deg
            sprite = turn_cutout(cutout, row.x_px, row.y_px, turn, mirror)
            yield sprite._replace(sprite=row.sprite, orientation=orientation)


def sprite_outlines(reel: Reel) -> list[Floats]:
    """Return the convex hull (k, 2) of every sprite: px ahead and left of its mass centre.

    The px are those of the drawn animation, where all fish are equally long.
    """
    hulls = []
    for number, row in enumerate(reel.sprites.itertuples()):
        cutout = reel.read_sprite(number)
        solid = np.argwhere(cutout.pixels[..., -1] >= _SOLID)[:, ::-1].astype(np.float32)
        hull = cv2.convexHull(solid)[:, 0].astype(float)
        offset = hull + np.array([cutout.x0_px - row.x_px, cutout.y0_px - row.y_px])
        hulls.append(offset * np.array([row.scale, -row.scale]))
    return hulls


def rotation_matrix(angle_deg: float) -> Floats:
    """Return the matrix (2, 2) that turns points (x right, y down) by an angle, anticlockwise.

    It is exact at multiples of 90°.
    """
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    if angle_deg % 90 == 0:
        cos, sin = np.round([cos, sin])
    return np.array([[cos, sin], [-sin, cos]])


def turn_cutout(
    source: Cutout, x_px: float, y_px: float, angle_deg: float, mirror_axis_deg: float | None = None
) -> Cutout:
    """Return a cut-out, the pixels of a fish with alpha, turned about a point of the film.

    x_px, y_px: that point. With `mirror_axis_deg` the cut-out is first mirrored about the line of
    that direction through the point. Both are one resampling (Lanczos, four lobes), trimmed to the
    visible pixels. A turn by 0, or by any angle that maps pixels to pixels, is exact.
    """
    angle_deg %= 360
    if angle_deg == 0 and mirror_axis_deg is None:
        return source
    # The linear part of the map, and the box of the turned cut-out, in px of the film.
    linear = rotation_matrix(angle_deg)
    if mirror_axis_deg is not None:
        from_axis, to_axis = rotation_matrix(-mirror_axis_deg), rotation_matrix(mirror_axis_deg)
        linear = linear @ (to_axis @ np.diag([1.0, -1.0]) @ from_axis)
    pivot, origin = np.array([x_px, y_px]), np.array([source.x0_px, source.y0_px])
    h, w = source.pixels.shape[:2]
    corners = np.array([[0, 0], [w - 1, 0], [0, h - 1], [w - 1, h - 1]]) + origin
    turned_corners = (corners - pivot) @ linear.T + pivot
    low = np.floor(turned_corners.min(0)).astype(int) - _REACH
    high = np.ceil(turned_corners.max(0)).astype(int) + _REACH
    inverse = linear.T  # a rotation or reflection: its inverse is its transpose
    offset = pivot - origin + inverse @ (low - pivot)  # where in the source the canvas begins
    width, height = (high - low + 1).tolist()
    canvas = cv2.warpAffine(
        source.pixels.astype(np.float32), np.column_stack([inverse, offset]), (width, height),
        flags=cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT,
    )  # fmt: skip
    # The filter overshoots. Where alpha exceeds 255, the colour is lowered with it; otherwise edges
    # would shine.
    scaled = canvas * (255 / np.maximum(canvas[..., -1:], 255))
    pixels = np.rint(np.clip(scaled, 0, 255)).astype(np.uint8)
    np.minimum(pixels[..., :-1], pixels[..., -1:], out=pixels[..., :-1])
    left, top, pixels = trim_picture(pixels)
    return source._replace(pixels=pixels, x0_px=int(low[0]) + left, y0_px=int(low[1]) + top)


def trim_picture(pixels: NDArray[np.uint8]) -> tuple[int, int, NDArray[np.uint8]]:
    """Trim a picture to its visible pixels; return left and top of the part, px, and the part.

    The last channel is alpha. A wholly transparent picture is trimmed to its first pixel.
    """
    left, top, width, height = cv2.boundingRect(np.ascontiguousarray(pixels[..., -1]))
    bottom, right = top + max(height, 1), left + max(width, 1)
    return left, top, np.ascontiguousarray(pixels[top:bottom, left:right])
