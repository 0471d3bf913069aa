"""γ from contours: films made by the model give back what made them."""

from dataclasses import replace

import numpy as np
import pytest

from finloop.base.errors import FinloopError
from finloop.drawn.dog.walk import DogFilm, frame_phases, true_limb_contours
from finloop.gait.compare import (
    choose_held_out_frames,
    compare_clocks,
    describe_doubtful_fit,
)
from finloop.gait.cycles import align_phase, align_phase_without_symmetry, foot_positions
from finloop.gait.fit import (
    GaitContours,
    Subcycle,
    SubcycleFrames,
    fit_gait,
    interpolate_key_frames,
)
from finloop.gait.model import (
    SHARINGS,
    Descriptor,
    Gait,
    HalfCycleLayout,
    contours_at_phases,
    gait_to_record,
    gamma_fraction,
    gamma_from_fractions,
    mirror_contours,
    start_share,
)

LIMBS = ("fore_left", "fore_right", "hind_left", "hind_right")
TRUE = {
    "fore_left": {"A": (0.1,), "B": (-0.8,)},
    "fore_right": {"A": (0.6,), "B": (0.3,)},
    "hind_left": {"A": (-0.2,), "B": (0.9,)},
    "hind_right": {"A": (0.0,), "B": (-0.5,)},
}
N = 32


def _blob(angle: float, seed: int) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, N, endpoint=False)
    rng = np.random.default_rng(seed)
    radius = 1 + 0.1 * sum(rng.normal() * np.cos(k * t + rng.normal()) for k in (2, 3, 5))
    points = np.column_stack([radius * np.cos(t) * 0.3, radius * np.sin(t) + 1])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return points @ turn


def _blobs(*angles):
    return {name: _blob(a, k) for k, (name, a) in enumerate(zip(LIMBS, angles, strict=True))}


ONE, TWO = _blobs(0.5, -0.5, -0.4, 0.4), _blobs(0.1, 0.05, -0.1, 0.0)


def _film(phases, gamma=TRUE, split=0.25, symmetry="swap", offsets=None, one=ONE, two=TWO):
    gait = Gait("x", symmetry, 1.0, gamma, split=split, wavelet="db4")
    frames = contours_at_phases((one, two), gait, phases, HalfCycleLayout(offsets=offsets))
    return GaitContours(frames, phases, 2.0, symmetry, offsets=offsets)


@pytest.mark.parametrize("gamma", [-1.0, -0.3, 0.0, 0.7, 1.0, 2.5])
def test_closed_form_finds_what_made_the_frames_and_is_a_minimum(gamma):
    rng = np.random.default_rng(6)
    source, to = rng.normal(size=(2, 9))
    tau = rng.uniform(size=12)
    frames = to + start_share(tau, gamma)[:, None] * (source - to)
    found = gamma_from_fractions([gamma_fraction(tau, frames, source, to)])
    assert found == pytest.approx(gamma, abs=1e-12)
    noisy = frames + 0.1 * rng.normal(size=frames.shape)
    best = gamma_from_fractions([gamma_fraction(tau, noisy, source, to)])
    error = [
        float(((noisy - to - start_share(tau, g)[:, None] * (source - to)) ** 2).sum())
        for g in (best - 1e-3, best, best + 1e-3)
    ]
    assert error[1] < min(error[0], error[2])


def test_no_motion_and_no_frames_have_no_gamma():
    still, none = np.ones(4), (np.array([]), np.empty((0, 4)))
    assert gamma_from_fractions([gamma_fraction(np.array([0.5]), still[None], still, still)]) == 0
    assert gamma_from_fractions([gamma_fraction(*none, still, 2 * still)]) == 0


@pytest.mark.parametrize("start", [0.0, 0.125, 0.75])
def test_limbs_of_a_synthesized_walk_give_back_gamma_and_keys(start):
    gait, keys = fit_gait(_film(start + np.arange(16) / 16), "walk", 1.5, wavelet="db4")
    for name in LIMBS:
        for letter in "AB":
            assert gait.gamma[name][letter] == pytest.approx(TRUE[name][letter], abs=1e-9)
        np.testing.assert_allclose(keys[0][name], ONE[name], atol=1e-12)
        np.testing.assert_allclose(keys[1][name], TWO[name], atol=1e-12)
    assert (gait.frequency_hz, gait.frames) == (1.5, 16)
    assert gait.cycles == pytest.approx(1)


