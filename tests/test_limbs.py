"""Limbs: cut off masks drawn here; the drawn insect's truth, and its heading as extraction sees it."""

import cv2
import numpy as np
import pytest
from toy_insect import WalkerFilm, walker_frames, walker_truth

from finloop.base.settings import settings
from finloop.extract.backbone import cut_limbs, trace_backbone
from finloop.extract.film import Detector, link_tracks, track_table_rows
from finloop.extract.samples import measure_scene_and_fish
from finloop.features.table import measure_features, wrap_deg

SIZE = (120, 180)  # of the pictures that masks are drawn into
BODY = ((90, 60), (40, 16))  # centre and half axes of an ellipse, px
LEGS = [((70, 60), (60, 25)), ((90, 60), (95, 22)), ((80, 60), (75, 98)), ((100, 60), (112, 96))]


def draw(ellipses=(BODY,), lines=(), width=4):
    picture = np.zeros(SIZE, np.uint8)
    for centre, axes in ellipses:
        cv2.ellipse(picture, centre, axes, 0, 0, 360, 1, cv2.FILLED)
    for start, stop in lines:
        cv2.line(picture, start, stop, 1, width)
    return picture.view(bool)


# -- what is cut off -------------------------------------------------------------------------------


def test_legs_are_cut_off_and_counted():
    body, whole = draw(), draw(lines=LEGS)
    trunk, count = cut_limbs(whole)
    assert count == len(LEGS)
    assert not (trunk & ~whole).any()
    near = cv2.dilate(body.view(np.uint8), np.ones((13, 13), np.uint8)) > 0
    assert not (trunk & ~near).any()  # stumps at most
    assert (trunk & body).sum() > 0.97 * body.sum()


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_silhouette_loses_the_same(turns):
    whole = draw(lines=LEGS)
    trunk, count = cut_limbs(whole)
    turned, count_of_turned = cut_limbs(np.ascontiguousarray(np.rot90(whole, turns)))
    assert count_of_turned == count
    # OpenCV's discs are not quite the same both ways.
    assert (turned != np.rot90(trunk, turns)).sum() < 0.01 * trunk.sum()


def test_a_tail_that_tapers_stays():
    picture = draw().astype(np.uint8)
    tail = np.array([[100, 45], [175, 59], [175, 61], [100, 75]])
    cv2.fillPoly(picture, [tail], 1)
    trunk, count = cut_limbs(picture.view(bool))
    assert count == 0 and trunk[60, 170]


def test_a_waist_stays_and_holds_the_body_together():
    pieces = [((50, 60), (30, 16)), ((125, 60), (30, 16))]
    whole = draw(pieces, [((60, 60), (115, 60)), *LEGS[2:]])
    trunk, count = cut_limbs(whole)
    assert trunk[60, 25] and trunk[60, 88] and trunk[60, 150]
    assert count <= len(LEGS[2:])


def test_a_body_without_thin_parts_keeps_its_shape():
    body = draw()
    trunk, count = cut_limbs(body)
    assert count == 0 and (trunk & body).sum() > 0.99 * body.sum()
    one = np.zeros((5, 5), bool)
    one[2, 2] = True
    assert cut_limbs(one)[1] == 0 and cut_limbs(one)[0][2, 2]


def test_a_leg_at_the_head_does_not_bend_the_backbone():
    whole = draw(lines=[*LEGS, ((60, 60), (25, 40))])
    field = whole * np.uint8(100)

    def off_axis(limbs):
        line = trace_backbone(whole, field, 33, 6.0, limbs)
        assert line is not None
        return np.abs(line.points_px[:, 1] - 60).max()

    assert off_axis(limbs=False) > 8
    assert off_axis(limbs=True) < 3


