"""Tables with a schema: every column's name, dtype and unit, checked on save and on load.

Files are Parquet. Each field's metadata holds its unit, so a table that is opened without this
program still explains its numbers.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from finloop.base.digits import round_significant
from finloop.base.errors import FinloopError
from finloop.base.schema import ANY, Column, Schema, lists_to_array
from finloop.io.atomic import whole_file
from finloop.io.checksums import check_file

_AGAIN = "run the stage that makes it again: `dvc repro`"


def _arrow_type(column: Column) -> pa.DataType:
    """Return the Arrow data type of a column: a number, or a list of numbers."""
    number = pa.type_for_alias(column.dtype)
    return pa.list_(number, column.length) if column.length else number  # ANY is Arrow's -1


def arrow_schema(schema: Schema) -> pa.Schema:
    """Convert a table's schema to an Arrow schema; each field's metadata holds its unit."""
    return pa.schema(
        pa.field(column.name, _arrow_type(column), column.nullable, {"unit": column.unit})
        for column in schema.columns
    )


def parquet_coding(schema: Schema) -> dict[str, Any]:
    """Return keyword arguments for pyarrow's Parquet writers: compression and checksums.

    Measured floats rarely repeat: a dictionary of their values would take three quarters of the
    writing time. Splitting their bytes into streams halves their size. Each page has a checksum of
    its own, so that a table without a record beside it is compared, too, all but its footer.
    """
    floats: list[str] = []
    others: list[str] = []
    for column in schema.columns:
        # Parquet names the numbers inside a list column so.
        path = f"{column.name}.list.element" if column.length else column.name
        (floats if column.dtype.startswith("float") else others).append(path)
    return {
        "compression": "zstd", "use_byte_stream_split": floats, "use_dictionary": others,
        "write_page_checksum": True,
    }  # fmt: skip


def save_table(path: Path, frame: pd.DataFrame, schema: Schema) -> None:
    """Check a table against its schema and write it as Parquet, completely or not at all.

    `arrow_table` says which numbers are converted, and what raises FinloopError.
    """
    table = arrow_table(frame, schema, str(path))
    with whole_file(path) as part:
        pq.write_table(table, part, **parquet_coding(schema))


def arrow_table(frame: pd.DataFrame, schema: Schema, name: str) -> pa.Table:
    """Check a data frame against its schema and convert it to an Arrow table.

    Numbers of another width are converted if that loses only floating-point precision; NaN in a
    nullable column becomes null. A list column has rows of arrays. name: of the table, for
    messages. FinloopError lists every missing, unknown, ill-typed or wrongly null column at once.
    """
    problems = _name_problems(list(frame.columns), schema)
    arrays, null_problems = [], list[str]()
    for column in schema.columns:
        if column.name in frame:
            try:
                arrays.append(_to_arrow(frame[column.name], column))
                null_problems += _null_problems(arrays[-1], column)
            except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
                problems.append(f"{column.name}: not {_describe_column(column)} ({error})")
    problems += null_problems
    if problems:
        do = "correct the stage that makes the table"
        raise _schema_error(f"the table for {name}", problems, do)
    return pa.Table.from_arrays(arrays, schema=arrow_schema(schema))


def apply_schema(frame: pd.DataFrame, schema: Schema) -> pd.DataFrame:
    """Return a data frame as it is after saving and loading; FinloopError if it does not fit."""
    return _to_frame(arrow_table(frame, schema, "the next verb"), schema)


def load_table(path: Path, schema: Schema, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Read a table that `save_table` wrote, with all columns or those named.

    Nullable whole numbers come back as pandas' `Int32` and its like, nulls of floats as NaN, list
    columns as rows of arrays. FinloopError if the file is missing or unreadable, or if columns are
    missing, not in the schema, of a wrong type, null where they must not be, or in another unit;
    the error lists all of these.
    """
    return _to_frame(*_read_columns(path, schema, columns))


def load_list_columns(path: Path, schema: Schema, *names: str) -> list[NDArray[Any]]:
    """Read list columns of a table, each as one array (rows, length), in the order of `names`.

    This is faster than `load_table`. FinloopError if the file is unreadable, does not fit its
    schema, or the lists of a column have several lengths.
    """
    table, schema = _read_columns(path, schema, names)
    arrays, problems = [], []
    for name in names:
        column = table.column(name).combine_chunks()
        lengths = pc.min_max(pc.list_value_length(column)).as_py()
        if lengths["min"] != lengths["max"]:
            problems.append(f"{name}: lists of {lengths['min']} to {lengths['max']} numbers")
            continue
        flat = column.flatten().to_numpy(zero_copy_only=False)
        arrays.append(flat.reshape(len(column), lengths["max"] or 0))
    if problems:
        raise _schema_error(str(path), problems, _AGAIN)
    return arrays


