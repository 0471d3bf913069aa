"""The cut-out store and the other files of `extract`: round trips, and what is damaged is said."""

import os
import resource
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.schema import Column, Schema
from finloop.extract.table import SceneFacts
from finloop.io.atomic import require_output_place, whole_file, whole_folder
from finloop.io.cutouts import CutoutWriter, open_cutouts, tracks_writer
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import load_record, save_record
from finloop.io.table import load_table

BATCHES = 600  # cut-outs: two full batches in the file, and a part of one


def pictures(count, channels=2):
    """Cut-outs of all sizes with random pixels, premultiplied."""
    rng = np.random.default_rng(0)
    for k in range(count):
        pixels = rng.integers(0, 256, (*rng.integers(1, 30, 2), channels), np.uint8)
        pixels[..., :-1] = np.minimum(pixels[..., :-1], pixels[..., -1:])
        yield Cutout(k % 7, k // 7, int(rng.integers(2000)), int(rng.integers(2000)), pixels)


def write_cutouts(path, cutouts):
    with CutoutWriter(path) as writer:
        for cutout in cutouts:
            writer.write(cutout)
    return path


def same(one, other):
    return one[:4] == other[:4] and np.array_equal(one.pixels, other.pixels)


# -- a film's rows ------------------------------------------------------------------------------

ROWS = Schema(
    Column("track_id", "int32", "1"),
    Column("frame", "int32", "1"),
    Column("line", "float32", "px", length=3),
)


@pytest.mark.parametrize("count", [0, 1, 3000])
def test_rows_of_a_film_are_sorted_by_track_and_frame_beside_their_cutouts(tmp_path, count):
    rng = np.random.default_rng(0)
    frame = np.sort(rng.integers(0, 99999, count))
    track = rng.integers(0, 7, count)  # fish come frame by frame, any of the tracks
    given = pd.DataFrame({"track_id": track, "frame": frame}).drop_duplicates(ignore_index=True)
    given["line"] = [np.full(3, number) for number in given.index]
    with tracks_writer(tmp_path, ROWS) as write:
        for start in range(0, len(given), 512):
            lot = given[start : start + 512]
            pictures = np.array(lot.index, np.int32).view(np.uint8).reshape(-1, 1, 2, 2)
            where = zip(lot["track_id"], lot["frame"], pictures, strict=True)
            write(lot, (Cutout(t, f, t, f, pixels) for t, f, pixels in where))
    wanted = given.sort_values(["track_id", "frame"])
    table = load_table(tmp_path / "tracks.parquet", ROWS)
    for name in ("track_id", "frame"):
        assert table[name].tolist() == wanted[name].tolist()
    assert [line.tolist() for line in table["line"]] == [[k] * 3 for k in wanted.index]
    with open_cutouts(tmp_path / "cutouts.arrow") as store:
        assert store.index["x0_px"].tolist() == wanted["track_id"].tolist()
        assert store.index[["track_id", "frame"]].equals(table[["track_id", "frame"]])
        shown = [store[k].pixels.ravel().view(np.int32)[0] for k in range(len(store))]
    assert shown == list(wanted.index)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cutouts.arrow", "tracks.parquet"]


# -- the store ----------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 256, BATCHES])
@pytest.mark.parametrize("channels", [2, 4])
def test_cutouts_come_back_in_any_order(tmp_path, count, channels):
    given = list(pictures(count, channels))
    with open_cutouts(write_cutouts(tmp_path / "c.arrow", given)) as store:
        assert len(store) == len(store.index) == count
        for k in np.random.default_rng(1).permutation(count):
            assert same(store[k], given[k])
        assert store.index["track_id"].tolist() == [cutout.track_id for cutout in given]
        assert store.index["frame"].tolist() == [cutout.frame for cutout in given]


def test_a_store_is_small_and_takes_views_of_larger_pictures(tmp_path):
    whole = np.arange(2 * 30 * 40, dtype=np.uint32).astype(np.uint8).reshape(30, 40, 2)
    part = Cutout(0, 0, 0, 0, whole[3:20:2, 5:30])
    with open_cutouts(write_cutouts(tmp_path / "v.arrow", [part])) as store:
        assert np.array_equal(store[0].pixels, part.pixels)
    flat = Cutout(0, 0, 0, 0, np.full((100, 100, 4), 7, np.uint8))
    assert write_cutouts(tmp_path / "c.arrow", [flat] * 50).stat().st_size < 50 * 400


def test_a_store_can_be_written_again_while_it_is_open(tmp_path):
    given = list(pictures(20))
    with open_cutouts(write_cutouts(tmp_path / "c.arrow", given)) as store:
        write_cutouts(tmp_path / "c.arrow", given[:3])
        assert same(store[19], given[19])
    with open_cutouts(tmp_path / "c.arrow") as store:
        assert len(store) == 3


@pytest.mark.parametrize("before", [False, True])
def test_an_exception_while_writing_leaves_what_was_there(tmp_path, before):
    path = tmp_path / "c.arrow"
    if before:
        write_cutouts(path, pictures(5))
    with pytest.raises(KeyError), CutoutWriter(path) as writer:
        for cutout in pictures(BATCHES):
            writer.write(cutout)
        raise KeyError
    assert [p.name for p in tmp_path.iterdir()] == (["c.arrow"] if before else [])
    if before:
        with open_cutouts(path) as store:
            assert len(store) == 5


def test_a_store_without_its_end_is_said(tmp_path):
    path = write_cutouts(tmp_path / "c.arrow", pictures(BATCHES))
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(FinloopError, match=r"c\.arrow cannot be read.*\n.*\n.*extract"):
        with open_cutouts(path):
            pass


def test_a_store_with_spoilt_pixels_is_said(tmp_path):
    path = write_cutouts(tmp_path / "c.arrow", pictures(40))
    data = bytearray(path.read_bytes())
    begin = data.find(b"\x28\xb5\x2f\xfd")  # where zstd's first frame starts
    data[begin : begin + 4] = b"\0\0\0\0"
    path.write_bytes(data)
    with open_cutouts(path) as store:
        assert same(store[39], list(pictures(40))[39])
        with pytest.raises(FinloopError, match=r"cut-out 0 .*\n.*\n.*extract"):
            store[0]


def test_another_arrow_file_is_refused(tmp_path):
    path = tmp_path / "c.arrow"
    table = pa.table({"track_id": pa.array([1], pa.int32()), "picture": ["x"]})
    with pa.ipc.new_file(str(path), table.schema) as file:
        file.write_table(table)
    with pytest.raises(FinloopError, match="track_id, picture"), open_cutouts(path):
        pass


# -- a cut-out over a background ----------------------------------------------------------------


@pytest.mark.parametrize("tank", [(50, 60), (50, 60, 3)])
def test_a_cutout_over_a_background(tank):
    rng = np.random.default_rng(2)
    background = rng.integers(0, 256, tank, np.uint8)
    channels = 4 if len(tank) == 3 else 2
    here = np.s_[7:17, 11:32]
    pixels = np.zeros((10, 21, channels), np.uint8)
    assert np.array_equal(Cutout(0, 0, 11, 7, pixels).blend_over(background), background[here])
    pixels[:] = 255  # nothing of the tank shines through
    pixels[..., :-1] = rng.integers(0, 256, (10, 21, channels - 1))
    opaque = Cutout(0, 0, 11, 7, pixels).blend_over(background)
    assert np.array_equal(opaque, pixels[..., :-1].reshape(opaque.shape))
    pixels[..., -1] = 128
    pixels[..., :-1] = 64  # half of the tank, and half of a 127.5
    half = Cutout(0, 0, 11, 7, pixels).blend_over(background)
    assert np.abs(half - (64 + background[here] * (127 / 255))).max() <= 0.5


# -- pictures, figures, facts -------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(9, 14), (9, 14, 3), (9, 14, 4)])
def test_a_picture_comes_back_as_it_was(tmp_path, shape):
    picture = np.random.default_rng(3).integers(0, 256, shape, np.uint8)
    save_picture(tmp_path / "p.png", picture)
    shown = picture if picture.ndim == 2 else picture[..., :3]  # colours without alpha
    assert np.array_equal(load_picture(tmp_path / "p.png"), shown)
    assert [p.name for p in tmp_path.iterdir()] == ["p.png"]


def test_facts_come_back_and_too_few_are_said(tmp_path):
    path, facts = (
        tmp_path / "scene.json",
        SceneFacts("dark", 1.25, 6.25, 640.0, 70.5, 91.0, "all", 33),
    )
    save_record(path, facts)
    assert load_record(path, SceneFacts, "extract") == facts
    path.write_text('{"noise_grey": 1}')
    with pytest.raises(FinloopError, match=r"scene\.json cannot be read.*\n.*\n.*extract"):
        load_record(path, SceneFacts, "extract")


# -- whole or not at all ------------------------------------------------------------------------


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "new" / "deep" / "file.txt"
    with whole_file(path) as part:
        part.write_text("half")
        assert not path.exists()
        assert part.parent == path.parent  # one file system: the last step is a rename
        part.write_text("whole")
    assert [p.name for p in path.parent.iterdir()] == ["file.txt"]
    assert path.read_text() == "whole"

    part.write_text("of a process that was killed here")
    with whole_file(path) as part:
        part.write_text("again")
    assert [p.name for p in path.parent.iterdir()] == ["file.txt"]
    assert path.read_text() == "again"


@pytest.mark.parametrize("error", [ValueError(), KeyboardInterrupt(), OSError(28, "No space left")])
def test_what_fails_leaves_the_file_as_it_was_and_a_full_disk_is_said(tmp_path, error):
    path = tmp_path / "file.txt"
    path.write_text("before")
    with pytest.raises((type(error), FinloopError)) as caught, whole_file(path) as part:
        part.write_text("half")
        raise error
    assert ("disk is full" in str(caught.value)) == isinstance(error, OSError)
    assert [p.name for p in tmp_path.iterdir()] == ["file.txt"]
    assert path.read_text() == "before"


@pytest.mark.parametrize("write", [whole_file, whole_folder])
def test_a_limit_of_the_size_of_files_is_said_and_nothing_is_lost(tmp_path, write):
    path = tmp_path / "out"
    with write(path) as part:
        part.mkdir(exist_ok=True) if write is whole_folder else part.write_text("before")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(FinloopError, match="out: the file would be larger"):
            with write(path) as part:
                (part / "a" if write is whole_folder else part).write_bytes(bytes(2000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert path.is_dir() or path.read_text() == "before"


def no_work(write, path):
    """What is said before the work."""
    with pytest.raises(FinloopError) as caught, write(path):
        pytest.fail("the work begins")
    return caught.value.came


def test_what_stands_in_the_way_of_an_output_is_noticed_before_the_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("elsewhere").mkdir()
    Path("elsewhere/kept").touch()
    Path("link").symlink_to("elsewhere")
    Path("broken").symlink_to("nowhere")
    Path("file").touch()
    for name in ("link", "broken"):
        assert f"{name} is a link to " in no_work(whole_folder, Path(name))
        with pytest.raises(FinloopError, match=f"{name} is a link to "):
            require_output_place(Path(name))
    assert no_work(whole_folder, Path("file")) == "file is a file"
    assert no_work(whole_file, Path("elsewhere")) == "elsewhere is a folder"
    for path, came in (("link/x", "link is a link to"), ("file/x/y", "file is a file")):
        with pytest.raises(FinloopError, match=came):
            require_output_place(Path(path))
    require_output_place(Path("new/x"))
    monkeypatch.setattr(os, "access", lambda *_: False)  # as root may write anywhere
    with pytest.raises(FinloopError, match="elsewhere: it cannot be written"):
        require_output_place(Path("elsewhere/x/y"))
    assert sorted(map(str, Path.cwd().rglob("kept"))) == [str(tmp_path / "elsewhere/kept")]
