"""Drawings that move by forces: laws of motion, what hangs together, the tool, and what is wrong."""

import re
import shlex
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scratch import save_svg

from finloop.base.drawing import Curve, Drawing
from finloop.base.errors import FinloopError
from finloop.io.svg import load_svg
from finloop.morph.force_list import (
    AttractionForce,
    FloorForce,
    GravityForce,
    HoldForce,
    WindForce,
    parse_force,
    parse_forces,
)
from finloop.morph.in_forces import move_drawing
from finloop.morph.layers import MOST_POINTS, PhysicalOptions, morph_drawings
from finloop.morph.pieces import find_pieces, mean_value_weights
from finloop.morph.tool import main

ROOT = Path(__file__).parents[1]
FACE = load_svg(ROOT / "data/drawings/face_a.svg")
FLAG = load_svg(ROOT / "data/drawings/flag.svg")
FREE = PhysicalOptions(elastic=2.0, damping=0.0, stiffness_damping=0.02)
CALM = PhysicalOptions(elastic=4.0, damping=4.0, stiffness_damping=0.02)


def move(drawing, forces, physics=FREE, frames=13, points=64, last=None):
    """A motion of 2 s, or of 6 s where the physics are calm."""
    rate = Fraction(frames - 1, 6 if physics is CALM else 2)
    forces = parse_forces(forces)
    return move_drawing(drawing, last or drawing, forces, frames, rate, points, physics=physics)


def middles(morph, names=None):
    """The mean of the points of the named contours in every frame."""
    return np.stack([morph.layers[name].mean(axis=1) for name in names or morph.layers]).mean(
        axis=0
    )


def mirror(drawing):
    """A drawing seen in a mirror; its width is that of the picture."""
    curves = {
        name: Curve([drawing.width, 0] + curve.points * [-1, 1], curve.closed)
        for name, curve in drawing.curves.items()
    }
    return replace(drawing, curves=curves)


# --- laws


def test_a_free_fall_is_half_g_t_squared_for_every_contour():
    morph = move(FACE, ["gravity=0.5"]).morph
    time = np.linspace(0, 2, 13)
    for stack in morph.layers.values():
        fall = stack - stack[0]
        np.testing.assert_allclose(fall[..., 0], 0, atol=2e-3)
        wanted = 0.5 * FACE.height * time**2 / 2
        np.testing.assert_allclose(
            fall[..., 1], np.broadcast_to(wanted[:, None], fall.shape[:2]), atol=2e-3
        )


def test_without_a_force_that_acts_a_drawing_rests():
    moved = move(FACE, ["gravity=0", "floor=390"])
    assert moved.rest_time == 0
    for stack in moved.morph.layers.values():
        np.testing.assert_allclose(stack, np.broadcast_to(stack[0], stack.shape), atol=2e-3)


def test_no_contour_goes_through_the_floor_and_the_drawing_comes_to_rest_on_it():
    moved = move(FACE, ["gravity=3", "floor=390"], CALM, frames=90)
    lowest = np.max([stack[..., 1].max(axis=1) for stack in moved.morph.layers.values()], axis=0)
    assert lowest.max() < 390.1 and lowest[-1] > 385
    assert moved.rest_time is not None and 1 < moved.rest_time < 5
    # The eyes stay in the face: they do not fall to the floor.
    assert middles(moved.morph, ["pupil_left", "pupil_right"])[-1, 1] < 300


def test_a_mirrored_drawing_moves_as_in_a_mirror():
    forces = ["gravity=2", "floor=390,friction=0.3"]
    one = move(FACE, [*forces, "wind=1,0,gust=0", "attraction=120,100"])
    other = move(mirror(FACE), [*forces, "wind=-1,0,gust=0", "attraction=280,100"])
    for name in ("outline", "pupil_left"):  # the mask is not symmetric to the last pixel
        seen = [FACE.width, 0] + one.morph.layers[name].mean(axis=1) * [-1, 1]
        np.testing.assert_allclose(other.morph.layers[name].mean(axis=1), seen, atol=1.0)


def test_attraction_to_a_point_ends_there():
    box = np.array([[10, 10], [50, 10], [50, 40], [10, 40.0]])
    drawing = Drawing({"box": Curve(box, True), "dot": Curve(box / 4 + 20, True)}, 100, 100)
    moved = move(drawing, ["attraction=60,70"], CALM, frames=60)
    np.testing.assert_allclose(middles(moved.morph, ["box"])[-1], [60, 70], atol=0.1)
    assert moved.rest_time is not None and moved.rest_time < 5


