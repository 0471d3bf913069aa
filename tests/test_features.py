"""Features: heading, bend, head and tail, swimming type, Table 1, pictures; laws and toy swimmers.

A toy swimmer is a stiff arc with a half width per point, moved as asked; all of its numbers are
known in closed form. y is down: what is anticlockwise and left is so as seen on screen.
"""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from conftest import TINY_CARP
from scratch import content, prepare
from tiny_run import copy_of, stage_run

import stages.features
import stages.plots.features
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.features.area import (
    closed_spline_points,
    control_points,
    interpolate_lines,
    measure_bend,
    signed_spline_area,
)
from finloop.features.current import places_through_water
from finloop.features.head import (
    HeadCues,
    _most_probable_states,
    _state_probabilities,
    choose_head_cues,
    decide_head_end,
)
from finloop.features.memory import held_out_block_frames, measure_delta_s
from finloop.features.metrics import (
    compare_with_truth,
    measure_heading_agreement,
    metrics_in_mm,
    orientation_table,
    rows_of_longest_track,
    summarize_features,
)
from finloop.features.swimming_type import (
    BRISK,
    LEFT,
    RIGHT,
    STRAIGHT,
    TurnThresholds,
    classify_swimming_types,
    heading_change,
    measure_turn_thresholds,
    turn_score,
)
from finloop.features.table import (
    FEATURES,
    FeaturesSettings,
    choose_turn_thresholds,
    delta_in_frames,
    find_orientations,
    measure_features,
    measure_headings,
    orient_backbones,
    track_slices,
    wrap_deg,
)
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture, save_figure
from finloop.io.table import load_table, save_table
from finloop.plots.features import (
    Specimen,
    choose_rows_to_check,
    draw_rose,
    draw_specimens,
    draw_trajectories,
    figure7,
)
from finloop.plots.turn import figure5, find_strongest_turn, heading_change_deg

ORIENTATIONS = 24  # conf/features/default.yaml

RATE = 25.0
SETTINGS = FeaturesSettings(
    head="auto", delta_s=0.2, water_current_bl_s=0.0, turn_threshold_deg=16.0, bend_threshold=0.04,
    turn_end_threshold=0.5, orientations=24,
)  # fmt: skip
LENGTH = 60.0
POINTS = 33
WIDTH = LENGTH * 0.09 * np.sin(np.pi * np.linspace(1, 0, POINTS) ** 1.6)  # head first: blunt there


def body(heading_deg, arc_deg=0.0, points=POINTS):
    """A stiff body (points, 2), head first at the origin, its neck pointing along the heading.

    An arc of `arc_deg`: from tail to head it turns that much to the left.
    """
    share = np.linspace(0, 1, points)
    along = np.radians(heading_deg - arc_deg * share[:-1] - arc_deg / 2 / (points - 1))
    step = LENGTH / (points - 1) * np.stack([np.cos(along), -np.sin(along)], 1)
    return np.vstack([[0, 0], -np.cumsum(step, 0)])


def swim(frames, speed=4.0, turn_deg=0.0, heading_deg=0.0, arc_deg=0.0, wag_deg=0.0):
    """Backbones (frames, POINTS, 2), head first, `speed` px a frame along a circle or a line."""
    at = np.arange(frames)
    direction = heading_deg + turn_deg * at
    wag = wag_deg * np.sin(2 * np.pi * 2 * at / RATE)  # the body beats to and fro, twice a second
    half = np.radians(turn_deg) / 2
    chord = speed * (np.sin(half) / half if half else 1.0)
    way = np.radians(direction[:-1] + turn_deg / 2)
    place = np.vstack([[0, 0], np.cumsum(chord * np.stack([np.cos(way), -np.sin(way)], 1), 0)])
    shapes = np.stack([body(h, arc_deg + w) for h, w in zip(direction, wag, strict=True)])
    return shapes + place[:, None] + (400, 300)


def tracks_table(*tracks, start=0, width=WIDTH):
    """A table of tracks out of backbones (frames, n, 2) each."""
    return pd.DataFrame([
        {
            "track_id": number, "frame": start + frame,
            "x_px": line[:, 0].mean(), "y_px": line[:, 1].mean(),
            "length_px": np.hypot(*np.diff(line, axis=0).T).sum(),
            "backbone_x_px": line[:, 0].astype(np.float32),
            "backbone_y_px": line[:, 1].astype(np.float32),
            "half_width_px": np.asarray(width, np.float32),
        }
        for number, lines in enumerate(tracks)
        for frame, line in enumerate(lines)
    ])  # fmt: skip


def shuffle_ends(lines, width, rng):
    """Each backbone with either end first; also which of them are head first."""
    first = rng.random(len(lines)) < 0.5
    width = np.broadcast_to(width, lines.shape[:2])
    lines = np.where(first[:, None, None], lines, lines[:, ::-1])
    return lines, np.where(first[:, None], width, width[:, ::-1]), first


# -- angles -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [4, 10, 24, 36, 120])
def test_every_orientation_is_as_wide_and_they_go_round(count):
    fine, sector = np.arange(-179.95, 180, 0.1), 360 / count
    number = find_orientations(fine, count)
    assert number.min() == 1 and number.max() == count
    assert np.all(np.bincount(number)[1:] == 3600 / count)
    assert np.abs(wrap_deg(fine - (number - 1.0) * sector)).max() <= sector / 2
    assert np.all(find_orientations(wrap_deg(fine + sector), count) == number % count + 1)


def test_wrapping():
    given = np.array([0, 180, -180, 540, 181, -181, 360, 720.5, -359])
    assert np.allclose(wrap_deg(given), [0, 180, 180, 180, -179, 179, 0, 0.5, 1])
    many = np.random.default_rng(0).uniform(-2000, 2000, 5000)
    wrapped = wrap_deg(many)
    assert wrapped.min() > -180
    assert wrapped.max() <= 180
    assert np.allclose(np.cos(np.radians(wrapped)), np.cos(np.radians(many)))
    assert np.allclose(np.sin(np.radians(wrapped)), np.sin(np.radians(many)))


@pytest.mark.parametrize(
    ("toward", "degrees"),
    [((1, 0), 0), ((0, -1), 90), ((-1, 0), 180), ((0, 1), -90), ((1, -1), 45)],
)
def test_heading_is_anticlockwise_on_screen(toward, degrees):
    line = np.linspace(1, 0, POINTS)[:, None] * np.array(toward)  # head first
    assert measure_headings(line[None]) == pytest.approx([degrees])


