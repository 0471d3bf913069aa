"""The sprites as an atlas for game engines: pages of pictures, and JSON that lists their places.

The JSON is TexturePacker's and Aseprite's *hash* layout, which PixiJS, Phaser and Godot's importers
read: `frames` by name, `meta.frameTags` (Aseprite) and `animations` (PixiJS) for each sequence in
each orientation. A frame's pivot is the fish's mass centre, as a share of its untrimmed size,
measured from the upper left *edge* as engines do, not from the first pixel's centre. Pictures have
straight alpha there, as PNG requires.
"""

from bisect import bisect_left
from collections.abc import Callable
from itertools import chain
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.errors import FinloopError
from finloop.extract.matte import drop_residue
from finloop.features.table import count_orientations

PADDING = 2  # px between pictures, so that an engine's filter reaches no neighbour
BLEED = 2  # px that colour extends under transparent pixels
_KEY = ["sprite", "orientation"]


class AtlasSlot(NamedTuple):
    """The rectangle [px] of an atlas page that holds one sprite in one orientation.

    sprite: its row in the table of sprites; orientation: 1 …; name: "sequence/orientation/step";
    group: "sequence/orientation"; x, y: of the upper left pixel.
    """

    sprite: int
    orientation: int
    name: str
    group: str
    x: int
    y: int
    width: int
    height: int


class AtlasPage(NamedTuple):
    """One picture of the atlas: its width and height in px, and the sprites on it."""

    width: int
    height: int
    slots: list[AtlasSlot]


def lay_out_pages(sprites: pd.DataFrame, index: pd.DataFrame, page_px: int) -> list[AtlasPage]:
    """Return atlas pages of at most page_px × page_px, with all sprites in all orientations.

    index: that of sprites.arrow, with the size [px] of each sprite in each orientation. A sequence
    in one orientation stays on one page. FinloopError if a page cannot hold it.
    """
    groups = _list_slots(sprites, index)

    def overflows_page(count: int) -> bool:
        """Return whether the first `count` groups that are left do not fit on one page."""
        return _pack_page([*chain(*groups[:count])], page_px, page_px) is None

    # Each page gets as many groups as fit, and is about as wide as high.
    atlas: list[AtlasPage] = []
    while groups:
        # The counts 1, 2 … up to the last that fits do not overflow: `fit` is their number.
        fit = bisect_left(range(1, len(groups) + 1), True, key=overflows_page)
        if fit == 0:
            slots = groups[0]
            raise FinloopError(
                f"the {len(slots)} pictures of {slots[0].group}, up to "
                f"{max(s.width for s in slots)} x {max(s.height for s in slots)} px, do not fit on "
                f"a page of {page_px} px",
                "a page for at least one sequence in one orientation",
                "raise sprites.page_px, or list fewer frames",
            )
        slots = [*chain(*groups[:fit])]
        area = sum((s.width + PADDING) * (s.height + PADDING) for s in slots)
        width = min(page_px, max(int(area**0.5), max(s.width for s in slots) + 2 * PADDING))
        while (page := _pack_page(slots, width, page_px)) is None:
            width = min(page_px, width + width // 8 + 1)
        atlas.append(page)
        groups = groups[fit:]
    return atlas


def _list_slots(sprites: pd.DataFrame, index: pd.DataFrame) -> list[list[AtlasSlot]]:
    """Return an atlas slot for each sprite, by sequence and orientation; x and y are unset.

    index: has the size [px] of each sprite in each orientation.
    """
    sizes = index.set_index(_KEY)[["width_px", "height_px"]]
    groups = []
    for sequence, rows in sprites.groupby("sequence", sort=False):
        for orientation in range(1, count_orientations(sprites) + 1):
            group = f"{sequence}/{orientation:02d}"
            slots = []
            for sprite, step in zip(rows["sprite"], rows["step"], strict=True):
                width, height = map(int, sizes.loc[(sprite, orientation)])
                name = f"{group}/{step:02d}"
                slots.append(AtlasSlot(sprite, orientation, name, group, 0, 0, width, height))
            groups.append(slots)
    return groups


def _pack_page(slots: list[AtlasSlot], most_width: int, most_height: int) -> AtlasPage | None:
    """Pack slots onto a page, side by side in lines, highest first; None if they do not fit.

    slots: their x and y are still to be set. most_width, most_height: of the page, px.
    """
    places: dict[str, AtlasSlot] = {}
    x = y = PADDING
    line_height = page_width = 0
    for slot in sorted(slots, key=lambda s: (-s.height, -s.width)):
        if x + slot.width + PADDING > most_width:
            x, y, line_height = PADDING, y + line_height + PADDING, 0
        if x + slot.width + PADDING > most_width or y + slot.height + PADDING > most_height:
            return None
        places[slot.name] = slot._replace(x=x, y=y)
        x += slot.width + PADDING
        line_height, page_width = max(line_height, slot.height), max(page_width, x)
    return AtlasPage(page_width, y + line_height + PADDING, [places[slot.name] for slot in slots])


def draw_atlas_page(
    page: AtlasPage, read_pixels: Callable[[int, int], NDArray[np.uint8]]
) -> NDArray[np.uint8]:
    """Draw an atlas page as a picture (height, width, 4), RGBA with straight alpha.

    read_pixels(sprite, orientation): returns its premultiplied picture (h, w, 2 or 4). Residue is
    left out, as other programs have other grounds.
    """
    canvas = np.zeros((page.height, page.width, 4), np.uint8)
    for slot in page.slots:
        target = canvas[slot.y : slot.y + slot.height, slot.x : slot.x + slot.width]
        source = drop_residue(read_pixels(slot.sprite, slot.orientation))
        target[..., :3] = source[..., :-1]  # grey gives R = G = B
        target[..., 3:] = source[..., -1:]
    return to_straight_alpha(canvas)


def encode_png(rgba: NDArray[np.uint8]) -> bytes:
    """Encode an RGBA picture (h, w, 4) as PNG: smaller than OpenCV's default, but slower."""
    settings = [cv2.IMWRITE_PNG_COMPRESSION, 6, cv2.IMWRITE_PNG_STRATEGY, 0]  # zlib's defaults
    return cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA), settings)[1].tobytes()


