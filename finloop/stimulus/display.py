"""A calibrated display: the size of its pixels, its brightness curve, the place of its picture.

It is stored as JSON, one file per display. The display's page makes it (its calibration panel) and
draws by it. Shares of the screen are 0 … 1, x right, y down; px are the display's own.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from finloop.base.errors import FinloopError
from finloop.io.atomic import save_bytes

VERSION = 1
_LARGEST = 1_000_000  # bytes of a file
_FLATTEST = 0.02  # smallest share of the screen that a corner of the picture area spans
_DO = "calibrate the display once more (key C on its page), or correct the file"

Level = Annotated[float, Field(ge=0, le=255, allow_inf_nan=False)]
Colour = tuple[Level, Level, Level]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
Place = tuple[
    Annotated[float, Field(ge=-1, le=2, allow_inf_nan=False)],
    Annotated[float, Field(ge=-1, le=2, allow_inf_nan=False)],
]
Corner = Literal["top left", "top right", "bottom right", "bottom left"]


class _StrictModel(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class Square(_StrictModel):
    """A square in a corner for a photodiode, black on even frames, white on odd ones.

    size_px: its side, px of the display.
    """

    corner: Corner
    size_px: Pixels


class DisplayCalibration(_StrictModel):
    """The calibration of a display: size of its pixels, brightness curve, place of its picture.

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
    ratio: Annotated[float, Field(gt=0, le=20)]
    background: Literal["film"] | Colour = "film"
    gamma: Annotated[tuple[Colour, ...], Field(min_length=256, max_length=256)] | None = None
    corners: tuple[Place, Place, Place, Place] | None = None
    square: Square | None = None
    scale: Annotated[float, Field(gt=0, le=1000)] | None = None
    refresh_hz: Annotated[float, Field(gt=0, le=2000)]

    @model_validator(mode="after")
    def _opens(self) -> Self:
        """Refuse corners that no projection reaches: they must turn the same way all around."""
        if self.corners is not None:
            turns = [_turn(self.corners, number) for number in range(4)]
            if min(turns) < _FLATTEST**2:
                raise ValueError("the corners must go round clockwise, with no corner bent inwards")
        return self


def _turn(corners: tuple[Place, ...], number: int) -> float:
    """Return the area, shares of the screen, that two sides at a corner span; > 0 = clockwise."""
    (ax, ay), (bx, by), (cx, cy) = (corners[(number + k) % 4] for k in (-1, 0, 1))
    return (bx - ax) * (cy - by) - (by - ay) * (cx - bx)


def load_display(path: Path) -> DisplayCalibration:
    """Read a display's calibration from a JSON file.

    FinloopError if the file is missing, broken, or of another version.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LARGEST + 1)
    except OSError as error:
        raise FinloopError(
            f"the display {path} cannot be read ({error.strerror or error})",
            "a display that was calibrated",
            "calibrate the display first (key C on its page)",
        ) from error
    if len(content) > _LARGEST:
        raise FinloopError(f"{path} is larger than {_LARGEST} bytes", "a calibrated display", _DO)
    try:
        return DisplayCalibration.model_validate_json(content)
    except (ValidationError, UnicodeError) as error:
        raise _display_error(path, error) from error


def _display_error(path: Path, error: ValidationError | UnicodeError) -> FinloopError:
    """Return one error that lists all that is wrong with a display file."""
    if isinstance(error, UnicodeError):
        return FinloopError(f"{path} is no text", "a calibrated display, as JSON", _DO)
    problems = error.errors(include_url=False, include_context=False, include_input=False)
    version = next((one for one in problems if one["loc"] == ("version",)), None)
    if version is not None:
        return FinloopError(
            f"{path} is of another version", f"a display of version {VERSION}",
            "calibrate the display once more (key C on its page)",
        )  # fmt: skip
    lines = "".join(
        f"\n    {'.'.join(map(str, one['loc'])) or 'the whole'}: {one['msg']}" for one in problems
    )
    return FinloopError(f"the display {path} is broken:{lines}", "a calibrated display", _DO)


def save_display(path: Path, display: DisplayCalibration) -> None:
    """Write a display's calibration as JSON, or nothing. FinloopError if the disk is full."""
    save_bytes(path, (display.model_dump_json(indent=1) + "\n").encode())
