"""Files of strangers: a reader gives a result or one message, whatever a file holds or declares."""

import io
import pickle
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hostile import Runs

from finloop.base.errors import FinloopError
from finloop.base.yaml_limits import refuse_yaml_bomb
from finloop.io.limits import MOST_BYTES, MOST_RATIO, call_aside, limit_memory, refuse_bomb
from finloop.io.parameters import read_parameters
from finloop.io.picture import decode_picture
from finloop.io.poses import load_poses
from finloop.io.poses.pickled import load_plain_pickle

ROOT = Path(__file__).parents[1]
FUZZ = """
import os
import sys
from pathlib import Path
from benchmarks import fault_files
from benchmarks.fault_seeds import CANARY, READERS, Reader
from finloop.base.errors import FinloopError

def fail(reason):
    raise reason

def make(folder):
    (folder / "a").write_bytes(b"any")

def bad(read):
    return Reader("a", make, lambda folder: folder.name == "case" and read(folder))

BAD = {
    "raises": bad(lambda folder: 1 / 0),
    "dies": bad(lambda folder: os.kill(os.getpid(), 11)),
    "runs": bad(lambda folder: os.system("true")),
    "leaves a trace": bad(lambda folder: Path(CANARY).touch()),
    "swallows": bad(lambda folder: bytearray(2**31)),
    "says nothing": bad(lambda folder: fail(FinloopError("", "a", "b"))),
}
for number, name in enumerate([*READERS]):
    if number % 6:  # the others take too long here
        del READERS[name]
count = len(READERS)
READERS.update(BAD)
sys.argv[1:] = ["--count", "2", "--inside", "--mutated", "--only", *READERS]
try:
    fault_files.main()
finally:
    print(count)
"""


def test_readers_give_a_result_or_one_message_and_each_kind_of_fault_is_found():
    pytest.importorskip("h5py")  # of `make tracks`, as the files that are spoiled
    done = subprocess.run(
        [sys.executable, "-c", FUZZ], cwd=ROOT, capture_output=True, text=True, check=False
    )
    *table, count = done.stdout.splitlines()
    columns = table[0].split()
    rows = [line.rsplit(maxsplit=len(columns) - 1) for line in table[1:]]
    files, faults = (
        [int(row[columns.index(name)]) for row in rows] for name in ("files", "faults")
    )
    assert len(rows) == int(count) + 6, done.stderr
    assert faults == [0] * int(count) + files[-6:], done.stderr
    assert set(files) == {2}


def test_what_a_file_declares_is_held_against_its_size():
    refuse_bomb("a", MOST_BYTES, 1, "-")
    refuse_bomb("a", MOST_RATIO * 10**8, 10**8, "-")
    with pytest.raises(
        FinloopError, match=r"a declares 30\.0 GB of content, in a file of 91 bytes"
    ):
        refuse_bomb("a", 30 * 10**9, 91, "-")
    with pytest.raises(FinloopError):
        refuse_bomb("a", MOST_RATIO * 10**8 + 1, 10**8, "-")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory")
def test_memory_is_limited_while_a_file_is_read_and_not_afterwards():
    with pytest.raises(MemoryError), limit_memory(1):
        np.empty(5 * MOST_BYTES, np.uint8)
    assert np.empty(5 * MOST_BYTES, np.uint8).size
    with limit_memory(1):
        assert np.empty(MOST_BYTES, np.uint8).size


def test_a_process_that_dies_over_a_file_is_an_error_and_the_next_file_is_read():
    with pytest.raises(ValueError, match="ends the process that reads it"):
        call_aside(sys.exit, 3, 1)
    assert call_aside(abs, -3, 1) == 3


def test_a_png_that_declares_a_hundred_thousand_rows_is_refused_before_it_is_decoded(tmp_path):
    head = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(b"")), (b"IEND", b""))
    chunks = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )
    path = tmp_path / "a.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
    with pytest.raises(FinloopError, match=r"100000×100000 pixels, declares 30\.0 GB"):
        decode_picture(path, cv2.IMREAD_COLOR)
    path.write_bytes(cv2.imencode(".png", np.zeros((900, 900), np.uint8))[1].tobytes())
    assert decode_picture(path, cv2.IMREAD_GRAYSCALE).shape == (900, 900)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 60 + "]" * 60, "50 levels"),
        ("[" * 10**5, "50 levels"),
        ("a: &a [x, x]\n" + "".join(
            f"b{k}: &{'ba'[k % 2]} [*{'ab'[k % 2]}, *{'ab'[k % 2]}]\n" for k in range(40)
        ), "100000 values"),
        ("a: &a [*a]", "no value before it"),
    ],
)  # fmt: skip
def test_yaml_that_is_deep_or_multiplies_is_refused(text, said):
    with pytest.raises(yaml.YAMLError, match=said):
        refuse_yaml_bomb(text)


def test_yaml_with_aliases_is_read(tmp_path):
    (tmp_path / "a.yaml").write_text("a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a}\n")
    values = {"a": {"x": 1}, "b": [{"x": 1}, {"x": 1}], "c": {"x": 1}}
    assert read_parameters(tmp_path / "a.yaml") == values


@pytest.mark.parametrize("protocol", range(6))
def test_a_pickle_is_data_and_nothing_else(protocol, capsys):
    record = {"a": [1, 2.5, None, True, -(2**70)], "b": ("x", b"y", {"z"}), "c": Path("a/b")}
    assert load_plain_pickle(io.BytesIO(pickle.dumps(record, protocol))) == record | {"c": "a/b"}
    with pytest.raises(ValueError, match=r"would run \w+\.print"):
        load_plain_pickle(io.BytesIO(pickle.dumps([Runs()], protocol)))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x04]r\xff\xff\xff\x7f0.",  # remembered as number 2³¹ − 1, and nothing is left
        b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7f.",  # a text of 2⁶³ − 1 letters
        b"cnumpy\nndarray\nN}U\x0c__setstate__Ns\x86b.",  # sets an attribute of a class
        b"ios\nsystem\n(S'true'\ntR.",
        b"\x80\x02" + b"(" * 10**4 + b"t" * 9999 + b".",
    ],
)
def test_hostile_pickles_are_refused(content, tmp_path):
    (tmp_path / "a.pickle").write_bytes(content)
    with pytest.raises(FinloopError, match="cannot be read as tracks"):
        load_poses(tmp_path / "a.pickle", None, 25.0)


def test_lists_within_lists_that_share_their_parts_are_no_places(tmp_path):
    nested = [1.0]
    for _ in range(60):
        nested = [nested, nested]
    for record in (
        {"trajectories": nested},
        {"trajectories": np.zeros((2, 2, 2)), "identities_labels": nested},
    ):
        (tmp_path / "a.pickle").write_bytes(pickle.dumps(record))
        with pytest.raises(FinloopError, match=r"no array of numbers|no names"):
            load_poses(tmp_path / "a.pickle", None, 25.0)


def test_many_animals_in_few_rows_take_little_memory(tmp_path):
    rows = "".join(f"t{k},{k},1,2,1\n" for k in range(3000))  # 9 million cells if all were stored
    (tmp_path / "a.csv").write_text("track,frame_idx,a.x,a.y,a.score\n" + rows)
    with limit_memory(1):
        poses = load_poses(tmp_path / "a.csv", None, 25.0)
    assert len(poses.individuals) == len(poses.frame) == 3000


def test_a_message_does_not_steer_the_terminal_and_has_an_end():
    error = FinloopError("a\x1b[2J\u202eb\n  c" + "x" * 10**5, "b", "c")
    assert error.came.startswith("a?[2J?b\n  c") and len(str(error)) < 5000
