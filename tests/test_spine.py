"""Morphs as Spine JSON: what a player makes of it is the morph, covered by triangles."""

import json
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from PIL import Image

from finloop.base.drawing import Drawing, Morph
from finloop.base.style import Gradient, Paint, Stop
from finloop.curve.contour import Curve
from finloop.curve.glyph import glyph_outlines
from finloop.io.animation import save_animation
from finloop.morph.layers import morph_drawings
from finloop.morph.pairs import Pairing, pair_drawings
from finloop.morph.simple import morph_regions_without_folds

RATE = Fraction(20)
FRAMES, N = 7, 64
RED = Paint((255, 0, 0), None, 1, 1, 1)
BLUE_LINE = Paint(None, (0, 0, 255), 1, 1, 4)
SHADED = Gradient(
    "linear", (Stop(0, (0, 0, 0), 1), Stop(1, (200, 100, 0), 1)), (50, 0, 0, 50, 0, 0)
)


def a_morph():
    """The letter d becomes an o, a bar turns and grows, a line bends; 100 × 80 px."""
    d, o = ([Curve(c.points / 25 + [20, 0], True) for c in glyph_outlines(name)] for name in "do")
    region = morph_regions_without_folds(d, o, FRAMES, N)
    tau = np.linspace(0, 1, FRAMES)
    bar = np.array([[-8, -2], [8, -2], [8, 2], [-8, 2]]) @ [1, 1j]
    turned = [70 + 20j + 9 * t + (1 + t) * np.exp(3j * t) * bar for t in tau]
    along = np.linspace(0, 1, N)
    layers = {
        "d": region[0], "d#2": region[1],
        "bar": np.stack([np.real(turned), np.imag(turned)], -1),
        "line": np.stack([np.stack([60 + 30 * along, 60 + 9 * t * along * (1 - along)], 1) for t in tau]),
    }  # fmt: skip
    fades = tuple(replace(RED, fill=(255, 0, round(255 * t)), fill_opacity=1 - t) for t in tau)
    return Morph(
        tau=tau, layers={name: np.round(stack, 3) for name, stack in layers.items()},
        closed={name: name != "line" for name in layers},
        folds={name: np.zeros(FRAMES, np.int64) for name in layers},
        continuous=dict.fromkeys(layers, True),
        styles={"d": fades, "bar": (RED,) * FRAMES, "line": (BLUE_LINE,) * FRAMES},
        width=100, height=80, decimals=3,
    )  # fmt: skip


def save(tmp_path, morph):
    path = tmp_path / "morph.spine.json"
    return path, save_animation(path, morph, RATE)


def value_at(keys, time, field, usual):
    """A timeline's value at the time of a key: a missing value is the usual one."""
    (found,) = [key for key in keys if abs(key["time"] - time) < 1e-5] or [{}]
    return np.asarray(found.get(field, usual), float)


def pose(content, slot, frame):
    """The mesh that a player shows in a slot at a frame: vertices (n, 2), y down, and triangles."""
    time = frame / 20
    (animation,) = content["animations"].values()
    lines = animation["slots"].get(slot["name"], {})
    name = slot["attachment"]
    for key in lines.get("attachment", []):
        name = key["name"] if key["time"] <= time + 1e-5 else name
    mesh = content["skins"][0]["attachments"][slot["name"]][name]
    deforms = animation["attachments"]["default"].get(slot["name"], {}).get(name, {})
    vertices = np.reshape(mesh["vertices"], (-1, 2))
    vertices = vertices + value_at(
        deforms.get("deform", []), time, "vertices", np.zeros(vertices.size)
    ).reshape(-1, 2)
    (bone,) = [bone for bone in content["bones"] if bone["name"] == slot["bone"]]
    moves = animation["bones"].get(bone["name"], {})
    angle, scale = (value_at(moves.get(key, []), time, field, usual)
                    for key, field, usual in (("rotate", "value", 0), ("scale", "x", 1)))  # fmt: skip
    place = [
        bone.get(axis, 0) + value_at(moves.get("translate", []), time, axis, 0) for axis in "xy"
    ]
    z = scale * np.exp(1j * np.radians(angle)) * (vertices @ [1, 1j]) + place @ np.array([1, 1j])
    return np.stack([z.real, content["skeleton"]["height"] - z.imag], 1), np.reshape(
        mesh["triangles"], (-1, 3)
    )


