"""The painter, marks, films and the stage `render`: laws, ground truth, bad input.

A toy fish is a soft drop of known mass centre, drawn here. What a film shows is read back with PyAV
or Pillow.
"""

from contextlib import chdir
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from av.video.reformatter import ColorRange, Colorspace
from conftest import TINY_CARP
from matplotlib.collections import LineCollection
from PIL import Image
from scratch import content, prepare, write_frames
from tiny_run import copy_of
from toy_fish import edit_list as toy_edit_list
from toy_fish import mass_centre, rough_picture

import stages.clip
import stages.extract
import stages.plots.render
import stages.render
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.edit.schema import EDIT, Goal
from finloop.io.cutouts import CutoutWriter
from finloop.io.movie import Mp4Writer, WebpWriter
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import save_json, save_records
from finloop.io.table import save_table
from finloop.io.video import read_frames
from finloop.plots import render as plots
from finloop.plots.parts import crop_with_edge_repeated
from finloop.puppet import PlacedBackbone
from finloop.render.gallery import CutoutSet, Gallery, fish_by_row, fish_by_tick
from finloop.render.marks import (
    COLOURS,
    MarkPainter,
    goal_stretches,
    rgb_from_hex,
    row_categories,
    rows_with_goal,
)  # fmt: skip
from finloop.render.painter import (
    BentPicture,
    Box,
    Painter,
    PlacedFish,
    Shadow,
    TurnedPicture,
    pad_picture,
    sharpen_picture,
)
from finloop.render.steps import FrameChangeMeter, film_frame_changes, frame_change_metrics
from finloop.sprites.orient import SPRITES

BLACK = np.zeros((90, 120), np.uint8)


