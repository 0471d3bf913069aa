"""The tank in three dimensions: the body, its skin, what an edit list asks for, cameras, light."""

import numpy as np
import pandas as pd
import pytest
from toy_fish import (
    LENGTH,
    ROOM,
    SPRITE,
    WIDTH,
    S,
    edit_list,
    fish_mask,
    fish_of,
    line,
    overlap,
    toy,
)  # fmt: skip

from finloop.base.errors import FinloopError
from finloop.render.painter import Painter, TurnedPicture, pad_picture
from finloop.sprites.orient import turn_cutout
from finloop.tank.body import (
    AROUND,
    RINGS,
    fish_surfaces,
    median_half_widths,
    surface_normals,
    surface_triangles,
)
from finloop.tank.camera import CAMERAS, VIEW_DEG, camera_views
from finloop.tank.light import LitFloor, WaterSurface
from finloop.tank.scene import select_offscreen_renderer
from finloop.tank.skin import LENGTHWISE, FishSkins
from finloop.tank.swim import film_body_shapes, swimming_heights


def straight(scale=1.0):
    return fish_surfaces(scale * line(0)[None], scale * WIDTH[None], WIDTH / LENGTH, scale * LENGTH)


# --- the body ------------------------------------------------------------------------------------


@pytest.mark.parametrize("bend", [0.0, 0.8, -1.6])
def test_the_body_is_closed_and_its_outside_is_outside(bend):
    points, out = fish_surfaces(line(bend)[None], WIDTH[None], WIDTH / LENGTH, LENGTH)
    corners = points.reshape(-1, 3)
    _, same = np.unique(np.round(corners, 6) + 0.0, axis=0, return_inverse=True)
    faces = same.reshape(-1)[surface_triangles()]
    faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ways = pd.Series(map(tuple, edges.tolist())).value_counts()
    assert all(ways[a, b] == ways.get((b, a), 0) for a, b in ways.index)  # every edge, both ways
    a, b, c = corners[surface_triangles()].swapaxes(0, 1)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    box = LENGTH * 2 * WIDTH.max() * np.ptp(corners[:, 2])
    assert 0.15 * box < volume < 0.7 * box
    assert np.linalg.norm(out, axis=-1) == pytest.approx(1)
    facing = np.cross(b - a, c - a)
    mean = out.reshape(-1, 3)[surface_triangles()].mean(1)
    large = np.linalg.norm(facing, axis=1) > 1e-3
    assert ((facing * mean).sum(1)[large] > 0).mean() > 0.98


