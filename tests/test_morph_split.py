"""Shapes of another kind or number: open and closed, one and several, parts, and pins."""

from dataclasses import replace

import numpy as np
import pytest

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.base.paint import group_contours, layers_by_shape, paint_layers
from finloop.base.style import Paint
from finloop.curve.contour import Curve, area_centroids, nearest_on_curve, signed_area
from finloop.curve.glyph import glyph_outlines
from finloop.morph.cover import find_covered_pieces, find_shifts
from finloop.morph.folds import is_simple
from finloop.morph.layers import morph_drawings
from finloop.morph.match import Pins, match_any_curves, match_curves
from finloop.morph.pairs import Pairing, load_pairing, match_drawings, pair_drawings, pair_shapes
from finloop.morph.regions import Region, split_regions
from finloop.morph.split import split_line, split_region

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
ANGLE = np.linspace(0, 2 * np.pi, 48, endpoint=False)
ROUND = 5 + 5 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
ARC = np.stack([np.cos(ANGLE * 0.9), np.sin(ANGLE * 0.9)], axis=1) * 20 + 50
RED = Paint((200, 30, 30), (0, 0, 0), 1.0, 1.0, 3.0)


def drawing(styles=None, **shapes) -> Drawing:
    """A drawing of 100 × 100: curves, or lists of them, by id."""
    curves = {}
    for name, contours in shapes.items():
        contours = [contours] if isinstance(contours, Curve) else contours
        curves |= {f"{name}#{k}" if k > 1 else name: one for k, one in enumerate(contours, 1)}
    return Drawing(curves, 100, 100, styles or {})


def polygon(points) -> Curve:
    return Curve(np.asarray(points, float), True)


def picture(morph_or_drawing, frame=None):
    """What a drawing, or a frame of a morph, looks like."""
    d = morph_or_drawing
    if frame is None:
        contours = {name: curve.points for name, curve in d.curves.items()}
        is_closed, styles = {name: curve.closed for name, curve in d.curves.items()}, d.styles
    else:
        contours = {name: stack[frame] for name, stack in d.layers.items()}
        is_closed, styles = d.closed, d.paints_at(frame)
    shapes = group_contours(is_closed, styles, 100)
    return paint_layers([(s, [contours[n] for n in s.layers]) for s in shapes], (200, 200), 2.0)


# --- open and closed


@pytest.mark.parametrize("points", [64, 65])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_line_opens_like_a_mouth_and_an_arc_closes_its_gap(points, swapped):
    line = Curve(np.array([[30, 50], [50, 54], [70, 50.0]]), False)
    lens = polygon(np.r_[line.points, [[50, 40.0]]])
    arc, ring = Curve(ARC, False), polygon(ROUND * 4 + 30)
    for one, other, wanted in ((line, lens, True), (arc, ring, False)):
        first, second, is_closed = match_any_curves(
            *((other, one) if swapped else (one, other)), points
        )
        assert is_closed is wanted and first.shape == second.shape == (points, 2)
        for found, curve in zip(
            (first, second), (other, one) if swapped else (one, other), strict=True
        ):
            assert is_simple(found, is_closed)
            assert np.hypot(*nearest_on_curve(found, curve)[1].T).max() < 0.3  # corners are cut
        ends = second if not swapped else first
        if not wanted:  # it closes but for what no pixel shows
            assert np.hypot(*(ends[0] - ends[-1])) < 0.01


@pytest.mark.parametrize("method", ["linear", "fold_free", "physical"])
def test_open_and_closed_by_every_method(method):
    a = drawing(
        mouth=Curve(np.array([[30, 50], [50, 58], [70, 50.0]]), False), arc=Curve(ARC - 20, False)
    )
    b = drawing(
        mouth=polygon([[30, 50], [50, 40], [70, 50], [50, 70]]), arc=polygon(ROUND * 4 + 10)
    )
    done = morph_drawings(a, b, method, 9, 64)
    assert done.closed == {"mouth": True, "arc": False}
    assert abs(signed_area(polygon(done.layers["mouth"][0]))) < 0.5
    assert abs(signed_area(polygon(done.layers["mouth"][-1]))) == pytest.approx(600, rel=0.01)
    back = morph_drawings(b, a, method, 9, 64)
    assert back.closed == done.closed
    if method == "fold_free":
        assert not done.count_fold_frames() and not back.count_fold_frames()


