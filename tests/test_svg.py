"""SVG in: geometry against formulas and fontTools' own reader, names, styles, files that do harm."""

import contextlib
import sys
from contextlib import contextmanager
from math import comb

import numpy as np
import pytest
from fontTools.pens.recordingPen import RecordingPen
from fontTools.svgLib.path import parse_path
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fault_drawings import crowds, spoiled_drawings
from finloop.base.errors import FinloopError
from finloop.base.limited_process import LimitedProcess
from finloop.base.style import colours_at, gradient_offsets
from finloop.curve.contour import signed_area
from finloop.io import svg
from finloop.io.svg import FLATNESS, describe_unpainted, load_svg, parse_svg
from finloop.io.svg_safe import MOST_BYTES, MOST_DRAWN
from finloop.io.svg_style import MOST_NESTED

SIDE = 100
CODE = (".py", ".pyc", ".so")
REACHED = []  # what Python opened or asked the network for while `watched` held
watched = []


def listen(event, arguments):
    if watched and (event.startswith(("socket.", "urllib.", "subprocess.")) or event == "open"):
        REACHED.append((event, str(arguments[0])))


sys.addaudithook(listen)


@contextmanager
def nothing_fetched(path):
    """Fail if the block opens another file than `path`, or asks the network."""
    REACHED.clear()
    watched.append(True)
    try:
        yield
    finally:
        watched.clear()
    reached = [one for one in REACHED if one[0] != "open" or not one[1].endswith(CODE)]
    assert ("open", str(path)) in reached  # the listener does hear
    assert {*reached} == {("open", str(path))}


def put(tmp_path, body, attributes='viewBox="0 0 100 100"', head=""):
    path = tmp_path / "drawing.svg"
    xmlns = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    path.write_text(f"{head}<svg {xmlns} {attributes}>{body}</svg>", encoding="utf-8")
    return path


def load(tmp_path, body, *more, **kinds):
    return load_svg(put(tmp_path, body, *more, **kinds))


def load_curve(tmp_path, body, *more):
    (curve,) = load(tmp_path, body, *more).curves.values()
    return curve


def distance(points, line, closed=False):
    """Of each point from a polyline."""
    a, b = (line, np.roll(line, -1, axis=0)) if closed else (line[:-1], line[1:])
    along = b - a
    t = ((points[:, None] - a) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-300)
    foot = a + np.clip(t, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - foot, axis=-1).min(axis=1)


def bezier(nodes, t):
    """Bernstein's formula."""
    n, t = len(nodes) - 1, t[:, None]
    parts = (comb(n, k) * t**k * (1 - t) ** (n - k) * np.array(p) for k, p in enumerate(nodes))
    return sum(parts)


# --- path commands


def as_fonttools_sees(d):
    """Dense points of a path with one contour, by another reader."""
    pen = RecordingPen()
    parse_path(d, pen)
    t, points, at = np.linspace(0, 1, 400), [], None
    for command, nodes in pen.value:
        if command == "moveTo":
            at = nodes[0]
        elif command in ("lineTo", "curveTo", "qCurveTo"):
            points.append(bezier([at, *nodes], t))
            at = nodes[-1]
    return np.concatenate(points)


PATHS = [
    "M10 10L50 20L40 60", "m10 10 40 10-10 40", "M10 10H60V40h-20v30",
    "M10 50C20 10 40 10 50 50S80 90 90 50", "m10 50c10-40 30-40 40 0s30 40 40 0",
    "M10 50Q30 0 50 50T90 50", "m10 50q20-50 40 0t40 0",
    "M20 50A30 20 30 0 1 60 60", "M20 50A30 20 30 1 0 60 60", "m20 50a30 20 30 1 1 20 10",
    "M20 50a1 1 0 01 40 0",  # too small a radius is made larger; flags run together
    "M10 10 20 20.5.5-3e1",  # numbers run together
    "M10,50C20,10,40,10,50,50Q60 90 70 50A9 9 0 0 1 80 60H90V10L5 5",
    "M10 50S40 10 50 50",  # nothing to mirror: the control point is the current one
]  # fmt: skip


@pytest.mark.parametrize("d", PATHS)
def test_every_path_command(tmp_path, d):
    curve, other = load_curve(tmp_path, f'<path d="{d}"/>'), as_fonttools_sees(d)
    assert not curve.closed
    rough = 6e-4 * 30 if "a" in d.lower() else 0  # that reader makes Bézier curves of arcs
    assert distance(other, curve.points).max() < FLATNESS * SIDE * 1.01 + rough
    assert distance(curve.points, other).max() < 0.05  # as dense as the other is
    np.testing.assert_allclose(curve.points[[0, -1]], other[[0, -1]], atol=1e-9)


@pytest.mark.parametrize(
    ("smooth", "plain"),
    [
        ("M10 50C20 10 40 10 50 50T70 30 90 50", "M10 50C20 10 40 10 50 50Q50 50 70 30Q90 10 90 50"),
        ("M10 50Q20 10 50 50S60 10 70 30t9-9", "M10 50Q20 10 50 50C50 50 60 10 70 30L79 21"),
        ("M10 50Q20 10 30 50L40 40T50 30", "M10 50Q20 10 30 50L40 40L50 30"),
    ],
)  # fmt: skip
def test_s_and_t_mirror_their_own_kind_only(tmp_path, smooth, plain):
    turned = '<path transform="rotate(20) skewX(9)" d="{}"/>'
    lines = [load_curve(tmp_path, turned.format(d)).points for d in (smooth, plain)]
    assert distance(lines[0], lines[1]).max() < 2 * FLATNESS * SIDE
    assert distance(lines[1], lines[0]).max() < 2 * FLATNESS * SIDE


NUMBER = st.floats(-500, 500).map(lambda x: round(x, 3))


@settings(max_examples=40)
@given(nodes=st.lists(st.tuples(NUMBER, NUMBER), min_size=3, max_size=4, unique=True))
def test_curves_are_followed_within_flatness(tmp_path_factory, nodes):
    path = tmp_path_factory.getbasetemp() / "f"
    path.mkdir(exist_ok=True)
    letter = "QC"[len(nodes) - 3]
    d = f"M{nodes[0][0]} {nodes[0][1]}{letter}" + " ".join(f"{x} {y}" for x, y in nodes[1:])
    curve = load_curve(path, f'<path d="{d}"/>')
    true = bezier(nodes, np.linspace(0, 1, 700))
    assert distance(true, curve.points).max() <= FLATNESS * SIDE * 1.001
    np.testing.assert_allclose(curve.points[[0, -1]], [nodes[0], nodes[-1]], atol=1e-9)


