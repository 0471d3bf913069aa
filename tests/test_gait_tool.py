"""The command `python -m finloop.gait`."""

import json
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE_S, ROOT
from scratch import save_svg

from finloop.base.errors import FinloopError
from finloop.gait.tool import (
    SHIPPED,
    choose_frame_timing,
    find_gait_file,
    load_gait,
    main,
    shipped_gait_files,
)
from finloop.io.svg import load_svg

DOG = [str(ROOT / f"data/drawings/dog_{key}.svg") for key in (1, 2)]
SMALL = ["--points", "32", "--frames", "4"]


def leg(name: str, x: int = 9) -> str:
    return f'<path id="{name}" d="M{x} 9H{x + 9}V60H{x}z"/>'


@pytest.mark.parametrize("ending", [".svg", ".spine.json"])
def test_the_command_writes_a_drawing_and_says_what_it_made(tmp_path, ending, capsys):
    out = tmp_path / f"out{ending}"
    given = [*DOG, "--gait", "dog_walk", "-o", str(out), *SMALL, "--size", "64"]
    assert main(given) == 0
    said = capsys.readouterr()
    assert said.out.startswith(f"{out}: 16 contours, 4 frames, a cycle of ")
    assert "feet slide 0.0" in said.out
    assert said.err == ""
    beside = {"out.spine.atlas", "finloop-white.png"} if ending == ".spine.json" else set()
    assert {path.name for path in tmp_path.iterdir()} == {out.name, *beside}


