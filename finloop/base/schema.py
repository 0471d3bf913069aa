"""Table schemas: each column's name, dtype and unit; `finloop.io.table` checks files by them."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

ANY = -1
"""The `length` of a list column whose lists may have any length."""


@dataclass(frozen=True)
class Column:
    """One column of a table: its name, dtype and unit, and whether its cells are lists."""

    name: str
    dtype: str  # a NumPy name ("int32", "float32", "bool", …) or "string"
    unit: str  # free text ("px", "deg", "s", "1")
    nullable: bool = False  # else it holds neither nulls nor NaN
    length: int = 0  # 0: cells are single values; > 0: lists of so many numbers; ANY: lists

    @property
    def pandas_dtype(self) -> str:
        """Return the dtype in pandas: object for lists, Int32 for integers that may be missing."""
        if self.length:
            return "object"
        if self.nullable and "int" in self.dtype:
            return self.dtype.replace("int", "Int").replace("u", "U")  # pandas' Int32, UInt8
        return "str" if self.dtype == "string" else self.dtype


class Schema:
    """The columns of a table in their order, with their names and pandas dtypes."""

    def __init__(self, *columns: Column) -> None:
        """Keep the columns, and read off their names and pandas dtypes."""
        self.columns, self.names = columns, [column.name for column in columns]
        self.pandas_dtypes = {column.name: column.pandas_dtype for column in columns}

    def empty(self) -> pd.DataFrame:
        """Return a table without rows that has these columns and dtypes."""
        return pd.DataFrame(columns=self.names).astype(self.pandas_dtypes)


def columns(
    dtype: str, unit: str, *names: str, nullable: bool = False, length: int = 0
) -> list[Column]:
    """Return a column for each name, all of one dtype and unit.

    nullable: whether values may be missing; length: of each cell's list, 0 for single values.
    """
    return [Column(name, dtype, unit, nullable, length) for name in names]


def lists_to_array(column: pd.Series) -> np.ndarray:
    """Stack a column of equally long lists into an array (rows, length); (0, 0) without rows."""
    return np.stack(list(column)) if len(column) else np.empty((0, 0))


def lists_to_points(table: pd.DataFrame, name: str) -> np.ndarray:
    """Stack the list columns <name>_x_px and <name>_y_px into points (rows, length, 2) in px."""
    return np.stack([lists_to_array(table[f"{name}_{axis}_px"]) for axis in "xy"], axis=-1)