def test_keys_between_frames_allow_for_the_bend_of_the_way():
    """Straight lines from frame to frame would be off by the bend (and γ by a tenth and more)."""
    film = _film(np.arange(48) / 24 + 1 / 48)
    gait, keys = fit_gait(film, "x", 1.0, wavelet="db4")
    rough = interpolate_key_frames(film, 0.25)
    off = [
        sum(
            ((mine[name] - true[name]) ** 2).sum()
            for mine, true in ((found[0], ONE), (found[1], TWO))
            for name in LIMBS
        )
        for found in (keys, rough)
    ]
    assert off[0] < 0.1 * off[1]
    for name in LIMBS:
        assert gait.gamma[name]["B"] == pytest.approx(TRUE[name]["B"], abs=0.05)


SHAPES = {"limb": (1,), "scale": (4,), "coefficient": (N, 1), "coordinate": (N, 2)}


def _random_gammas(sharing: str) -> dict[str, dict[str, tuple]]:
    rng = np.random.default_rng(3)

    def draw() -> tuple:
        values = rng.uniform(-0.9, 0.9, SHAPES[sharing]).tolist()
        return tuple(tuple(row) if isinstance(row, list) else row for row in values)

    return {name: {"A": draw(), "B": draw()} for name in LIMBS}


def _noise_poses(seed: int) -> dict[str, np.ndarray]:
    """Contours whose coefficients all move, at all scales and in x and y."""
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=(N, 2)) for name in LIMBS}


ROUGH = {"one": _noise_poses(1), "two": _noise_poses(2)}


@pytest.mark.parametrize("sharing", SHARINGS)
def test_gamma_of_whatever_shares_one_comes_back_and_predicts_what_a_shared_clock_cannot(sharing):
    gammas = _random_gammas(sharing)
    film = _film(np.arange(48) / 16, gammas, **ROUGH)
    gait, keys = fit_gait(film, "x", 1.0, wavelet="db4", sharing=sharing)
    for name in LIMBS:
        for letter in "AB":
            found = np.array(gait.gamma[name][letter])
            np.testing.assert_allclose(found, gammas[name][letter], atol=1e-9)
    cycle = contours_at_phases(keys, gait, film.phase)
    np.testing.assert_allclose(cycle["hind_left"], film.contours["hind_left"], atol=1e-9)
    rms = compare_clocks(film, wavelet="db4").rms
    finer = SHARINGS.index(sharing)
    assert all(rms[clock] < 1e-9 for clock in SHARINGS[finer:])
    assert all(rms[clock] > 0.02 for clock in ("linear", *SHARINGS[:finer]))
    assert (rms["free"] < 1e-9) == (sharing == "limb")  # no bound for clocks that differ


def test_each_finer_gamma_fits_the_frames_better_and_its_mean_by_energy_is_that_of_the_limb():
    film = _film(np.arange(48) / 16, **ROUGH)
    rng = np.random.default_rng(4)
    noisy = replace(
        film, contours={k: v + rng.normal(size=v.shape) for k, v in film.contours.items()}
    )
    gaits, errors = {}, []
    for sharing in SHARINGS:
        gaits[sharing], keys = fit_gait(noisy, "x", 1.0, wavelet="db4", sharing=sharing)
        cycle = contours_at_phases(keys, gaits[sharing], film.phase)
        errors.append(sum(float(((cycle[k] - noisy.contours[k]) ** 2).sum()) for k in LIMBS))
    assert (np.diff(errors) < 0).all()
    for gait in gaits.values():
        for name in LIMBS:
            limb = gaits["limb"].gamma[name]["A"][0]
            assert gait.limb_gamma(name, "A") == pytest.approx(limb, abs=1e-9)