def areas(points, triangles):
    u, w = (
        points[triangles[:, 1]] - points[triangles[:, 0]],
        points[triangles[:, 2]] - points[triangles[:, 0]],
    )
    return -(u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / 2  # y down


def polygon_area(points):
    x, y = points.T
    return abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def check_format(content):
    """What the documentation of the format asks for."""
    assert re.fullmatch(r"4\.2\.\d+", content["skeleton"]["spine"])
    bones, slots = ([item["name"] for item in content[key]] for key in ("bones", "slots"))
    assert bones[0] == "root" and len({*bones}) == len(bones) and len({*slots}) == len(slots)
    assert all(bone["parent"] == "root" for bone in content["bones"][1:])
    (skin,) = content["skins"]
    assert skin["name"] == "default" and [*skin["attachments"]] == slots
    for slot in content["slots"]:
        assert slot["bone"] in bones and re.fullmatch("[0-9a-f]{8}", slot["color"])
        meshes = skin["attachments"][slot["name"]]
        assert slot["attachment"] in meshes
        for mesh in meshes.values():
            count = len(mesh["vertices"]) // 2
            assert mesh["type"] == "mesh" and len(mesh["uvs"]) == 2 * count
            assert 0 <= min(mesh["uvs"]) <= max(mesh["uvs"]) <= 1
            assert 0 <= min(mesh["triangles"]) <= max(mesh["triangles"]) < count
            assert 3 <= mesh["hull"] <= count
    (animation,) = content["animations"].values()
    assert set(animation) == {"slots", "bones", "attachments"}
    assert {*animation["slots"], *animation["attachments"]["default"]} <= {*slots}
    assert {*animation["bones"]} <= {*bones}
    for kind in ("slots", "bones"):
        for lines in animation[kind].values():
            for keys in lines.values():
                assert (np.diff([key["time"] for key in keys]) > 0).all()
    for name, meshes in animation["attachments"]["default"].items():
        for attachment, lines in meshes.items():
            size = len(skin["attachments"][name][attachment]["vertices"])
            assert all(len(key["vertices"]) == size for key in lines["deform"])


def test_a_player_shows_every_frame_and_its_triangles_cover_the_areas(tmp_path):
    morph = a_morph()
    path, lost = save(tmp_path, morph)
    assert not lost
    content = json.loads(path.read_text())
    check_format(content)
    assert [slot["name"] for slot in content["slots"]] == ["fill:d", "fill:bar", "line:line"]
    d, bar, line = content["slots"]
    for frame in range(FRAMES):
        contours = [morph.layers[name][frame] for name in ("d", "d#2")]
        points, triangles = pose(content, d, frame)
        np.testing.assert_allclose(points, np.concatenate(contours), atol=2e-3)
        assert (areas(points, triangles) >= 0).all()
        region = polygon_area(contours[0]) - polygon_area(contours[1])
        assert areas(points, triangles).sum() == pytest.approx(region, rel=1e-9)
        points, triangles = pose(content, bar, frame)
        np.testing.assert_allclose(points, morph.layers["bar"][frame], atol=2e-3)
        assert areas(points, triangles).sum() == pytest.approx(polygon_area(points), rel=1e-9)
        points, triangles = pose(content, line, frame)
        drawn = morph.layers["line"][frame]
        length = np.hypot(*np.diff(drawn, axis=0).T).sum()
        round_ends = np.pi * 2**2
        assert abs(areas(points, triangles)).sum() == pytest.approx(
            4 * length + round_ends, rel=0.02
        )
        middle = (points[: len(points) // 2] + points[len(points) // 2 :]) / 2
        assert np.hypot(*(middle[3:-3] - drawn).T).max() < 2e-3
    # the bar is rigid: a bone without deform; the others are not
    animation = content["animations"]["morph"]
    assert set(animation["bones"]["fill:bar"]) == {"rotate", "translate", "scale"}
    assert set(animation["attachments"]["default"]) == {"fill:d", "line:line"}
    colours = [key["color"] for key in animation["slots"]["fill:d"]["rgba"]]
    assert (colours[0], colours[3], colours[-2]) == ("ff0000ff", "ff008080", "ff00ff00")
    assert max(key["time"] for key in animation["bones"]["root"]["translate"]) == FRAMES / 20


def test_what_spine_lacks_is_said_by_name(tmp_path):
    morph = a_morph()
    crossing = morph.layers["bar"].copy()
    crossing[3, [0, 1]] = crossing[3, [1, 0]]
    dashed = replace(BLUE_LINE, dashes=(3.0, 2.0))
    shaded = (replace(RED, fill=SHADED),) * FRAMES
    odd = replace(
        morph, layers=morph.layers | {"bar": crossing},
        styles=morph.styles | {"d": shaded, "line": (dashed,) * FRAMES},
    )  # fmt: skip
    path, lost = save(tmp_path, odd)
    for what in (
        "gradients as one colour: d",
        "dashes as a whole line: line",
        f"areas that cross themselves roughly: bar in 1 of {FRAMES} frames",
    ):
        assert what in lost
    red, green, blue = bytes.fromhex(json.loads(path.read_text())["slots"][0]["color"])[:3]
    assert red == pytest.approx(2 * green, abs=2) and red > 0 == blue


def test_no_line_shows_along_a_cut_or_at_a_lost_hole(tmp_path):
    box = np.array([[10, 10], [90, 10], [90, 50], [10, 50.0]])
    lined = {"a": replace(RED, stroke=(0, 0, 0), width=4.0)}
    whole = Drawing({"a": Curve(box, True)}, 100, 60, lined)
    halves = [Curve(box * [0.4, 1] + [x, 0], True) for x in (6, 54)]
    two = Drawing({"b": halves[0], "c": halves[1]}, 100, 60, dict.fromkeys("bc", lined["a"]))
    pairing = Pairing({}, splits={"a": ["b", "c"]})
    ringed = replace(whole, curves={**whole.curves, "a#2": Curve(box[::-1] * 0.3 + 20, True)})
    ringed.styles["a#2"] = lined["a"]
    for ends, slot, lengths in (
        (pair_drawings(whole, two, pairing), "line:b", (120, 144)),  # three sides; all four
        ((ringed, whole), "line:a", (240 + 72, 240)),
    ):
        path, lost = save(tmp_path, morph_drawings(*ends, "fold_free", 5, 128))
        assert "dashes" not in lost
        content = json.loads(path.read_text())
        item = next(one for one in content["slots"] if one["name"] == slot)
        shown = [abs(areas(*pose(content, item, frame))).sum() / 4 for frame in (0, 4)]
        assert shown == pytest.approx(lengths, rel=0.04)  # corners are mitred


def test_atlas_and_picture_are_there_and_a_still_drawing_has_no_timelines(tmp_path):
    morph = a_morph()
    still = morph.take_frames(np.zeros(3, np.int64))
    path, _ = save(tmp_path, still)
    content = json.loads(path.read_text())
    check_format(content)
    animation = content["animations"]["morph"]
    assert not animation["slots"] and not animation["attachments"]["default"]
    atlas = (tmp_path / "morph.spine.atlas").read_text().splitlines()
    with Image.open(tmp_path / atlas[0]) as picture:
        assert (
            np.all(np.asarray(picture) == 255) and f"size:{picture.width},{picture.height}" in atlas
        )
    mesh = content["skins"][0]["attachments"]["fill:d"]["fill:d"]
    assert mesh["path"] in atlas
