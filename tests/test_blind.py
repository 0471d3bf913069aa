"""The blind test: pairs chosen by chance and alike, a page that counts, answers that are scored."""

import base64
import json
import re
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from browser import chromium, visit
from scipy.stats import binom
from scratch import write_frames
from toy_fish import edit_list, mass_centre

from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.edit.schema import EDIT
from finloop.io.movie import Mp4Writer, VideoWriter
from finloop.io.table import save_table
from finloop.io.video import read_frames
from finloop.project import Project
from finloop.realism.blind import (
    ANSWERS,
    LEAST_PAIRS,
    PAIRS,
    SIDES,
    BlindSource,
    build_blind_page,
    choose_pairs,
    join_halves,
    score_answers,
)
from finloop.render.gallery import CutoutSet, Gallery
from finloop.render.settings import RenderSettings
from stages.blind import PAGE, describe_answers, write_page

TICKS, LENGTH, SHAPE = 50, 40.0, (300, 400)
AROUND = np.array([90], np.uint8)


def swim(ticks, animal=0, start=0, x=200.0, y=150.0, scene=0):
    """An animal that swims on a circle of 60 px around a place."""
    angle = np.arange(ticks) / 15
    places = {"x_px": x + 60 * np.cos(angle), "y_px": y + 60 * np.sin(angle)}
    return pd.DataFrame(
        {"scene": scene, "animal": animal, "tick": start + np.arange(ticks)} | places
    )


def source(*tables, length=LENGTH):
    return BlindSource(pd.concat(tables, ignore_index=True), length, SHAPE)


def hours(scale=1.0):
    return source(*(swim(TICKS * 30, scene=k) for k in range(2)), length=LENGTH * scale)


def content_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script id="content"[^>]*>(.*?)</script>', text, re.DOTALL)[1])


def sides_of(content):
    return [
        SIDES[one["code"] * content["factor"] % content["modulus"] % 2] for one in content["pairs"]
    ]


# --- pairs


def test_half_of_the_films_are_left_and_no_stretch_is_shown_twice():
    pairs = choose_pairs(hours(), hours(), TICKS, seed=1)
    sides = [pair.side for pair in pairs]
    assert len(pairs) == PAIRS and sides.count("left") == PAIRS / 2
    assert sides != sorted(sides)
    for crops in zip(*((pair.film, pair.animation) for pair in pairs), strict=True):
        shown = [(crop.stretch.scene, crop.stretch.first) for crop in crops]
        assert len(set(shown)) == PAIRS
        assert all(first % TICKS == 0 for _, first in shown)


def test_a_seed_gives_the_same_pairs_and_another_one_others():
    def chosen_pairs(seed):
        pairs = choose_pairs(hours(), hours(), TICKS, seed)
        return [(p.film.stretch.first, p.animation.stretch.first, p.side) for p in pairs]

    assert chosen_pairs(3) == chosen_pairs(3) != chosen_pairs(4)


@pytest.mark.parametrize("scale", [1.0, 0.5, 1.7])
def test_both_crops_lie_in_the_picture_and_are_equally_wide_in_body_lengths(scale):
    for pair in choose_pairs(hours(), hours(scale), TICKS, seed=0):
        for crop in (pair.film, pair.animation):
            box = crop.box
            assert box.clip_to(SHAPE) == box
            assert box.bottom - box.top == box.right - box.left
        widths = [len(range(*crop.box[::2])) / crop.length_px for crop in pair[:2]]
        assert widths[0] == pytest.approx(widths[1], rel=0.02)
        assert pair.size_px % 16 == 0  # so no block of the coder lies in both halves


def test_stretches_with_another_animal_near_are_left_out():
    one = swim(200)
    beside = one[60:90].assign(animal=1, x_px=one["x_px"] + 1.4 * LENGTH)
    near = [stretch.first for stretch in source(one, beside).stretches_alone(20)]
    assert near == [0, 20, 40, 90, 110, 130, 150, 170]
    for harmless in (
        beside.assign(x_px=one["x_px"] + 1.6 * LENGTH), beside.assign(scene=1),
        beside.assign(tick=beside["tick"] + 1000),
    ):  # fmt: skip
        assert len(source(one, harmless).stretches_alone(20)) == 11


