"""Pale fins belong to a cut-out, shadows do not, and no measure changes by either."""

from functools import cache

import cv2
import numpy as np
import pytest

from finloop.base.cutout import Cutout
from finloop.base.settings import settings
from finloop.extract.background import Scene
from finloop.extract.fins import PalePixels, add_fins_to_alpha
from finloop.extract.samples import measure_scene_and_fish
from finloop.extract.segment import SilhouetteEdge, find_silhouettes, measure_fish

SIZE = 240, 320
WHOLE = np.full(SIZE, 255, np.uint8)
TONE, BODY = 180, 80  # of the tank, of the fish
LONG, WIDE = 40.0, 9.0
FIN = 16.0  # px that the fin reaches beyond the body
FINE = 4  # parts of a pixel


def tank():
    """A tank whose floor has soft patches."""
    rough = cv2.GaussianBlur(np.random.default_rng(0).standard_normal(SIZE), (0, 0), 5)
    return np.clip(TONE + 5 * rough / np.abs(rough).max(), 0, 255).astype(np.uint8)


def pixel_shares(corners):
    """The share (h, w) of each pixel inside a polygon (n, 2) x, y px."""
    big = np.zeros((SIZE[0] * FINE, SIZE[1] * FINE), np.uint8)
    fine = np.round((np.asarray(corners) + 0.5) * FINE - 0.5).astype(np.int32)
    cv2.fillPoly(big, [fine], 255)
    return cv2.resize(big, SIZE[::-1], interpolation=cv2.INTER_AREA) / 255


def fish_at(x, y, deg):
    """The body and the tail fin (h, w) of a fish whose head points to `deg`, 0 = to the right."""
    turn = np.radians(deg)
    ahead, left = np.array([np.cos(turn), -np.sin(turn)]), np.array([-np.sin(turn), -np.cos(turn)])
    s = np.linspace(-1, 1, 41)
    half = WIDE * np.sqrt(1 - s**2) * (0.6 + 0.4 * s)  # the thicker half is the front
    flanks = [(x, y) + LONG * a * ahead + w * left for a, w in zip(s, half, strict=True)]
    others = [(x, y) + LONG * a * ahead - w * left for a, w in zip(s, half, strict=True)]
    root, tip = LONG - 6, LONG + FIN
    fin = [(x, y) - a * ahead + w * left for a, w in ((root, 2), (tip, 5), (tip, -5), (root, -2))]
    return pixel_shares(flanks + others[::-1]), pixel_shares(fin)


def film(fishes, fin=0.0, shadow=0.0, tone=BODY, fin_tone=BODY, gloom=0.0):
    """A frame with fish; `fin`, `shadow`, `gloom`: how opaque these are.

    A shadow falls 6, 8 px aside. Gloom is all around a fish.
    """
    picture = tank().astype(float)
    for place in fishes:
        body, tail = fish_at(*place)
        fallen = fish_at(place[0] + 6, place[1] + 8, place[2])[0] * shadow
        picture *= 1 - 0.5 * cv2.GaussianBlur(fallen, (0, 0), 1.5)
        picture *= 1 - gloom * cv2.GaussianBlur(body, (0, 0), 6)
        for share, ink in ((tail * fin, fin_tone), (body, tone)):
            picture = share * ink + (1 - share) * picture
    return picture.round().astype(np.uint8)


def scene(polarity="dark"):
    return Scene(tank(), polarity, 1.2, 6.0)


def measure_patches(frame, fins, polarity="dark"):
    patches = find_silhouettes(frame, scene(polarity), WHOLE, 60.0, SilhouetteEdge(0.4, 0.45, fins))
    return [measure_fish(one, frame, scene(polarity), 33) for one in patches]


def over_the_tank(fish):
    """The cut-out in its place in the tank."""
    picture, (h, w) = tank().astype(int), fish.cutout.shape[:2]
    back = Cutout(0, 0, fish.x0, fish.y0, fish.cutout).blend_over(tank())
    picture[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w] = back
    return picture


@cache
def wheel(**how):
    """Frames with a fish in the middle that heads everywhere."""
    places = [(160 + 30 * np.cos(k), 120 + 30 * np.sin(k), 47.0 * k) for k in range(16)]
    return [film([place], **how) for place in places]


@pytest.mark.parametrize("deg", [0, 70, 200])
def test_the_cutout_with_its_fin_is_the_film_and_no_measure_changes(deg):
    frame = film([(160, 120, deg)], fin=0.2)
    (shown,), (without,) = measure_patches(frame, "all"), measure_patches(frame, "none")
    body, tail = fish_at(160, 120, deg)
    fin = (tail == 1) & (body == 0)
    assert fin.sum() > 100
    assert np.abs(over_the_tank(shown) - frame)[fin].mean() < 2
    assert np.abs(over_the_tank(without) - frame)[fin].mean() > 5
    assert shown.cutout.size > without.cutout.size
    assert np.array_equal(shown.outline_px, without.outline_px)
    assert np.array_equal(shown.backbone.points_px, without.backbone.points_px)
    assert (shown.x_px, shown.y_px, shown.area_px) == (without.x_px, without.y_px, without.area_px)


