"""Morphs as files: what other readers and players make of them; painting; whole or not at all."""

import json
import re
from dataclasses import replace
from fractions import Fraction
from xml.etree import ElementTree

import av
import cv2
import numpy as np
import pytest
from browser import chromium, visit
from fontTools.pens.recordingPen import RecordingPen
from fontTools.svgLib.path import parse_path
from PIL import Image
from rlottie_python import LottieAnimation

import finloop.io.animation
from finloop.base.drawing import Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import Paint, Shape, group_contours, paint_layers, parse_style
from finloop.io.animation import ENDINGS, save_animation
from finloop.io.svg import load_svg

RATE = Fraction(20)
SVG = "{http://www.w3.org/2000/svg}"
FRAMES = 9
NASTY = 'b<r&"ow'


def ring(x, y, radius, n=48):
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return np.stack([x + radius * np.cos(t), y + radius * np.sin(t)], axis=1)


def a_morph(frames=FRAMES, width=120, height=80):
    """A red ring with a hole moves right, a blue line above it turns."""
    tau = np.linspace(0, 1, frames)
    along = np.linspace(-1, 1, 16)
    layers = {
        "ring": np.stack([ring(30 + 60 * t, 50, 20) for t in tau]),
        "ring#2": np.stack([ring(30 + 60 * t, 50, 10, 30) for t in tau]),
        NASTY: np.stack([[60, 15] + np.outer(along, [40, 12 * t]) for t in tau]),
    }
    return Morph(
        tau=tau,
        layers={name: np.round(stack, 3) for name, stack in layers.items()},
        closed={"ring": True, "ring#2": True, NASTY: False},
        folds={name: np.zeros(frames, np.int64) for name in layers},
        continuous=dict.fromkeys(layers, True),
        styles={"ring": "fill:#ff0000;stroke:none", NASTY: "fill:none;stroke:blue;stroke-width:4"},
        width=width, height=height, decimals=3,
    )  # fmt: skip


def expected_picture(morph, frame, scale=1.0):
    what = group_contours(morph.closed, morph.styles, max(morph.width, morph.height))
    drawn = [(one, [morph.layers[name][frame] for name in one.layers]) for one in what]
    size = round(morph.height * scale), round(morph.width * scale)
    return paint_layers(drawn, size, scale).astype(int)


def save_morph(tmp_path, ending, morph=None, **kinds):
    path = tmp_path / f"morph{ending}"
    save_animation(path, morph or a_morph(), RATE, **kinds)
    return path


# --- plain JSON


def test_plain_json_comes_back_to_the_last_digit(tmp_path):
    morph = a_morph()
    frames = json.loads(save_morph(tmp_path, ".json").read_text())
    assert list(frames) == ["frames"]
    assert [set(frame) for frame in frames["frames"]] == [{"tau", "layers"}] * FRAMES
    np.testing.assert_array_equal([frame["tau"] for frame in frames["frames"]], morph.tau)
    assert list(frames["frames"][0]["layers"]) == list(morph.layers)
    for name, stack in morph.layers.items():
        np.testing.assert_array_equal([f["layers"][name] for f in frames["frames"]], stack)


# --- SVG


def contours(d):
    """The contours of a path and whether each is closed, by another reader."""
    pen = RecordingPen()
    parse_path(d, pen)
    found, closed = [], []
    for command, nodes in pen.value:
        if command == "moveTo":
            found.append([nodes[0]])
        elif command == "lineTo":
            found[-1].append(nodes[0])
        else:
            closed.append(command == "closePath")
    return found, closed


def test_svg_holds_every_frame_to_the_last_digit(tmp_path):
    morph = a_morph()
    root = ElementTree.parse(save_morph(tmp_path, ".svg")).getroot()
    size = [root.get(name) for name in ("width", "height", "viewBox")]
    assert size == ["120", "80", "0 0 120 80"]
    (group,) = root
    assert group.get("transform") == "scale(0.001)"
    assert [path.get("id") for path in group] == ["ring", NASTY]
    for path, names in zip(group, [["ring", "ring#2"], [NASTY]], strict=True):
        (animate,) = path
        assert animate.get("attributeName") == "d"
        assert animate.get("dur") == "0.45s"  # 9 frames of 1/20 s
        values = animate.get("values").split(";")
        assert len(values) == FRAMES + 1
        assert values[0] == path.get("d")
        assert values.pop() == values[-1]  # the last stays for its time
        # A player moves points between values only where these have the same commands.
        assert len({re.sub(r"[-\d ]+", " ", value) for value in values}) == 1
        for frame, value in enumerate(values):
            found, closed = contours(value)
            assert closed == [morph.closed[name] for name in names]
            for name, points in zip(names, found, strict=True):
                stack = morph.layers[name][frame] * 1000
                points = points[: len(stack)]  # that reader closes with a line
                np.testing.assert_allclose(points, stack, atol=1e-6)


