"""Morphs as files: what other readers and players make of them; painting; whole or not at all."""

import json
import re
from dataclasses import replace
from fractions import Fraction
from itertools import product
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
from finloop.base.drawing import Curve, Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import Shape, group_contours, paint_layers
from finloop.base.style import Gradient, Paint, Stop, mix_paints
from finloop.curve.contour import nearest_on_curve
from finloop.io.animation import ENDINGS, save_animation
from finloop.io.svg import load_svg

RATE = Fraction(20)
SVG = "{http://www.w3.org/2000/svg}"
FRAMES = 9
NASTY = 'b<r&"ow'
RED = Paint((255, 0, 0), None, 1, 1, 1)
BLUE_LINE = Paint(None, (0, 0, 255), 1, 1, 4)


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
        styles={"ring": (RED,) * frames, NASTY: (BLUE_LINE,) * frames},
        width=width, height=height, decimals=3,
    )  # fmt: skip


def expected_picture(morph, frame, scale=1.0):
    what = group_contours(morph.closed, morph.paints_at(frame), max(morph.width, morph.height))
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
    assert drawing.styles["ring"].fill == drawing.styles["ring#2"].fill == (255, 0, 0)
    assert drawing.styles["ring"].stroke is None
    line = drawing.styles[NASTY]
    assert line == replace(BLUE_LINE, width=pytest.approx(4))


def painted_morph():
    """The ring's fill changes from a line of colours to circles of them, the line's dashes open."""
    stops = (Stop(0, (255, 240, 0), 1), Stop(0.6, (255, 0, 90), 1), Stop(1, (0, 40, 255), 0.4))
    line = Gradient("linear", stops, (20, 10, -30, 25, 20, 40), spread="reflect")
    others = (Stop(0, (0, 40, 255), 0.4), Stop(0.5, (255, 240, 0), 1), Stop(1, (255, 0, 90), 1))
    circles = Gradient("radial", others, (18, 4, -3, 9, 92, 48), (0.4, -0.2))
    ends = Paint(line, (0, 90, 0), 1, 0.5, 3), Paint(circles, (90, 0, 90), 0.9, 1, 1)
    dashed = replace(BLUE_LINE, stroke=replace(line, kind="linear"), dashes=(9, 5), dash_offset=3)
    shares = np.linspace(0, 1, FRAMES)
    styles = {
        "ring": tuple(mix_paints(*ends, share) for share in shares),
        NASTY: tuple(mix_paints(BLUE_LINE, dashed, share) for share in shares),
    }
    return replace(a_morph(), styles=styles)


def test_svg_plays_in_a_browser(tmp_path):
    kinds = [(1, ".svg"), (6, ".svg"), (6, ".css.svg")]
    with chromium() as browser:
        for morph, (frame, ending) in product((a_morph(), painted_morph()), kinds):
            svg = save_morph(tmp_path, ending, morph).read_text()
            moves = "<animate" in svg, "@keyframes" in svg
            assert moves == (ending == ".svg", ending == ".css.svg")
            seek = (
                's = document.querySelector("svg"); s.pauseAnimations(); '
                f"s.setCurrentTime({frame} / {RATE}); for (a of document.getAnimations()) "
                f"{{a.pause(); a.currentTime = 1000 * {frame} / {RATE} + 0.1}}"
            )
            page = f'<body style="margin:0">{svg}<script>{seek}</script>'
            (tmp_path / "page.html").write_text(page)
            picture = visit(browser, tmp_path / "page.html").page.screenshot()
            coded = np.frombuffer(picture, np.uint8)
            shot = cv2.imdecode(coded, cv2.IMREAD_COLOR)[:80, :120, ::-1].astype(int)
            assert np.abs(shot - expected_picture(morph, frame)).mean() < 1
            assert np.abs(shot - expected_picture(morph, 8)).mean() > 5


