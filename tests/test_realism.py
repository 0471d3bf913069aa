"""Realism: laws of the area and its interval, of blocks and windows, of the instrument, the stage."""

import json
import pickle
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from scratch import prepare
from sklearn.metrics import roc_auc_score
from tiny_run import stage_run

import stages.plots.realism
import stages.realism
from finloop.base.errors import FinloopError
from finloop.base.parallel import Processes
from finloop.base.settings import settings
from finloop.base.stretches import sample_stretches, spread_rows
from finloop.edit.schema import EDIT, SPRITE, filmed_edit_list
from finloop.extract.background import Scene
from finloop.extract.film import Detector
from finloop.extract.table import SceneFacts
from finloop.features.table import FEATURES
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.record import load_record
from finloop.io.table import load_table, save_table
from finloop.io.video import load_facts, load_mask
from finloop.project import Project
from finloop.realism import examples
from finloop.realism.auc import Scores, compute_auc, compute_roc
from finloop.realism.compare import (
    FilmSample,
    Verdict,
    classify_pictures,
    classify_windows,
)  # fmt: skip
from finloop.realism.crops import (
    PICTURE_CHANNELS,
    SIZE,
    CropCamera,
    CropMeter,
    CropSeries,
    rows_with_company,
)  # fmt: skip
from finloop.realism.instrument import EditList, Instrument, Swimming, join_measurements
from finloop.realism.settings import RealismSettings
from finloop.realism.windows import (
    CHANNELS,
    equal_blocks,
    track_channels,
    window_cut_from_deltas,
)  # fmt: skip
from finloop.render.gallery import fish_by_row
from finloop.render.painter import Painter
from stages.realism import GalleryOpener
from stages.settings import load_settings

RATE, DELTA = 25.0, 5


@dataclass(frozen=True)
class Coarse(RealismSettings):
    """Fewer bins and steps, so that a classifier learns quickly."""

    bins: ClassVar[int] = 8
    step: ClassVar[float] = 0.6


P = Coarse(**vars(settings("realism", classifier_trees=20)))


# --- the area and its interval


def scores(rng, n=300, shift=0.0, blocks=5, clusters=60):
    animation = rng.random(n) < 0.5
    score = rng.normal(size=n) + shift * animation
    return Scores(score, animation, rng.integers(0, blocks, n), rng.integers(0, clusters, n))


def test_the_area_is_that_of_scikit_learn_of_blocks_weighted_by_their_pairs():
    one = scores(np.random.default_rng(0), shift=0.7)
    one.score[::3] = np.round(one.score[::3])  # ties
    for block in (np.zeros(300, int), np.repeat([0, 1], [60, 240])):
        parts = [block == number for number in np.unique(block)]
        areas = [roc_auc_score(one.animation[part], one.score[part]) for part in parts]
        pairs = [one.animation[part].sum() * (~one.animation[part]).sum() for part in parts]
        found = compute_auc(one._replace(block=block)).value
        assert found == pytest.approx(np.average(areas, weights=pairs))


def test_labels_swapped_give_the_rest_to_one():
    one = scores(np.random.default_rng(1), shift=0.7)
    value, low, high = compute_auc(one)
    other = compute_auc(one._replace(animation=~one.animation))
    assert other == pytest.approx((1 - value, 1 - high, 1 - low))


def test_neither_scores_of_two_blocks_are_compared_nor_windows_without_a_score_counted():
    one = scores(np.random.default_rng(2), shift=0.5)
    shifted = one._replace(score=one.score + 100.0 * one.block)
    assert compute_auc(shifted) == pytest.approx(compute_auc(one))
    more = Scores(*(np.concatenate([column, column[:20]]) for column in one))
    more.score[-20:] = np.nan
    assert compute_auc(more) == pytest.approx(compute_auc(one))


def test_windows_that_come_twice_make_no_interval_narrower():
    one = scores(np.random.default_rng(4), shift=0.5)
    twice = Scores(*(np.concatenate([column, column]) for column in one))
    assert compute_auc(twice) == pytest.approx(compute_auc(one))
    apart = twice._replace(cluster=np.arange(len(twice.score)))
    assert np.ptp(compute_auc(apart)[1:]) < 0.8 * np.ptp(compute_auc(twice)[1:])


