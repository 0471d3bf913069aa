"""Sprites: turning, picking, Table 1 after, atlas; laws on drawn shapes and a toy film.

The toy film is a fish with a bright head that glides, beats its tail at a known rate and turns at
known frames; its cut-outs, backbones and tables are drawn here. y is down; angles are degrees,
anticlockwise as seen.
"""

import json
import re
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from PIL import Image
from scratch import content, prepare, put_clip
from toy_fish import mass_centre

import stages.plots.sprites
import stages.sprites
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.distance.reel import Reel, sprite_store_row
from finloop.extract.matte import drop_residue
from finloop.extract.table import OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.features.metrics import orientation_table
from finloop.features.table import FEATURES, measure_features, wrap_deg
from finloop.features.table import FeaturesSettings as FeatureSettings
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import save_record
from finloop.io.table import load_table, save_table
from finloop.plots.sprites import draw_sprites
from finloop.sprites import atlas as sprites_atlas
from finloop.sprites.choice import (
    SIDES,
    FrameRun,
    best_runs_of_tracks,
    choose_frames,
    choose_run_combination,
    cycle_headings,
    find_glides,
    find_tail_beats,
    find_turns,
    measure_loop_closure,
    measure_sharpness,
    smooth_series,
    swimmer_table,
    turn_phases,
)
from finloop.sprites.metrics import (
    count_complete_orientations,
    cycle_metrics,
    fault_table,
    sprite_metrics,
    sprite_orientation_table,
)
from finloop.sprites.orient import (
    SPRITES,
    rotation_matrix,
    sprite_cutouts,
    sprite_table,
    trim_picture,
    turn_cutout,
)
from finloop.sprites.settings import SpritesSettings

ORIENTATIONS = 12

RATE, DELTA = 25.0, 5
POINTS = 33
LENGTH = 60.0
HALF_WIDTH = LENGTH * 0.09 * np.sin(np.pi * np.linspace(1, 0, POINTS) ** 1.6)  # head first: blunt
AUTOMATIC = settings("sprites")


# -- a toy film -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Film:
    """Tables and cut-outs of one drawn fish, as the earlier stages would write them."""

    tracks: pd.DataFrame
    features: pd.DataFrame
    cutouts: list

    @property
    def table(self):
        return swimmer_table(self.features, self.tracks, AUTOMATIC)

    @property
    def look(self):
        return partial(
            Reel(self.features, Held(self.cutouts)).draw_aligned_rows, size_px=AUTOMATIC.picture_px
        )


class Held(list):
    """Cut-outs in memory, as a store."""

    @property
    def index(self):
        return pd.DataFrame([one[:2] for one in self], columns=["track_id", "frame"])


BEAT = 10  # frames of a toy tail beat
PLAN = (
    ("slide", 16), ("beat", 40), ("left", 16), ("beat", 40), ("slide", 16), ("right", 16),
    ("slide", 20),
)  # fmt: skip


def plan_frames(plan, word):
    """First and last frame of each part of a plan that is called `word`."""
    edges = np.cumsum([0, *(n for _, n in plan)])
    parts = zip(plan, edges[:-1], edges[1:], strict=True)
    return [(int(a), int(b) - 1) for (w, _), a, b in parts if w == word]


def draw(line, contrast=0.5):
    """A fish (backbone head first, px) as a premultiplied cut-out; its head is brighter."""
    step = np.gradient(line, axis=0)
    normal = np.stack([-step[:, 1], step[:, 0]], 1) / np.hypot(*step.T)[:, None]
    edge = np.vstack(
        [line + HALF_WIDTH[:, None] * normal, (line - HALF_WIDTH[:, None] * normal)[::-1]]
    )
    low = np.floor(edge.min(0)).astype(int) - 3
    width, height = (np.ceil(edge.max(0)).astype(int) + 4 - low).tolist()
    alpha = np.zeros((height, width), np.uint8)
    cv2.fillPoly(alpha, [np.round(16 * (edge - low)).astype(np.int32)], 255, cv2.LINE_AA, 4)
    y, x = np.mgrid[:height, :width]
    to_head = np.hypot(x + low[0] - line[0, 0], y + low[1] - line[0, 1])
    colour = alpha * (contrast + 0.4 * np.exp(-to_head / 12))
    mass = alpha.astype(float)
    pixels = np.dstack([colour.round().astype(np.uint8), alpha])
    return low, mass_centre(mass) + low, pixels, mass.sum() / 255


