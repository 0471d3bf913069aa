"""The pages that show a stimulus, each one HTML text with all that it needs.

A page has exactly one script and one style, from the files in `page/`, so that its policy can
forbid the browser to run anything else.
"""

import base64
import hashlib
import html
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.stimulus.drawn import PARTNER, PICTURE, POSTURE, States
from finloop.stimulus.pictures import PagePicture, typical

DRAWING = ("strip.js", "shaders.js", "view.js", "draw.js", "motion.js")
"""The scripts that draw and move the fish, on both pages."""
_FILES = Path(__file__).with_name("page")
_PLAIN: dict[str, Any] = {"as": "fish", "contrast": 1.0, "size": 1.0, "colour": None}


def script(*names: str) -> str:
    """Return the JavaScript files `names` of `page/`, joined to one strict script."""
    return '"use strict";\n' + "\n".join(_read(name) for name in names)


def display_page() -> str:
    """Return the HTML of the page in front of the animals; a server sends its content."""
    code = script(*DRAWING, "levels.js", "panel.js", "display.js")
    return _read("display.html").replace("/*script*/", code)


def experimenter_page() -> str:
    """Return the HTML of the experimenter's page."""
    return _read("experimenter.html")


def alone_page(
    title: str, rate: float, floor: Picture, pictures: Mapping[int, PagePicture], motion: States,
    looks: Sequence[dict[str, Any]] = (_PLAIN,), loops: bool = True,
) -> str:  # fmt: skip
    """Return the HTML of a page that plays a motion (ticks, fish, F) alone, for ever if `loops`.

    rate: ticks/s; floor: the empty tank, (h, w) or (h, w, 3) uint8; pictures: all that the motion
    names, by row of the film; looks: each as `Look.message`. It needs no server and no network.
    FinloopError if a picture or all ticks are missing.
    """
    _refuse(pictures, motion)
    data = _pack_data(rate, floor, pictures, motion, list(looks), loops)
    whole = _read("alone.html").replace("/*title*/", html.escape(title))
    whole = whole.replace("/*script*/", script(*DRAWING, "alone.js"))
    policy = (
        f"default-src 'none'; script-src {_digest('script', whole)}; "
        f"style-src {_digest('style', whole)}; img-src data:; base-uri 'none'; form-action 'none'"
    )
    whole = whole.replace("/*policy*/", policy)
    return whole.replace("/*data*/", base64.b64encode(zlib.compress(data, 9)).decode())


def _read(name: str) -> str:
    return (_FILES / name).read_text(encoding="utf-8")


def _digest(tag: str, page: str) -> str:
    (text,) = re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _refuse(pictures: Mapping[int, PagePicture], motion: States) -> None:
    if motion.ndim != 3 or 0 in motion.shape or not np.isfinite(motion).all():
        raise FinloopError(
            f"a motion of shape {motion.shape}", "states of ticks and fish, all of them numbers",
            "give the states of at least one tick and fish",
        )  # fmt: skip
    named = np.unique(motion[..., [PICTURE, PARTNER]]).astype(int).tolist()
    if missing := [number for number in named if number >= 0 and number not in pictures]:
        raise FinloopError(
            f"{len(missing)} pictures are missing, {missing[0]} first",
            "every picture that the motion names", "give these pictures, too",
        )  # fmt: skip


def _pack_data(
    rate: float, floor: Picture, pictures: Mapping[int, PagePicture], motion: States,
    looks: list[dict[str, Any]], loops: bool,
) -> bytes:  # fmt: skip
    """Pack a page's data: 4 bytes, a text's length; the text; arrays; see `page/alone.js`."""
    height, width = floor.shape[:2]
    sizes = [one.pixels.shape for one in pictures.values()]
    facts = {
        "rate": rate, "width": width, "height": height,
        "channels": 1 if floor.ndim == 2 else floor.shape[2], "posture": motion.shape[2] - POSTURE,
        "fish": motion.shape[1], "ticks": len(motion), "looks": looks, "loops": loops,
        "typical": typical(pictures.values()) if pictures else None,
        "slot_width": max((size[1] for size in sizes), default=1),
        "slot_height": max((size[0] for size in sizes), default=1),
        "pictures": [
            {
                "picture": number, "width": one.pixels.shape[1], "height": one.pixels.shape[0],
                "line": [float(part) for part in one.line],
            }
            for number, one in pictures.items()
        ],
    }  # fmt: skip
    text = json.dumps(facts, separators=(",", ":")).encode()
    arrays = [floor, *(part for one in pictures.values() for part in _arrays(one))]
    parts = [len(text).to_bytes(4, "little"), text, *map(np.ndarray.tobytes, arrays)]
    return b"".join([*parts, np.asarray(motion, "<f4").tobytes()])


def _arrays(one: PagePicture) -> tuple[NDArray[np.float32], Picture]:
    return np.asarray(one.posture, "<f4"), one.pixels
