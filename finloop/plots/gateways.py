"""Fig. 14 of the fish paper: the pictures of gateways, side by side."""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.distance.map import MapFacts
from finloop.distance.reel import Reel
from finloop.gateways.find import IN, OUT, draw_sprites_and_next
from finloop.plots.loops import TransitionPictures, spread_table_rows
from finloop.plots.parts import INK, Picture, composite_on_grey, join_in_rows, write_text

Stack = NDArray[np.float32]

TILE = 150  # px
_STRIP = 20  # px, height of a headline
_COLUMNS = 3  # gateways in a row
_HEADLINES = {
    IN: "IN: sprite | next as filmed | next frame instead | half of both",
    OUT: "OUT: frame | next as filmed | next sprite instead | half of both",
}


def gateway_pictures(
    gateways: pd.DataFrame, most: int, reel: Reel, facts: MapFacts
) -> Iterator[TransitionPictures]:
    """Yield the pictures of gateways, in the pose in which their two sides were compared.

    At most `most` gateways are shown, evenly spaced from the smallest distance to the largest. A
    picture is (TILE, TILE, c). gateways: columns sprite, row, orientation (0 = any), direction (IN:
    from a sprite into the film, OUT: back), distance. facts: how the distance map was made.
    """
    by_distance = gateways.sort_values("distance", kind="stable")

    @lru_cache(1)  # in the pose BODY all sprites have one orientation
    def load_next_and_sprite_pictures(orientation: int) -> tuple[Stack, Stack]:
        """Return pictures of the frames after all sprites, and of all sprites.

        orientation: in which they are drawn.
        """
        return draw_sprites_and_next(reel, TILE, facts.frame_of_reference, orientation)

    for gateway in spread_table_rows(by_distance, most).itertuples():
        sprite, row = reel.sprites.iloc[gateway.sprite], reel.features.iloc[gateway.row]
        next_pictures, sprite_pictures = load_next_and_sprite_pictures(max(1, gateway.orientation))
        after_sprite = next_pictures[gateway.sprite]
        sprite_itself = sprite_pictures[gateway.sprite]
        inward = gateway.direction == IN
        # On the way out the film's next frame is drawn, too; on the way in it is not used.
        rows = np.array([gateway.row, gateway.row + (not inward)])
        frame, after_frame = reel.draw_rows(rows, TILE, facts.frame_of_reference)
        sprite_name = f"{sprite['sequence']} {sprite['step']} "
        sprite_name += f"({sprite['track_id']}:{sprite['frame']})"
        frame_name = f"film {row['track_id']:.0f}:{row['frame']:.0f}"
        below = f"{gateway.distance / facts.step_median:.2f} steps"
        if inward:
            above = f"{sprite_name} > {frame_name}"
            yield TransitionPictures(sprite_itself, after_sprite, frame, above, below)
        else:
            above = f"{frame_name} > {sprite_name}"
            yield TransitionPictures(frame, after_frame, sprite_itself, above, below)


def draw_gateways(gateways: Mapping[str, Sequence[TransitionPictures]]) -> Picture:
    """Return a picture (h, w, 3) of gateways, each direction below a line that explains it.

    gateways: direction (IN, OUT) → gateways.
    """
    bands = []
    for direction, pictures in gateways.items():
        strip = np.full((_STRIP, 4 * TILE * _COLUMNS, 3), 255, np.uint8)  # 4 pictures a gateway
        write_text(strip, _HEADLINES[direction], (4, _STRIP - 5), INK, font_scale=0.45)
        bands += [strip, *join_in_rows([_draw_gateway(gateway) for gateway in pictures], _COLUMNS)]
    return np.vstack(bands)


def _draw_gateway(gateway: TransitionPictures) -> Picture:
    """Return four pictures of a gateway side by side, each (TILE, TILE, 3), with two texts.

    They are the last one, the next as filmed, the next through the gateway, and the mean of both.
    """
    mean = ((gateway.natural + gateway.instead) / 2).astype(np.float32)
    stacks = (gateway.before, gateway.natural, gateway.instead, mean)
    picture = np.hstack(
        [composite_on_grey(255 * stack[..., :-1], stack[..., -1:]) for stack in stacks]
    )
    for text, y in ((gateway.above, 12), (gateway.below, TILE - 5)):
        write_text(picture, text, (4, y), INK, font_scale=0.36)
    cv2.rectangle(picture, (0, 0), (picture.shape[1] - 1, TILE - 1), (235,) * 3, thickness=2)
    return picture