def test_a_fin_is_as_opaque_as_it_is_paler_than_the_fish_over_any_tank():
    (fish,) = measure_patches(film([(160, 120, 0)], fin=0.2), "all")
    alpha = fish.cutout[120 - fish.y0 - 1 : 120 - fish.y0 + 2, : int(FIN) - 4, -1] / 255
    assert alpha.max() < 0.35
    assert np.median(alpha[:, 4:]) == pytest.approx(0.2, abs=0.05)
    other = np.full(SIZE, 120, np.uint8)
    row = Cutout(0, 0, fish.x0, fish.y0, fish.cutout).blend_over(other)[120 - fish.y0]
    assert np.median(row[6:12]) == pytest.approx(0.2 * BODY + 0.8 * 120, abs=4)


def test_a_pale_pixel_belongs_to_the_nearest_fish():
    frame = film([(100, 120, 0), (100 - 2 * LONG - FIN - 1, 120, 0)], fin=0.2)
    both = measure_patches(frame, "all")
    assert len(both) == 2
    whole = np.zeros(SIZE, int)
    for fish in both:
        h, w = fish.cutout.shape[:2]
        whole[fish.y0 : fish.y0 + h, fish.x0 : fish.x0 + w] += fish.cutout[..., -1] > 0
    assert whole.max() == 1
    assert whole[120, 48:58].all()  # the fin between them


def test_what_is_far_from_the_silhouette_is_no_part_of_the_fish():
    frame = film([(220, 120, 0)])
    frame[118:122, 20:185] -= 15  # a pale stalk, thrice as long as a fin may be
    (fish,) = measure_patches(frame, "all")
    behind = 220 - LONG - fish.x0
    assert 0.25 * 2 * LONG < behind < 0.45 * 2 * LONG


@pytest.mark.parametrize(
    ("parameter", "how", "fins"),
    [
        ("auto", {"fin": 0.2}, "all"), ("auto", {"shadow": 0.4}, "none"),
        ("auto", {"gloom": 0.3}, "none"), ("auto", {}, "all"),
        ("keep", {"shadow": 0.4}, "all"), ("drop", {"fin": 0.2}, "none"),
    ],
)  # fmt: skip
def test_fins_are_told_from_shadows_and_gloom_by_many_fish_or_by_the_parameter(
    parameter, how, fins
):
    own = settings("extract", fins=parameter)
    assert measure_scene_and_fish(wheel(**how), WHOLE, own)[1].fins == fins


def test_a_fin_fades_where_noise_begins():
    field = np.arange(256, dtype=np.uint8)[None, :]
    none, mask = np.zeros((1, 256), np.uint8), np.ones((1, 256), bool)
    alpha = add_fins_to_alpha(none, (0, 0), PalePixels(0, 0, mask, field), (100.0, 6.0))[0][0]
    assert not alpha[:7].any()
    assert np.all(np.diff(alpha.astype(int)) >= 0)
    assert np.abs(alpha[12:100] - 2.55 * field[0, 12:100]).max() <= 1


def test_bright_fins_are_kept_where_the_shadow_is_dropped():
    frames = wheel(fin=0.2, fin_tone=255, shadow=0.4, tone=255)
    for frame, k in zip(frames, range(16), strict=True):  # a dark patch on bright skin
        middle = round(160 + 30 * np.cos(k)), round(120 + 30 * np.sin(k))
        cv2.circle(frame, middle, 5, 20, cv2.FILLED)
    own = settings("extract", polarity="both")
    found_scene, typical = measure_scene_and_fish(frames, WHOLE, own)
    assert found_scene.polarity == "both"
    assert typical.fins == "brighter"


def test_a_film_in_which_all_head_the_same_way_keeps_what_is_pale():
    frames = [film([(140 + 3 * k, 120, 0)], fin=0.2) for k in range(16)]
    own = settings("extract", background="threshold")
    assert measure_scene_and_fish(frames, WHOLE, own)[1].fins == "all"


def test_a_fin_at_the_edge_of_what_was_looked_at():
    mask = np.zeros((6, 8), bool)
    mask[:, :3] = True
    field = np.full((6, 8), 20, np.uint8)
    alpha = np.full((2, 2), 255, np.uint8)
    pale = PalePixels(10, 10, mask, field)
    whole, corner = add_fins_to_alpha(alpha, (14, 12), pale, (100.0, 6.0))
    assert corner == (10, 10) and whole.shape == (6, 6)
    assert np.array_equal(whole[2:4, 4:], alpha)
    assert np.all(whole[:, :3] == 51) and np.all(whole[:2, 3:] == 0)
