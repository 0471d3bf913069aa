"""Thin parts of an animal that are paler than its body: they belong to it in every frame, or none."""

import cv2
import numpy as np
import pytest

from finloop.base.settings import settings
from finloop.extract.backbone import trace_backbone
from finloop.extract.samples import measure_scene_and_fish
from finloop.extract.segment import THIN_EDGE, SilhouetteEdge, add_thin_parts, find_silhouettes
from finloop.extract.settings import ExtractSettings

SIZE, TANK, BODY = (160, 240), 200, 100  # grey levels; the body differs by 100
WHOLE = np.full(SIZE, 255, np.uint8)


def animal(tail: float, x: int = 90, gloom: float = 0.0) -> np.ndarray:
    """A picture of a body, 60 x 28 px, with a tail of 50 px that differs by so many grey levels."""
    change = np.zeros(SIZE, np.float32)
    if gloom:
        cv2.ellipse(change, (x, 80), (42, 26), 0, 0, 360, gloom, -1, cv2.LINE_AA)
    line = np.array([[x + 28, 80], [x + 45, 84], [x + 62, 80], [x + 78, 70]])
    cv2.polylines(change, [line], False, tail, 3, cv2.LINE_AA)
    cv2.ellipse(change, (x, 80), (30, 14), 0, 0, 360, BODY, -1, cv2.LINE_AA)
    return np.round(change).astype(np.uint8)


def silhouette(change: np.ndarray) -> np.ndarray:
    """The silhouette that ends at 0.4 of the body's contrast, with its thin parts."""
    above = np.where(change > 0.4 * BODY, 255, 0).astype(np.uint8)
    return add_thin_parts(above, change, int(THIN_EDGE * BODY))


def test_a_pale_tail_belongs_to_the_body():
    change = animal(tail=30)
    assert not (change[:, 125:] > 0.4 * BODY).any()  # beyond the silhouette's edge
    found = silhouette(change)
    assert set(np.unique(found)) == {0, 255}
    assert found[70, 167] == 255 and found[80, 90] == 255
    assert ((found > 0) <= (change > THIN_EDGE * BODY)).all()


def test_what_is_pale_and_wide_or_apart_does_not():
    change = animal(tail=30, gloom=25)
    found = silhouette(change)
    plain = change > 0.4 * BODY
    near = cv2.dilate(plain.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    ring = (change > 20) & ~near
    ring[:, 115:] = False  # where the tail leaves it
    assert ring.sum() > 500 and not (found[ring] > 0).any()
    change[20:24, 20:80] = 30  # a stick elsewhere
    assert not silhouette(change)[20:24, 20:80].any()
    assert np.array_equal(silhouette(animal(tail=10)), np.where(animal(tail=10) > 40, 255, 0))


@pytest.mark.parametrize("tail", [25, 38, 60])
def test_the_backbone_is_as_long_however_pale_the_tail(tail, monkeypatch):
    frame = TANK - animal(tail)
    how = settings("extract")
    sample = [TANK - animal(40, x) for x in range(40, 150, 5)]
    monkeypatch.setattr(ExtractSettings, "thin", "keep")
    scene, typical = measure_scene_and_fish(sample, WHOLE, how)
    assert typical.thin
    lengths = {}
    for thin in (False, True):
        ends = SilhouetteEdge(how.outline_contrast_ratio, how.shadow, "none", thin)
        (one,) = find_silhouettes(frame, scene, WHOLE, 60, ends)
        line = trace_backbone(one.mask, one.field, 33, scene.threshold)
        assert line is not None
        lengths[thin] = line.length_px
    assert lengths[True] == pytest.approx(110, rel=0.06)
    assert lengths[False] < 75 or tail == 60


def test_thin_parts_are_looked_for_where_lengths_differ_without_them(monkeypatch):
    rng = np.random.default_rng(0)
    how = settings("extract")
    places = rng.permutation(np.arange(40, 150, 4))
    flickers = [TANK - animal(float(rng.uniform(28, 52)), int(x)) for x in places]
    steady = [TANK - animal(70, int(x)) for x in places]
    with_thin = measure_scene_and_fish(flickers, WHOLE, how)[1]
    assert with_thin.thin and not measure_scene_and_fish(steady, WHOLE, how)[1].thin
    monkeypatch.setattr(ExtractSettings, "thin", "drop")
    without = measure_scene_and_fish(flickers, WHOLE, how)[1]
    assert not without.thin and with_thin.length_px > without.length_px
