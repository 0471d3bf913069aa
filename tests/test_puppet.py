"""The puppet: a frame drawn in any pose, by laws on a body that is painted with its own places."""

import cv2
import numpy as np
import pandas as pd
import pytest

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.puppet import (
    Pose,
    PoseShapes,
    TailParameters,
    align_body_and_tail,
    change_in_pose,
    draw_in_pose,
    pose_cutout,
    poses_from_features,
)
from finloop.puppet.pose import backbone_directions, backbone_steps, mirror_posture

STEPS, SIZE, LENGTH, WIDE = 32, (121, 121), 60.0, 7.0
MIDDLE = (60.0, 60.0, 0.0, LENGTH)


def pose(turn=0.0, place=MIDDLE, count=STEPS, length=1.0):
    """A backbone bent into an arc, `turn` radians in all; its middle step heads ahead."""
    way = turn * (0.5 - (np.arange(count) + 0.5) / count)
    posture = np.concatenate([[0, 0], way, np.full(count, length / count)])
    straight = Pose(*(np.float64(part) for part in place), posture)
    middle = straight.backbone_px().mean(0) - (place[0], place[1])
    cos, sin = np.cos(place[2]), np.sin(place[2])
    ahead, aside = cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1]
    posture[:2] = -ahead / place[3], aside / place[3]
    return Pose(*(np.float64(part) for part in place), posture)


def soft(inside):
    """Alpha 0 … 1 of a signed distance from the outline, px."""
    return np.clip(inside + 0.5, 0, 1)


def straight_body(wide=WIDE, fin=0.0):
    """A straight body: red its place along, green its place beside, blue stripes, soft alpha.

    fin: how far, px, a fin stands out on its left, from 40 to 50 % of the body.
    """
    y, x = np.indices(SIZE).astype(float)
    share, left = (60 + LENGTH / 2 - x) / LENGTH, 60 - y
    reach = np.where((share > 0.4) & (share < 0.5) & (left > 0), wide + fin, wide)
    alpha = soft(np.minimum(reach - abs(left), np.minimum(share, 1 - share) * LENGTH))
    red, green = 0.2 + 0.7 * np.clip(share, 0, 1), 0.5 + left / 40
    blue = 0.5 + 0.4 * np.sin(share * 40)
    colour = np.stack([red, green, blue], -1).clip(0, 1) * alpha[..., None]
    return Cutout(1, 1, 0, 0, np.rint(np.dstack([colour, alpha]) * 255).astype(np.uint8))


def cut(picture):
    return Cutout(1, 1, 0, 0, np.rint(picture * 255).astype(np.uint8))


def sides(picture):
    """Where the body is solid; its places there: along, 0 … 1, and beside, px."""
    solid = picture[..., 3] > 0.9
    alpha = np.maximum(picture[..., 3], 1e-6)
    return solid, (picture[..., 0] / alpha - 0.2) / 0.7, (picture[..., 1] / alpha - 0.5) * 40


BODY = straight_body()
FRAME = BODY.pixels / np.float32(255)


@pytest.mark.parametrize("turn", [0.0, 0.6, -2.0, 4.0])
@pytest.mark.parametrize("sharp", [True, False])
def test_a_frame_in_its_own_pose_is_itself(turn, sharp):
    bent = cut(draw_in_pose(BODY, pose(), pose(turn), SIZE))
    again = draw_in_pose(bent, pose(turn), pose(turn), SIZE, sharp=sharp)
    assert np.abs(again - bent.pixels / 255).max() < 1e-3


def test_grey_is_drawn_as_colour_is():
    grey = BODY._replace(pixels=np.ascontiguousarray(BODY.pixels[..., [1, 3]]))
    drawn = draw_in_pose(BODY, pose(), pose(2.0), SIZE)
    assert np.allclose(draw_in_pose(grey, pose(), pose(2.0), SIZE), drawn[..., [1, 3]], atol=5e-3)


