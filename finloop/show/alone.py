"""The page that plays a motion by itself, without a server or a network."""

import base64
import html
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.show.drawn import FILM_LOOK, POSTURE, States
from finloop.show.page import DRAWING, build_page, make_content_policy, pack_message
from finloop.show.pictures import PagePicture, list_shown_rows, measure_typical_fish


def build_standalone_page(
    title: str, rate: float, floor: Picture, pictures: Mapping[int, PagePicture], motion: States,
    looks: Sequence[dict[str, Any]] = (FILM_LOOK,), loops: bool = True,
) -> str:  # fmt: skip
    """Return the HTML of a page that plays a motion without a server or a network.

    motion: states (ticks, fish, fields). rate: ticks/s. floor: the empty tank, (h, w) or (h, w, 3)
    uint8. pictures: all that the motion names, by row of the film. looks: how fish are drawn, each
    the values of `Look.to_json_values`; the motion names them by index. loops: whether it plays for
    ever. FinloopError if the motion has no tick, no fish or numbers that are not finite, or if a
    picture is missing.
    """
    _refuse_unplayable(motion, pictures)
    height, width = floor.shape[:2]
    sizes = [picture.pixels.shape for picture in pictures.values()]
    facts = {
        "rate": rate, "width": width, "height": height,
        "channels": 1 if floor.ndim == 2 else floor.shape[2], "posture": motion.shape[2] - POSTURE,
        "fish": motion.shape[1], "ticks": len(motion), "looks": list(looks), "loops": loops,
        "typical": measure_typical_fish(pictures.values()) if pictures else None,
        "slot_width": max((size[1] for size in sizes), default=1),
        "slot_height": max((size[0] for size in sizes), default=1),
        "pictures": [picture.describe(number) for number, picture in pictures.items()],
    }  # fmt: skip
    parts = [floor.tobytes(), *(picture.to_bytes() for picture in pictures.values())]
    data = pack_message(facts, b"".join([*parts, np.asarray(motion, "<f4").tobytes()]))
    page = build_page("alone.html", *DRAWING, "alone.js").replace("/*title*/", html.escape(title))
    page = page.replace("/*policy*/", make_content_policy(page, "img-src data:"))
    return page.replace("/*data*/", base64.b64encode(zlib.compress(data, 9)).decode())


def _refuse_unplayable(motion: States, pictures: Mapping[int, PagePicture]) -> None:
    """Raise FinloopError if a motion has no tick, fish or finite numbers, or lacks a picture."""
    if motion.ndim != 3 or 0 in motion.shape or not np.isfinite(motion).all():
        raise FinloopError(
            f"a motion of shape {motion.shape}", "states of ticks and fish, all of them numbers",
            "give the states of at least one tick and fish",
        )  # fmt: skip
    if missing := [number for number in list_shown_rows(motion) if number not in pictures]:
        raise FinloopError(
            f"{len(missing)} pictures are missing, {missing[0]} first",
            "every picture that the motion names", "give these pictures, too",
        )  # fmt: skip