@pytest.mark.parametrize("points", [13, 33, 34, 35])
def test_the_tail_does_not_turn_the_heading(points):
    straight, beating = body(30, points=points), body(30, points=points)
    behind = np.arange(points) > np.ceil((points - 1) / 3)
    beating[behind] += np.random.default_rng(1).normal(0, 9, (behind.sum(), 2))
    assert measure_headings(np.stack([straight, beating])) == pytest.approx([30, 30])


@pytest.mark.parametrize("points", [13, 33, 34, 35])
def test_the_heading_of_a_bent_fish_is_the_chord_of_its_front_third(points):
    # The chord of a circle's arc lies half the arc's angle off its end.
    assert measure_headings(body(70, 60, points)[None]) == pytest.approx([70 - 60 / 6], abs=0.3)


@pytest.mark.parametrize(
    ("delta_s", "rate", "frames"),
    [(0.2, 25, 5), (0.2, 28.07, 6), (0.2, 30, 6), (0.2, 100, 20), (0.2, 2, 1), (0.04, 25, 1)],
)
def test_delta_is_a_time(delta_s, rate, frames):
    assert delta_in_frames(delta_s, rate) == frames


@pytest.mark.parametrize(
    ("bent", "beat_s", "rate", "frames", "delta_s"),
    [
        (1, 1.0, 25, 500, 0.2),  # the paper's: half a beat is longer
        (1, 0.05, 500, 700, 0.025),  # a larva: half a beat
        (1, 1.0, 500, 60, 0.03),  # a quarter of the track
        (0, 1.0, 25, 300, 0.2),  # a fish that never bends
    ],
)
def test_delta_is_measured_in_the_film(bent, beat_s, rate, frames, delta_s):
    bend = bent * np.sin(2 * np.pi * np.arange(frames) / rate / beat_s)
    assert measure_delta_s([bend], rate) == pytest.approx(delta_s, rel=0.05)


def test_blocks_are_shorter_in_a_short_film():
    assert held_out_block_frames(10.0, 0.2, 5, np.arange(1500), 10) == 50
    assert held_out_block_frames(10.0, 0.2, 5, np.arange(100), 10) == 20
    assert held_out_block_frames(10.0, 0.2, 5, np.arange(20), 10) == 10
    assert held_out_block_frames(10.0, 0.2, 5, np.arange(0), 10) == 10


# -- motion area ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("count", [4, 5, 6, 7, 9])
def test_the_area_is_that_of_the_curve(count, seed):
    control = np.random.default_rng(seed).normal(0, 20, (count, 2))
    x, y = closed_spline_points(control, 4000).T
    polygon = -0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)  # y is down
    assert signed_spline_area(control[None])[0] == pytest.approx(polygon, rel=1e-6, abs=1e-4)


def test_the_curve_is_the_uniform_cubic_b_spline():
    control = np.random.default_rng(2).normal(size=(6, 2))
    curve = closed_spline_points(control, 8).reshape(6, 8, 2)
    knots = (control + 4 * np.roll(control, -1, 0) + np.roll(control, -2, 0)) / 6
    assert np.allclose(curve[:, 0], knots)
    assert np.abs(np.diff(np.vstack([*curve, curve[0, :1]]), axis=0)).max() < 1


def test_control_points_lie_at_their_shares():
    line = np.stack([np.linspace(0, 30, 13), np.zeros(13)], 1)[None]
    assert np.allclose(control_points(line)[0, :, 0], [0, 5, 10, 15, 25, 30])
    line = np.stack([np.linspace(0, 30, 34), np.linspace(0, 60, 34)], 1)[None]
    assert np.allclose(control_points(line)[0, :, 1], [0, 10, 20, 30, 50, 60])


def bends(lines):
    lines = np.asarray(lines)
    return measure_bend(lines, np.hypot(*np.diff(lines, axis=1).transpose(2, 0, 1)).sum(1))


def test_a_bend_to_the_left_is_plus_and_grows_with_the_arc():
    arcs = np.arange(-150, 151, 25)
    for heading_deg in (20, 107, 251):
        found = bends([body(heading_deg, arc) for arc in arcs])
        assert np.array_equal(np.sign(found.round(9)), np.sign(arcs))  # 0 for a straight fish
        assert np.all(np.diff(found) > 0)
        assert found == pytest.approx(-found[::-1])
    # By hand: heads up on screen, the tail points left, as in a turn from right to up.
    line = np.array([[10, 0], [10, 3], [9, 6], [7, 8], [4, 9.5], [0, 10.0]])
    assert bends([line])[0] > 0.02
    anticlockwise = np.array([[[0, 0], [0, 1], [1, 1], [1, 0.0]]])
    assert signed_spline_area(anticlockwise)[0] > 0


def test_place_direction_and_size_do_not_change_the_bend():
    fish = np.stack([body(10, 80), body(-140, -50)])
    angle = np.radians(33)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for seen in (fish + (300, -20), fish @ turn, 3 * fish):
        assert bends(seen) == pytest.approx(bends(fish))
    one, large = (signed_spline_area(control_points(lines)) for lines in (fish, 3 * fish))
    assert large == pytest.approx(9 * one)
    assert bends(fish * (-1, 1)) == pytest.approx(-bends(fish))


# -- head or tail -----------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_the_head_is_found_in_every_frame(seed):
    rng = np.random.default_rng(seed)
    lines = swim(80, speed=2.0, turn_deg=rng.uniform(-6, 6), wag_deg=40)
    lines = lines + rng.normal(0, 0.02 * LENGTH, lines.shape)
    width = WIDTH * rng.lognormal(0, 0.2, (80, 1)) + rng.normal(0, 0.5, (80, POINTS))
    mixed, widths, first = shuffle_ends(lines, width, rng)
    found, confidence = decide_head_end(mixed, widths, RATE)
    assert np.array_equal(found, first)
    assert confidence.min() > 0.9


@pytest.mark.parametrize(
    ("speed", "width"), [(3.0, np.full(POINTS, 4.0)), (0.0, WIDTH)], ids=["by way", "by shape"]
)
def test_one_cue_is_enough_to_find_the_head(speed, width):
    mixed, widths, first = shuffle_ends(swim(60, speed=speed), width, np.random.default_rng(0))
    found, confidence = decide_head_end(mixed, widths, RATE)
    assert np.array_equal(found, first)
    assert confidence.min() > 0.9
    if speed == 0:  # a single frame, too
        assert decide_head_end(mixed[:1], widths[:1], RATE)[0] == first[:1]