def test_closed_or_open(tmp_path):
    drawing = load(
        tmp_path,
        '<path id="z" d="M0 0H9V9Z"/><path id="meets" d="M0 0H9V9L0 0"/>'
        '<path id="open" d="M0 0H9V9"/><polyline id="line" points="0 0 9 0 9 9"/>'
        '<polygon id="gon" points="0,0 9,0 9,9"/><line id="one" x2="9"/>',
    )
    assert {name: curve.closed for name, curve in drawing.curves.items()} == {
        "z": True, "meets": True, "open": False, "line": False, "gon": True, "one": False,
    }  # fmt: skip


def test_a_path_goes_on_after_it_was_closed(tmp_path):
    drawing = load(tmp_path, '<path id="p" fill="none" d="M10 10h20v20zm5 5h5v5zl3 4"/>')
    assert list(drawing.curves) == ["p", "p#2", "p#3"]
    corners = [curve.points.tolist() for curve in drawing.curves.values()]
    assert corners[0] == [[10, 10], [30, 10], [30, 30]]
    assert corners[1] == [[15, 15], [20, 15], [20, 20]]
    assert corners[2] == [[15, 15], [18, 19]]  # from where the second began


# --- shapes, transforms, viewport


@pytest.mark.parametrize(
    ("shape", "wanted"),
    [
        ('<circle cx="50" cy="40" r="20"/>', np.pi * 400),
        ('<ellipse cx="50" cy="40" rx="30" ry="10"/>', np.pi * 300),
        ('<rect x="5" y="6" width="30" height="20"/>', 600),
        ('<rect x="5" y="6" width="30" height="20" rx="4" ry="3"/>', 600 - (4 - np.pi) * 12),
        ('<polygon points="10 10 40 10 40 30"/>', 300),
    ],
)
def test_areas_of_basic_shapes(tmp_path, shape, wanted):
    curve = load_curve(tmp_path, shape)
    assert curve.closed
    assert abs(signed_area(curve)) == pytest.approx(wanted, rel=1e-3)
    if "circle" in shape:
        np.testing.assert_allclose(np.hypot(*(curve.points - [50, 40]).T), 20, rtol=1e-9)


A = np.deg2rad(30)
TURN = np.array([[np.cos(A), -np.sin(A)], [np.sin(A), np.cos(A)]])


@pytest.mark.parametrize(
    ("transform", "matrix", "shift"),
    [
        ("translate(3 4)", np.eye(2), [3, 4]),
        ("translate(3)", np.eye(2), [3, 0]),
        ("scale(2)", 2 * np.eye(2), [0, 0]),
        ("scale(2,-3)", np.diag([2, -3]), [0, 0]),
        ("rotate(30)", TURN, [0, 0]),
        ("rotate(30 10 20)", TURN, np.array([10, 20]) - TURN @ [10, 20]),
        ("skewX(30)", np.array([[1, np.tan(A)], [0, 1]]), [0, 0]),
        ("skewY(30)", np.array([[1, 0], [np.tan(A), 1]]), [0, 0]),
        ("matrix(1 2 3 4 5 6)", np.array([[1, 3], [2, 4]]), [5, 6]),
        ("translate(3,4) rotate(30) scale(2)", 2 * TURN, [3, 4]),
    ],
)
def test_transforms(tmp_path, transform, matrix, shift):
    corners = np.array([[10, 10], [40, 10], [40, 30.0]])
    path = '<path d="M10 10H40V30z"'
    wanted = corners @ np.array(matrix).T + shift
    curve = load_curve(tmp_path, f'{path} transform="{transform}"/>')
    np.testing.assert_allclose(curve.points, wanted)
    group = f'<g transform="{transform}"><g transform="translate(1 2)">{path}/></g></g>'
    moved = (corners + [1, 2]) @ np.array(matrix).T + shift
    np.testing.assert_allclose(load_curve(tmp_path, group).points, moved)


@pytest.mark.parametrize(
    ("attributes", "size", "first"),
    [
        ('viewBox="0 0 100 100"', (100, 100), (10, 10)),
        ('width="200" height="200" viewBox="0 0 100 100"', (200, 200), (20, 20)),
        ('width="300" height="100" viewBox="0 0 100 100"', (300, 100), (110, 10)),
        ('width="300" height="100" viewBox="0 0 100 100" preserveAspectRatio="none"', (300, 100), (30, 10)),
        ('width="100" height="300" viewBox="0 0 100 100" preserveAspectRatio="xMinYMin"', (100, 300), (10, 10)),
        ('width="100" height="100" viewBox="-10 -20 100 100"', (100, 100), (20, 30)),
        ('width="1in" height="1in" viewBox="0 0 96 96"', (96, 96), (10, 10)),
        ('width="50" height="60"', (50, 60), (10, 10)),
        ("", (40, 30), (10, 10)),
    ],
)  # fmt: skip
def test_viewport(tmp_path, attributes, size, first):
    drawing = load(tmp_path, '<path d="M10 10H40V30z"/>', attributes)
    assert (drawing.width, drawing.height) == pytest.approx(size)
    (curve,) = drawing.curves.values()
    np.testing.assert_allclose(curve.points[0], first)


# --- use, names, styles


def test_shapes_used_again(tmp_path):
    drawing = load(
        tmp_path,
        '<defs><path id="eye" d="M0 0h2v2z"/></defs><symbol id="s"><path d="M0 0h4v4z"/></symbol>'
        '<use id="left" href="#eye" x="10" y="5"/><use id="right" xlink:href="#eye" x="20"/>'
        '<use href="#eye" transform="scale(2)"/><use id="badge" href="#s"/>',
    )
    assert {name: curve.points[0].tolist() for name, curve in drawing.curves.items()} == {
        "left": [10, 5], "right": [20, 0], "eye": [0, 0], "badge": [0, 0],
    }  # fmt: skip


def test_names_come_from_ids_then_groups(tmp_path):
    p = 'd="M0 0H9V9z"'
    drawing = load(
        tmp_path,
        f'<path {p}/><g id="mouth"><path {p}/><path {p}/><path id="tooth" {p}/></g><path {p}/>',
    )
    assert list(drawing.curves) == ["contour", "mouth", "mouth-2", "tooth", "contour-2"]


def test_styles(tmp_path):
    p = 'd="M0 0H9V9z"'
    drawing = load(
        tmp_path,
        f'<path id="css" class="k" {p}/><g fill="none" stroke="lime"><path id="in" {p}/></g>'
        f'<path id="usual" {p}/><path id="lost" fill="url(#nothing) red" {p}/>'
        f'<g transform="scale(3)"><path id="wide" style="fill:none;stroke:#fff;stroke-width:2" {p}/></g>'
        f'<g opacity=".5"><g opacity="50%"><path id="thin" opacity=".8" fill-opacity=".4" {p}/></g></g>'
        f'<path id="bare" fill="none" {p}/><style>.k{{fill:red;stroke:#00f}}</style>',
    )
    styles = drawing.styles
    assert (styles["css"].fill, styles["css"].stroke) == ((255, 0, 0), (0, 0, 255))
    assert (styles["in"].fill, styles["in"].stroke) == (None, (0, 255, 0))
    assert (styles["usual"].fill, styles["usual"].stroke) == ((0, 0, 0), None)
    assert styles["lost"].fill == (255, 0, 0)
    assert styles["wide"].width == pytest.approx(6)
    assert styles["thin"].fill_opacity == pytest.approx(0.5 * 0.5 * 0.8 * 0.4, abs=0.002)
    assert "bare" not in styles