def film(plan=PLAN, heading=20.0, mirrored=False, speed=2.5, start=0, track=3):
    """A fish that swims a plan. A turn takes it 90° round, bent by as much amid it."""
    words = [(w, i, n) for w, n in plan for i in range(n)]
    place, rows, cutouts = np.array([400.0, 300.0]), [], []
    phase = 0.0
    for number, (word, at, n) in enumerate(words):
        side = {"left": 1, "right": -1}.get(word, 0) * (-1 if mirrored else 1)
        turning = side * 90 / n * (1 - np.cos(2 * np.pi * (at + 0.5) / n))
        arc = side * 100 * np.sin(np.pi * (at + 0.5) / n) ** 2
        phase += 2 * np.pi / BEAT
        wave = (50 if word == "beat" else 0) * (-1 if mirrored else 1)
        share = (np.arange(POINTS - 1) + 0.5) / (POINTS - 1)
        along = np.radians(heading - arc * share + wave * share**1.5 * np.sin(phase - 2.5 * share))
        step = LENGTH / (POINTS - 1) * np.stack([np.cos(along), -np.sin(along)], 1)
        line = place + np.vstack([[0, 0], -np.cumsum(step, 0)])
        low, centre, pixels, area = draw(line)
        rows.append(
            {
                "track_id": track, "frame": start + number, "x_px": centre[0], "y_px": centre[1],
                "area_px": area, "contrast": 100.0, "length_px": LENGTH,
                "backbone_x_px": line[:, 0].astype(np.float32),
                "backbone_y_px": line[:, 1].astype(np.float32),
                "half_width_px": HALF_WIDTH.astype(np.float32),
                "outline_x_px": np.zeros(OUTLINE_POINTS, np.float32),
                "outline_y_px": np.zeros(OUTLINE_POINTS, np.float32),
            }
        )  # fmt: skip
        cutouts.append(Cutout(track, start + number, int(low[0]), int(low[1]), pixels))
        heading += turning
        angle = np.radians(heading)
        place = place + speed * np.array([np.cos(angle), -np.sin(angle)])
    tracks = pd.DataFrame(rows)
    p = FeatureSettings("auto", 0.2, 0.0, 16.0, 0.04, 0.5, ORIENTATIONS)
    table, _ = measure_features(tracks, RATE, p)
    return Film(tracks, table, cutouts)


@pytest.fixture(scope="module")
def toy():
    return film()


@pytest.fixture(scope="module")
def automatic_choice(toy):
    return choose_frames(toy.table, toy.look, DELTA, AUTOMATIC)


@pytest.fixture(scope="module")
def sprites(toy, automatic_choice):
    return sprite_table(toy.table, automatic_choice, AUTOMATIC)


@pytest.fixture(scope="module")
def pictures(toy, sprites):
    return list(sprite_cutouts(sprites, toy.cutouts))


def pick(film, **values):
    p = replace(AUTOMATIC, **{f"{word}_frames": text for word, text in values.items()})
    return choose_frames(film.table, film.look, DELTA, p)


# -- turning ----------------------------------------------------------------------------------------


def shape(colour=None):
    """An asymmetrical drawing: a body with a knob; (h, w, 2), or RGB where `colour` says."""
    alpha = np.zeros((41, 53), np.uint8)
    cv2.ellipse(alpha, (24, 20), (18, 6), 20, 0, 360, 255, -1, cv2.LINE_AA)
    cv2.circle(alpha, (36, 28), 6, 255, -1, cv2.LINE_AA)
    if colour is None:
        x = np.arange(53)
        return np.dstack([(alpha * (0.2 + 0.5 * x / 53)).astype(np.uint8), alpha])
    return np.dstack([*(np.round(alpha * c).astype(np.uint8) for c in colour), alpha])


def centre(one):
    return mass_centre(one.pixels[..., -1].astype(float)) + [one.x0_px, one.y0_px]


def canvas(one, size=120):
    """The picture on a canvas whose middle is film (100, 200)."""
    big = np.zeros((size, size, one.pixels.shape[2]), np.int16)
    x, y = one.x0_px - 100 + size // 2, one.y0_px - 200 + size // 2
    big[y : y + one.pixels.shape[0], x : x + one.pixels.shape[1]] = one.pixels
    return big


PIVOTS = [(100.0, 200.0), (100.5, 199.5), (101.3, 203.81)]


def cut_out(pixels, x0_px, y0_px):
    return Cutout(0, 0, x0_px, y0_px, pixels)


SOURCE = cut_out(shape(), 80, 185)


@pytest.mark.parametrize("pivot", PIVOTS[:2])
@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_quarter_turns_that_take_pixels_to_pixels_are_exact(pivot, quarter):
    assert turn_cutout(SOURCE, *pivot, 360 * (quarter - 2)) is SOURCE
    one = turn_cutout(SOURCE, *pivot, 90 * quarter)
    _, _, want = trim_picture(np.rot90(SOURCE.pixels, quarter))  # anticlockwise as seen
    np.testing.assert_array_equal(one.pixels, want)
    np.testing.assert_allclose(
        centre(one), rotation_matrix(90 * quarter) @ (centre(SOURCE) - pivot) + pivot
    )


@pytest.mark.parametrize("pivot", PIVOTS)
@pytest.mark.parametrize("angle", [7.5, 45, 111, 195, -60, 90])
def test_mass_and_its_centre_are_kept(pivot, angle):
    one = turn_cutout(SOURCE, *pivot, angle)
    alpha = one.pixels[..., -1]
    assert all(edge.any() for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]))  # trimmed
    mass = int(SOURCE.pixels[..., -1].sum())
    assert int(one.pixels[..., -1].sum()) == pytest.approx(mass, rel=3e-3)  # nothing is clipped
    want = rotation_matrix(angle) @ (centre(SOURCE) - pivot) + pivot
    np.testing.assert_allclose(centre(one), want, atol=0.03)


