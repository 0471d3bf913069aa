"""Pictures: written completely or not at all; read unless they are far larger than their file."""

from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes, whole_file
from finloop.io.checksums import check_file
from finloop.io.limits import refuse_bomb

if TYPE_CHECKING:  # a third of a second, in stages that draw no figure
    from matplotlib.figure import Figure

_DPI = 110  # dots per inch of a figure
_DECIMALS = 5  # of the places of its axes, in shares of its width and height: 0.01 px


def save_picture(path: Path, picture: Picture) -> None:
    """Write a picture, (h, w) grey, (h, w, 3) RGB or (h, w, 4) RGBA, by the ending of `path`."""
    if picture.ndim == 3:
        code = cv2.COLOR_RGB2BGR if picture.shape[2] == 3 else cv2.COLOR_RGBA2BGRA
        picture = cv2.cvtColor(picture, code)
    save_bytes(path, cv2.imencode(path.suffix, picture)[1].tobytes())


def decode_picture(path: Path, flags: int) -> Picture | None:
    """Read a picture as OpenCV does, colours as blue, green, red; None if it cannot be read.

    flags: of `cv2.imdecode`. FinloopError if the picture declares far more pixels than its file can
    hold: it would fill the memory. OSError if there is no such file.
    """
    data = check_file(path).read_bytes()
    _refuse_picture_bomb(path, data)
    with suppress(cv2.error):  # for more than 2²⁰ rows, among others
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    return None


def _refuse_picture_bomb(path: Path, data: bytes) -> None:
    """Raise FinloopError if a picture declares far more pixels than its file can hold.

    Only the header is read, by Pillow. A header that it cannot read is left to OpenCV, which takes
    at most 2³⁰ pixels.
    """
    from PIL import (  # not at the top: most stages read no pictures
        BmpImagePlugin,
        GifImagePlugin,
        Jpeg2KImagePlugin,
        JpegImagePlugin,
        PngImagePlugin,
        PpmImagePlugin,
        TiffImagePlugin,
        WebPImagePlugin,
    )

    # The classes themselves: `Image.open` has a limit of its own, which it shares with all threads.
    for header in (
        PngImagePlugin.PngImageFile, JpegImagePlugin.JpegImageFile, TiffImagePlugin.TiffImageFile,
        BmpImagePlugin.BmpImageFile, WebPImagePlugin.WebPImageFile, GifImagePlugin.GifImageFile,
        Jpeg2KImagePlugin.Jpeg2KImageFile, PpmImagePlugin.PpmImageFile,
    ):  # fmt: skip
        with suppress(Exception):  # it is of another kind, or damaged
            width, height = header(BytesIO(data)).size
            name = f"{path}, {width}×{height} pixels,"
            break
    else:
        return
    refuse_bomb(name, 3 * width * height, len(data), "save it smaller, or move it away")


def load_picture(path: Path) -> Picture:
    """Read a picture as (h, w) grey or (h, w, 3) RGB uint8; FinloopError if it cannot be read."""
    try:
        picture = decode_picture(path, cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise ValueError("no picture")  # caught below
    except (OSError, ValueError) as error:
        raise FinloopError(
            f"{path} cannot be read as a picture ({error})",
            "a picture that an earlier stage wrote",
            "run the pipeline again: `dvc repro`",
        ) from error
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def save_figure(path: Path, figure: "Figure") -> None:
    """Write a matplotlib figure as a PNG; `path` ends in .png.

    Equal figures give the same bytes. The figure changes: hidden axes lose their ticks. A figure
    with a layout engine gets `_DPI`, and a fixed layout with rounded places of axes.
    """
    for axes in figure.axes:
        if not axes.axison:  # hidden ticks would still be laid out, in half of the time
            axes.set(xticks=[], yticks=[])
    if (engine := figure.get_layout_engine()) is not None:
        # The last bits of its solver differ between processes; at the edge of a subpixel they show.
        figure.set_dpi(_DPI)
        engine.execute(figure)
        figure.set_layout_engine("none")
        for axes in figure.axes:
            axes.set_position(np.round(axes.get_position(original=True).bounds, _DECIMALS))
    with whole_file(path) as part:
        figure.savefig(part, dpi=_DPI, metadata={"Software": None})