def drop(size=31, channels=2, level=1.0):
    """A soft drop, larger to its right: premultiplied (size, size, channels), symmetric in y."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    alpha = 255 * np.exp(-((x / 4) ** 2) - (y / (3.5 + 0.1 * x)) ** 2)
    colours = [alpha * level * share for share in (1, 0.6, 0.3)[: channels - 1]]
    return np.round(np.dstack([*colours, alpha])).astype(np.uint8)


def fish(pixels=None, **how):
    pixels = drop() if pixels is None else pixels
    return TurnedPicture(pad_picture(pixels, *mass_centre(pixels[..., -1].astype(float))), **how)


def paint_fish(x, y, one, partner=None, weight=0.0, tank=BLACK):
    painter = Painter(tank)
    painter.draw(x, y, one, partner, weight)
    return painter.frame.copy()


# --- the painter ---------------------------------------------------------------------------------


@pytest.mark.parametrize("tank_channels", [1, 3])
def test_a_fish_in_its_own_place_is_the_cutout_bit_for_bit(tank_channels):
    rng = np.random.default_rng(0)
    tank = rng.integers(0, 256, (60, 80, tank_channels), np.uint8).squeeze()
    for trial in range(20):
        pixels = rough_picture(rng, *rng.integers(5, 30, 2), tank_channels + 1)
        x0, y0 = (int(n) for n in rng.integers(0, 30, 2))
        x, y = x0 + rng.random() * 20, y0 + rng.random() * 20  # anywhere: a mass centre is no pixel
        cutout = Cutout(0, 0, x0, y0, pixels)
        wanted = tank.copy()
        wanted[y0 : y0 + len(pixels), x0 : x0 + pixels.shape[1]] = cutout.blend_over(tank)
        for angle in (0.0, 360.0, -720.0):
            own = TurnedPicture(pad_picture(pixels, x - x0, y - y0), angle, 1.0)
            assert np.array_equal(paint_fish(x, y, own, tank=tank), wanted), (trial, angle)


def test_every_alpha_over_every_level_is_rounded_as_the_cutout():
    level, alpha = np.meshgrid(np.arange(256, dtype=np.uint8), np.arange(256, dtype=np.uint8))
    for colour in (np.zeros_like(alpha), alpha // 2, alpha):
        pixels = np.dstack([colour, alpha])
        shown = paint_fish(0.0, 0.0, TurnedPicture(pad_picture(pixels, 0.0, 0.0)), tank=level)
        assert np.array_equal(shown, Cutout(0, 0, 0, 0, pixels).blend_over(level))


def test_the_mass_centre_is_where_it_is_asked_for_however_turned_and_scaled():
    for angle in range(0, 360, 17):
        for scale in (0.7, 1.0, 1.6):
            at = mass_centre(paint_fish(61.3, 44.8, fish(rotation_deg=angle, scale=scale)))
            assert at == pytest.approx([61.3, 44.8], abs=0.02), (angle, scale)


def test_the_kernel_gives_back_polynomials_of_the_second_degree():
    y, x = np.mgrid[:12, :14].astype(float)
    slope = np.round(20 + 3 * x + 0.5 * x * (x - 1) + 4 * y).astype(np.uint8)
    pixels = np.dstack([slope, np.full_like(slope, 255)])
    for u, v in ((5.0, 5.0), (5.1, 6.7), (6.25, 4.5), (7.9, 3.01)):
        shown = paint_fish(40 - u, 40 - v, TurnedPicture(pad_picture(pixels, 0.0, 0.0)))[40, 40]
        assert shown == pytest.approx(20 + 3 * u + 0.5 * u * (u - 1) + 4 * v, abs=0.501)


def striped_disc(period_px):
    """An opaque disc of 20 px with stripes, (61, 61, 2)."""
    y, x = np.mgrid[:61, :61] - 30.0
    stripes = 120 + 50 * np.sin(2 * np.pi * x / period_px)
    opaque = np.hypot(x, y) < 20
    alpha = np.where(opaque, 255, 0)
    return np.dstack([np.round(np.where(opaque, stripes, 0)), alpha]).astype(np.uint8)


@pytest.mark.parametrize("period_px", [2.6, 4.0, 9.0])
def test_a_picture_of_the_film_stays_as_sharp_in_the_mean_however_it_is_turned(period_px):
    """The power of stripes is the mean over angles and places; without sharpening it is less."""
    plain = pad_picture(striped_disc(period_px), 30.0, 30.0)
    inside = np.hypot(*(np.mgrid[:90, :120] - np.array([45, 60])[:, None, None])) < 15
    rng = np.random.default_rng(6)
    powers = []
    for picture in (plain, sharpen_picture(plain)):
        drawn = [
            paint_fish(60 + u, 45 + v, TurnedPicture(picture, angle))[inside].astype(float).var()
            for u, v, angle in rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 360], (40, 3))
        ]
        powers.append(np.mean(drawn) / (50**2 / 2))
    assert powers[1] == pytest.approx(1, abs=0.04)
    assert powers[0] < (0.93 if period_px < 5 else 1)


def test_a_picture_of_the_film_drawn_pixel_on_pixel_is_the_film_and_opaque_stays_opaque():
    pixels = striped_disc(2.6)
    picture = sharpen_picture(pad_picture(pixels, 30.0, 30.0))
    around = np.s_[15:76, 30:91]
    assert np.array_equal(paint_fish(60, 45, TurnedPicture(picture))[around], pixels[..., 0])
    bright, dark = (
        paint_fish(60.4, 45.3, TurnedPicture(picture, 20.0), tank=np.full_like(BLACK, level))
        for level in (0, 255)
    )
    inner = np.hypot(*(np.mgrid[:90, :120] - np.array([45, 60])[:, None, None])) < 17
    assert np.array_equal(bright[inner], dark[inner])  # no tank shines through


@pytest.mark.parametrize("quarter", [1, 2, 3, 5, -1])
def test_quarter_turns_are_anticlockwise_and_exact(quarter):
    pixels = drop()
    middle = (pixels.shape[0] - 1) / 2
    upright = paint_fish(50, 40, TurnedPicture(pad_picture(pixels, middle, middle)))
    turned = paint_fish(50, 40, TurnedPicture(pad_picture(pixels, middle, middle), 90.0 * quarter))
    around = np.s_[40 - 15 : 40 + 16, 50 - 15 : 50 + 16]
    assert np.array_equal(turned[around], np.rot90(upright[around], quarter))


def test_a_turn_by_any_angle_turns_the_long_axis_by_it():
    def axis(image):
        x, y = mass_centre(image)
        v, u = np.mgrid[: image.shape[0], : image.shape[1]] - np.array([y, x])[:, None, None]
        xx, yy, xy = ((image * m).sum() for m in (u * u, v * v, -u * v))  # y up
        return np.degrees(np.arctan2(2 * xy, xx - yy) / 2)

    for angle in (7.5, 30.0, -41.0, 80.0):
        one = fish(rotation_deg=angle)
        assert axis(paint_fish(60, 45, one).astype(float)) == pytest.approx(angle, abs=0.5)


def test_scale_scales_areas():
    masses = [paint_fish(60, 45, fish(scale=scale)).sum(dtype=float) for scale in (1.0, 1.5, 2.0)]
    assert np.array(masses) / masses[0] == pytest.approx([1, 2.25, 4], rel=0.01)


@pytest.mark.parametrize("weight", [0.0, 0.25, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("channels", [2, 4])
def test_a_crossfade_is_linear_between_either_alone(weight, channels):
    rng = np.random.default_rng(1)
    tank = rng.integers(0, 256, (90, 120, channels - 1), np.uint8).squeeze()
    a = TurnedPicture(pad_picture(rough_picture(rng, 20, 31, channels), 14.2, 9.1), 12.0, 1.1)
    tall = pad_picture(rough_picture(rng, 31, 12, channels), 5.5, 16.0)
    b = TurnedPicture(tall, 5.0, 1.5)  # stands out at both ends
    alone = [paint_fish(60.3, 44.6, one, tank=tank).astype(float) for one in (a, b)]
    faded = paint_fish(60.3, 44.6, a, b, weight, tank=tank)
    assert np.abs(faded - ((1 - weight) * alone[0] + weight * alone[1])).max() <= 1.001
    if weight in (0.0, 1.0):
        assert np.array_equal(faded, alone[int(weight)])


@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_fish_of_the_tanks_colour_is_not_seen(level):
    """No fringe, no halo, nothing that overflows, however hard its edges."""
    alpha = 255 * (np.random.default_rng(2).random((25, 25)) < 0.5)
    alpha[5:20, 5:20] = 255
    pixels = np.dstack([np.round(alpha * level / 255), alpha]).astype(np.uint8)
    tank = np.full_like(BLACK, level)
    for angle in range(0, 180, 13):
        shown = paint_fish(
            60.37, 44.81, TurnedPicture(pad_picture(pixels, 12.0, 12.0), angle, 1.2), tank=tank
        )
        assert np.abs(shown.astype(int) - level).max() <= (1 if level == 90 else 0)


def test_a_bright_fish_never_overflows():
    """Over white a picture is 255 − alpha + colour: never beyond white, nor darker than black is."""
    rng = np.random.default_rng(3)
    white = np.full((90, 120, 3), 255, np.uint8)
    for angle in range(0, 360, 31):
        pixels = rough_picture(rng, 20, 20, 4)
        black = pixels * np.array([0, 0, 0, 1], np.uint8)
        turned = (TurnedPicture(pad_picture(one, 9.5, 9.5), angle, 1.3) for one in (pixels, black))
        bright, dark = (paint_fish(60.4, 44.3, one, tank=white) for one in turned)
        assert (bright >= dark).all()  # what overflowed would begin at 0 again


def test_what_lies_outside_is_cut_off():
    rng = np.random.default_rng(4)
    one = TurnedPicture(pad_picture(rough_picture(rng, 15, 25, 2), 12.0, 7.0), 25.0)
    wide = np.full((190, 220), 80, np.uint8)
    edges = (-3.3, 20.0), (119.0, 89.5), (60.2, -7.7), (60.0, 95.0)
    for x, y in (*edges, (-200.0, 30.0), (1e6, -1e6)):
        far = paint_fish(x + 50, y + 50, one, tank=wide)
        painter = Painter(wide[50:140, 50:170])
        box = painter.draw(x, y, one)
        assert np.array_equal(painter.frame, far[50:140, 50:170])
        assert box.is_empty == (abs(x) > 150)


def test_a_grey_fish_on_a_canvas_of_colour_is_grey_and_colours_keep_their_order():
    one = fish(rotation_deg=15.0)
    grey, painter = paint_fish(60.4, 40.2, one), Painter(BLACK, colour=True)
    painter.draw(60.4, 40.2, one)
    assert np.array_equal(painter.frame, np.dstack([grey] * 3))
    with pytest.raises(ValueError, match="coloured canvas"):
        Painter(BLACK).draw(60, 40, fish(drop(channels=4)))
    shown = paint_fish(60, 40, fish(drop(channels=4)), tank=np.zeros((90, 120, 3), np.uint8))
    red, green, blue = shown.reshape(-1, 3).sum(axis=0, dtype=float)
    assert (green / red, blue / red) == pytest.approx((0.6, 0.3), abs=0.02)


def test_a_wiped_canvas_is_the_floor_and_the_background_is_untouched():
    rng = np.random.default_rng(5)
    tank = rng.integers(0, 256, (90, 120), np.uint8)
    kept = tank.copy()
    painter = Painter(tank)
    for _ in range(30):
        painter.draw(*rng.uniform(-20, 140, 2), fish(rotation_deg=rng.uniform(0, 360)))
    assert not np.array_equal(painter.frame, tank)
    painter.wipe()
    assert np.array_equal(painter.frame, tank) and np.array_equal(tank, kept)
    painter.canvas[0, 0] ^= 255  # nothing is left to wipe
    painter.wipe()
    assert not np.array_equal(painter.canvas[0, 0], painter.floor[0, 0])
    painter.canvas[:] = painter.floor
    painter.show(placed_at(20.0, 30.0))
    painter.show(placed_at(80.0, 30.0))
    assert np.array_equal(painter.frame, paint_fish(80.0, 30.0, fish(), tank=tank))


def placed_at(x, y):
    return PlacedFish(x, y, fish(), None, 0.0)


# --- edit lists ----------------------------------------------------------------------------------


def gallery(count=3, keep=512):
    """Pictures of the film: drops of the same size, lying at their own places."""
    store = [Cutout(0, i, 10 + 3 * i, 20, drop(level=1 - 0.2 * i)) for i in range(count)]
    own = mass_centre(drop()[..., -1].astype(float))
    centres = own + [[10 + 3 * i, 20] for i in range(count)]
    return Gallery({"frame": CutoutSet(store, centres)}, keep=keep)


# --- several fish


def edit_list(n, **columns):
    """An edit list of n ticks of a fish that swims to the right."""
    return toy_edit_list(n, **{"x_px": np.linspace(30, 90, n), "y_px": 45.0} | columns)


def two_fish(n=3, **columns):
    """Two fish at one place, of different pictures."""
    both = pd.concat([edit_list(n), edit_list(n, fish=1, source=2)], ignore_index=True)
    return both.assign(x_px=60.0, **columns)


def test_a_gallery_for_other_grounds_leaves_out_the_residue():
    pixels = np.zeros((20, 20, 2), np.uint8)
    pixels[..., 1], pixels[8:12, 8:12] = 20, 255  # a fish in a faint shadow
    stored = {"frame": CutoutSet([Cutout(0, 0, 0, 0, pixels)], np.array([[9.5, 9.5]]))}
    alone, own = Gallery(stored, residue=False), Gallery(stored)
    for mirrored in (False, True):
        kept = own.film_picture(0, mirrored).filmed[..., 1] > 0
        assert np.count_nonzero(kept) == 400
        shown = alone.film_picture(0, mirrored).filmed[..., 1]
        assert np.count_nonzero(shown) == 36  # the fish and the pixel around it
        assert np.count_nonzero(shown == 255) == 16


def test_of_several_fish_the_one_with_the_highest_number_is_on_top():
    ticks = list(fish_by_tick(two_fish(), gallery()))
    assert [len(fish) for fish in ticks] == [2, 2, 2]
    for lower, upper in ticks:
        painter, wanted, other = Painter(TANK), Painter(TANK), Painter(TANK)
        boxes = [wanted.draw(*lower), wanted.draw(*upper)]
        assert painter.show(lower, upper) == Box.enclose(boxes)
        assert np.array_equal(painter.frame, wanted.frame)
        other.show(upper, lower)
        assert not np.array_equal(painter.frame, other.frame)


def square(x, level=200, alpha=255, side=20):
    """A square fish of one grey level, about x, 45.5; with x half-way, of whole pixels."""
    pixels = np.full((side, side, 2), alpha, np.uint8)
    pixels[..., 0] = level
    return PlacedFish(
        x, 45.5, TurnedPicture(pad_picture(pixels, (side - 1) / 2, (side - 1) / 2)), None, 0.0
    )


def paint_shadows(*fish, share=0.5, blur=2.0):
    """What fish over one another look like, and how much darker than without shadows."""
    painter, plain = Painter(TANK, shadow=Shadow(share, blur)), Painter(TANK)
    assert painter.show(*fish) == plain.show(*fish)
    return painter, plain.frame.astype(int) - painter.frame


def test_a_fish_throws_a_soft_shadow_on_the_one_below_and_on_nothing_else():
    painter, darker = paint_shadows(square(50.5, 240), square(62.5, 100))
    beside = np.zeros(darker.shape, bool)
    beside[36:56, 41:53] = True  # of the lower fish what the upper one leaves free
    assert (darker[beside] >= 0).all() and not darker[~beside].any()
    edge = darker[45, 41:53]  # of the lower fish, towards the upper one
    assert (np.diff(edge) >= 0).all() and edge[0] == 0
    assert edge[-1] == pytest.approx(240 * 0.5 / 2, abs=20)  # half of the blurred edge
    painter.wipe()
    assert np.array_equal(painter.frame, TANK)


def test_fish_beside_each_other_and_one_alone_throw_no_shadow():
    assert not paint_shadows(square(40.0), square(61.0))[1].any()
    assert not paint_shadows(square(40.0))[1].any()
    assert not paint_shadows(square(40.0), square(45.0), share=0.0)[1].any()
    assert not paint_shadows(square(-500.0), square(45.0))[1].any()


def test_a_shadow_comes_little_by_little_as_fish_come_together():
    """Also where there is one already, on another fish."""
    below = square(40.0 - 9.5, 100)
    for others in ((), (square(30.0, 240),)):
        near = (square(50.5 + gap, 240) for gap in np.arange(-1.0, 6.0, 0.1))
        dark = [paint_shadows(*others, one, below)[1] for one in near]
        totals = [int(one.sum()) for one in dark]
        steps = [np.abs(np.diff(pair, axis=0)).max() for pair in zip(dark, dark[1:], strict=False)]
        assert max(totals) > totals[-1] + 1000 and max(steps) <= 10


def test_tables_in_which_fish_are_not_as_long_are_refused():
    for bad in (two_fish().iloc[:5], two_fish(tick=np.arange(6))):
        with pytest.raises(FinloopError, match="of each fish"):
            fish_by_tick(bad, gallery())


def test_marks_of_several_fish_grow_each_its_own_way():
    edit = two_fish(4).assign(
        x_px=[20.0, 30, 40, 50, 100, 110, 120, 130], y_px=[40.0] * 4 + [80.0] * 4,
        goal=["A"] * 4 + ["B", "B", "", ""],
    )  # fmt: skip
    painter = Painter(np.full((400, 500), 120, np.uint8), colour=True)
    before, marks = painter.floor.copy(), MarkPainter(painter, edit, [])
    for tick, fish in enumerate(fish_by_tick(edit, gallery())):
        marks.show(tick, *fish)
    new = (painter.floor != before).any(axis=2)
    assert new[40, 21:50].all() and new[80, 101:130].all()
    assert not new[:, 55:95].any()  # no line leads from one fish to the other


def test_the_trajectory_of_several_fish_does_not_join_them():
    goal = ["A"] * 3 + [""] + ["B"] * 4
    edit = two_fish(4).assign(x_px=[20.0, 30, 40, 50, 100, 110, 120, 130], goal=goal)
    figure = plots.draw_trajectory(edit, [Goal("A", 20.0, 20.0), Goal("B", 90.0, 20.0)], TANK)
    lines = segments(figure)
    assert len(lines) == 6 and max(np.hypot(*np.diff(s, axis=0).T).max() for s in lines) < 11
    texts = [one.get_text() for one in figure.axes[0].texts]
    assert texts == ["A  0.1 s", "B"]  # reached; the list ends before


def segments(figure):
    lines = [one for one in figure.axes[0].collections if isinstance(one, LineCollection)]
    return [piece for line in lines for piece in line.get_segments()]


# --- poses


def straight(size=20.0, count=6):
    """The posture of an animal that does not bend."""
    return np.concatenate([[0.5, 0], np.zeros(count), np.full(count, 1 / count)])


def bend_fish(one, heading=0.0, posture=None, mirrored=False, scale=1.0):
    """A fish headed right, drawn headed there in a posture."""
    source = PlacedBackbone(one.picture.x_px, one.picture.y_px, 0.0, 20.0, straight())
    posture = straight() if posture is None else posture
    return BentPicture(one.picture, source, posture, np.radians(heading), 20.0 * scale, mirrored)


@pytest.mark.parametrize(("angle", "scale"), [(0.0, 1.0), (33.0, 1.0), (-140.0, 1.3)])
def test_a_fish_in_its_own_pose_is_drawn_as_without_one(angle, scale):
    plain = paint_fish(61.3, 44.8, fish(rotation_deg=angle, scale=scale)).astype(int)
    posed = paint_fish(61.3, 44.8, bend_fish(fish(), angle, scale=scale)).astype(int)
    assert plain.max() > 100 and np.abs(plain - posed).max() <= 2
    bent = bend_fish(fish(), angle, scale=scale)
    both = paint_fish(61.3, 44.8, bent, bent, 0.5)
    assert np.abs(both.astype(int) - posed).max() <= 1


@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_a_grey_fish_in_a_pose_is_grey_on_a_canvas_of_colour(weight):
    one = bend_fish(fish(), 33.0)
    painter = Painter(BLACK, colour=True)
    painter.draw(60.4, 40.2, one, one, weight)
    grey = paint_fish(60.4, 40.2, one, one, weight)
    assert grey.any() and np.array_equal(painter.frame, np.dstack([grey] * 3))


def test_a_bend_moves_the_tail_and_what_is_off_the_canvas_is_cut_off():
    curl = straight()
    curl[2:8] = np.linspace(0, 1.5, 6)
    bent = [bend_fish(fish(), 0.0, posture) for posture in (straight(), curl)]
    assert (paint_fish(60, 45, bent[0]) != paint_fish(60, 45, bent[1])).any()
    painter = Painter(BLACK)
    assert painter.draw(-500, 40, bend_fish(fish())).is_empty
    painter.draw(2, 2, bend_fish(fish(), 0.0, curl))
    painter.wipe()
    assert not painter.frame.any()
    with pytest.raises(ValueError, match="both drawn in a pose"):
        painter.draw(20, 20, fish(), bend_fish(fish()), 0.5)


def test_rows_are_drawn_as_they_say():
    stored = gallery()
    edit = edit_list(
        2, source=[0, 2], rotation_deg=[0.0, 30.0], scale=[1.0, 1.5], weight=[0.0, 0.25],
        partner_kind=[None, "frame"], partner=pd.array([pd.NA, 1], dtype="Int32"),
        partner_rotation_deg=[np.nan, -20.0], partner_scale=[np.nan, 0.5],
    )  # fmt: skip
    first, second = fish_by_row(edit, stored)
    pictures = [stored.film_picture(i) for i in range(3)]
    assert first == (30.0, 45.0, TurnedPicture(pictures[0]), None, 0.0)
    turned = TurnedPicture(pictures[2], 30.0, 1.5), TurnedPicture(pictures[1], -20.0, 0.5)
    assert second == (90.0, 45.0, *turned, 0.25)


FADE = {"weight": 0.5, "partner_kind": "frame", "partner_rotation_deg": 0.0, "partner_scale": 1.0}


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        ({"source": [0, 3, 3]}, r"tick 1: source is 3, wanted a frame, 0 … 2 \(and at 1 more"),
        ({"kind": "sprite"}, "kind is sprite, wanted frame"),
        ({"scale": [1.0, 0.0, 1.0]}, "tick 1: scale is 0.0, wanted more than 0"),
        ({"rotation_deg": np.inf}, "rotation_deg is inf"),
        ({"x_px": np.nan}, "x_px is nan"),
        ({"weight": 1.5}, "weight is 1.5"),
        ({"weight": 0.5}, "partner_kind is None"),
        ({**FADE, "partner": 7}, "partner is 7"),
        ({**FADE, "partner": 0, "partner_scale": 0.0}, "partner_scale is 0.0"),
        ({"tick": [0, 1, 3]}, "tick 3: tick is 3"),
        ({"pose": [None, np.zeros(3), None]}, "pose is"),  # no shapes of the film are there
    ],
)
def test_what_cannot_be_drawn_is_said_at_once(harm, said):
    with pytest.raises(FinloopError, match=said):
        fish_by_row(edit_list(3, **harm), gallery())


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        ({"orientation": [1, 24, 25]}, "tick 2: orientation is 25, wanted an orientation, 1 … 24"),
        ({}, "tick 0: orientation is <NA>"),
        ({"orientation": 1, "source": 2}, "source is 2, wanted a sprite, 0 … 1"),
        ({"orientation": 1, **FADE, "partner_kind": "sprite", "partner": 0}, "partner_orientation is"),
    ],
)  # fmt: skip
def test_a_sprite_that_is_in_no_orientation_is_refused(harm, said):
    stored = CutoutSet([Cutout(0, 0, 10, 20, drop())] * 48, np.full((2, 2), 25.0), 24)
    with pytest.raises(FinloopError, match=said):
        fish_by_row(edit_list(3, **{"kind": "sprite"} | harm), Gallery({"sprite": stored}))


def test_all_problems_are_said_together_and_none_is_none():
    with pytest.raises(FinloopError) as caught:
        fish_by_row(edit_list(3, source=9, scale=0.0, weight=2.0), gallery())
    assert all(word in str(caught.value) for word in ("source", "scale", "weight"))
    with pytest.raises(FinloopError, match="the edit list is empty"):
        fish_by_row(edit_list(0), gallery())
    assert len(list(fish_by_row(edit_list(3), gallery()))) == 3


def test_a_step_is_the_distance_of_the_two_pictures():
    tank = np.random.default_rng(6).integers(0, 200, (90, 120, 3), np.uint8)
    for channels in (1, 3):
        painter = Painter(tank[..., 0] if channels == 1 else tank)
        steps, shown = FrameChangeMeter(painter), []
        for x in (-50.0, 3.0, 30.0, 33.7, 90.0, 90.0, 300.0, 300.0):
            step = steps.measure_change(painter.show(placed_at(x, 40.0)))
            shown.append(painter.canvas.astype(float))
            if len(shown) == 1:
                assert np.isnan(step)
            else:
                wanted = np.sqrt(((shown[-1] - shown[-2]) ** 2).sum() / channels)
                assert step == pytest.approx(wanted, rel=1e-5)


def test_steps_of_the_film_join_consecutive_frames_of_one_track():
    """A gap and a change of track are no steps."""
    stored, painter = gallery(5), Painter(BLACK)
    places = stored.cutout_sets["frame"].centres_px
    tracks = pd.DataFrame({
        "track_id": [2, 2, 2, 7, 7], "frame": [7, 8, 10, 11, 12],
        "x_px": places[:, 0], "y_px": places[:, 1],
    })  # fmt: skip
    found = film_frame_changes(painter, stored, tracks)
    pictures = [
        paint_fish(*places[i], TurnedPicture(stored.film_picture(i))).astype(float)
        for i in range(5)
    ]
    wanted = [np.linalg.norm(pictures[a] - pictures[b]) for a, b in ((0, 1), (3, 4))]
    assert found == pytest.approx(wanted)
    assert len(film_frame_changes(painter, stored, tracks, most=1)) == 1
    assert len(film_frame_changes(painter, stored, tracks.iloc[:1])) == 0


def test_step_numbers_are_one_where_nothing_differs():
    steps = np.linspace(1, 2, 101)
    numbers = frame_change_metrics([np.nan, *steps], steps)
    assert numbers["picture_step_ratio"] == 1
    assert numbers["picture_steps_above_film_p95_share"] == pytest.approx(0.05, abs=0.01)
    assert frame_change_metrics([np.nan], steps) == {}


# --- marks and pictures --------------------------------------------------------------------------

TANK = np.full((240, 320), 150, np.uint8)
NETWORK = (*TINY_CARP, "render.mode=network", "render.comparison_seconds=0")
GOALS = [Goal("A", 90.0, 60.0), Goal("B", 230.0, 120.0)]


def journey():
    """Ten ticks to A, ten to B, ten of wandering, straight but for a turn in the middle."""
    return edit_list(
        30, x_px=np.linspace(40, 280, 30), y_px=np.linspace(60, 140, 30),
        goal=["A"] * 10 + ["B"] * 10 + [""] * 10, state=["straight"] * 12 + ["turn"] * 6 + ["straight"] * 12,
        heading_deg=np.r_[np.zeros(12), np.arange(6) * 10, np.full(12, 60)],
    )  # fmt: skip


def test_parts_and_aims():
    edit = journey()
    names, colours = row_categories(edit)
    assert list(names) == list(edit["state"])
    assert colours == {word: COLOURS[word] for word in ("straight", "turn")}
    assert goal_stretches(edit) == [("A", 0, 10), ("B", 10, 20), ("", 20, 30)]
    mixed = edit.assign(kind=["sprite"] * 15 + ["frame"] * 15, mirrored=[False] * 25 + [True] * 5)
    assert all(set(part) == {"sprite", "film", "mirror image"} for part in row_categories(mixed))
    assert len(row_categories(edit.assign(state="hovers"))[1]) == 1
    assert list(rows_with_goal(edit)) == [True] * 20 + [False] * 10
    assert rows_with_goal(edit.assign(goal="")).all()
    assert rgb_from_hex("#0072B2") == (0, 114, 178)


def test_marks_lie_below_the_fish_and_the_way_grows():
    edit = journey()
    store = [Cutout(0, 0, 0, 0, np.full((5, 5, 2), 255, np.uint8))]
    stored = Gallery({"frame": CutoutSet(store, [[2, 2]])})
    marked, clean = Painter(TANK, colour=True), Painter(TANK, colour=True)
    marks = MarkPainter(marked, edit, GOALS)
    marks_seen = []
    for tick, one in enumerate(fish_by_row(edit, stored)):
        clean.show(one)
        marks.show(tick, one)
        differs = (marked.frame != clean.frame).any(axis=2)
        marks_seen.append(differs.sum())
        x, y = round(one.x_px), round(one.y_px)
        assert not differs[y - 1 : y + 2, x - 1 : x + 2].any()  # the fish is on top
        above = (marked.canvas != marked.floor).any(axis=2)
        above[y - 4 : y + 5, x - 4 : x + 5] = above[marks._plate.slices] = False
        assert not above.any()  # all else is on the floor, and shown at once
        if tick == 15:
            way = marked.frame[round(edit["y_px"][6]), round(edit["x_px"][6])].astype(int)
            assert np.abs(way - rgb_from_hex(COLOURS["straight"])).max() < 90
    assert marks_seen[-1] > marks_seen[1] + 100
    wandered = marked.floor[round(edit["y_px"][25]), round(edit["x_px"][25])].astype(int)
    assert np.ptp(wandered) == 0 and wandered[0] < 140  # grey, and no more of the states' colours
    ring = marked.floor[60 - 8 : 60 + 9, 90 - 8 : 90 + 9]
    assert (ring.min(axis=2) > 200).any()  # goal A, reached, in white
    marked.wipe()
    assert np.array_equal(marked.canvas, marked.floor)


def test_the_caption_keeps_out_of_the_fishs_way():
    for corner, (x, y) in enumerate([(20, 20), (300, 20), (20, 220), (300, 220)]):
        edit = edit_list(5, x_px=float(x), y_px=float(y))
        painter = Painter(TANK, colour=True)
        marks = MarkPainter(painter, edit, [])
        marks.show(0, next(fish_by_row(edit, gallery())))
        dark = (painter.canvas == 75).all(axis=2)
        assert dark.sum() > 500, corner
        assert not dark[max(0, y - 15) : y + 15, max(0, x - 15) : x + 15].any(), corner


def test_a_name_at_the_edge_is_written_to_the_other_side():
    painter = Painter(TANK, colour=True)
    MarkPainter(painter, journey(), [Goal("feeder", 310.0, 200.0)])
    assert (painter.floor[190:210, 250:300] > 200).any()


def test_the_trajectory_shows_ways_and_goals():
    edit = journey()
    figure = plots.draw_trajectory(edit, GOALS, TANK)
    assert len(segments(figure)) == len(edit) - 1
    assert {text.get_text() for text in figure.axes[0].texts} == {"A  0.4 s", "B  0.8 s"}
    key = {text.get_text() for text in figure.legends[0].get_texts()}
    assert key == {"straight", "turn", "wandering", "start"}
    assert plots.draw_trajectory(edit.iloc[:1], GOALS, TANK).axes  # of a single tick, too


def test_the_sheet_begins_where_most_happens():
    edit = journey()
    assert 8 <= plots.find_liveliest_start(edit, 10) <= 13
    assert plots.find_liveliest_start(edit, 30) == plots.find_liveliest_start(edit, 99) == 0
    over = edit.assign(heading_deg=[*[179.0, -179.0] * 5, *range(0, 60, 3)])  # ±180 is no turn
    assert plots.find_liveliest_start(over, 10) >= 9
    tiles = [plots.Tile(TANK[:41, :41], tick, "turn", "#D55E00", 0.3) for tick in range(10)]
    sheet = plots.draw_tiles(tiles, columns=4, size=60)
    assert sheet.shape == (3 * (60 + 18 + 2), 4 * 62, 3)


def test_a_window_goes_on_beyond_the_edge():
    picture = np.arange(100, dtype=np.uint8).reshape(10, 10)
    assert np.array_equal(crop_with_edge_repeated(picture, 3, 3, 5, 5), picture[3:8, 3:8])
    assert np.array_equal(
        crop_with_edge_repeated(picture, -1, -1, 3, 3), [[0, 0, 1], [0, 0, 1], [10, 10, 11]]
    )


# --- films ---------------------------------------------------------------------------------------

RATE = Fraction(2807, 100)


def clip(count, shape):
    """A bright square that wanders over a slope."""
    slope = np.linspace(40, 200, shape[1]).astype(np.uint8)
    for number in range(count):
        frame = np.broadcast_to(slope if len(shape) == 2 else slope[:, None], shape).copy()
        frame[10:20, 2 * number : 2 * number + 10] = 250
        yield frame


@pytest.mark.parametrize("shape", [(48, 64), (47, 63, 3)])
def test_an_mp4_comes_back(tmp_path, shape):
    path = tmp_path / "a.mp4"
    frames = list(clip(20, shape))
    write_frames(Mp4Writer(path, shape, RATE, 10), frames)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        codec = stream.codec_context
        assert (stream.average_rate, stream.frames, codec.pix_fmt) == (RATE, 20, "yuv420p")
        # Odd sides repeat their last row or column.
        assert (stream.height, stream.width) == (48, 64)
        assert (codec.color_range, codec.colorspace) == (ColorRange.MPEG, Colorspace.ITU709)
        assert codec.color_primaries == codec.color_trc == 1
        back = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        times = [round(Fraction(p.pts) * stream.time_base * RATE) for p in _video_frames(path)]
    assert times == list(range(20))
    for frame, shown in zip(frames, back, strict=True):
        wanted = frame if frame.ndim == 3 else np.dstack([frame] * 3)
        error = np.abs(shown[: shape[0], : shape[1]].astype(int) - wanted)
        assert error.mean() < 1.5 and np.quantile(error, 0.99) <= 8
        assert np.abs(shown[:, -1].astype(int) - shown[:, -2]).max() <= 30  # nothing black
        assert np.abs(shown[-1].astype(int) - shown[-2]).max() <= 30
    data = path.read_bytes()
    assert data.index(b"moov") < data.index(b"mdat")  # plays before it is loaded


def _video_frames(path):
    with av.open(str(path)) as container:
        yield from container.decode(video=0)


def test_colours_come_back(tmp_path):
    colours = np.array(
        [(213, 94, 0), (0, 114, 178), (0, 158, 115), (255, 255, 255), (0, 0, 0)], np.uint8
    )
    frame = np.repeat(np.repeat(colours[None], 32, axis=0), 32, axis=1)
    write_frames(Mp4Writer(tmp_path / "a.mp4", frame.shape, RATE, 5), [frame] * 3)
    write_frames(WebpWriter(tmp_path / "a.webp", frame.shape, RATE, 160, 95), [frame] * 3)
    film = next(_video_frames(tmp_path / "a.mp4")).to_ndarray(format="rgb24")
    webp = np.asarray(Image.open(tmp_path / "a.webp").convert("RGB"))
    for shown in (film, webp):
        assert np.abs(shown[16, 16::32].astype(int) - colours).max() <= 6


@pytest.mark.parametrize("shape", [(48, 64), (96, 127, 3)])
def test_a_webp_comes_back(tmp_path, shape):
    path = tmp_path / "a.webp"
    write_frames(WebpWriter(path, shape, RATE, 64, 90), clip(20, shape))
    with Image.open(path) as film:
        assert (film.n_frames, film.size, film.info["loop"]) == (20, (64, 48), 0)
        lasts = []
        for number in range(20):
            film.seek(number)
            film.load()
            lasts.append(film.info["duration"])
        at = np.asarray(film.convert("L")).astype(int)
    assert sum(lasts) == pytest.approx(20 * 1000 / RATE, abs=2) and set(lasts) == {35, 36}
    assert at[round(15 * 48 / shape[0]), round((2 * 19 + 5) * 64 / shape[1])] > 230


MAKE = (
    lambda path: Mp4Writer(path, (48, 64), RATE, 20),
    lambda path: WebpWriter(path, (48, 64), RATE, 64, 75),
)


@pytest.mark.parametrize("make", MAKE)
def test_an_unfinished_film_leaves_what_was_there(tmp_path, make):
    path = tmp_path / "a.film"
    path.write_bytes(b"before")
    with pytest.raises(ValueError, match="wanted"):
        write_frames(make(path), [np.zeros((48, 64), np.uint8), np.zeros((48, 65), np.uint8)])
    with pytest.raises(ValueError, match="wanted"):
        write_frames(make(path), [np.zeros((48, 64), float)])
    assert path.read_bytes() == b"before" and len(list(tmp_path.iterdir())) == 1


# --- the stage -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def replay_folder(tmp_path_factory):
    """A folder with the drawn carp, extracted, and an edit list that replays its first track."""
    folder = tmp_path_factory.mktemp("render")
    with chdir(folder):
        prepare(folder, *NETWORK, "clip.frames=90", "clip.colour=true", "clip.height_px=241")
        stages.clip.main()
        stages.extract.main()
    tracks = pd.read_parquet(folder / "data/extract/tracks.parquet")
    own = tracks[tracks["track_id"] == tracks["track_id"].mode()[0]].sort_values("frame")
    edit = edit_list(
        len(own), source=own.index, x_px=own["x_px"].to_numpy(), y_px=own["y_px"].to_numpy(),
        goal=["A"] * 10 + [""] * (len(own) - 10),
    )  # fmt: skip
    save_table(folder / "data/animate/network.parquet", edit, EDIT)
    save_records(folder / "data/animate/network/goals.json", [Goal("A", 100.0, 60.0)])
    save_json(folder / "data/animate/network/drawn.json", {"size": 1.0})
    (folder / "first_frame").write_text(str(own["frame"].iloc[0]))
    return folder


folder = copy_of("replay_folder")


def too_short(folder):
    """As the stage of a mode leaves what a film is not enough for."""
    save_table(folder / "data/animate/network.parquet", edit_list(0), EDIT)
    save_json(folder / "data/animate/network/reason.json", {"reason": "too short"})


def edit_columns(folder, **columns):
    path = folder / "data/animate/network.parquet"
    save_table(path, pd.read_parquet(path).assign(**columns), EDIT)


def test_a_coded_film_keeps_the_tanks_grain(tmp_path):
    rng, crf = np.random.default_rng(0), settings("render").crf
    frames = [
        np.clip(np.rint(rng.normal(150, 1.5, (96, 128, 1))), 0, 255).astype(np.uint8).repeat(3, 2)
        for _ in range(12)
    ]
    write_frames(Mp4Writer(tmp_path / "a.mp4", frames[0].shape, RATE, crf), frames)
    shown = [frame.to_ndarray(format="rgb24") for frame in _video_frames(tmp_path / "a.mp4")]
    assert np.std(shown, axis=0).mean() == pytest.approx(np.std(frames, axis=0).mean(), rel=0.12)


def test_a_replay_of_the_film_is_the_film(folder):
    """Ground truth: the film's own frames, at their own places, show what the film shows."""
    prepare(folder, *NETWORK, "render.crf=5")
    stages.render.main()
    start = int((folder / "first_frame").read_text())
    film = list(read_frames(Path("data/clip/clip.mp4"), colour=True, start=start))
    tank = load_picture(Path("data/extract/background.png")).astype(int)
    shown = [frame.to_ndarray(format="rgb24") for frame in _video_frames("data/render/network.mp4")]
    assert shown[0].shape[:2] == (242, 320)  # 241 rows of film
    for real, drawn in zip(film, shown, strict=False):
        fish = np.abs(real.astype(int) - tank).max(axis=2) > 40
        assert fish.sum() > 200
        error = np.abs(drawn[:241].astype(int) - real)[fish]
        assert error.mean() < 5 and error.mean() < 0.08 * np.abs(real - tank)[fish].mean()
    metrics = load_numbers(Path("reports/render"))
    assert metrics["frames"] == len(shown)
    assert metrics["picture_step_ratio"] == pytest.approx(1, abs=0.01)
    made = {"network.mp4", "network_marked.mp4", "network.webp"}
    assert set(content(Path("data/render"))) == made
    stages.plots.render.main()
    for name in ("hybrid.png", "contact_sheet.png"):
        assert load_picture(Path("reports/modes/render") / name).std() > 10


