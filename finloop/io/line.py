"""Read a path: a table with x and y, CSV or Parquet, or an SVG drawing with one path."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import MM, PX, TANK, Line, check_line
from finloop.io.svg import load_svg

_WANTED = (
    "columns x and y (or x_px and y_px, x_mm and y_mm, x_tank and y_tank); optionally time_s "
    "and heading_deg"
)


def load_line(path: Path, unit: str) -> Line:
    """Load the path that a fish follows from a file: .csv, .parquet or .svg.

    unit: PX, TANK or MM, of columns x and y; columns such as x_mm name their own. An SVG's path is
    in px of its viewport, or in shares of the viewport if the unit is TANK. FinloopError if the
    file cannot be read, lacks a column, is an SVG of several paths or none, or holds no path.
    """
    suffix = path.suffix.lower()
    if suffix == ".svg":
        return check_line(_line_from_drawing(path, unit))
    if suffix not in (".csv", ".parquet"):
        raise FinloopError(
            f"{path} is no file that finloop can read a path from",
            "a file .csv, .parquet or .svg; or a track of the film, such as track:8",
            "save the path as one of these, or correct matching.path",
        )
    return check_line(_line_from_table(path, _table(path, suffix), unit))


def _table(path: Path, suffix: str) -> pa.Table:
    try:
        return pa.csv.read_csv(path) if suffix == ".csv" else pq.read_table(path)
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise FinloopError(
            f"{path} cannot be read as a table ({error})",
            _WANTED,
            "save the table again, or name another file (matching.path)",
        ) from error


def _line_from_table(path: Path, table: pa.Table, unit: str) -> Line:
    names = {name.strip().lower(): name for name in table.column_names}
    units = [PX, MM, TANK]
    own = next((choice for choice in units if {f"x_{choice}", f"y_{choice}"} <= names.keys()), None)
    x, y = ("x", "y") if own is None else (f"x_{own}", f"y_{own}")
    if not {x, y} <= names.keys():
        raise FinloopError(
            f"{path} has the columns {', '.join(table.column_names)}",
            _WANTED,
            "rename the columns that hold x and y",
        )

    def numbers(name: str) -> Floats | None:
        return _numbers(path, table, names[name]) if name in names else None

    at = [_numbers(path, table, names[name]) for name in (x, y)]
    return Line(str(path), at[0], at[1], own or unit, numbers("time_s"), numbers("heading_deg"))


def _numbers(path: Path, table: pa.Table, name: str) -> Floats:
    try:
        column = table.column(name).cast(pa.float64())
    except pa.ArrowException as error:
        raise FinloopError(
            f"the column {name} of {path} holds no numbers ({error})", _WANTED, "correct it"
        ) from error
    return np.array(column.to_numpy(zero_copy_only=False), float)


def _line_from_drawing(path: Path, unit: str) -> Line:
    drawing = load_svg(path)
    if len(drawing.curves) != 1:
        raise FinloopError(
            f"{path} has {len(drawing.curves)} paths: {', '.join(drawing.curves)}",
            "an SVG with one path",
            "save only the path that the fish should follow",
        )
    ((_, curve),) = drawing.curves.items()
    scale = (drawing.width, drawing.height) if unit == TANK else (1.0, 1.0)
    x, y = (curve.points / scale).T
    return Line(str(path), x.copy(), y.copy(), unit, closed=curve.closed)