def test_a_pose_that_moves_moves_the_picture():
    start = draw_in_pose(BODY, pose(), pose(1.0), SIZE)
    there = pose(1.0).move_to(67, 51, 0, LENGTH)
    moved = np.roll(start, (-9, 7), (0, 1))
    assert np.abs(draw_in_pose(BODY, pose(), there, SIZE) - moved).max() < 1e-3
    quarter = pose(1.0).move_to(60, 60, np.pi / 2, LENGTH)
    assert np.abs(draw_in_pose(BODY, pose(), quarter, SIZE) - np.rot90(start)).max() < 1e-3


def test_a_pose_of_another_size_scales_the_picture():
    large = draw_in_pose(BODY, pose(), pose(1.0).move_to(120, 120, 0, 2 * LENGTH), (241, 241))
    small = draw_in_pose(BODY, pose(), pose(1.0), SIZE)
    assert large[..., 3].sum() == pytest.approx(4 * small[..., 3].sum(), rel=0.01)
    half = draw_in_pose(cut(large), pose(1.0).move_to(120, 120, 0, 2 * LENGTH), pose(1.0), SIZE)
    assert np.abs(half - small).mean() < 0.01


def test_mirrored_is_the_mirror_image():
    finned = straight_body(fin=10)
    bent = draw_in_pose(finned, pose(), pose(1.5), SIZE)
    other = draw_in_pose(finned, pose(), pose(1.5).mirror(), SIZE, mirrored=True)
    assert np.abs(other - bent[::-1]).max() < 1e-3
    twice = draw_in_pose(cut(other), pose(1.5).mirror(), pose(1.5), SIZE, mirrored=True)
    assert np.abs(twice - cut(bent).pixels / 255).max() < 0.01
    assert np.array_equal(pose(1.5).mirror().mirror().posture, pose(1.5).posture)
    assert np.allclose(pose(1.5).mirror().posture, pose(-1.5).posture)


@pytest.mark.parametrize("turn", [1.0, 2.5, 4.0])
def test_a_striped_body_bends_and_comes_back(turn):
    bent = draw_in_pose(BODY, pose(), pose(turn), SIZE)
    back = draw_in_pose(cut(bent), pose(turn), pose(), SIZE)
    solid = cv2.erode((FRAME[..., 3] > 0.99).astype(np.uint8), np.ones((5, 5))) > 0
    assert np.abs(back - FRAME)[solid].mean() < 0.015
    assert np.abs(back - FRAME)[solid].max() < 0.25  # a stripe is 10 px long


@pytest.mark.parametrize("turn, wide", [(2.5, 7.0), (5.0, 7.0), (5.0, 14.0), (-5.0, 14.0)])
def test_every_place_of_the_body_is_in_one_place(turn, wide):
    """Also where the body is wider than its bend is round: radius 12 px."""
    drawn = draw_in_pose(straight_body(wide), pose(), pose(turn), SIZE)
    solid, along, beside = sides(drawn)
    for start in np.arange(0.1, 0.9, 0.1):
        for flank in (beside > 2, beside < -2):
            band = solid & (along > start) & (along < start + 0.1) & flank
            pieces = cv2.connectedComponentsWithStats(band.astype(np.uint8))[2][1:, 4]
            assert band.sum() > 5
            assert pieces.max() >= band.sum() - 2, (start, pieces)


@pytest.mark.parametrize("turn", [1.0, 3.0, 5.0])
def test_no_skin_is_lost_in_a_bend(turn):
    area = draw_in_pose(BODY, pose(), pose(turn), SIZE)[..., 3].sum()
    assert area == pytest.approx(FRAME[..., 3].sum(), rel=0.02 if turn < 4 else 0.06)


def test_a_tail_beside_the_head_is_not_seen_twice():
    """A ring: its tail lies where the straight line beyond its head would go on."""
    ring = draw_in_pose(BODY, pose(), pose(5.9), SIZE)
    back = draw_in_pose(cut(ring), pose(5.9), pose(), SIZE)
    assert back[..., 3].sum() == pytest.approx(FRAME[..., 3].sum(), rel=0.12)
    x = np.nonzero(back[..., 3] > 0.1)[1]
    assert x.min() > 60 - LENGTH / 2 - 3 and x.max() < 60 + LENGTH / 2 + 3