# --- one and several


def test_pieces_fill_the_shape_and_have_their_shares():
    goals = [
        Region(polygon(ROUND * size + place), []) for size, place in ((4, 0), (2, 60), (1, 20))
    ]
    pieces = split_region(Region(polygon(ROUND * 10), []), goals)
    areas = [abs(signed_area(piece.region.outer)) for piece in pieces]
    whole = abs(signed_area(polygon(ROUND * 10)))
    assert sum(areas) == pytest.approx(whole) and areas[0] == max(areas)
    assert areas[0] / whole == pytest.approx(16 / 21, abs=0.1)
    assert all(is_simple(piece.region.outer.points) for piece in pieces)
    low, high = (area_centroids(pieces[k].region.outer.points) for k in (0, 1))
    assert (low < high).all()  # as the goals lie
    for k, piece in enumerate(pieces):  # each cut is on two pieces
        middles = piece.cuts.mean(axis=1)
        others = [
            nearest_on_curve(middles, p.region.outer)[1] for p in pieces[:k] + pieces[k + 1 :]
        ]
        assert np.hypot(*np.min(np.abs(others), axis=0).T).max() < 1e-6


def test_an_eight_is_cut_between_its_holes_and_a_ring_not_at_all():
    (eight,) = split_regions(glyph_outlines("8"))
    goals = [Region(polygon(SQUARE + [0, 30 * k]), []) for k in (0, 1)]
    pieces = split_region(eight, goals)
    assert [len(piece.region.holes) for piece in pieces] == [1, 1]
    inner = [polygon(SQUARE * 0.99 + 0.05)]
    with pytest.raises(FinloopError, match="no straight cut divides"):
        split_region(Region(polygon(SQUARE), inner), goals)


def test_a_line_is_cut_by_the_lengths_of_its_parts():
    line = Curve(np.array([[0, 0], [30, 0.0]]), False)
    goals = [Curve(np.array([[x, 9], [x + w, 9.0]]), False) for x, w in ((20, 20), (0, 10))]
    ends = [part.points[[0, -1], 0].tolist() for part in split_line(line, goals)]
    assert ends == [[10, 30], [0, 10]]


@pytest.mark.parametrize("method", ["linear", "fold_free", "physical"])
def test_one_becomes_two_and_looks_as_drawn_at_both_ends(method):
    one = drawing({"body": RED}, body=polygon(ROUND * 5 + 20))
    two = drawing(dict.fromkeys(("left", "right"), RED), left=polygon(ROUND * 2 + [20, 40]),
                  right=polygon(ROUND * 3 + [60, 30]))  # fmt: skip
    for a, b, given in (
        (one, two, Pairing({}, splits={"body": ["left", "right"]})),
        (two, one, Pairing({"left": "body", "right": "body"})),
    ):
        done = morph_drawings(*pair_drawings(a, b, pair_shapes(a, b, given)), method, 9, 256)
        assert list(done.layers) == ["left", "right"] and not done.count_fold_frames()
        assert method == "physical" or not done.covers  # but for the seam
        for frame, drawn in ((0, a), (-1, b)):
            off = abs(picture(done, frame).astype(int) - picture(drawn)).max(axis=2)
            assert (off > 90).mean() < 5e-4  # neither a seam nor the line of a cut