def test_perfect_scores_have_the_area_1_and_no_interval_beyond():
    one = scores(np.random.default_rng(5), shift=100.0)
    assert compute_auc(one) == (1.0, 1.0, 1.0)
    near = compute_auc(one._replace(score=np.where(one.cluster == 0, -one.score, one.score)))
    assert 0.5 < near.low < near.value < near.high < 1.0


def test_the_interval_covers_the_truth_of_drawn_clusters_about_as_often_as_it_says():
    rng, hits = np.random.default_rng(6), 0
    for _ in range(100):
        cluster = np.repeat(np.arange(80), 5)  # of five windows that are alike
        score = (rng.normal(size=80)[cluster] + 0.3 * rng.normal(size=400)) / np.sqrt(1.09)
        drawn = Scores(score, cluster % 2 == 0, np.zeros(400, int), cluster)
        _, low, high = compute_auc(drawn)
        hits += low <= 0.5 <= high
    assert 0.90 <= hits / 100 <= 0.99


def test_the_curve_rises_from_0_to_1_over_an_equal_area():
    one = scores(np.random.default_rng(7), n=3000, shift=1.0)
    curve = compute_roc(one, 201)
    assert curve["hits"].iloc[-1] == 1.0 and (np.diff(curve["hits"]) >= 0).all()
    area = np.trapezoid(curve["hits"], curve["false_alarms"])
    assert area == pytest.approx(compute_auc(one).value, abs=0.005)


# --- windows and blocks


def fish(seed, seconds=60.0, turning=1.0, track=0):
    """A fish whose speeds and bend are drawn from an autoregressive process, as a feature table."""
    rng, n = np.random.default_rng(seed), round(seconds * RATE)
    noise = rng.normal(size=(n + 50, 3))
    for k in range(1, len(noise)):
        noise[k] = 0.9 * noise[k - 1] + 0.44 * noise[k]
    speed, turn, bend = noise[50:].T
    heading = np.cumsum(turning * 60.0 * turn / RATE)
    angle = np.radians(heading)
    step = (2.0 + 0.5 * speed) * 40 / RATE
    return pd.DataFrame(
        {
            "track_id": track, "frame": np.arange(n),
            "x_px": np.cumsum(step * np.cos(angle)), "y_px": -np.cumsum(step * np.sin(angle)),
            "heading_deg": (heading + 180) % 360 - 180, "body_length_px": 40.0,
            "motion_area": 0.05 * np.abs(bend),
        }
    ).reindex(columns=FEATURES.names).assign(current=0.0)  # fmt: skip


def swimming_of(table, row):
    n = len(table)
    whole = np.arange(n)
    rows = np.full(n, -1) if row is None else row
    return Swimming(table, np.zeros(n, int), whole, rows, whole / RATE)


def sample_of(table, p=P):
    film = swimming_of(table, np.arange(len(table)))
    return FilmSample(film, table["frame"].to_numpy() / RATE, 0.2, RATE, DELTA, p)


def test_channels_do_not_depend_on_place_direction_or_size():
    table = fish(0, 4.0)
    angle, x, y = np.radians(70.0), table["x_px"], table["y_px"]
    turned = table.assign(
        x_px=300 + 1.5 * (x * np.cos(angle) + y * np.sin(angle)),
        y_px=-20 + 1.5 * (-x * np.sin(angle) + y * np.cos(angle)),
        heading_deg=(table["heading_deg"] + 70 + 180) % 360 - 180,
        body_length_px=60.0,
    )
    mine = track_channels(table, RATE, 0.2)
    assert np.allclose(track_channels(turned, RATE, 0.2), mine)
    assert mine[:, 0].mean() == pytest.approx(2.0, abs=0.6)  # forward, body lengths/s
    mirrored = track_channels(table.assign(y_px=-y, heading_deg=-table["heading_deg"]), RATE, 0.2)
    assert np.allclose(mirrored, mine * [1, -1, -1, 1])