def test_the_far_side_of_a_bend_is_not_seen_beyond_the_near_one():
    """Straightened, cross-sections of a fan go on beyond its middle, where other skin lies."""
    fan = draw_in_pose(straight_body(14), pose(), pose(5.0), SIZE)
    back = draw_in_pose(cut(fan), pose(5.0), pose(), SIZE)
    assert back[:40, :, 3].sum() < 0.01 * back[..., 3].sum()


def test_an_open_fin_is_whole():
    finned = straight_body(fin=10)
    fin = finned.pixels[..., 3].sum() / 255 - FRAME[..., 3].sum()
    for turn in (-1.5, 1.5):
        drawn = draw_in_pose(finned, pose(), pose(turn), SIZE)
        without = draw_in_pose(BODY, pose(), pose(turn), SIZE)
        squeeze = 1 - turn / LENGTH * (WIDE + 5)  # on the inner side, wider on the outer one
        extra = (drawn - without)[..., 3]
        assert extra.sum() == pytest.approx(squeeze * fin, rel=0.1)
        assert cv2.connectedComponents((drawn[..., 3] > 0.5).astype(np.uint8))[0] == 2


@pytest.mark.parametrize("light", [0, 255])
def test_the_outline_has_no_fringe(light):
    pixels = BODY.pixels.copy()
    pixels[..., :3] = pixels[..., 3:] // 255 * light if light == 0 else pixels[..., 3:]
    there = pose(2.0).move_to(60.3, 59.6, 0.4, 70)
    drawn = draw_in_pose(BODY._replace(pixels=pixels), pose(), there, SIZE)
    assert drawn.min() >= 0 and drawn.max() <= 1
    assert np.array_equal(drawn[..., 0], drawn[..., 3] * (light == 255))


def test_a_longer_backbone_has_the_same_places_along_it():
    drawn = draw_in_pose(BODY, pose(), pose(length=1.25), SIZE)
    solid, along, _ = sides(drawn)
    x = np.indices(SIZE)[1]
    true = (60 + 1.25 * LENGTH / 2 - x) / (1.25 * LENGTH)
    assert np.abs(along - true)[solid].max() < 0.02
    assert abs(draw_in_pose(BODY, pose(), pose(), SIZE)[60, :, 3].sum() - LENGTH) < 1


def test_a_backbone_of_few_points():
    two = pose(1.0, count=2)
    bent = draw_in_pose(BODY, pose(count=2), two, SIZE)
    assert np.abs(draw_in_pose(cut(bent), two, two, SIZE) - cut(bent).pixels / 255).max() < 1e-3
    assert bent[..., 3].sum() == pytest.approx(FRAME[..., 3].sum(), rel=0.05)


def test_a_frame_clipped_at_the_border_of_the_film():
    clipped = BODY._replace(pixels=np.ascontiguousarray(BODY.pixels[:62, 20:]), x0_px=20)
    whole = draw_in_pose(BODY, pose(), pose(1.0), SIZE)
    part = draw_in_pose(clipped, pose(), pose(1.0), SIZE)
    _, _, beside = sides(whole)
    there = (whole[..., 3] > 0.99) & (beside > 2)
    assert np.abs(part - whole)[there].max() < 1e-3
    assert part[..., 3].sum() < 0.7 * whole[..., 3].sum()


def test_what_lies_outside_the_picture_is_cut_off():
    whole = draw_in_pose(BODY, pose(), pose(1.0), SIZE)
    corner = draw_in_pose(BODY, pose(), pose(1.0).move_to(20, 30, 0, LENGTH), (60, 70))
    assert np.allclose(corner, whole[30:90, 40:110], atol=1e-3)
    assert not draw_in_pose(BODY, pose(), pose().move_to(-500, 0, 0, LENGTH), SIZE).any()


def change(first, second, weight, turn=1.0):
    """What is between two cut-outs in one pose, bent by `turn`, and each of them alone."""
    posed = [pose_cutout(cutout, pose(), pose(turn), False, True) for cutout in (first, second)]
    box = (0, 0, *SIZE)
    return change_in_pose(*posed, weight, box), *(picture.draw_part(box) for picture in posed)


