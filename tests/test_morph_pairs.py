"""Which shapes of two drawings become each other, and those without a partner."""

import numpy as np
import pytest
from PIL import ImageColor

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.base.style import Paint
from finloop.curve.contour import Curve
from finloop.morph.layers import morph_drawings
from finloop.morph.pairs import Pairing, load_pairing, pair_drawings, pair_shapes
from finloop.morph.tool import main

SQUARE = np.array([[0, 0], [10, 0], [10, 10], [0, 10]], float)
ROUND = 5 + 5 * np.stack(
    [f(np.linspace(0, 2 * np.pi, 24, endpoint=False)) for f in (np.cos, np.sin)], 1
)
LINE = np.array([[0, 0], [10, 3.0]])


def paint(colour: str) -> Paint:
    """A fill and a line of a colour."""
    rgb = ImageColor.getrgb(colour)[:3]
    return Paint(rgb, rgb, 1.0, 1.0, 1.0)


def drawing(styles=None, **contours) -> Drawing:
    """A drawing of 100 × 100: contours by id, closed but for those whose id begins with line."""
    return Drawing(
        {name: Curve(points, not name.startswith("line")) for name, points in contours.items()},
        100, 100, styles or {},
    )  # fmt: skip


FACE = drawing(left=SQUARE + [20, 20], right=SQUARE + [70, 20], mouth=ROUND * 3 + [40, 60])
OTHER = drawing(
    {"eye": paint("red")}, eye=SQUARE + [22, 20], eye_2=SQUARE + [68, 22], lips=ROUND * 3 + [40, 65]
)


def test_equal_ids_go_together_wherever_they_are():
    swapped = drawing(left=SQUARE + [70, 20], right=SQUARE + [20, 20], mouth=SQUARE)
    found = pair_shapes(FACE, swapped)
    assert found.pairs == {"left": "left", "right": "right", "mouth": "mouth"}
    assert not found.proposed and not found.summary


def test_other_ids_are_paired_by_place_and_shape_and_that_is_said():
    found = pair_shapes(FACE, OTHER)
    assert found.pairs == {"left": "eye", "right": "eye_2", "mouth": "lips"}
    assert found.summary == "paired by place and shape: left → eye, right → eye_2, mouth → lips"
    # at one place, the shape decides
    a = drawing(box=SQUARE + 30, ring=ROUND + 30)
    b = drawing(disc=ROUND + 30, tile=SQUARE + 30)
    assert pair_shapes(a, b).pairs == {"box": "tile", "ring": "disc"}
    # and of one shape at one place, the size
    eye = drawing(white=4 * ROUND, pupil=ROUND + 15)
    other = drawing(small=ROUND + 15, large=4 * ROUND)
    assert pair_shapes(eye, other).pairs == {"white": "large", "pupil": "small"}


def test_a_file_goes_first_and_what_is_left_vanishes_or_appears(tmp_path):
    path = tmp_path / "pairs.yaml"
    path.write_text("pairs: {left: eye_2}\nvanish: [mouth]\n", encoding="utf-8")
    found = pair_shapes(FACE, OTHER, load_pairing(path))
    assert found.pairs == {"left": "eye_2", "right": "eye"}
    assert found.vanish == ["mouth"] and found.appear == ["lips"]
    assert found.summary.endswith("vanish: mouth; appear: lips")


def test_open_and_closed_are_never_proposed_as_a_pair():
    found = pair_shapes(drawing(line_1=LINE), drawing(box=SQUARE))
    assert not found.pairs and found.vanish == ["line_1"] and found.appear == ["box"]