P = 'd="M0 0H9V9z"'


@pytest.mark.parametrize(
    ("body", "fill", "opacity"),
    [
        (f'<path fill="red" fill-opacity="50%" {P}/>', (255, 0, 0), 0.5),
        (f'<path fill="rgba(255,0,0,.5)" fill-opacity=".5" {P}/>', (255, 0, 0), 0.25),
        (f'<path fill="hsl(120 100% 50% / 50%)" {P}/>', (0, 255, 0), 0.5),
        (f'<path fill="hwb(240 0% 0%)" {P}/>', (0, 0, 255), 1),
        (f'<path fill="oklch(0.628 0.2577 29.23)" {P}/>', (255, 0, 0), 1),
        (f'<style>.a{{fill:blue!important}}</style><path class="a" style="fill:red" {P}/>', (0, 0, 255), 1),
        (f'<style>g .a{{fill:blue}}#p{{fill:lime}}.a{{fill:red}}</style><g><path id="p" class="a" {P}/></g>', (0, 255, 0), 1),
        (f'<style>g&gt;path{{fill:blue}}path{{fill:red}}</style><g><path {P}/></g>', (0, 0, 255), 1),
        (f'<style>svg{{--c:var(--d);--d:red}}</style><path fill="var(--c)" {P}/>', (255, 0, 0), 1),
        (f'<path style="fill:var(--none, rgb(0 0 255 / .5))" {P}/>', (0, 0, 255), 0.5),
        (f'<g fill="red"><path style="fill:inherit" {P}/></g>', (255, 0, 0), 1),
        (f'<g opacity=".5"><path opacity="inherit" fill="red" {P}/></g>', (255, 0, 0), 0.25),
        (f'<g fill="red"><path style="fill:initial" {P}/></g>', (0, 0, 0), 1),
        (f'<g color="lime"><path fill="currentColor" {P}/></g>', (0, 255, 0), 1),
        (f'<defs><path id="s" fill="currentColor" {P}/></defs><g color="lime"><use href="#s"/></g>', (0, 255, 0), 1),
    ],
)  # fmt: skip
def test_colours_as_style_sheets_state_them(tmp_path, body, fill, opacity):
    (paint,) = load(tmp_path, body).styles.values()
    assert (paint.fill, paint.fill_opacity) == (fill, pytest.approx(opacity))


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        ('fill="rde"', "fill: rde ('a')"),
        ('stroke="var(--no)"', "stroke: var(--no) ('a')"),
        ('fill="lab(50% 0 0)"', "fill: lab(50% 0 0) ('a')"),
        ('opacity="abc"', "opacity: abc ('a')"),
        ('fill-opacity="nan"', "fill-opacity: nan ('a')"),
        ('stroke="red" stroke-width="-3"', "stroke-width: -3 ('a')"),
        ('stroke="red" stroke-width="1e999"', "stroke-width: 1e999 ('a')"),
        ('stroke="red" stroke-width="3parsec"', "stroke-width: 3parsec ('a')"),
        ('stroke="red" stroke-dasharray="4 inf"', "stroke-dasharray: inf ('a')"),
        ('stroke="red" stroke-width="1e200"', "a line or gradient of a size of 1e+200 ('a')"),
        ('transform="translate(1e999)"', "transform: translate(1e999) ('a')"),
        ('transform="rotat(30)"', "transform: rotat(30) ('a')"),
        ('style="transform:translate(10%)"', "transform: translate(10%) ('a')"),
        ('style="rotate:x 30deg"', "rotate: rotate(x 30deg) ('a')"),
        ('style="d:ray(20deg)"', "d: ray(20deg) ('a')"),
        ('fill-rule="even-odd"', "fill-rule: even-odd ('a')"),
        ('vector-effect="fixed-position"', "a vector effect ('a')"),
        ('style="offset-path:none;transform-box:fill-box;rotate:9deg"', "a transform in a box of its own ('a')"),
        ('style="mix-blend-mode:multiply"', "a blend mode ('a')"),
        ('paint-order="stroke" stroke="red"', "a line below its fill ('a')"),
        ('transform="scale(2)" style="transform-origin:50% 50%"', "a transform about a point of its own ('a')"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_by_name(tmp_path, attribute, said):
    with pytest.raises(FinloopError) as error:
        load(tmp_path, f'<path id="a" {attribute} {P}/>')
    assert said in error.value.came


def test_style_sheets_state_geometry(tmp_path):
    body = (
        "<style>#a{d:path('M1 2h3v4z')} #b{cx:60px;cy:20px;r:10px} #c{x:7px;width:2px;height:4px;"
        "translate:10px 20px;rotate:90deg;scale:2 1;transform:translate(1px,0)}</style>"
        '<path id="a" d="M0 0H9V9z"/><circle id="b" r="1"/><rect id="c" y="5"/>'
    )
    curves = load(tmp_path, body).curves
    assert (
        curves["a"].points.tolist() == [[1, 2], [4, 2], [4, 6], [1, 2]][: len(curves["a"].points)]
    )
    assert np.ptp(curves["b"].points, axis=0) == pytest.approx([20, 20], abs=0.1)
    # (7 … 9, 5 … 9) + (1, 0), times (2, 1), turned from x to y, + (10, 20)
    low, high = curves["c"].points.min(axis=0), curves["c"].points.max(axis=0)
    assert (*low, *high) == pytest.approx((1, 36, 5, 40))


def test_an_attribute_that_only_styles_know_changes_nothing(tmp_path):
    plain = load(tmp_path, f'<path id="a" {P}/>').curves["a"].points
    body = f'<g translate="no"><path id="a" rotate="45" scale="2" offset-path="x" {P}/></g>'
    assert load(tmp_path, body).curves["a"].points.tolist() == plain.tolist()


def test_a_switch_shows_its_first_child_that_fits(tmp_path):
    shapes = [f'<g {how}><path id="{name}" {P}/></g>' for name, how in (
        ("german", 'systemLanguage="de, fr"'), ("other", 'requiredExtensions="http://a.example"'),
        ("english", 'systemLanguage="de, en-GB"'), ("any", ""),
    )]  # fmt: skip
    body = f"<switch>{''.join(shapes)}</switch>"
    assert list(load(tmp_path, body).curves) == ["english"]
    assert list(load(tmp_path, "".join(shapes)).curves) == ["english", "any"]


def test_an_inner_contour_is_a_hole_if_the_fill_rule_says_so(tmp_path):
    outer, alike, reverse = "M0 0H90V90H0z", "M20 20H60V60H20z", "M20 20V60H60V20z"
    cases = {"a": outer + alike, "b": outer + reverse, "c": outer + alike + "M70 70H80V80H70z"}
    body = "".join(f'<path id="{name}" d="{d}"/>' for name, d in cases.items())
    curves = load(tmp_path, f'{body}<path id="d" fill-rule="evenodd" d="{cases["a"]}"/>').curves
    assert list(curves) == ["a", "b", "b#2", "c", "d", "d#2"]
    with pytest.raises(FinloopError) as error:
        load(tmp_path, f'<path id="a" stroke="red" d="{cases["a"]}"/>')
    assert "fill-rule: nonzero" in error.value.came
    # Contours that lie on each other, or share a part of an edge
    for d, count in (
        (outer + outer, 1), (outer + "M0 0V90H90V0z", 2), (outer + "M30 20H90V60H30z", 1),
        (outer + "M30 20V60H90V20z", 2), ("M0 0H90V20H20V70H90V90H0zM20 20H90V70H20z", 2),
    ):  # fmt: skip
        assert len(load(tmp_path, f'<path d="{d}"/>').curves) == count
    # Where contours cross, finloop fills by the even-odd rule, and says so if nonzero fills more.
    star = "M50 5L76 86L7 36H93L24 86z"
    for d, rule, is_named in (
        (f"{outer}M50 50H120V120H50z", "nonzero", True),
        (f"{outer}M50 50V120H120V50z", "nonzero", False),  # winds 1 − 1 times: not filled by either
        (star, "nonzero", True), (star, "evenodd", False), (outer, "nonzero", False),
    ):  # fmt: skip
        found = load(tmp_path, f'<path id="a" fill-rule="{rule}" d="{d}"/>')
        assert found.unpainted == ("a",) * is_named and len(found.curves) == d.count("M")
        assert ("even-odd rule" in describe_unpainted(found)) == is_named
    assert not load(tmp_path, f'<path id="a" fill="none" stroke="red" d="{star}"/>').unpainted


def test_path_length_is_the_unit_of_dashes(tmp_path):
    d = 'd="M10 10h80" fill="none" stroke="red" stroke-dasharray="2 1" stroke-dashoffset="1"'
    (paint,) = load(tmp_path, f'<path pathLength="10" transform="scale(.5)" {d}/>').styles.values()
    assert (*paint.dashes, paint.dash_offset) == pytest.approx((8, 4, 4))
    kept = f'<path pathLength="10" vector-effect="non-scaling-stroke" transform="scale(.5)" {d}/>'
    (paint,) = load(tmp_path, kept).styles.values()
    assert (*paint.dashes, paint.width) == pytest.approx((8, 4, 1))


def test_the_root_counts_like_any_group(tmp_path):
    path = f'<filter id="f"/><path id="a" {P}/>'
    (paint,) = load(tmp_path, path, 'viewBox="0 0 9 9" opacity=".5"').styles.values()
    assert paint.fill_opacity == 0.5
    for attribute, said in (
        ("filter", "a filter"),
        ("clip-path", "a clip path"),
        ("mask", "a mask"),
    ):
        with pytest.raises(FinloopError, match=said):
            load(tmp_path, path, f'viewBox="0 0 9 9" {attribute}="url(#f)"')


def test_a_symbol_has_the_size_that_its_use_gives_it(tmp_path):
    drawing = load(
        tmp_path,
        '<symbol id="s" viewBox="0 0 10 10"><rect width="10" height="50%"/></symbol>'
        '<use id="small" href="#s" x="5" width="20" height="40"/><use id="whole" href="#s"/>'
        '<svg x="10" y="20" width="50%" height="50" viewBox="0 0 10 10"><path id="in" d="M0 0H10V10z"/></svg>',
    )
    corners = {
        name: np.ptp(curve.points, axis=0).tolist() for name, curve in drawing.curves.items()
    }
    assert corners == {"small": [20, 10], "whole": [100, 50], "in": [50, 50]}
    assert drawing.curves["small"].points.min(axis=0).tolist() == [5, 10]  # in its middle
    assert drawing.curves["in"].points[0].tolist() == [10, 20]


@pytest.mark.parametrize("tag", ["svg", "symbol"])
def test_a_nested_viewport_that_cuts_a_shape_is_refused_by_name(tmp_path, tag):
    use = '<use href="#s" x="20" width="50" height="50" transform="rotate(30)"/>' * (
        tag == "symbol"
    )
    nested = f'<{tag} id="s" viewBox="0 0 10 10" width="50" height="50" STYLE><path id="a" d="M0 0H9V12z"/></{tag}>'
    body = nested + use
    with pytest.raises(FinloopError) as error:
        load(tmp_path, body.replace("STYLE", ""))
    assert (
        "overflow: hidden, of an svg or symbol that cuts it (set it to visible" in error.value.came
    )
    assert len(load(tmp_path, body.replace("STYLE", 'overflow="visible"')).curves) == 1
    assert len(load(tmp_path, body.replace("STYLE", "").replace("V12z", "V9z")).curves) == 1


def test_gradients_in_hidden_groups_and_their_stops_by_id(tmp_path):
    body = (
        '<g style="display:none"><linearGradient id="g" color="red"><stop id="first"/>'
        '<stop offset="1" stop-color="currentColor"/></linearGradient></g>'
        f'<style>#first{{stop-color:lime;stop-opacity:25%}}</style><path fill="url(#g)" {P}/>'
    )
    (paint,) = load(tmp_path, body).styles.values()
    assert [tuple(stop) for stop in paint.fill.stops] == [
        (0, (0, 255, 0), 0.25),
        (1, (255, 0, 0), 1),
    ]


def test_shapes_without_a_size_and_lines_without_a_width_are_not_drawn(tmp_path):
    body = '<rect id="r"/><rect width="9"/><circle/><ellipse rx="3" ry="0"/><path/><path d=""/>'
    drawing = load(tmp_path, body + f'<path id="a" stroke="red" stroke-width="0" {P}/>')
    assert list(drawing.curves) == ["a"] and drawing.styles["a"].stroke is None


def test_names_of_paths_with_holes_and_of_illustrator(tmp_path):
    holed = '<path d="M0 0H9V9zM2 1V2H3z"/>'
    drawing = load(tmp_path, f'<g id="word">{holed}{holed}</g><path id="d_x23_2" {P}/>')
    assert list(drawing.curves) == ["word", "word#2", "word-2", "word-2#2", "d#2"]
    with pytest.raises(FinloopError, match="the name 'd#2' for two contours"):
        load(tmp_path, f'<path id="d" d="M0 0H9V9zM2 1V2H3z"/><path id="d_x23_2" {P}/>')


VARIABLES = "".join(f"--v{k}:" + f"var(--v{k + 1})" * 30 + ";" for k in range(40))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (f"<style>{'a' * 60_000}{{}}</style><path {P}/>", None),
        (f'<path {P} transform="{"rotate(" * 60_000}"/>', "transform: rotate("),
        (
            f"<style>{'x y z{a:b}' * 6000}</style>{'<g>' * 60}<path {P}/>{'</g>' * 60}",
            "too many rules",
        ),
        (f"<style>path~path{{fill:red}}</style><path {P}/>", "a style rule for 'path~path'"),
        (
            f"<style>*{{{VARIABLES}fill:var(--v0)}}</style><path {P}/>",
            "of more than 4096 characters",
        ),
        (f'<path {P} fill="{"rgb(" * 50_000}"/>', "fill: rgb("),
        (f"<style>*{{fill:{'(' * 50_000}}}</style><path {P}/>", "cannot be understood"),
        (
            f'<path style="{";".join(f"--a{k}:b" for k in range(60_000))}" {P}/>',
            "style attributes of",
        ),
    ],
)
def test_styles_that_once_took_minutes_are_read_or_refused_at_once(tmp_path, body, said):
    """Work grew with the square of their length, or with the power of their depth."""
    path = put(tmp_path, body)
    if said is None:
        assert list(load_svg(path).curves) == ["contour"]
        return
    with pytest.raises(FinloopError) as error:
        load_svg(path)
    assert said in error.value.came