@pytest.mark.parametrize(("x", "radius"), [(104, 9), (108, 9), (112, 6)])
def test_the_stump_of_a_leg_does_not_bend_a_stout_body(x, radius):
    whole = draw([((90, 60), (36, 17)), ((x, 46), (radius, radius))])
    line = trace_backbone(whole, whole * np.uint8(100), 33, 6.0, limbs=True)
    assert line is not None
    assert np.abs(line.points_px[:, 1] - 60).max() < 1.5  # 2.4-3.7 px with a fish's smoothing


def test_a_slender_body_keeps_its_bends():
    x = np.arange(20, 160)
    middle = 60 + 14 * np.sin(2 * np.pi * (x - 20) / 140)
    wave = np.zeros(SIZE, np.uint8)
    cv2.polylines(wave, [np.stack([x, middle.round()], 1).astype(np.int32)], False, 1, 13)
    whole = wave.view(bool)
    line = trace_backbone(whole, whole * np.uint8(100), 33, 6.0, limbs=True)
    assert line is not None
    inner = line.points_px[4:-4]
    assert np.abs(inner[:, 1] - np.interp(inner[:, 0], x, middle)).max() < 2


# -- the drawn insect ------------------------------------------------------------------------------


def test_the_insect_walks_ahead_along_its_axis_and_stays_in_the_picture():
    film = WalkerFilm()
    truth = walker_truth(film)
    place = truth[["x_px", "y_px"]].to_numpy()
    step = place[2:] - place[:-2]
    travel_deg = np.degrees(np.arctan2(-step[:, 1], step[:, 0]))
    assert np.abs(wrap_deg(truth.heading_deg.to_numpy()[1:-1] - travel_deg)).max() < 0.5
    axis = truth[["head_x_px", "head_y_px"]].to_numpy() - truth[["tail_x_px", "tail_y_px"]]
    assert np.allclose(np.hypot(*axis.to_numpy().T), film.body_length_px)
    for frame in list(walker_frames(film))[::20]:
        dark = frame < 150
        assert dark.any() and not (dark[[0, -1]].any() or dark[:, [0, -1]].any())


def heading_errors(film, limbs=None):
    """Errors of the insect's heading, degrees, in each frame, and whether it was seen to have limbs."""
    frames, how = list(walker_frames(film)), settings("extract")
    arena = np.full(frames[0].shape, 255, np.uint8)
    scene, typical = measure_scene_and_fish(frames[::3], arena, how)
    seen = typical.limbs if limbs is None else limbs
    detector = Detector(arena, typical._replace(limbs=seen), how)
    found = link_tracks([detector(frame, scene) for frame in frames], typical, how)
    tracks = track_table_rows([fish for _, listed in found for fish in listed])
    features, _ = measure_features(tracks, film.frame_rate_hz, settings("features"))
    assert len(features) == film.frames
    true = walker_truth(film)["heading_deg"].to_numpy()
    return np.abs(wrap_deg(features["heading_deg"].to_numpy() - true)), typical.limbs


@pytest.mark.parametrize(("length_px", "leg_width"), [(60, 0.03), (30, 0.05), (20, 0.05)])
def test_the_heading_is_the_axis_of_a_body_with_legs_and_antennae(length_px, leg_width):
    film = WalkerFilm(body_length_px=length_px, leg_width=leg_width)
    error_deg, has_limbs = heading_errors(film)
    assert has_limbs
    assert np.median(error_deg) < 3
    assert np.quantile(error_deg, 0.9) < 6


def test_with_its_limbs_kept_the_heading_of_the_insect_is_along_a_leg():
    assert np.median(heading_errors(WalkerFilm(body_length_px=30), limbs=False)[0]) > 10


def test_a_fish_with_a_thin_tail_has_no_limbs():
    frames = []
    for x in range(40, 115, 5):
        mask = draw([((x, 60), (25, 12))], [((x, 60), (x + 55, 60 + x % 20 - 10))], width=3)
        frames.append(np.where(mask, 60, 200).astype(np.uint8))
    arena = np.full(SIZE, 255, np.uint8)
    assert not measure_scene_and_fish(frames, arena, settings("extract"))[1].limbs