def test_a_window_is_cut_of_one_track_and_a_whole_number_of_steps():
    cut = window_cut_from_deltas(5.0, 1.25, 0.6, DELTA)
    assert cut == (24, 6, 3)
    tracks = fish(0, 1.5), fish(1, 0.9, track=1), fish(2, 1.0, track=2)
    sample = sample_of(pd.concat(tracks, ignore_index=True))
    made = sample.cut_windows(sample.film, sample.film_blocks())
    assert made.first.tolist() == [0, 6, 12, 38 + 22]
    assert made.x.shape == (4, 8, len(CHANNELS))


def test_blocks_hold_equally_much_and_gaps_belong_to_both_sides():
    time = np.sort(np.random.default_rng(0).exponential(size=1000).cumsum())
    blocks = equal_blocks(time, 5)
    assert np.bincount(blocks.block_numbers(time)).tolist() == [200] * 5
    near = blocks.are_near(time, 3.0)
    assert (near[np.arange(1000), blocks.block_numbers(time)]).all()
    edge = blocks.edges[1]
    assert (near[:, 0] == (time < edge + 3.0)).all()
    assert (near[:, 1] == ((time > edge - 3.0) & (time < blocks.edges[2] + 3.0))).all()


def test_halves_have_blocks_of_their_own():
    blocks = equal_blocks(np.arange(100.0), 5, repeats=2)
    assert blocks.block_numbers(np.array([5.0, 15, 55, 65, 99, 200])).tolist() == [0, 1, 0, 1, 4, 4]


def test_no_window_shares_a_frame_of_film_with_what_its_classifier_learnt_from():
    table = fish(0)
    sample = sample_of(table)
    rng = np.random.default_rng(1)
    row = np.concatenate([np.arange(a, a + 20) for a in rng.integers(0, len(table) - 20, 75)])
    row[200:300] = -1  # sprites
    film, made = sample.windows_beside_film(swimming_of(fish(2), row))
    own = sample.film.row
    inside = np.arange(sample.window_cut.length + 1)
    for block in range(P.cross_validation_folds):
        tested, learnt = [], []
        for windows, rows in ((film, own), (made, row)):
            shown = rows[windows.first[:, None] + inside]
            tested.append(shown[windows.block == block])
            learnt.append(shown[~windows.near[:, block]])
        filmed = np.unique(tested[0])  # film windows alone: an animation's may play more blocks
        assert not np.isin(np.concatenate(learnt), filmed[filmed >= 0]).any()
        assert all(len(part) for part in (*tested, *learnt))


# --- verdicts


def verdict_on(made, p=P, row=None, seed=0):
    sample = sample_of(fish(seed, 120.0), p)
    return classify_windows(sample.windows_beside_film(swimming_of(made, row)), p, by_channel=False)


@cache
def verdict_of(seed):
    return verdict_on(fish(seed, 120.0))


def test_two_samples_of_one_process_cannot_be_told():
    values = [verdict_of(seed).whole for seed in (10, 11, 12)]
    assert np.mean([one.value for one in values]) == pytest.approx(0.5, abs=0.06)
    assert sum(one.low <= 0.5 <= one.high for one in values) >= 2