def test_what_hardly_moves_has_the_gamma_of_its_parent():
    """Of 8 coefficients, 2 of the coarsest scale move, one only in x; the second scale is still."""
    start, gamma = np.zeros((8, 2)), np.array([0.8, -0.4])
    start[0], start[1], start[2] = (3, 2), (1, 0), (1e-4, 0)
    tau = np.array([0.2, 0.5, 0.9])
    frames = np.zeros((3, 8, 2))
    frames[:, :2] = start_share(tau[:, None, None], gamma[:, None]) * start[:2]
    frames[:, 2:] = np.random.default_rng(5).normal(size=(3, 6, 2)) * 1e-3
    scales = [slice(0, 4), slice(4, 8)]
    subcycle = Subcycle(SubcycleFrames(tau, frames), start, np.zeros((8, 2)), scales)
    limb = (13 * 0.8 - 0.4) / 14
    assert subcycle.fit_gammas("limb", 1e-3) == pytest.approx([limb], abs=1e-6)
    scale = subcycle.fit_gammas("scale", 1e-3)
    assert scale == pytest.approx([limb, limb], abs=1e-6)
    coefficient = subcycle.fit_gammas("coefficient", 1e-3)
    assert coefficient[:, 0] == pytest.approx([0.8, -0.4, *[limb] * 6], abs=1e-6)
    coordinate = subcycle.fit_gammas("coordinate", 1e-3)
    assert coordinate == pytest.approx(np.repeat(coefficient, 2, axis=1), abs=1e-6)
    assert (
        np.abs(subcycle.fit_gammas("coefficient", 0.0)[2]) > 5
    )  # noise, divided by hardly anything
    still = Subcycle(subcycle.samples, start, start, scales)
    assert not still.fit_gammas("coordinate", 1e-3).any()


def test_coordinates_that_turn_back_are_named():
    gammas = _random_gammas("coordinate")
    rows = np.array(gammas["hind_left"]["B"])
    rows[2, 1], rows[30, 0] = 4.0, -6.0
    gammas["hind_left"]["B"] = tuple(map(tuple, rows.tolist()))
    film = _film(np.arange(48) / 16, gammas, **ROUGH)
    table = compare_clocks(film, wavelet="db4").not_monotone
    assert set(table["contour"] + table["subcycle"]) == {"hind_leftB"}
    found = table.set_index(["coefficient", "coordinate"])["gamma"].to_dict()
    assert found == pytest.approx({(3, "y"): 4.0, (31, "x"): -6.0}, abs=1e-6)
    assert (table["left_pct"] < 1e-6).all() and table["beyond_key_pct"].is_monotonic_decreasing
    # y of coefficient 3 passes its key by f = −(4 − 1)² / (4 · 4) of its way.
    coefficients = [
        Descriptor("db4").coefficients(pose["hind_left"])[2, 1] for pose in ROUGH.values()
    ]
    one, two = ROUGH["one"]["hind_right"], coefficients[1]  # B goes from key 2 to 1', by symmetry
    way = abs(two - Descriptor("db4").coefficients(one)[2, 1])
    beyond = table.set_index("coefficient")["beyond_key_pct"][3]
    assert beyond == pytest.approx(100 * 9 / 16 * way / np.sqrt(N) / film.body_length)
    assert compare_clocks(_film(np.arange(48) / 16), wavelet="db4").not_monotone.empty


def test_half_a_cycle_is_enough_and_less_is_refused():
    """Limbs of one side in the first half are those of the other in the second."""
    gait, _ = fit_gait(_film(np.arange(9) / 16), "x", 1.0, wavelet="db4")
    for name in LIMBS:
        assert gait.gamma[name]["B"] == pytest.approx(TRUE[name]["B"], abs=1e-9)
    with pytest.raises(FinloopError, match="half a cycle"):
        fit_gait(_film(np.arange(6) / 16), "x", 1.0)
    with pytest.raises(FinloopError, match="does not always rise"):
        fit_gait(_film(np.array([0.0, 0.4, 0.3, 0.9])), "x", 1.0)


