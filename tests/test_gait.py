"""The model of a gait: its clock, its four keys, its cycle; gaits as files."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.gait.coarse import few_point_contours
from finloop.gait.model import (
    Descriptor,
    Gait,
    HalfCycleLayout,
    contours_at_phases,
    four_key_frames,
    gait_to_record,
    interpolate_contours,
    locate_in_subcycle,
    mirror_contours,
    opposite_limb,
    reversed_order,
    start_share,
)
from finloop.gait.tool import load_gait
from finloop.io.record import save_json

DESCRIPTOR = Descriptor("db4", 4)
LIMBS = ("fore_left", "fore_right", "hind_left", "hind_right", "body")
ONE, TWO = (
    dict(zip(LIMBS, np.random.default_rng(seed).normal(size=(len(LIMBS), 32, 2)), strict=True))
    for seed in (5, 6)
)
GAMMA = {
    "*": {"A": (0.5,), "B": (-0.5,)},
    "fore_left": {"A": (-0.9, 0.3, 0.1), "B": (1.0,)},
    "fore_right": {"A": (0.0,), "B": (0.2,)},
}
WALK = Gait("walk", "swap", 1.5, GAMMA, wavelet="db4")
SWIM = Gait("swim", "mirror", 4.0, GAMMA, split=0.2, wavelet="db4")
THREE, FOUR = (
    dict(zip(LIMBS, np.random.default_rng(seed).normal(size=(len(LIMBS), 32, 2)), strict=True))
    for seed in (7, 8)
)
ALL_FOUR = {
    "*": {"A": (0.5,), "B": (-0.5,), "C": (0.0,), "D": (1.0,)},
    "fore_left": {"A": (-0.9, 0.3, 0.1), "B": (1.0,), "C": (0.2,), "D": (-0.4, 0.4)},
}
GALLOP = Gait("gallop", "none", 2.0, ALL_FOUR, split=0.3, wavelet="db4", confidence=None)
GALLOP_KEYS = ONE, TWO, THREE, FOUR


@pytest.mark.parametrize("gamma", [-1.0, -0.4, 0.0, 0.8, 1.0])
def test_clock_goes_from_one_to_zero_and_bends_by_gamma(gamma):
    tau = np.linspace(0, 1, 101)
    f = start_share(tau, gamma)
    assert (f[0], f[-1]) == (1, 0)
    assert (np.diff(f) <= 1e-15).all()
    np.testing.assert_allclose(f - (1 - tau), -gamma * tau * (1 - tau), atol=1e-15)
    np.testing.assert_allclose(np.diff(f, 2) / 0.01**2, 2 * gamma, atol=1e-9)


def test_partner_is_the_other_side_if_it_is_there():
    assert opposite_limb("fore_left", LIMBS) == "fore_right"
    assert opposite_limb("fore_left", ["fore_left"]) == "fore_left"
    assert opposite_limb("body", LIMBS) == "body"
    for name in LIMBS:
        assert opposite_limb(opposite_limb(name, LIMBS), LIMBS) == name


def test_a_mirror_keeps_the_direction_and_twice_is_the_identity():
    points = np.random.default_rng(7).normal(size=(3, 16, 2))
    order = reversed_order(16, 3)
    flipped = mirror_contours(points, 2.0, order)
    np.testing.assert_allclose(mirror_contours(flipped, 2.0, order), points, atol=1e-15)
    x, y = points[0].T
    u, v = flipped[0].T
    area = [a @ np.roll(b, -1) - b @ np.roll(a, -1) for a, b in ((x, y), (u, v))]
    assert area[0] == pytest.approx(area[1])
    np.testing.assert_allclose(
        mirror_contours(points)[:, 0], points[:, 0] * [1, -1]
    )  # the snout stays


@pytest.mark.parametrize("gait", [WALK, SWIM], ids=lambda gait: gait.name)
def test_the_cycle_goes_through_its_keys_and_its_second_half_repeats_the_first(gait):
    keys = four_key_frames((ONE, TWO), gait.symmetry)
    frames = contours_at_phases(
        (ONE, TWO), gait, np.array([0, gait.split, 0.5, 0.5 + gait.split, 1])
    )
    for name in LIMBS:
        for k in range(5):
            np.testing.assert_allclose(frames[name][k], keys[k % 4][name], atol=1e-12)
    whole = contours_at_phases((ONE, TWO), gait, np.arange(20) / 20)
    for name in LIMBS:
        other = whole[opposite_limb(name, LIMBS)][:10]
        expected = other if gait.symmetry == "swap" else mirror_contours(other)
        np.testing.assert_allclose(whole[name][10:], expected, atol=1e-12)
    # Across every key, the end of the cycle among them, steps are as small as the time step.
    ends = np.array([0.0, gait.split, 0.5, 0.5 + gait.split, 1.0])
    for frames in contours_at_phases((ONE, TWO), gait, np.r_[ends - 1e-7, ends + 1e-7]).values():
        assert np.abs(frames[:5] - frames[5:]).max() < 1e-4


def test_without_symmetry_the_cycle_goes_through_four_given_keys_each_with_its_gamma():
    ends = np.array([0, 0.3, 0.5, 0.8, 1])
    frames = contours_at_phases(GALLOP_KEYS, GALLOP, ends)
    middle = contours_at_phases(GALLOP_KEYS, GALLOP, (ends[1:] + ends[:-1]) / 2)
    for name in LIMBS:
        for k in range(5):
            np.testing.assert_allclose(frames[name][k], GALLOP_KEYS[k % 4][name], atol=1e-12)
        for k, letter in enumerate("ABCD"):
            pair = GALLOP_KEYS[k][name], GALLOP_KEYS[(k + 1) % 4][name]
            gamma = GALLOP.contour_gamma(name, letter)
            half = interpolate_contours(*pair, np.array([0.5]), gamma, GALLOP.descriptor)
            np.testing.assert_allclose(middle[name][k], half[0], atol=1e-12)


@pytest.mark.parametrize(("gait", "count"), [(GALLOP, 2), (GALLOP, 3), (WALK, 4), (SWIM, 1)])
def test_other_numbers_of_keys_than_the_symmetry_has_are_refused(gait, count):
    with pytest.raises(FinloopError, match=f"{count} key poses for a gait of symmetry"):
        contours_at_phases(GALLOP_KEYS[:count], gait, np.arange(4) / 4)


def test_keys_without_symmetry_need_the_same_ids_but_no_pairs():
    one = {**ONE, "fore_left": np.zeros((16, 2))}
    keys = [{**key, "fore_left": np.zeros((16, 2))} for key in GALLOP_KEYS]
    assert len(four_key_frames(keys, "none")) == 4
    with pytest.raises(FinloopError, match="'fore_left' has 16 points in key 1, 32 in 1'"):
        four_key_frames((one, keys[1], THREE, keys[3]), "none")


def test_gamma_bends_between_the_keys_and_each_scale_by_its_own():
    source, to = ONE["body"], TWO["body"]
    tau = np.array([0.25, 0.5])
    one = interpolate_contours(source, to, tau, (0.7,), DESCRIPTOR)
    np.testing.assert_allclose(one, to + start_share(tau, 0.7)[:, None, None] * (source - to))
    twice = interpolate_contours(source, to, tau, (0.7, 0.7), DESCRIPTOR)
    np.testing.assert_allclose(twice, one, atol=1e-12)
    gammas = (-0.5, 0.0, 0.9)
    moved = DESCRIPTOR.coefficients(interpolate_contours(source, to, tau, gammas, DESCRIPTOR) - to)
    way = DESCRIPTOR.coefficients(source - to)
    for m, where in enumerate(DESCRIPTOR.scales(32)):
        f = start_share(tau, gammas[min(m, 2)])  # scales beyond those named go by the last
        np.testing.assert_allclose(moved[:, where], f[:, None, None] * way[where], atol=1e-12)


def test_few_control_points_make_smoother_contours_and_all_change_nothing():
    cycle = partial(contours_at_phases, (ONE, TWO), WALK, np.arange(8) / 8)
    full, every, few = (cycle(control=control)["body"] for control in (None, 32, 4))
    np.testing.assert_allclose(every, full, atol=1e-12)
    assert np.abs(DESCRIPTOR.coefficients(few)[:, 4:]).max() < 1e-12
    np.testing.assert_allclose(few.mean(axis=1), full.mean(axis=1), atol=1e-12)
    open_ones = cycle(control=4, closed={"body": False})["body"]
    assert np.abs(open_ones[:, 0] - open_ones[:, -1]).max() > 0.1  # its ends do not meet


@pytest.mark.parametrize("gait", [WALK, SWIM, GALLOP])
def test_few_control_points_alone_move_as_among_all(gait):
    """Fig. 14 solved at its own number of points: every coefficient has a clock of its own."""
    phases, keys = np.arange(12) / 12, GALLOP_KEYS if gait is GALLOP else (ONE, TWO)
    for control in (4, 8, 32):
        alone = few_point_contours(keys, gait, phases, HalfCycleLayout(), control)
        among = contours_at_phases(keys, gait, phases, control=control)
        for name in ONE:
            np.testing.assert_allclose(alone[name], among[name], atol=1e-12)


def test_subcycles():
    which, tau = locate_in_subcycle(np.array([0.0, 0.1, 0.2, 0.5, 0.95, 1.25, -0.4]), 0.2)
    assert which.tolist() == [0, 0, 1, 2, 3, 1, 2]
    np.testing.assert_allclose(tau, [0, 0.5, 0, 0, 5 / 6, 1 / 6, 0.5], atol=1e-12)


def test_offsets_keep_a_limb_at_its_hip():
    hips = {"fore_left": np.array([3.0, -1.0]), "fore_right": np.array([-3.0, 1.0])}
    later = four_key_frames((ONE, TWO), "swap", HalfCycleLayout(offsets=hips))[2]
    np.testing.assert_allclose(later["fore_left"], ONE["fore_right"] + [3, -1])
    moved = HalfCycleLayout(offsets=dict.fromkeys(hips, np.ones(2)))
    with pytest.raises(FinloopError, match="'fore_left' is not what it was"):
        four_key_frames((ONE, TWO), "swap", moved)
    rolled = HalfCycleLayout(orders={"body": np.roll(np.arange(32), 1)})
    with pytest.raises(FinloopError, match="two half cycles later"):
        four_key_frames((ONE, TWO), "mirror", rolled)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one, two: two.pop("body"), "'body' only in key 1"),
        (lambda one, two: one.pop("body"), "'body' only in key 2"),
        (lambda one, two: two.update(body=np.zeros((8, 2))), "32 points in key 1, 8 in 2"),
        (
            lambda one, two: [key.update(fore_left=np.zeros((16, 2))) for key in (one, two)],
            "'fore_right' 32",
        ),
        (lambda one, two: (one.clear(), two.clear()), "no contours"),
    ],
)
def test_keys_that_do_not_belong_together_are_refused(change, said):
    one, two = dict(ONE), dict(TWO)
    change(one, two)
    with pytest.raises(FinloopError, match=said):
        four_key_frames((one, two), "swap")


def test_numbers_out_of_range_are_refused():
    for said, gait, control in (
        (r"split of 0\.6", replace(WALK, split=0.6), None),
        ("'turn'", replace(WALK, symmetry="turn"), None),
        ("64 control points", WALK, 64),
    ):
        with pytest.raises(FinloopError, match=said):
            contours_at_phases((ONE, TWO), gait, np.arange(8) / 8, control=control)


def test_gamma_of_coefficients_fits_the_number_of_points_that_it_was_fitted_to():
    gammas = tuple((value,) for value in np.linspace(-1, 1, 32).tolist())
    gait = replace(WALK, gamma={"*": {"A": gammas, "B": gammas}})
    whole = contours_at_phases((ONE, TWO), gait, np.array([0.1]))["body"]
    way = DESCRIPTOR.coefficients(ONE["body"] - TWO["body"])
    shares = start_share(np.array(0.4), np.array(gammas))
    np.testing.assert_allclose(DESCRIPTOR.coefficients(whole[0] - TWO["body"]), shares * way)
    half = [{name: points[::2] for name, points in key.items()} for key in (ONE, TWO)]
    with pytest.raises(FinloopError, match="γ for 32 coefficients, and contours with 16"):
        contours_at_phases(half, gait, np.array([0.1]))


@pytest.mark.parametrize("shape", [(1,), (6,), (64, 1), (64, 2)])
def test_a_gait_of_any_sharing_comes_back_from_its_file(tmp_path, shape):
    values = np.random.default_rng(1).normal(size=shape).round(6).tolist()
    gammas = tuple(tuple(row) if isinstance(row, list) else row for row in values)
    both = {"outline": {"A": gammas, "B": gammas}}
    gait = Gait("own", "mirror", 2.0, both | {"*": {"A": (0.0,), "B": (0.5,)}}, motion=both)
    save_json(tmp_path / "own.json", gait_to_record(gait))
    assert load_gait(tmp_path / "own.json") == gait


@pytest.mark.parametrize(
    "spans", [((0.0, 0.25), (0.5, 1.0)), ((0.5, 1.0), (0.0, 0.5)), ((0.3, 1.3),)]
)
def test_a_gait_comes_back_from_its_file(tmp_path, spans):
    gait = replace(
        WALK, support={"fore_left": spans}, source="a film", confidence=0.9, cycles=3.0,
        frames=72, residuals={"linear": 0.02, "gamma": 0.01},
    )  # fmt: skip
    path = tmp_path / "walk.json"
    save_json(path, gait_to_record(gait))
    assert load_gait(path) == gait
    before = path.read_bytes()
    save_json(path, gait_to_record(load_gait(path)))
    assert path.read_bytes() == before
    with pytest.raises(FinloopError, match="frequency_hz"):
        save_json(path, gait_to_record(replace(gait, frequency_hz=float("nan"))))
    assert path.read_bytes() == before


def test_a_gait_without_symmetry_comes_back_from_its_file(tmp_path):
    save_json(tmp_path / "gallop.json", gait_to_record(GALLOP))
    assert load_gait(tmp_path / "gallop.json") == GALLOP


def test_the_least_that_a_person_must_write(tmp_path):
    path = tmp_path / "own.json"
    path.write_text(
        '{"name": "own", "symmetry": "mirror", "frequency_hz": 2, "gamma": {"*": {"A": [0], "B": [0.5]}}}'
    )
    assert load_gait(path) == Gait("own", "mirror", 2, {"*": {"A": (0.0,), "B": (0.5,)}})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"speed": 1}, "gait.speed: unknown"),
        ({"symmetry": "turn"}, "gait.symmetry: should be 'swap', 'mirror' or 'none'"),
        ({"split": 0.5}, "gait.split: should be less than 0.5"),
        ({"coarse": 3}, "no power of two"),
        ({"gamma": {}}, "gait.gamma: .* at least 1 item"),
        ({"gamma": {"*": {"A": [0]}}}, r"gait.gamma.\*: .* at least 2 items"),
        ({"gamma": {"*": {"A": [0], "B": ["x"]}}}, r"gait.gamma.\*.B.scales.0: .* a valid number"),
        ({"gamma": {"*": {"A": [0], "B": [[0], [1, 2]]}}}, "coefficients: one γ for some"),
        ({"gamma": {"*": {"A": [0], "B": [[0], [1], [2]]}}}, "coefficients: no power of two"),
        ({"gamma": {"*": {"A": [0], "B": [[0, 1, 2]]}}}, r"B.coefficients.0: .* at most 2 items"),
        ({"motion": {"*": {"A": [1], "B": [1, 1]}}}, r"motion.\*.B has not one number for each γ"),
        ({"gamma": {"*": {"A": [0], "B": [float("inf")]}}}, "finite number"),
        ({"support": {"fore_left": [[0.5, 0.2]]}}, "gait.support.fore_left: no list"),
        ({"gamma": {"*": {"A": [0], "B": [1e300]}}}, "less than or equal to 1000"),
        ({"frequency_hz": 10**400}, "gait.frequency_hz"),
        ({"support": {"fore_left": [[0.6, 0.8], [0.9, 1.7]]}}, "overlap"),
        ({"gamma": ALL_FOUR}, r"gamma.\* is for A, B, C, D, but a gait of symmetry swap has A, B"),
        ({"symmetry": "none"}, r"gamma.\* is for A, B, but a gait of symmetry none has A, B, C, D"),
        ({"gamma": {"*": {"A": [0], "E": [0]}}}, r"gamma.\*.E"),
        ({"colour": "red", "name": None}, "gait.name: should .*, got None; gait.colour: unknown"),
    ],
)
def test_a_file_that_is_no_gait_is_refused_by_name(tmp_path, change, said):
    path = tmp_path / "walk.json"
    save_json(path, gait_to_record(WALK))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(FinloopError, match=said):
        load_gait(path)


@pytest.mark.parametrize("text", [None, "", "{", "[1, 2]", "3", "[" * 100_000])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, text):
    path = tmp_path / "walk.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(FinloopError, match=r"walk\.json"):
        load_gait(path)