@pytest.mark.parametrize("frame", [0, 3, 8])
def test_gradients_and_dashes_come_in_again_as_they_went_out(tmp_path, frame):
    morph = painted_morph().take_frames(np.array([frame]))
    drawing = load_svg(save_morph(tmp_path, ".svg", morph))
    again = replace(morph, styles={name: (paint,) for name, paint in drawing.styles.items()})
    assert np.abs(expected_picture(again, 0) - expected_picture(morph, 0)).max() <= 2


# --- Lottie


@pytest.mark.parametrize("make_morph", [a_morph, painted_morph])
def test_lottie_is_drawn_alike_by_another_player(tmp_path, make_morph):
    morph = make_morph()
    path = save_morph(tmp_path, ".lottie.json", morph)
    player = LottieAnimation.from_file(str(path))
    assert player.lottie_animation_get_size() == (120, 80)
    assert player.lottie_animation_get_framerate() == RATE
    for frame in range(FRAMES):
        shown = np.array(player.render_pillow_frame(frame_num=frame)).astype(float)
        share = shown[..., 3:] / 255
        on_white = shown[..., :3] * share + 255 * (1 - share)
        # rlottie draws radial gradients along circles, and measures dashes to 7 % (its VLine::length).
        least = 1 if make_morph is a_morph else 6
        assert np.abs(on_white - expected_picture(morph, frame)).mean() < least
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
        assert [key["t"] for key in keys] == [0, FRAMES - 1]  # all points move evenly
        assert "i" not in keys[-1]
        for key, points in zip(keys, morph.layers[name][[0, -1]], strict=True):
            (value,) = key["s"]
            assert value["c"] == morph.closed[name]
            assert len(value["i"]) == len(value["o"]) == len(value["v"]) <= len(points)
            assert not np.any(value["i"])
            assert_same_line(value["v"], points, 0.12)  # 1/1000 of 120 px
    line = next(layer for layer in items.values() if layer["nm"] == NASTY)
    assert len(line["ks"]["k"][0]["s"][0]["v"]) < 16  # a straight line needs no points within


def assert_same_line(points, whole, most):
    """Every point of `whole` (n, 2) is at most so far from the closed or open line of `points`."""
    _, gaps = nearest_on_curve(np.asarray(whole), Curve(np.asarray(points, float), len(points) > 2))
    assert np.hypot(*gaps.T).max() <= most


def test_lottie_keeps_the_frames_and_points_that_it_needs(tmp_path):
    """Between keyframes and points, what a player shows is off by 1/1000 of the side at most."""
    tau = np.linspace(0, 1, 61)
    shake = 10 * np.sin(4 * tau)[:, None, None] * [1, 0]
    wobble = np.stack([ring(60, 40, 20 + 12 * np.sin(3 * t), 200) for t in tau]) + shake
    dot = np.repeat(ring(5, 5, 1e-4, 200)[None], 61, axis=0)
    base = a_morph(61)
    morph = replace(
        base, layers={"ring": wobble, "dot": dot}, closed={"ring": True, "dot": True},
        styles={"ring": tuple(replace(RED, fill=(round(255 * t), 0, 0)) for t in tau)}, decimals=6,
    )  # fmt: skip
    path = save_morph(tmp_path, ".lottie.json", morph)
    layers = {
        layer["nm"]: layer["shapes"][0]["it"] for layer in json.loads(path.read_text())["layers"]
    }
    assert len(layers["dot"][0]["ks"]["k"][0]["s"][0]["v"]) == 3
    keys = layers["ring"][0]["ks"]["k"]
    times, shapes = [key["t"] for key in keys], np.array([key["s"][0]["v"] for key in keys])
    assert len(times) < 30 and shapes.shape[1] < 150 and path.stat().st_size < 90_000
    for frame in range(61):
        x, y = (
            [np.interp(frame, times, shapes[:, k, axis]) for k in range(shapes.shape[1])]
            for axis in (0, 1)
        )
        assert_same_line(np.stack([x, y], axis=1), wobble[frame], 1.1 * 0.12)
    (fill,) = (item for item in layers["ring"] if item["ty"] == "fl")
    assert [key["t"] for key in fill["c"]["k"]] == [0, 60]  # evenly, but for whole levels