def read_list_blocks(
    path: Path, schema: Schema, names: Sequence[str], rows: int
) -> Iterator[list[NDArray[Any]]]:
    """Yield list columns of a long table in blocks of rows: for each name an array (k, length).

    rows: most rows of a block, k. All lists of a column must have the schema's length; only the
    columns' names are checked. FinloopError if the file is missing, unreadable, or lacks a column.
    """
    lengths = {column.name: column.length for column in schema.columns}
    try:
        with pq.ParquetFile(check_file(path), page_checksum_verification=True) as file:
            if missing := [name for name in names if name not in file.schema_arrow.names]:
                raise _schema_error(str(path), [f"{name}: missing" for name in missing], _AGAIN)
            for batch in file.iter_batches(rows, columns=list(names)):
                flat = {
                    name: batch.column(name).flatten().to_numpy(zero_copy_only=False)
                    for name in names
                }
                yield [flat[name].reshape(-1, lengths[name]) for name in names]
    except (OSError, pa.ArrowException) as error:
        raise _unreadable_error(path, error) from error


def _unreadable_error(path: Path, error: Exception) -> FinloopError:
    """Return the error for a file that is not a readable Parquet table."""
    return FinloopError(f"{path} cannot be read as a table ({error})", "a Parquet file", _AGAIN)


def _read_columns(
    path: Path, schema: Schema, columns: Sequence[str] | None
) -> tuple[pa.Table, Schema]:
    """Read a Parquet table and check it; return it with its schema, both with the same columns.

    columns: names of those to read, None = all. FinloopError lists all faults at once.
    """
    if columns is not None:
        schema = Schema(*(column for column in schema.columns if column.name in columns))
    try:
        table = pq.read_table(
            check_file(path), columns=None if columns is None else list(columns),
            page_checksum_verification=True,
        )  # fmt: skip
    except (OSError, pa.ArrowException) as error:
        raise _unreadable_error(path, error) from error
    problems = _name_problems(table.column_names, schema)
    for column in schema.columns:
        if column.name not in table.column_names:
            continue
        field = table.schema.field(column.name)
        if field.type != _arrow_type(column):
            problems.append(f"{column.name}: {field.type}, wanted {_describe_column(column)}")
            continue
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        if unit != column.unit:
            problems.append(f"{column.name}: in {unit or 'no unit'!r}, wanted {column.unit!r}")
        problems += _null_problems(table.column(column.name).combine_chunks(), column)
    if problems:
        raise _schema_error(str(path), problems, _AGAIN)
    return table, schema


def save_csv(path: Path, frame: pd.DataFrame, decimals: int, exact: bool = False) -> None:
    """Write a small table as CSV for people and plots, rounded, completely or not at all.

    decimals: most digits after the point. exact: keep all of these (mathematical constants, places
    in a film); else floats also lose the digits that differ between processors.
    """
    frame = frame.round(decimals)
    if not exact:
        floats = frame.select_dtypes("floating")
        frame = frame.assign(**floats.map(round_significant))
    with whole_file(path) as part:
        frame.to_csv(part, index=False, lineterminator="\n")


def load_csv(path: Path, as_text: bool = False) -> pd.DataFrame:
    """Read a small table that `save_csv` wrote; as_text: cells stay text, and empty ones "".

    FinloopError if the file is damaged.
    """
    if as_text:
        return pd.read_csv(check_file(path), dtype=str, keep_default_na=False)
    return pd.read_csv(check_file(path))


def _describe_column(column: Column) -> str:
    """Return a column's type and unit in words, such as "lists of 3 float32 in 'px'"."""
    size = "" if column.length == ANY else f"{column.length} "
    kind = f"lists of {size}{column.dtype}" if column.length else column.dtype
    return f"{kind}{' or null' if column.nullable else ''} in {column.unit!r}"