@pytest.mark.parametrize("angle", [37, 135])
def test_there_and_back_is_close(angle):
    pivot = (101.3, 203.81)
    back = turn_cutout(turn_cutout(SOURCE, *pivot, angle), *pivot, -angle)
    off = canvas(back) - canvas(SOURCE)
    assert np.sqrt((off[canvas(SOURCE)[..., -1] > 0] ** 2.0).mean()) < 8
    smeared = cv2.GaussianBlur(canvas(SOURCE).astype(np.float32), (0, 0), 0.7) - canvas(SOURCE)
    assert (off**2.0).mean() < 0.25 * (smeared**2).mean()  # sharper by far than a slight blur


@pytest.mark.parametrize("angle", [0, 12, 77, 180])
@pytest.mark.parametrize("axis", [None, 33.0])
def test_colour_never_exceeds_alpha_and_edges_do_not_shine(angle, axis):
    flat = cut_out(shape((0.6, 0.2, 1.0)), 80, 185)
    one = turn_cutout(flat, 101.3, 203.81, angle, mirror_axis_deg=axis).pixels.astype(float)
    assert (one[..., :3] <= one[..., 3:]).all()
    for channel, share in enumerate((0.6, 0.2, 1.0)):  # of one colour it was, of one it stays
        np.testing.assert_allclose(one[..., channel], share * one[..., 3], atol=1.6)


@pytest.mark.parametrize(("axis", "flip"), [(0, np.flipud), (90, np.fliplr), (180, np.flipud)])
def test_mirrored_is_the_mirror_image(axis, flip):
    one = turn_cutout(SOURCE, 100, 200, 0, mirror_axis_deg=axis)
    _, _, want = trim_picture(flip(SOURCE.pixels))
    np.testing.assert_array_equal(one.pixels, want)


def test_mirroring_comes_before_turning_and_keeps_the_axis():
    both = turn_cutout(SOURCE, 101.3, 203.81, 50, mirror_axis_deg=25.0)
    mirrored = turn_cutout(SOURCE, 101.3, 203.81, 0, mirror_axis_deg=25.0)
    one_by_one = turn_cutout(mirrored, 101.3, 203.81, 50)
    assert np.abs(canvas(both) - canvas(one_by_one)).mean() < 0.4


def test_aligned_fish_are_headed_right_in_the_middle(toy):
    rows = np.array([3, 8])
    for picture in toy.look(rows, toy.table["heading"].to_numpy()[rows]):
        one = cut_out((255 * picture).round().astype(np.uint8), 0, 0)
        np.testing.assert_allclose(centre(one), (AUTOMATIC.picture_px - 1) / 2, atol=0.2)
        assert abs(tilt(one)) < 2
        assert picture.max() <= 1


def tilt(one):
    """Direction of a straight drawn fish: its longest axis, towards the brighter end."""
    alpha = one.pixels[..., -1].astype(float)
    y, x = np.mgrid[: alpha.shape[0], : alpha.shape[1]].astype(float)
    x -= (alpha * x).sum() / alpha.sum()
    y -= (alpha * y).sum() / alpha.sum()
    xx, xy, yy = ((alpha * a).sum() for a in (x * x, x * y, y * y))
    axis = np.degrees(0.5 * np.arctan2(-2 * xy, xx - yy))
    light = one.pixels[..., 0] / np.maximum(alpha, 1) - 0.5 * (alpha > 0)
    ahead = (light * (x * np.cos(np.radians(axis)) - y * np.sin(np.radians(axis)))).sum()
    return float(wrap_deg(np.array(axis if ahead > 0 else axis + 180)))


# -- the table of swimmers --------------------------------------------------------------------------


def test_swimmers_say_how_fish_move(toy):
    table = toy.table
    assert len(table) == len(toy.tracks) and table["usable"].all()
    glide = table.iloc[3:13]
    np.testing.assert_allclose(glide["speed"], 2.5 / LENGTH, atol=4e-3)  # pixels: 0.2 px
    assert np.abs(glide["tail"]).max() < 0.01
    beat = table[table["frame"].between(*plan_frames(PLAN, "beat")[0])]
    assert 0.1 < np.ptp(beat["tail"]) < 0.6
    (first, last), *_ = plan_frames(PLAN, "left")
    turned = table["heading"][last + 1] - table["heading"][first]
    assert turned == pytest.approx(90, abs=5)  # the head yaws
    assert np.isinf(table["neighbour_bl"]).all()


@pytest.mark.parametrize(
    ("column", "value"), [("head_confidence", 0.89), ("body_length_px", 1.1 * LENGTH)]
)
def test_doubtful_frames_cannot_be_used(toy, column, value):
    spoilt = toy.features.copy()
    spoilt.loc[30, column] = value
    usable = swimmer_table(spoilt, toy.tracks, AUTOMATIC)["usable"].to_numpy()
    assert not usable[30] and usable.sum() == len(usable) - 1


def test_fish_near_another_cannot_be_used(toy):
    other = film((("slide", 30),), track=4)
    near = Film(
        pd.concat([toy.tracks, other.tracks], ignore_index=True),
        pd.concat([toy.features, other.features], ignore_index=True),
        [],
    )
    assert not near.table["usable"][:30].any()
    assert near.table["usable"][60:160].all()


def test_smoothing_keeps_lines_and_a_monotone_run_monotone():
    for line in ([1.0], [1.0, 5.0], [3.0, 5.0, 7.0, 9.0]):
        np.testing.assert_allclose(smooth_series(np.array(line)), line)
    run = np.sort(np.random.default_rng(1).exponential(size=30)).cumsum()
    assert (np.diff(smooth_series(run)) > 0).all()