def lottie_items(tmp_path, paints):
    """The items that paint a ring in a Lottie file, by type; paints: of its first and last frame."""
    shares = np.linspace(0, 1, FRAMES)
    morph = replace(
        a_morph(), styles={"ring": tuple(mix_paints(*paints, share) for share in shares)}
    )
    told = json.loads(save_morph(tmp_path, ".lottie.json", morph).read_text())
    ring_layer = next(layer for layer in told["layers"] if layer["nm"] == "ring")
    return [
        item for item in ring_layer["shapes"][0]["it"] if item["ty"] in ("st", "gs", "fl", "gf")
    ]


def test_the_focus_of_a_rotated_gradient_in_lottie(tmp_path):
    stops = (Stop(0, (255, 0, 0), 1), Stop(1, (0, 0, 255), 1))
    turned = Gradient("radial", stops, (0, 10, -10, 0, 50, 40), focus=(0.5, 0))  # down the page
    (item,) = lottie_items(tmp_path, [Paint(turned, None, 1, 1, 1)] * 2)
    assert (item["h"]["k"], item["a"]["k"]) == (pytest.approx(50), pytest.approx(90))


def test_ends_of_dashes_change_in_lottie(tmp_path):
    """A player takes the ends from the first frame, so each kind of them is a stroke of its own."""
    straight = replace(RED, stroke=(0, 0, 0), dashes=(6, 3))
    items = lottie_items(tmp_path, (straight, replace(straight, round_dashes=True)))
    strokes = [item for item in items if item["ty"] == "st"]
    assert [item["lc"] for item in strokes] == [1, 2]
    first, last = ([key["s"] for key in item["o"]["k"]] for item in strokes)
    assert (first[0], last[0]) == ([100], [0]) and (first[-1], last[-1]) == ([0], [100])


def test_frames_may_have_more_dashes_than_others(tmp_path):
    """Players interpolate lists of one length: gaps along two cuts, then one around a lost hole."""
    line = replace(RED, stroke=(0, 0, 0), round_dashes=True)
    dashes = [(6, 3, 5, 2), (6, 3), *[()] * (FRAMES - 2)]
    styles = {"ring": tuple(replace(line, dashes=lengths) for lengths in dashes)}
    morph = replace(a_morph(), styles=styles)
    told = json.loads(save_morph(tmp_path, ".lottie.json", morph).read_text())
    (ring_layer,) = (layer for layer in told["layers"] if layer["nm"] == "ring")
    (stroke,) = (item for item in ring_layer["shapes"][0]["it"] if item["ty"] == "st")
    keys = [part["v"]["k"] for part in stroke["d"][:4]]
    shown = [
        [np.interp(frame, [k["t"] for k in key], [k["s"][0] for k in key]) for key in keys]
        for frame in range(3)
    ]
    assert shown == [[6, 3, 5, 2], [6, 3, 6, 3], [9, 0, 7, 0]]
    svg = save_morph(tmp_path, ".svg", morph).read_text()
    assert 'values="6000 3000 5000 2000;6000 3000 6000 3000;9000 0 7000 0;' in svg  # 1/1000 px


def test_what_lottie_cannot_show_is_named(tmp_path):
    stops = (Stop(0, (255, 0, 0), 1), Stop(1, (0, 0, 255), 1))
    mirrored = Gradient("linear", stops, (9, 0, 0, 9, 0, 0), spread="reflect")
    flat = Gradient("radial", stops, (9, 0, 0, 3, 50, 40))
    morph = replace(a_morph(), styles={"ring": (Paint(mirrored, flat, 1, 1, 1),) * FRAMES})
    lost = save_animation(tmp_path / "a.lottie.json", morph, Fraction(30))
    assert "gradients that repeat or reflect end (ring)" in lost
    assert "gradients along ellipses are circles (ring)" in lost
    assert not save_animation(tmp_path / "a.svg", morph, Fraction(30))
    assert not save_animation(tmp_path / "a.lottie.json", a_morph(), Fraction(30))


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
            np.testing.assert_array_equal(shown, expected_picture(morph, frame, 2))


