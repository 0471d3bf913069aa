"""Several fish in one tank: a body is a few discs, and nobody swims through another."""

from itertools import product

import numpy as np
import pytest
from toy_film import HULL, crowd_player, film_world_of, matching_of, narrow_tank

from finloop.animate.encounters import do_outlines_overlap, place_outline
from finloop.animate.kinematics import Target
from finloop.animate.obstacles import (
    NO_OBSTACLES,
    Plans,
    can_stay,
    count_lasting_ticks,
    count_ticks_before_meeting,
    cover_with_discs,
    is_clear_in_search,
    is_clear_of_fish,
    make_obstacles,
    sort_near_first,
)
from finloop.base.errors import FinloopError
from finloop.edit.schema import FRAME
from finloop.edit.stretch import Decision, Stretch
from finloop.live.tank import LiveTank
from finloop.plan.planner import Planner

NEEDLE = np.array([[30.0, 2], [-30, 2], [-30, -2], [30, -2]])
MODE = "matching"  # the one mode of several fish
EDGE = 1.5  # px around every body


def obstacles_at(ways, start, discs, stays):
    """The obstacles of fish whose ways begin at a tick."""
    return make_obstacles(
        Plans.from_paths(ways, start).places_of_others(-1, start), start, discs, stays
    )


SPOT = Target(0.0, 0.0, 0.0, 0.0)


def bent_outline(rng: np.random.Generator) -> np.ndarray:
    """The outline (50, 2) of a fish of 60 px that bends to one side, thin at the tail."""
    along = np.linspace(30, -30, 25)
    middle = rng.uniform(-20, 20) * ((30 - along) / 60) ** 2
    wide = 3 + 4 * (along + 30) / 60
    return np.concatenate([
        np.column_stack([along, middle + wide]), np.column_stack([along, middle - wide])[::-1]
    ])  # fmt: skip


# --- discs


def test_discs_hold_their_outline_also_of_few_and_long_sides():
    outlines = [bent_outline(np.random.default_rng(seed)) for seed in range(20)]
    few = np.array([[0.5, 0.02], [0.3, 0.1], [-0.5, 0.01], [-0.45, -0.02], [0.4, -0.08]])
    for corners in (*outlines, 40 * few, 400 * few):
        own = cover_with_discs(np.empty((0, 5, 2)), [corners]).table[0]
        share = np.linspace(0, 1, 200)[:, None, None]
        sides = corners + share * (np.roll(corners, -1, axis=0) - corners)
        apart = np.hypot(*(sides.reshape(-1, 1, 2) - own[None, :, :2]).transpose(2, 0, 1))
        assert (apart <= own[:, 2]).any(axis=1).all()


def test_discs_are_no_wider_than_they_must_be():
    own = cover_with_discs(NEEDLE[None], []).table[0]
    assert own[:, 0] == pytest.approx([-25, -15, -5, 5, 15, 25])
    assert own[:, 1] == pytest.approx(0) and own[:, 2] == pytest.approx(np.hypot(2, 5) + EDGE)


def test_sprites_are_looked_up_after_the_frames_and_their_mirror_images():
    way = np.arange(6.0).reshape(2, 3)
    frames = Stretch(0, way, np.array([2, 7]), False, SPOT, False, Decision(""), FRAME)
    sprites = Stretch(0, way, np.array([0, 1]), False, SPOT, False, Decision(""))
    assert frames.pictures.tolist() == [2, 7] and sprites.pictures.tolist() == [-1, -2]
    assert frames.path_and_pictures.tolist() == [[0, 1, 2, 2], [3, 4, 5, 7]]


def test_of_a_way_that_is_over_its_last_tick_is_left():
    way = np.arange(9.0).reshape(3, 3)
    one = Stretch(0, way, np.arange(3), False, SPOT, False, Decision(""), FRAME)
    for gone, left in ((0, 3), (1, 2), (2, 1), (3, 1), (9, 1)):
        assert one.remaining_path(gone).tolist() == one.path_and_pictures[-left:].tolist()