# -- picking ----------------------------------------------------------------------------------------


def within(stretch, parts, slack=0):
    return any(a - slack <= stretch.first and stretch.last <= b + slack for a, b in parts)


def test_the_straight_cycle_is_one_beat_that_closes(toy, automatic_choice):
    straight = automatic_choice["straight"].run
    assert len(straight) == BEAT
    assert within(straight, plan_frames(PLAN, "beat"))
    result = cycle_metrics("straight", automatic_choice["straight"], toy.table, toy.look)
    assert result["straight_closure_after_last_to_first"] < 1
    assert result["straight_closure_last_to_first"] < 1.5


def test_a_slide_has_a_still_tail(automatic_choice):
    slide = automatic_choice["slide"].run
    assert within(slide, plan_frames(PLAN, "slide"), slack=1)
    assert 0.4 * RATE <= len(slide) <= RATE
    assert not automatic_choice["slide"].stands_in


def test_a_short_slide_stands_in(toy, monkeypatch):
    monkeypatch.setattr(SpritesSettings, "slide_least", 20.0)
    assert choose_frames(toy.table, toy.look, DELTA, AUTOMATIC)["slide"].stands_in


@pytest.mark.parametrize(("swing", "stands_in"), [(0.04, False), (0.06, True)])
def test_a_slide_whose_tail_moves_by_more_than_its_width_stands_in(toy, swing, stands_in):
    table = toy.table.assign(tail=swing * (np.arange(len(toy.table)) % 2))
    assert choose_frames(table, toy.look, DELTA, AUTOMATIC)["slide"].stands_in == stands_in


@pytest.mark.parametrize(("word", "sign"), [("left", 1), ("right", -1)])
def test_a_turn_goes_in_holds_and_comes_out(toy, automatic_choice, sprites, word, sign):
    ((first, last),) = plan_frames(PLAN, word)
    stretch = automatic_choice[word].run
    assert first - 3 <= stretch.first <= first + 4 and last - 4 <= stretch.last <= last + 3
    rows = sprites[sprites["sequence"] == word]
    order = "".join(phase[0] for phase in rows["phase"])
    assert re.fullmatch("i+h+o+", order)
    bend = sign * rows["bend"].to_numpy()
    held = (rows["phase"] == "hold").to_numpy()
    assert bend.argmax() in np.flatnonzero(held)
    assert (bend[held] >= 0.9 * bend.max()).all() and (bend[~held] < 0.9 * bend.max()).all()
    assert abs(bend[0]) < 0.25 * bend.max() and abs(bend[-1]) < 0.25 * bend.max()
    assert rows["turn_deg"].sum() == pytest.approx(sign * 90, abs=8)
    assert (sign * rows["turn_deg"] >= -1e-4).all()
    assert not rows["mirrored"].any()


@pytest.mark.parametrize(("heading", "mirrored"), [(161.0, False), (-20.0, True)])
def test_picks_turn_with_the_film_and_swap_in_its_mirror(automatic_choice, heading, mirrored):
    picked = pick(film(heading=heading, mirrored=mirrored))
    for word, other in (("left", "right"), ("right", "left")):
        a, b = picked[word].run, automatic_choice[other if mirrored else word].run
        assert abs(a.first - b.first) <= 1 and abs(a.last - b.last) <= 1
    straight = picked["straight"].run  # every beat is as good
    assert len(straight) == BEAT and within(straight, plan_frames(PLAN, "beat"))


@pytest.mark.parametrize("gone", ["left", "right"])
def test_a_side_without_turns_gets_the_other_mirrored(gone):
    one = film(tuple(part for part in PLAN if part[0] != gone))
    picked = pick(one)
    other = {"left": "right", "right": "left"}[gone]
    assert picked[gone].mirrored and not picked[other].mirrored
    assert picked[gone].run == picked[other].run
    table = sprite_table(one.table, picked, AUTOMATIC)
    mine, theirs = (table[table["sequence"] == w].reset_index() for w in (gone, other))
    for name in ("bend", "sideways", "turn_deg", "head_offset_deg"):
        np.testing.assert_allclose(mine[name], -theirs[name], atol=1e-5)
    for name in ("forward", "motion_area_rel", "phase", "x_px", "heading_deg"):
        assert (mine[name] == theirs[name]).all()
    two = table[table["mirrored"] | (table["sequence"] == other)]
    made = list(sprite_cutouts(two, one.cutouts))
    for step in range(len(mine)):
        left, right = (made[(k * len(mine) + step) * ORIENTATIONS] for k in (0, 1))
        x, y = mine["x_px"][step], mine["y_px"][step]
        flipped = turn_cutout(right, x, y, 0, mirror_axis_deg=0.0)
        shift = cut_out(flipped.pixels, flipped.x0_px - int(x) + 100, flipped.y0_px - int(y) + 200)
        here = cut_out(left.pixels, left.x0_px - int(x) + 100, left.y0_px - int(y) + 200)
        assert np.abs(canvas(shift) - canvas(here))[..., -1].mean() < 0.6  # twice resampled