@pytest.mark.parametrize(
    ("style", "dashes", "offset"),
    [
        ("stroke-dasharray:4 2", (12, 6), 0),
        ("stroke-dasharray:4,2,1;stroke-dashoffset:5", (12, 6, 3, 12, 6, 3), 15),
        ("stroke-dasharray:4 2;stroke-linecap:square;stroke-width:1", (15, 3), 1.5),
        ("stroke-dasharray:none", (), 0),
        ("stroke-dasharray:4 -2", (), 0),
        ("stroke-dasharray:0 0", (), 0),
        ("stroke-dasharray:3 0", (), 0),
    ],
)
def test_dashes(tmp_path, style, dashes, offset):
    body = f'<g transform="scale(3)"><path style="stroke:red;{style}" d="M0 0H9"/></g>'
    (paint,) = load(tmp_path, body).styles.values()
    assert paint.dashes == pytest.approx(dashes)
    assert paint.dash_offset == pytest.approx(offset)


def gradient_colours(fill, points):
    return colours_at(fill, gradient_offsets(fill, np.array(points, float)))


STOPS = '<stop stop-color="red"/><stop offset="1" stop-color="#00f" stop-opacity=".5"/>'


@pytest.mark.parametrize(
    ("gradient", "points", "shares"),
    [
        # The shape is 40 by 20 at (10, 10); points are in it, shares are offsets.
        ("linearGradient", [(10, 15), (20, 25), (50, 10)], [0, 0.25, 1]),
        ('linearGradient x1="0" x2="0" y2="1"', [(10, 10), (50, 15), (20, 30)], [0, 0.25, 1]),
        ('linearGradient x2="100%" y2="100%"', [(10, 10), (30, 20), (50, 30), (50, 10)], [0, 0.5, 1, 0.5]),
        ('linearGradient gradientUnits="userSpaceOnUse" x1="20" x2="40%"', [(20, 0), (25, 9), (40, 5)], [0, 0.25, 1]),
        ('linearGradient gradientUnits="userSpaceOnUse" x2="10" gradientTransform="translate(20) scale(2)"', [(30, 0)], [0.5]),
        ('linearGradient x2=".5" spreadMethod="reflect"', [(30, 10), (40, 10), (50, 10)], [1, 0.5, 0]),
        ('linearGradient x2=".5" spreadMethod="repeat"', [(25, 10), (35, 10), (45, 10)], [0.75, 0.25, 0.75]),
        ("radialGradient", [(30, 20), (40, 20), (30, 25), (50, 20)], [0, 0.5, 0.5, 1]),
        ('radialGradient gradientUnits="userSpaceOnUse" cx="30" cy="20" r="10" fx="25"', [(25, 20), (40, 20), (30, 10)], [0, 1, 1]),
    ],
)  # fmt: skip
def test_gradients_colour_points_of_the_plane(tmp_path, gradient, points, shares):
    tag = gradient.partition(" ")[0]
    drawing = load(
        tmp_path,
        f'<defs><{gradient} id="g">{STOPS}</{tag}></defs>'
        '<g transform="rotate(90) scale(2)"><path fill="url(#g)" d="M10 10h40v20h-40z"/></g>',
    )
    (paint,) = drawing.styles.values()
    moved = [(-2 * y, 2 * x) for x, y in points]
    wanted = [(255 * (1 - share), 0, 255 * share, 1 - share / 2) for share in shares]
    np.testing.assert_allclose(gradient_colours(paint.fill, moved), wanted, atol=1e-6)