@pytest.mark.parametrize("method", ["linear", "fold_free", "physical"])
def test_what_has_no_partner_grows_from_a_point_in_its_place(method):
    beard = drawing({"beard": paint("brown")}, left=SQUARE + [20, 20], beard=ROUND + [45, 80],
                    right=SQUARE + [70, 20])  # fmt: skip
    pairing = pair_shapes(FACE, beard, Pairing({}, vanish=["mouth"], appear=["beard"]))
    done = morph_drawings(*pair_drawings(FACE, beard, pairing), method, 9, 32)
    assert list(done.layers) == ["left", "beard", "right", "mouth"]  # above what was below it
    extents = {name: np.ptp(stack, axis=1).max(axis=1) for name, stack in done.layers.items()}
    assert extents["beard"][0] < 0.02 and extents["beard"][-1] == pytest.approx(10, rel=0.02)
    assert extents["mouth"][-1] < 0.04 and extents["mouth"][0] == pytest.approx(30, rel=0.02)
    centres = done.layers["beard"].mean(axis=1)
    np.testing.assert_allclose(centres, np.broadcast_to(centres[-1], centres.shape), atol=0.01)
    assert {painted.fill for painted in done.styles["beard"]} == {paint("brown").fill}
    widths = [painted.width for painted in done.styles["beard"]]
    assert widths[0] < 0.01 and widths[-1] == 1.0 and not done.count_fold_frames()


def test_names_and_styles_follow_the_first_drawing():
    b = drawing({"left": paint("blue")}, left=SQUARE + [22, 20])
    pairing = Pairing({"right": "left"}, vanish=["left", "mouth"])
    first, second = pair_drawings(FACE, b, pairing)
    assert list(first.curves) == list(second.curves) == list(FACE.curves)
    assert second.styles == {"right": paint("blue")}
    np.testing.assert_array_equal(second.curves["right"].points, b.curves["left"].points)
    appears = pair_drawings(FACE, b, Pairing({}, vanish=list(FACE.curves), appear=["left"]))
    assert next(iter(appears[0].curves)) == "left-2"  # its id stands for another shape


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (Pairing({"nose": "eye"}), "first drawing: no shape 'nose'"),
        (Pairing({"left": "nose"}), "second drawing: no shape 'nose'"),
        (Pairing({"left": "eye"}, vanish=["left"]), "'left' twice"),
        (Pairing({"left": "eye"}, splits={"right": ["eye", "lips"]}), "'eye' twice"),
        (Pairing({"left": "eye"}, appear=["eye"]), "'eye' twice"),
    ],
)
def test_pairs_that_cannot_be_are_refused(given, said):
    with pytest.raises(FinloopError, match=said):
        pair_shapes(FACE, OTHER, given)


@pytest.mark.parametrize(
    ("text", "said"),
    [("[a, b]", "no keys"), ("pairs: [a]", "pairs are no"), ("pairs: {a: 3}", "pairs are no"),
     ("pairs: {a: [b]}", "pairs are no"), ("pins: {a: [[1, 2]]}", "pins are no"),
     ("pins: {a: [[[1, 2], [3, .nan]]]}", "pins are no"), ("eyes: {a: b}", "it has eyes"), ("vanish: hat", "vanish is no list"), ("{", "cannot be read"),
     ("pairs: {a: b, a: c}", "a key stands twice")],
)  # fmt: skip
def test_a_file_without_pairs_is_refused(tmp_path, text, said):
    path = tmp_path / "pairs.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(FinloopError, match=said):
        load_pairing(path)


def test_the_command_says_what_it_paired(tmp_path, capsys):
    for name, own in (("a", "nose"), ("b", "snout")):
        (tmp_path / f"{name}.svg").write_text(
            '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64">'
            f'<path id="{own}" d="M9 9H60V60z"/></svg>',
            encoding="utf-8",
        )
    given = [str(tmp_path / "a.svg"), str(tmp_path / "b.svg"), "-o", str(tmp_path / "o.json")]
    assert main([*given, "--frames", "3", "--points", "16"]) == 0
    assert "paired by place and shape: nose → snout" in capsys.readouterr().out
    (tmp_path / "p.yaml").write_text("vanish: [nose]\nappear: [snout]", encoding="utf-8")
    assert (
        main([*given, "--frames", "3", "--points", "16", "--pairs", str(tmp_path / "p.yaml")]) == 0
    )
    assert "vanish: nose; appear: snout" in capsys.readouterr().out
