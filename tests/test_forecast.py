"""The forecast: states, learning, similar rows, sampling, measures: laws on a drawn fish.

The law by which it bends and swims, and so its spread, is written down in toy_swim.py.
"""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from toy_swim import DELTA, HOW, MIRROR, NOISE, RATE, plain, random_swimmer, unseen

from finloop.base.errors import FinloopError
from finloop.base.nearest import assign_parts
from finloop.forecast import neighbours
from finloop.forecast.assess import (
    autocorrelation,
    compare_free_swim,
    measure_control_slopes,
    measure_predictions,
    predict_ensembles,
    roll_out_means,
)
from finloop.forecast.film import MOTION, compute_film_states, split_held_out
from finloop.forecast.learning import train_predictor
from finloop.forecast.model import restore_forecast
from finloop.forecast.neighbours import build_similarity_graph
from finloop.forecast.sampling import (
    build_sampler,
    draw_next_row,
    follow_row,
    next_row_weights,
    start_at_row,
    step_fish,
    swim_freely,
)


@pytest.fixture(scope="module")
def film():
    return compute_film_states(*random_swimmer(), MIRROR, RATE, HOW)


@pytest.fixture(scope="module")
def learnt(film):
    sides = split_held_out(film, HOW)
    return train_predictor(film, sides, HOW)[0], sides


@pytest.fixture(scope="module")
def swim(film, learnt):
    graph = build_similarity_graph(film, plain(film), unseen, HOW)
    return build_sampler(film, learnt[0], graph, HOW)


def rng(seed=0):
    return np.random.default_rng(seed)


# --- states


def test_a_state_is_the_posture_and_how_the_fish_came_here(film):
    features, codes = random_swimmer()
    row = 700
    assert np.allclose(film.states[row, :2], codes[row])
    forward, sideways, turning = film.states[row, -MOTION:]
    assert turning == pytest.approx(4 * codes[row, 0])
    moved = np.hypot(*np.diff(features[["x_px", "y_px"]].to_numpy()[row - 1 : row + 1], axis=0)[0])
    assert np.hypot(forward, sideways) == pytest.approx(moved / 60 * RATE)
    assert forward > abs(sideways)


def test_the_mirror_image_turns_the_other_way(film):
    row, image = 700, 700 + film.count
    assert np.allclose(film.states[image], film.states[row] * [-1, 1, 1, -1, -1])
    assert np.allclose(film.control[image], film.control[row] * [1, -1])


def test_rows_at_the_ends_of_tracks_cannot_be_learnt_from():
    film = compute_film_states(*random_swimmer(tracks=3), MIRROR, RATE, HOW)
    last = film.lags[-1]
    for begins in (0, 1000, 2000):
        assert not film.usable[begins : begins + last + 1].any()
        assert film.usable[begins + last + 1 : begins + 1000 - DELTA].all()
        assert not film.usable[begins + 1000 - DELTA : begins + 1000].any()


def test_a_fish_whose_sides_differ_is_not_mirrored():
    film = compute_film_states(*random_swimmer(), None, RATE, HOW)
    assert len(film.states) == film.count
    assert film.side.tolist() == [1, 1]
    assert np.array_equal(film.mirror, np.eye(len(film.scale)))


@pytest.mark.parametrize("fault", ["short", "still", "straight"])
def test_a_film_that_shows_too_little_is_refused_in_a_sentence(fault):
    features, codes = random_swimmer(80 if fault == "short" else 400)
    if fault == "still":
        features["displacement"] *= 0
    if fault == "straight":
        features["swimming_type"] *= 0
    what = {"short": "rows with a past", "still": "moves", "straight": "turns"}[fault]
    with pytest.raises(FinloopError, match=what):
        compute_film_states(features, codes, MIRROR, RATE, HOW)


# --- learning


def test_the_network_learns_the_law_that_the_fish_swims_by(film, learnt):
    model, sides = learnt
    held = sides.held_out
    error = model.predict_means(film.past(held), film.control[held]) - film.states[held + 1]
    persistence = film.states[held] - film.states[held + 1]
    skill = 1 - (error**2).mean(0) / (persistence**2).mean(0)
    assert skill[0] > 0.1  # the control tells of the noise to come, so more than the law does
    assert (error[:, 0] ** 2).mean() < 1.05 * NOISE**2