@pytest.mark.parametrize("seed", range(8))
def test_who_is_clear_of_another_does_not_overlap_it(seed):
    rng = np.random.default_rng(seed)
    outlines = [bent_outline(rng), bent_outline(rng), bent_outline(rng)]
    discs = cover_with_discs(np.stack(outlines[:2]), outlines[2:])
    shown = [(0, 0, False), (1, 1, False), (2, 0, True), (3, 1, True), (-1, 2, False)]
    met = 0
    for _ in range(40):
        (one, own, flip), (other, theirs, flop) = (shown[rng.integers(5)] for _ in range(2))
        a, b = ((*rng.uniform(0, 60, 2), rng.uniform(-180, 180)) for _ in range(2))
        obstacles = obstacles_at([np.array([[*b, other]])], 0, discs, 0)
        apart = is_clear_of_fish(obstacles, one, *a, 0)
        back = is_clear_of_fish(obstacles_at([np.array([[*a, one]])], 0, discs, 0), other, *b, 0)
        assert apart == back  # whoever asks
        there = place_outline(outlines[own], *a, flip), place_outline(outlines[theirs], *b, flop)
        assert not (apart and do_outlines_overlap(*there))
        met += not apart
    assert 0 < met < 40


def test_side_by_side_is_nearer_than_head_to_tail():
    discs = cover_with_discs(NEEDLE[None], [])
    obstacles = obstacles_at([np.array([[0.0, 0, 0, 0]])], 0, discs, 0)
    wide = 2 * (np.hypot(2, 5) + EDGE)
    assert is_clear_of_fish(obstacles, 0, 0.0, wide + 0.1, 0.0, 0)
    assert not is_clear_of_fish(obstacles, 0, 0.0, wide - 0.1, 0.0, 0)
    assert not is_clear_of_fish(obstacles, 0, 50.0, 0.0, 0.0, 0)
    assert is_clear_of_fish(obstacles, 0, 70.0, 0.0, 0.0, 0)


# --- ways


def crossing():
    """The obstacles of a needle that swims to the right for 20 ticks, and stays there."""
    way = np.column_stack([5.0 * np.arange(20), np.zeros(20), np.zeros(20), np.zeros(20)])
    return obstacles_at([way], 10, cover_with_discs(NEEDLE[None], []), 6)


def test_others_are_where_they_planned_to_be_and_stay_where_that_ends():
    obstacles = crossing()
    for tick, x in ((10, 0.0), (14, 20.0), (29, 95.0), (80, 95.0)):
        assert not is_clear_of_fish(obstacles, 0, x + 60, 0.0, 0.0, tick)
        assert is_clear_of_fish(obstacles, 0, x + 75, 0.0, 0.0, tick)


def test_who_looks_ahead_forgets_them_after_a_while():
    obstacles = crossing()
    assert obstacles.until == 10 + 19 + 6
    for tick in range(10, 60):
        ahead = is_clear_in_search(obstacles, 0, 95.0, 0.0, 90.0, tick)
        assert ahead == (tick > 35 or is_clear_of_fish(obstacles, 0, 95.0, 0.0, 90.0, tick))


def test_the_ticks_of_a_way_that_last_are_those_of_a_plain_search():
    obstacles, ends = crossing(), set()
    for begins in np.linspace(-150, 200, 30):
        way = np.column_stack([np.full(40, 40.0), begins + 3.0 * np.arange(40), np.full(40, -90.0)])
        numbers = np.zeros(40, np.int64)
        free = [is_clear_of_fish(obstacles, 0, *place, 10 + t) for t, place in enumerate(way)]
        n = free.index(False) if False in free else 40
        assert count_ticks_before_meeting(obstacles, numbers, way, 10) == n
        lasts = [
            all(is_clear_of_fish(obstacles, 0, *way[k - 1], tick) for tick in range(9 + k, 100))
            for k in range(1, n + 1)
        ]
        most = max((k for k, good in enumerate(lasts, 1) if good), default=0)
        assert count_lasting_ticks(obstacles, numbers, way, 10) == most
        assert can_stay(obstacles, 0, way[0], 10) == (n > 0 and lasts[0])
        ends.add((n, most))
    assert any(0 < most < n for n, most in ends)
    assert min(ends)[0] < 3 and max(ends)[0] == 40


