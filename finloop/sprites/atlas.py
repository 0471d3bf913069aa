"""The sprites as an atlas for game engines: pages of pictures, and JSON that lists their places.

The JSON is TexturePacker's and Aseprite's *hash* layout, which PixiJS, Phaser and Godot's importers
read: `frames` by name, `meta.frameTags` (Aseprite) and `animations` (PixiJS) for each sequence in
each orientation. A frame's pivot is the fish's mass centre, as a share of its untrimmed size,
measured from the upper left *edge* as engines do, not from the first pixel's centre. Pictures have
straight alpha there, as PNG requires.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.features.table import orientations_of

PADDING = 2  # px between pictures, so that an engine's filter reaches no neighbour
BLEED = 2  # px that colour extends under transparent pixels
_KEY = ["sprite", "orientation"]


class AtlasSlot(NamedTuple):
    """The rectangle of an atlas page that holds one sprite in one orientation.

    sprite: its row in the table of sprites; orientation: 1 …; name: "sequence/orientation/step";
    group: "sequence/orientation"; x, y: px of the upper left pixel; width, height: px.
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
    """One picture of the atlas: its width and height in px, and the sprites on it (`spots`)."""

    width: int
    height: int
    spots: list[AtlasSlot]


def lay_out_pages(sprites: pd.DataFrame, index: pd.DataFrame, page_px: int) -> list[AtlasPage]:
    """Return atlas pages, at most page_px wide and high, with every sprite in every orientation.

    sprites: schema `SPRITES`; index: that of sprites.arrow, with the size [px] of each sprite in
    each orientation. A sequence in one orientation stays on one page. FinloopError if a page cannot
    hold it.
    """
    groups = list(_groups(sprites, index))
    atlas: list[AtlasPage] = []
    while groups:
        fit = _count_fitting(groups, page_px)
        if fit == 0:
            name, spots = groups[0][0].group, groups[0]
            raise FinloopError(
                f"the {len(spots)} pictures of {name}, up to {max(s.width for s in spots)} x "
                f"{max(s.height for s in spots)} px, do not fit on a page of {page_px} px",
                "a page for at least one sequence in one orientation",
                "raise sprites.page_px, or list fewer frames",
            )
        atlas.append(_smallest([spot for group in groups[:fit] for spot in group], page_px))
        groups = groups[fit:]
    return atlas


def _groups(sprites: pd.DataFrame, index: pd.DataFrame) -> Iterator[list[AtlasSlot]]:
    sizes = index.set_index(_KEY)[["width_px", "height_px"]]
    for sequence, rows in sprites.groupby("sequence", sort=False):
        for number in range(1, orientations_of(sprites) + 1):
            group = f"{sequence}/{number:02d}"
            yield [
                AtlasSlot(sprite, number, f"{group}/{step:02d}", group, 0, 0, *map(int, size))
                for sprite, step in zip(rows["sprite"], rows["step"], strict=True)
                for size in [sizes.loc[(sprite, number)]]
            ]


def _count_fitting(groups: list[list[AtlasSlot]], page_px: int) -> int:
    low, high = 0, len(groups)
    while low < high:
        middle = (low + high + 1) // 2
        spots = [spot for group in groups[:middle] for spot in group]
        if _shelves(spots, page_px, page_px) is not None:
            low = middle
        else:
            high = middle - 1
    return low