def test_gradients_refer_to_gradients_and_stops_have_styles(tmp_path):
    drawing = load(
        tmp_path,
        "<style>.s{stop-color:lime}</style>"
        '<linearGradient id="a" xlink:href="#b"/><radialGradient id="loop" href="#loop"/>'
        '<linearGradient id="b" href="#c" x2="50%"/><linearGradient id="c" x1=".25">'
        '<stop class="s"/><stop offset="50%" style="stop-color:rgb(0,0,255)"/><stop offset=".2"/>'
        '</linearGradient><path id="p" fill="url(#a)" d="M0 0h100v10h-100z"/>'
        '<path id="none" fill="url(#loop)" d="M0 0h9v9z"/><path id="flat" fill="url(#a)" d="M0 0H9"/>',
    )
    (fill,) = [paint.fill for paint in drawing.styles.values()]
    assert [stop.offset for stop in fill.stops] == [0, 0.5, 0.5]  # offsets never fall
    found = gradient_colours(fill, [(25, 0), (37, 0), (50, 0)])
    np.testing.assert_allclose(found[:, :3], [(0, 255, 0), (0, 10.2, 244.8), (0, 0, 0)], atol=0.1)


# The same picture as four programs write it: a body with a gradient, and a leg with its paw.
HEAD = 'width="100" height="100" viewBox="0 0 100 100"'
LEG = 'd="M0,0 L20,0 L20,40 L0,40 Z"'
PROGRAMS = {
    "Inkscape": (
        f'inkscape:version="1.3" xmlns:inkscape="urn:i" xmlns:sodipodi="urn:s" {HEAD}',
        '''<sodipodi:namedview id="base" showgrid="false"/><defs id="defs1">
        <linearGradient id="lg1"><stop style="stop-color:#ff0000;stop-opacity:1" offset="0" id="s1"/>
        <stop style="stop-color:#0000ff;stop-opacity:1" offset="1" id="s2"/></linearGradient>
        <linearGradient id="lg2" xlink:href="#lg1" x1="10" y1="30" x2="90" y2="30" gradientUnits="userSpaceOnUse"/>
        <radialGradient id="rg1" cx="10" cy="45" r="12" fx="10" fy="45" gradientUnits="userSpaceOnUse"
        gradientTransform="matrix(1,0,0,0.5,0,22.5)"><stop style="stop-color:#ffffff" offset="0" id="s3"/>
        <stop style="stop-color:#000000" offset="1" id="s4"/></radialGradient>
        <filter id="unused"><feGaussianBlur stdDeviation="2"/></filter></defs><metadata id="m"/>
        <g inkscape:label="Layer 1" inkscape:groupmode="layer" id="layer1">
        <path style="fill:url(#lg2);stroke:none" d="m 10,10 h 80 v 40 H 10 Z" id="body" sodipodi:nodetypes="ccccc"/>
        <g id="fore_left" inkscape:label="leg" transform="translate(20,40)">
        <path style="fill:#00ff00;fill-opacity:0.5;stroke:#000000;stroke-width:2;stroke-dasharray:6, 3;stroke-dashoffset:0" LEG id="leg"/>
        <ellipse style="fill:url(#rg1);stroke:none" id="paw" cx="10" cy="45" rx="12" ry="6"/></g></g>''',
    ),
    "Illustrator": (
        f'id="Layer_1" data-name="Layer 1" {HEAD}',
        '''<defs><style>.cls-1{fill:url(#linear-gradient);}.cls-2{fill:lime;fill-opacity:.5;stroke:#000;
        stroke-width:2px;stroke-dasharray:6 3}.cls-1,.cls-3{stroke-width:0px;}.cls-3{fill:url(#radial-gradient);}</style>
        <linearGradient id="linear-gradient" x1="10" y1="30" x2="90" y2="30" gradientUnits="userSpaceOnUse">
        <stop offset="0" stop-color="red"/><stop offset="1" stop-color="blue"/></linearGradient>
        <radialGradient id="radial-gradient" cx="10" cy="45" fx="10" fy="45" r="12"
        gradientTransform="translate(0 22.5) scale(1 .5)" gradientUnits="userSpaceOnUse">
        <stop offset="0" stop-color="#fff"/><stop offset="1" stop-color="#000"/></radialGradient></defs>
        <path id="body" class="cls-1" d="M10,10h80v40H10V10Z"/><g id="fore_x5F_left" transform="translate(20 40)">
        <polygon id="leg" class="cls-2" points="0 0 20 0 20 40 0 40 0 0"/>
        <ellipse id="paw" class="cls-3" cx="10" cy="45" rx="12" ry="6"/></g>''',
    ),
    "Figma": (
        f'fill="none" {HEAD}',
        '''<g id="Frame 1" clip-path="url(#clip0_1_2)"><path id="body" d="M10 10H90V50H10V10Z" fill="url(#paint0_linear_1_2)"/>
        <g id="fore_left"><path id="leg" d="M20 40H40V80H20V40Z" fill="#00FF00" fill-opacity="0.5" stroke="black" stroke-width="2" stroke-dasharray="6 3"/>
        <ellipse id="paw" cx="30" cy="85" rx="12" ry="6" fill="url(#paint1_radial_1_2)"/></g></g><defs>
        <linearGradient id="paint0_linear_1_2" x1="10" y1="30" x2="90" y2="30" gradientUnits="userSpaceOnUse">
        <stop stop-color="#FF0000"/><stop offset="1" stop-color="#0000FF"/></linearGradient>
        <radialGradient id="paint1_radial_1_2" cx="0" cy="0" r="1" gradientUnits="userSpaceOnUse"
        gradientTransform="translate(30 85) rotate(90) scale(6 12)"><stop stop-color="white"/><stop offset="1"/></radialGradient>
        <clipPath id="clip0_1_2"><rect width="100" height="100" fill="white"/></clipPath></defs>''',
    ),
    "Affinity": (
        'width="100%" height="100%" viewBox="0 0 100 100" version="1.1" xml:space="preserve" xmlns:serif="urn:a"'
        ' style="fill-rule:evenodd;clip-rule:evenodd;stroke-linejoin:round;stroke-miterlimit:2;"',
        '''<g transform="matrix(1,0,0,1,-10,-20)"><path id="body" d="M20,30L100,30L100,70L20,70L20,30Z" style="fill:url(#_Linear1);"/></g>
        <g id="fore_left" serif:id="fore left" transform="matrix(1,0,0,1,20,40)"><g transform="matrix(2,0,0,2,0,0)">
        <path id="leg" d="M0,0L10,0L10,20L0,20L0,0Z" style="fill:rgb(0,255,0);fill-opacity:0.5;stroke:black;stroke-width:1px;stroke-dasharray:3,1.5;"/></g>
        <g transform="matrix(1,0,0,0.5,0,22.5)"><circle id="paw" cx="10" cy="45" r="12" style="fill:url(#_Radial2);"/></g></g><defs>
        <linearGradient id="_Linear1" x1="0" y1="0" x2="1" y2="0" gradientUnits="userSpaceOnUse" gradientTransform="matrix(80,0,0,80,20,50)">
        <stop offset="0" style="stop-color:rgb(255,0,0);stop-opacity:1"/><stop offset="1" style="stop-color:rgb(0,0,255);stop-opacity:1"/></linearGradient>
        <radialGradient id="_Radial2" cx="0" cy="0" r="1" gradientUnits="userSpaceOnUse" gradientTransform="matrix(12,0,0,12,10,45)">
        <stop offset="0" style="stop-color:white"/><stop offset="1" style="stop-color:black"/></radialGradient></defs>''',
    ),
}  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS)
def test_drawings_of_four_programs_are_the_same(tmp_path, program):
    attributes, body = PROGRAMS[program]
    drawing = load(tmp_path, body.replace("LEG", LEG), attributes)
    assert (drawing.width, drawing.height) == (100, 100)
    assert list(drawing.curves) == ["body", "leg", "paw"]
    assert drawing.groups["leg"][0] == drawing.groups["paw"][0] == "fore_left"
    corners = {"body": [[10, 10], [90, 10], [90, 50], [10, 50]]}
    corners["leg"] = [[20, 40], [40, 40], [40, 80], [20, 80]]
    for name, points in corners.items():
        np.testing.assert_allclose(drawing.curves[name].points, points)
    assert distance(drawing.curves["paw"].points, np.array([[18, 85], [42, 85]])).max() < 6.001
    body, leg, paw = (drawing.styles[name] for name in ("body", "leg", "paw"))
    assert (leg.fill, leg.fill_opacity) == ((0, 255, 0), pytest.approx(0.5, abs=0.002))
    assert (leg.stroke, leg.stroke_opacity, leg.width) == ((0, 0, 0), 1, pytest.approx(2))
    assert leg.dashes == pytest.approx((6, 3))
    found = gradient_colours(body.fill, [(0, 0), (50, 50), (99, 9)])[:, :3]
    np.testing.assert_allclose(found, [(255, 0, 0), (127.5, 0, 127.5), (0, 0, 255)], atol=1e-6)
    found = gradient_colours(paw.fill, [(30, 85), (36, 85), (30, 88), (42, 85)])[:, 0]
    np.testing.assert_allclose(found, [255, 127.5, 127.5, 0], atol=1e-6)
    assert body.stroke is paw.stroke is None