def test_far_limbs_that_hang_elsewhere_keep_their_hips():
    offsets = {"fore_left": np.array([0.2, 0.1]), "fore_right": np.array([-0.2, -0.1])}
    gait, keys = fit_gait(_film(np.arange(16) / 16, offsets=offsets), "x", 1.0, wavelet="db4")
    assert gait.gamma["fore_left"]["B"] == pytest.approx((-0.8,), abs=1e-9)
    np.testing.assert_allclose(keys[0]["fore_right"], ONE["fore_right"], atol=1e-12)


# --- without symmetry

GALLOP = {
    name: {letter: (round(g, 2),) for letter, g in zip("ABCD", row, strict=True)}
    for name, row in zip(LIMBS, np.random.default_rng(8).uniform(-0.9, 0.9, (4, 4)), strict=True)
}
GALLOP_KEYS = [
    _blobs(0.6, 0.2, -0.5, -0.3), _blobs(-0.1, 0.5, -0.6, -0.6),
    _blobs(-0.7, -0.4, 0.3, 0.0), _blobs(0.2, -0.6, 0.5, 0.4),
]  # fmt: skip


def _gallop(phases, gamma=GALLOP, keys=GALLOP_KEYS):
    gait = Gait("x", "none", 1.0, gamma, wavelet="db4")
    return GaitContours(contours_at_phases(keys, gait, phases), phases, 2.0, "none")


@pytest.mark.parametrize("sharing", SHARINGS)
def test_one_cycle_of_a_gallop_gives_back_gamma_of_four_subcycles_and_four_keys(sharing):
    """The film wraps: its frames begin anywhere in the cycle."""
    rng = np.random.default_rng(3)

    def draw() -> tuple:
        values = rng.uniform(-0.9, 0.9, SHAPES[sharing]).tolist()
        return tuple(tuple(row) if isinstance(row, list) else row for row in values)

    gamma = {name: {letter: draw() for letter in "ABCD"} for name in LIMBS}
    made = [_noise_poses(seed) for seed in (1, 2, 3, 4)]
    film = _gallop(0.3125 + np.arange(16) / 16, gamma, made)
    gait, keys = fit_gait(film, "x", 2.0, wavelet="db4", sharing=sharing)
    assert (gait.symmetry, gait.cycles, len(keys)) == ("none", pytest.approx(1), 4)
    for name in LIMBS:
        for letter in "ABCD":
            found = np.array(gait.gamma[name][letter])
            np.testing.assert_allclose(found, gamma[name][letter], atol=1e-9)
        for key, true in zip(keys, made, strict=True):
            np.testing.assert_allclose(key[name], true[name], atol=1e-12)
    whole = contours_at_phases(keys, gait, film.phase)
    np.testing.assert_allclose(whole["hind_left"], film.contours["hind_left"], atol=1e-9)


def test_keys_between_the_frames_of_one_cycle_are_found_by_both_neighbours():
    phases = np.arange(24) / 24 + 0.013
    gait, keys = fit_gait(_gallop(phases), "x", 1.0, wavelet="db4")
    for key, true in zip(keys, GALLOP_KEYS, strict=True):
        for name in LIMBS:
            np.testing.assert_allclose(key[name], true[name], atol=0.01)
    assert gait.gamma["fore_left"]["B"] == pytest.approx(GALLOP["fore_left"]["B"], abs=0.2)


def test_a_hidden_frame_beside_a_key_does_not_shift_it():
    """The limb goes straight through key 1, from 2' to 2: frames before and after it agree."""
    _, two, later, two_later = GALLOP_KEYS
    first = {name: (two[name] + two_later[name]) / 2 for name in LIMBS}
    straight = dict.fromkeys(LIMBS, dict.fromkeys("ABCD", (0.0,)))
    film = _gallop(np.arange(24) / 24 + 0.013, straight, [first, two, later, two_later])
    film.contours["fore_left"][0] = np.nan
    found = interpolate_key_frames(film, 0.25)[0]["fore_left"]
    np.testing.assert_allclose(found, first["fore_left"], atol=1e-12)


