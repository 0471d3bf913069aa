"""Jumps to nearest neighbours: against every pair, one a passage, and mirror images alike."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from toy_film import arc_track, film_world_of, matching_of, table_of

from finloop.base.nearest import assign_parts
from finloop.base.settings import settings
from finloop.distance.picture import BODY
from finloop.edit.build import resolve_mirror_images
from finloop.edit.schema import TERMS
from finloop.features.table import wrap_deg
from finloop.jumps import film
from finloop.jumps.film import JumpSearch, _find_best_jumps, choose_best_jumps
from finloop.jumps.signature import (
    SignatureParts,
    compute_signatures,
    measure_handedness,
    measure_side_difference,
)
from finloop.jumps.table import JUMPS
from finloop.jumps.visible import VisibleDistance
from finloop.plan.graph import index_jumps, motion_graph

COUNT, LEAST = 5, 8


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def walk(rng: np.random.Generator, n: int = 160) -> np.ndarray:
    """Numbers (2, n, 3) that change little by little; the mirror image has the last one negated."""
    own = rng.normal(0, 1, (n, 3)).cumsum(0) / 4
    return np.stack([own, own * (1, 1, -1)])


def nearest(values, track, mirror=True):
    return JumpSearch.from_values(values, track, COUNT, LEAST, mirror)(np.arange(len(track)))


@pytest.mark.parametrize("mirror", [True, False])
def test_every_jump_is_what_a_search_of_every_pair_gives(rng, mirror):
    values, track = walk(rng), np.repeat([0, 1, 2], [60, 70, 30])
    n, made = len(track), nearest(values, track, mirror)
    assert list(made) == ["row", "to", "mirrored", "far"]
    targets = np.concatenate(values[: 1 + mirror])
    for row in range(n):
        far = np.linalg.norm(targets - values[0, row], axis=1)
        j = np.arange(len(targets))
        to = j % n
        ends = np.searchsorted(track, track[to], "right") - 1 - to < LEAST
        near = (j < n) & (track[to] == track[row]) & (np.abs(to - row) < LEAST)
        far[ends | near] = np.inf
        inner = np.r_[np.inf, far, np.inf]
        best = np.flatnonzero((far < inner[:-2]) & (far <= inner[2:]))
        kept: list[int] = []
        for j in best[np.argsort(far[best])].tolist():
            beside = [abs(j - i) < LEAST and track[j % n] == track[i % n] for i in kept]
            if not any(beside):
                kept.append(j)
        best = np.array(kept[:COUNT])
        mine = made[made["row"] == row]
        assert mine["to"].tolist() == (best % n).tolist()
        assert mine["mirrored"].tolist() == (best >= n).tolist()
        assert mine["far"].to_numpy() == pytest.approx(far[best], rel=1e-5)


def test_a_rest_is_no_more_neighbours_than_it_has_passages(rng):
    """A fish that rests twice, and swims between: both rests are among the neighbours of each."""
    rest = rng.normal(0, 0.01, (2, 30, 3))
    own = np.concatenate([rest[0], walk(rng)[0] + 3, rest[1] + 0.2, walk(rng)[0] - 3])
    track = np.zeros(len(own), int)
    made = nearest(np.stack([own, own]), track, mirror=False)
    first = made[made["row"] < 30].groupby("row")["to"]
    assert first.apply(lambda to: to.between(190, 219).any()).all()
    assert made.groupby("row")["to"].apply(lambda to: np.diff(np.sort(to)).min()).min() >= LEAST


class Nothing:
    """A film of which no picture is looked at."""

    def picture_array(self):
        return np.zeros((0, 8, 8, 2), np.uint8)

    def load_film(self):
        return None, SimpleNamespace(pose=SimpleNamespace(posture=np.zeros((0, 2))))


def of_parts(monkeypatch, most: int) -> None:
    """A film of so many rows is long."""
    monkeypatch.setattr(film, "assign_parts", partial(assign_parts, most=most))


def test_in_a_part_of_the_film_are_the_nearest_that_lie_there(rng, monkeypatch):
    of_parts(monkeypatch, 60)
    values, track = walk(rng), np.zeros(160, int)
    made, whole = (JumpSearch.from_values(values, track, count, LEAST) for count in (COUNT, 160))
    assert made.part_count == 3
    rows, every = np.arange(160), whole(np.arange(160))
    for part in range(3):
        few = made.search_part(rows, part)
        assert (made.part[few["to"]] == part).all() and set(few["row"]) == set(rows)
        for row, own in few.groupby("row"):
            there = every[(every["row"] == row) & (made.part[every["to"]] == part)]
            assert own["far"].min() <= there["far"].min()


def test_jumps_of_a_long_film_lead_to_the_nearest_rows_and_to_others(rng, monkeypatch):
    """Ten times the same film, which differ by less than a hundredth of a step."""
    one = walk(rng)[0]
    own = np.concatenate([one + rng.normal(0, 1e-3, one.shape) for _ in range(10)])
    values, track = np.stack([own, own]), np.repeat(np.arange(10), len(one))
    monkeypatch.setattr(VisibleDistance, "measure_best", lambda self, near, count: 0 * near["far"])
    made = {}
    for most in (2000, 160):
        of_parts(monkeypatch, most)
        look = JumpSearch.from_values(values, track, 10, LEAST, mirror=False)
        made[most] = _find_best_jumps(Nothing(), look, 1.0, 8, 3, np.arange(len(track)))
    # The nearest are all of the same moment, after which all goes on alike.
    elsewhere = {
        most: (jumps["to"] % len(one) - jumps["row"] % len(one)).abs() >= LEAST
        for most, jumps in made.items()
    }
    assert elsewhere[2000].mean() < 0.05 and elsewhere[160].mean() > 0.4
    nearest = made[160].groupby("row")["seam"].min() - made[2000].groupby("row")["seam"].min()
    assert nearest.abs().max() == 0
    assert not made[160].duplicated(["row", "to", "mirrored"]).any()
    assert made[160]["row"].is_monotonic_increasing


def test_a_film_too_short_to_go_on_has_no_jump(rng):
    assert nearest(walk(rng, LEAST), np.zeros(LEAST, int)).empty


def test_of_what_is_near_the_best_to_the_eye_are_chosen():
    near = pd.DataFrame({"row": [0] * 4 + [1], "to": range(4, 9), "mirrored": False, "far": 0.5})
    made = choose_best_jumps(near, np.array([1.5, 0.5, 3.0, 2.0, 9.0]), 2)
    assert list(made) == JUMPS.names
    assert made["to"].tolist() == [5, 4, 8] and made["row"].tolist() == [0, 0, 1]
    assert made["seam"].tolist() == [0.75, 2.75, 81.5]


def test_what_is_seen_is_what_no_posture_explains(rng):
    """Two frames in one posture, and their mirror images; a third one, bent."""
    pictures = np.zeros((4, 24, 24, 2), np.uint8)
    pictures[:, 8:16, 4:20] = 200
    pictures[1, 10:12, 14:18, 0] = 50  # a patch on one side
    pictures[2] = pictures[1, ::-1]
    steps = [np.full(8, 1 / 8)] * 4
    bent = np.stack([np.zeros(8)] * 3 + [np.linspace(0, 0.4, 8)])
    postures = np.concatenate([np.tile([0.5, 0.0], (4, 1)), bent, steps], 1)
    seen = VisibleDistance(pictures, postures, 2.0)
    same = seen([0, 1, 2, 1], [0, 1, 1, 2], [False, False, True, True])
    assert same == pytest.approx(0, abs=0.05)
    patch = np.linalg.norm((pictures[1] - pictures[0].astype(float)) / 255) / 2
    assert seen([0, 1], [1, 0], [False, False]) == pytest.approx(patch, rel=0.1)
    plain = np.linalg.norm((pictures[3] - pictures[1].astype(float)) / 255) / 2
    assert 0 < seen([1], [3], [False])[0] <= plain + 1e-6


def test_no_more_is_drawn_than_the_best_of_every_row_need(rng):
    pictures = rng.integers(0, 256, (40, 12, 12, 2)).astype(np.uint8)
    postures = np.tile([0.5, *[0.0] * 5, *[0.25] * 4], (40, 1))
    seen = VisibleDistance(pictures, postures, 3.0)
    far = np.sort(rng.uniform(1, 30, (8, 20)), axis=1)
    near = pd.DataFrame({"row": np.repeat(np.arange(8), 20), "to": rng.integers(0, 40, 160)})
    near = near.assign(mirrored=rng.random(160) < 0.5, far=far.ravel())
    every = seen(near["row"], near["to"], near["mirrored"])
    some = seen.measure_best(near, COUNT)
    drawn = np.isfinite(some)
    assert some[drawn] == pytest.approx(every[drawn])
    assert 8 * COUNT <= drawn.sum() < 160
    assert choose_best_jumps(near, some, COUNT).equals(choose_best_jumps(near, every, COUNT))


def test_the_unit_is_the_natural_step_and_weights_take_parts_out(rng):
    n = 200
    sides = np.stack([walk(rng, n)[0]] * 2)
    noise = rng.normal(0, 100, (2, n, 4))
    made = SignatureParts(sides, sides, sides, noise)
    ends = np.arange(n - 1), np.arange(1, n)
    p = settings("jumps", appearance_weight=0.0)
    values = compute_signatures(made, ends, p)
    assert np.median(np.linalg.norm(np.diff(values[0], axis=0), axis=1)) == pytest.approx(1)
    for other in (made._replace(look=7 * noise), made._replace(pose=9 * sides)):
        assert compute_signatures(other, ends, p) == pytest.approx(values)


def test_sides_that_are_alike_are_near_and_others_far(rng):
    class Pictures:
        def __init__(self, patch: float) -> None:
            self.patch = patch

        def __call__(self, rows):
            one = np.zeros((len(rows), 16, 16, 2), np.float32)
            one[:, 4:12, 2:14] = 0.5
            one[:, 4:8, 4:8] += self.patch
            return one + rng.normal(0, 0.02, one.shape).astype(np.float32)

    track = np.zeros(100, int)
    assert measure_side_difference(Pictures(0.0), track) == pytest.approx(1, abs=0.1)
    assert measure_side_difference(Pictures(0.3), track) > 3


@pytest.mark.parametrize(("rates", "least", "most"), [
    ((3.0, -3.0) * 20, 0.0, 0.0), ((5.0, 5.0), 0.9, 1.0),
    ((5.0, 5.0, 5.0, -5.0) * 20, 0.2, 0.5),
    # So few circles are chance, whichever way round.
    ((5.0, 5.0, 5.0, -5.0), 0.0, 0.0), ((5.0,), 0.0, 0.0),
])  # fmt: skip
def test_who_turns_one_way_more_often_is_handed(rng, rates, least, most):
    turning = np.repeat(rates, 100) * rng.uniform(0.9, 1.1, 100 * len(rates))
    motion = np.column_stack([np.ones_like(turning), 0 * turning, turning])
    pose = rng.normal(0, 1, (len(turning), 2)) * (1, 0.1)
    made = SignatureParts(
        np.stack([pose, pose * (-1, 1)]), None, np.stack([motion, motion * (1, -1, -1)]), None
    )
    assert least <= measure_handedness(made, 100) <= most


def both_sides():
    """A film of two circles and a line, which can go on anywhere as its mirror image."""
    table = table_of(*(arc_track([rate] * 149) for rate in (0.0, 3.0, -5.0)))
    n, rows = len(table), np.arange(10, 440, 10)
    ends = {"row": rows, "to": (rows + 37) % 430}
    jumps = pd.DataFrame({**ends, "mirrored": rows % 20 == 0, "seam": 0.5})
    ways = index_jumps(jumps, n)
    motion = film_world_of().motion
    return (table, jumps, motion_graph(table, ways, motion, BODY, np.zeros(n, bool), np.zeros(n)))


def test_a_mirror_image_jumps_as_its_row_does_to_the_other_side():
    """But none to where the film ends: a fish could not go on from there."""
    table, jumps, made = both_sides()
    n, kept = len(table), 0
    assert made.filmed_count == n and len(made.rows) == 2 * n
    for row, to, across in zip(jumps["row"], jumps["to"], jumps["mirrored"], strict=True):
        for side in (0, 1):
            k = made.jump_slot[row + side * n]
            there = np.array([to + n * (side ^ int(across))])
            there = there[made.can_play_on(there)]
            assert made.to[made.start[k] : made.start[k + 1]].tolist() == there.tolist()
            kept += len(there)
    assert 0.9 * 2 * len(jumps) < kept < 2 * len(jumps)


def test_without_mirror_images_the_film_is_no_longer():
    table, jumps, _ = both_sides()
    ways = index_jumps(jumps.assign(mirrored=False), len(table))
    assert len(ways.jump_slot) == len(table)
    none = np.zeros(len(table))
    made = motion_graph(table, ways, film_world_of().motion, BODY, none.astype(bool), none)
    assert made.filmed_count == len(made.rows)


def test_a_mirror_image_swims_the_mirrored_way_and_is_drawn_mirrored_about_its_heading():
    table, _, made = both_sides()
    n, rows = len(table), np.arange(200, 260)
    for name, sign in (("dx", 1), ("dy", -1), ("heading", -1), ("speed", 1), ("area", 1)):
        assert getattr(made, name)[rows + n] == pytest.approx(sign * getattr(made, name)[rows])
    rotation_deg = np.full(len(rows), 25.0)
    shown = resolve_mirror_images(
        np.ones(len(rows), bool), rows + n, rotation_deg, made.heading[:n]
    )
    assert shown.mirrored.all() and shown.number.tolist() == rows.tolist()
    drawn = table["heading_deg"].to_numpy()[rows] + shown.rotation_deg
    assert wrap_deg(drawn - (made.heading[rows + n] + rotation_deg)) == pytest.approx(0, abs=1e-9)


def test_who_wanders_takes_the_film_as_it_comes(rng):
    planner = matching_of(film_world_of(choice_noise=5e-6, wander="film"))
    state = planner.begin(rng)
    stretch, _ = planner.plan(state, None, rng)
    value = stretch.options.costs[stretch.options.taken] * planner.world.motion.rate_hz
    assert value >= planner.world.to_ticks(planner.world.settings.look_ahead_deltas)
    assert not stretch.touches_goal
    to_come = stretch.options.terms[:, TERMS.index("to_come")]
    assert (to_come == 0).all()
