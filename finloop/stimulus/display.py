"""A calibrated display: the size of its pixels, its brightness curve, the place of its picture.

It is stored as JSON, one file per display. The display's page makes it (its calibration panel) and
draws by it. Shares of the screen are 0 … 1, x right, y down; px are the display's own.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes
from finloop.show.message import StrictModel

VERSION = 1
_MOST_BYTES = 1_000_000  # of a file
_FLATTEST = 0.02  # smallest share of the screen that a corner of the picture area spans
_ADVICE = "calibrate the display once more (key C on its page), or correct the file"

Level = Annotated[float, Field(ge=0, le=255)]
Colour = tuple[Level, Level, Level]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
PixelRatio = Annotated[float, Field(gt=0, le=20)]
Share = Annotated[float, Field(ge=-1, le=2)]
Place = tuple[Share, Share]


class PhotodiodeSquare(StrictModel):
    """A square on the display for a photodiode: black on even frames, white on odd ones.

    size_px: its side, px of the display.
    """

    corner: Literal["top left", "top right", "bottom right", "bottom left"]
    size_px: Pixels


class DisplayCalibration(StrictModel):
    """What was measured of a display: size of its pixels, brightness curve, place of the picture.

    px_per_mm: None = not measured. ratio: device px per CSS px. background: the film's empty tank,
    or one colour. gamma: what is sent (R, G, B) for each wanted level 0 … 255; None = the same.
    corners: where the picture's corners top left, top right, bottom right, bottom left go, shares
    of the screen; None = unchanged. scale: screen px per px of the tank; None = from px_per_mm
    where the tank's px are known in mm, else as large as fits. refresh_hz: as measured.
    """

    version: Literal[1] = 1
    px_per_mm: Annotated[float, Field(gt=0, le=1000)] | None = None
    width_px: Pixels
    height_px: Pixels
    ratio: PixelRatio
    background: Literal["film"] | Colour = "film"
    gamma: Annotated[tuple[Colour, ...], Field(min_length=256, max_length=256)] | None = None
    corners: tuple[Place, Place, Place, Place] | None = None
    square: PhotodiodeSquare | None = None
    scale: Annotated[float, Field(gt=0, le=1000)] | None = None
    refresh_hz: Annotated[float, Field(gt=0, le=2000)]

    @model_validator(mode="after")
    def _check_corners(self) -> Self:
        """Return the calibration; ValueError unless its corners form a convex quadrilateral.

        Going round, each corner must turn clockwise, or no projection reaches them.
        """
        corners = self.corners or ()
        for number, (bx, by) in enumerate(corners):
            (ax, ay), (cx, cy) = corners[number - 1], corners[(number + 1) % 4]
            # The cross product of the sides a→b and b→c, a share of the screen's area, is positive
            # if b turns clockwise (y points down); a tiny one is refused, too, as nearly flat.
            spanned = (bx - ax) * (cy - by) - (by - ay) * (cx - bx)
            if spanned < _FLATTEST**2:
                raise ValueError("the corners must go round clockwise, with no corner bent inwards")
        return self


def load_display(path: Path) -> DisplayCalibration:
    """Return a display's calibration, read from a JSON file.

    FinloopError if the file is missing, broken, or of another version.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise FinloopError(
            f"the display {path} cannot be read ({error.strerror or error})",
            "a display that was calibrated",
            "calibrate the display first (key C on its page)",
        ) from error
    if len(content) > _MOST_BYTES:
        came = f"{path} is larger than {_MOST_BYTES} bytes"
        raise FinloopError(came, "a calibrated display", _ADVICE)
    try:
        return DisplayCalibration.model_validate_json(content)
    except UnicodeError as error:
        wanted = "a calibrated display, as JSON"
        raise FinloopError(f"{path} is no text", wanted, _ADVICE) from error
    except ValidationError as error:
        problems = error.errors(include_url=False, include_context=False, include_input=False)
        if any(problem["loc"] == ("version",) for problem in problems):
            raise FinloopError(
                f"{path} is of another version", f"a display of version {VERSION}",
                "calibrate the display once more (key C on its page)",
            ) from error  # fmt: skip
        lines = ""
        for problem in problems:
            field = ".".join(map(str, problem["loc"])) or "the whole"
            lines += f"\n    {field}: {problem['msg']}"
        came = f"the display {path} is broken:{lines}"
        raise FinloopError(came, "a calibrated display", _ADVICE) from error


def save_display(path: Path, display: DisplayCalibration) -> None:
    """Write a display's calibration as JSON, whole or not at all; FinloopError on a full disk."""
    save_bytes(path, (display.model_dump_json(indent=1) + "\n").encode())