def test_wind_moves_a_drawing_to_where_attraction_holds_it():
    """Drag × wind is strength × offset: (2π)² strength, and drag 8 without another."""
    calm, windy = (
        move(FACE, ["attraction=200,200,strength=2", *wind], CALM)
        for wind in (["wind=0,0,drag=8"], ["wind=0.5,0,drag=8"])
    )
    shift = middles(windy.morph)[-1] - middles(calm.morph)[-1]
    np.testing.assert_allclose(
        shift, [8 * 0.5 * FACE.height / (2 * (2 * np.pi) ** 2), 0], rtol=0.01, atol=0.01
    )


def test_what_is_held_stays_and_what_holds_it_stands_still():
    physics = PhysicalOptions(elastic=1.0, damping=2.0, stiffness_damping=0.01)
    morph = move(FLAG, ["hold=pole", "wind=0.5,0,drag=2,gust=2,gust_length=0.6"], physics).morph
    assert (morph.layers["pole"] == morph.layers["pole"][0]).all()
    cloth = morph.layers["cloth"]
    travel = np.abs(cloth - cloth[0]).max(axis=(0, 2))
    at_pole, far = cloth[0, :, 0] < 58, cloth[0, :, 0] > 200
    assert travel[at_pole].max() < 4 and travel[far].min() > 5
    assert list(morph.layers) == list(FLAG.curves)  # the order of drawing


def test_two_drawings_become_each_other_while_forces_act():
    last = load_svg(ROOT / "data/drawings/face_b.svg")
    morph = move(FACE, ["gravity=2", "floor=390"], CALM, frames=90, last=last).morph
    plain = morph_drawings(FACE, last, "linear", 2, 64)
    for name, stack in morph.layers.items():
        np.testing.assert_allclose(stack[0], plain.layers[name][0], atol=2e-3)
    outline = morph.layers["outline"][-1]
    wanted = plain.layers["outline"][-1]
    off = (outline - outline.mean(axis=0)) - (wanted - wanted.mean(axis=0))
    assert np.abs(off).max() < 0.1 * FACE.height  # its weight flattens it a little
    assert (
        morph.styles["hair"][0] != morph.styles["hair"][-1]
        or FACE.styles["hair"] == last.styles["hair"]
    )


# --- pieces


def test_contours_that_touch_are_a_piece_and_others_fall_alone():
    box = np.array([[10, 10], [40, 10], [40, 40], [10, 40.0]])
    drawing = Drawing(
        {"left": Curve(box, True), "on_it": Curve(box + 8, True), "inside": Curve(box / 4 + 20, True),
         "right": Curve(box + [50, 20], True)}, 100, 100,
    )  # fmt: skip
    pieces = find_pieces(drawing)
    assert len(pieces.silhouettes) == 2
    assert pieces.piece_of["left"] == pieces.piece_of["on_it"] == pieces.piece_of["inside"]
    assert pieces.piece_of["right"] != pieces.piece_of["left"]
    morph = move(drawing, ["gravity=2", "floor=75"], CALM).morph
    assert morph.layers["right"][-1, :, 1].max() == pytest.approx(75, abs=0.5)
    assert morph.layers["on_it"][-1, :, 1].max() == pytest.approx(75, abs=0.5)
    assert morph.layers["left"][-1, :, 1].max() < 72


def test_mean_value_weights_keep_affine_motions_inside_outside_and_on_the_polygon():
    polygon = np.array([[0, 0], [4, 0], [4, 3], [2, 1], [0, 3.0]])
    points = np.array([[1, 1], [2, 0.5], [5, 5], [2, 0], [3, 2], [4, 3], [-1, 1.0]])
    weights = mean_value_weights(points, polygon)
    turn = np.array([[0.8, -0.6], [1.2, 0.4]])
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(weights @ polygon, points, atol=1e-6)
    np.testing.assert_allclose(weights @ (polygon @ turn + 3), points @ turn + 3, atol=1e-6)


# --- what a user writes


