"""Fish that swim by rules: in company by zones, after a leader; contradictory rules are refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from toy_film import LENGTH, film_world_of, matching_of, planning, school_rule

from finloop.animate.arena import make_tank
from finloop.animate.rule import Rule
from finloop.animate.shoal import animate_group, make_tasks
from finloop.base.errors import FinloopError
from finloop.edit.build import build_edit_lists
from finloop.edit.schema import Goal
from finloop.live.message import parse_message
from finloop.live.tank import LiveTank
from finloop.live.view import TankView
from finloop.modes.matching import MatchingAnimator, add_rules
from finloop.plan.objectives import place_by_rule
from finloop.social.measures import measure_group
from finloop.social.zones import NO_ZONES, Zones

NEAR = Zones(0.0, 0.0, 30.0, 0.0, 0.0, 0.0, 3.0)  # attraction alone
FAR = Zones(30.0, 30.0, 30.0, 0.0, 3.0, 0.0, 0.0)  # repulsion alone
TICKS = 400


@cache
def water(rule="zones", fish=5, follow=(), overlap=False):
    """A tank of twenty lengths."""
    arena = np.zeros((900, 900), bool)
    arena[50:-50, 50:-50] = True
    room_ = make_tank(arena, 0.6 * LENGTH)
    pairs = [list(one) for one in follow]
    return film_world_of(room_=room_, rule=rule, fish=fish, follow_pairs=pairs, overlap=overlap)


def player_of(zones, **by):
    return replace(matching_of(water(**by)), school_rule=school_rule(zones))


def planner_of(own_world):
    return MatchingAnimator(matching_of(own_world), None, 1.0, own_world.settings)


def stepless():
    """A rule of a film whose tracks are too short for a step."""
    none, rule = np.zeros(0, complex), school_rule(NEAR)
    return replace(rule, steps=replace(rule.steps, wall=none, last=none, move=none, turn=none))


def swim_group(player, ticks=TICKS, seed=0, goals=()):
    p = player.world.settings
    plans = MatchingAnimator(player, None, 1.0, player.world.settings)
    todo = plans._share_out_tasks(goals, plans.goal_seekers, np.random.default_rng(seed))
    assert len(todo) == p.fish
    return build_edit_lists(animate_group(player, todo, ticks), ticks, player.edit_inputs)


def gaps(player, edit):
    """Nearest-neighbour distances in the second half, body lengths."""
    later = edit[edit["tick"] > TICKS // 2]
    places, heading = later[["x_px", "y_px"]].to_numpy(), later["heading_deg"].to_numpy()
    table = measure_group(later["tick"].to_numpy(), places, heading, player.world.walls)
    return float(table["neighbour_distance"].median())


# --- by zones


def test_fish_that_attract_each_other_come_together_and_others_part():
    players = player_of(NEAR), player_of(FAR)
    near, far = (swim_group(player) for player in players)
    assert gaps(players[0], near) < 0.6 * gaps(players[1], far)
    assert set(near["goal"]) >= {"company"}


def test_a_fish_of_which_nothing_is_wished_swims_as_without_a_rule():
    by, alone = player_of(NO_ZONES), player_of(NO_ZONES, rule="none")
    one, other = swim_group(by, 100), swim_group(alone, 100)
    assert one.drop(columns="goal").equals(other.drop(columns="goal"))


@pytest.mark.parametrize("overlap", [False, True])
def test_company_is_known_whether_or_not_fish_keep_clear(overlap):
    player = player_of(NEAR, overlap=overlap)
    edit = swim_group(player, 200)
    assert (edit[edit["tick"] > 50]["goal"] == "company").mean() > 0.9
    assert edit["x_px"].between(50, 850).all() and edit["y_px"].between(50, 850).all()


def test_a_wish_holds_for_a_step_and_is_drawn_anew_then():
    player = player_of(NEAR)
    rng = np.random.default_rng(0)
    state = player.begin(rng)
    rule = Rule.by_zones(np.array([[500.0, 500.0, 0.0]]), player.school_rule)
    places, ticks = [], 0
    while ticks < 60:
        stretch, state = player.plan(state, rule, rng)
        assert state.by_rule and 0 <= state.place_ticks_left < 15
        places.append(tuple(state.place))
        ticks += len(stretch.trajectory)
    assert 2 <= len(set(places)) <= len(places)
    assert place_by_rule(rule, state.fish, player.world, rng)[1] == 15
    begun = state._replace(place_ticks_left=5)
    _, wanders = player.plan(begun, None, rng)
    assert not wanders.by_rule and tuple(wanders.place) != tuple(begun.place)


def test_zones_that_nobody_knows_are_asked_for():
    player = replace(player_of(NEAR), school_rule=None)
    with pytest.raises(FinloopError, match="no zones for fish in a school") as caught:
        swim_group(player, 10)
    assert "calibrate" in caught.value.do


@pytest.mark.parametrize("steps", [True, False])
def test_company_without_a_rule_is_refused_before_anything_is_planned(steps):
    player = player_of(NEAR)
    assert MatchingAnimator(player, None, 1.0, player.world.settings).goals() == []
    player = replace(player, school_rule=stepless() if steps else None)
    with pytest.raises(FinloopError, match="too short for the steps" if steps else "no zones"):
        MatchingAnimator(player, None, 1.0, player.world.settings).goals()
    alone = replace(player, world=water(fish=1))
    assert MatchingAnimator(alone, None, 1.0, alone.world.settings).goals() == []


# --- after a leader


def test_followers_keep_near_their_leader_who_swims_to_its_goals():
    player = player_of(NEAR, rule="none", fish=3, follow=((2, 1), (3, 1)))
    goals = [Goal("A", 700.0, 200.0, 20.0), Goal("B", 200.0, 700.0, 20.0)]
    edit = swim_group(player, 400, goals=goals)
    where = edit[["x_px", "y_px"]].to_numpy().reshape(3, -1, 2)
    alone = swim_group(player_of(NEAR, rule="none", fish=3), 400, goals=goals)
    apart = alone[["x_px", "y_px"]].to_numpy().reshape(3, -1, 2)
    for follower in (1, 2):
        behind, free = (
            np.median(np.hypot(*(one[follower] - one[0]).T)[200:] / LENGTH)
            for one in (where, apart)
        )
        assert behind < min(6, free)
    first, second = (edit[edit["fish"] == fish] for fish in (0, 1))
    assert {"A", "B"} <= set(first["goal"])
    assert set(second["goal"]) <= {"leader", ""}


def test_a_follower_swims_behind_its_leader():
    player = player_of(NEAR)
    fish = player.begin(np.random.default_rng(0)).fish
    rule = Rule.to_follow(np.array([400.0, 300.0, 90.0, 0.0]))
    place, left = place_by_rule(rule, fish, player.world, None)
    assert place == pytest.approx([400, 300 + LENGTH]) and left == 0


def test_who_follows_nobody_has_the_goals():
    plans = planner_of(water("none", 4, ((2, 1), (4, 3))))
    goals = [Goal(name, 100.0, 100.0) for name in "ABC"]
    names = [[goal.name for goal in lot] for lot in (task.goals for task in plans.tasks(goals))]
    assert names == [["A", "C"], [], ["B"], []]
    assert plans.goal_seekers == [0, 2]
    player = player_of(NEAR)
    assert MatchingAnimator(player, None, 1.0, player.world.settings).goals() == []


@pytest.mark.parametrize("follow", [((1, 2), (2, 1)), ((1, 1),), ((2, 9),)])
def test_contradictory_rules_are_refused_before_anything_is_planned(follow):
    plans = planner_of(water("none", 3, follow))
    with pytest.raises(FinloopError, match="contradict each other") as caught:
        plans.goals()
    assert "matching.follow_pairs" in caught.value.do


def test_some_follow_and_the_rest_swim_in_company_or_each_by_itself():
    todo = make_tasks([], 3, np.random.default_rng(0))
    both = add_rules(todo, planning(rule="zones", follow_pairs=[[3, 1]]))
    assert [(one.zones, one.follows) for one in both] == [(True, None), (True, None), (False, 0)]
    neither = add_rules(todo, planning())
    assert [(one.zones, one.follows) for one in neither] == [(False, None)] * 3


# --- in the live tank


def live(zones=NEAR, fish=4):
    return LiveTank({"matching": player_of(zones, rule="none", fish=fish)}, "matching", fish, 3)


def fish_by_row(tank, ticks):
    """Places (ticks, fish, 2) of so many further ticks."""
    made = []
    for _ in range(ticks):
        tank.advance()
        made.append([(row.x_px, row.y_px) for row in (one.row_at(tank.tick) for one in tank.fish)])
    return np.array(made)


def spread(places):
    """How far fish are from their middle, body lengths."""
    off = places - places.mean(1, keepdims=True)
    return float(np.hypot(*off.transpose(2, 0, 1)).mean()) / LENGTH


def test_a_fish_is_handed_from_goal_to_path_to_rule_and_wanders_again():
    tank = live()
    one = tank.fish[0]
    tank.send_to_goal(0, 450.0, 450.0)
    assert one.goal is not None
    tank.follow_path(0, [(200.0, 200.0), (600.0, 300.0), (700.0, 600.0)])
    fish_by_row(tank, 3)
    assert one.path_task is not None and one.rule_task is None
    tank.swim_in_group(0)
    assert one.goal is None and one.path_task is None and one.rule_task.leader is None
    fish_by_row(tank, 20)
    assert {choice.target_name for choice in one._decisions} >= {"company"}
    tank.follow_leader(0, 2)
    assert tank.leaders == {1: 3}
    fish_by_row(tank, 20)
    assert one._decisions[-1].target_name == "leader"
    tank.send_to_goal(0, 450.0, 450.0)
    assert one.rule_task is None and one.goal is not None
    tank.swim_in_group(0)
    tank.let_wander(0)
    assert one.rule_task is None and tank.fish[1].rule_task is None


def test_weights_are_changed_while_fish_swim():
    near, far = live(), live()
    near.swim_in_group(None)
    far.swim_in_group(None)
    far.set_zone_weights((0.0, 0.0, 0.0))
    assert far.school_rule.zones.weights == (0, 0, 0)
    together, apart = (fish_by_row(tank, 300)[150:] for tank in (near, far))
    assert spread(together) < 0.6 * spread(apart)


def test_who_swims_by_a_rule_can_be_rewound_and_swims_the_same_again():
    tank = live()
    tank.swim_in_group(None)
    tank.follow_leader(3, 1)
    fish_by_row(tank, 60)
    first = fish_by_row(tank, 80)
    before = tank.school_rule
    tank.set_zone_weights((1.0, 1.0, 0.1))
    fish_by_row(tank, 20)
    tank.go_back_to(60)
    assert tank.school_rule == before and tank.leaders == {4: 2}
    assert fish_by_row(tank, 80) == pytest.approx(first)


def test_who_would_follow_in_a_circle_is_refused_and_told():
    view = TankView(live(), None, None)
    view.handle_request(parse_message('{"do": "rule", "fish": 0, "leader": 1}'))
    assert view.tank.leaders == {1: 2} and view.refused == ""
    # Everybody, also who leads it.
    view.handle_request(parse_message('{"do": "rule", "fish": null, "leader": 0}'))
    assert "fish 2 follows fish 1 follows fish 2" in view.refused
    assert view.tank.leaders == {1: 2}
    view.handle_request(parse_message('{"do": "rule", "fish": null, "leader": 1}'))
    assert view.tank.leaders == {1: 2, 3: 2, 4: 2} and view.refused == ""
    view.handle_request(parse_message('{"do": "rule", "fish": 1, "leader": 7}'))  # nobody
    assert view.tank.leaders == {1: 2, 3: 2, 4: 2}


def test_company_of_which_nothing_is_known_or_without_steps_is_refused():
    weights = '{"do": "weights", "repulsion": 1.0, "alignment": 1.0, "attraction": 1.0}'
    for rule, said in ((None, "calibrate"), (stepless(), "too short")):
        view = TankView(live(), None, None)
        view.tank.school_rule = rule
        view.handle_request(parse_message('{"do": "rule", "fish": null, "leader": null}'))
        assert said in view.refused and view.tank.fish[0].rule_task is None
        view.handle_request(parse_message(weights))
        assert (view.tank.school_rule is None) == (rule is None)


def test_a_follower_whose_leader_is_gone_wanders():
    tank = live()
    tank.follow_leader(0, 3)
    fish_by_row(tank, 10)
    tank.set_fish_count(2)
    fish_by_row(tank, 30)
    assert tank.leaders == {} and tank.fish[0]._decisions[-1].goal is None


@pytest.mark.parametrize("bad", [
    '{"do": "rule", "fish": 0}', '{"do": "rule", "fish": 0, "leader": 99}',
    '{"do": "weights", "repulsion": -1, "alignment": 0, "attraction": 0}',
    '{"do": "weights", "repulsion": 1, "alignment": 0, "attraction": 99}',
])  # fmt: skip
def test_rules_that_make_no_sense_are_no_messages(bad):
    assert parse_message(bad) is None