def test_in_a_film_without_any_turn_a_bend_stands_in():
    one = film((("slide", 20), ("beat", 40)))
    picked = pick(one)
    assert not picked["straight"].stands_in
    for word, side in SIDES.items():
        assert picked[word].stands_in
        turn = picked[word].run
        bend = (-side if picked[word].mirrored else side) * one.table["bend"].to_numpy()[turn.rows]
        assert 0 < bend.argmax() < len(turn) - 1 and bend.max() > 0
    phase = sprite_table(one.table, picked, AUTOMATIC).groupby("sequence")["phase"].agg(set)
    assert "hold" in phase["left"] and "hold" in phase["right"]


def test_in_a_film_without_a_tail_beat_a_glide_stands_in():
    picked = pick(film((("slide", 20), ("left", 16), ("slide", 20))))
    assert picked["straight"].stands_in and not picked["left"].stands_in
    assert picked["straight"].run == picked["slide"].run


def test_a_fish_that_never_bends_says_so(toy):
    with pytest.raises(FinloopError, match="a fish that bends"):
        choose_frames(toy.table.assign(bend=0.0), toy.look, DELTA, AUTOMATIC)


def test_of_a_film_of_doubtful_frames_the_calmest_and_most_bent_stand_in(toy):
    table = swimmer_table(toy.features.assign(head_confidence=0.5), toy.tracks, AUTOMATIC)
    assert not table["usable"].any()
    picked = choose_frames(table, toy.look, DELTA, AUTOMATIC)
    assert all(picked[word].stands_in for word in ("straight", "left", "right"))


def test_spoilt_frames_are_never_picked(toy, automatic_choice):
    spoilt = toy.features.copy()
    at = automatic_choice["straight"].run.rows
    spoilt.loc[at.start + 2 : at.stop - 2, "head_confidence"] = 0.7
    table = swimmer_table(spoilt, toy.tracks, AUTOMATIC)
    picked = choose_frames(table, toy.look, DELTA, AUTOMATIC)
    for choice in picked.values():
        assert table["usable"][choice.run.rows].all()
    assert picked["straight"].run != automatic_choice["straight"].run


def test_candidates_do_not_reach_across_tracks(toy):
    cut = toy.table.copy()
    cut.loc[70:, "track_id"] = 9  # amid the left turn and its surroundings
    cycles = [find(cut, DELTA, AUTOMATIC) for find in (find_tail_beats, find_glides)]
    for candidates in cycles + [find_turns(cut, side, AUTOMATIC) for side in (1, -1)]:
        if len(candidates):
            last = candidates["start"].to_numpy() + candidates["length"].to_numpy()
            assert not ((candidates["start"] < 70) & (last > 70)).any()


def test_one_animal_for_all_unless_it_costs_much(toy):
    table = pd.concat([toy.table, toy.table.assign(track_id=8)], ignore_index=True)

    def stretch(track, cost):
        return FrameRun(track, 0, 9, slice(0, 10), {"fault": cost})

    for cost, track in ((2.0, 3), (9.0, 8)):
        both = {
            "straight": [stretch(3, 1.0), stretch(8, 1.1)],
            "left": [stretch(3, cost), stretch(8, 1.9)],
        }
        chosen = choose_run_combination(table, both, AUTOMATIC)
        assert {one.track_id for one in chosen.values()} == {track}


def test_the_head_s_yaw_does_not_tilt_the_line():
    at = np.arange(30)
    table = pd.DataFrame({"heading": 40 + 0.5 * at + 6 * np.sin(2 * np.pi * at / 10)})
    for start in range(10):
        line = cycle_headings(table, start, 10)
        np.testing.assert_allclose(line, 40 + 0.5 * (start + np.arange(11)), atol=1e-9)


def test_closure_counts_natural_steps():
    wheel = np.stack([[[[np.cos(a), np.sin(a)]]] for a in 2 * np.pi * np.arange(9) / 8])
    assert measure_loop_closure(wheel) == pytest.approx(0, abs=1e-9)
    assert measure_loop_closure(wheel[:-1]) == pytest.approx(1)


def test_a_loop_that_closes_is_preferred(toy):
    (first, _), *_ = plan_frames(PLAN, "beat")
    candidates = pd.DataFrame(
        {"start": first + 5, "length": [BEAT - 3, BEAT, BEAT + 3], "fault": 1.0}
    )
    (best,) = best_runs_of_tracks(toy.table, candidates, toy.look, 1e-6, AUTOMATIC, is_cycle=True)
    assert len(best) == BEAT and set(best.faults) == {"fault", "does not close", "blurred"}


def test_blurred_pictures_are_a_fault(toy):
    look = toy.look
    clear = look(np.array([3]), np.array([20.0]))
    soft = np.stack([cv2.GaussianBlur(one, (0, 0), 1.5) for one in clear])
    assert measure_sharpness(soft)[0] < 0.8 * measure_sharpness(clear)[0]
    assert measure_sharpness(np.zeros_like(clear))[0] == 0


def test_faults_explain_the_choice(automatic_choice):
    table = fault_table(automatic_choice)
    assert set(table["sequence"]) == {"straight", "slide", "left", "right"}
    for word, rows in table.groupby("sequence"):
        assert rows["value"].sum() == pytest.approx(automatic_choice[word].run.cost)
        assert (rows["value"] >= -1e-9).all()


# -- frames listed by hand --------------------------------------------------------------------------