@pytest.mark.parametrize("weight", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_skin_changes_from_the_tail_to_the_head(weight):
    plain = BODY._replace(pixels=BODY.pixels * np.array([1, 1, 0, 1], np.uint8))
    drawn, new, old = change(plain, BODY, weight)
    assert np.allclose(drawn[..., 3], new[..., 3], atol=1e-6)  # no part of it is half transparent
    solid, place, _ = sides(drawn)
    share = (drawn / np.maximum(old, 1e-6))[..., 2]  # of the old skin
    assert np.allclose(share[solid & (place < 1.2 * weight - 0.25)], 1, atol=2e-3)
    assert np.allclose(share[solid & (place > 1.2 * weight + 0.05)], 0, atol=2e-3)
    assert abs(share[solid].mean() - weight) < 0.08


@pytest.mark.parametrize("weight", [0.1, 0.4, 0.6, 0.9])
@pytest.mark.parametrize("is_new", [True, False])
def test_a_fin_of_one_picture_alone_is_seen_whole_or_not_at_all(weight, is_new):
    finned = straight_body(fin=12)
    drawn, new, old = change(*((finned, BODY) if is_new else (BODY, finned)), weight)
    assert np.allclose(drawn[..., 3], (old if weight > 0.5 else new)[..., 3], atol=1e-5)
    fin, shown = np.abs(new[..., 3] - old[..., 3]) > 0.99, new if is_new else old
    assert fin.sum() > 30
    expected = shown[fin] if (weight < 0.5) == is_new else 0
    assert np.allclose(drawn[fin], expected, atol=5e-3)


# --- poses of a film


def film(rows=40, seed=0):
    """Features and backbones (rows, n, 2) of fish that bend at random."""
    rng = np.random.default_rng(seed)
    lines, headings = [], rng.uniform(-180, 180, rows)
    for heading in headings:
        place = (*rng.uniform(0, 900, 2), np.radians(heading), 60 + rng.normal())
        lines.append(pose(rng.normal(), place, 8).backbone_px())
    lines = np.array(lines)
    table = pd.DataFrame({
        "track_id": 1, "x_px": lines[..., 0].mean(1), "y_px": lines[..., 1].mean(1),
        "heading_deg": headings, "body_length_px": 60.0,
    })  # fmt: skip
    return table, lines


def test_poses_of_a_film_have_its_backbones():
    table, lines = film()
    poses = poses_from_features(table, lines.astype(np.float32))
    assert len(poses) == len(lines)
    assert np.abs(poses.backbone_px() - lines).max() < 1e-3
    assert np.abs(poses[3].backbone_px() - lines[3]).max() < 1e-3
    moved = poses.move_to(0, 0, 0, 60)
    assert np.allclose(moved.posture, poses.posture)
    assert np.abs(moved.backbone_px()).max() < 60


def test_mirrored_poses_have_mirrored_backbones():
    poses = poses_from_features(*film()).move_to(0, 0, 0, 60)
    assert np.allclose(poses.mirror().backbone_px(), poses.backbone_px() * (1, -1))


def test_few_shapes_explain_the_postures():
    posture = poses_from_features(*film()).posture
    shapes = PoseShapes.fit(posture, share=0.999)
    assert len(shapes.variance_shares) <= 3  # one way to bend, and the fish's size
    assert 0.999 <= shapes.variance_shares.sum() <= 1
    back = shapes.decode(shapes.encode(posture))
    assert np.abs(backbone_directions(back) - backbone_directions(posture)).max() < 0.05
    assert np.allclose(mirror_posture(shapes.mean), shapes.mean, atol=1e-9)
    assert np.allclose(shapes.shapes @ shapes.shapes.T, np.eye(len(shapes.shapes)))


def test_which_way_an_eigenvector_points_makes_no_other_codes(monkeypatch):
    posture = poses_from_features(*film()).posture
    eigh, flips = np.linalg.eigh, np.array([1.0, -1.0])
    one = PoseShapes.fit(posture, share=0.999)

    def other_library(matrix):
        values, vectors = eigh(matrix)
        noise = 1e-12 * np.random.default_rng(0).normal(size=vectors.shape)
        return values, vectors * np.resize(flips, len(values)) + noise

    monkeypatch.setattr(np.linalg, "eigh", other_library)
    for _ in range(2):
        assert np.abs(PoseShapes.fit(posture, share=0.999).codes - one.codes).max() < 1e-9
        flips *= -1


def test_a_pose_beyond_all_filmed_is_moved_towards_the_film():
    posture = poses_from_features(*film()).posture
    shapes = PoseShapes.fit(posture, share=0.99)
    for filmed in (posture, mirror_posture(posture)):
        codes = shapes.encode(filmed)
        near, clamped = shapes.nearest_codes(codes)
        assert not clamped.any() and np.array_equal(near, codes)
    wild = posture[0].copy()
    backbone_directions(wild)[:] = np.linspace(4, -4, 8)
    near, clamped = shapes.nearest_codes(shapes.encode(wild))
    assert clamped and not shapes.nearest_codes(near * (1 - 1e-9)).clamped
    most = np.abs(backbone_directions(posture)).max()
    bent = np.abs(backbone_directions(shapes.decode(near))).max()
    assert most - 0.3 < bent < most + 2 * shapes.gap * 8**0.5


@pytest.mark.parametrize("rows", [1, 0])
def test_shapes_want_postures(rows):
    with pytest.raises(FinloopError, match="postures"):
        PoseShapes.fit(np.zeros((rows, 18)), 0.99)
    with pytest.raises(FinloopError, match="1 of them not finite"):
        PoseShapes.fit(np.vstack([np.zeros((3, 18)), np.full((1, 18), np.nan)]), 0.99)


# --- a fat body with a thin tail

TAIL = TailParameters(thin=0.4, smoothing=0.5, body=5 / 8, whole=0.95)


def mouse(tail, points=33):
    """A straight mouse whose body is 60 px long, seen with so much tail [px]: backbone, widths."""
    arc = np.linspace(0, 60 + tail, points)
    width = np.where(arc < 60, 20 * np.sqrt(np.sin(np.pi * (arc / 60).clip(0, 1))), 2.0)
    return np.stack([-arc, np.zeros(points)], -1), width


def test_a_body_has_the_same_points_however_much_tail_is_seen():
    lines, widths = (np.array(part) for part in zip(*map(mouse, (0, 20, 40, 40)), strict=True))
    tracks = pd.DataFrame({
        "backbone_x_px": list(lines[..., 0]), "backbone_y_px": list(lines[..., 1]),
        "half_width_px": list(widths),
    })  # fmt: skip
    made = align_body_and_tail(tracks, lines, TAIL)
    body = np.hypot(*np.diff(made, axis=1).transpose(2, 0, 1))[:, :20].sum(1)
    assert np.abs(body - 60).max() < 4 and np.ptp(body) < 1
    tails = np.hypot(*np.diff(made, axis=1).transpose(2, 0, 1))[:, 20:]
    assert np.ptp(tails) < 0.01 and tails[0].sum() == pytest.approx(40, abs=4)
    assert np.abs(made[..., 1]).max() < 1e-9
    back = tracks.map(lambda cell: cell[::-1])  # the film's points from tail to head
    assert np.allclose(align_body_and_tail(back, lines, TAIL), made)


def test_a_bend_shorter_than_the_body_is_wide_is_smoothed():
    line, width = mouse(40)
    bent = line + np.stack([0 * width, 3 * np.sin(line[:, 0] / 3) * (width > 2)], -1)
    tracks = pd.DataFrame({
        "backbone_x_px": [bent[:, 0]], "backbone_y_px": [bent[:, 1]], "half_width_px": [width],
    })  # fmt: skip
    assert np.abs(align_body_and_tail(tracks, bent[None], TAIL)[0, 3:17, 1]).max() < 1
    assert np.allclose(backbone_steps(pose().posture), 1 / STEPS)