@pytest.mark.parametrize(
    ("body", "says", "do"),
    [
        ('<clipPath id="c"><path d="M0 0H5V5z"/></clipPath><g clip-path="url(#c)"><path id="a" P/></g>', "a clip path ('a')", "release clip"),
        ('<clipPath id="c"><rect width="99" height="99"/></clipPath><path id="a" clip-path="url(#c)" P/>', "a clip path ('a')", "cut"),
        ('<style>.m{mask:url(#m)}</style><mask id="m"/><path id="a" class="m" P/>', "a mask ('a')", "release masks"),
        ('<filter id="f"/><path id="a" style="filter:url(#f)" P/><path id="b" filter="url(#f)" P/>', "a filter ('a', 'b')", "remove filters"),
        ('<pattern id="p"><path P/></pattern><g fill="url(#p)"><path id="a" P/></g>', "a pattern ('a')", "gradients"),
        ('<marker id="p"><path P/></marker><path id="a" marker-end="url(#p)" P/>', "a marker ('a')", "into paths"),
        ('<path P/><g id="t"><text><tspan>Hello</tspan></text></g>', "text ('Hello')", "turn text into paths"),
        ('<mask id="m"/><text id="t">a</text><path id="a" mask="url(#m)" filter="url(#f)" P/>', "a mask ('a'), a filter ('a'), text ('t')", "; "),
    ],
)  # fmt: skip
def test_what_no_contour_shows_is_refused_by_name_in_one_message(tmp_path, body, says, do):
    with pytest.raises(FinloopError) as error:
        load(tmp_path, body.replace("P/", 'd="M0 0H9V9z"/'))
    assert says in error.value.came
    assert do in error.value.do