def test_a_gap_in_a_track_and_another_track_end_a_stretch():
    broken = swim(60).drop(index=30)
    found = source(broken, swim(25, animal=1, x=1e4)).stretches_alone(20)
    assert [stretch.first for stretch in found] == [0, 31, 0]


def test_what_is_near_is_the_film_bit_for_bit_and_all_else_is_hidden():
    rng = np.random.default_rng(0)
    pair = choose_pairs(hours(), hours(), TICKS, seed=0)[0]
    frames = rng.integers(0, 256, (2, TICKS, *SHAPE), dtype=np.uint8)
    size = pair.size_px
    for tick, shown in enumerate(join_halves(*frames, pair, AROUND)):
        assert shown.shape == (size, 2 * size + 16)
        halves = shown[:, :size], shown[:, -size:]
        assert (shown[:, size:-size] == AROUND).all()
        ordered = halves if pair.side == "left" else halves[::-1]
        for half, crop, whole in zip(ordered, pair[:2], frames, strict=True):
            y, x = np.mgrid[:size, :size]
            far = np.hypot(*(np.stack([x, y], -1) - crop.centres[tick]).transpose(2, 0, 1)) / LENGTH
            wanted = whole[tick][crop.box.slices]
            assert (half[far < 0.7] == wanted[far < 0.7]).all()
            assert (half[far > 1] == AROUND).all()


def test_too_little_film_is_fewer_pairs_and_none_that_prove_nothing():
    few = source(swim(TICKS * 7 + 3))
    assert len(choose_pairs(few, hours(), TICKS, seed=0)) == 7
    with pytest.raises(FinloopError, match="3 pairs for a blind test: in 3 stretches of film"):
        choose_pairs(source(swim(TICKS * 3)), hours(), TICKS, seed=0)
    assert score_answers(LEAST_PAIRS, LEAST_PAIRS).low > 0.5
    assert score_answers(LEAST_PAIRS - 1, LEAST_PAIRS - 1).low < 0.5


# --- answers


def test_the_interval_knows_sure_people_from_guessing_ones():
    assert score_answers(40, 40).low > 0.9
    assert score_answers(0, 40).high < 0.1
    assert "does not show" in score_answers(20, 40).sentence
    # Of those who guess, about one in twenty is outside the interval by chance.
    scores = [score_answers(k, 40) for k in range(41)]
    outside = [k for k, score in enumerate(scores) if not score.low <= 0.5 <= score.high]
    assert 0.01 < binom.pmf(outside, 40, 0.5).sum() < 0.07
    for score, mirror in zip(scores, scores[::-1], strict=True):
        assert score.low == pytest.approx(1 - mirror.high)


def write_answers(path, answers, **changes):
    rows = [(k + 1, "left", answer, int(answer == "left"), 1.5) for k, answer in enumerate(answers)]
    pd.DataFrame(rows, columns=list(ANSWERS)).assign(**changes).to_csv(path, index=False)
    return path


def test_answer_files_are_scored_each_and_all(tmp_path):
    files = [
        write_answers(tmp_path / "a.csv", ["left"] * 9 + ["right"]),
        write_answers(tmp_path / "b.csv", ["left", "right"] * 5),
    ]
    first, second, both = describe_answers(files).splitlines()
    assert first.startswith("a.csv: 9 of 10 right, 90% (95 % interval 60% to 98%).")
    assert "5 of 10" in second and both.startswith("all 2: 14 of 20 right")
    assert describe_answers(files[:1]) == first


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "cannot be read"),
        ("", "cannot be read"),
        ("pair,side\n1,left\n", "is no answer file"),
        ("pair,side,answer,right,seconds\n", "is no answer file"),
        ("pair,side,answer,right,seconds\n1,left,right,1,2.0\n", "contradicts itself"),
        ("pair,side,answer,right,seconds\n1,up,up,1,2.0\n", "contradicts itself"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path, text, said):
    if text is not None:
        (tmp_path / "x.csv").write_text(text)
    with pytest.raises(FinloopError, match=said):
        describe_answers([tmp_path / "x.csv"])