@pytest.mark.parametrize("rule", ["auto", "blunt", "thin", "travel"])
@pytest.mark.parametrize("leads", ["blunt", "thin"])
def test_the_end_that_leads_in_the_film_is_the_head(rule, leads):
    """One animal moves about; another rests, so that only its shape tells its head."""
    width = WIDTH if leads == "blunt" else WIDTH[::-1]
    lines = [swim(60, speed=3.0), swim(60, speed=0.0) + 300.0]
    tracks = tracks_table(*lines, width=width)
    found, confidence = orient_backbones(tracks, RATE, rule=rule)
    truth = np.concatenate(lines)
    ahead = np.linalg.norm(found[:, 0] - truth[:, 0], axis=1) < 1
    assert ahead[:60].all() == (rule in ("auto", "travel", leads))
    assert rule == "travel" or ahead[60:].all() == (rule in ("auto", leads))
    assert rule == "travel" or confidence.min() > 0.9


def test_a_few_steps_backwards_do_not_make_the_thin_end_the_head():
    line = swim(4, speed=-3.0)
    cues = choose_head_cues("auto", line, np.broadcast_to(WIDTH, (4, POINTS)), [slice(0, 4)], RATE)
    assert cues == HeadCues(1, True)


def test_a_fish_may_be_pushed_backwards_for_a_while():
    lines = np.concatenate([swim(50), swim(50)[-1] + (swim(12) - swim(12)[0]) * (-0.5, 1)])
    found, _ = decide_head_end(lines, np.broadcast_to(WIDTH, (62, POINTS)), RATE)
    assert found.all()


def test_one_wild_frame_does_not_outvote_a_track():
    # A silhouette that jumps back by two body lengths for once, of a fish hardly blunter in front.
    lines = swim(40, 0.0)
    lines[20:] -= (2 * LENGTH, 0)
    width = 4.0 + 0.3 * (WIDTH - WIDTH[::-1]) / 2
    found, _ = decide_head_end(lines, np.tile(width, (40, 1)), RATE)
    assert found.all()


def test_without_any_evidence_nothing_is_sure():
    _, confidence = decide_head_end(swim(40, speed=0.0), np.full((40, POINTS), 4.0), RATE)
    assert confidence == pytest.approx(0.5)


def test_confidence_grows_with_evidence():
    def sureness(share, frames=40, speed=0.0, rate=RATE):
        width = 4.0 + share * (WIDTH - WIDTH[::-1]) / 2
        return decide_head_end(swim(frames, speed), np.tile(width, (frames, 1)), rate)[1].mean()

    shapes = [sureness(share) for share in (0, 0.05, 0.1, 0.2, 0.4)]
    assert np.all(np.diff(shapes) > 0.01)
    assert np.all(np.diff([sureness(0.05, frames) for frames in (5, 20, 80)]) > 0.01)  # more film
    assert np.all(np.diff([sureness(0, speed=v) for v in (0, 0.2, 0.5, 1)]) > 0.01)
    # The same film taken at four times the rate says hardly more, frame by frame four times less.
    assert sureness(0.05, 160, rate=4 * RATE) == pytest.approx(sureness(0.05, 40), abs=0.02)


def test_a_frame_that_contradicts_its_track_lowers_its_confidence_only():
    widths = np.tile(WIDTH, (60, 1))
    _, plain = decide_head_end(swim(60, 1.0), widths, RATE)
    widths[30] = widths[30, ::-1]
    found, confidence = decide_head_end(swim(60, 1.0), widths, RATE)
    assert found.all()
    assert np.all(confidence <= plain + 1e-12)


def chain(seed, frames=8):
    """Random log odds of frames and of staying; log probability of every sequence of states."""
    rng = np.random.default_rng(seed)
    evidence, stay = rng.normal(0, 3, frames), rng.normal(1, 2, frames - 1)
    paths = np.array(list(itertools.product([0, 1], repeat=frames)))
    moved = paths[:, 1:] != paths[:, :-1]
    score = np.where(paths == 0, evidence, 0).sum(1) + np.where(moved, 0, stay).sum(1)
    return (evidence.tolist(), stay.tolist()), paths, score


@pytest.mark.parametrize("seed", range(15))
def test_the_best_states_and_their_probabilities_against_every_sequence(seed):
    given, paths, score = chain(seed)
    assert np.array_equal(_most_probable_states(*given), paths[score.argmax()] == 0)
    weight = np.exp(score - score.max())
    probability = (weight[:, None] * (paths == 0)).sum(0) / weight.sum()
    assert _state_probabilities(*given) == pytest.approx(probability)


def test_a_long_track_does_not_overflow():
    (evidence, stay), _, _ = chain(0)
    given = [50 * one for one in evidence * 500], (stay * 600)[:3999]
    sure = _state_probabilities(*given)
    assert np.isfinite(sure).all()
    assert _state_probabilities(*([-one for one in given[0]], given[1])) == pytest.approx(1 - sure)


# -- swimming type ----------------------------------------------------------------------------------


def kind(turned, bent, **changed):
    given = {"turn_deg": 16.0, "bend": 0.04, "release": 0.5} | changed
    release = given.pop("release")
    both = np.asarray(turned, float), np.asarray(bent, float)
    return classify_swimming_types(*both, TurnThresholds(**given), release)


@pytest.mark.parametrize("span", [1, 4, 5, 6])
@pytest.mark.parametrize("frames", [2, 3, 30])
def test_a_steady_turn_is_the_same_everywhere(span, frames):
    # Near the ends as well, across ±180°, and in a track shorter than the span.
    turn = 4.0 * np.arange(frames)
    assert heading_change(wrap_deg(150 + turn), span) == pytest.approx(4.0 * span)
    assert heading_change(wrap_deg(-150 - turn), span) == pytest.approx(-4.0 * span)
    assert heading_change(turn[:1], span) == [0.0]


def test_a_turn_is_centred_on_its_frame():
    heading_deg = np.concatenate([np.zeros(20), np.full(20, 10.0)])
    assert np.flatnonzero(heading_change(heading_deg, 4)).tolist() == [18, 19, 20, 21]
    assert np.flatnonzero(heading_change(heading_deg, 5)).tolist() == [17, 18, 19, 20, 21]


