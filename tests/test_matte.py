"""The alpha of cut-outs: that of drawn fish is known; a parted tail is bridged, crumbs go."""

from functools import cache

import cv2
import numpy as np
import pytest

from finloop.drawn.carp.film import carp_motion, draw_fish_alone, empty_tank, film_frames
from finloop.drawn.carp.settings import CarpFilm
from finloop.extract.background import Scene, match_scene_to_light
from finloop.extract.matte import cut_with_residue, drop_residue, one_piece, residue_width
from finloop.extract.samples import measure_edge_width
from finloop.extract.segment import (
    SilhouetteEdge,
    find_silhouettes,
    measure_fish,
    premultiply_cutout,
    soft_alpha,
)

SIZE = 240, 320


class NoShadow(CarpFilm):
    """A film of carp without shadows on the floor."""

    shadow = 0.0


@cache
def carp(colour, film_type=CarpFilm):
    """Cut-outs of drawn carp with closed fins, as filmed: truth, alpha and colours of each."""
    film = film_type(
        frames=9, fish=1, width_px=SIZE[1], height_px=SIZE[0], body_length_px=80.0,
        frame_rate_hz=25.0, noise_grey=1.5, fins_open_ratio=0.0, seed=4, colour=colour,
    )  # fmt: skip
    poses, tank = carp_motion(film), np.clip(np.rint(empty_tank(film)), 0, 255).astype(np.uint8)
    scene, arena = Scene(tank.squeeze(), "dark", 1.2, 6.0), np.full(SIZE, 255, np.uint8)
    found = []
    for number, (frame, _) in enumerate(film_frames(film, poses)):
        lit = match_scene_to_light(scene, frame)
        edge_rule = SilhouetteEdge(0.4, 0.45, "none")
        silhouettes = list(find_silhouettes(frame, lit, arena, 100.0, edge_rule))
        if len(silhouettes) != 1:
            continue  # at the picture's edge
        edge_px = measure_edge_width(silhouettes[0])
        fish = measure_fish(silhouettes[0], frame, lit, 33, edge_px=edge_px)
        x0, y0, (h, w) = silhouettes[0].x0, silhouettes[0].y0, silhouettes[0].mask.shape
        here, inside = np.s_[y0 : y0 + h, x0 : x0 + w], (y0 - fish.y0, x0 - fish.x0)
        cutout = fish.cutout[inside[0] : inside[0] + h, inside[1] : inside[1] + w]
        colours, opacity = draw_fish_alone(film, poses, number, 0)
        old = soft_alpha(silhouettes[0].mask, silhouettes[0].field, 6)
        found.append((colours[here] / lit.gains, opacity[here], cutout, old))
    return found


@pytest.mark.parametrize("colour", [False, True])
@pytest.mark.parametrize("film_type", [CarpFilm, NoShadow])
def test_the_alpha_of_a_drawn_fish_is_right_to_two_per_cent(film_type, colour):
    errors, before, edges = [], [], []
    for _, true, cutout, old in carp(colour, film_type):
        # The truth has no shadow: it is compared with the fish alone, or filmed without a shadow.
        shown = drop_residue(cutout) if film_type is CarpFilm else cutout
        error = np.abs(shown[..., -1] / 255 - true)
        errors.append(error.mean())
        before.append(np.abs(old / 255 - true).mean())
        edges.append(error[(true > 0.02) & (true < 0.98)].mean())
    assert len(errors) > 4
    assert np.mean(errors) < 0.02
    assert np.mean(errors) < 0.75 * np.mean(before)  # than the alpha that the measures have
    assert np.mean(edges) < 0.15


@pytest.mark.parametrize("ground", [0, 128, 255])
def test_on_any_ground_the_edge_has_next_to_no_colour_of_the_tank(ground):
    for colours, true, cutout, _ in carp(True):
        cutout = drop_residue(cutout)
        alpha = cutout[..., -1:] / 255
        shown = cutout[..., :-1] + (1 - alpha) * ground
        right = colours + (1 - true[..., None]) * ground
        edge = (true > 0.02) & (true < 0.98)
        # The tank has 190 grey levels; a hard edge would be off by a fifth of the contrast.
        assert np.abs(shown - right)[edge].mean() < 0.1 * 190
        assert np.abs(shown - right)[true > 0.98].mean() < 4


def parted_tail(gap):
    """A body, and a tail of lower opacity behind a gap of so many pixels."""
    alpha = np.zeros((40, 120), np.uint8)
    cv2.ellipse(alpha, (80, 20), (30, 8), 0, 0, 360, 255, cv2.FILLED)
    silhouette = alpha > 0
    alpha[18:23, 50 - gap - 20 : 50 - gap] = 120
    return alpha, silhouette


def count_pieces(alpha, level):
    return cv2.connectedComponents((alpha >= level).astype(np.uint8))[0] - 1


@pytest.mark.parametrize("gap", [1, 2, 3, 4])
def test_a_parted_tail_is_one_piece_with_the_fish(gap):
    alpha, silhouette = parted_tail(gap)
    assert count_pieces(alpha, 26) == 2
    whole = one_piece(alpha, silhouette, (0, 0))
    assert [count_pieces(whole, level) for level in (1, 26, 100, 120, 255)] == [1] * 5
    assert np.array_equal(whole[alpha > 0], alpha[alpha > 0])  # the tail keeps its opacity
    assert (
        np.count_nonzero(whole) - np.count_nonzero(alpha) <= 12 * gap
    )  # and only the gap is filled