def test_what_is_not_used_or_does_nothing_is_not_refused(tmp_path):
    p = 'd="M0 0H9V9z"'
    body = (
        f'<defs><filter id="f"/><pattern id="p"><path {p}/></pattern><clipPath id="c"><rect width="100"'
        f' height="100"/></clipPath></defs><g clip-path="url(#c)"><path id="seen" {p}/></g><text> </text>'
        f'<path style="display:none" filter="url(#f)" {p}/><text display="none">words</text>'
        f'<path visibility="hidden" fill="url(#p)" {p}/>'
        f'<path id="bare" filter="none" fill="" style="paint-order:stroke;mix-blend-mode:normal" {p}/>'
    )
    assert list(load(tmp_path, body).curves) == ["seen", "bare"]


@pytest.mark.parametrize(
    ("rect", "is_artboard"),
    [
        ('width="100" height="100" style="fill:none"', True),  # Illustrator
        ('width="101" height="100" fill="none" transform="scale(0.992 0.998)"', True),  # Affinity
        ('width="100" height="98" fill="none"', False),
        ('width="100" height="100" fill="white"', False),
        ('width="100" height="100" rx="9" fill="none"', False),
        ('width="100" height="100" fill="none" stroke="black"', False),
    ],
)
def test_an_artboard_is_no_shape(tmp_path, rect, is_artboard):
    """It would be a black frame, or hide the picture, where the other drawing paints its partner."""
    board = f'<g id="Artboard1"><rect x="0" y="0" {rect}/></g>'
    drawing = load(tmp_path, f'<path id="seen" d="M1 1H9V9z"/>{board}')
    assert list(drawing.curves) == ["seen", *["Artboard1"] * (not is_artboard)]
    assert list(load(tmp_path, board).curves) == ["Artboard1"]  # the only shape


def test_what_inkscape_names_by_itself_goes_by_its_label(tmp_path):
    p = 'd="M0 0H9V9z"'
    drawing = load(
        tmp_path,
        f'<g id="layer1" inkscape:label="dog"><g id="g12" inkscape:label="fore_left"><path id="path3"'
        f' inkscape:label="paw" {p}/><path id="path4-2" {p}/></g><path id="path9" inkscape:label="paw"'
        f' {p}/><path id="ear" inkscape:label="left ear" {p}/></g>',
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="9" height="9"',
    )
    assert list(drawing.curves) == ["paw", "path4-2", "paw-2", "ear"]
    assert drawing.groups["paw"] == drawing.groups["path4-2"] == ("fore_left", "dog")


def test_an_id_that_is_its_label_too_stays_an_id(tmp_path):
    ear = '<path id="ear" inkscape:label="ear" d="M0 0H9V9z"/>'
    root = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="9" height="9"'
    nameless = '<g id="ear"><path d="M0 0H9V9z"/></g>'
    assert list(load(tmp_path, nameless + ear, root).curves) == ["ear-2", "ear"]
    with pytest.raises(FinloopError, match="uses the id 'ear' 2 times"):
        load(tmp_path, ear + ear, root)


def test_groups_are_known_by_their_ids(tmp_path):
    p = 'd="M0 0H9V9z"'
    drawing = load(
        tmp_path,
        f'<defs><g id="boot"><path id="sole" {p}/></g></defs><g id="dog"><g id="leg"><g><path {p}/></g>'
        f'<path id="paw" {p}/></g><use id="foot" href="#boot"/></g><path id="sun" {p}/>',
    )
    assert drawing.groups == {
        "leg": ("leg", "dog"), "paw": ("leg", "dog"), "foot": ("boot", "foot", "dog"),
    }  # fmt: skip


def test_what_is_hidden_or_no_contour_is_left_out(tmp_path):
    p = 'd="M0 0H9V9z"'
    body = (
        f'<path id="seen" {p}/><path display="none" {p}/><g style="display:none"><path {p}/></g>'
        f'<path visibility="hidden" {p}/><metadata><path {p}/></metadata>'
        f"<clipPath><path {p}/></clipPath><mask><path {p}/></mask><pattern><path {p}/></pattern>"
        f"<marker><path {p}/></marker><symbol><path {p}/></symbol><defs><path {p}/></defs>"
    )
    assert list(load(tmp_path, body).curves) == ["seen"]


# --- files that do harm

BOMB = '<!DOCTYPE svg [<!ENTITY a "ha">' + "".join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
) + "]>"  # fmt: skip
SHAPE = '<path id="p" d="M0 0H9V9z"/>'


def use_bomb():
    levels = ['<g id="u0"><path d="M0 0H9V9z"/></g>']
    levels += [f'<g id="u{k}">{f"""<use href="#u{k - 1}"/>""" * 10}</g>' for k in range(1, 10)]
    return f"<defs>{''.join(levels)}</defs><use href='#u9'/>"


