"""Exports for other programs: fish without their tank, and an edit list that needs no store.

Coordinates in px, x right, y down, pixel centres at integers.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Picture
from finloop.base.schema import Column, Schema, columns
from finloop.edit.schema import EDIT, SPRITE
from finloop.render.gallery import Gallery
from finloop.render.painter import Box, Painter, PlacedFish

_WHITE = 255
RIM = 3  # px around the fish that get its colour: what a codec or a filter reads beyond the edge
_FAINT = 16  # alpha below which a pixel's own colour is too coarse

_MM = ("x_mm", "y_mm", "aim_x_mm", "aim_y_mm")
READABLE = Schema(
    *EDIT.columns,
    *columns("int32", "1", "track_id", "frame"),
    Column("atlas", "string", "1", nullable=True),
    *columns("int32", "1", "partner_track_id", "partner_frame", nullable=True),
    Column("partner_atlas", "string", "1", nullable=True),
    *columns("float64", "mm", *_MM, nullable=True),
    Column("speed_mm_s", "float64", "mm/s", nullable=True),
)
"""An edit list for other programs: with the track and frame of the film that each row shows (a
sprite is a frame, too), the sprite's name in the atlas, and places and speed in mm, empty
without a scale."""


class FishOnlyPainter:
    """Paints fish without their tank, over black and over white, to find their alpha.

    Over black a pixel is F, premultiplied by alpha a; over white it is F + 255 − a.
    """

    def __init__(self, height: int, width: int, channels: int) -> None:
        """Create both canvases: height and width in px, 1 or 3 channels."""
        black = np.zeros((height, width, channels), np.uint8)
        self.black, self.white = Painter(black), Painter(black + np.uint8(_WHITE))

    def show(self, *fish: PlacedFish) -> Box:
        """Paint fish, given from the lowest layer up, over black and over white; return their box.

        The box covers all of them. Both canvases are clean before.
        """
        self.white.show(*fish)
        return self.black.show(*fish)

    def picture_in_box(self, box: Box) -> Picture:
        """Return the painted fish within a box: RGBA (h, w, 4) uint8, premultiplied by alpha.

        Both canvases are rounded: a colour may exceed its alpha by 1.
        """
        over_black = self.black.canvas[box.slices]
        through = self.white.canvas[box.slices].astype(np.float32) - over_black  # 255 − alpha
        alpha = np.rint(_WHITE - through.mean(axis=2, keepdims=True)).astype(np.uint8)
        rgb = over_black if over_black.shape[2] == 3 else over_black.repeat(3, axis=2)
        return np.concatenate([rgb, alpha], axis=2)


def box_of_all_fish(frames: Iterable[Sequence[PlacedFish]], painter: FishOnlyPainter) -> Box:
    """Return the smallest box of the canvas that holds all fish of all ticks, and a rim.

    frames: the fish of every tick; painter: paints them. The box is one pixel if no fish is on the
    canvas.
    """
    boxes = [box for fish in frames if not (box := painter.show(*fish)).is_empty]
    if not boxes:
        return Box(0, 0, 1, 1)
    return Box.enclose(boxes).grow(RIM).clip_to(painter.black.canvas.shape)


def cut_out_fish(
    frames: Iterable[Sequence[PlacedFish]], painter: FishOnlyPainter, crop: Box
) -> Iterator[Picture]:
    """Yield the fish of each tick without background: RGBA (h, w, 4) uint8 of the box `crop`.

    Alpha is straight, not premultiplied. The array is reused: take a copy to keep it. frames: the
    fish of every tick; painter: paints them; crop: that of `box_of_all_fish`, or a smaller one.
    """
    frame = np.zeros((crop.bottom - crop.top, crop.right - crop.left, 4), np.uint8)
    painted = Box(0, 0, 0, 0)  # part of the frame that is not empty
    for fish in frames:
        frame[painted.slices] = 0
        box = painter.show(*fish).grow(RIM).intersect(crop)
        painted = Box(0, 0, 0, 0)
        if not box.is_empty:
            painted = Box(
                box.top - crop.top, box.left - crop.left,
                box.bottom - crop.top, box.right - crop.left,
            )  # fmt: skip
            frame[painted.slices] = _straighten_alpha(painter.picture_in_box(box))
        yield frame


def _straighten_alpha(pixels: Picture) -> Picture:
    """Convert a premultiplied picture to straight alpha: (h, w, 4) RGBA uint8.

    The colour of a faint pixel is rounded too coarsely (at alpha 1 it is 0 or 255): it gets the
    mean around it, as transparent pixels within `RIM` do. Else video codecs, which halve the
    resolution of colour, and filters would bring noise, or black, into the edge.
    """
    premultiplied = pixels.astype(np.float32)
    around = cv2.boxFilter(
        premultiplied, -1, (2 * RIM + 1, 2 * RIM + 1), borderType=cv2.BORDER_CONSTANT
    )
    pixel_colour, mean_colour = (
        255 * picture[..., :3] / np.maximum(picture[..., 3:], 1e-6)
        for picture in (premultiplied, around)
    )
    colour = np.where(premultiplied[..., 3:] < _FAINT, mean_colour, pixel_colour)
    return np.concatenate([np.rint(colour).clip(0, 255).astype(np.uint8), pixels[..., 3:]], axis=2)


def sprites_of_sequence(
    sprites: pd.DataFrame, sequence: str, gallery: Gallery
) -> tuple[list[tuple[PlacedFish]], int]:
    """Return the sprites of a sequence as fish to draw, and half the width of a canvas for them.

    A square canvas 2 half + 1 px wide holds them all: each is headed right, with its mass centre in
    the middle pixel. sprites: schema SPRITES; sequence: name of the sequence.
    """
    rows = sprites[sprites["sequence"] == sequence]
    steps = [
        gallery.picture_to_draw(
            SPRITE, int(sprite), orientation=1, rotation_deg=0.0, scale=float(scale)
        )
        for sprite, scale in zip(rows["sprite"], rows["scale"], strict=True)
    ]
    # A whole diagonal of the largest picture (`near` has its height and width), as the mass centre
    # may lie anywhere in it.
    half = RIM + max(math.ceil(step.scale * math.hypot(*step.picture.near.shape)) for step in steps)
    return [(PlacedFish(half, half, step, partner=None, weight=0.0),) for step in steps], half


def add_film_sources(
    edit: pd.DataFrame, tracks: pd.DataFrame, sprites: pd.DataFrame,
    mm_per_px: float | None = None, length_px: float = np.nan,
) -> pd.DataFrame:  # fmt: skip
    """Add to an edit list the track and frame of each row in the film, and lengths in mm.

    The result has the columns READABLE. edit: schema EDIT; tracks: track_id and frame of every
    cut-out (pixels of a fish with alpha); sprites: schema SPRITES; mm_per_px: None where unknown;
    length_px: body length of the animal as drawn, for its speed.
    """
    source = _film_source_columns(edit, "", "source", tracks, sprites)
    partner = _film_source_columns(edit, "partner_", "partner", tracks, sprites)
    scale = np.nan if mm_per_px is None else mm_per_px
    mm = {name: edit[name.replace("_mm", "_px")] * scale for name in _MM}
    speed = edit["speed"].astype(float) * length_px * scale
    return pd.concat(
        [edit, source, partner.add_prefix("partner_"), pd.DataFrame(mm | {"speed_mm_s": speed})],
        axis=1,
    )


def flatten_poses(listed: pd.DataFrame) -> pd.DataFrame:
    """Return an edit list (READABLE) for CSV: list column `pose` becomes pose_1, pose_2 etc.

    A row without a pose has empty cells there. Where no scale is known, columns in mm are left out.
    """
    poses = [pose for pose in listed["pose"] if pose is not None]
    cells = np.full((len(listed), len(poses[0]) if poses else 0), np.nan)
    if poses:
        cells[listed["pose"].notna()] = poses
    names = [f"pose_{number}" for number in range(1, cells.shape[1] + 1)]
    pose_columns = pd.DataFrame(cells, listed.index, names)
    unknown = [name for name in (*_MM, "speed_mm_s") if listed[name].isna().all()]
    return pd.concat([listed.drop(columns=["pose", *unknown]), pose_columns], axis=1)


def _film_source_columns(
    edit: pd.DataFrame, prefix: str, source: str, tracks: pd.DataFrame, sprites: pd.DataFrame
) -> pd.DataFrame:
    """Return track, frame and sprite name of the picture in each row of an edit list.

    prefix, source: "" and "source" for the columns of the main picture, "partner_" and "partner"
    for the one to cross-fade with; tracks: track_id and frame of every cut-out; sprites: schema
    SPRITES. Cells without a picture, or a sprite, are empty.
    """
    kind, number = edit[f"{prefix}kind"], edit[source].fillna(0).to_numpy(int)
    is_sprite, is_empty = (kind == SPRITE).to_numpy(), kind.isna().to_numpy()
    cutout = np.where(is_sprite, 0, number)
    rows = sprites.iloc[np.where(is_sprite, number, 0)]
    orientations = edit[f"{prefix}orientation"].fillna(0)
    names = [
        f"{sequence}/{orientation:02d}/{step:02d}"
        for sequence, orientation, step in zip(
            rows["sequence"], orientations, rows["step"], strict=True
        )
    ]
    source_columns = {}
    for name in ("track_id", "frame"):
        values = np.where(is_sprite, rows[name].to_numpy(), tracks[name].to_numpy()[cutout])
        source_columns[name] = pd.Series(values, kind.index, dtype="Int32").mask(is_empty)
    atlas = pd.Series(names, kind.index, dtype=object).where(is_sprite, None)
    return pd.DataFrame(source_columns | {"atlas": atlas})