def test_the_mirrored_past_and_control_give_the_mirrored_mean(film, learnt):
    model, _ = learnt
    rows = rng().choice(film.rows, 50)
    past, control = film.past(rows), film.control[rows]
    mean, image = (
        model.predict_means(past, control),
        model.predict_means(past @ film.mirror, control * film.side),
    )
    assert np.allclose(image, mean @ film.mirror, atol=1e-4)


def test_the_seed_determines_the_network(film, learnt):
    how = replace(HOW, epochs=2)
    one, again, other = (
        train_predictor(film, learnt[1], replace(how, seed=seed))[0].layers[0] for seed in (0, 0, 1)
    )
    assert np.array_equal(one, again)
    assert not np.allclose(one, other)


def test_nothing_that_is_held_out_is_learnt_from(film, learnt):
    sides, reach = learnt[1], film.lags[-1]
    used = {int(f) for frame in film.frame[sides.train] for f in range(frame - reach, frame + 2)}
    assert not used & set(film.frame[sides.held_out].tolist())


def test_learning_stops_when_the_error_held_out_no_longer_falls(film, learnt, monkeypatch):
    monkeypatch.setattr(type(HOW), "patience", 2)
    curve = train_predictor(film, learnt[1], replace(HOW, epochs=60, learning_rate=0.02))[1]
    best = int(curve["held_out_error"].argmin())
    assert len(curve) - 1 == min(best + 2, 60)


def test_a_model_is_read_as_it_was_written(film, learnt):
    model = learnt[0]
    again = restore_forecast(**json.loads(json.dumps(model.to_values())))
    rows = film.rows[:20]
    past, control = film.past(rows), film.control[rows]
    assert np.array_equal(again.predict_means(past, control), model.predict_means(past, control))


@pytest.mark.parametrize("fault", ["format", "scale", "first"])
def test_a_damaged_model_is_refused(learnt, fault):
    content = learnt[0].to_values()
    content[fault] = "x" if fault == "format" else content[fault][:-1]
    with pytest.raises(ValueError, match=r"wanted|sizes"):
        restore_forecast(**content)


# --- similar rows


def test_whoever_has_a_neighbour_is_its_neighbour_and_so_are_the_mirror_images(film, swim):
    a, b = np.repeat(np.arange(len(swim.start) - 1), np.diff(swim.start)), swim.to
    n, m = film.count, len(film.states)
    pairs = np.unique(m * a + b)
    assert np.array_equal(pairs, np.unique(m * b + a))
    assert np.array_equal(pairs, np.unique(m * ((a + n) % m) + (b + n) % m))


def test_neighbours_are_of_other_passages_and_nearer_than_others(film, swim):
    r = rng()
    for row in r.choice(film.rows, 20).tolist():
        near = swim.to[swim.start[row] : swim.start[row + 1]]
        assert (np.abs(near - row) >= DELTA).all()
        apart = np.abs(film.states[near] - film.states[row]) / film.scale
        other = np.abs(film.states[r.choice(film.rows, 200)] - film.states[row]) / film.scale
        assert apart.mean() < 0.7 * other.mean()


def test_rows_that_look_different_are_no_neighbours(film, monkeypatch):
    open_fins = np.random.default_rng(1).random(film.count) < 0.5
    look = 2.0 * np.tile(open_fins, 2)[:, None]
    shown = np.roll(look, -1)  # next
    for most, share in ((3.0, 0.5), (1.0, 0.0)):
        monkeypatch.setattr(type(HOW), "max_look_difference", most)
        start, to = build_similarity_graph(film, look, unseen, HOW)
        one = np.repeat(np.arange(len(look)), np.diff(start))
        mixed = (shown[one] != shown[to]).mean()
        assert mixed == pytest.approx(share, abs=0.1)
    assert mixed == 0


def test_of_a_long_film_so_many_rows_are_learnt_from_and_held_out(film, monkeypatch):
    whole = split_held_out(film, HOW)
    monkeypatch.setattr(type(HOW), "most_rows", 40)
    some = split_held_out(film, HOW)
    for every, few in ((whole.train, some.train), (whole.held_out, some.held_out)):
        assert len(few) == min(40, len(every)) and (np.diff(few) > 0).all()
        assert np.isin(few, every).all()
    assert len(whole.train) > 40


