"""Pictures, written completely or not at all."""

from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes, whole_file
from finloop.io.checksums import check_file

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


def load_picture(path: Path) -> Picture:
    """Read a picture as (h, w) grey or (h, w, 3) RGB uint8; FinloopError if it cannot be read."""
    try:
        coded = np.frombuffer(check_file(path).read_bytes(), np.uint8)
        picture = cv2.imdecode(coded, cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise ValueError("no picture")  # caught below
    except (OSError, cv2.error, ValueError) as error:
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