def test_both_cues_count_in_units_of_their_thresholds():
    assert kind([15.9], [0.04]).tolist() == [STRAIGHT]
    assert kind([16.1], [0.04]).tolist() == [LEFT]
    assert kind([33.0], [0.0]).tolist() == [LEFT]
    assert kind([33.0], [-0.04]).tolist() == [STRAIGHT]  # a tail beat against the turn
    assert kind([-16.1], [-0.04]).tolist() == [RIGHT]
    assert kind([16.1], [0.04], turn_deg=20.0).tolist() == [STRAIGHT]
    assert kind([16.1], [0.04], bend=0.05).tolist() == [STRAIGHT]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("release", [0.2, 0.5, 1.0])
def test_hysteresis(seed, release):
    rng = np.random.default_rng(seed)
    score = np.convolve(rng.normal(0, 2.0, 300), np.hanning(9) / 3, "same")
    found = kind(16 * score, 0.04 * score, release=release)
    for sign in (LEFT, RIGHT):
        above = np.concatenate([[False], sign * score > release, [False]])
        edges = np.flatnonzero(np.diff(above))
        for start, stop in edges.reshape(-1, 2):  # a run above release is a turn as a whole or not
            assert np.all((found[start:stop] == sign) == ((sign * score[start:stop]).max() > 1))
        assert not np.any((found == sign) & ~above[1:-1])


def weaving(deg_s, bent, seconds=60.0, rate=RATE):
    """Heading [°] and bend of a track that turns to and fro, at most so quickly and so bent."""
    time = np.arange(0, seconds, 1 / rate)
    wave = 2 * np.pi * time / 20
    return deg_s * 20 / (2 * np.pi) * np.sin(wave), bent * np.cos(wave)


@pytest.mark.parametrize("slower", [0.2, 0.4])
def test_a_slow_fish_turns_as_often_as_a_brisk_one(slower):
    # 45° and more in all, but never 16° in Δ: by fixed thresholds it would swim straight for ever.
    heading_deg, bent = weaving(75.0 * slower, 0.04 * slower, seconds=120.0)
    both = heading_change(heading_deg, 5), bent
    assert set(classify_swimming_types(*both, BRISK, 0.5)) == {STRAIGHT}
    limits = measure_turn_thresholds([heading_deg], [bent], 5)
    types = classify_swimming_types(*both, limits, 0.5)
    assert (np.abs(turn_score(*both, limits)) >= 1).mean() == pytest.approx(0.1, abs=0.02)
    assert {LEFT, RIGHT} < set(types.tolist())
    # In its own units it turns just as a fish twice as slow does in its own.
    slow = measure_turn_thresholds([heading_deg / 2 + 7.0], [bent / 2], 5)
    assert slow == pytest.approx([value / 2 for value in limits])


def test_a_brisk_fish_and_one_that_keeps_its_heading_have_the_thresholds_of_a_brisk_one():
    heading_deg, bent = weaving(300.0, 0.1)
    assert measure_turn_thresholds([heading_deg], [bent], 5) == BRISK
    time = np.arange(500)
    wag = 5.0 * np.sin(time)  # of a tail beat
    assert measure_turn_thresholds([wag + 178.0, wag - 90.0], [0.01 * np.cos(time)] * 2, 5) == BRISK


def test_given_thresholds_are_kept():
    heading_deg, bent = weaving(10.0, 0.002)
    given = replace(SETTINGS, turn_threshold_deg=9.0, bend_threshold="auto")
    limits = choose_turn_thresholds(heading_deg, bent, [slice(0, len(bent))], 5, given)
    measured = measure_turn_thresholds([heading_deg], [bent], 5)
    assert limits == TurnThresholds(9.0, measured.bend)


# -- the table --------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn_deg", [0.0, 4.0, -7.0])
@pytest.mark.parametrize("rate", [25.0, 28.07, 60.0])
def test_a_steady_swimmer_in_closed_form(turn_deg, rate):
    frames, speed = 50, 3.0
    lines = swim(frames, speed, turn_deg, heading_deg=100)
    tracks = tracks_table(lines, start=7)
    tracks[["x_px", "y_px"]] = lines[:, 0]  # any point fixed to the neck goes round the circle
    table, backbones = measure_features(tracks, rate, SETTINGS)
    delta = delta_in_frames(0.2, rate)
    assert table["frame"].tolist() == list(range(7, 57))
    assert table["time_s"].to_numpy() == pytest.approx(np.arange(7, 57) / rate)
    assert table["heading_deg"].to_numpy() == pytest.approx(
        wrap_deg(100 + turn_deg * np.arange(frames)), abs=1e-3
    )
    half = np.radians(turn_deg) / 2
    way = speed * (np.sin(half * delta) / half if turn_deg else delta)
    assert table["displacement"][:-delta].to_numpy() == pytest.approx(way / LENGTH, rel=1e-4)
    angle = table["included_angle_deg"][:-delta].to_numpy()
    assert angle == pytest.approx(turn_deg * delta, abs=1e-3)
    assert table["displacement"].isna().sum() == table["included_angle_deg"].isna().sum() == delta
    assert table["body_length_px"].to_numpy() == pytest.approx(LENGTH, rel=1e-5)
    assert table[["head_x_px", "head_y_px"]].to_numpy() == pytest.approx(lines[:, 0], abs=1e-3)
    assert table[["tail_x_px", "tail_y_px"]].to_numpy() == pytest.approx(lines[:, -1], abs=1e-3)
    assert backbones == pytest.approx(lines, abs=1e-3)
    straight = abs(turn_deg * delta) < 32
    assert set(table["swimming_type"]) == {STRAIGHT if straight else np.sign(turn_deg)}


def test_displacement_takes_the_length_of_the_whole_track():
    tracks = tracks_table(swim(20, 3.0))
    tracks.loc[8, "length_px"] = 90.0  # one frame measured badly
    table, _ = measure_features(tracks, RATE, SETTINGS)
    assert table["displacement"][:15].to_numpy() == pytest.approx(15 / LENGTH)


@pytest.mark.parametrize("frames", [1, 2, 5, 6])
def test_what_lies_beyond_the_end_of_a_track_is_null_and_not_zero(tmp_path, frames):
    tracks = tracks_table(swim(frames), swim(12), swim(frames))
    table, _ = measure_features(tracks, RATE, SETTINGS)  # Δ = 5 frames
    save_table(tmp_path / "t.parquet", table, FEATURES)
    back = load_table(tmp_path / "t.parquet", FEATURES)
    known = [max(0, frames - 5), 7, max(0, frames - 5)]
    for column in ("displacement", "included_angle_deg"):
        assert back.groupby("track_id")[column].count().tolist() == known
    others = [c.name for c in FEATURES.columns if not c.nullable]
    assert not back[others].isna().any().any()