def test_the_command_from_end_to_end(tmp_path):
    """As a person would: another process, in another folder, two cycles in a row."""
    command = [sys.executable, "-m", "finloop.gait", *DOG, "--gait", "dog_walk", "-o", "out.json"]
    done = subprocess.run(
        [*command, *SMALL, "--cycles", "2", "--level", "3", "--wavelet", "db4"],
        cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, text=True, capture_output=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    frames = json.loads((tmp_path / "out.json").read_text())["frames"]
    assert [frame["tau"] for frame in frames] == [0, 0.5, 1, 0.5] * 2
    assert frames[:4] == frames[4:]
    assert {len(points) for points in frames[0]["layers"].values()} == {32}
    assert list(frames[0]["layers"]) == list(load_svg(Path(DOG[0])).curves)


def test_level_and_wavelet_reach_the_drawing(tmp_path):
    """Without a level, and with one γ a limb, all points move alike by any wavelet."""
    out, made = tmp_path / "out.json", {}
    for level in ("0", "3"):
        for wavelet in ("coif2", "db4"):
            given = ["--level", level, "--wavelet", wavelet, "-o", str(out), *SMALL]
            assert main([*DOG, "--gait", "dog_walk", *given]) == 0
            made[level, wavelet] = out.read_bytes()
    assert made["0", "coif2"] == made["0", "db4"]
    assert len(set(made.values())) == 3


def test_the_wavelet_of_control_points_does_not_change_a_gait_by_scale(tmp_path):
    """γ per scale belongs to the wavelet that it was fitted with."""
    gait = json.loads((SHIPPED / "dog_walk.json").read_text())
    for subcycles in gait["gamma"].values():
        subcycles |= {"A": [0.5, -0.5], "B": [-0.5, 0.5]}
    own, out, made = tmp_path / "own.json", tmp_path / "out.json", set()
    own.write_text(json.dumps(gait))
    for wavelet in ("coif2", "db4"):
        assert main([*DOG, "--gait", str(own), "--wavelet", wavelet, "-o", str(out), *SMALL]) == 0
        made.add(out.read_bytes())
    assert len(made) == 1


def test_a_gallop_takes_four_key_poses(tmp_path, capsys):
    keys = [str(ROOT / f"data/drawings/cat_gallop_{key}.svg") for key in (1, 2, 3, 4)]
    out = tmp_path / "out.json"
    assert main([*keys, "--gait", "horse_gallop", "-o", str(out), *SMALL]) == 0
    assert [frame["tau"] for frame in json.loads(out.read_text())["frames"]] == [0, 0.25, 0.5, 0.75]
    assert "a cycle of 0.5 s" in capsys.readouterr().out
    few = "-o", str(out), "--points", "32", "--frames", "8"
    for given, is_wrong in ((keys, False), (keys[::-1], True)):
        assert main([*given, "--gait", "horse_gallop", *few]) == 0
        assert ("in the gait's order?" in capsys.readouterr().out) == is_wrong
    for given, gait, said in (
        (keys[:2], "horse_gallop", "2 key poses for a gait of symmetry 'none'"),
        (keys, "dog_walk", "4 key poses for a gait of symmetry 'swap'"),
        (keys[:1], "dog_walk", "1 key poses"),
    ):
        assert main([*given, "--gait", gait, "-o", str(out), *SMALL]) == 1
        assert said in capsys.readouterr().err


@pytest.mark.parametrize(("animal", "ear"), [("dog", "ear"), ("cat", "ear_near")])
def test_a_trot_moves_both_drawings_whose_feet_stand(tmp_path, animal, ear, capsys):
    keys = [str(ROOT / f"data/drawings/{animal}_{key}.svg") for key in (1, 2)]
    out = tmp_path / "out.json"
    assert main([*keys, "--gait", "dog_trot", "-o", str(out), *SMALL]) == 0
    slide = float(re.search(r"feet slide ([\d.e-]+) %", capsys.readouterr().out)[1])
    assert slide < 0.5
    first, _, half, _ = json.loads(out.read_text())["frames"]
    moved = abs(np.subtract(first["layers"][ear], half["layers"][ear])).max()
    assert moved < 1  # what names no side is where it was after half a cycle


def test_an_animated_picture_goes_on_from_its_last_frame_to_its_first(tmp_path):
    """It would stand still at its end otherwise, and jump."""
    out = tmp_path / "out.svg"
    assert main([*DOG, "--gait", "dog_walk", "-o", str(out), *SMALL]) == 0
    values = out.read_text().split('values="')[1].split('"')[0].split(";")
    assert len(values) == 5 and values[0] == values[-1] != values[-2]


def test_what_a_viewer_should_know_is_said(tmp_path, capsys):
    key1 = save_svg(tmp_path / "1.svg", leg("fore_left", -5) + leg("fore_right", 60))
    key2 = save_svg(tmp_path / "2.svg", leg("fore_left", 20) + leg("fore_right", 20))
    assert main([key1, key2, "--gait", "dog_walk", "-o", str(tmp_path / "o.svg"), *SMALL]) == 0
    said = capsys.readouterr().out
    assert "leaves the picture: fore_left in 1, fore_right in 1 of 4 frames" in said
    assert "no contour or group is hind_right, hind_left of dog_walk" in said
    assert main([key2, key1, "--gait", "dog_walk", "-o", str(tmp_path / "o.svg"), *SMALL]) == 0
    assert "should stand" not in capsys.readouterr().out
    lame = leg("fore_left", 20) + '<path id="fore_right" d="M20 9H29V50H20z"/>'
    key2 = save_svg(tmp_path / "2.svg", lame)
    assert main([key1, key2, "--gait", "dog_walk", "-o", str(tmp_path / "o.svg"), *SMALL]) == 0
    assert "in key 2 fore_right should stand" in capsys.readouterr().out
    other = save_svg(tmp_path / "3.svg", leg("arm"))
    assert main([other, other, "--gait", "dog_walk", "-o", str(tmp_path / "o.svg"), *SMALL]) == 0
    assert "no contour is a foot of dog_walk" in capsys.readouterr().out


# --- shipped_gaits


def test_shipped_gaits_are_found_by_name_and_others_by_path(tmp_path):
    assert find_gait_file("dog_walk", SHIPPED) == SHIPPED / "dog_walk.json"
    own = tmp_path / "own.json"
    own.write_bytes((SHIPPED / "dog_walk.json").read_bytes())
    assert find_gait_file(str(own), SHIPPED) == own
    with pytest.raises(FinloopError, match="dog_walk or "):
        find_gait_file("cat", SHIPPED)
    assert all(load_gait(path).name == name for name, path in shipped_gait_files(SHIPPED).items())
    with pytest.raises(FinloopError, match="wanted: the path of"):
        find_gait_file("cat", tmp_path / "nowhere")


def test_the_list_shows_each_gait(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--list"])
    assert stop.value.code == 0
    names = [line.split(":")[0] for line in capsys.readouterr().out.splitlines()]
    assert names == list(shipped_gait_files(SHIPPED))


@pytest.mark.parametrize(
    ("hz", "frames", "rate", "wanted"),
    [(1.5, None, None, (20, 30)), (1.5, None, 12, (8, 12)), (1.5, 40, None, (40, 60)),
     (1.5, 40, 20, (40, 20)), (25.0, None, None, (4, 30)), (0.0001, None, None, (10_000, 30))],
)  # fmt: skip
def test_tempo(hz, frames, rate, wanted):
    assert choose_frame_timing(hz, frames, rate and Fraction(rate)) == wanted


# --- bad input


@pytest.mark.parametrize(
    ("one", "two", "given", "says"),
    [
        (leg("a"), leg("b"), [], "'a' only in the first; 'b' only in the second"),
        (leg("a"), '<path id="a" d="M9 9H18V60"/>', [], "'a' closed in the first, open in the second"),
        (leg("a"), "", [], "no contour"),
        (leg("a"), leg("a"), ["--gait", "cat"], "dog_walk or "),
        (leg("a"), leg("a"), ["--frames", "3"], "3 frames"),
        (leg("a"), leg("a"), ["--frames", "99999"], "99999 frames"),
        (leg("a"), leg("a"), ["--points", "4"], "4 points"),
        (leg("a"), leg("a"), ["--cycles", "0"], "0 cycles"),
        (leg("a"), leg("a"), ["--cycles", "9999"], "9999 cycles"),
        (leg("a"), leg("a"), ["--level", "4"], "0 to 3: a contour needs 4 control points"),
        (leg("a"), leg("a"), ["--level", "-1"], "level -1"),
        (leg("a"), leg("a"), ["--wavelet", "db99"], "the wavelet 'db99'"),
        (leg("a"), leg("a"), ["--rate", "2000"], "2000 frames per second"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_and_nothing_is_left(tmp_path, one, two, given, says, capsys):
    keys = [save_svg(tmp_path / f"{k}.svg", inside) for k, inside in enumerate((one, two))]
    out = str(tmp_path / "out.svg")
    assert main([*keys, "--gait", "dog_walk", "-o", out, *SMALL, *given]) == 1
    said = capsys.readouterr()
    assert said.err.startswith("finloop: ") and says in said.err
    assert said.out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.svg", "1.svg"]


@pytest.mark.parametrize("output", ["out.gif", "out", "/dev/null/out.svg"])
def test_the_command_cannot_write_there(output, capsys):
    assert main([*DOG, "--gait", "dog_walk", "-o", output, *SMALL]) == 1
    assert output.removesuffix("/out.svg") in capsys.readouterr().err


@pytest.mark.parametrize("wrong", [["--rate", "fast"], ["--rate", "1/0"], ["--rate", "-3"]])
def test_the_command_refuses_what_it_does_not_know(wrong, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*DOG, "--gait", "dog_walk", "-o", "out.svg", *wrong])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert wrong[0] in said and "frames per second" in said