def _name_problems(names: list[str], schema: Schema) -> list[str]:
    """Return a message for each column that is missing, or unknown to the schema."""
    missing = [f"{name}: missing" for name in schema.names if name not in names]
    return missing + [f"{name}: not in the schema" for name in names if name not in schema.names]


def _to_arrow(values: pd.Series, column: Column) -> pa.Array:
    """Return a column as an Arrow array; ValueError, TypeError or ArrowInvalid if that changes it.

    Only the rounding of floats is allowed.
    """
    arrow_type = _arrow_type(column)
    if column.length == ANY:
        cells = [
            None if cell is None else _cast_list(np.asarray(cell), arrow_type).to_numpy()
            for cell in values
        ]
        return pa.array(cells, arrow_type)
    if column.length:  # lists of one length
        rows = lists_to_array(values)
        if len(values) and rows.shape != (len(values), column.length):
            raise ValueError(f"lists of shape {rows.shape[1:]}")
        return pa.FixedSizeListArray.from_arrays(
            _cast_list(rows.ravel(), arrow_type), column.length
        )
    array = pa.array(values, from_pandas=True)
    if isinstance(array, pa.ChunkedArray):
        array = array.combine_chunks()
    return array.cast(arrow_type)  # refuses all changes but the rounding of floats


def _cast_list(numbers: np.ndarray, list_type: pa.DataType) -> pa.Array:
    """Cast numbers (n,) to the number type of an Arrow list; ArrowInvalid if that changes them."""
    return pa.array(numbers).cast(list_type.value_type)


def _null_problems(array: pa.Array, column: Column) -> list[str]:
    """Return a message if a column that must be full has null or NaN cells, else an empty list."""
    if column.nullable:
        return []
    count = array.null_count
    # A column of lists is checked number by number: a null number becomes NaN in to_numpy, and is
    # counted with the NaNs.
    numbers = array.flatten() if column.length else array.drop_null()
    if pa.types.is_floating(numbers.type):
        count += int(np.isnan(numbers.to_numpy(zero_copy_only=False)).sum())
    return [f"{column.name}: {count} null or NaN, but it must not be empty"] if count else []


def _to_frame(table: pa.Table, schema: Schema) -> pd.DataFrame:
    """Convert an Arrow table to a data frame, with the schema's columns."""
    return pd.DataFrame({
        column.name: _to_pandas(table.column(column.name).combine_chunks(), column)
        for column in schema.columns
    })  # fmt: skip


def _to_pandas(array: pa.Array, column: Column) -> pd.Series:
    """Convert an Arrow column to a pandas column, with lists as arrays.

    Integers that may be null become pandas' nullable type, not floats.
    """
    if column.length == ANY:
        return array.to_pandas()
    if column.length:
        rows = array.flatten().to_numpy(zero_copy_only=False).reshape(len(array), column.length)
        return pd.Series(list(rows), dtype=object)
    if column.nullable and pa.types.is_integer(array.type):
        return array.to_pandas(integer_object_nulls=True).astype(column.pandas_dtype)
    return array.to_pandas()


def _schema_error(table: str, problems: list[str], advice: str) -> FinloopError:
    """Return the error that lists why a table does not fit its schema.

    table: its name, in words. problems: a message each. advice: what the user can do.
    """
    return FinloopError(
        came=f"{table} does not fit its schema:\n    " + "\n    ".join(problems),
        wanted="every column of the schema, with its type and unit, and no other",
        do=advice,
    )


def save_csv_in_blocks(path: Path, blocks: Iterable[pd.DataFrame], decimals: int) -> None:
    """Write a long table with its index as CSV, block by block, completely or not at all.

    blocks: data frames of the same columns. decimals: digits after the point of every float.
    """
    with whole_file(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        for number, block in enumerate(blocks):
            block.to_csv(
                file, header=number == 0, float_format=f"%.{decimals}f", lineterminator="\n"
            )


@contextmanager
def table_writer(path: Path, schema: Schema) -> Iterator[Callable[[pd.DataFrame], None]]:
    """Yield a function that appends a data frame to a Parquet file.

    So the table may be larger than the memory. The file appears at `path` when the block succeeds.
    The function raises FinloopError for a data frame that does not fit the schema.
    """
    coding = parquet_coding(schema)
    with whole_file(path) as part, pq.ParquetWriter(part, arrow_schema(schema), **coding) as file:
        yield lambda frame: file.write_table(arrow_table(frame, schema, str(path)))