# --- the program


RENDER = RenderSettings("matching", "still", False, 20, 0.0, 64, 0.0, 0.0)
RATE = 10


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A film of a bright square that swims for 12 s in noise; its animation shows a dark one."""
    monkeypatch.chdir(tmp_path)
    rng, ticks = np.random.default_rng(0), 12 * RATE
    way = swim(ticks, x=100.0, y=75.0)
    frames = rng.integers(100, 110, (ticks, 150, 200), dtype=np.uint8)
    for frame, x, y in zip(frames, way["x_px"].astype(int), way["y_px"].astype(int), strict=True):
        frame[max(y - 5, 0) : y + 6, max(x - 5, 0) : x + 6] = 220
    (tmp_path / "data/clip").mkdir(parents=True)
    clip = tmp_path / "data/clip/clip.mp4"
    write_frames(VideoWriter(clip, 200, 150, Fraction(RATE)), frames)
    pixels = np.dstack([np.full((11, 11), 20), np.full((11, 11), 255)]).astype(np.uint8)
    centre = mass_centre(pixels[..., -1].astype(float))
    gallery = Gallery({"frame": CutoutSet([Cutout(0, 0, 0, 0, pixels)], np.array([centre]))})
    edit = edit_list(ticks, x_px=way["x_px"], y_px=way["y_px"])
    real = Project(tmp_path)
    save_table(tmp_path / "data/animate/matching.parquet", edit, EDIT)
    features = way.rename(columns={"animal": "track_id", "tick": "frame"})
    facts = SimpleNamespace(
        height_px=150, width_px=200, colour=False, frame_rate=Fraction(RATE), frame_rate_hz=RATE
    )
    return SimpleNamespace(
        data=real.data, edit_list=real.edit_list, rate_hz=float(RATE), features=features,
        facts=facts, background=np.full((150, 200), 105, np.uint8), whole_gallery=gallery,
        scene=SimpleNamespace(typical_length_px=20.0), drawn_scale=lambda mode: 1.0,
        living_tank={"film": None}.__getitem__,  # never without the film's light
    )  # fmt: skip


def test_the_page_has_the_films_frames_on_one_side_and_drawn_ones_on_the_other(project, capsys):
    write_page("matching", 5, RENDER, project)
    assert "6 pairs of film and matching" in capsys.readouterr().out
    content = content_of(PAGE)
    sides = sides_of(content)
    assert len(content["pairs"]) == 6 and sides.count("left") == 3
    lengths = set()
    for side, pair in zip(sides, content["pairs"], strict=True):
        (PAGE.parent / "pair.mp4").write_bytes(base64.b64decode(pair["film"]))
        frames = np.array(list(read_frames(PAGE.parent / "pair.mp4")), float)
        lengths.add(len(frames))
        size = frames.shape[1]
        halves = {"left": frames[..., :size], "right": frames[..., -size:]}
        drawn = halves.pop("right" if side == "left" else "left")
        (filmed,) = halves.values()
        assert filmed.max() > 180 and drawn.min() < 50 and drawn.max() < 130
    assert lengths == {2 * RATE}
    text = PAGE.read_text("utf-8")
    write_page("matching", 5, RENDER, project)
    assert PAGE.read_text("utf-8") == text
    assert not re.search(r"https?://|src=", text)


def test_a_mode_without_an_animation_is_named(project):
    with pytest.raises(FinloopError, match=r"network\.parquet.*\n.*the mode that MODE names"):
        write_page("network", 0, RENDER, project)


def test_a_film_that_is_too_short_is_refused(project):
    project.features = project.features.iloc[: 5 * RATE]
    with pytest.raises(FinloopError, match="2 pairs for a blind test"):
        write_page("matching", 0, RENDER, project)


# --- the page in a browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page of six pairs, in tiny clips."""
    folder = tmp_path_factory.mktemp("blind")
    frames = [np.full((32, 80), 40 * k, np.uint8) for k in range(5)]
    write_frames(Mp4Writer(folder / "a.mp4", (32, 80), Fraction(5), 30), frames)
    sides = ["left", "right", "right", "left", "left", "right"]
    films = [(folder / "a.mp4").read_bytes()] * len(sides)
    (folder / "index.html").write_text(build_blind_page(films, sides, "hybrid", 5.0, 0))
    return folder / "index.html"