def test_which_end_a_backbone_begins_with_does_not_matter():
    lines = swim(40, 3.0, 4.0, wag_deg=50)
    mixed, widths, _ = shuffle_ends(lines, WIDTH, np.random.default_rng(7))
    tracks = tracks_table(mixed).assign(half_width_px=list(widths))
    table, backbones = measure_features(tracks, RATE, SETTINGS)
    plain, same = measure_features(tracks_table(lines), RATE, SETTINGS)
    pd.testing.assert_frame_equal(table, plain)
    assert np.array_equal(backbones, same)
    assert backbones == pytest.approx(lines, abs=1e-4)


def test_the_table_has_the_rows_of_the_tracks_and_fits_its_schema(tmp_path):
    tracks = tracks_table(swim(9), swim(15, turn_deg=3, arc_deg=60), swim(11, heading_deg=90))
    with pytest.raises(FinloopError, match="not sorted by track_id, frame"):
        measure_features(tracks.sample(frac=1, random_state=0), RATE, SETTINGS)
    table, backbones = measure_features(tracks, RATE, SETTINGS)
    assert table[["track_id", "frame"]].equals(tracks[["track_id", "frame"]])
    assert len(backbones) == len(tracks)
    assert list(table) == [c.name for c in FEATURES.columns]
    save_table(tmp_path / "t.parquet", table, FEATURES)
    back = load_table(tmp_path / "t.parquet", FEATURES)
    assert np.allclose(back.astype(float), table.astype(float), rtol=1e-6, equal_nan=True)


def test_motion_area_is_the_size_of_the_bend_and_relative_to_the_largest():
    tracks = tracks_table(swim(9, arc_deg=-70), swim(9, arc_deg=40), swim(9))
    table, _ = measure_features(tracks, RATE, SETTINGS)
    assert table["motion_area"].to_numpy() == pytest.approx(table["bend"].abs().to_numpy())
    assert table["motion_area_rel"].groupby(table["track_id"]).max().tolist() == pytest.approx(
        [1, bends([body(0, 40)])[0] / bends([body(0, 70)])[0], 0], abs=1e-4
    )
    assert np.sign(table["bend"].round(6)).groupby(table["track_id"]).mean().tolist() == [-1, 1, 0]
    flat = np.linspace(60, 0, POINTS)[:, None] * (1.0, 0.0) + np.arange(9)[:, None, None] * (1, 0)
    table, _ = measure_features(tracks_table(flat), RATE, SETTINGS)  # no fish is ever bent
    assert table["motion_area_rel"].tolist() == [0] * 9


SEEN = {  # points seen otherwise; the heading then; the sign of left
    "shifted": (lambda p: p + (-120, 35), lambda h: h, 1),
    "turned by 90°": (lambda p: p[..., ::-1] * (1, -1), lambda h: h + 90, 1),
    "turned by 180°": (lambda p: -p, lambda h: h + 180, 1),
    "mirrored": (lambda p: p * (-1, 1), lambda h: 180 - h, -1),
}


@pytest.mark.parametrize("view", SEEN)
def test_the_same_film_seen_otherwise(view):
    see, point, side = SEEN[view]
    rng = np.random.default_rng(6)
    films = [
        shuffle_ends(swim(40, 3, turn_deg, heading_deg, wag_deg=50), WIDTH, rng)
        for turn_deg, heading_deg in ((2, 0), (-6, 77), (8, 200))
    ]

    def measure_changed(change):
        tracks = tracks_table(*(change(lines) for lines, _, _ in films))
        tracks["half_width_px"] = [w for _, widths, _ in films for w in widths]
        return measure_features(tracks, RATE, SETTINGS)[0]

    one, other = measure_changed(lambda p: p), measure_changed(see)
    assert {LEFT, RIGHT, STRAIGHT} == set(one["swimming_type"])
    assert wrap_deg(other["heading_deg"] - point(one["heading_deg"])) == pytest.approx(0, abs=1e-3)
    for column in ("bend", "included_angle_deg"):
        assert np.allclose(other[column], side * one[column], atol=1e-3, equal_nan=True)
    assert np.array_equal(other["swimming_type"], side * one["swimming_type"])
    for column in ("displacement", "motion_area", "motion_area_rel", "body_length_px",
                   "head_confidence", "time_s"):  # fmt: skip
        assert np.allclose(other[column], one[column], rtol=1e-3, atol=1e-4, equal_nan=True)
    if view.startswith("turned"):
        sectors = 6 if "90" in view else 12
        clear = np.abs(one["heading_deg"] / 15 - np.floor(one["heading_deg"] / 15) - 0.5) > 0.01
        moved = (one["orientation"] - 1 + sectors) % ORIENTATIONS + 1
        assert np.array_equal(other["orientation"][clear], moved[clear])


# -- Table 1 and the other numbers ------------------------------------------------------------------


def toy_table():
    """Two tracks of a few frames: orientations 1 and 7, all types."""
    return pd.DataFrame({
        "track_id": [0, 0, 0, 0, 1, 1, 1, 1, 1, 1], "frame": [0, 1, 2, 3, 0, 1, 2, 3, 4, 5],
        "orientation": np.int8([1, 1, 1, 1, 1, 7, 7, 7, 7, 7]), "orientations": ORIENTATIONS,
        "swimming_type": np.int8([0, 0, 1, 1, -1, 0, 0, 0, -1, -1]),
        "motion_area": [0.01, 0.02, 0.04, 0.08, 0.05, 0.01, 0.01, 0.01, 0.1, 0.02],
    })  # fmt: skip


def test_table_1_by_hand():
    table = orientation_table(toy_table()).set_index("orientation")
    assert table.index.tolist() == list(range(1, 25))
    assert table.loc[1].to_dict() == pytest.approx(
        {"straight_pct": 40, "right_pct": 20, "max_area_right": 0.5, "left_pct": 40,
         "max_area_left": 1.0, "amount_pct": 50}
    )  # fmt: skip
    assert table.loc[7].to_dict() == pytest.approx(
        {"straight_pct": 60, "right_pct": 40, "max_area_right": 1.0, "left_pct": 0,
         "max_area_left": 0.0, "amount_pct": 50}
    )  # fmt: skip
    others = table.drop([1, 7])
    assert others.pop("amount_pct").tolist() == [0] * 22
    assert others.isna().all().all()
    straight = orientation_table(toy_table().assign(swimming_type=0)).iloc[[0, 6]]
    assert straight["straight_pct"].tolist() == [100, 100]
    assert not straight[["max_area_left", "max_area_right"]].any(axis=None)