@pytest.mark.parametrize("known_ticks", [1, 8, 40])
@pytest.mark.parametrize("seed", range(3))
def test_a_search_looks_for_those_alone_that_can_be_met_in_time(seed, known_ticks):
    rng, pace = np.random.default_rng(seed), 5.0
    ways = [
        np.column_stack([
            np.cumsum(rng.normal(0, 4, (n, 2)), axis=0) + rng.uniform(200, 600, 2),
            rng.uniform(-180, 180, n), np.zeros(n),
        ])
        for n in rng.integers(1, 12, 20)
    ]  # fmt: skip
    obstacles = obstacles_at(ways, 7, cover_with_discs(NEEDLE[None], []), 6)
    some = sort_near_first(obstacles, 400.0, 400.0, pace * np.arange(known_ticks + 1))
    assert obstacles.near_count == 20 > some.near_count > 0
    assert sorted(some.places[0].tolist()) == sorted(obstacles.places[0].tolist())
    met = 0
    for _ in range(2000):
        tick, angle = int(rng.integers(7, obstacles.until + 1)), rng.uniform(0, 2 * np.pi)
        far = rng.uniform(0, pace * (tick - 6))  # as far as it comes by then
        place = 400 + far * np.cos(angle), 400 + far * np.sin(angle), rng.uniform(-180, 180)
        free = is_clear_of_fish(obstacles, 0, *place, tick)
        assert is_clear_in_search(some, 0, *place, tick) == free
        assert is_clear_of_fish(some, 0, *place, tick) == free
        met += not free
    assert met


def test_how_far_a_fish_comes_is_never_less_than_the_film_shows():
    world = film_world_of()
    film, far = world.film, world.farthest_px
    for ticks in range(1, len(far)):
        first = np.flatnonzero(film.has_next[:-ticks])[:: max(1, ticks)]
        one_track = np.abs(film.x[first + ticks] - film.x[first]) < 400
        off = np.hypot(film.x[first + ticks] - film.x[first], film.y[first + ticks] - film.y[first])
        inside = first[np.array([film.has_next[k : k + ticks].all() for k in first]) & one_track]
        shown = off[np.isin(first, inside)]
        assert shown.max() <= far[ticks] + 1e-9
    assert far[0] == 0 and far[-1] > 0 and (np.diff(far) >= 0).all()


def test_alone_every_place_is_clear():
    assert is_clear_of_fish(NO_OBSTACLES, 0, 0.0, 0.0, 0.0, 0)


# --- fish of one tank


def outlines_of(tank):
    for fish in tank.fish:
        row = fish.row_at(tank.tick)
        yield place_outline(HULL, row.x_px, row.y_px, row.heading_deg, False)


def overlaps(tank) -> int:
    outlines = list(outlines_of(tank))
    return sum(do_outlines_overlap(a, b) for k, a in enumerate(outlines) for b in outlines[:k])


def test_nobody_swims_through_another():
    met = {}
    for through in (False, True):
        tank, rng = LiveTank({MODE: crowd_player(through)}, MODE, 6, 1), np.random.default_rng(3)
        met[through], still = 0, 0
        for tick in range(240):
            if tick % 7 == 0:  # sent about all the time, the moment before it meets another, too
                tank.send_to_goal(int(rng.integers(6)), *rng.uniform((200, 100), (600, 500)))
            before = [fish.row_at(tank.tick) for fish in tank.fish]
            tank.advance()
            met[through] += overlaps(tank)
            rows = zip(before, (fish.row_at(tank.tick) for fish in tank.fish), strict=True)
            still += sum((row.x_px, row.y_px) == (old.x_px, old.y_px) for old, row in rows)
        assert len(tank.fish) == 6 and still < 0.3 * 6 * 240
    assert met[False] == 0 < met[True]


