"""The page of all results, in one self-contained file.

The page's text stands in `report.html.j2`; pictures travel in it as WebP, the film as MP4.
"""

import base64
import io
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, NamedTuple

import cv2
import numpy as np
from jinja2 import Environment, StrictUndefined
from PIL import Image

from finloop.base.arrays import Picture

_METHOD = 4  # of WebP: 6 takes twice as long for 2 % less


class WebP(NamedTuple):
    """A picture as a WebP data URI, with its width and height in px.

    The size lets the page keep the space free while the picture loads.
    """

    uri: str
    width: int
    height: int


def data_uri(kind: str, content: bytes) -> str:
    """Return bytes as a data URI, which a page can contain; kind: MIME type such as "video/mp4"."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


def encode_webp(picture: Picture, max_width_px: int, quality: int) -> WebP:
    """Return a picture, (h, w) or (h, w, 3) RGB, as a WebP data URI; a wider one is reduced.

    quality: that of WebP, 0 … 100.
    """
    height, width = picture.shape[:2]
    if width > max_width_px:
        width, height = max_width_px, max(1, round(height * max_width_px / width))
        picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA))
    coded = io.BytesIO()
    Image.fromarray(picture).save(coded, "WEBP", quality=quality, method=_METHOD)
    return WebP(data_uri("image/webp", coded.getvalue()), width, height)


def render_template(template: str, values: Mapping[str, Any]) -> str:
    """Fill a Jinja template of finloop/report/ with values; return the HTML text.

    Values are escaped. A name in the template that `values` lacks raises an error.
    """
    text = files("finloop.report").joinpath(template).read_text(encoding="utf-8")
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(text).render(**values) + "\n"
