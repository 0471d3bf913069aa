"""What a table holds: each column's name, dtype and unit; `finloop.io.table` checks files by it."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

ANY = -1
"""The length of lists that may have any length."""


@dataclass(frozen=True)
class Column:
    """One column: `dtype` is a NumPy name ("int32", "float32", "bool", "string", …).

    `unit` is free text ("px", "deg", "s", "1"). A column that is not `nullable` holds neither
    nulls nor NaN. `length` > 0 makes every cell a list of that many `dtype` numbers, ANY a list of
    any length; only lists of any length may be nullable.
    """

    name: str
    dtype: str
    unit: str
    nullable: bool = False
    length: int = 0

    @property
    def kind(self) -> str:
        """Its dtype in pandas: of lists object, of whole numbers that may be null Int32."""
        if self.length:
            return "object"
        if self.nullable and "int" in self.dtype:
            return self.dtype.replace("int", "Int").replace("u", "U")
        return "str" if self.dtype == "string" else self.dtype


class Schema:
    """The columns of a table, in order, their names, and their kinds by name."""

    def __init__(self, *columns: Column) -> None:
        self.columns, self.names = columns, [column.name for column in columns]
        self.kinds = {column.name: column.kind for column in columns}

    def empty(self) -> pd.DataFrame:
        """A table without rows."""
        return pd.DataFrame(columns=self.names).astype(self.kinds)


def columns(
    dtype: str, unit: str, *names: str, nullable: bool = False, length: int = 0
) -> list[Column]:
    """Columns of one kind."""
    return [Column(name, dtype, unit, nullable, length) for name in names]


def lists_to_array(column: pd.Series) -> np.ndarray:
    """Stack a list column into one array, (rows, length)."""
    return np.stack(list(column)) if len(column) else np.empty((0, 0))


def lists_to_points(table: pd.DataFrame, name: str) -> np.ndarray:
    """The list columns <name>_x_px and <name>_y_px as points, (rows, length, 2)."""
    return np.stack([lists_to_array(table[f"{name}_{axis}_px"]) for axis in "xy"], axis=-1)