def test_crumbs_are_dropped_and_what_hangs_by_a_thread_is_as_faint_as_the_thread():
    alpha, silhouette = parted_tail(9)
    assert np.array_equal(one_piece(alpha, silhouette, (0, 0)) > 0, silhouette)
    alpha[20, 30:52] = np.maximum(alpha[20, 30:52], 9)  # a faint thread to the tail
    whole = one_piece(alpha, silhouette, (0, 0))
    assert whole[18:23, 25:30].max() == 9
    assert all(count_pieces(whole, level) == 1 for level in (1, 9, 10, 120))
    assert np.array_equal(whole[silhouette], alpha[silhouette])


def test_an_alpha_in_one_piece_stays_as_it_is():
    rng = np.random.default_rng(2)
    hill = cv2.GaussianBlur(np.pad(np.full((9, 50), 255, np.uint8), 12), (0, 0), 3)
    silhouette = np.zeros(hill.shape, bool)
    silhouette[14:19, 20:50] = True
    assert np.array_equal(one_piece(hill, silhouette, (0, 0)), hill)
    noise = rng.integers(0, 256, hill.shape, np.uint8)
    once = one_piece(noise, silhouette, (0, 0))
    assert np.array_equal(one_piece(once, silhouette, (0, 0)), once)
    assert np.array_equal(once[silhouette], noise[silhouette])


def filmed_disc(grain=0.0, light=1.0, shadow=6.0):
    """A dark disc on a tank of 180, blurred by its film, with a soft shadow and grain around it."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:100, :100] - 50.0
    distance = np.hypot(x, y)
    alpha = np.clip(20.5 - distance, 0, 1)
    shade = shadow * np.exp(-(np.maximum(distance - 20, 0) ** 2) / 8)
    film = light * ((1 - alpha) * (180 - shade) + alpha * 60 + rng.normal(0, grain, x.shape))
    tank = np.full(x.shape, 180, np.uint8)
    return film.astype(np.float32)[..., None], tank, np.rint(255 * alpha).astype(np.uint8), distance


def draw(cutout, tank):
    """A cut-out laid over a tank."""
    return cutout[..., 0] + (1 - cutout[..., 1] / 255.0) * tank


def test_a_cut_out_on_its_own_tank_gives_the_film_back_with_the_shadow_around_the_fish():
    film, tank, alpha, distance = filmed_disc()
    cutout = cut_with_residue(alpha, film, tank, np.ones(1), 0.3)
    drawn = draw(cutout, tank)
    near = distance < 20 + residue_width(40) - 2
    assert np.abs(drawn - film[..., 0])[near].max() < 1.1
    assert np.abs(draw(premultiply_cutout(film, tank, alpha), tank) - film[..., 0]).max() > 4
    assert cutout[distance > 22, 1].max() < 26  # the shadow is faint, and
    assert cutout[distance > 22, 0].max() <= 1  # black


def test_on_a_tank_with_grain_the_cut_out_brings_no_grain_of_its_own():
    film, tank, alpha, distance = filmed_disc(grain=2.0, shadow=0.0)
    cutout = cut_with_residue(alpha, film, tank, np.ones(1), 2.0)
    around = (distance > 23) & (distance < 27)
    other = tank + np.random.default_rng(5).normal(0, 2.0, tank.shape)
    assert 1.8 < (draw(cutout, other) - tank)[around].std() < 2.4  # the sum of both has 2.8
    assert cutout[around, 1].mean() < 0.02 * 255


@pytest.mark.parametrize("light", [0.993, 1.005])
def test_a_light_that_differs_beside_the_fish_leaves_no_halo(light):
    film, tank, alpha, distance = filmed_disc(grain=1.0, light=light, shadow=0.0)
    cutout = cut_with_residue(alpha, film, tank, np.ones(1), 1.0)
    around = (distance > 22) & (distance < 27)
    assert abs((draw(cutout, tank) - 180)[around].mean()) < 0.1
    assert draw(cutout, tank)[distance < 19].mean() == pytest.approx(60, abs=0.1)


def test_another_animal_near_by_is_no_residue():
    film, tank, alpha, distance = filmed_disc(shadow=0.0)
    film[48:53, 76:90] = 90  # its head, 5 px away
    cutout = cut_with_residue(alpha, film, tank, np.ones(1), 0.3)
    assert cutout[distance > 24, 1].max() == 0


@pytest.mark.parametrize("ground", [0, 255])
def test_without_its_residue_a_cut_out_leaves_any_other_ground_as_it_is(ground):
    film, tank, alpha, distance = filmed_disc(grain=0.5)
    with_shadow = cut_with_residue(alpha, film, tank, np.ones(1), 0.5)
    fish, other = drop_residue(with_shadow), np.full(alpha.shape, ground, np.uint8)
    around = distance > 23
    assert np.array_equal(draw(fish, other)[around], other[around])
    assert np.abs(draw(with_shadow, other) - other)[around].max() > (2 if ground else 0)
    assert np.array_equal(fish[distance < 20], with_shadow[distance < 20])  # the fish is whole
    assert np.array_equal(drop_residue(fish), fish)


@pytest.mark.parametrize("level", [0, 5, 255])
def test_a_fish_keeps_its_levels_on_a_black_or_white_tank_whose_grain_is_cut_off(level):
    rng, (y, x) = np.random.default_rng(0), np.mgrid[:60, :60] - 30.0
    alpha = np.clip(12.5 - np.hypot(x, y), 0, 1)
    film = (1 - alpha) * level + alpha * 90 + rng.normal(0, 2, x.shape)
    film = np.clip(film, 0, 255).astype(np.float32)[..., None]
    tank, opaque = np.full(x.shape, level, np.uint8), np.rint(255 * alpha).astype(np.uint8)
    drawn = draw(cut_with_residue(opaque, film, tank, np.ones(1), 2.0), tank)
    assert np.abs(drawn - film[..., 0])[alpha > 0].max() < 4