def test_two_fish_sent_to_each_other_pass():
    tank, passed = LiveTank({MODE: crowd_player()}, MODE, 2, 5), 0
    for _ in range(4):
        for number, x in enumerate((280.0, 520.0) if passed % 2 else (520.0, 280.0)):
            tank.send_to_goal(number, x, 300.0)
        for _ in range(600):
            tank.advance()
            assert not overlaps(tank)
            if all(fish.reached for fish in tank.fish):
                passed += 1
                break
    assert passed == 4


def test_along_one_path_they_follow_each_other():
    tank, angle = LiveTank({MODE: crowd_player()}, MODE, 3, 5), np.linspace(0, 2 * np.pi, 40)
    ring = np.column_stack([400 + 100 * np.cos(angle), 300 + 100 * np.sin(angle)])
    tank.follow_path(None, [(float(x), float(y)) for x, y in ring])
    on_it = 0
    for _ in range(300):
        tank.advance()
        assert not overlaps(tank)
        on_it += sum(fish.path_task.begun for fish in tank.fish)
    assert on_it > 300


def kept_plan(tank, monkeypatch, wish) -> int:
    """The tick at which a wish is refused, as others rely on the plan; three ticks of it are left."""
    while len(tank.fish[0].planned_path_from(tank.tick)) < 4:
        tank.advance()
    plan = tank.fish[0].planned_path_from(tank.tick)
    wish()
    with monkeypatch.context() as patch:
        patch.setattr(Planner, "is_clear", lambda *_: False)
        tank.advance()
    assert np.array_equal(tank.fish[0].planned_path_from(tank.tick), plan[1:])
    return tank.tick


def test_the_goal_of_a_kept_plan_is_not_the_new_one(monkeypatch):
    tank = LiveTank({MODE: crowd_player()}, MODE, 1, 2)
    fish, kept = tank.fish[0], 0
    for number in range(8):
        tank.send_to_goal(0, *((220.0, 120.0), (580.0, 480.0))[number % 2])
        while not fish.reached:
            tank.advance()
            ends = fish.decision_at(tank.tick).stretch.touches_goal
            if ends and len(fish.planned_path_from(tank.tick)) > 4:
                kept_plan(tank, monkeypatch, lambda: tank.send_to_goal(0, 400.0, 120.0))
                while len(fish.planned_path_from(tank.tick)) > 1:
                    tank.advance()
                assert not fish.reached
                kept += 1
                break
    assert kept


def test_a_plan_that_was_kept_is_kept_again(monkeypatch):
    tank = LiveTank({MODE: crowd_player()}, MODE, 2, 2)
    for _ in range(30):
        tank.advance()

    def elsewhere():
        tank.send_to_goal(0, 220.0, 480.0)

    begin = kept_plan(tank, monkeypatch, elsewhere)
    for _ in range(40):
        tank.advance()
    was = [[one.row_at(tick)[:-1] for tick in range(begin, begin + 41)] for one in tank.fish]
    tank.go_back_to(begin)
    for _ in range(40):
        tank.advance()
    now = [[one.row_at(tick)[:-1] for tick in range(begin, begin + 41)] for one in tank.fish]
    assert repr(now) == repr(was)


def test_more_fish_than_fit():
    player = matching_of(film_world_of(room_=narrow_tank()))
    tank = LiveTank({MODE: player}, MODE, 40, 0)
    assert 1 <= len(tank.fish) < 40
    fish = [one.planned_path_from(tank.tick) for one in tank.fish]
    places = product(range(10, 120, 10), range(10, 70, 10))
    plans = Plans.from_paths(fish + [np.array([[x, y, 0.0, 0.0]]) for x, y in places], 0)
    with pytest.raises(FinloopError, match="no room"):
        others = player.others_to_avoid(plans.places_of_others(-1, 0), 0)
        player.begin(np.random.default_rng(0), None, others)