def test_a_straight_fish_is_as_wide_as_filmed_and_the_same_on_both_sides():
    points, _ = straight()
    side = np.abs(points[0, ..., 1]).max(1)
    at = -points[0, :, AROUND // 2, 0] / LENGTH
    wide = (at > 0.05) & (at < 0.8)
    assert side[wide] == pytest.approx(np.interp(at, S, WIDTH)[wide], rel=0.03)
    assert points[0, ..., 1] == pytest.approx(-points[0, :, ::-1, 1], abs=1e-9)
    assert points[0, ..., 0].max() == pytest.approx(0, abs=1e-9)  # the tip of the head
    assert points[0, ..., 0].min() == pytest.approx(-LENGTH)


def test_bodies_turn_scale_and_mirror_with_their_backbones():
    bent = line(0.7)
    points, out = fish_surfaces(bent[None], WIDTH[None], WIDTH / LENGTH, LENGTH)
    turn = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    there = fish_surfaces((bent @ turn[:2, :2].T)[None], WIDTH[None], WIDTH / LENGTH, LENGTH)
    assert there[0] == pytest.approx(points @ turn.T) and there[1] == pytest.approx(out @ turn.T)
    twice = fish_surfaces(2 * bent[None], 2 * WIDTH[None], WIDTH / LENGTH, 2 * LENGTH)
    assert twice[0] == pytest.approx(2 * points)
    other = fish_surfaces((bent * (1, -1))[None], WIDTH[None], WIDTH / LENGTH, LENGTH)
    assert other[0] == pytest.approx(points[:, :, ::-1] * (1, -1, 1))


def test_an_open_fin_does_not_make_the_body_fat():
    wide = WIDTH.copy()
    wide[8:12] *= 3
    points = fish_surfaces(line(0)[None], wide[None], WIDTH / LENGTH, LENGTH)[0]
    assert np.abs(points[..., 1]).max() < 1.25 * WIDTH.max()


def test_normals_of_a_ball():
    angle, turn = np.meshgrid(
        np.linspace(0, np.pi, RINGS), np.linspace(np.pi, -np.pi, AROUND), indexing="ij"
    )
    ball = np.stack([np.cos(angle), np.sin(angle) * np.sin(turn), np.sin(angle) * np.cos(turn)], -1)
    found = surface_normals(ball[None])[0]
    assert (found * ball).sum(-1)[:-1].min() > 0.97


# --- what an edit list asks for ------------------------------------------------------------------


def test_backbones_of_the_film_run_from_head_to_tail():
    tracks, heads, _ = toy()
    film = film_body_shapes(tracks, heads)
    for row, bend in enumerate((0.9, -0.5)):
        moved = film.backbone[row] - film.backbone[row, 0]
        assert moved == pytest.approx(line(bend), abs=1e-4)
        assert film.half_width[row] == pytest.approx(WIDTH, rel=1e-5)


@pytest.mark.parametrize(
    ("row", "angle", "scale"), [(0, 0.0, 1.0), (0, 37.0, 1.0), (1, -110.0, 1.3)]
)
def test_from_above_it_covers_what_the_painter_draws(row, angle, scale):
    edit = edit_list(1, source=row, rotation_deg=angle, scale=scale, x_px=88.4, y_px=71.7)
    tracks, _, cutouts = toy()
    one = cutouts[row]
    x, y = tracks.loc[row, ["x_px", "y_px"]].to_numpy(float) - [one.x0_px, one.y0_px]
    painter = Painter(np.zeros((150, 200, 3), np.uint8))
    painter.draw(88.4, 71.7, TurnedPicture(pad_picture(one.pixels, x, y), angle, scale))
    assert overlap(fish_mask(fish_of(edit), 0, (150, 200)), painter.frame.max(2) > 90) > 0.88


@pytest.mark.parametrize(("sprite", "orientation"), [(0, 1), (0, 6), (1, 1), (1, 18)])
def test_sprites_are_turned_and_mirrored_as_their_pictures_are(sprite, orientation):
    """Ground truth: the sprite's own picture, made as the stage `sprites` makes it."""
    tracks, _, cutouts = toy()
    one = SPRITE.iloc[sprite]
    x, y = tracks.loc[one.frame, ["x_px", "y_px"]].astype(float)
    shown = turn_cutout(
        cutouts[one.frame], x, y, 15 * (orientation - 1) - one.heading_deg,
        mirror_axis_deg=one.heading_deg if one.mirrored else None,
    )  # fmt: skip
    painter = Painter(np.zeros((150, 200, 3), np.uint8))
    picture = pad_picture(shown.pixels, x - shown.x0_px, y - shown.y0_px)
    painter.draw(90, 75, TurnedPicture(picture, 20.0))
    edit = edit_list(1, kind="sprite", source=sprite, orientation=orientation, rotation_deg=20.0)
    assert overlap(fish_mask(fish_of(edit), 0, (150, 200)), painter.frame.max(2) > 90) > 0.88


def test_a_cross_fade_is_half_way_between_and_its_skin_comes_in_from_the_tail():
    ends = edit_list(2, source=[0, 1], rotation_deg=[0.0, 50.0], scale=[1.0, 1.2])
    faded = edit_list(
        3, source=0, weight=[0.0, 0.5, 1.0], partner_kind="frame", partner=1,
        partner_rotation_deg=50.0, partner_scale=1.2,
    )  # fmt: skip
    a, b = fish_of(ends).poses.backbone
    assert fish_of(faded).poses.backbone == pytest.approx(np.stack([a, (a + b) / 2, b]))
    skins = [fish_of(ends).skin(0).astype(int), fish_of(ends).skin(1).astype(int)]
    half = fish_of(faded).skin(1).astype(int)
    head, tail = np.s_[:, : LENGTHWISE // 3], np.s_[:, -LENGTHWISE // 3 :]
    assert np.abs(half[head] - skins[1][head]).max() <= 1
    assert np.abs(half[tail] - skins[0][tail]).max() <= 1


def test_the_mass_centre_is_where_the_list_puts_it():
    fish = fish_of(edit_list(1, x_px=120.25, y_px=33.5, rotation_deg=77.0))
    assert fish.place[0, :2] == pytest.approx([120.25, -33.5])
    seen = fish_mask(fish, 0, (150, 200))
    assert np.argwhere(seen).mean(0) == pytest.approx([33.5, 120.25], abs=0.7)


def test_it_swims_in_the_water():
    high, other = (swimming_heights(np.linspace(0, 100, 500), 50.0, fish) for fish in (0, 1))
    assert not np.allclose(high, other)
    assert high.min() > 12 and high.max() < 38 and np.abs(np.diff(high)).max() < 1.2


# --- the skin ------------------------------------------------------------------------------------


def test_the_skin_is_the_film_seen_from_above():
    skin = fish_of(edit_list(1)).skin(0).astype(int)
    left, right = skin[16:24, 20:60], skin[40:48, 20:60]  # rows run from below over left to right
    assert np.abs(left - [200, 30, 30]).max() < 12 and np.abs(right - [30, 30, 200]).max() < 12
    assert skin[:3].mean() > left.mean() + 40 and skin[-3:].mean() > right.mean() + 40  # the belly


def test_a_mirrored_fish_has_its_colours_mirrored():
    plain = fish_of(edit_list(1, kind="frame", source=1)).skin(0)
    mirrored = fish_of(edit_list(1, kind="sprite", source=1, orientation=1)).skin(0)
    assert np.array_equal(mirrored, plain[::-1]) and not np.array_equal(mirrored, plain)


def test_no_water_is_seen_on_the_skin():
    """Premultiplied colours fade to black at the rim: a white fish stays white all around."""
    tracks, heads, cutouts = toy()
    white = [one._replace(pixels=np.repeat(one.pixels[..., -1:], 4, axis=2)) for one in cutouts]
    film = film_body_shapes(tracks, heads)
    typical = median_half_widths(film.half_width, film.backbone)
    skins = FishSkins(film, typical, tracks[["x_px", "y_px"]].to_numpy(), white.__getitem__)
    assert np.quantile(skins.skin(0)[16:48, 14:], 0.01) > 225


# --- camera and light ----------------------------------------------------------------------------


def seen_at(view, tick, point):
    """Where a point is in the picture, half its height being 1: across, up; and how far ahead."""
    ahead = view.aim[tick] - view.place[tick]
    ahead = ahead / np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    offset = np.asarray(point) - view.place[tick]
    far = offset @ ahead
    return np.array([offset @ right, offset @ np.cross(right, ahead)]) / far / np.tan(
        np.radians(VIEW_DEG / 2)
    ), far


def circling(ticks=300):
    angle = np.linspace(0, 9, ticks)
    head = ROOM.middle + np.stack([50 * np.cos(angle), 40 * np.sin(angle), 0 * angle], -1)
    return head, angle + np.pi / 2


@pytest.mark.parametrize("camera", ["corner", "orbit"])
def test_the_whole_tank_is_seen_and_fills_the_picture(camera):
    view = camera_views(camera, ROOM, *circling(), 25.0)
    corners = [(x, -y, z) for x in (0, 199) for y in (0, 149) for z in (0, 120)]
    for tick in (0, 77, 299):
        at = np.array([seen_at(view, tick, corner)[0] for corner in corners])
        extent = np.abs(at) / (ROOM.aspect, 1)
        assert 0.9 < extent.max() < 1


@pytest.mark.parametrize("camera", ["follow", "side"])
def test_the_fish_is_seen_all_the_time(camera):
    head, heading = circling()
    view = camera_views(camera, ROOM, head, heading, 25.0)
    for tick in range(0, 300, 23):
        at, far = seen_at(view, tick, head[tick])
        assert np.abs(at[0]) < ROOM.aspect and abs(at[1]) < 0.9 and far > LENGTH


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras_do_not_jump(camera):
    view = camera_views(camera, ROOM, *circling(900), 25.0)
    assert len(view.place) == len(view.aim) == 900
    for way in (view.place, view.aim):
        step = np.linalg.norm(np.diff(way, axis=0), axis=1)
        assert step.max() < 0.35 * LENGTH
        assert np.abs(np.diff(step)).max() < 0.06 * LENGTH


def test_the_shadow_lies_away_from_the_sun_and_the_rest_is_the_film():
    background = np.full((150, 200), 120, np.uint8)
    floor = LitFloor(background, ROOM)
    fish = fish_of(edit_list(1, x_px=100.0, y_px=75.0))
    points = fish.surface_and_skin_at(0)[0]
    without = floor.draw_floor([points + (1000, 0, 0)], 3.0).astype(int)
    taken = without - floor.draw_floor([points], 3.0)
    assert taken.min() >= 0 and taken.max() > 40
    y, x = np.mgrid[:150, :200]
    at = np.array([(taken * x).sum(), (taken * y).sum()]) / taken.sum()
    assert at == pytest.approx([100 + 40 * 0.28 / 0.9, 75 + 40 * 0.34 / 0.9], abs=1.5)
    assert without.mean() == pytest.approx(120, rel=0.1) and np.ptp(without) < 45
    assert np.array_equal(floor.draw_floor([points], 3.0), floor.draw_floor([points], 3.0))


def test_water_is_clear_from_above_and_a_mirror_from_afar():
    water = WaterSurface(ROOM)
    above = water.points_and_colours(1.0, np.array([100.0, -75, 5000]), False)[1]
    afar = water.points_and_colours(1.0, np.array([100.0, -9000, 200]), False)[1]
    assert np.median(above[:, 3]) < 40 < 120 < np.median(afar[:, 3])
    assert water.points_and_colours(1.0, ROOM.middle, True)[0][:, 2] == pytest.approx(120, abs=6)


def test_a_missing_library_is_named():
    with pytest.raises(FinloopError, match="libegl1"):
        select_offscreen_renderer({"libNoSuchThing.so.0": "vtkEGLRenderWindow"})