def to_straight_alpha(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert a premultiplied RGBA picture (h, w, 4) to straight alpha: colour divided by alpha.

    Colour also extends `BLEED` px under the transparent pixels around the edge. Premultiplying the
    result gives back the same numbers.
    """
    alpha = pixels[..., 3]
    # Whole-number division with rounding: (2·255·c + a) // 2a.
    divisor = np.maximum(alpha, 1).astype(np.uint32)[..., None]
    colour = ((510 * pixels[..., :3].astype(np.uint32) + divisor) // (2 * divisor)).astype(np.uint8)
    coloured = (alpha > 0).astype(np.uint8)
    colour *= coloured[..., None]
    for _ in range(BLEED):  # a transparent pixel gets the mean of its coloured neighbours
        count = cv2.boxFilter(coloured, cv2.CV_16U, (3, 3), normalize=False, borderType=0)
        total = cv2.boxFilter(colour, cv2.CV_16U, (3, 3), normalize=False, borderType=0)
        newly_coloured = (coloured == 0) & (count > 0)
        colour[newly_coloured] = (
            (total[newly_coloured] / count[newly_coloured][:, None]).round().astype(np.uint8)
        )
        coloured |= newly_coloured.astype(np.uint8)
    return np.dstack([colour, alpha])


def atlas_page_json(
    atlas: list[AtlasPage], page_number: int, sprites: pd.DataFrame, index: pd.DataFrame,
    rate_hz: float,
) -> dict[str, Any]:  # fmt: skip
    """Return the JSON of an atlas page: its sprites' rectangles, sequences, and each step's motion.

    index: has the place and size [px] of each sprite in each orientation. All sprites have the same
    untrimmed size; its middle is within a pixel of the mass centre. page_number: of the page in
    `atlas`, from 0.
    """
    page = atlas[page_number]
    # The untrimmed size: squares of 2 reach + 1 px around the pixel with the mass centre.
    centres = sprites[["x_px", "y_px"]].to_numpy()
    middles = np.floor(centres + 0.5)
    corner = index[["x0_px", "y0_px"]].to_numpy() - middles[index["sprite"]]
    size = index[["width_px", "height_px"]].to_numpy()
    reach = int(max((-corner).max(), (corner + size - 1).max()))
    corners = index.set_index(_KEY)[["x0_px", "y0_px"]]
    frames: dict[str, dict[str, Any]] = {}
    groups: dict[str, list[str]] = {}
    for slot in page.slots:
        corner_px = corners.loc[(slot.sprite, slot.orientation)].to_numpy()
        frames[slot.name] = {
            **_frame_rectangles(slot, corner_px, centres[slot.sprite], reach),
            "duration": round(1000 / rate_hz),
        }
        groups.setdefault(slot.group, []).append(slot.name)
    # The page, its sequences, and how the fish moves in each step.
    names = list(frames)
    motion = ["scale", "forward", "sideways", "turn_deg"]
    meta = {
        "app": "finloop",
        "version": "1.0",
        "image": f"atlas-{page_number}.png",
        "format": "RGBA8888",
        "size": {"w": page.width, "h": page.height},
        "scale": "1",
        "frameRate": round(rate_hz, 4),
        "frameTags": [
            {"name": group, "from": names.index(in_group[0]), "to": names.index(in_group[-1]),
             "direction": "forward"}
            for group, in_group in groups.items()
        ],
        "motion": {
            f"{row.sequence}/{row.step:02d}": {"phase": row.phase}
            | {name: round(float(getattr(row, name)), 4) for name in motion}
            for row in sprites.itertuples()
        },
    }  # fmt: skip
    if len(atlas) > 1:
        packs = [f"atlas-{n}.json" for n in range(len(atlas)) if n != page_number]
        meta["related_multi_packs"] = packs
    return {"frames": frames, "animations": groups, "meta": meta}


def _frame_rectangles(
    slot: AtlasSlot, corner_px: NDArray[Any], centre_px: NDArray[Any], reach: int
) -> dict[str, Any]:
    """Return the JSON of where a sprite lies on its page and in its untrimmed square.

    corner_px, centre_px (2,): x, y of its upper left pixel and of its mass centre, in its own
    coordinates; reach: the square extends so many px to each side of the centre's pixel.
    """
    (x, y), side = centre_px, 2 * reach + 1
    origin_x, origin_y = (np.floor(centre_px + 0.5) - reach).astype(int).tolist()
    # A share of the square, from its edge: half a px before its first pixel's centre.
    pivot = {"x": round((x - origin_x + 0.5) / side, 6), "y": round((y - origin_y + 0.5) / side, 6)}
    return {
        "frame": {"x": slot.x, "y": slot.y, "w": slot.width, "h": slot.height},
        "rotated": False,
        "trimmed": True,
        "spriteSourceSize": {
            "x": int(corner_px[0] - origin_x), "y": int(corner_px[1] - origin_y),
            "w": slot.width, "h": slot.height,
        },
        "sourceSize": {"w": side, "h": side},
        "pivot": pivot,
        "anchor": pivot,  # PixiJS's name for it
    }  # fmt: skip