@pytest.mark.parametrize(
    ("text", "force"),
    [
        ("gravity=2", GravityForce(2.0)),
        ("gravity=-0.5", GravityForce(-0.5)),
        ("wind=1,-2", WindForce((1.0, -2.0))),
        ("wind=1,0,drag=0,gust=0.5,gust_length=2", WindForce((1.0, 0.0), 0.0, 0.5, 2.0)),
        ("attraction=20,30,strength=7", AttractionForce((20.0, 30.0), 7.0)),
        ("attraction=the sun", AttractionForce("the sun", 1.0)),
        ("floor=390", FloorForce(390.0)),
        ("floor=ground,friction=0", FloorForce("ground", 0.0)),
        ("hold=pole", HoldForce("pole")),
    ],
)
def test_forces_are_read_as_they_are_written(text, force):
    assert parse_force(text) == force


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("rain=1", "'rain' is none of gravity"),
        ("gravity", "no number of size"),
        ("gravity=nan", "no number of size"),
        ("wind=inf,0", "no number of size"),
        ("wind=1", "no value of wind"),
        ("wind=1,0,drag=-1", "drag is -1, not 0 or more"),
        ("wind=1,0,gust_length=0", "gust_length is 0, not above 0"),
        ("attraction=1", "no value of attraction"),
        ("attraction=1,2,strength=x", "'x' is no number of size"),
        ("floor=nan", "no number of size"),
        ("floor=390,friction=-1", "friction is -1"),
        ("hold=", "no value of hold"),
        ("gravity=1,drag=2", "'drag=2' is no option of gravity"),
    ],
)  # fmt: skip
def test_what_is_no_force_is_told(text, said):
    with pytest.raises(FinloopError, match=re.escape(said)) as refused:
        parse_force(text)
    assert "gravity=STRENGTH" in refused.value.wanted


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--force", "floor=300"], "a floor at y = 300 above the lower end of the drawing"),
        (["--force", "attraction=moon"], "a force names 'moon', which is no shape"),
        (["--force", "hold=pole"], "a force names 'pole'"),
        (["--force", "gravity=1", "--mass=-1"], "mass -1"),
        (["--force", "gravity=1", "--damping=-2"], "damping -2"),
        (["--force", "gravity=1", "--elastic", "nan"], "elastic nan"),
        (["--force", "gravity=1", "--fps", "0.01"], "a film of 400 s"),
        (["--force", "gravity=1", "--mass", "0", "--damping", "0"], "nothing resists"),
        (["--force", "gravity=1", "--points", "1000000"], "contours of 1000000 points"),
        (["--force", "gravity=1", "--points", "100"], "power of two"),
        (["--force", "gravity=1e6"], "forces that move the drawing to"),
        (["--force", "gravity=1e308"], "no number of size"),
        (["--force", "gravity=1", "--method", "linear"], "--force with --method linear"),
        (["--force", "gravity=1", "--back"], "--force with --back"),
        (["--force", "gravity=1", "--pairs", "p.yaml"], "one drawing and pairs (p.yaml)"),
        ([], "one drawing and no force"),
    ],
)  # fmt: skip
def test_the_command_tells_what_is_wrong_and_leaves_nothing(tmp_path, capsys, given, said):
    face = str(ROOT / "data/drawings/face_a.svg")
    assert (
        main([face, "-o", str(tmp_path / "o.svg"), "--frames", "5", "--points", "64", *given]) == 1
    )
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_drawings_of_other_pieces_and_shapes_that_hold_nothing_are_refused(tmp_path):
    box = np.array([[10, 10], [40, 10], [40, 40], [10, 40.0]])
    one, two = (
        Drawing({"a": Curve(box, True), "b": Curve(box + shift, True)}, 100, 100)
        for shift in (10, 50)
    )
    with pytest.raises(FinloopError, match="drawings of 1 and 2 pieces"):
        move(one, ["gravity=1"], last=two)
    with pytest.raises(FinloopError, match="nothing touches 'b'"):
        move(two, ["hold=b"])
    with pytest.raises(FinloopError, match="pins of 'a', and forces"):
        move(replace(two, pins={"a": box[:1]}), ["gravity=1"])
    with pytest.raises(FinloopError, match="every shape"):
        move(two, ["hold=b", "floor=a"])
    dust = {
        f"p{k}": Curve(np.array([[0, 0], [0.1, 0], [0, 0.1]]) + [k % 15, k // 15], True)
        for k in range(150)
    }
    with pytest.raises(FinloopError, match="150 separate pieces"):
        move(Drawing(dust, 15, 15), ["gravity=1"])
    with pytest.raises(FinloopError, match=f"{MOST_POINTS * 2} points"):
        move(one, ["gravity=1"], points=MOST_POINTS * 2)


def test_the_command_moves_any_drawing_and_says_when_it_rests(tmp_path, capsys):
    given = save_svg(
        tmp_path / "a.svg",
        '<path id="line" fill="none" stroke="#000" d="M9 9Q40 30 60 20"/><circle id="ball" cx="30" cy="50" r="9"/>',
    )
    out = tmp_path / "out.json"
    physics = ["--damping", "4", "--stiffness-damping", "0.05", "--fps", "10"]
    assert (
        main(
            [
                given,
                "-o",
                str(out),
                "--force",
                "gravity=2",
                "--force",
                "floor=90",
                *physics,
                "--points",
                "64",
            ]
        )
        == 0
    )
    assert re.search(
        r"2 contours, 60 frames, .*; at rest from [\d.]+ s on", capsys.readouterr().out
    )


PAGE = (ROOT / "docs/forces.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^\.venv/bin/python -m finloop\.morph (.*)$", PAGE, re.MULTILINE)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_of_the_page_work(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    words = shlex.split(command)
    words[words.index("-o") + 1] = str(tmp_path / "out.svg")
    assert main([*words, "--frames", "5"]) == 0, capsys.readouterr().err
    assert len(COMMANDS) >= 4