def test_listed_frames_are_taken_as_they_are(toy):
    ((a, b),) = plan_frames(PLAN, "left")
    picked = pick(toy, straight="3:20-33", left=f" 3 : {a} - {b} ")
    assert (picked["straight"].run.first, picked["straight"].run.last) == (20, 33)
    assert (picked["left"].run.first, picked["left"].run.last) == (a, b)
    assert fault_table(picked)["fault"].eq("listed by hand").sum() == 2


def test_listed_frames_may_be_a_track_s_last(toy):
    end = int(toy.tracks["frame"].max())
    picked = pick(toy, slide=f"3:{end - 9}-{end}")
    rows = sprite_table(toy.table, picked, AUTOMATIC).query("sequence == 'slide'")
    np.testing.assert_allclose(rows["forward"], 2.5 / LENGTH, atol=4e-3)
    assert len(rows) == 10
    result = cycle_metrics("slide", picked["slide"], toy.table, toy.look)
    assert "slide_closure_last_to_first" not in result  # there is no frame after


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"straight": "20-33"}, 'a track and its first and last frame, as "8:120-140"'),
        ({"left": "3:a-b"}, r"sprites.left_frames=3:a-b"),
        ({"slide": "7:20-33"}, r"there is no track 7\n  wanted: one of 3\n"),
        (
            {"slide": "3:150-180"},
            r"track 3 lacks 17 of these frames\n  wanted: frames within 0-163",
        ),
        ({"straight": "3:33-20"}, "0 frames"),
        ({"right": "3:20-21"}, "2 frames\n  wanted: at least 3"),
        ({"left": "3:2-12"}, "does not bend to the left"),
        ({"right": "3:56-71"}, "does not bend to the right"),
    ],
)
def test_nonsense_in_the_list_is_refused(toy, asked, message):
    with pytest.raises(FinloopError, match=message):
        pick(toy, **asked)