@pytest.mark.parametrize("decimals", [-2, 0, 3, 8])
def test_svg_on_any_grid_comes_in_again_with_its_styles(tmp_path, decimals):
    morph = a_morph()
    step = 10.0**-decimals
    layers = {name: np.round(stack) * step for name, stack in morph.layers.items()}
    size = {"width": 120 * step, "height": 80 * step}
    on_grid = replace(morph, layers=layers, decimals=decimals, **size)
    drawing = load_svg(save_morph(tmp_path, ".svg", on_grid))
    assert (drawing.width, drawing.height) == pytest.approx((120 * step, 80 * step))
    for name, curve in drawing.curves.items():
        np.testing.assert_allclose(curve.points / step, np.round(morph.layers[name][0]), atol=1e-6)
        assert curve.closed == morph.closed[name]
    assert drawing.styles["ring"] == drawing.styles["ring#2"] == "fill:#ff0000;stroke:none"
    line = parse_style(drawing.styles[NASTY], 120)
    assert line == Paint(None, (0, 0, 255), 1, 1, pytest.approx(4))


def test_svg_plays_in_a_browser(tmp_path):
    morph, frame = a_morph(), 6
    svg = save_morph(tmp_path, ".svg").read_text()
    seek = f"s.pauseAnimations(); s.setCurrentTime({frame} / {RATE})"
    script = f'<script>s = document.querySelector("svg"); {seek}</script>'
    (tmp_path / "page.html").write_text(f'<body style="margin:0">{svg}{script}')
    with chromium() as browser:
        picture = visit(browser, tmp_path / "page.html").page.screenshot()
    shot = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)[:80, :120, ::-1].astype(
        int
    )
    assert np.abs(shot - expected_picture(morph, frame)).mean() < 1
    assert np.abs(shot - expected_picture(morph, 0)).mean() > 10


# --- Lottie


def test_lottie_is_drawn_alike_by_another_player(tmp_path):
    morph = a_morph()
    path = save_morph(tmp_path, ".lottie.json")
    player = LottieAnimation.from_file(str(path))
    assert player.lottie_animation_get_size() == (120, 80)
    assert player.lottie_animation_get_framerate() == RATE
    for frame in range(FRAMES):
        shown = np.array(player.render_pillow_frame(frame_num=frame)).astype(float)
        share = shown[..., 3:] / 255
        on_white = shown[..., :3] * share + 255 * (1 - share)
        assert np.abs(on_white - expected_picture(morph, frame)).mean() < 1
    assert np.abs(on_white - expected_picture(morph, 0)).mean() > 10


def test_lottie_keeps_layers_and_vertices(tmp_path):
    morph = a_morph()
    told = json.loads(save_morph(tmp_path, ".lottie.json").read_text())
    assert (told["ip"], told["op"], told["fr"]) == (0, FRAMES, 20)
    assert [layer["nm"] for layer in told["layers"]] == [NASTY, "ring"]  # the topmost first
    assert all((layer["ip"], layer["op"]) == (0, FRAMES) for layer in told["layers"])
    shapes = [shape for layer in told["layers"] for shape in layer["shapes"][0]["it"]]
    items = {shape["nm"]: shape for shape in shapes if shape["ty"] == "sh"}
    assert items.keys() == morph.layers.keys()
    for name, item in items.items():
        keys = item["ks"]["k"]
        assert [key["t"] for key in keys] == list(range(FRAMES))
        assert "i" not in keys[-1]
        for key, points in zip(keys, morph.layers[name], strict=True):
            (value,) = key["s"]
            assert value["c"] == morph.closed[name]
            assert len(value["i"]) == len(value["o"]) == len(points)
            assert not np.any(value["i"])
            np.testing.assert_array_equal(value["v"], points)


# --- films


def test_webp(tmp_path):
    morph = a_morph()
    with Image.open(save_morph(tmp_path, ".webp", longer_side_px=240)) as film:
        assert film.n_frames == FRAMES
        for frame in range(FRAMES):
            film.seek(frame)
            shown = np.array(film.convert("RGB"))
            assert film.info["duration"] == 50
            assert shown.shape == (160, 240, 3)
            assert np.abs(shown - expected_picture(morph, frame, 2)).mean() < 4


def test_mp4_of_an_odd_size(tmp_path):
    morph = a_morph(width=121, height=81)
    with av.open(save_morph(tmp_path, ".mp4", morph, longer_side_px=243)) as film:
        stream = film.streams.video[0]
        assert stream.average_rate == RATE
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
    assert len(shown) == FRAMES
    assert shown[0].shape == (162, 244, 3)
    assert np.abs(shown[4][:, :242] - expected_picture(morph, 4, 243 / 121)[:162, :242]).mean() < 4


# --- painting

BLACK = Paint((0, 0, 0), None, 1, 1, 1)


def picture(contours, how=BLACK, size=(64, 64), scale=1.0, closed=True):
    names = tuple(str(k) for k in range(len(contours)))
    shape = Shape("a", names, (closed,) * len(contours), how)
    return paint_layers([(shape, contours)], size, scale)


