"""Mode `matching` by the forecast: goals, walls, repeats, control, what the fish remembers; as laws."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from toy_film import LENGTH, film_world_of, matching_of
from toy_swim import HOW, MIRROR, RATE, plain, random_swimmer, unseen

from finloop.animate.paths import lay_path
from finloop.animate.shoal import animate_fish
from finloop.animate.state import Fish, State
from finloop.base.line import PX, Line
from finloop.edit.schema import FORECAST, Goal
from finloop.forecast.film import MOTION, compute_film_states, split_held_out
from finloop.forecast.learning import train_predictor
from finloop.forecast.neighbours import build_similarity_graph
from finloop.forecast.sampling import build_sampler, follow_row, start_at_row
from finloop.plan.cost import Rarity
from finloop.plan.graph import ROW, remove_dead_ends
from finloop.plan.path_measures import path_table
from finloop.plan.sources import PredictionSource
from finloop.plan.world import fast_speed

REST = np.zeros(3000, bool)
GOALS = [Goal("A", 120, 100), Goal("B", 680, 500), Goal("C", 120, 500)]


@cache
def sample():
    features, codes = random_swimmer()
    film = compute_film_states(features, codes, MIRROR, RATE, HOW)
    model, _ = train_predictor(film, split_held_out(film, HOW), replace(HOW, epochs=3))
    return build_sampler(film, model, build_similarity_graph(film, plain(film), unseen, HOW), HOW)


def own_world(mirrored=True, barred=()):
    """The tank of the made-up film, and the film of the drawn fish, with its mirror image."""
    features, _ = random_swimmer()
    n = len(features)
    rows = np.zeros(2 * n if mirrored else n, ROW)
    heading = features["heading_deg"].to_numpy()
    rows["heading"] = np.concatenate([heading, -heading])[: len(rows)]
    scale = LENGTH / features["body_length_px"].to_numpy()
    x, y = (features[f"{axis}_px"].to_numpy() * scale for axis in "xy")
    dx, dy = np.diff(x, append=x[-1]), np.diff(y, append=y[-1])
    speed = np.hypot(dx, dy) / LENGTH * RATE
    for name, one, other in (
        ("x", x, x), ("y", y, -y), ("dx", dx, dx), ("dy", dy, -dy), ("speed", speed, speed),
    ):  # fmt: skip
        rows[name] = np.concatenate([one, other])[: len(rows)]
    rows["has_next"] = True
    rows["has_next"][n - 1 :: n] = False
    rows["has_next"][list(barred)] = False
    plain = film_world_of()
    return replace(plain, film=plain.film._replace(rows=rows, filmed_count=n))


def player(**film):
    """A planner that shows predictions alone."""
    world, none = own_world(**film), Rarity(np.zeros(3000), np.zeros(1), 0.0, 0.0)
    recurrent = remove_dead_ends(sample(), world.film.has_next, REST)
    by_forecast = PredictionSource(world, recurrent, none)
    return replace(matching_of(), world=world, film=None, prediction=by_forecast)


@pytest.mark.parametrize("seed", range(3))
def test_all_goals_are_reached_within_the_tank(seed):
    fish = player()
    animation = animate_fish(fish, GOALS, 2500, np.random.default_rng(seed))
    assert (animation.reached >= 0).all()
    way = np.concatenate([one.trajectory for one in animation.stretches])
    legal = fish.world.tank.legal
    assert legal[np.rint(way[:, 1]).astype(int), np.rint(way[:, 0]).astype(int)].all()


def test_a_goal_at_a_wall_is_reached_by_the_head():
    fish = player()
    y, x = np.argwhere(fish.world.tank.legal).min(0)
    goal = Goal("A", float(x) - 0.9 * fish.world.head_px, float(y) + 200)
    assert (animate_fish(fish, [goal], 1500, np.random.default_rng(0)).reached >= 0).all()


def test_the_fish_moves_as_is_foretold():
    fish = player()
    state = fish.begin(np.random.default_rng(1))
    stretch, _ = fish.plan(state, GOALS[1], np.random.default_rng(2))
    start = np.array([state.fish.x, state.fish.y])
    way = np.vstack([start, stretch.trajectory[:, :2]])
    speed = np.hypot(*np.diff(way, axis=0).T) / LENGTH * RATE
    states = stretch.past[-len(stretch.trajectory) :]
    assert np.allclose(speed, np.hypot(states[:, -3], states[:, -2]))


def test_the_same_draws_give_the_same_swim():
    swims = (animate_fish(player(), GOALS, 150, np.random.default_rng(seed)) for seed in (4, 4, 5))
    one, same, other = (np.concatenate([s.trajectory for s in swim.stretches]) for swim in swims)
    assert np.array_equal(one, same) and not np.array_equal(one[:100], other[:100])


def test_a_stretch_that_is_cut_leaves_the_fish_as_it_was_then():
    fish = player()
    state, rng = fish.begin(np.random.default_rng(1)), np.random.default_rng(3)
    stretch, _ = fish.plan(state, GOALS[1], rng)
    while len(stretch.trajectory) < 3:
        stretch, _ = fish.plan(state, GOALS[1], rng)
    short, cut = fish.cut(state, stretch, 2)
    deep = len(state.fish.past) if state.fish.past is not None else len(cut.fish.past)
    assert len(short.past) == deep + 2
    assert np.array_equal(cut.fish.past[0], stretch.past[deep + 1])
    assert cut.fish.row == stretch.number[1]


def test_rows_that_must_not_be_shown_are_not_and_neither_are_mirror_images_that_are_none():
    barred = range(1000, 1400)
    fish = player(mirrored=False, barred=barred)
    animation = animate_fish(fish, GOALS, 2000, np.random.default_rng(0))
    shown = np.concatenate([one.number for one in animation.stretches])
    assert shown.max() < 3000
    assert not np.isin(shown, list(barred)[1:]).any()


def test_only_rows_that_are_shown_are_similar():
    one = remove_dead_ends(sample(), own_world(mirrored=False).film.has_next, REST)
    assert (one.to < 3000).all()
    assert one.usable[one.to].all()
    assert one.start[-1] == len(one.to)


def test_where_the_film_rests_a_fish_moves_as_the_film_does_and_its_mirror_image_too():
    rest = REST.copy()
    rest[500:510] = True
    more = own_world().film.has_next
    plain, resting = (remove_dead_ends(sample(), more, each) for each in (REST, rest))
    for row in (495, 3495):
        past = start_at_row(plain, row).past + 0.1
        control = plain.control[row]
        free, held = (follow_row(one, past, row, 20, control)[::-1] for one in (plain, resting))
        film = plain.states[row + 1 : row + 21]
        assert np.array_equal(held[4:14, -MOTION:], film[4:14, -MOTION:])
        assert (free[4:14, -MOTION:] != film[4:14, -MOTION:]).all()
        assert np.array_equal(held[:4], free[:4])
        assert (held[4:14, :-MOTION] != film[4:14, :-MOTION]).all()  # its posture settles


def test_rows_that_only_lead_to_an_end_of_the_film_are_not_followed():
    whole = sample()
    start = whole.start.copy()
    lonely = slice(1000, 1101)  # the last rows before a cut have no neighbours
    gone = np.isin(np.repeat(np.arange(len(whole.usable)), np.diff(start)), np.r_[lonely])
    gone |= np.isin(whole.to, np.r_[lonely])
    start = np.append(0, np.cumsum(~gone))[start]
    more = np.arange(3000) % 1101 != 1100
    one = remove_dead_ends(whole._replace(start=start, to=whole.to[~gone]), more, REST)
    assert not one.usable[lonely].any()
    assert one.usable[800:999].all()
    assert one.start[1000] > one.start[999]  # from the last one it goes over
    rows = np.flatnonzero(one.usable)
    assert (one.usable[rows + 1] | (one.start[rows + 1] > one.start[rows])).all()


def test_rows_that_only_lead_round_among_themselves_are_not_followed():
    whole = sample()
    one = np.repeat(np.arange(len(whole.usable)), np.diff(whole.start))
    trap = (one >= 1050) & (one < 1101)
    into = np.where(trap, 1060, whole.to)  # a few frames, again and again
    more = np.arange(3000) % 1101 != 1100
    film = remove_dead_ends(whole._replace(to=into), more, REST)
    assert not film.usable[1050:1101].any()
    assert film.usable[600:1000].mean() > 0.9


def test_a_fish_from_sprites_or_from_the_film_goes_on():
    one = replace(player(), sprite_rows=np.arange(60))
    for fish in (
        Fish(300.0, 300.0, 0.0, 2.0, 0, sprite=7),
        Fish(300.0, 300.0, 0.0, 2.0, 5, sprite=-1, row=2999),
        Fish(300.0, 300.0, 0.0, 2.0, 5, sprite=-1, row=1),
    ):
        stretch, later = one.plan(State(fish, np.zeros(2)), GOALS[0], np.random.default_rng(0))
        assert later.fish.past is not None and later.fish.row == stretch.number[-1]


def test_the_head_of_a_fish_in_a_corner_turns_no_faster_than_a_fast_fish_swims_or_as_is_predicted():
    one, world = player(), own_world()
    head_px = world.motion.body_length_px / 2  # from the centre of a fish to its head
    most = np.degrees(world.cost_weights.fast_px / head_px)
    assert world.most_spot_turn_deg == pytest.approx(most)
    legal = one.world.tank.legal
    y, x = np.argwhere(legal).min(0)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        fish = Fish(float(x), float(y), 135.0, 2.0, FORECAST, sprite=-1, row=100 + 20 * seed)
        fish = fish._replace(rotation_deg=135.0 - float(one.world.film.heading[fish.row]))
        state = State(fish, np.zeros(2))
        for _ in range(6):
            heading = state.fish.heading
            stretch, state = one.plan(state, Goal("A", 400.0, 300.0), rng)
            way = np.rint(stretch.trajectory[:, :2]).astype(int)
            assert legal[way[:, 1], way[:, 0]].all()
            own = np.abs(np.diff(one.world.film.heading[stretch.number], prepend=np.nan))[1:]
            if stretch.past is not None:
                own = np.abs(np.degrees(stretch.past[-len(stretch.trajectory) :, -1]) / RATE)[1:]
            turned = np.abs((np.diff(stretch.trajectory[:, 2]) + 180) % 360 - 180)
            assert (turned <= np.maximum(own % 360, most) + 1e-6).all()
            assert abs((stretch.trajectory[0, 2] - heading + 180) % 360 - 180) < 30


def test_a_fish_that_rests_for_most_of_the_film_is_fast_when_it_swims():
    p = replace(own_world().settings, expected_speed_quantile=0.75)
    speed = np.where(np.arange(1000) % 10 == 0, 4.0, 0.0)
    assert fast_speed(speed, p) == pytest.approx(0.4)
    assert fast_speed(speed + 1, p) == 1
    assert fast_speed(np.zeros(9), p) > 0


def test_a_fish_that_swims_as_is_foretold_keeps_to_a_path_and_goes_on_from_a_cut():
    """It shows the rows that it follows, and remembers its own states."""
    one, turn = player(), np.linspace(0, 2 * np.pi, 100, endpoint=False)
    line = Line("a", 400 + 200 * np.sin(turn), 300 + 120 * np.sin(2 * turn), PX, closed=True)
    path = lay_path(line, one.world.tank, one.world.motion, None)
    found = animate_fish(one, [], 500, np.random.default_rng(0), path.route)
    table = path_table("matching", found, path, 500, one.world)
    assert np.sqrt((table["across"] ** 2).mean()) < 0.1
    assert table["along_px"].is_monotonic_increasing
    assert table["along_px"].iloc[-1] > 0.75 * path.route.length
    film = one.world.film
    for part in found.stretches:
        assert part.state == FORECAST and (np.diff(part.number) == 1).all()
        turned = part.trajectory[:, 2] - film.heading[part.number] - part.rotation_deg
        assert np.cos(np.radians(turned)) == pytest.approx(1)
    state, rng = one.begin(np.random.default_rng(1), path.route), np.random.default_rng(2)
    stretch, then = one.plan(state, path.route, rng)
    _, cut = one.cut(state, stretch, 3)
    assert len(cut.fish.past) == len(then.fish.past)
    assert (cut.fish.x, cut.fish.y) == tuple(stretch.trajectory[2, :2])
    assert one.plan(cut, path.route, rng)[1].progress.along > 0
