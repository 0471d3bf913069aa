"""Morphs of drawings in layers, and the command that makes them from two files to one."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import PATIENCE_S
from hypothesis import given, settings
from hypothesis import strategies as st
from scratch import save_svg

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.base.style import Paint
from finloop.curve.contour import Curve
from finloop.io.animation import ENDINGS
from finloop.io.svg import load_svg
from finloop.morph.folds import count_polygon_folds
from finloop.morph.layers import (
    METHODS,
    PhysicalOptions,
    fit_drawing,
    morph_drawings,
    there_and_back,
)
from finloop.morph.match import Resolution
from finloop.morph.tool import main

ROOT = Path(__file__).parents[1]
FACES = [str(ROOT / "data/drawings" / f"face_{which}.svg") for which in "ab"]
SQUARE = np.array([[20, 20], [60, 20], [60, 60], [20, 60.0]])
TRIANGLE = np.array([[10, 80], [50, 5], [90, 80.0]])
LINE = np.array([[10, 10], [40, 20], [90, 15.0]])
EIGHT = np.array([[10, 10], [60, 60], [60, 10], [10, 60.0]])


def drawing(width=100, height=100, styles=(), **curves):
    """Of arrays (n, 2), open where the name begins with "open"."""
    made = {name: Curve(points, not name.startswith("open")) for name, points in curves.items()}
    return Drawing(made, width, height, dict(styles))


RED, BLUE = Paint((255, 0, 0), None, 1, 1, 1), Paint((0, 0, 255), None, 1, 1, 1)
LIME_LINE = Paint(None, (0, 255, 0), 1, 1, 2)
A = drawing(box=SQUARE, open_line=LINE, styles={"box": RED})
STYLES = {"box": BLUE, "open_line": LIME_LINE}
B = drawing(open_line=LINE + [0, 60], box=TRIANGLE, styles=STYLES)


def far(points, line):
    """The farthest of points from a closed polyline."""
    a, b = line, np.roll(line, -1, axis=0)
    t = ((points[:, None] - a) * (b - a)).sum(-1) / ((b - a) ** 2).sum(-1)
    foot = a + np.clip(t, 0, 1)[..., None] * (b - a)
    return np.linalg.norm(points[:, None] - foot, axis=-1).min(axis=1).max()


# --- layers


@pytest.mark.parametrize("method", METHODS)
def test_a_morph_has_every_frame_of_every_layer(method):
    done = morph_drawings(A, B, method, 7, points=64)
    assert list(done.layers) == ["box", "open_line"]  # as the first drawing has them
    assert all(stack.shape == (7, 64, 2) for stack in done.layers.values())
    assert list(done.folds) == list(done.layers)
    assert all(count.shape == (7,) for count in done.folds.values())
    assert done.closed == {"box": True, "open_line": False}
    np.testing.assert_allclose(done.tau, np.arange(7) / 6)
    assert (done.styles["box"][0], done.styles["box"][-1]) == (RED, BLUE)
    assert done.styles["open_line"] == (LIME_LINE,) * 7  # painted in one drawing only
    assert (done.width, done.height) == (100, 100)


@pytest.mark.parametrize("method", ["linear", "fold_free"])
def test_the_ends_are_the_drawings(method):
    done = morph_drawings(A, B, method, 5, points=128)
    for frame, box, line in ((0, SQUARE, LINE), (-1, TRIANGLE, LINE + [0, 60])):
        assert far(done.layers["box"][frame], box) < 1e-4
        ends = done.layers["open_line"][frame][[0, -1]]
        np.testing.assert_allclose(ends[np.argsort(ends[:, 0])], line[[0, -1]], atol=1e-4)


def test_frames_lie_on_the_grid_that_is_told():
    for side, decimals in ((100, 4), (101, 3), (1, 6), (24, 4), (3e7, -2)):
        done = morph_drawings(
            fit_drawing(A, side, side), fit_drawing(B, side, side), "linear", 3, points=32
        )
        assert done.decimals == decimals
        for stack in done.layers.values():
            np.testing.assert_array_equal(stack, np.round(stack, decimals))
    corner = drawing(box=SQUARE - 20 - 1e-9)
    box = morph_drawings(corner, corner, "linear", 2, points=32).layers["box"]
    assert (box == 0).any() and not np.signbit(box).any()


@pytest.mark.parametrize(
    ("method", "one", "other"),
    [
        ("physical", *({"physics": PhysicalOptions(elastic=share)} for share in (8.0, 0.5))),
        *(
            (method, {"resolution": Resolution(0)}, {"resolution": Resolution(3)})
            for method in METHODS
        ),
        *(
            (method, {"resolution": Resolution(3, "coif2")}, {"resolution": Resolution(3, "db4")})
            for method in METHODS
        ),
    ],
)
def test_settings_reach_their_method(method, one, other):
    first, second = (morph_drawings(A, B, method, 5, 64, **given) for given in (one, other))
    for name in first.layers:
        assert np.abs(first.layers[name] - second.layers[name]).max() > 0.01


def test_without_a_level_the_wavelet_reaches_what_has_a_stiffness():
    """Blending all coefficients is blending the points, whatever the wavelet; K is each its own."""
    for method, reaches in (("linear", False), ("physical", True), ("fold_free", False)):
        frames = [
            morph_drawings(A, B, method, 5, 64, Resolution(0, wavelet)).layers["box"]
            for wavelet in ("coif2", "db4", "db10")
        ]
        assert all(np.array_equal(frames[0], other) != reaches for other in frames[1:])
        assert np.array_equal(frames[1], frames[2]) != reaches


def test_what_is_counted_is_what_is_shown():
    twisted = drawing(box=EIGHT)
    done = morph_drawings(twisted, twisted, "linear", 3, points=64)
    assert (done.folds["box"] > 0).all()
    assert not done.continuous["box"]
    np.testing.assert_array_equal(done.folds["box"], count_polygon_folds(done.layers["box"], True))


@settings(max_examples=30)
@given(
    size=st.tuples(st.floats(1, 500), st.floats(1, 500)),
    into=st.tuples(st.floats(1, 500), st.floats(1, 500)),
)
def test_fitted_drawings_keep_their_shape_and_touch_the_rim(size, into):
    corners = np.array([[0, 0], [size[0], 0], size, [0, size[1]]])
    shown = fit_drawing(drawing(*size, box=corners), *into).curves["box"].points
    low, high = shown.min(axis=0), shown.max(axis=0)
    extent = high - low
    assert extent[0] * size[1] == pytest.approx(extent[1] * size[0])
    np.testing.assert_allclose(low + high, into)  # in the middle
    assert (low >= -1e-9 * max(into)).all()
    assert np.isclose(extent, into).any()


def test_the_second_drawing_is_fitted_into_the_first():
    large = fit_drawing(B, 1000, 1000)
    one, other = (morph_drawings(A, b, "linear", 3, points=32) for b in (B, large))
    for name in one.layers:
        np.testing.assert_allclose(one.layers[name], other.layers[name], atol=2e-4)


def test_there_and_back_repeats_without_a_jump():
    done = morph_drawings(A, B, "linear", 4, points=32)
    shown = there_and_back(done)
    np.testing.assert_array_equal(shown.tau, done.tau[[0, 1, 2, 3, 2, 1]])
    np.testing.assert_array_equal(shown.layers["box"], done.layers["box"][[0, 1, 2, 3, 2, 1]])
    assert len(shown.folds["box"]) == 6


def test_the_faces_do_not_fold():
    done = morph_drawings(*map(load_svg, map(Path, FACES)), "fold_free", 60)
    assert not any(count.any() for count in done.folds.values())
    assert all(done.continuous.values())


# --- what does not belong together


def test_all_that_does_not_belong_together_is_told_at_once():
    a, b = drawing(box=SQUARE, nose=SQUARE), drawing(box=SQUARE, chin=SQUARE)
    with pytest.raises(FinloopError) as error:
        morph_drawings(a, b, "linear", 3)
    assert "'nose' only in the first; 'chin' only in the second" in error.value.came
    assert "box" not in error.value.came


@pytest.mark.parametrize(
    ("method", "frames", "points", "says"),
    [
        ("magic", 3, 64, "magic"),
        ("linear", 1, 64, "1 frames"),
        ("linear", 10**9, 64, "frames"),
        ("linear", 3, 4, "4 points"),
        ("linear", 3, 10**9, "points"),
    ],
)
def test_impossible_numbers(method, frames, points, says):
    with pytest.raises(FinloopError, match=says):
        morph_drawings(A, B, method, frames, points)


# --- the command


@pytest.mark.parametrize("ending", list(ENDINGS))
def test_the_command_writes_every_format(tmp_path, ending, capsys):
    out = tmp_path / f"out{ending}"
    given = [*FACES, "-o", str(out), "--frames", "4", "--points", "64", "--size", "64"]
    assert main(given) == 0
    said = capsys.readouterr()
    assert f"{out}: 11 contours, 4 frames, no folds" in said.out
    assert said.err == ""
    beside = {"out.spine.atlas", "finloop-white.png"} if ending == ".spine.json" else set()
    assert {path.name for path in tmp_path.iterdir()} == {out.name, *beside}


def test_the_command_counts_folds(tmp_path, capsys):
    star = '<path id="star" d="M50 5L76 86L7 36H93L24 86z"/>'
    eight = save_svg(tmp_path / "a.svg", '<path id="eight" d="M9 9L60 60V9L9 60z"/>' + star)
    given = [eight, eight, "-o", str(tmp_path / "o.json"), "--method", "linear", "--frames", "3"]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "folds: eight in 3, star in 3 of 3 frames" in said
    assert "painted by the even-odd rule, though fill-rule is nonzero: star" in said


def test_the_command_from_end_to_end(tmp_path):
    """As a person would: another process, in another folder, with `--back`."""
    command = [sys.executable, "-m", "finloop.morph", *FACES, "-o", "out.json", "--back"]
    done = subprocess.run(
        [*command, "--frames", "5", "--method", "linear", "--fps", "12.5", "--points", "32"],
        cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, text=True, capture_output=True, timeout=PATIENCE_S,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) == 1
    frames = json.loads((tmp_path / "out.json").read_text())["frames"]
    assert [frame["tau"] for frame in frames] == [0, 0.25, 0.5, 0.75, 1, 0.75, 0.5, 0.25]
    assert {len(points) for points in frames[0]["layers"].values()} == {32}
    assert list(frames[0]["layers"]) == list(load_svg(Path(FACES[0])).curves)


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("", "no contour"),
        ('<path id="box" d="M5 5L9 5Z"/>', "curve box"),
        ('<path id="box" d="M5 5L5 5"/>', "curve box"),
        ('<path id="box" d="M5 5L1e999 5"/>', "curve box"),
        ('<path id="box" d="M9 9L60 60V9L9 60z"/>', "shape 'box'"),
    ],
)
def test_the_command_tells_what_is_wrong_and_leaves_nothing(tmp_path, body, says, capsys):
    one = save_svg(tmp_path / "a.svg", body)
    other = save_svg(tmp_path / "b.svg", '<path id="box" d="M9 9H60V60z"/>')
    assert main([one, other, "-o", str(tmp_path / "out.svg")]) == 1
    said = capsys.readouterr()
    assert said.err.startswith("finloop: ")
    assert says in said.err
    assert said.out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.svg", "b.svg"]


@pytest.mark.parametrize(
    ("box", "method", "says"),
    [(EIGHT, "fold_free", "shape 'box'"), (SQUARE + 1e6, "linear", "shape 'box' reaches 1")],
)
def test_a_contour_that_a_method_refuses_is_named(box, method, says):
    with pytest.raises(FinloopError, match=says):
        morph_drawings(drawing(box=box), drawing(box=SQUARE), method, 3, points=64)


@pytest.mark.parametrize("output", ["out.gif", "out", "/dev/null/out.svg"])
def test_the_command_cannot_write_there(tmp_path, output, capsys):
    given = ["-o", output, "--frames", "2", "--points", "16", "--method", "linear"]
    assert main([*FACES, *given]) == 1
    assert output.removesuffix("/out.svg") in capsys.readouterr().err
    if not output.endswith(".svg"):  # said before the work
        assert main(["missing.svg", "missing.svg", *given]) == 1
        assert output in capsys.readouterr().err


@pytest.mark.parametrize(
    "wrong", [["--fps", "fast"], ["--fps", "1/0"], ["--method", "magic"], ["--frames", "x"]]
)
def test_the_command_refuses_what_it_does_not_know(tmp_path, wrong, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*FACES, "-o", str(tmp_path / "out.svg"), *wrong])
    assert stop.value.code == 2
    assert wrong[0] in capsys.readouterr().err