def test_pieces_that_cover_each_other_are_named_and_kept_apart():
    """They pass through each other, beside each other, or stay together along the cut."""
    left, right = ROUND * 2 + [20, 40], ROUND * 2 + [60, 40]
    cut = np.array([[[40, 20], [40, 60.0]]])
    cuts, family = {"left": cut, "right": cut}, (("left", "right"),)
    for goals, is_named in (
        ((right, left), True), ((left - 10, right + 10), False), ((right, left + [0, 160]), False)
    ):  # fmt: skip
        a = replace(drawing(left=polygon(left), right=polygon(right)), cuts=cuts, families=family)
        b = drawing(left=polygon(goals[0]), right=polygon(goals[1]))
        done = morph_drawings(a, b, "linear", 9, 64)
        assert sorted(done.count_cover_frames()) == ["left", "right"] * is_named
        assert not done.take_frames(np.array([0, -1])).covers.get("left", np.zeros(1)).any()
        apart = morph_drawings(a, b, "fold_free", 9, 64)
        assert not apart.covers and all(apart.continuous.values())
        moved = [name for name in apart.layers if (apart.layers[name] != done.layers[name]).any()]
        assert len(moved) == is_named  # one steps aside, and only if it must
        layers = replace(a, families=())  # layers that are no pieces of one shape pass over others
        assert not morph_drawings(layers, b, "linear", 9, 64).covers


@pytest.mark.parametrize("glyphs", ["H%", "?C"])
def test_pieces_of_a_glyph_step_aside(glyphs):
    a, b = (
        drawing(letter=[polygon(c.points / 12 + [20, 80]) for c in glyph_outlines(g)])
        for g in glyphs
    )
    ends = pair_drawings(a, b, pair_shapes(a, b))
    free, alone = (
        morph_drawings(*(replace(end, families=known) for end in ends), "fold_free", 20, 64)
        for known in (ends[0].families, ())
    )
    shapes = layers_by_shape(alone.layers)
    contours = {name: [alone.layers[layer] for layer in names] for name, names in shapes.items()}
    assert ends[0].families == (tuple(shapes),) and find_covered_pieces(contours, ends[0].families)
    assert not free.covers and not free.count_fold_frames()


def test_shifts_are_none_at_both_ends_and_where_nothing_is_covered():
    tau = np.linspace(0, 1, 41)[:, None, None]
    wide, small = SQUARE * [4, 4] - 20, SQUARE - 5
    still = np.repeat(wide[None], 41, axis=0)
    across = small + [80, 0] * (2 * tau - 1)  # from the left to the right, through the wide one
    apart = [[still], [across + [0, 60]]]
    assert not np.any(find_shifts(apart))
    assert not np.any(find_shifts([[still], *[[across]] * 16]))  # too many to look at
    stays, shift = find_shifts([[still], [across]])
    assert not stays.any() and not shift[[0, -1]].any()
    steps = np.hypot(*np.diff(shift, axis=0).T)
    reach = np.hypot(*shift.T)
    assert 20 < reach.max() < 40 and steps.max() < 0.25 * reach.max()  # it clears the edge steadily
    assert np.linalg.matrix_rank(shift, tol=1e-6 * reach.max()) == 1  # in one direction


@pytest.mark.parametrize("turn", range(0, 48, 12))
def test_the_line_of_a_hole_stays_whole_in_a_piece(turn):
    """It has the dashes of the outer line, which leave the cut open."""
    left = np.roll(ROUND, turn, axis=0) * 2 + [20, 40]  # wherever it begins
    two = drawing(dict.fromkeys(("left", "right"), RED), left=polygon(left),
                  right=polygon(ROUND * 2 + [60, 40]))  # fmt: skip
    given = Pairing({"left": "body", "right": "body"})
    one = drawing({"body": RED}, body=[polygon(ROUND * 5 + 20), polygon(ROUND + [30, 40])])
    done = morph_drawings(*pair_drawings(two, one, given), "linear", 9, 256)
    assert list(done.layers) == ["left", "left#2", "right"] and done.styles["left"][-1].dashes
    off = abs(picture(done, -1).astype(int) - picture(one)).max(axis=2)
    assert (off > 90).mean() < 5e-4
    # a hole longer round than the piece's line shows the line of the cut, but is whole, too
    teeth = np.array([[30 + 6 * (k % 2), 36 + k] for k in range(18)])
    comb = polygon(np.concatenate([teeth, teeth[::-1] - [3, 0]]))
    one = drawing({"body": RED}, body=[polygon(ROUND * 5 + 20), comb])
    done = morph_drawings(*pair_drawings(two, one, given), "linear", 9, 256)
    assert not done.styles["left"][-1].dashes and done.styles["right"][-1].dashes