def test_rows_that_are_apart_to_the_eye_are_no_neighbours(film):
    asked = []

    def record_discontinuities(rows, to, mirrored):
        asked.append((rows, to, mirrored))
        return 9.0 * (to % 2 == 0)

    start, to = build_similarity_graph(film, plain(film), record_discontinuities, HOW)
    one = np.repeat(np.arange(len(film.states)), np.diff(start))
    assert len(one) and ((one % film.count % 2 == 0) | (to % film.count % 2 == 0)).all()
    with pytest.raises(FinloopError, match="look alike"):
        build_similarity_graph(film, plain(film), lambda rows, *_: np.full(len(rows), 9.0), HOW)
    rows, other, mirrored = (np.concatenate(part) for part in zip(*asked, strict=True))
    assert max(rows.max(), other.max()) < film.count and mirrored.any() and not mirrored.all()


def test_similar_rows_do_not_depend_on_how_many_are_looked_at_at_a_time(film, monkeypatch):
    def toy_discontinuities(rows, to, mirrored):
        return np.where((rows + to) % 3 == 0, 9.0, 0.0)

    whole = build_similarity_graph(film, plain(film), toy_discontinuities, HOW)
    monkeypatch.setattr(neighbours, "_BATCH", 7)
    monkeypatch.setattr(neighbours, "_BLOCK", 50)
    assert len(film.rows) > 100
    for one, other in zip(
        whole, build_similarity_graph(film, plain(film), toy_discontinuities, HOW), strict=True
    ):
        assert np.array_equal(one, other)