def test_each_frame_of_one_cycle_is_held_out_by_itself():
    film = _gallop(np.arange(16) / 16 + 0.02)
    masks = choose_held_out_frames(film)
    assert len(masks) == 16 and (np.sum(masks, axis=0) == 1).all()
    found = compare_clocks(film, wavelet="db4")
    assert found.by_contour["frames"].sum() == 16 * len(LIMBS)
    assert set(found.by_contour["subcycle"]) == set("ABCD")
    assert found.rms["limb"] < 0.6 * found.rms["linear"]
    assert len(choose_held_out_frames(_gallop(np.arange(32) / 16))) == 2  # cycles


@pytest.mark.parametrize("late", [0.0, 0.1, 0.55, 0.8])
def test_keys_of_a_gallop_are_where_straight_lines_through_the_feet_join(late):
    """Of these keys, the first is the one with the feet farthest apart."""
    straight = dict.fromkeys(LIMBS, dict.fromkeys("ABCD", (0.0,)))
    true = np.arange(15) / 15 + late
    feet = foot_positions(_gallop(true, straight).contours)
    phase = align_phase_without_symmetry(np.arange(15) / 15, feet, 0.25)
    turn = true[0] - phase[0]  # from key 1 of the film to the found one
    np.testing.assert_allclose(true - phase, turn)
    assert abs(turn * 4 - round(turn * 4)) < 4 / 480
    at_keys = foot_positions(_gallop(turn + np.arange(4) / 4, straight).contours)
    assert np.ptp(at_keys, axis=1).argmax() == 0
    frames = np.arange(15)
    feet[frames, frames % 4] = np.nan  # no frame shows all feet
    hidden = align_phase_without_symmetry(frames / 15, feet, 0.25)
    np.testing.assert_allclose(hidden, phase, atol=2 / 240)


def test_a_gallop_needs_a_whole_cycle_and_takes_no_partner_for_a_hidden_limb():
    with pytest.raises(FinloopError, match="a whole cycle: no part of it follows"):
        fit_gait(_gallop(np.arange(12) / 16), "x", 1.0)
    film = _gallop(np.arange(16) / 16)
    del film.contours["fore_left"]
    assert film.add_hidden_limbs() is film


def test_a_lifted_foot_that_moves_back_is_not_on_the_ground():
    """A foot stands at phases 0.25 to 0.5; it moves back from 0 to 0.5, and comes down meanwhile."""
    phase = (np.arange(32) + 0.5) / 32
    x = np.where(phase < 0.5, -phase, phase - 1)
    y = np.where((phase > 0.25) & (phase < 0.5), 0.0, -0.3)
    places = np.column_stack([x, y])[:, None]
    film = GaitContours({"fore_left": _blob(0, 1) + places}, phase, 2.0, "none")
    ((start, end),) = fit_gait(film, "x", 1.0, wavelet="db4")[0].support["fore_left"]
    assert (start, end) == pytest.approx((0.25, 0.5), abs=1 / 64)


def test_gamma_of_all_contours_is_bounded_as_any_other():
    """Nearly the same in all keys, far away between them: γ would be a million."""
    phase = np.arange(32) / 32
    bow = np.abs(np.sin(4 * np.pi * phase)) + 1e-6 * np.cos(2 * np.pi * phase)
    limb = _blob(0, 1) + np.column_stack([bow, bow])[:, None]
    gait, _ = fit_gait(GaitContours({"fore_left": limb}, phase, 2.0, "none"), "x", 1.0)
    assert gait_to_record(gait)["gamma"]["*"] == {
        letter: [pytest.approx(0, abs=1000)] for letter in "ABCD"
    }


def test_a_wavelet_that_is_not_orthogonal_is_refused():
    with pytest.raises(FinloopError, match=r"bior4\.4 is not orthogonal"):
        fit_gait(_gallop(np.arange(16) / 16), "x", 1.0, wavelet="bior4.4")


def test_a_mirrored_cycle_and_another_split():
    one = {"outline": _blob(0.5, 9)}
    two = {"outline": _blob(0.2, 9)}
    gamma = {"outline": {"A": (-0.9,), "B": (0.4,)}}
    phases = np.arange(40) / 20
    film = _film(phases, gamma, 0.2, "mirror", one=one, two=two)
    outline = film.contours["outline"]
    np.testing.assert_allclose(outline[10], mirror_contours(outline[0]), atol=1e-12)
    gait, _ = fit_gait(film, "fish", 2.0, split=0.2, wavelet="db4")
    assert gait.gamma["outline"]["A"] == pytest.approx((-0.9,), abs=1e-9)
    assert gait.gamma["*"]["B"] == pytest.approx((0.4,), abs=1e-9)
    assert gait.support == {}