def test_parts_of_a_path_may_differ_in_number():
    i, x = (drawing({"letter": RED}, letter=[Curve(c.points / 14 + [20, 75], True) for c in glyph_outlines(g)])
            for g in "iX")  # fmt: skip
    for a, b in ((i, x), (x, i)):
        done = morph_drawings(*pair_drawings(a, b, pair_shapes(a, b)), "fold_free", 8, 128)
        assert list(done.layers) == ["letter", "letter-2"] and not done.count_fold_frames()


def test_a_lost_hole_leaves_no_dot_of_its_line():
    ring = drawing({"o": RED}, o=[polygon(ROUND * 6 + 10), polygon(ROUND * 2 + 30)])
    disc = drawing({"o": RED}, o=polygon(ROUND * 6 + 10))
    done = morph_drawings(ring, disc, "fold_free", 8, 128)
    assert (abs(picture(done, -1).astype(int) - picture(disc)).max(axis=2) > 90).mean() < 5e-4
    assert picture(done, -1)[80, 80].tolist() == [200, 30, 30]  # where the hole was


def test_one_and_several_are_proposed_by_id_and_by_place():
    whole = drawing(
        dict.fromkeys(("eye", "log"), RED), eye=polygon(ROUND), log=polygon(SQUARE * [4, 1] + 50)
    )
    parts = drawing(
        dict.fromkeys(("eye_1", "eye_2", "end", "top"), RED), eye_1=polygon(ROUND - 3), eye_2=polygon(ROUND + 9),
        end=polygon(SQUARE * [1.8, 1] + 50), top=polygon(SQUARE * [1.8, 1] + [72, 50]),
    )  # fmt: skip
    found = pair_shapes(whole, parts)
    assert {name: list(names) for name, names in found.splits.items()} == {
        "eye": ["eye_1", "eye_2"], "log": ["end", "top"],
    }  # fmt: skip
    assert found.summary == "paired by place and shape: eye → eye_1 + eye_2, log → end + top"
    merged = pair_shapes(parts, whole)
    assert merged.pairs == {"eye_1": "eye", "eye_2": "eye", "end": "log", "top": "log"}
    assert not (merged.appear or merged.vanish or found.appear or found.vanish)
    eyebrow = drawing(eyebrow=polygon(ROUND), eyelid=polygon(ROUND + 20))
    assert not pair_shapes(drawing(eye=polygon(ROUND)), eyebrow).splits


def test_many_shapes_are_paired_soon_and_rightly():
    places = np.random.default_rng(1).uniform(0, 90, (300, 2))
    a = drawing(**{f"a{k}": polygon(ROUND / 5 + place) for k, place in enumerate(places)})
    b = drawing(**{f"b{k}": polygon(ROUND / 5 + place) for k, place in enumerate(places[::-1])})
    assert pair_shapes(a, b).pairs == {f"a{k}": f"b{299 - k}" for k in range(300)}


# --- pins


def test_pins_go_to_each_other_and_points_between_them_are_even():
    a, b = polygon(SQUARE * 4), polygon(ROUND * 4)
    pins = Pins(np.array([[40, 40], [0, 0.0]]), np.array([[20, 0], [20, 40.0]]))
    first, second = match_curves(a, b, 64, pins=pins)
    for k in range(2):
        row = np.hypot(*(first - pins.first[k]).T).argmin()
        np.testing.assert_allclose(first[row], pins.first[k], atol=1e-9)
        np.testing.assert_allclose(second[row], pins.second[k], atol=0.2)
    steps = np.hypot(*np.diff(second, axis=0).T)
    assert steps.max() / steps.min() < 1.2
    turned = polygon(b.points[::-1])  # the direction in which it is drawn does not matter
    np.testing.assert_allclose(match_curves(a, turned, 64, pins=pins)[1], second, atol=1e-9)
    line, other = (Curve(np.array([[0, y], [30, y], [60.0, y]]), False) for y in (0, 9))
    ends = Pins(np.array([[0, 0], [20, 0.0]]), np.array([[60, 9], [30, 9.0]]))
    one, two = match_curves(line, other, 31, pins=ends)
    assert two[0].tolist() == [60, 9] and two[np.flatnonzero(one[:, 0] == 20)[0], 0] == 30
    three = [[0, 0], [40, 0], [40, 40]]
    with pytest.raises(FinloopError, match="3 pins that do not follow each other"):
        match_curves(
            a, b, 64, pins=Pins(np.array(three), np.array([[0, 20], [20, 40], [40, 20.0]]))
        )