def test_of_equal_ids_the_first_counts(tmp_path):
    body = "<defs><path id='a' d='M0 0H9V9z'/></defs><use id='a' href='#a'/>"
    (curve,) = load_svg(put(tmp_path, body)).curves.values()
    assert len(curve.points) == 3


@pytest.mark.parametrize(
    ("body", "head", "says"),
    [
        ("<text>&i;</text>" + SHAPE, BOMB, "entity"),
        (SHAPE, '<!DOCTYPE svg [<!ENTITY x SYSTEM "secret.txt">]>', "entity"),
        (SHAPE, '<!DOCTYPE svg [<!ENTITY % x SYSTEM "http://127.0.0.1:9/x.dtd"> %x;]>', "entity"),
        ('<use href="other.svg#p"/>', "", "other.svg#p"),
        ('<use xlink:href="http://127.0.0.1:9/a.svg#p"/>', "", "another file"),
        ('<g id="a"><use href="#a"/></g>', "", "shows itself"),
        ('<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>', "", "shows itself"),
        (use_bomb(), "", "512 KiB"),
        (f'<path id="p" d="M0 0{"h1v1" * (MOST_DRAWN // 100)}"/>' + '<use href="#p"/>' * 50, "", "512 KiB"),
        ("<g>" * MOST_NESTED + SHAPE + "</g>" * MOST_NESTED, "", f"{MOST_NESTED} deep"),
        ("<g/>" * (MOST_DRAWN // 100 + 1), "", "512 KiB"),
        (f'<path d="M0 0{"h1v1" * (MOST_DRAWN // 4)}"/>', "", "512 KiB"),
        (SHAPE * 1001, "", "1001"),
        (f"<style>{'*{a:b}' * 12_000}</style>" + SHAPE, "", "style sheets of 70 KiB"),
        ("", "", "no contour"),
        ("<text>only words</text>", "", "shows text"),
        (f"<path d='M0 0H9' stroke='red' stroke-dasharray='{'1 ' * 65}'/>", "", "65 lengths"),
        (f"<linearGradient id='g'>{'<stop/>' * 65}</linearGradient><path fill='url(#g)' d='M0 0H9V9z'/>", "", "65 stops"),
        ("<g>", "", "no XML"),
        ("<other:path/>" + SHAPE, "", "no XML (unbound prefix"),
        (f'<path id="p" d="M0 0H9V9{"z" * 1001}"/>', "", "d: 1001 contours"),
        (f'<path id="p" d="{"M0 0H9V9" * 1001}"/>', "", "d: 1001 contours"),
        (f'<polygon id="p" points="{"1" * 60_000}"/>', "", "points: 111"),
        (f"<style>{'a b ' * 501}{{fill:red}}</style>" + SHAPE, "", "selectors of 20"),
        (SHAPE * 2, "", "'p' 2 times"),
        ('<path id="p" d="M0 0H9V9z" transform="scale(0)"/>', "", "curve p"),
        ('<path id="p" d="M0 0H1e999V9z"/>', "", "curve p"),
        ('<path id="p" d="M5 5L5 5"/>', "", "curve p"),
        ('<path id="p" d="M5 5L9 5z"/>', "", "closed curve p"),
        ('<path id="p" d="M5 5L9 bogus"/>', "", "cannot be understood"),
    ],
)  # fmt: skip
def test_refused(tmp_path, body, head, says):
    (tmp_path / "secret.txt").write_text("secret")
    path = put(tmp_path, body, head=head)
    if len(body) < 100_000:
        assert path.stat().st_size <= MOST_BYTES
    with nothing_fetched(path), pytest.raises(FinloopError) as error:
        parse_svg(path)
    with pytest.raises(FinloopError) as same:
        load_svg(path)
    assert str(same.value) == str(error.value)
    assert says in error.value.came.replace(str(path), "")
    assert "secret" not in str(error.value)


def test_outside_references_are_not_fetched(tmp_path):
    (tmp_path / "secret.txt").write_text("<path d='M0 0H9V9z'/>")
    body = (
        '<image href="secret.txt" width="9" height="9"/><image href="http://127.0.0.1:9/a.png"/>'
        "<style>@import url(secret.txt); @import url(http://127.0.0.1:9/a.css);"
        " path{fill:url(secret.txt#x)}</style><script href='secret.txt'/>"
        '<feImage href="secret.txt"/><a href="http://127.0.0.1:9/">' + SHAPE + "</a>"
    )
    head = (
        '<?xml-stylesheet href="secret.txt"?>'
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://127.0.0.1:9/svg11.dtd">'
    )
    path = put(tmp_path, body, head=head)
    with nothing_fetched(path):
        assert list(parse_svg(path).curves) == ["p"]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "it is empty"),
        (b"GIF89a", "no XML"),
        (b"\x1f\x8b\x08zipped", "no XML"),
        (b"<html/>", "<html>"),
        (b"<svg>" + b" " * MOST_BYTES + b"</svg>", "MiB"),
        (b'<?xml version="1.0" encoding="klingon"?><svg/>', "no XML"),
        (b'<svg xmlns="http://www.w3.org/2000/svg"/>', "no contour"),
        (b'<svg xmlns="http://www.w3.org/2000/svg" width="0" height="0" viewBox="0 0 9 9"/>', "no contour"),
    ],
)  # fmt: skip
def test_no_drawing(tmp_path, data, says):
    path = tmp_path / "drawing.svg"
    path.write_bytes(data)
    with pytest.raises(FinloopError) as error:
        load_svg(path)
    assert str(path) in error.value.came
    assert says in error.value.came.replace(str(path), "")
    for missing in (tmp_path / "none.svg", tmp_path):
        with pytest.raises(FinloopError, match="cannot be read"):
            load_svg(missing)


def test_a_spoiled_drawing_gives_a_drawing_or_one_message(tmp_path):
    """`benchmarks.fault_drawings` spoils ten thousand, and writes one long value everywhere."""
    path, read = tmp_path / "drawing.svg", 0
    for content in spoiled_drawings(100, seed=5):
        path.write_bytes(content)
        try:
            read += bool(load_svg(path).curves)
        except FinloopError as error:
            assert str(path) in str(error) or error.came.startswith(("a ", "the ", "point "))
    assert 5 < read < 60


def test_a_drawing_that_takes_too_long_is_refused_with_its_size(tmp_path, monkeypatch):
    with contextlib.closing(LimitedProcess(0, svg.MOST_MIB)) as hurried:  # a second, rounded up
        monkeypatch.setattr(svg, "_PARSER", hurried)
        path = put(tmp_path, dict(crowds(1000))["contours in each other"].decode())
        with pytest.raises(
            FinloopError, match=rf"drawing.svg \({path.stat().st_size / 1024:.0f} KiB"
        ):
            load_svg(path)
        assert list(load(tmp_path, SHAPE).curves) == ["p"]