def _smallest(spots: list[AtlasSlot], page_px: int) -> AtlasPage:
    """Return a page about as wide as high, no larger than `page_px`."""
    area = sum((s.width + PADDING) * (s.height + PADDING) for s in spots)
    width = min(page_px, max(int(area**0.5), max(s.width for s in spots) + 2 * PADDING))
    while (page := _shelves(spots, width, page_px)) is None:
        width = min(page_px, width + width // 8 + 1)
    return page


def _shelves(spots: list[AtlasSlot], width: int, height: int) -> AtlasPage | None:
    """Pack rows of pictures, highest first; None if they do not fit. The order stays as given."""
    places: dict[str, AtlasSlot] = {}
    x = y = PADDING
    shelf = right = 0
    for spot in sorted(spots, key=lambda s: (-s.height, -s.width)):
        if x + spot.width + PADDING > width:
            x, y, shelf = PADDING, y + shelf + PADDING, 0
        if x + spot.width + PADDING > width or y + spot.height + PADDING > height:
            return None
        places[spot.name] = spot._replace(x=x, y=y)
        x += spot.width + PADDING
        shelf, right = max(shelf, spot.height), max(right, x)
    return AtlasPage(right, y + shelf + PADDING, [places[spot.name] for spot in spots])


def draw_page(
    page: AtlasPage, pixels: Callable[[int, int], NDArray[np.uint8]]
) -> NDArray[np.uint8]:
    """Draw an atlas page: its picture (height, width, 4), RGBA with straight alpha.

    pixels(sprite, orientation): returns the premultiplied picture (h, w, 2 or 4) of one sprite.
    """
    canvas = np.zeros((page.height, page.width, 4), np.uint8)
    for spot in page.spots:
        here = canvas[spot.y : spot.y + spot.height, spot.x : spot.x + spot.width]
        source = pixels(spot.sprite, spot.orientation)
        here[..., :3], here[..., 3:] = source[..., :-1], source[..., -1:]  # grey gives R = G = B
    return straight_alpha(canvas)


def encode_png(rgba: NDArray[np.uint8]) -> bytes:
    """Return the bytes of a PNG file of an RGBA picture (h, w, 4).

    The file is smaller than OpenCV's default but takes longer to make.
    """
    settings = [cv2.IMWRITE_PNG_COMPRESSION, 6, cv2.IMWRITE_PNG_STRATEGY, 0]
    return cv2.imencode(".png", cv2.cvtColor(rgba, cv2.COLOR_RGBA2BGRA), settings)[1].tobytes()


def straight_alpha(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return premultiplied RGBA (h, w, 4) with straight alpha: its colour is divided by alpha.

    Colour also extends `BLEED` px under the transparent pixels around the edge. Premultiplying the
    result gives back the same numbers.
    """
    alpha = pixels[..., 3]
    # Whole-number division with rounding: (2·255·c + a) // 2a.
    divisor = np.maximum(alpha, 1).astype(np.uint32)[..., None]
    colour = ((510 * pixels[..., :3].astype(np.uint32) + divisor) // (2 * divisor)).astype(np.uint8)
    coloured = (alpha > 0).astype(np.uint8)
    colour *= coloured[..., None]
    for _ in range(BLEED):
        count = cv2.boxFilter(coloured, cv2.CV_16U, (3, 3), normalize=False, borderType=0)
        total = cv2.boxFilter(colour, cv2.CV_16U, (3, 3), normalize=False, borderType=0)
        new = (coloured == 0) & (count > 0)
        colour[new] = (total[new] / count[new][:, None]).round().astype(np.uint8)
        coloured |= new.astype(np.uint8)
    return np.dstack([colour, alpha])


def page_json(
    atlas: list[AtlasPage], number: int, sprites: pd.DataFrame, index: pd.DataFrame, rate_hz: float
) -> dict[str, Any]:
    """Return the JSON of page `number`: its sprites' rectangles, its sequences, each step's motion.

    sprites, index: as for `lay_out_pages`; rate_hz: frames per second. All sprites have the same
    untrimmed size; its middle is within a pixel of the mass centre.
    """
    page, reach = atlas[number], _reach(sprites, index)
    duration = round(1000 / rate_hz)
    centres = sprites[["x_px", "y_px"]].to_numpy()
    corners = index.set_index(_KEY)[["x0_px", "y0_px"]]
    frames = {
        spot.name: _frame(spot, centres[spot.sprite], corners.loc[spot[:2]], reach, duration)
        for spot in page.spots
    }
    groups: dict[str, list[str]] = {}
    for spot in page.spots:
        groups.setdefault(spot.group, []).append(spot.name)
    names = list(frames)
    meta = {
        "app": "finloop",
        "version": "1.0",
        "image": f"atlas-{number}.png",
        "format": "RGBA8888",
        "size": {"w": page.width, "h": page.height},
        "scale": "1",
        "frameRate": round(rate_hz, 4),
        "frameTags": [
            {"name": group, "from": names.index(of[0]), "to": names.index(of[-1]),
             "direction": "forward"}
            for group, of in groups.items()
        ],
        "motion": _motion(sprites),
    }  # fmt: skip
    if len(atlas) > 1:
        packs = [f"atlas-{n}.json" for n in range(len(atlas)) if n != number]
        meta["related_multi_packs"] = packs
    return {"frames": frames, "animations": groups, "meta": meta}


def _reach(sprites: pd.DataFrame, index: pd.DataFrame) -> int:
    """Return how far [px] any picture reaches from the pixel that holds its mass centre."""
    places = sprites[["x_px", "y_px"]].to_numpy()[index["sprite"]]
    x, y = np.floor(places + 0.5).T
    left, top = index["x0_px"].to_numpy(), index["y0_px"].to_numpy()
    right = left + index["width_px"].to_numpy() - 1
    bottom = top + index["height_px"].to_numpy() - 1
    return int(max((x - left).max(), (right - x).max(), (y - top).max(), (bottom - y).max()))


def _frame(
    spot: AtlasSlot, centre: Floats, corner: pd.Series, reach: int, duration: int
) -> dict[str, Any]:
    (x, y), (left, top), size = centre, corner, 2 * reach + 1
    origin_x, origin_y = int(np.floor(x + 0.5)) - reach, int(np.floor(y + 0.5)) - reach
    pivot = {
        "x": round((x - origin_x + 0.5) / size, 6),
        "y": round((y - origin_y + 0.5) / size, 6),
    }
    return {
        "frame": {"x": spot.x, "y": spot.y, "w": spot.width, "h": spot.height},
        "rotated": False,
        "trimmed": True,
        "spriteSourceSize": {
            "x": int(left - origin_x), "y": int(top - origin_y), "w": spot.width, "h": spot.height,
        },
        "sourceSize": {"w": size, "h": size},
        "pivot": pivot,
        "anchor": pivot,  # PixiJS's name for it
        "duration": duration,
    }  # fmt: skip


def _motion(sprites: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """Return how the fish moves in each step, and the scale of its picture."""
    numbers = ["scale", "forward", "sideways", "turn_deg"]
    return {
        f"{row.sequence}/{row.step:02d}": {"phase": row.phase}
        | {name: round(float(getattr(row, name)), 4) for name in numbers}
        for row in sprites.itertuples()
    }