def test_webp_follows_colours_that_change_slowly(tmp_path):
    """By three levels a frame, which a coder of differences leaves out."""
    frames = 60
    paints = [mix_paints(RED, replace(RED, fill=(120, 60, 0)), k / 59) for k in range(frames)]
    square = np.array([[0, 0], [120, 0], [120, 80], [0, 80.0]])
    morph = replace(
        a_morph(frames), layers={"ring": np.stack([square] * frames)}, closed={"ring": True},
        styles={"ring": tuple(paints)},
    )  # fmt: skip
    with Image.open(save_morph(tmp_path, ".webp", morph, longer_side_px=120)) as film:
        for frame in (20, 40, 59):
            film.seek(frame)
            shown = np.array(film.convert("RGB"))[20:60, 20:100].reshape(-1, 3)
            assert (shown == paints[frame].fill).all()


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


@pytest.mark.parametrize(("round_dashes", "more"), [(False, 0.0), (True, 4 * np.pi * 9)])
def test_dashes_have_their_length_and_straight_or_round_ends(round_dashes, more):
    line = np.array([[4.0, 30], [60, 30]])
    how = Paint(None, (0, 0, 0), 1, 1, 6, dashes=(8, 7), dash_offset=0, round_dashes=round_dashes)
    assert ink([line], how, closed=False) == pytest.approx(4 * 8 * 6 + more, rel=0.05)
    row = picture([line], how, closed=False)[30, :, 0]
    for start in (4, 19, 34, 49):
        assert (row[start + 1 : start + 7] == 0).all()
        if not round_dashes:
            assert (row[start + 9 : start + 14] == 255).all()
    shifted = picture([line], replace(how, dash_offset=5), closed=False)[30, :, 0]
    np.testing.assert_array_equal(shifted[8:50], row[13:55])
    turned = ring(32, 32, 20), replace(how, dashes=(5, 5), width=2, round_dashes=False)
    assert ink([turned[0]], turned[1]) == pytest.approx(13 * 5 * 2, rel=0.1)


def test_dashes_too_short_or_too_many_are_a_paler_line():
    line = np.array([[4.0, 30], [60, 30]])
    how = Paint(None, (0, 0, 0), 1, 1, 6)
    whole = ink([line], how, closed=False)
    for dashes in ((0.01, 0.03), (1e-9, 3e-9)):
        pale = ink([line], replace(how, dashes=dashes), closed=False)
        assert pale == pytest.approx(whole / 4, rel=0.01)
    far = np.array([[-2e6, 30], [2e6, 30]])
    assert ink([far], replace(how, dashes=(1, 1)), closed=False) == pytest.approx(
        64 * 6 / 2, rel=0.05
    )


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_gradient_colours_pixels_by_their_middles(scale):
    stops = (Stop(0, (0, 0, 0), 1), Stop(1, (250, 100, 0), 1))
    fill = Gradient("linear", stops, (50, 0, 0, 50, 5, 0))
    square = np.array([[0, 0], [64, 0], [64, 64], [0, 64.0]]) / scale
    row = picture([square], Paint(fill, None, 1, 1, 1), scale=scale)[9]
    share = np.clip(((np.arange(64) + 0.5) / scale - 5) / 50, 0, 1)
    np.testing.assert_allclose(row, share[:, None] * [250, 100, 0], atol=0.51)


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


def test_a_shape_that_nothing_paints_is_a_black_line():
    nothing = Paint(None, None, 1, 1, 1)
    for styles in ({}, {"a": nothing}):
        (shape,) = group_contours({"a": True, "a#2": True}, styles, 400)
        assert shape == Shape("a", ("a", "a#2"), (True, True), Paint(None, (0, 0, 0), 1, 1, 2))


# --- endings, whole or not at all


@pytest.mark.parametrize(
    "name", ["out.gif", "out", ".svg", ".spine.json", "out.svg.txt", "out.lottie"]
)
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
    beside = {".png", ".atlas"}  # what Spine needs beside its JSON
    assert [file for file in tmp_path.iterdir() if file.suffix not in beside] == [path]