SEEN = "() => document.getElementById('clips').readyState >= 2"
STOPPED = "() => document.getElementById('clips').paused"
FITS = "() => document.documentElement.scrollWidth <= innerWidth"


def answer_pairs(shown, act):
    """Answer every pair by an act, which gets the side of the film."""
    for number, side in enumerate(sides_of(json.loads(shown.inner_text("#content"))), 1):
        shown.wait_for_function(
            f"() => document.getElementById('count').textContent === 'Pair {number} of 6'"
        )
        shown.wait_for_function(SEEN)
        act(side)
    return shown.inner_text("#result")


def test_one_who_sees_it_gets_all_and_the_answer_file_says_so(browser, page, tmp_path):
    seen = visit(browser, page, viewport={"width": 360, "height": 700}, accept_downloads=True)
    shown = seen.page
    assert shown.evaluate(FITS)
    shown.click("#start")
    assert shown.evaluate(FITS)
    shown.keyboard.press("x")  # no key of the test
    said = answer_pairs(shown, lambda side: shown.keyboard.press("fj"[side == "right"]))
    assert "6 of 6 right: 100 %" in said and "95 % interval 61 % to 100 %" in said
    assert "So you can tell film and animation apart." in said
    with shown.expect_download() as download:
        shown.click("#save")
    assert download.value.suggested_filename.startswith("blind_hybrid_")
    download.value.save_as(tmp_path / "a.csv")
    assert describe_answers([tmp_path / "a.csv"]).startswith("a.csv: 6 of 6 right, 100%")
    assert not seen.bad


def test_by_touch_with_little_motion_and_all_wrong(browser, page):
    seen = visit(browser, page, reduced_motion="reduce", has_touch=True)
    shown = seen.page
    assert "little motion" in shown.inner_text("#intro")
    shown.tap("#start")
    shown.wait_for_function(SEEN)
    assert shown.evaluate(STOPPED)
    shown.keyboard.press(" ")
    assert not shown.evaluate(STOPPED)

    def tap_other_side(side):
        box = shown.locator("#clips").bounding_box()
        x = box["x"] + box["width"] * (0.25 if side == "right" else 0.75)
        shown.touchscreen.tap(x, box["y"] + box["height"] / 2)

    said = answer_pairs(shown, tap_other_side)
    assert "0 of 6 right" in said and "take the animation for the film" in said
    assert not seen.bad


def test_one_who_stops_is_counted_and_one_who_guesses_shows_nothing(browser, page):
    shown = visit(browser, page).page
    shown.click("#start")
    shown.wait_for_function(SEEN)
    assert shown.get_by_role("status").first.inner_text() == "Pair 1 of 6"
    shown.get_by_role("button", name="the film is left").click()
    shown.wait_for_function("() => document.getElementById('count').textContent === 'Pair 2 of 6'")
    shown.wait_for_function(SEEN)
    shown.get_by_role("button", name="the film is left").click()
    shown.get_by_role("button", name="End here").click()
    said = shown.inner_text("#result")
    assert "1 of 2 right" in said and "does not show" in said and "So few answers" in said
    # What the page computes is what the program computes.
    for k in range(0, 41, 4):
        score = score_answers(k, 40)
        assert shown.evaluate(f"interval({k}, 40)") == pytest.approx([score.low, score.high])
