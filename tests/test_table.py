"""Tables keep to their schema, and everything that is wrong is said at once."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from finloop.base.errors import FinloopError
from finloop.base.schema import ANY, Column, Schema, columns, lists_to_array
from finloop.io.table import (
    apply_schema,
    load_list_columns,
    load_table,
    read_list_blocks,
    save_csv,
    save_table,
)

SCHEMA = Schema(
    Column("frame", "int32", "1"),
    Column("x_px", "float64", "px"),
    Column("speed", "float32", "px/s", nullable=True),
    Column("type", "int8", "1", nullable=True),
    Column("name", "string", "1"),
    Column("seen", "bool", "1"),
    Column("line_px", "float32", "px", length=3),
)


def table(**changes) -> pd.DataFrame:
    columns = {
        "frame": [0, 1], "x_px": [0.1, 2.0], "speed": [1.5, np.nan], "type": pd.array([1, None], "Int8"),
        "name": ["a", "b"], "seen": [True, False], "line_px": list(np.arange(6, dtype="f4").reshape(2, 3)),
    }  # fmt: skip
    return pd.DataFrame(columns | changes)


def test_round_trip(tmp_path):
    path = tmp_path / "a.parquet"
    save_table(path, table(), SCHEMA)
    back = load_table(path, SCHEMA)
    assert list(back.columns) == SCHEMA.names
    kinds = [str(back[name].dtype) for name in ("frame", "x_px", "speed", "type", "seen")]
    assert kinds == ["int32", "float64", "float32", "Int8", "bool"]
    assert back["x_px"].tolist() == [0.1, 2.0]
    assert back["speed"].isna().tolist() == [False, True]
    assert back["type"].isna().tolist() == [False, True]
    np.testing.assert_array_equal(lists_to_array(back["line_px"]), [[0, 1, 2], [3, 4, 5]])
    assert [file.name for file in tmp_path.iterdir()] == ["a.parquet"]
    raw = pq.read_table(path)  # missing is null, and never NaN in the file
    assert raw["speed"].null_count == 1
    assert raw.schema.field("x_px").metadata[b"unit"] == b"px"
    assert not raw.schema.field("x_px").nullable


def test_a_table_without_rows_is_as_it_is_loaded(tmp_path):
    schema = Schema(*SCHEMA.columns, Column("any", "int16", "1", nullable=True, length=ANY))
    save_table(tmp_path / "a.parquet", schema.empty(), schema)
    back = load_table(tmp_path / "a.parquet", schema)
    pd.testing.assert_frame_equal(back, schema.empty())
    assert lists_to_array(back["line_px"]).shape[0] == 0


def test_lists_are_read_some_rows_at_a_time(tmp_path):
    path, lines = tmp_path / "a.parquet", np.arange(30, dtype=np.float32).reshape(10, 3)
    schema = Schema(*SCHEMA.columns[:1], SCHEMA.columns[-1])
    save_table(path, pd.DataFrame({"frame": range(10), "line_px": list(lines)}), schema)
    lots = [some for (some,) in read_list_blocks(path, schema, ["line_px"], 4)]
    assert [len(some) for some in lots] == [4, 4, 2]
    assert np.array_equal(np.concatenate(lots), lines)
    with pytest.raises(FinloopError, match="other: missing"):
        list(read_list_blocks(path, schema, ["other"], 4))
    with pytest.raises(FinloopError, match="cannot be read"):
        list(read_list_blocks(tmp_path / "b.parquet", schema, ["line_px"], 4))


def test_columns_are_put_in_order(tmp_path):
    path = tmp_path / "a.parquet"
    save_table(path, table()[["x_px", *table().columns.drop("x_px")]], SCHEMA)
    assert pq.read_schema(path).names == SCHEMA.names


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"frame": [0.5, 1]}, "frame: not int32"),
        ({"frame": [0, 2**40]}, "frame: not int32"),
        ({"frame": ["a", "b"]}, "frame: not int32"),
        ({"x_px": [np.nan, 1]}, "x_px: 1 null or NaN"),
        ({"x_px": [None, None]}, "x_px: 2 null or NaN"),
        ({"name": [None, "b"]}, "name: 1 null or NaN"),
        ({"line_px": [[1, 2, 3], [1, np.nan, 3]]}, "line_px: 1 null or NaN"),
        ({"line_px": [[1, 2], [1, 2]]}, "line_px: not lists of 3 float32"),
        ({"line_px": [[1, 2, 3], [1, 2]]}, "line_px: not lists of 3 float32"),
        ({"other": [0, 0]}, "other: not in the schema"),
    ],
)
def test_what_does_not_fit_is_refused_on_saving(tmp_path, changes, said):
    with pytest.raises(FinloopError, match=said):
        save_table(tmp_path / "a.parquet", table(**changes), SCHEMA)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("length", [2, ANY])
@pytest.mark.parametrize("numbers", [[1, 2.5], [1, 2**40]])
def test_integers_in_lists_are_not_changed(length, numbers):
    schema = Schema(Column("places", "int32", "1", length=length))
    with pytest.raises(FinloopError, match="places: not lists"):
        apply_schema(pd.DataFrame({"places": [numbers]}), schema)
    kept = apply_schema(pd.DataFrame({"places": [[1, 2]]}), schema)
    assert kept["places"][0].tolist() == [1, 2]


def test_all_problems_are_said_at_once(tmp_path):
    bad = table(frame=["a", "b"], x_px=[np.nan, 1.0], other=[1, 2]).drop(columns="seen")
    with pytest.raises(FinloopError) as caught:
        save_table(tmp_path / "a.parquet", bad, SCHEMA)
    for problem in ("frame: not", "x_px: 1 null", "other: not in", "seen: missing"):
        assert problem in str(caught.value)


def test_all_problems_are_said_at_once_on_loading(tmp_path):
    path = tmp_path / "a.parquet"
    fields = [
        pa.field("frame", pa.int64(), True, {"unit": "1"}),
        pa.field("x_px", pa.float64(), True, {"unit": "mm"}),
        pa.field("other", pa.int8()),
    ]
    columns = [pa.array([1]), pa.array([None], pa.float64()), pa.array([1], pa.int8())]
    pq.write_table(pa.Table.from_arrays(columns, schema=pa.schema(fields)), path)
    with pytest.raises(FinloopError) as caught:
        load_table(path, SCHEMA)
    problems = ["frame: int64, wanted int32", "x_px: in 'mm', wanted 'px'", "x_px: 1 null"]
    for problem in [*problems, "other: not in", "seen: missing", "line_px: missing"]:
        assert problem in str(caught.value)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_small_table_does_not_tell_one_processor_from_another(tmp_path, dtype):
    measured = np.array([1234.567, 0.123456, 1e-6, np.nan])
    for name, last_bits in (("a.csv", 0), ("b.csv", 1e-6)):
        values = (measured * (1 + last_bits)).astype(dtype)
        frame = pd.DataFrame({"frame": [1, 2, 3, 123456], "x": values, "why": list("abcd")})
        save_csv(tmp_path / name, frame, decimals=5)
    text = (tmp_path / "a.csv").read_text()
    assert text == "frame,x,why\n1,1235.0,a\n2,0.1235,b\n3,0.0,c\n123456,,d\n"
    assert text == (tmp_path / "b.csv").read_text()


def test_an_exact_table_keeps_its_decimals(tmp_path):
    save_csv(tmp_path / "a.csv", pd.DataFrame({"x": [1234.56789]}), decimals=3, exact=True)
    assert (tmp_path / "a.csv").read_text() == "x\n1234.568\n"


def test_lists_are_loaded_as_one_array_and_refused_where_their_lengths_differ(tmp_path):
    schema = Schema(*columns("float32", "1", "even", "odd", length=ANY))
    even = np.arange(6, dtype=np.float32).reshape(2, 3)
    table = pd.DataFrame({"even": list(even), "odd": [even[0], even[1, :2]]})
    save_table(tmp_path / "lists.parquet", table, schema)
    (back,) = load_list_columns(tmp_path / "lists.parquet", schema, "even")
    np.testing.assert_array_equal(back, even)
    with pytest.raises(FinloopError, match="odd: lists of 2 to 3"):
        load_list_columns(tmp_path / "lists.parquet", schema, "even", "odd")
