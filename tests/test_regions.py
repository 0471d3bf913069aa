"""Masks and traces on disk: round trips, and what is wrong with them in clear words."""

import cv2
import numpy as np
import pytest

from finloop.base.drawing import Drawing
from finloop.base.errors import FinloopError
from finloop.curve.contour import Curve, signed_area
from finloop.gait.limbs import BORDER, EMPTY, check_traced_contour, region_contour
from finloop.io.regions import MOST_FRAMES, load_regions, save_masks


def square(x, size=12, shape=(40, 50)):
    mask = np.zeros(shape, bool)
    mask[10 : 10 + size, x : x + size] = True
    return mask


def save_traces(folder, drawings):
    """As a drawing program does: an SVG a frame, a path a limb."""
    folder.mkdir(exist_ok=True)
    for k, drawing in enumerate(drawings):
        paths = "".join(
            f'<path id="{name}" d="M{" L".join(f"{x},{y}" for x, y in curve.points)}'
            f'{"Z" if curve.closed else ""}"/>'
            for name, curve in drawing.curves.items()
        )
        box = f'viewBox="0 0 {drawing.width} {drawing.height}"'
        text = f'<svg xmlns="http://www.w3.org/2000/svg" {box}>{paths}</svg>'
        (folder / f"{k:04}.svg").write_text(text, encoding="utf-8")


@pytest.fixture
def masks(tmp_path):
    save_masks(tmp_path / "r", [{"leg": square(5 + k), "body": square(8)} for k in range(3)])
    return tmp_path / "r"


def test_masks_come_back_as_their_contours(masks):
    found = load_regions(masks, region_contour, check_traced_contour).frames
    assert len(found) == 3
    for k, frame in enumerate(found):
        assert frame["leg"].points == pytest.approx(region_contour(square(5 + k)).points)
    assert not list(masks.parent.glob(".*"))


def test_frames_are_numbered_by_their_names_and_what_lacks_is_said(masks):
    (masks / "leg/0001.png").rename(masks / "leg/shot_2_0012.png")
    cv2.imwrite(str(masks / "leg/0009.png"), np.zeros((40, 50), np.uint8))
    cut = square(0).astype(np.uint8) * 255
    cv2.imwrite(str(masks / "leg/0010.png"), cv2.merge([cut, cut, cut]))
    found = load_regions(masks, region_contour, check_traced_contour).frames
    assert len(found) == 13
    assert [found[k]["leg"] for k in (1, 9, 10)] == [None, EMPTY, BORDER]
    assert isinstance(found[12]["leg"], Curve)
    assert found[12]["body"] is None


def test_the_first_number_there_is_frame_0(tmp_path):
    for k in (7, 8):
        for name in ("leg", "body"):
            (tmp_path / name).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / name / f"{k}.png"), square(k).astype(np.uint8) * 255)
    found, first = load_regions(tmp_path, region_contour, check_traced_contour)
    assert first == 7
    assert [frame["leg"].points[:, 0].min() for frame in found] == pytest.approx([6.5, 7.5])


def test_traces_come_back(tmp_path):
    leg = region_contour(square(7))
    body = Curve(leg.points * [1, 2], True)
    over = Curve(leg.points - [20, 0], True)
    save_traces(
        tmp_path / "t",
        [Drawing({"leg": leg, "body": body}, 50, 80), Drawing({"leg": over}, 50, 80)],
    )
    found = load_regions(tmp_path / "t", region_contour, check_traced_contour).frames
    assert found[0]["leg"].points == pytest.approx(leg.points, abs=1e-3)
    assert signed_area(found[0]["body"]) == pytest.approx(2 * signed_area(leg), rel=1e-3)
    assert found[1] == {"leg": BORDER, "body": None}


def test_masks_of_other_sizes_or_none_are_refused(masks):
    cv2.imwrite(str(masks / "leg/0001.png"), np.full((40, 51), 255, np.uint8))
    with pytest.raises(FinloopError, match="51×40"):
        load_regions(masks, region_contour, check_traced_contour)
    (masks / "leg/0001.png").write_bytes(b"no picture")
    with pytest.raises(FinloopError, match="cannot be read"):
        load_regions(masks, region_contour, check_traced_contour)


def test_traces_of_other_sizes_and_open_paths_are_refused(tmp_path):
    leg = region_contour(square(7))
    save_traces(tmp_path, [Drawing({"leg": leg}, 50, 80), Drawing({"leg": leg}, 50, 90)])
    with pytest.raises(FinloopError, match="50×90"):
        load_regions(tmp_path, region_contour, check_traced_contour)
    save_traces(tmp_path, [Drawing({"leg": Curve(leg.points, False)}, 50, 80)])
    with pytest.raises(FinloopError, match="open"):
        load_regions(tmp_path, region_contour, check_traced_contour)


def test_folders_that_hold_no_regions_are_refused(masks, tmp_path):
    with pytest.raises(FinloopError, match="no folder"):
        load_regions(tmp_path / "nowhere", region_contour, check_traced_contour)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FinloopError, match="0 SVG files"):
        load_regions(tmp_path / "empty", region_contour, check_traced_contour)
    (masks / "0000.svg").write_text("<svg/>", encoding="utf-8")
    with pytest.raises(FinloopError, match="keep one kind"):
        load_regions(masks, region_contour, check_traced_contour)


def test_masks_of_ones_are_told(masks):
    for path in masks.glob("leg/*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) // 255)
    with pytest.raises(FinloopError, match="no mask of leg has a pixel brighter than 1 of 255"):
        load_regions(masks, region_contour, check_traced_contour)


@pytest.mark.parametrize(("name", "word"), [("a.png", "no number"), ("x1.png", "another has")])
def test_names_must_tell_the_frame(masks, name, word):
    (masks / "leg/0002.png").rename(masks / "leg" / name)
    with pytest.raises(FinloopError, match=word):
        load_regions(masks, region_contour, check_traced_contour)


@pytest.mark.parametrize("kind", ["masks", "traces"])
def test_numbers_that_no_film_reaches_are_refused_by_name(masks, tmp_path, kind):
    last, late, folder = masks / "leg/0002.png", f"leg_{10**12}", masks
    if kind == "traces":
        leg, folder = Curve(np.array([[5.0, 5.0], [9.0, 5.0], [9.0, 9.0]]), True), tmp_path / "t"
        save_traces(folder, [Drawing({"leg": leg}, 50, 40)] * 3)
        last = folder / "0002.svg"
    odd = last.with_name(f"{late}{last.suffix}")
    odd.write_bytes(last.read_bytes())
    with pytest.raises(FinloopError, match=rf"{last} and {odd}, {10**12 - 3} frames have no"):
        load_regions(folder, region_contour, check_traced_contour)
    odd.rename(odd.with_stem(str(MOST_FRAMES - 1)))  # as long as a film of limbs may be
    assert len(load_regions(folder, region_contour, check_traced_contour).frames) == MOST_FRAMES