def test_neighbours_in_a_long_film_are_of_a_part_of_it(film, monkeypatch):
    """Each turn of rows has another part, so that every part is reached."""
    monkeypatch.setattr(neighbours, "assign_parts", partial(assign_parts, most=film.count // 3))
    monkeypatch.setattr(neighbours, "_TURN", 50)
    monkeypatch.setattr(neighbours, "_BATCH", 25)
    part = neighbours.assign_parts(film.count, neighbours._STRETCH * film.delta)
    parts, order = 1 + int(part.max()), np.empty(len(film.states), int)
    order[film.rows] = np.arange(len(film.rows))
    assert parts >= 3
    pairs = np.concatenate([*neighbours._find_similar_pairs(film, plain(film), HOW)])
    turn = order[pairs[:, 0]] // 50 % parts
    assert (part[pairs[:, 1] % film.count] == turn).all()
    assert len(np.unique(turn)) == parts


def test_a_sampler_takes_means_that_were_predicted_before(film, learnt, swim):
    again = build_sampler(film, learnt[0], (swim.start, swim.to), HOW, 2 * swim.mean)
    assert np.array_equal(again.mean, 2 * swim.mean)
    rows = film.rows[:50]
    means = learnt[0].predict_means(film.past(rows), film.control[rows])
    assert np.allclose(swim.mean[rows], means)


def test_in_the_long_run_all_rows_are_visited_alike(swim):
    """The transitions between rows are symmetric, so none of them fills up."""
    m = len(swim.states)
    there = np.zeros(m)
    for row in np.flatnonzero(swim.usable):
        rows, chance = next_row_weights(swim, row)
        assert chance.sum() == pytest.approx(1)
        np.add.at(there, rows, chance)
    assert np.allclose(there[swim.usable], 1)


# --- sampling


def test_in_a_rows_own_state_under_its_own_control_a_fish_swims_as_filmed(film, swim):
    row = int(film.rows[300])
    past = film.states[row - np.arange(film.lags[-1] + 1)]
    states = follow_row(swim, past, row, 8, film.control[row])[::-1]
    assert np.allclose(states, film.states[row + 1 : row + 9], atol=1e-4)


def test_a_difference_settles(film, swim):
    row = int(film.rows[300])
    past = film.states[row - np.arange(film.lags[-1] + 1)] + 0.5 * film.scale
    states = follow_row(swim, past, row, 25, film.control[row])[::-1]
    off = np.abs(states - film.states[row + 1 : row + 26]) / film.scale
    assert off[-1].max() < 0.02
    assert off[0, -MOTION:].max() < off[0, :-MOTION].max() < 0.5


def test_a_step_changes_nothing_but_the_draws(swim):
    state = start_at_row(swim, int(np.flatnonzero(swim.usable)[40]))
    past = state.past.copy()
    one, again = (step_fish(swim, state, None, rng(3)) for _ in range(2))
    assert np.array_equal(state.past, past)
    assert np.array_equal(one.past, again.past)
    assert np.array_equal(one.past[1:], past[:-1])


def test_the_mirrored_state_and_control_give_the_mirrored_distribution(film, swim):
    n = film.count
    for row in rng().choice(film.rows[film.rows < n], 10).tolist():
        ends = []
        for side, here in ((np.ones(2), row), (film.side, row + n)):
            rows, chance = next_row_weights(swim, here)
            control = film.control[row] * side
            past = swim.states[here - np.arange(film.lags[-1] + 1)]
            states = np.array([follow_row(swim, past, int(r), 1, control)[0] for r in rows])
            if here != row:
                states = states @ film.mirror
            order = np.argsort(states[:, 0])
            ends.append((states[order], chance[order]))
        assert np.allclose(ends[0][0], ends[1][0], atol=1e-3)
        assert np.allclose(ends[0][1], ends[1][1])


def test_a_free_fish_stays_within_the_films_states_and_repeats_no_second(film, swim):
    states, rows = swim_freely(swim, 3000, rng())
    usual = film.states[film.rows]
    assert (states >= usual.min(0)).all() and (states <= usual.max(0)).all()
    numbers = compare_free_swim(states, rows, film, swim)
    assert numbers["free_clamped_pct"] < 2 and numbers["free_longest_exact_repeat_s"] <= 1.0
    assert np.array_equal(swim_freely(swim, 200, rng())[0], swim_freely(swim, 200, rng())[0])
    assert not np.allclose(states[:200], swim_freely(swim, 200, rng(2))[0])


def test_a_fish_that_is_left_free_moves_as_the_film_does(film, swim):
    states, _ = swim_freely(swim, 6000, rng())
    filmed = film.states[film.rows]
    assert np.allclose(states.std(0), filmed.std(0), rtol=0.15)
    whole = np.ones(len(states) - 1, bool)
    known = autocorrelation(filmed[: len(filmed) // 2, 0], whole[: len(filmed) // 2 - 1], 20)
    assert np.allclose(autocorrelation(states[:, 0], whole, 20), known, atol=0.15)


def test_a_fish_turns_and_moves_as_it_is_told(film, swim):
    slopes = measure_control_slopes(swim, film, rng())
    assert 0.5 < slopes["angle_slope"] < 1.3
    assert slopes["displacement_slope"] > 0.3


def test_where_no_row_is_like_another_nothing_is_said_of_control(film, swim):
    lonely = swim._replace(start=np.zeros_like(swim.start))
    assert measure_control_slopes(lonely, film, rng()) == {}


def test_where_the_film_ends_a_fish_goes_over(swim):
    last = int(np.flatnonzero(swim.usable[:3000])[-1]) + 1
    assert not swim.usable[last]
    assert all(swim.usable[draw_next_row(swim, last, None, rng(seed))] for seed in range(20))


# --- measures


def test_the_spread_is_that_of_the_law(film, learnt, swim):
    """The truth lies in the inner half of its forecasts half of the time."""
    told = predict_ensembles(film, swim, learnt[1], rng())
    numbers = measure_predictions(film, told, swim, learnt[1])
    assert numbers["truth_in_inner_50_pct"] == pytest.approx(50, abs=6)
    assert numbers["truth_in_inner_80_pct"] == pytest.approx(80, abs=6)
    assert numbers["held_out_log_likelihood"] > numbers["persistence_log_likelihood"]
    assert numbers["motion_skill_against_persistence"] > 0


def test_ahead_of_one_tick_is_the_mean(film, learnt):
    model, sides = learnt
    rows = sides.held_out[:10]
    one = roll_out_means(replace(film, delta=1), model, rows)
    assert np.allclose(one, model.predict_means(film.past(rows), film.control[rows]))


def test_the_autocorrelation_of_a_wave_is_a_cosine():
    wave = np.cos(2 * np.pi * np.arange(2000) / 20)
    known = autocorrelation(wave, np.ones(1999, bool), 21)
    assert np.allclose(known, np.cos(2 * np.pi * np.arange(21) / 20), atol=0.01)