def test_phases_need_frames_on_both_sides_of_the_bend(toy):
    ((a, b),) = plan_frames(PLAN, "left")
    half = FrameRun(3, a, (a + b) // 2 - 1, slice(a, (a + b) // 2))
    assert turn_phases(toy.table, half, 1, AUTOMATIC.hold) == ["none"]


# -- the table and the pictures ---------------------------------------------------------------------


def test_the_table_fits_its_schema_and_pictures_are_in_its_order(tmp_path, sprites, pictures):
    save_table(tmp_path / "s.parquet", sprites, SPRITES)
    back = load_table(tmp_path / "s.parquet", SPRITES)
    assert list(back["sprite"]) == list(range(len(back)))
    assert list(back["sequence"].drop_duplicates()) == ["straight", "slide", "left", "right"]
    for _, rows in back.groupby("sequence"):
        assert list(rows["step"]) == list(range(len(rows)))
    frames = np.repeat(sprites[["track_id", "frame"]].to_numpy(), ORIENTATIONS, axis=0)
    assert [picture[:2] for picture in pictures] == list(map(tuple, frames.tolist()))


def test_motion_is_the_film_s_own(toy, sprites):
    """Playing forward, sideways and turns of a sequence leads where the fish of the film went."""
    for word, rows in sprites.groupby("sequence"):
        angle = np.radians(rows["heading_deg"].to_numpy(float))
        steps = (rows["forward"] + 1j * rows["sideways"]).to_numpy() * np.exp(1j * angle)
        way = LENGTH * np.array([steps.sum().real, -steps.sum().imag])
        at = toy.tracks.set_index("frame")[["x_px", "y_px"]].to_numpy()
        first, last = int(rows["frame"].min()), int(rows["frame"].max())
        np.testing.assert_allclose(way, at[last + 1] - at[first], atol=1.0, err_msg=word)
        np.testing.assert_allclose(
            wrap_deg(np.diff(rows["heading_deg"])), rows["turn_deg"].to_numpy()[:-1], atol=1e-3
        )


@pytest.mark.parametrize("count", [5, ORIENTATIONS, 36])
def test_every_orientation_is_turned_to_its_direction(toy, sprites, count):
    slide = sprites[sprites["sequence"] == "slide"].iloc[[3]].assign(orientations=count)
    turned = list(sprite_cutouts(slide, toy.cutouts))
    assert len(turned) == count
    for number, one in enumerate(turned):
        assert abs(wrap_deg(np.array(tilt(one) - number * 360 / count))) < 1.5, number + 1
        np.testing.assert_allclose(centre(one), slide[["x_px", "y_px"]].iloc[0], atol=0.1)


def test_table_1_has_all_types_in_every_orientation(toy, sprites):
    before, after = orientation_table(toy.features), sprite_orientation_table(sprites, toy.features)
    assert count_complete_orientations(before) < ORIENTATIONS == count_complete_orientations(after)
    np.testing.assert_allclose(after[["straight_pct", "left_pct", "right_pct"]].sum(axis=1), 100)
    np.testing.assert_allclose(after["amount_pct"], 100 / ORIENTATIONS)
    for word in ("left", "right"):
        assert after[f"max_area_{word}"].between(0.9, 1.0 + 1e-6).all()
    assert list(before.columns) == list(after.columns)


def test_numbers_are_flat_and_finite(toy, sprites):
    found = sprite_metrics(sprites, toy.table, toy.features, len(toy.features), RATE)
    assert all(np.isfinite(value) for value in found.values())
    picked = sprites[["track_id", "frame"]].drop_duplicates()
    assert found["picked_of_fish_frames_pct"] == pytest.approx(100 * len(picked) / len(toy.tracks))
    assert found["tail_beat_hz"] == pytest.approx(RATE / BEAT)
    assert found["tracks_used"] == 1 and found["mirrored_turns"] == 0


def test_the_contact_sheet_shows_steps_and_orientations(sprites, pictures):
    sheet = draw_sprites(
        sprites, lambda s, o: pictures[sprite_store_row(s, o, ORIENTATIONS)], columns=6, size=60
    )
    lines = sum(-(-len(rows) // 6) for _, rows in sprites.groupby("sequence")) + ORIENTATIONS // 6
    assert sheet.shape == (60 * lines, 360, 3) and sheet.std() > 5


# -- the atlas --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def few(sprites):
    """The first steps of two sequences are an atlas too."""
    rows = sprites[sprites["sequence"].isin(["straight", "left"]) & (sprites["step"] < 8)]
    rows = rows.reset_index(drop=True)
    return rows.assign(sprite=np.arange(len(rows)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory, few, toy):
    """A folder with the store of these sprites, as the stage has it when it writes the atlas."""
    path = tmp_path_factory.mktemp("store")
    with CutoutWriter(path / "sprites.arrow", sprites=True) as writer:
        for one in sprite_cutouts(few, toy.cutouts):
            writer.write(one)
    return path


@pytest.fixture(scope="module")
def atlas(folder, few):
    """The same folder with an atlas of small pages, and how many there are."""
    return folder, stages.sprites.write_atlas(folder, few, 512, RATE)


@pytest.fixture(scope="module")
def store(folder):
    with open_cutouts(folder / "sprites.arrow") as opened:
        yield opened


def read_atlas(folder):
    """An independent reader, from the layout's documentation alone.

    `frame`: where on the page; `spriteSourceSize`: where that lies on the untrimmed picture, which is
    as large as `sourceSize`; `pivot`: a share of the untrimmed size; alpha is straight.
    Yields name, untrimmed RGBA float 0-1 premultiplied, pivot in px from the edge, duration.
    """
    waiting, seen = ["atlas-0.json"], set()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        sheet = json.loads((folder / name).read_text())
        waiting += sheet["meta"].get("related_multi_packs", [])
        with Image.open(folder / sheet["meta"]["image"]) as opened:
            assert opened.mode == "RGBA"
            assert opened.size == (sheet["meta"]["size"]["w"], sheet["meta"]["size"]["h"])
            page = np.asarray(opened).astype(float) / 255
        for frame_name, entry in sheet["frames"].items():
            box, at, size = entry["frame"], entry["spriteSourceSize"], entry["sourceSize"]
            whole = np.zeros((size["h"], size["w"], 4))
            part = page[box["y"] : box["y"] + box["h"], box["x"] : box["x"] + box["w"]].copy()
            part[..., :3] *= part[..., 3:]
            whole[at["y"] : at["y"] + at["h"], at["x"] : at["x"] + at["w"]] = part
            assert entry["anchor"] == entry["pivot"]  # PixiJS reads the one, Phaser the other
            pivot = entry["pivot"]["x"] * size["w"], entry["pivot"]["y"] * size["h"]
            yield frame_name, whole, pivot, entry["duration"]


def test_an_independent_reader_finds_every_sprite(atlas, few, store):
    folder, pages = atlas
    assert pages > 1
    names = set()
    for name, whole, pivot, duration in read_atlas(folder):
        sequence, orientation, step = name.split("/")
        row = few[(few["sequence"] == sequence) & (few["step"] == int(step))].iloc[0]
        want = store[int(row["sprite"]) * ORIENTATIONS + int(orientation) - 1]
        # From a pixel's centre in the film to its edge-counted place around the pivot.
        x = want.x0_px - row["x_px"] - 0.5 + pivot[0]
        y = want.y0_px - row["y_px"] - 0.5 + pivot[1]
        assert (x, y) == (pytest.approx(round(x), abs=1e-3), pytest.approx(round(y), abs=1e-3))
        expected = np.zeros_like(whole)
        pixels = drop_residue(want.pixels)  # which belongs on the film's own tank alone
        h, w = pixels.shape[:2]
        part = expected[round(y) : round(y) + h, round(x) : round(x) + w]
        part[..., :3], part[..., 3:] = pixels[..., :-1] / 255, pixels[..., -1:] / 255
        assert np.abs(whole - expected).max() <= 0.5 / 255
        assert duration == 40
        names.add(name)
    assert len(names) == len(store)


def test_tags_and_animations_name_each_sequence_in_each_orientation(atlas, few):
    (folder, pages), tags = atlas, []
    for path in (folder / f"atlas-{number}.json" for number in range(pages)):
        sheet = json.loads(path.read_text())
        names = list(sheet["frames"])
        for tag in sheet["meta"]["frameTags"]:
            of = names[tag["from"] : tag["to"] + 1]
            assert of == sheet["animations"][tag["name"]]  # Aseprite's and PixiJS's say the same
            assert of == [f"{tag['name']}/{step:02d}" for step in range(len(of))]
            assert tag["direction"] == "forward"
            sequence = tag["name"].split("/")[0]
            assert len(of) == (few["sequence"] == sequence).sum()
            tags.append(tag["name"])
        motion = sheet["meta"]["motion"]["left/02"]
        row = few[(few["sequence"] == "left") & (few["step"] == 2)].iloc[0]
        assert motion["turn_deg"] == pytest.approx(row["turn_deg"], abs=1e-4)
    words = ("straight", "left")
    assert sorted(tags) == sorted(f"{w}/{o:02d}" for w in words for o in range(1, ORIENTATIONS + 1))


def test_pictures_on_a_page_do_not_touch(few, store):
    for page in sprites_atlas.lay_out_pages(few, store.index, 512):
        assert page.width <= 512 and page.height <= 512
        taken = np.zeros((page.height, page.width), int)
        for spot in page.slots:
            taken[spot.y - 1 : spot.y + spot.height + 1, spot.x - 1 : spot.x + spot.width + 1] += 1
        assert taken.max() == 1
        assert taken.sum() == sum((s.width + 2) * (s.height + 2) for s in page.slots)


def test_a_page_too_small_for_one_sequence_is_refused(few, store):
    with pytest.raises(FinloopError, match="do not fit on a page of 100 px"):
        sprites_atlas.lay_out_pages(few, store.index, 100)


def test_colour_bleeds_under_the_edge_and_stays_the_same():
    premultiplied = np.zeros((12, 12, 4), np.uint8)
    rng = np.random.default_rng(0)
    alpha = rng.integers(1, 256, (4, 4))
    premultiplied[4:8, 4:8, 3] = alpha
    premultiplied[4:8, 4:8, :3] = (alpha[..., None] * rng.random((4, 4, 3))).round()
    out = sprites_atlas.to_straight_alpha(premultiplied)
    back = np.round(out[..., :3] * (out[..., 3:] / 255.0))
    np.testing.assert_array_equal(back, premultiplied[..., :3])
    np.testing.assert_array_equal(out[..., 3], premultiplied[..., 3])
    even = np.zeros((12, 12, 4), np.uint8)
    even[4:8, 4:8] = 51, 102, 204, 255
    out = sprites_atlas.to_straight_alpha(even)
    assert (out[2:10, 2:10, :3] == (51, 102, 204)).all()  # no dark rim when a filter mixes
    assert not out[:2].any()


# -- the stage --------------------------------------------------------------------------------------


def put_film(folder, one):
    prepare(folder, *TINY_CARP)
    put_clip(folder, [np.zeros((32, 48), np.uint8)] * 4, rate=round(RATE))
    extract = folder / "data/extract"
    save_record(
        extract / "scene.json", SceneFacts("dark", 1.0, 5.0, 450.0, LENGTH, 100.0, "all", POINTS)
    )
    save_table(extract / "tracks.parquet", one.tracks, tracks_schema(POINTS))
    with CutoutWriter(extract / "cutouts.arrow") as writer:
        for cutout in one.cutouts:
            writer.write(cutout)
    save_table(folder / "data/features/features.parquet", one.features, FEATURES)


@pytest.fixture
def work(tmp_path, monkeypatch, toy):
    put_film(tmp_path, toy)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_stage_writes_sprites_atlas_and_reports(work, sprites, pictures, capsys):
    stages.sprites.main()
    stages.plots.sprites.main()
    assert sorted(p.name for p in (work / "data/sprites").iterdir()) == [
        "atlas-0.json", "atlas-0.png", "faults.csv", "sprites.arrow", "sprites.parquet",
        "table1_after.csv",
    ]  # fmt: skip
    back = load_table(work / "data/sprites/sprites.parquet", SPRITES)
    assert list(back["frame"]) == list(sprites["frame"])
    with open_cutouts(work / "data/sprites/sprites.arrow") as store:
        assert len(store) == len(pictures)
        np.testing.assert_array_equal(store[30].pixels, pictures[30].pixels)
    metrics = load_numbers(work / "reports/sprites")
    assert metrics["orientations_with_all_types_after"] == ORIENTATIONS
    assert metrics["mirrored_turns"] == metrics["slide_stands_in"] == 0
    assert load_picture(work / "reports/motion/sprites/contact_sheet.png").ndim == 3
    assert len(pd.read_csv(work / "data/sprites/table1_after.csv")) == ORIENTATIONS
    said = capsys.readouterr().err
    assert "mirrored" not in said and "glide" not in said
    first = content(work / "data/sprites")
    stages.sprites.main()
    assert content(work / "data/sprites") == first  # the same again


def test_stage_says_what_stands_in(work, capsys):
    put_film(work, film((("beat", 30), ("left", 16), ("beat", 30))))
    stages.sprites.main()
    said = capsys.readouterr().err
    assert "no turn to the right; mirrored the left one" in said
    assert "no glide with a still tail" in said
    metrics = load_numbers(work / "reports/sprites")
    assert metrics["mirrored_turns"] == metrics["slide_stands_in"] == 1
    assert metrics["orientations_with_all_types_after"] == ORIENTATIONS


def test_stage_that_fails_leaves_nothing_behind(work):
    prepare(work, *TINY_CARP, "sprites.straight_frames='5:1-9'")
    with pytest.raises(FinloopError, match="there is no track 5"):
        stages.sprites.main()
    assert not (work / "data/sprites").exists() and not (work / "reports/sprites").exists()


def test_a_least_swing_above_the_most_is_refused():
    with pytest.raises(FinloopError, match="min_tail_swing_bl is more than max_tail_swing_bl"):
        settings("sprites", max_tail_swing_bl=0.05)