def test_keys_lie_between_the_frames_beside_and_over_cycles_are_their_mean():
    straight = {name: {"A": (0.0,), "B": (0.0,)} for name in LIMBS}
    film = _film(np.arange(32) / 16, straight)
    noise = np.random.default_rng(6).normal(size=film.contours["fore_left"].shape)
    fore = film.contours["fore_left"] + noise
    noisy = replace(film, contours={**film.contours, "fore_left": fore})
    later = {name: points[[8, 24]] for name, points in noisy.contours.items()}
    mean = (fore[[0, 16]].sum(0) + film.contours_half_cycle_later(later)["fore_left"].sum(0)) / 4
    np.testing.assert_allclose(interpolate_key_frames(noisy, 0.25)[0]["fore_left"], mean)
    between = _film((np.arange(4) - 0.5) / 4 + 0.25, straight)  # key 2 amid two frames
    expected = between.contours["fore_left"][:2].mean(axis=0)
    twin = _film(between.phase + 0.5, straight)
    other = twin.contours_half_cycle_later(twin.contours)["fore_left"][:2].mean(axis=0)
    np.testing.assert_allclose(expected, other, atol=1e-12)
    found = interpolate_key_frames(between, 0.25)[1]["fore_left"]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_limbs_missing_in_some_frames_are_fitted_from_the_others():
    film = _film(np.arange(32) / 16)
    for name, frames in (("fore_left", [2, 9, 20]), ("hind_right", [0, 5])):
        film.contours[name][frames] = np.nan
    gait, _ = fit_gait(film, "x", 1.0, wavelet="db4")
    for name in LIMBS:
        assert gait.gamma[name]["A"] == pytest.approx(TRUE[name]["A"], abs=1e-9)
    film.contours["fore_left"][:] = np.nan
    film.contours["fore_right"][:] = np.nan
    with pytest.raises(FinloopError, match="show 'fore_left' in A, 'fore_left' in B, 'fore_right'"):
        fit_gait(film, "x", 1.0)


def test_what_a_film_lacks_is_said():
    with pytest.raises(FinloopError, match="'fore_left' in A"):
        fit_gait(_film(np.arange(8) / 4), "x", 1.0)
    film = _film(np.arange(32) / 16)
    film.contours["hind_left"][[0, 1, 2, 14, 15, 16, 17, 18, 30, 31]] = np.nan
    film.contours["hind_right"][[6, 7, 8, 9, 10, 22, 23, 24, 25, 26]] = np.nan
    with pytest.raises(FinloopError, match="no frame shows 'hind_left' near key 1\n"):
        fit_gait(film, "x", 1.0)


def test_support_is_from_the_foremost_place_to_the_hindmost():
    """The limb of _blob hangs down and swings: foremost at a negative angle."""
    gait, keys = fit_gait(_film(np.arange(16) / 16), "x", 1.0)
    for ((start, stop),) in gait.support.values():
        assert 0 <= start < stop <= start + 1
    low = int(keys[0]["hind_left"][:, 1].argmax())
    frames = _film(np.array([gait.support["hind_left"][0][0], 0.3, 0.9])).contours["hind_left"]
    assert frames[0, low, 0] >= frames[1:, low, 0].max()


def test_clocks_on_frames_left_out_stand_in_their_order():
    quiet = compare_clocks(_film(np.arange(48) / 16), wavelet="db4")
    assert quiet.rms["linear"] > 0.01
    assert max(quiet.rms[clock] for clock in ("limb", "scale", "free")) < 1e-9
    other = compare_clocks(_film(np.arange(24) / 16), wavelet="db4")  # no left-out frame has a twin
    assert other.rms["limb"] < other.rms["free"] < other.rms["linear"]
    hind = quiet.by_scale.query("contour == 'hind_left' and subcycle == 'B'")
    assert hind["verdict"].iloc[0] == "buys" and hind["energy_share"].sum() == pytest.approx(1)
    straight = compare_clocks(_film(np.arange(48) / 16, {"*": {"A": (0.0,), "B": (0.0,)}}))
    assert set(straight.by_scale["verdict"]) == {"not seen"}