def test_the_summary():
    tracks = tracks_table(swim(70, 3.0), swim(20, 3.0, turn_deg=8.0, arc_deg=60))
    numbers = summarize_features(measure_features(tracks, RATE, SETTINGS)[0])
    assert numbers["fish_frames"] == 90
    assert numbers["tracks"] == 2
    assert numbers["fish_frames_in_tracks_of_60_frames"] == 70
    assert numbers["straight_pct"] == pytest.approx(100 * 70 / 90)
    assert numbers["left_pct"] == pytest.approx(100 * 20 / 90)
    assert numbers["right_pct"] == 0
    assert numbers["orientations_seen"] == 11  # 0° to 152°, less the chord of the bent neck
    assert numbers["displacement_median_body_lengths"] == pytest.approx(15 / 60)
    assert numbers["headed_along_travel_pct"] == 100
    one_frame, _ = measure_features(tracks_table(swim(1)), RATE, SETTINGS)
    numbers = summarize_features(one_frame)
    assert numbers["fish_frames"] == 1 and numbers["moving_fish_frames"] == 0
    assert np.isnan(numbers["displacement_median_body_lengths"])


def test_how_many_swim_forwards():
    tracks = tracks_table(swim(30, 3.0, 1.0), swim(20, 3.0, heading_deg=45), swim(9, 0.0))
    table, _ = measure_features(tracks, RATE, SETTINGS)
    found = measure_heading_agreement(table)
    assert found["moving_fish_frames"] == 25 + 15
    assert found["headed_along_travel_pct"] == 100
    assert found["heading_off_travel_median_deg"] < 15
    swapped = table.copy()
    swapped.loc[swapped["track_id"] == 1, "heading_deg"] = -135.0
    found = measure_heading_agreement(swapped)
    assert found["headed_along_travel_pct"] == pytest.approx(100 * 25 / 40)
    still, _ = measure_features(tracks_table(swim(9, 0.0)), RATE, SETTINGS)
    assert measure_heading_agreement(still) == {"moving_fish_frames": 0}


def truth_of(table, backbones):
    """The truth that this table would be perfect against; backbones at 65 points."""
    lines = interpolate_lines(backbones, np.linspace(0, POINTS - 1, 65))
    same = ["frame", "x_px", "y_px", "heading_deg", "body_length_px", "bend", "swimming_type"]
    return table[same].assign(
        fish_id=table["track_id"], curvature_deg=table["bend"],
        backbone_x_px=list(lines[..., 0]), backbone_y_px=list(lines[..., 1]),
    )  # fmt: skip


@pytest.fixture(scope="module")
def swimmers_with_truth():
    """A table of two swimmers, its backbones, and the truth that it agrees with."""
    wagging = swim(40, 3.0, 4.0, wag_deg=60), swim(30, 3.0, -6.0, 90, arc_deg=-40) + (300, 0)
    table, backbones = measure_features(tracks_table(*wagging), RATE, SETTINGS)
    return table, backbones, truth_of(table, backbones)


def test_against_itself_nothing_is_wrong(swimmers_with_truth):
    found = compare_with_truth(*swimmers_with_truth)
    assert found["truth_found_pct"] == 100
    for name in ("centre_error_median_px", "centre_error_p95_px", "heading_error_median_deg",
                 "heading_error_p95_deg", "head_tail_swaps", "identity_changes"):  # fmt: skip
        assert found[f"truth_{name}"] == 0
    assert found["truth_backbone_error_mean_pct"] == pytest.approx(0, abs=1e-4)
    assert found["truth_body_length_bias_pct"] == 0
    assert found["truth_swimming_type_agreement_pct"] == 100
    assert found["truth_motion_area_bend_rank_correlation"] == pytest.approx(1)


def test_errors_are_counted(swimmers_with_truth):
    table, backbones, truth = swimmers_with_truth
    moved = table.assign(
        x_px=table["x_px"] + 3.0,
        y_px=table["y_px"] - 4.0,
        heading_deg=wrap_deg(table["heading_deg"] + 7),
        body_length_px=table["body_length_px"] * 1.02,
        swimming_type=np.where(table["track_id"] == 1, 0, table["swimming_type"]),
    )
    lines = backbones + np.float32([0.03, 0.04]) * LENGTH
    swapped = np.arange(len(table)) % 7 == 0
    lines[swapped] = lines[swapped][:, ::-1]
    found = compare_with_truth(moved, lines, truth)
    assert found["truth_centre_error_median_px"] == pytest.approx(5)
    assert found["truth_heading_error_median_deg"] == pytest.approx(7, abs=1e-4)
    assert found["truth_body_length_bias_pct"] == pytest.approx(2)
    assert found["truth_head_tail_swaps"] == swapped.sum()
    assert found["truth_backbone_error_mean_pct"] == pytest.approx(5, abs=1e-3)  # swaps set aside
    right = (moved["swimming_type"] == truth["swimming_type"]).mean()
    assert found["truth_swimming_type_agreement_pct"] == pytest.approx(100 * right)
    assert found["truth_right_recall_pct"] == 0


def test_lost_and_confused_fish_are_counted(swimmers_with_truth):
    table, backbones, truth = swimmers_with_truth
    keep = (table["frame"] % 2 == 0).to_numpy()
    found = compare_with_truth(table[keep].reset_index(drop=True), backbones[keep], truth)
    assert found["truth_found_pct"] == pytest.approx(100 * keep.mean())
    # One track that passes from one fish to the other and back.
    both = table[table["frame"] < 30].sort_values(["frame", "track_id"])
    passing = both.iloc[[2 * k + (10 <= k < 20) for k in range(30)]]
    lines = backbones[passing.index]
    passing = passing.assign(track_id=0).reset_index(drop=True)
    assert compare_with_truth(passing, lines, truth)["truth_identity_changes"] == 2


# -- pictures ---------------------------------------------------------------------------------------