def test_a_copy_of_the_film_cannot_be_told_whatever_its_order():
    """Played in the same order or another: no twin is learnt from, see `windows`."""
    table = fish(0, 120.0)
    row = np.arange(len(table))
    assert verdict_on(table, row=row).whole.value == 0.5
    parts = np.random.default_rng(1).permutation(np.split(row, 12))
    order = np.concatenate(list(parts))
    shuffled = table.iloc[order].assign(track_id=np.repeat(np.arange(12), len(row) // 12))
    mixed = verdict_on(shuffled.reset_index(drop=True), row=order).whole
    assert mixed.value == pytest.approx(0.5, abs=0.04)
    blind = verdict_on(shuffled.reset_index(drop=True)).whole  # were the film's rows not known
    assert blind.value < 0.2


def test_twice_the_turning_speed_gives_itself_away_by_turning():
    fast = verdict_on(fish(10, 120.0, turning=3.0))
    assert fast.whole.value > 0.9
    assert max(fast.importance, key=fast.importance.get) == "turning"


def test_a_film_too_short_is_refused_with_what_would_do():
    sides = sample_of(fish(0, 3.0)).windows_beside_film(swimming_of(fish(1, 3.0), None))
    with pytest.raises(FinloopError, match=r"a longer film, fewer realism.cross_validation_folds"):
        classify_windows(sides, P)


def test_a_verdict_is_the_same_again():
    first, second = verdict_of(10), verdict_on(fish(10, 120.0))
    assert first.whole == second.whole and first.importance == second.importance


def test_tracks_stay_whole_and_long_ones_are_cut_evenly():
    ids = np.repeat([0, 1, 2, 3], [100, 30, 250, 7])
    every = sample_stretches(ids, 100, 10**6, 0)
    assert [one.stop - one.start for one in every] == [100, 30, 83, 84, 83, 7]
    some = sample_stretches(ids, 100, 120, 0)
    assert {(one.start, one.stop) for one in some} < {(one.start, one.stop) for one in every}
    assert 120 <= sum(one.stop - one.start for one in some) < 120 + 100


def test_rows_are_spread_evenly_over_the_film():
    rows = np.arange(7, 1007)
    some = spread_rows(rows, 50)
    assert (len(some), some[0], some[-1]) == (50, 7, 1006) and set(np.diff(some)) <= {20, 21}
    np.testing.assert_array_equal(spread_rows(rows, 1001), rows)


# --- examples


def test_the_falsest_windows_do_not_touch_and_a_copy_is_most_alike():
    sample = sample_of(fish(0, 60.0))
    film, made = sample.windows_beside_film(swimming_of(fish(0, 60.0), None))
    score = np.random.default_rng(0).normal(size=len(made.x))
    score[3] = np.nan
    pairs = examples.most_false_windows(film, made, score, 4, sample.window_cut.length)
    assert pairs[0].score == np.nanmax(score) and len(pairs) == 4
    assert all(one.film == one.animation for one in pairs)
    begins = np.sort([made.first[one.animation] for one in pairs])
    assert (np.diff(begins) > sample.window_cut.length).all()


def test_a_view_shows_the_heading_to_the_right():
    frame = np.zeros((100, 120), np.uint8)
    frame[20:40, 60] = 255  # a line up from (60, 40)
    seen = examples.CameraView(60.0, 40.0, 90.0, 80.0).crop_frame(frame, 160)
    y, x = np.nonzero(seen[..., 0] > 100)
    assert seen.shape == (160, 160, 3)
    assert abs(y.mean() - 79.5) < 2 and x.min() > 75 and x.max() > 115


# --- the instrument and the stage, on a tiny carp


folder = stage_run("plots-modes")


@pytest.fixture
def carp(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def instrument_of(folder):
    clip, extract = folder / "data/clip", folder / "data/extract"
    facts = load_facts(clip / "facts.json")
    mask = load_mask(clip / "arena.png", facts.width_px, facts.height_px)
    return Instrument(
        load_picture(extract / "background.png"), mask.astype(np.uint8) * 255,
        load_record(extract / "scene.json", SceneFacts, "extract"), load_settings("extract"),
        load_settings("features"), facts.frame_rate_hz,
    )  # fmt: skip


def test_the_part_around_the_fish_gives_what_the_whole_frame_gives(carp):
    one = instrument_of(carp)
    facts, painter = one.facts, Painter(one.tank)
    scene = Scene(one.tank, facts.polarity, facts.noise_grey, facts.threshold_grey)
    detector = Detector(one.arena, one.typical_fish, one.extract)
    with Project() as project:
        drawn = project.edit_with_sources("network", "realism", sprites=True, bodies=True)
        gallery = project.gallery(drawn)
        fish = list(fish_by_row(drawn.edit, gallery))[::7]
        # Not compared: cut-outs, whose residue needs the light of a whole frame.
        for part, drawn_fish in zip(one.detect_fish(fish), fish, strict=True):
            painter.show(drawn_fish)
            whole = detector(painter.frame, scene)
            assert part.verdicts == whole.verdicts
            assert part.spots == whole.spots
            for mine, other in zip(part.fish, whole.fish, strict=True):
                assert (mine is None) == (other is None)
                if mine is not None:
                    for name in ("x_px", "y_px", "area_px"):
                        assert getattr(mine, name) == pytest.approx(getattr(other, name))
                    assert np.allclose(mine.backbone.points_px, other.backbone.points_px)


def test_the_film_drawn_again_is_measured_as_it_was_filmed(carp):
    features = load_table(carp / "data/features/features.parquet", FEATURES)
    places = features[["x_px", "y_px"]].to_numpy()
    edit = filmed_edit_list(np.arange(len(features)), places)
    with Project() as project:
        gallery = project.gallery(project.edit_with_sources("network", "realism"))
        table = instrument_of(carp).measure_fish(fish_by_row(edit, gallery))
    simulated = join_measurements([edit], [table], RATE)
    assert (simulated.row == np.arange(len(features))).all()
    off = table[["x_px", "y_px"]].to_numpy() - places
    assert np.median(np.abs(off)) < 0.1  # a soft edge is a little paler than the filmed one
    assert np.abs(off).max() < 0.4
    turned = (table["heading_deg"] - features["heading_deg"] + 180) % 360 - 180
    assert turned.abs().median() < 0.3


@pytest.mark.parametrize("size", [0.5, 1.25])
def test_fish_drawn_larger_or_smaller_are_measured_as_large_as_filmed(carp, size):
    features = load_table(carp / "data/features/features.parquet", FEATURES)
    first = features[features["track_id"] == features["track_id"].iloc[0]]
    one = instrument_of(carp)
    drawn = one.adapt_to_animation(size)
    assert drawn.features.water_current_bl_s == 0.0  # it swims about, however the film was made
    filmed = first[["x_px", "y_px"]].to_numpy()
    about = (filmed - filmed.mean(0)) * size
    places = about + np.array(one.tank.shape[1::-1]) / 2
    edit = filmed_edit_list(np.arange(len(first)), places).assign(scale=size)
    with Project() as project:
        gallery = project.gallery(project.edit_with_sources("network", "realism"))
        table = drawn.measure_fish(fish_by_row(drawn.reduce_to_filmed_size(edit), gallery))
    off = size * (table[["x_px", "y_px"]].to_numpy() + 0.5) - 0.5 - places
    assert np.median(np.abs(off)) < 0.2
    assert table["body_length_px"].median() == pytest.approx(first["body_length_px"].median(), 0.05)
    assert one.adapt_to_animation(1.0).tank is one.tank


def test_another_process_is_sent_no_tables_and_opens_the_same_pictures(carp):
    here = GalleryOpener(Project())
    sent = pickle.dumps(here)
    assert len(sent) < 1000
    with here() as own, pickle.loads(sent)() as other:
        np.testing.assert_array_equal(own.film_picture(3).pixels, other.film_picture(3).pixels)
        np.testing.assert_array_equal(own.bodies.poses.codes, other.bodies.poses.codes)


def test_ticks_that_show_the_film_have_its_rows_whatever_moves_them(tmp_path):
    edit = filmed_edit_list(np.arange(5, 9), np.ones((4, 2)))
    save_table(tmp_path / "film.parquet", edit, EDIT)  # it fits the schema
    edit.loc[1, "mode"] = "network"
    edit.loc[2, "kind"] = SPRITE
    table = fish(0, 4 / RATE)
    twice = join_measurements([edit, edit], [table, table], RATE)
    assert twice.row.tolist() == [5, 6, -1, 8] * 2
    assert twice.list_number.tolist() == [0] * 4 + [1] * 4
    assert np.allclose(twice.time_s * RATE, np.arange(8))
    assert twice.table["track_id"].tolist() == [0] * 4 + [1] * 4
    assert edit["mode"].iloc[0] == "film"


def test_the_stage_writes_numbers_curves_and_examples(carp):
    numbers = load_numbers(carp / "reports/realism")
    names = {"network_auc", "network_auc_low", "matching_auc_high", "halves_auc", "again_auc"}
    assert names <= set(numbers)
    table = pd.read_csv(carp / "data/realism/auc.csv")
    assert table["auc"].between(0, 1).all() and (table["low"] <= table["high"]).all()
    shown = load_table(carp / "data/realism/examples.parquet", examples.EXAMPLES)
    assert set(shown["side"]) == set(examples.SIDES)
    assert (carp / "data/realism/examples.mp4").stat().st_size > 0
    for name in ("auc.png", "contact_sheet.png", "picture_auc.png", "looks.png", "pictures.png"):
        assert load_picture(carp / "reports/modes/realism" / name).std() > 5


def test_a_film_too_short_for_the_blocks_is_said_and_the_rest_goes_on(carp, capsys):
    prepare(carp, *TINY_CARP, "realism.window_deltas=8")
    stages.realism.main()
    assert "no numbers for network" in capsys.readouterr().err
    numbers = load_numbers(carp / "reports/realism")
    assert set(numbers) >= {"film_s", "network_s"} and not any("auc" in name for name in numbers)
    stages.plots.realism.main()


def test_an_animation_without_a_fish_is_said(carp, capsys, monkeypatch):
    edit_lists = {
        "film": [],
        "network": [EditList(filmed_edit_list(np.arange(3), np.ones((3, 2))))],
    }
    nothing = pd.DataFrame(columns=FEATURES.names)
    monkeypatch.setattr(stages.realism, "measure_edit_list", lambda *_: nothing)
    how = GalleryOpener(Project()), dict.fromkeys(edit_lists, instrument_of(carp)), Processes()
    assert stages.realism.measure_swimming(edit_lists, *how) == {}
    assert "the fish of network in 0 %" in capsys.readouterr().err


# --- pictures


TANK = np.full((300, 300), 200, np.uint8)
CAMERA = CropCamera(TANK, 6.0, 60.0, 600.0)


def picture_of(x=150.0, y=150.0, angle_deg=0.0, light=1.0, shade=100, grain=0.0):
    """A dark ellipse, 60 × 12 px, that heads for angle_deg in a tank of 200."""
    frame = TANK.astype(np.float32)
    centre, axes = (round(16 * x), round(16 * y)), (16 * 30, 16 * 6)
    cv2.ellipse(frame, centre, axes, -angle_deg, 0, 360, shade, -1, cv2.LINE_AA, 4)
    noise = np.random.default_rng(round(x)).normal(0, grain, frame.shape) if grain else 0
    return np.clip(np.rint(frame * light + noise), 0, 255).astype(np.uint8)


def channels_of(frame, *place):
    values, _, _ = CropMeter(CAMERA).measure(frame, *(place or (150.0, 150.0, 0.0)))
    return dict(zip(PICTURE_CHANNELS, values, strict=True))


def test_a_crop_shows_the_fish_alike_wherever_it_is_and_heads():
    still = CAMERA.cut(picture_of(), 150.0, 150.0, 0.0)
    moved = CAMERA.cut(picture_of(120.0, 180.0, 70.0), 120.0, 180.0, 70.0)
    assert still.shape == (SIZE, SIZE) and np.abs(still - moved).mean() < 2
    y, x = np.nonzero(still < 150)
    assert np.ptp(x) == pytest.approx(60, abs=2) and np.ptp(y) == pytest.approx(12, abs=2)
    assert (np.abs(still - 200) < 1).mean() > 0.85
    large = CropCamera(TANK, 6.0, 2 * 67.0, 600.0)  # a fish twice as long as fits is shown half
    y, x = np.nonzero(large.cut(picture_of(), 150.0, 150.0, 0.0) < 150)
    assert np.ptp(x) == pytest.approx(30, abs=2)
    corner = CAMERA.cut(picture_of(), 2.0, 299.0, 45.0)  # beyond the frame its edge goes on
    assert np.allclose(corner, 200)


def test_the_light_of_the_whole_picture_is_light_and_not_contrast():
    plain, bright, dark = (
        channels_of(picture_of(light=light, shade=shade))
        for light, shade in ((1.0, 100), (1.1, 100), (1.0, 60))
    )
    assert bright["light"] == pytest.approx(1.1, abs=0.01) and plain["light"] == 1.0
    assert bright["contrast"] == pytest.approx(plain["contrast"], abs=0.01)
    assert plain["contrast"] == pytest.approx(-0.5, abs=0.05)
    assert dark["contrast"] < plain["contrast"] - 0.1
    assert 1.0 < plain["area"] / (np.pi * 30 * 6 / 60**2) < 1.5  # with pixels that it part covers


def test_grain_is_measured_beside_the_fish_in_its_band():
    clean, grainy = channels_of(picture_of()), channels_of(picture_of(grain=4.0))
    assert clean["fine_grain"] < 1e-3
    assert 0.5 * 4 / 200 < grainy["fine_grain"] < 4 / 200  # interpolation takes a part
    assert grainy["fine_grain"] > 2 * grainy["middle_grain"] > 2 * grainy["coarse_grain"]
    ringed = picture_of()
    cv2.ellipse(ringed, (150, 150), (33, 9), 0, 0, 360, 205, 3)  # a faint light halo
    assert channels_of(ringed)["fringe"] < channels_of(picture_of())["fringe"] - 0.01


def test_the_change_from_the_crop_before_is_none_for_a_fish_that_glides():
    meter = CropMeter(CAMERA)
    first, _, none = meter.measure(picture_of(), 150.0, 150.0, 0.0)
    glided, _, change = meter.measure(picture_of(158.0), 158.0, 150.0, 0.0)
    lit, _, _ = meter.measure(picture_of(158.0, light=1.05), 158.0, 150.0, 0.0)
    assert none is None and np.isnan(first[-1])
    assert glided[-1] < 1e-3 and np.abs(change).max() < 0.05
    assert lit[-1] == pytest.approx(0.05, abs=0.005)


def test_another_animal_in_the_crop_of_a_film_gives_nothing():
    two = picture_of()
    cv2.ellipse(two, (140, 180), (25, 6), 0, 0, 360, 90, -1)
    assert np.isnan(CropMeter(CAMERA).measure(two, 150.0, 150.0, 0.0, alone=True)[0]).all()
    assert np.isfinite(CropMeter(CAMERA).measure(two, 150.0, 150.0, 0.0)[0][:-1]).all()
    assert np.isnan(CropMeter(CAMERA).measure(TANK, 150.0, 150.0, 0.0)[0]).all()
    places = pd.DataFrame(
        {"frame": [0, 0, 0, 1], "heading_deg": 0.0, "x_px": [150.0, 190.0, 260.0, 190.0]}
    ).assign(y_px=150.0, track_id=[0, 1, 2, 3])
    for end in ("head", "tail"):
        places = places.assign(**{f"{end}_x_px": places["x_px"], f"{end}_y_px": places["y_px"]})
    assert rows_with_company(np.arange(4), places, CAMERA).tolist() == [True, True, False, False]


def pictures_of(n, seed, flicker):
    """A fish in n ticks whose contrast flickers, as channels of pictures and as crops."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(n, len(PICTURE_CHANNELS)))
    values[:, 0] += flicker * (-1.0) ** np.arange(n)
    rows = np.arange(1, n, 6)
    crops = rng.normal(0, 0.01, (len(rows), 2, SIZE, SIZE))
    crops[:, 1, 40:56, 30:66] += 0.03 * flicker * rng.choice([-1, 1], len(rows))[:, None, None]
    return CropSeries(values, rows, crops.astype(np.float16))


FEW = replace(P, cross_validation_folds=2, classifier_trees=12)


def picture_verdict(flicker):
    film, animation = (
        replace(swimming_of(fish(seed, 60.0), row), pictures=pictures_of(1500, seed, strength))
        for seed, row, strength in ((0, np.arange(1500), 0.0), (1, None, flicker))
    )
    sample = replace(sample_of(fish(0), FEW), film=film)
    windows, crops = (
        replace(sample, view=view).windows_beside_film(animation) for view in ("picture", "crop")
    )
    return classify_pictures(windows, crops, FEW)


def test_a_fish_that_flickers_is_told_by_that_channel_and_in_that_place():
    verdict = picture_verdict(2.0)
    assert verdict.best.value > 0.95 and verdict.alone["crop_change"].value > 0.9
    assert max(PICTURE_CHANNELS, key=lambda name: verdict.alone[name].value) == "contrast"
    assert verdict.alone["contrast"].value > 0.95 and abs(verdict.alone["light"].value - 0.5) < 0.2
    look = verdict.looks[1]
    assert look.sum() == pytest.approx(1)
    assert look[36:60, 26:70].mean() > 3 * look.mean()
    again = Verdict.from_values(json.loads(json.dumps(verdict.to_values())))
    assert again.best == verdict.best and np.array_equal(again.looks, verdict.looks)


def test_pictures_of_one_process_cannot_be_told():
    verdict = picture_verdict(0.0)
    assert abs(verdict.whole.value - 0.5) < 0.15
    assert all(verdict.alone[name].low < 0.55 for name in ("crop", "crop_change"))
