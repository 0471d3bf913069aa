"""Read a path: a table with x and y, CSV or Parquet, or an SVG drawing with one path."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.base.line import MM, PX, TANK, Line, check_line
from finloop.io.limits import refuse_bomb
from finloop.io.svg import load_svg

_MOST_COLUMNS = 1000
_WANTED = (
    "columns x and y (or x_px and y_px, x_mm and y_mm, x_tank and y_tank); optionally time_s "
    "and heading_deg"
)


def load_line(path: Path, unit: str) -> Line:
    """Load the path that a fish shall follow, from a file .csv, .parquet or .svg.

    unit: PX, TANK (see `finloop.base.line`) or MM, of columns x and y; columns such as x_mm name
    their own. An SVG's path is in px, or in shares of the viewport if the unit is TANK.
    FinloopError if the file cannot be read, lacks a column, or holds not exactly one path.
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
    try:
        return check_line(_line_from_table(path, _load_table(path), unit))
    except (OSError, pa.ArrowException, ValueError) as error:
        raise FinloopError(
            f"{path} cannot be read as a table ({error})",
            _WANTED,
            "save the table again, or name another file (matching.path)",
        ) from error


def _load_table(path: Path) -> pa.Table:
    """Load the table in a CSV or Parquet file; FinloopError if it declares far too much.

    ValueError if it has too many columns, OSError or ArrowException if it is damaged.
    """
    size = path.stat().st_size
    if path.suffix.lower() == ".csv":
        with path.open("rb") as file:
            columns = file.readline().count(b",") + 1
        rows = 0
    else:
        facts = pq.read_metadata(path)
        rows, columns = facts.num_rows, facts.num_columns
    if columns > _MOST_COLUMNS:
        raise ValueError(f"it has {columns} columns")
    name = f"{path}, {rows} rows of {columns} columns,"
    refuse_bomb(name, rows * columns * 8, size, "save the path alone")
    return pa.csv.read_csv(path) if path.suffix.lower() == ".csv" else pq.read_table(path)


def _line_from_table(path: Path, table: pa.Table, unit: str) -> Line:
    """Return the path in a table's columns x and y, with times and headings if the table has them.

    path: of the table's file, for messages. unit: of x and y, unless the columns' names say it.
    FinloopError if the table lacks x or y, or a column holds no numbers.
    """
    names = {name.strip().lower(): name for name in table.column_names}
    x, y = "x", "y"
    for named_unit in (TANK, MM, PX):  # px is taken where a table has several
        if {f"x_{named_unit}", f"y_{named_unit}"} <= names.keys():
            x, y, unit = f"x_{named_unit}", f"y_{named_unit}", named_unit
    if not {x, y} <= names.keys():
        raise FinloopError(
            f"{path} has the columns {', '.join(table.column_names)}",
            _WANTED,
            "rename the columns that hold x and y",
        )

    def read_column(name: str) -> Floats:
        """Return the numbers of a column; FinloopError if it holds anything else."""
        try:
            values = table.column(names[name]).cast(pa.float64())
        except pa.ArrowException as error:
            came = f"the column {names[name]} of {path} holds no numbers ({error})"
            raise FinloopError(came, _WANTED, "correct it") from error
        return np.array(values.to_numpy(zero_copy_only=False), float)

    time_s, heading_deg = (
        read_column(name) if name in names else None for name in ("time_s", "heading_deg")
    )
    return Line(str(path), read_column(x), read_column(y), unit, time_s, heading_deg)


def _line_from_drawing(path: Path, unit: str) -> Line:
    """Load the only path of an SVG file; FinloopError if it has none or several.

    unit: PX, or TANK for shares of the drawing's size.
    """
    drawing = load_svg(path)
    if len(drawing.curves) != 1:
        raise FinloopError(
            f"{path} has {len(drawing.curves)} paths: {', '.join(drawing.curves)}",
            "an SVG with one path",
            "save only the path that the fish should follow",
        )
    (curve,) = drawing.curves.values()
    scale = (drawing.width, drawing.height) if unit == TANK else (1.0, 1.0)
    x, y = (curve.points / scale).T
    return Line(str(path), x.copy(), y.copy(), unit, closed=curve.closed)