def test_noise_makes_gamma_buy_nothing_where_there_is_none():
    film = _film(np.arange(80) / 20, {"*": {"A": (0.0,), "B": (0.8,)}})
    rng = np.random.default_rng(6)
    noisy = {k: v + 0.02 * rng.normal(size=v.shape) for k, v in film.contours.items()}
    found = compare_clocks(replace(film, contours=noisy))
    limbs = found.by_contour.set_index(["contour", "subcycle"])
    for name in LIMBS:
        a, b = limbs.loc[(name, "A")], limbs.loc[(name, "B")]
        assert b["rms_limb"] < b["rms_linear"]
        assert a["rms_limb"] == pytest.approx(a["rms_linear"], rel=0.02)
    fine = found.by_scale.query("subcycle == 'A' and scale > 0")
    assert not (fine["gamma_buys_pct"] > 10).any()


def test_what_is_left_out():
    cycles = choose_held_out_frames(_film(np.arange(40) / 16))
    assert [int(mask.sum()) for mask in cycles] == [16, 16, 8]
    even, odd = choose_held_out_frames(_film(np.arange(24) / 16))  # every other frame
    assert (even ^ odd).all() and not (even[1:] & even[:-1]).any()
    one = compare_clocks(_film(np.arange(24) / 24), wavelet="db4")
    assert one.rms["limb"] < one.rms["linear"]


def test_the_keys_that_a_film_starts_from_do_not_matter():
    """Errors are lengths: a film twice as large has the same in body lengths, and the same γ."""
    film = _film(np.arange(16) / 16 + 0.03)
    contours = {name: 2 * points for name, points in film.contours.items()}
    large = replace(film, contours=contours, body_length=2 * film.body_length)
    for name, of in fit_gait(film, "x", 1.0)[0].gamma.items():
        assert of["A"] == pytest.approx(fit_gait(large, "x", 1.0)[0].gamma[name]["A"], rel=1e-9)
    assert compare_clocks(film).rms == pytest.approx(compare_clocks(large).rms, rel=1e-9)


@pytest.mark.parametrize("late", [-0.03, 0.0, 0.02])
def test_feet_tell_where_the_keys_are(late):
    """A period is off by a little in phase and frequency; where feet turn round sets it right."""
    dog = DogFilm(frames=50, cycles=2.7)
    limbs = true_limb_contours(dog, 32)
    limbs["fore_left"][7] = np.nan
    true = frame_phases(dog)
    found = align_phase(true * 1.003 + late, foot_positions(limbs), 0.25)
    np.testing.assert_allclose(found, true, atol=1e-3)
    np.testing.assert_array_equal(align_phase(true[:9], foot_positions(limbs)[:9], 0.25), true[:9])
    known = align_phase(true + late, foot_positions(limbs), 0.25, stretches=False)
    np.testing.assert_allclose(known - true, np.full(len(true), known[0] - true[0]))
    assert known[0] == pytest.approx(true[0], abs=1e-3)


def test_a_fit_that_explains_little_of_the_motion_is_said():
    walk = _film(np.arange(48) / 16)
    # Left limbs half a cycle early: left and right move together.
    bound = replace(walk, contours={
        name: np.roll(points, 8, axis=0) if "left" in name else points
        for name, points in walk.contours.items()
    })  # fmt: skip
    hidden = {**walk.contours, "fore_left": np.full_like(walk.contours["fore_left"], np.nan)}
    half = replace(walk, contours=hidden)
    for film, words in ((walk, ""), (half, ""), (bound, "gait.symmetry=none")):
        rms = compare_clocks(film, wavelet="db4").rms["limb"]
        assert words in describe_doubtful_fit(film, rms)
        assert bool(words) == bool(describe_doubtful_fit(film, rms))