def test_pins_of_a_file_reach_the_morph_and_wrong_ones_are_refused(tmp_path):
    path = tmp_path / "pairs.yaml"
    a = drawing(box=[polygon(SQUARE * 4), polygon(SQUARE + 10)], hat=polygon(SQUARE + 80))
    b = Drawing(
        {"tin": polygon(ROUND * 8), "tin#2": polygon(ROUND * 2 + 30), "hat": polygon(SQUARE + 170)},
        200,
        200,
    )
    path.write_text("pairs: {box: tin}\npins: {box: [[[0, 0], [80, 40]], [[10, 10], [40, 30]]]}")
    for method in ("linear", "fold_free"):
        done = morph_drawings(*match_drawings(a, b, path)[:2], method, 9, 64)
        assert not (method == "fold_free" and done.count_fold_frames())
        for layer, pin in (("box", ([0, 0], [40, 20])), ("box#2", ([10, 10], [20, 15]))):
            np.testing.assert_allclose(done.layers[layer][[0, -1], 0], pin, atol=0.1)
    for text, said in (
        ("pins: {nose: [[[0, 0], [1, 1]]]}", "pins of 'nose'"),
        ("vanish: [hat]\npins: {hat: [[[0, 0], [1, 1]]]}", "pins of 'hat'"),
        ("pairs: {box: tin}\npins: {box: [[[0, 0], [40, 30]]]}", "contours that do not correspond"),
    ):
        path.write_text(text)
        with pytest.raises(FinloopError, match=said):
            morph_drawings(*match_drawings(a, b, path)[:2], "fold_free", 3, 64)
    path.write_text("pairs: {a: [b, c]}")
    assert load_pairing(path).splits == {"a": ["b", "c"]}


# --- open and closed parts of one shape


@pytest.mark.parametrize("method", ["linear", "fold_free"])
def test_open_and_closed_parts_of_one_path_go_to_their_kind(method):
    no_fill = Paint(None, (0, 0, 0), 1.0, 1.0, 2.0)
    whisker = Curve(np.array([[70, 20], [90, 15.0]]), False)
    second = Curve(whisker.points + [0, 20], False)
    a = drawing(
        {"cat": no_fill, "tail": no_fill}, cat=[whisker, polygon(ROUND * 4 + 20)], tail=second
    )
    b = drawing({"cat": no_fill, "tail": no_fill},
                cat=[polygon(ROUND * 5 + 10), whisker, second, polygon(SQUARE)], tail=second)  # fmt: skip
    done = morph_drawings(*match_drawings(a, b)[:2], method, 9, 64)
    assert list(done.layers) == ["cat", "cat-2", "cat-3", "cat-4", "tail"]
    assert [*done.closed.values()] == [True, True, False, False, False]
    for frame, wanted in ((0, a), (-1, b)):  # whisker and head are cut into two
        off = abs(picture(done, frame).astype(int) - picture(wanted)).max(axis=2) > 90
        assert off.mean() < 3e-3
    back = morph_drawings(*match_drawings(b, a)[:2], method, 9, 64)
    assert sorted(back.closed.values()) == sorted(done.closed.values())