def specimen(table, backbones, row, colour=False):
    line = backbones[row]
    x0, y0 = np.floor(line.min(0)).astype(int) - 5
    width, height = np.ceil(np.ptp(line, axis=0)).astype(int) + 10
    film = np.full((height, width, 3) if colour else (height, width), 90, np.uint8)
    return Specimen(table.iloc[row], line, film, int(x0), int(y0))


@pytest.mark.parametrize("count", [1, 5, 6, 7])
@pytest.mark.parametrize("colour", [False, True])
def test_the_size_of_a_contact_sheet(swimmers_with_truth, count, colour):
    table, backbones, _ = swimmers_with_truth
    shown = (specimen(table, backbones, row, colour) for row in range(count))
    sheet = draw_specimens(shown, columns=3, size=150)
    assert sheet.shape == (24 + 150 * -(-count // 3), 450, 3)
    assert sheet.dtype == np.uint8


def test_what_a_contact_sheet_draws(swimmers_with_truth):
    table, backbones, _ = swimmers_with_truth
    tile = draw_specimens([specimen(table, backbones, 5)], columns=1, size=300)[24:]

    def places(colour):
        return np.argwhere(np.abs(tile - np.array(colour)).max(-1) < 60)[:, ::-1]

    backbone, spline, control, arrow = map(
        places, ((255, 220, 0), (255, 60, 60), (255, 255, 255), (0, 255, 90))
    )
    assert min(map(len, (backbone, spline, control, arrow))) > 20
    angle = np.radians(table["heading_deg"].iloc[5])  # the arrow leaves the head along the heading
    assert (arrow.mean(0) - backbone.mean(0)) @ (np.cos(angle), -np.sin(angle)) > 50
    assert np.ptp(backbone, axis=0).max() > 200  # head to tail, as large as the tile allows


def test_the_most_doubtful_come_first(swimmers_with_truth):
    table, _, _ = swimmers_with_truth
    doubt = table.assign(head_confidence=1.0)
    doubt.loc[[3, 50, 11, 12, 13, 14], "head_confidence"] = [0.5, 0.6, 0.7, 0.71, 0.72, 0.73]
    chosen = choose_rows_to_check(doubt, 12)
    assert len(chosen) == 12
    assert chosen[:4].tolist() == [3, 50, 11, 12]  # no more than three of a track
    assert set(chosen) & {13, 14} == set()
    areas = table["motion_area"].to_numpy()[chosen[6:]]
    assert areas[0] == table["motion_area"].max()
    assert np.all(np.diff(areas) <= 0)
    assert set(choose_rows_to_check(table.iloc[:1], 48)) == {0}


VARIANTS = {
    "one row": lambda: [swim(1)],
    "thirty tracks, no turning": lambda: [swim(3, heading_deg=12 * k) for k in range(30)],
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_figures_of_any_table(tmp_path, variant):
    table, _ = measure_features(tracks_table(*VARIANTS[variant]()), RATE, SETTINGS)
    empty = np.full((600, 800), 120, np.uint8)
    assert sum(bar.get_height() for bar in draw_rose(table).axes[0].patches) == pytest.approx(100)
    for name, figure, size in (
        ("fig7", figure7(table), (495, 1100)),
        ("rose", draw_rose(table), (660, 660)),
        ("trajectories", draw_trajectories(table, empty), (825, 1100)),
    ):
        save_figure(tmp_path / f"{name}.png", figure)
        picture = load_picture(tmp_path / f"{name}.png")
        assert picture.shape == (*size, 3)
        assert picture.std() > 5


def test_fig_7_shows_the_longest_track(swimmers_with_truth):
    table, _, _ = swimmers_with_truth
    assert set(rows_of_longest_track(table)["track_id"]) == {0}
    upper, lower = figure7(table).axes
    (area,) = upper.lines
    assert area.get_ydata() == pytest.approx(table["motion_area_rel"][:40].to_numpy())
    (kind_line,) = lower.lines
    assert np.array_equal(kind_line.get_ydata(), table["swimming_type"][:40])


def a_turn(to_left=True, turn_deg=12.0, still=30):
    """A table and its backbones: straight, a turn of 20 frames in which the body bends, straight."""
    side = 1 if to_left else -1
    share = np.sin(np.pi * np.clip((np.arange(2 * still + 20) - still) / 20, 0, 1))
    heading_deg = side * np.cumsum(turn_deg * (share > 0))
    place = np.cumsum(4.0 * np.exp(-1j * np.radians(heading_deg)))
    lines = [
        body(angle, side * 70 * bent) + (at.real, at.imag)
        for angle, bent, at in zip(heading_deg, share, place, strict=True)
    ]
    return measure_features(tracks_table(np.stack(lines)), RATE, SETTINGS)


@pytest.mark.parametrize("to_left", [True, False])
def test_the_turn_of_fig_5_is_clear_and_the_strongest(to_left):
    table, _ = a_turn(to_left)
    rows = find_strongest_turn(table)
    k, again = np.diff(rows)
    assert k == again and k % 5 == 0 and k < 20  # a multiple of Δ, shorter than the turn
    types, area = (table[name].to_numpy()[rows] for name in ("swimming_type", "motion_area"))
    side = LEFT if to_left else RIGHT
    assert types[0] == STRAIGHT and types[1] == side
    assert area[1] == max(area)
    angles = heading_change_deg(table, rows[:2], k, 5)
    assert np.all(np.sign(angles) == side)
    heading_deg = table["heading_deg"].to_numpy()[rows]
    assert wrap_deg(np.diff(heading_deg) - angles) == pytest.approx(0, abs=1e-3)
    # A slower turn before it, as a track of its own, is passed over.
    slow, _ = a_turn(to_left, 7.0)
    both = pd.concat([slow, table.assign(track_id=1)], ignore_index=True)
    assert find_strongest_turn(both).tolist() == (rows + len(slow)).tolist()
    assert find_strongest_turn(both.assign(head_confidence=0.8)) is None


def test_a_film_without_turns_has_no_fig_5():
    for lines in (swim(60), swim(1), swim(7)):
        assert find_strongest_turn(measure_features(tracks_table(lines), RATE, SETTINGS)[0]) is None
    turning = measure_features(tracks_table(swim(60, turn_deg=6.0, arc_deg=60)), RATE, SETTINGS)[0]
    assert find_strongest_turn(turning) is None  # it does not begin with straight swimming


def test_fig_5_draws_the_area_and_the_angles_of_the_table():
    table, backbones = a_turn()
    rows = find_strongest_turn(table)
    low = backbones.min((0, 1))
    lines = backbones - low + 40
    tank = np.full((int(np.ptp(backbones[..., 1])) + 90, int(np.ptp(backbones[..., 0])) + 90), 120)
    fish = [specimen(table, lines, row) for row in rows]
    upper, lower = figure5(table, rows, fish, tank.astype(np.uint8)).subfigs
    for axes, row in zip(upper.axes[3:6], rows, strict=True):
        (patch,) = axes.patches
        x, y = patch.get_xy().T
        area = 0.5 * abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        one = table.iloc[row]
        assert area / one["body_length_px"] ** 2 == pytest.approx(one["motion_area"], abs=2e-4)
        assert f"motion area {one['motion_area_rel']:.2f}" in axes.get_title()
    angles = heading_change_deg(table, rows[:2], rows[1] - rows[0], 5)
    assert "included angle" not in upper.axes[3].get_title()
    for axes, angle in zip(upper.axes[4:6], angles, strict=True):
        assert f"included angle {angle:+.0f}°" in axes.get_title()
    turned = lower.axes[1].lines[0].get_ydata()
    frames = lower.axes[1].lines[0].get_xdata()
    assert turned[frames == rows[2]] == pytest.approx(angles.sum(), abs=1e-3)


# -- the stage --------------------------------------------------------------------------------------

MADE = {"fig7.csv", "metrics.json", "table1.csv"}
DRAWN = {"contact_sheet.png", "fig5.png", "fig7.png", "rose.png", "trajectories.png"}


film_run = stage_run("plots-film")
workspace = copy_of("film_run", "no_drawing")


def test_the_stage_makes_its_table_and_reports(workspace):
    report = workspace / "reports/features"
    assert {path.name for path in report.iterdir()} == MADE
    assert set(content(workspace / "reports/film/features")) == DRAWN
    assert list(content(workspace / "data/features")) == ["features.parquet", "findings.csv"]
    table = load_table(workspace / "data/features/features.parquet", FEATURES)
    assert len(table) == 100
    metrics = load_numbers(report)
    assert metrics["fish_frames"] == metrics["truth_found_pct"] == 100
    assert metrics["truth_head_tail_swaps"] == 0
    assert all(isinstance(number, int | float) for number in metrics.values())
    csv = pd.read_csv(report / "table1.csv")
    assert csv["orientation"].tolist() == list(range(1, 21))
    assert csv["amount_pct"].sum() == pytest.approx(100, abs=20 * 0.005)
    assert pd.read_csv(report / "fig7.csv")["frame"].tolist() == list(range(100))
    sheet = load_picture(workspace / "reports/film/features/contact_sheet.png")
    assert sheet.shape == (24 + 8 * 220, 6 * 220, 3) and sheet.std() > 10


def test_delta_follows_the_parameter_and_no_truth_gives_no_errors(workspace):
    prepare(workspace, *TINY_CARP, "features.delta_s=0.4")
    (workspace / "data/clip/truth.parquet").unlink()
    stages.features.main()
    table = load_table(workspace / "data/features/features.parquet", FEATURES)
    assert table["displacement"].isna().sum() == 10
    metrics = load_numbers(workspace / "reports/features")
    assert metrics["fish_frames"] == 100
    assert not [name for name in metrics if name.startswith("truth")]


def test_a_ruler_gives_lengths_and_speeds_in_millimetres():
    """40 px long, half a body length in each Δ of five frames, 25 frames a second."""
    moved = [0.5] * 15 + [np.nan] * 5
    table = pd.DataFrame(
        {"track_id": 1, "frame": range(20), "body_length_px": 40.0, "displacement": moved}
    )
    found = metrics_in_mm(table, (640, 480), 25.0, 0.25)
    assert found["body_length_median_mm"] == 10
    assert found["speed_median_mm_s"] == pytest.approx(0.5 * 10 * 25 / 5)
    assert (found["tank_width_mm"], found["tank_height_mm"]) == (160, 120)
    twice = {name: 2 * mm for name, mm in found.items()}
    assert metrics_in_mm(table, (640, 480), 25.0, 0.5) == twice


# -- a current ---------------------------------------------------------------------------------------


def station_features(current=0.0, heading_deg=30.0):
    """The features of a fish that beats its tail on the spot."""
    lines = swim(100, speed=0.0, heading_deg=heading_deg, wag_deg=40.0)
    lines -= lines.mean(axis=1, keepdims=True) - (400, 300)
    own = settings("features", delta_s=0.2, water_current_bl_s=current)
    return measure_features(tracks_table(lines), RATE, own)[0]


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, -150.0])
def test_a_fish_in_a_current_gets_on_along_its_heading(heading_deg):
    table = station_features(1.5, heading_deg)
    way = places_through_water(table)
    far = way[-1] - way[0]
    assert np.hypot(*far) == pytest.approx(1.5 * LENGTH * 99 / RATE, rel=0.02)
    assert np.degrees(np.arctan2(-far[1], far[0])) == pytest.approx(heading_deg, abs=2)
    assert table["displacement"].dropna().median() == pytest.approx(1.5 * 0.2, rel=0.05)
    assert np.allclose(table[["x_px", "y_px"]], [400, 300])  # the picture is where it was
    assert measure_heading_agreement(table)["moving_fish_frames"] == 0  # an assumed way proves none


def test_the_current_is_found_and_a_number_overrides_it():
    found = station_features("auto")["current"]
    assert found.nunique() == 1 and 0.3 < found.iloc[0] < 1.6
    lines = swim(200, speed=4.0, wag_deg=40.0)
    table = tracks_table(shuffle_ends(lines, np.ones(33), np.random.default_rng(0))[0])
    assert (measure_features(table, RATE, settings("features"))[0]["current"] == 0).all()
    assert (measure_features(table, RATE, SETTINGS)[0]["current"] == 0).all()


def test_tracks_are_moved_on_each_by_itself():
    one = station_features(1.0)
    both = pd.concat([one, one.assign(track_id=1)], ignore_index=True)
    way = places_through_water(both)
    steps = np.diff(way, axis=0)
    assert np.allclose(steps[:99], steps[100:], atol=1e-6)
    assert [one.stop - one.start for one in track_slices(both)] == [100, 100]
    still = station_features()
    assert np.array_equal(places_through_water(still), still[["x_px", "y_px"]].to_numpy())
    assert still["displacement"].max() < 1e-3