@pytest.mark.usefixtures("no_drawing")
def test_the_same_edit_list_gives_the_same_bytes_and_a_webp_is_as_short_as_asked(folder):
    prepare(folder, *NETWORK, "render.webp_seconds=0.4", "render.webp_width_px=100")
    stages.render.main()
    first = content(Path("data/render")) | content(Path("reports/render"))
    stages.render.main()
    assert content(Path("data/render")) | content(Path("reports/render")) == first
    with Image.open("data/render/network.webp") as film:
        assert (film.n_frames, film.size) == (10, (100, 76))


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda f: edit_columns(f, source=99_999), "wanted a frame"),
        (lambda f: too_short(f), "there is no animation of it: too short(.|\n)*render.mode="),
        (lambda f: (f / "data/animate/network.parquet").unlink(), "there is no data.animate.network.parquet"),
        (lambda f: (f / "data/animate/network/goals.json").unlink(), "goals.json cannot be read"),
        (lambda f: (f / "data/extract/cutouts.arrow").unlink(), "cutouts.arrow cannot be read"),
        (lambda f: (f / "data/extract/background.png").unlink(), "background.png cannot be read"),
        (lambda f: edit_columns(f, kind="sprite"), "sprites.parquet cannot be read"),
        (lambda f: prepare(f, *NETWORK, "render.mode=loops"), "there is no data.animate.loops.parquet"),
        (lambda f: _spoil(f / "data/extract/cutouts.arrow"), "is damaged"),
        (lambda f: lose_a_row(f / "data/extract/tracks.parquet"), "mass centres"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_and_what_was_there_stays(folder, harm, said):
    Path("data/render").mkdir(parents=True)
    Path("data/render/network.mp4").write_text("before")
    harm(folder)
    with pytest.raises(FinloopError, match=said):
        stages.render.main()
    assert set(content(Path("data/render"))) == {"network.mp4"}
    assert not Path("reports/render").exists()


def lose_a_row(path):
    table = pq.read_table(path)
    pq.write_table(table.slice(0, table.num_rows - 1), path)


def _spoil(path):
    """Make the cut-outs of a store unreadable."""
    data = path.read_bytes()
    path.write_bytes(data.replace(b"\x28\xb5\x2f\xfd", b"spoi"))  # zstd's mark


@pytest.mark.usefixtures("no_drawing")
def test_sprites_are_drawn_about_their_own_mass_centres(folder):
    """The second of two, elsewhere in its picture; without marks and WebP there is only the film."""
    Path("data/render").mkdir(parents=True)
    Path("data/render/old.mp4").write_text("of another run")
    pixels = [np.pad(drop(31, 4), ((5 * i, 0), (0, 0), (0, 0))) for i in range(2)]
    own = mass_centre(drop()[..., -1].astype(float))
    with CutoutWriter(folder / "data/sprites/sprites.arrow", sprites=True) as store:
        for sprite in range(2):
            for number in range(1, 25):
                store.write(Cutout(0, sprite, 7, 9, pixels[sprite], sprite, number))
    numbers = {column.name: 0 for column in SPRITES.columns if column.dtype != "string"}
    table = pd.DataFrame({"sequence": "straight", "phase": "cycle", **numbers}, index=range(2))
    table = table.assign(
        sprite=[0, 1], orientations=24, mirrored=False, x_px=own[0] + 7.0,
        y_px=own[1] + 9 + np.array([0.0, 5.0]),
    )  # fmt: skip
    save_table(folder / "data/sprites/sprites.parquet", table, SPRITES)
    edit_columns(
        folder, kind="sprite", source=np.int32(1), orientation=np.int8(1), x_px=160.0, y_px=120.0,
        rotation_deg=np.float32(0),
    )  # fmt: skip
    settings = ["render.crf=1", "render.marked_film=false", "render.webp_seconds=0.0"]
    prepare(folder, *NETWORK, *settings, "render.tank=still")
    stages.render.main()
    assert set(content(Path("data/render"))) == {"network.mp4"}
    assert Path("reports/render/metrics.json").exists()  # although nothing switches in it
    tank = load_picture(Path("data/extract/background.png"))
    wanted = paint_fish(160.0, 120.0, fish(drop(31, 4)), tank=tank).astype(int)
    shown = next(_video_frames("data/render/network.mp4")).to_ndarray(format="rgb24")[:241]
    assert np.abs(shown - wanted).mean() < 2 and np.abs(wanted - tank).max() > 60
    around = np.s_[105:136, 145:176]
    assert np.abs(shown - wanted)[around].mean() < 0.1 * np.abs(wanted - tank)[around].mean() + 2


# --- the sheet of switches -----------------------------------------------------------------------


FRAMES = pd.DataFrame({"track_id": 0, "frame": np.arange(3000)})


def edit_of_kinds(kinds, fades=()):
    """An edit list of so many ticks each of a kind, with cross-fades of three ticks."""
    names = [name for name, count in kinds for _ in range(count)]
    weight = np.zeros(len(names))
    for tick in fades:
        weight[tick : tick + 3] = (0.75, 0.5, 0.25)
    return edit_list(len(names), kind=names, weight=weight, source=np.arange(len(names)))


def test_switches_are_between_kinds_and_across_the_film():
    fades = [8, 20, 33, 45, 50, 60]
    edit = edit_of_kinds([("sprite", 20), ("frame", 30), ("sprite", 20)], fades)
    source = [*range(10), *range(50, 60)]
    for one, switches in (
        (edit, fades), (edit.assign(weight=0.0), [20, 50]),
        (edit_of_kinds([("sprite", 30)], fades=(9,)), [9]), (edit_of_kinds([("sprite", 30)]), []),
        (edit_of_kinds([("frame", 1)]), []), (edit_list(20, source=source), [10]),  # a plain jump
    ):  # fmt: skip
        assert plots.choose_switch_ticks(one, FRAMES, 12) == switches


def test_of_many_switches_some_of_either_sort_are_shown_spread_over_the_animation():
    edit = edit_of_kinds(
        [("sprite", 20), ("frame", 80)] * 10,
        fades=[100 * i + 30 + 10 * k for i in range(10) for k in range(6)],
    )
    between = {t for i in range(10) for t in (100 * i, 100 * i + 20)} - {0}
    for most in (1, 2, 5, 12, 30, 79):
        shown = plots.choose_switch_ticks(edit, FRAMES, most)
        assert shown == sorted(set(shown)) and len(shown) == most
        assert len(between & set(shown)) == min(len(between), max(most - 60, most // 2))
    assert len(plots.choose_switch_ticks(edit, FRAMES, 1000)) == 19 + 60
    assert np.ptp(plots.choose_switch_ticks(edit, FRAMES, 12)) > 800
    only = edit_of_kinds([("sprite", 20), ("frame", 20)] * 10)
    assert len(plots.choose_switch_ticks(only, FRAMES, 12)) == 12  # there is no other sort


@pytest.mark.parametrize("count", [2, 5, 30])
@pytest.mark.parametrize("tick", [0, 1, 4])
def test_around_a_switch_are_ticks_of_the_animation(count, tick):
    found = plots.ticks_around_switch(min(tick, count - 1), count)
    assert len(found) == min(count, plots.BEFORE + plots.AFTER)
    assert found[0] >= 0 and found[-1] < count and min(tick, count - 1) in found


@pytest.mark.usefixtures("no_drawing")
def test_the_sheet_of_switches_has_a_row_for_each(folder):
    table = pd.read_parquet(folder / "data/animate/network.parquet")
    weight = np.zeros(len(table), np.float32)
    partner = pd.array([pd.NA] * len(table), "Int32")
    for tick in (10, 30, 50):
        weight[tick], partner[tick] = 0.5, table["source"].iloc[tick - 1] + 1
    fade = weight > 0
    edit_columns(
        folder, weight=weight, partner=partner, partner_kind=np.where(fade, "frame", None),
        partner_rotation_deg=np.where(fade, 0.0, np.nan).astype(np.float32),
        partner_scale=np.where(fade, 1.0, np.nan).astype(np.float32),
    )  # fmt: skip
    prepare(folder, *NETWORK, "render.marked_film=false", "render.webp_seconds=0.0")
    stages.render.main()
    stages.plots.render.main()
    sheet = load_picture(Path("reports/modes/render/switches.png"))
    one = load_picture(Path("reports/modes/render/contact_sheet.png")).shape[0] / (plots.TICKS / 8)
    assert sheet.shape[0] == 3 * one