def ink(contours, *arguments, **kinds):
    return float((255 - picture(contours, *arguments, **kinds)[..., 0].astype(float)).sum() / 255)


def test_as_much_ink_as_area():
    assert ink([ring(30.3, 31.7, 20)]) == pytest.approx(np.pi * 400, rel=0.01)
    assert ink([ring(30.3, 31.7, 20), ring(31, 31, 8)]) == pytest.approx(np.pi * 336, rel=0.01)
    assert ink([ring(15.1, 15.9, 10)], scale=2) == pytest.approx(np.pi * 400, rel=0.01)
    square = np.array([[10, 10], [20, 10], [20, 20], [10, 20.0]])
    assert (picture([square])[11:19, 11:19] == 0).all()
    assert (picture([square])[[9, 21], 11:19] == 255).all()


def test_as_much_ink_as_length_times_width():
    line = np.array([[10.0, 30], [50, 30]])
    how = Paint(None, (0, 0, 0), 1, 1, 6)
    assert ink([line], how, closed=False) == pytest.approx(40 * 6 + np.pi * 9, rel=0.04)
    assert ink([ring(32, 32, 20)], how) == pytest.approx(2 * np.pi * 20 * 6, rel=0.04)


def test_a_shift_by_whole_pixels_shifts_the_picture():
    one, other = (picture([ring(30 + s, 31 - s, 15.5)]) for s in (0, 3))
    np.testing.assert_array_equal(np.roll(one, (-3, 3), axis=(0, 1)), other)


def test_later_shapes_cover_earlier_ones_and_opacity_lets_through():
    red, green = Paint((255, 0, 0), None, 1, 1, 1), Paint((0, 255, 0), None, 0.5, 1, 1)
    both = [(Shape("a", ("a",), (True,), how), [ring(32, 32, 20)]) for how in (red, green)]
    assert paint_layers(both, (64, 64), 1)[32, 32].tolist() == [128, 128, 0]
    assert paint_layers(both[::-1], (64, 64), 1)[32, 32].tolist() == [255, 0, 0]


def test_what_lies_outside_is_cut_off():
    assert ink([ring(-100, 30, 20)]) == 0
    assert ink([ring(0, 32, 20)]) == pytest.approx(np.pi * 200, rel=0.02)
    assert (picture([ring(32, 32, 500)]) == 0).all()
    far = 1000 * 2048.0  # as far off as a morph may reach, in the largest film
    assert ink([np.array([[far, 10], [far, 50], [far - 9, 50]])]) == 0
    assert ink([np.array([[-far, -far], [far, -far], [0, far]])]) == 64 * 64


def test_styles():
    assert parse_style("", 400) == Paint(None, (0, 0, 0), 1, 1, 2)
    assert parse_style("fill:none", 400).stroke == (0, 0, 0)  # never nothing at all
    assert parse_style(" fill : red ; stroke-width:3; fill-opacity:.5", 4) == Paint(
        (255, 0, 0), None, 0.5, 1, 3
    )
    for bad in ("fill:reddish", "fill:red;stroke-width:wide"):
        with pytest.raises(FinloopError, match="cannot be read"):
            parse_style(bad, 1)


# --- endings, whole or not at all


@pytest.mark.parametrize("name", ["out.gif", "out", ".svg", "out.svg.txt", "out.lottie"])
def test_an_unknown_ending_is_named(tmp_path, name):
    with pytest.raises(FinloopError, match=re.escape(name)) as error:
        save_animation(tmp_path / name, a_morph(), RATE)
    assert all(ending in error.value.wanted for ending in ENDINGS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("rate", "size"), [(Fraction(0), 64), (Fraction(-3), 64), (Fraction(10**6), 64), (RATE, 0), (RATE, 10**6)]
)  # fmt: skip
def test_impossible_numbers(tmp_path, rate, size):
    with pytest.raises(FinloopError):
        save_animation(tmp_path / "out.mp4", a_morph(), rate, size)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("ending", list(ENDINGS))
def test_the_same_bytes_again_or_none(tmp_path, ending, monkeypatch):
    path = save_morph(tmp_path, ending, longer_side_px=64)
    before, calls = path.read_bytes(), []
    again = save_morph(tmp_path, ending.upper(), longer_side_px=64)  # an ending in capitals
    assert again.read_bytes() == before
    again.unlink()

    def fails(*arguments, **kinds):
        calls.append(1)
        if len(calls) > 3:
            raise RuntimeError("half way")
        return paint_layers(*arguments, **kinds)

    monkeypatch.setattr(finloop.io.animation, "paint_layers", fails)
    monkeypatch.setattr("pathlib.Path.write_bytes", lambda *a, **k: 1 / 0)
    with pytest.raises((RuntimeError, ZeroDivisionError)):
        save_animation(path, a_morph(), RATE, 64)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