def test_a_part_without_a_partner_of_its_kind_vanishes_or_appears():
    line, ring = Curve(np.array([[70, 20], [90, 15.0]]), False), polygon(ROUND * 4)
    first = drawing(a=[ring, line])
    one, other = match_drawings(first, drawing(a=ring))[:2]
    assert list(one.curves) == ["a", "a-2"]
    assert np.ptp(other.curves["a-2"].points, axis=0).max() < 0.1  # as small as a point
    # only lines, only regions: the nearest close, the others vanish
    one, other = match_drawings(drawing(a=line), drawing(a=[ring, polygon(SQUARE + 80)]))[:2]
    kinds = [(one.curves[name].closed, other.curves[name].closed) for name in one.curves]
    assert sorted(kinds) == [(False, True), (True, True)]
    filled = drawing({"a": RED}, a=[ring, Curve(np.array([[15, 15], [20, 25.0]]), False)])
    with pytest.raises(FinloopError, match="'a': a filled shape with an open contour"):
        match_drawings(filled, drawing(a=ring))
    crossing = drawing(a=[ring, polygon(ROUND * 4 + 3), line])
    with pytest.raises(FinloopError, match="shape 'a': a region whose contours meet"):
        match_drawings(crossing, drawing(a=ring))
    # drawings may share curves; parts have the ids of the several
    for one, other in (
        (drawing(a=[ring, line]), drawing(b=line, c=ring)),
        (drawing(a=ring), drawing(b=line, c=ring)),
    ):
        one, other = pair_drawings(one, other, Pairing({}, splits={"a": ["b", "c"]}))
        assert set(one.curves) == set(other.curves) == {"b", "c"}


def test_pins_of_pieces_and_of_a_line_that_closes(tmp_path):
    path = tmp_path / "pairs.yaml"
    a = drawing(
        eye=polygon(SQUARE * [6, 2] + 20), mouth=Curve(np.array([[20, 70], [80, 70.0]]), False)
    )
    b = drawing(left=polygon(ROUND * 2 + 10), right=polygon(ROUND * 2 + [60, 10]),
                mouth=polygon(SQUARE * 2 + [40, 70]))  # fmt: skip
    path.write_text(
        "pairs: {eye: [left, right]}\n"
        "pins: {eye: [[[20, 20], [20, 10]], [[80, 40], [70, 30]]],"
        " mouth: [[[35, 70], [50, 70]], [[65, 70], [50, 90]]]}"
    )
    done = morph_drawings(*match_drawings(a, b, path)[:2], "fold_free", 9, 96)
    assert not done.count_fold_frames() and not done.closed["mouth"]
    for layer, (one, other) in (
        ("left", ((20, 20), (20, 10))), ("right", ((80, 40), (70, 30))),
        ("mouth", ((35, 70), (50, 70))), ("mouth", ((65, 70), (50, 90))),
    ):  # fmt: skip
        row = np.hypot(*(done.layers[layer][0] - one).T).argmin()
        assert np.hypot(*(done.layers[layer][0, row] - one)) < 1
        assert np.hypot(*(done.layers[layer][-1, row] - other)) < 1
    turned = drawing(mouth=polygon(b.curves["mouth"].points[::-1]))
    pin = Pins(np.array([[35, 70.0]]), np.array([[50, 70.0]]))
    for ring in (b.curves["mouth"], turned.curves["mouth"]):
        line, cut, is_closed = match_any_curves(a.curves["mouth"], ring, 61, pins=pin)
        assert not is_closed and line[15].tolist() == pytest.approx([35, 70])
        assert cut[15].tolist() == pytest.approx([50, 70], abs=0.1)
    same = Pins(np.array([[20, 70], [80, 70.0]]), np.array([[50, 70], [50, 90.0]]))
    with pytest.raises(FinloopError, match="pins that do not follow each other"):
        match_any_curves(a.curves["mouth"], ring, 61, pins=same)


def test_linear_is_advised_only_where_it_works():
    crossing = [polygon(SQUARE), polygon(SQUARE + 5)]
    with pytest.raises(FinloopError) as error:
        match_drawings(drawing(a=crossing), drawing(a=polygon(SQUARE)))
    assert "linear" not in error.value.do
    ends = match_drawings(drawing(a=crossing), drawing(a=[polygon(SQUARE), polygon(SQUARE + 20)]))
    with pytest.raises(FinloopError) as error:
        morph_drawings(*ends[:2], "fold_free", 3, 32)
    assert "linear" in error.value.do
    assert list(morph_drawings(*ends[:2], "linear", 3, 32).layers) == ["a", "a#2"]
