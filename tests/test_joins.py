"""Joins by inertialization: laws on made-up postures; fades and cuts beside them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from toy_film import (
    DELTA,
    RATE,
    bodies_of,
    gateways,
    hybrid_of,
    paper_player,
    player_of,
    rich_film,
)  # fmt: skip

from finloop.animate.settings import AnimateSettings
from finloop.animate.shoal import plan_edit_list
from finloop.base.settings import settings
from finloop.edit.joins import (
    JoinRules,
    PictureSequence,
    inertialize_pictures,
    resolve_join_rules,
    sum_past_values,
)
from finloop.edit.modes import MODES
from finloop.edit.schema import CUT, FADE, FRAME, INERTIAL, SPRITE, Goal, row_picture
from finloop.features.table import wrap_deg

DECAY = 5.0
BODIES = bodies_of(rich_film())
HOW = JoinRules(INERTIAL, 3, DECAY, BODIES, np.zeros(len(BODIES.goes_on), bool))


def frames(*runs, mirrored=False, rotation_deg=0.0):
    """Runs (first row, ticks) of the film, one after the other."""
    rows = np.concatenate([np.arange(first, first + ticks) for first, ticks in runs])
    n = len(rows)
    return PictureSequence(np.ones(n, bool), rows, np.full(n, rotation_deg), np.full(n, mirrored))


def shown_bodies(shown):
    return BODIES.picture_bodies(shown.frame, shown.number, shown.rotation_deg, shown.mirrored)


def inertialize_shown(shown, how=HOW):
    return inertialize_pictures(shown, np.zeros(len(shown.number)), how)


def heading(shown, found):
    return shown_bodies(shown).heading_deg + found.turn_deg


SHAPES = BODIES.poses.shapes
POSES = replace(BODIES.poses, shapes=replace(SHAPES, gap=1e9))
FREE = replace(HOW, bodies=replace(BODIES, poses=POSES))
"""The same film, in which every posture is possible."""


def test_the_film_itself_is_in_no_pose():
    found = inertialize_shown(frames((10, 60)))
    assert not found.posed.any() and not found.turn_deg.any() and not len(found.begins)
    next_row = frames((10, 5), (15, 40))
    assert not inertialize_shown(next_row).posed.any()


def test_posture_velocity_and_heading_go_on_across_a_join_and_die_away():
    shown = frames((10, 30), (310, 40))
    found, codes = inertialize_shown(shown, FREE), BODIES.codes(shown_bodies(shown))
    assert list(np.flatnonzero(found.posed)) == list(range(30, 30 + FREE.most_ticks - 3))
    assert list(found.begins) == [30]
    film = BODIES.poses.codes
    assert found.codes[30] == pytest.approx(film[40], abs=1e-5)  # what would have come
    step = found.codes[31] - found.codes[30]
    plain = codes[31] - film[40]
    going_on = film[41] - film[40]
    assert np.linalg.norm(step - going_on) < 0.4 * np.linalg.norm(plain - going_on)
    turned = heading(shown, found)
    filmed = wrap_deg(BODIES.heading_deg[40] - BODIES.heading_deg[39])
    assert wrap_deg(turned[30] - turned[29]) == pytest.approx(filmed, abs=1e-6)
    left = np.linalg.norm(found.codes - codes, axis=1)
    assert left[30 + int(DECAY) :].max() < 0.25 * left[30]
    assert left[found.posed][-1] < 0.01 * left[30] and left[~found.posed].max() < 1e-6


def test_a_spring_has_five_per_cent_left_when_its_time_is_over():
    offset, velocity = replace(HOW, decay=5.0).spring_response()
    assert offset[0] == 1 and velocity[0] == 0
    assert offset[5] == pytest.approx(0.05, abs=1e-4)
    assert offset[-1] < 0.002 and (np.diff(offset) < 0).all()
    twice = (offset[2] - 2 * offset[1] + offset[0]) / (offset[1] - offset[0])
    assert abs(twice) < 1  # it begins smoothly


def test_a_picture_that_is_held_does_not_bend_on_and_on():
    rows = np.r_[10:20, np.full(30, 19), 20:30]
    n = len(rows)
    shown = PictureSequence(np.ones(n, bool), rows, np.zeros(n), np.zeros(n, bool))
    found = inertialize_shown(shown, FREE)
    apart = np.linalg.norm(found.codes - BODIES.codes(shown_bodies(shown)), axis=1)
    step = np.linalg.norm(np.diff(BODIES.poses.codes[10:30], axis=0), axis=1).max()
    assert apart.max() < 3 * step and not found.posed[25:39].any()


def test_while_the_film_rests_what_a_join_left_stays_as_it_is():
    rest = np.zeros_like(HOW.rests)
    rest[315:325] = True
    resting = replace(FREE, rests=rest)
    shown = frames((10, 30), (310, 60))
    codes = BODIES.codes(shown_bodies(shown))
    turn = heading(shown, inertialize_shown(shown)) - shown_bodies(shown).heading_deg
    free, held = (inertialize_shown(shown, how) for how in (FREE, resting))
    left, stays = free.codes - codes, held.codes - codes
    count = len(shown.number) - 10
    assert np.allclose(np.delete(stays, np.r_[35:45], 0), left[:count], atol=1e-6)
    assert np.allclose(stays[35:45], stays[34], atol=1e-6) and np.abs(stays[34]).max() > 0.05
    assert np.allclose(np.delete(held.turn_deg, np.r_[35:45]), turn[:count])
    assert held.posed.sum() == free.posed.sum() + 10
    frames_moving, sprites_moving = (
        resting.count_moving(kind, shown.number) for kind in (FRAME, SPRITE)
    )
    assert frames_moving == sprites_moving - 10


def test_two_joins_in_a_row_carry_the_rest():
    found = inertialize_shown(frames((10, 30), (310, 3), (700, 40)), FREE)
    alone = inertialize_shown(frames((10, 30), (310, 40)), FREE)
    # What would have come: the second run's next row, bent by what was left of the first join.
    expected = alone.codes[33]
    assert found.codes[33] == pytest.approx(expected, abs=1e-5)
    assert np.linalg.norm(expected - BODIES.poses.codes[313]) > 0.05
    plain = inertialize_shown(frames((310, 3), (700, 40)), FREE)
    assert not np.allclose(found.codes[34], plain.codes[4], atol=1e-3)


def test_mirrored_frames_are_mirrored_and_twice_is_themselves():
    mirror = SHAPES.mirror_matrix
    assert mirror @ mirror == pytest.approx(np.eye(len(mirror)), abs=1e-9)
    plain, other = (frames((10, 30), (310, 40), mirrored=flip) for flip in (False, True))
    one, two = inertialize_shown(plain, FREE), inertialize_shown(other, FREE)
    assert two.codes[one.posed] == pytest.approx(one.codes[one.posed] @ mirror, abs=1e-5)
    mixed = replace(plain, mirrored=np.arange(70) >= 30)
    assert inertialize_shown(mixed, FREE).codes[30] == pytest.approx(one.codes[30], abs=1e-5)
    flipped = replace(frames((10, 60)), mirrored=np.arange(60) >= 30)  # the same row, turned over
    assert inertialize_shown(flipped, FREE).begins.tolist() == [30]


def test_what_no_animal_of_the_film_can_do_is_not_drawn():
    shown = frames((10, 30), (310, 40))
    found = inertialize_shown(shown)
    codes = found.codes[found.posed].astype(float)
    assert not SHAPES.nearest_codes(codes).clamped.any()
    far = SHAPES.nearest_codes(found.codes[30][None] + 50.0)
    assert far.clamped.all() and SHAPES.is_far_from_film(far.codes).all()


@pytest.mark.parametrize("mode", MODES)
def test_joins_change_how_pictures_are_drawn_and_nothing_else(mode):
    lists = {
        kind: plan_edit_list(player_of(mode, join=kind), [], 600, np.random.default_rng(2))
        for kind in (INERTIAL, FADE, CUT)
    }
    inertial, fade, cut = lists.values()
    same = [name for name in cut if not name.startswith("partner") and name != "weight"]
    assert fade[same].equals(cut[same])
    assert cut["pose"].isna().all() and not cut["weight"].any()
    assert (fade["weight"] > 0).any()
    same = [name for name in same if name not in ("pose", "rotation_deg")]
    assert inertial[same].equals(cut[same])
    posed = inertial["pose"].notna()
    assert posed.any() and (inertial["weight"] > 0)[posed].any()
    assert not (inertial["weight"] > 0)[~posed].any()
    assert inertial["rotation_deg"][~posed].equals(cut["rotation_deg"][~posed])


def test_sprites_and_frames_join_alike():
    """A join that none came shortly before: its own heading alone goes on."""
    few = gateways().query("direction == 'out' or (sprite == 3 and rank < 3)")
    player = paper_player(hybrid_of(gates=few), INERTIAL)
    edit = plan_edit_list(player, [Goal("A", 200.0, 200.0)], 3000, np.random.default_rng(2))
    kind = edit["kind"].to_numpy()
    switches = np.flatnonzero(kind[1:] != kind[:-1]) + 1
    assert len(switches) > 2
    assert edit["pose"][switches].notna().all()
    calm = [tick for tick in switches if edit["reason"][tick - 8 : tick].isna().all()]
    assert set(kind[calm]) == {SPRITE, FRAME}
    for tick in calm:
        bodies = [
            BODIES.body_in_edit_row(row_picture(row))
            for row in edit.iloc[tick - 1 : tick + 1].itertuples()
        ]
        assert abs(wrap_deg(bodies[1].heading_deg - bodies[0].heading_deg)) < 30  # two orientations


def test_a_fish_that_never_bends_joins_too():
    poses = BODIES.poses
    stiff = replace(BODIES, poses=replace(poses, codes=np.zeros_like(poses.codes)))
    found = inertialize_shown(frames((10, 30), (310, 40)), replace(HOW, bodies=stiff))
    assert found.posed.any() and not found.codes.any()


def test_the_time_of_a_join_is_measured_or_said(monkeypatch):
    def decay(memory, **changes):
        film = replace(BODIES, poses=replace(BODIES.poses, memory_frames=memory * RATE))
        p = settings("animate", **changes)
        return resolve_join_rules(p, INERTIAL, film, DELTA).decay / RATE

    assert decay(0.25) == pytest.approx(0.25)
    monkeypatch.setattr(AnimateSettings, "join_frames", 3)
    assert decay(0.01) == pytest.approx(0.15) and decay(9.0) == pytest.approx(0.4)
    # Of few frames in Δ a join has frames enough to be none.
    monkeypatch.setattr(AnimateSettings, "join_frames", 6)
    assert decay(0.01) == pytest.approx(6 / RATE)
    assert decay(9.0) == pytest.approx(0.4)
    assert decay(0.25, join_time_deltas=4.0) == pytest.approx(0.8)
    assert resolve_join_rules(settings("animate"), CUT, BODIES, DELTA).fade == 0


def test_what_is_left_of_jumps_is_what_a_filter_leaves():
    rng = np.random.default_rng(0)
    weights, values = rng.normal(size=7), rng.normal(size=(30, 2))
    wanted = scipy.signal.lfilter(weights, [1.0], values, axis=0)
    for ticks in (30, 3):
        assert sum_past_values(weights, values[:ticks]) == pytest.approx(wanted[:ticks], rel=1e-12)
