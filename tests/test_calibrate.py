"""Zones fitted to films whose fish swim by known zones, and the stage."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from constants import with_constants
from scratch import prepare, put_clip

import finloop
import finloop.calibrate.film
import stages.calibrate
import stages.plots.calibrate
from finloop.base.errors import FinloopError
from finloop.base.settings import settings
from finloop.calibrate.film import build_film_group, measure_horizon_frames
from finloop.calibrate.fit import (
    NeighbourSums,
    cross_validate,
    default_zones,
    fit_directions,
    fit_zones,
)
from finloop.calibrate.rule import (
    explain_missing_fit,
    fit_school_rule,
    measure_steps_without_others,
    simulate_point_fish,
)
from finloop.calibrate.settings import CalibrateSettings
from finloop.features.table import FEATURES
from finloop.io.numbers import load_numbers
from finloop.io.record import save_records
from finloop.io.several import PARTS_NAME, JoinedFilm
from finloop.io.table import load_table, save_table
from finloop.project import Project
from finloop.social.measures import SCHOOL, values_of_measure, wasserstein_distances
from finloop.social.neighbours import all_neighbours, complex_vectors
from finloop.social.rule import require_rule
from finloop.social.zones import COUZIN, NO_ZONES, Zones, pull_of_others, zone_pulls

PX, OWN, STEP = 20.0, 0.6, 0.3
ARENA = np.ones((300, 300), bool)
TRUE = Zones(0.5, 2.0, 8.0, 90.0, 1.2, 0.5, 0.8)
TRIED = {"radii": (0.0, 0.5, 1.0, 2.0, 4.0, 8.0), "blind_angles_deg": (0.0, 90.0, 180.0)}


@cache
def swim(zones, fish=6, frames=1500, seed=0):
    """Feature tables of fish whose heading after a frame is OWN (1 + pull) in the mean, and noise."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(3, 12, fish) - 1j * rng.uniform(3, 12, fish)
    heading = np.exp(2j * np.pi * rng.random(fish))
    places, headings = np.empty((2, frames, fish), complex)
    for t in range(frames):
        places[t], headings[t] = place, heading
        mean = OWN * (1 + pull_of_others(all_neighbours(place, heading), zones))
        noise = rng.normal(0, 0.35, fish) + 1j * rng.normal(0, 0.35, fish)
        to = mean + noise
        heading = heading * to / np.abs(to)
        place = place + STEP * heading
        inside = (place.real > 0) & (place.real < 15) & (place.imag < 0) & (place.imag > -15)
        heading = np.where(inside, heading, ((7.5 - 7.5j) - place) / np.abs((7.5 - 7.5j) - place))
        place = np.clip(place.real, 0, 15) + 1j * np.clip(place.imag, -15, 0)
    return features(places, headings)


def features(places, headings):
    """A feature table of tracks (frames, fish)."""
    frames, fish = places.shape
    table = pd.DataFrame({
        "track_id": np.repeat(np.arange(fish), frames), "frame": np.tile(np.arange(frames), fish),
        "x_px": PX * places.real.T.ravel(), "y_px": -PX * places.imag.T.ravel(),
        "heading_deg": np.degrees(np.angle(headings)).T.ravel(), "body_length_px": PX,
    })  # fmt: skip
    for name in FEATURES.names:
        if name not in table:
            table[name] = 1
    last = table["frame"] == frames - 1  # Δ of a frame
    table["displacement"] = np.where(last, np.nan, STEP)
    return table.astype(FEATURES.pandas_dtypes)[FEATURES.names]


def quick_settings(**changes):
    """Parameters with which a fit is quick."""
    return with_constants(settings("calibrate"), **TRIED | changes)


def shoal(zones=TRUE, **by):
    return build_film_group(swim(zones, **by), ARENA, 1, 1.0)


FILM = shoal()


# --- the fit


@pytest.fixture(scope="module")
def zones_fit():
    """What is fitted to FILM."""
    return fit_zones(FILM, quick_settings())


def test_zones_that_fish_swim_by_are_found_again(zones_fit):
    found = zones_fit
    assert found.zones.radii == TRUE.radii
    assert found.zones.blind_deg == TRUE.blind_deg
    assert found.zones.weights == pytest.approx(TRUE.weights, rel=0.25)
    assert found.explained_held_out == pytest.approx(found.explained, abs=0.05)
    assert found.explained_held_out > 0.05


def test_fish_that_pay_no_attention_have_no_zones_that_foretell():
    found = fit_zones(shoal(NO_ZONES), quick_settings())
    assert found.explained_held_out < 0.005
    assert max(found.zones.weights) < 0.1


def test_what_is_given_is_kept_and_the_rest_is_fitted():
    p = quick_settings(attraction_radius_bl=7.0, attraction_weight=0.8, blind_angle_deg=90.0)
    found = fit_zones(FILM, p).zones
    assert (found.attraction, found.attraction_weight, found.blind_deg) == (7.0, 0.8, 90.0)
    assert found.repulsion_weight == pytest.approx(1.2, rel=0.3)


@pytest.mark.parametrize(
    "asked",
    [
        {"repulsion_radius_bl": 20.0},
        {"alignment_radius_bl": 20.0},
        {"radii": (1.0, 2.0, 4.0), "attraction_radius_bl": 0.5},
        {"attraction_radius_bl": 0.0},
    ],
)
def test_zones_beyond_the_list_are_fitted_round_what_is_given(asked):
    zones = fit_zones(FILM, quick_settings(**{"blind_angles_deg": (0.0,)} | asked)).zones
    for name in {*asked} - {"radii"}:
        assert getattr(zones, name.removesuffix("_radius_bl")) == asked[name]
    assert list(zones.radii) == sorted(zones.radii)


def test_the_mirror_image_of_a_film_has_the_same_zones(zones_fit):
    table = swim(TRUE)
    mirrored = table.assign(x_px=299 - table["x_px"], heading_deg=180 - table["heading_deg"])
    there = fit_zones(build_film_group(mirrored, ARENA, 1, 1.0), quick_settings())
    assert there.zones.radii == zones_fit.zones.radii
    assert there.zones.weights == pytest.approx(zones_fit.zones.weights, rel=1e-3)


def test_rings_say_what_zones_say():
    rows = FILM.rows_for_fit(True, 300)
    seen = FILM.visible_neighbours(rows)
    rings = NeighbourSums(seen, [0.0, 0.5, 2.0, 8.0], 90.0)
    for radii in [(0.5, 2.0, 8.0), (0.0, 0.0, 8.0), (0.5, 0.5, 0.5), (0.0, 2.0, 2.0)]:
        assert rings.mean_zone_directions(radii) == pytest.approx(
            zone_pulls(seen, radii, 90.0), abs=1e-9
        )


def test_regression_leaves_out_what_would_be_negative():
    rng = np.random.default_rng(0)
    pulls, wall = (rng.normal(0, 1, (500, n)) + 1j * rng.normal(0, 1, (500, n)) for n in (3, 1))
    after = 0.5 + pulls @ [0.2, -0.4, 0.1] - 0.3 * wall[:, 0]
    lot, square = fit_directions(pulls[:, [0, 2, 1]], wall[:, 0], after, [None] * 3)
    assert lot[3] == 0 and lot[[0, 1, 2, 4]] == pytest.approx([0.5, 0.2, 0.1, -0.3], abs=0.05)
    columns = np.column_stack([np.ones(500), pulls[:, [0, 2]], wall[:, 0]])
    assert square == pytest.approx((np.abs(after - columns @ lot[[0, 1, 2, 4]]) ** 2).sum())


def test_what_fits_by_chance_is_found_out_by_the_other_part():
    rng, parts, free = np.random.default_rng(0), np.arange(40) < 20, [None] * 3
    own, cross, true = [], [], []
    for _ in range(40):
        noise = rng.normal(0, 1, (40, 5)) + 1j * rng.normal(0, 1, (40, 5))
        pulls, wall, after = noise[:, :3], noise[:, 3], 0.5 + noise[:, 4]

        def squares(fit, after, wall=wall, pulls=pulls):
            """The squares left by the pulls less those left by nothing."""
            return np.subtract(*(fit(one, wall, after) for one in (pulls, 0 * pulls)))

        def cross_fit(pulls, wall, after):
            return cross_validate(pulls, wall, after, free, parts)

        own.append(squares(lambda *given: fit_directions(*given, free)[1], after))
        cross.append(squares(cross_fit, after))
        true.append(squares(cross_fit, after + 2 * pulls[:, 0]))
    assert np.mean(own) < 0  # what was fitted to fits better with anything than with nothing
    assert np.mean(cross) > 0
    assert max(true) < 0


# --- the film


def test_company_is_that_of_the_frame_and_a_while_later_of_the_track():
    rows = FILM.rows_for_fit(False, 50)
    assert (FILM.frame[rows] >= 750).all()
    assert (FILM.frame[FILM.later[rows]] == FILM.frame[rows] + 1).all()
    assert (np.isfinite(FILM.visible_neighbours(rows).distance).sum(axis=1) == 5).all()
    assert FILM.typical_fish_count == 6


def test_headings_that_last_are_looked_at_again_later():
    rng = np.random.default_rng(0)
    track = np.zeros(4000, int)
    quick, slow = (np.exp(1j * np.cumsum(rng.normal(0, size, 4000))) for size in (0.5, 0.2))
    # The mean cosine of a random walk falls as exp(−σ² t / 2).
    assert measure_horizon_frames(quick, track, 1) == pytest.approx(2 * np.log(2) / 0.5**2, rel=0.4)
    assert measure_horizon_frames(slow, track, 1) == pytest.approx(2 * np.log(2) / 0.2**2, rel=0.4)
    assert measure_horizon_frames(slow, track, 1500) == 1500
    assert measure_horizon_frames(slow, track, 3000) == 1999  # rows have one before and a later one


def test_a_horizon_longer_than_the_tracks_is_refused():
    table = swim(TRUE, frames=300)
    assert len(build_film_group(table, ARENA, 1, 149.0).rows_with_whole_steps(5000)) > 0
    for horizon in (150.0, 1000.0):
        with pytest.raises(FinloopError, match=f"horizon={horizon:g} is .* has 300") as caught:
            build_film_group(table, ARENA, 1, horizon)
        assert "at most 149" in caught.value.wanted and "auto" in caught.value.do
    for frames in (3, 4, 7, 30):  # a measured one always leaves some steps
        film = build_film_group(swim(TRUE, frames=frames), ARENA, 10, "auto")
        assert len(film.rows_with_whole_steps(5000)) > 0


def test_tracks_too_short_for_a_step_teach_no_rule():
    often = swim(TRUE, fish=10, frames=40)  # in company throughout, each track of two frames
    short = often.assign(track_id=often["track_id"] * 20 + often["frame"] // 2)
    film = build_film_group(short, ARENA, 1, "auto")
    assert min(len(film.rows_for_fit(half, 50)) for half in (True, False)) == 50
    rule, fit = fit_school_rule(film, settings("calibrate"))
    assert fit is None and "no track has three consecutive frames" in explain_missing_fit(film)
    with pytest.raises(FinloopError, match="too short for the steps"):
        require_rule(rule)


def test_fish_that_are_points_shoal_as_the_film_does():
    p = with_constants(settings("calibrate"), steps=800)
    half, other = FILM.measures_of_half(True), FILM.measures_of_half(False)
    rows, far = FILM.rows_with_whole_steps(p.rows), {}
    for name, zones in (("zones", TRUE), ("alone", NO_ZONES)):
        steps = measure_steps_without_others(FILM, rows, zones)
        animation = simulate_point_fish(FILM, steps, zones, p, np.random.default_rng(0))
        far[name] = wasserstein_distances(FILM.table, animation)["neighbour_distance"]
        assert animation["wall_distance"].min() > 0
    assert far["zones"] < 0.5 * far["alone"]
    assert wasserstein_distances(half, other)["neighbour_distance"] < far["alone"]


def test_own_steps_leave_nothing_to_the_company():
    rows = FILM.rows_with_whole_steps(3000)
    steps = measure_steps_without_others(FILM, rows, TRUE)
    assert steps.turn_per_pull == pytest.approx(OWN, rel=0.15)
    pulls = pull_of_others(FILM.visible_neighbours(rows), TRUE)
    whole = measure_steps_without_others(FILM, rows, NO_ZONES)
    left, before = (float((one.turn * pulls.conj()).real.mean()) for one in (steps, whole))
    assert before > 0.1 and abs(left) < 0.3 * before


# --- parameters and the stage


def test_zones_that_do_not_lie_round_each_other_are_refused():
    with pytest.raises(FinloopError, match="repulsion ≤ alignment ≤ attraction"):
        settings("calibrate", repulsion_radius_bl=3.0, attraction_radius_bl=2.0)


def test_a_film_without_company_has_the_papers_zones():
    assert default_zones(settings("calibrate")) == COUZIN
    given = default_zones(settings("calibrate", repulsion_radius_bl=2.0, attraction_weight=0.0))
    assert given == replace(COUZIN, repulsion=2.0, attraction_weight=0.0)


def run(tmp_path, monkeypatch, table, *overrides, parts=(), steps=50):
    """The stage on a feature table; the numbers that it reports."""
    tmp_path.mkdir(exist_ok=True)
    prepare(tmp_path, *overrides)
    monkeypatch.setattr(CalibrateSettings, "horizon", 1.0)
    monkeypatch.setattr(CalibrateSettings, "steps", steps)
    monkeypatch.chdir(tmp_path)
    put_clip(tmp_path, [np.zeros(ARENA.shape, np.uint8)])
    if parts:
        save_records(tmp_path / "data/clip" / PARTS_NAME, parts)
    save_table(tmp_path / "data/features/features.parquet", table, FEATURES)
    stages.calibrate.main()
    stages.plots.calibrate.main()
    assert (tmp_path / "reports/film/calibrate/distributions.png").stat().st_size > 0
    return load_numbers(tmp_path / "reports/calibrate")


@pytest.fixture(scope="module")
def zones_run(tmp_path_factory):
    """A folder in which the stage has run on fish that swim by zones, and its numbers."""
    folder = tmp_path_factory.mktemp("zones")
    with pytest.MonkeyPatch.context() as patch:
        return folder, run(folder, patch, swim(TRUE, frames=200))


def test_the_stage_says_how_the_fish_of_a_film_act_on_each_other(zones_run, monkeypatch):
    folder, numbers = zones_run
    monkeypatch.chdir(folder)
    assert numbers["fitted"] == 1 and numbers["fish"] == 6
    table = pd.read_csv(folder / "data/calibrate/company.csv")
    assert set(table["shoal"]) == {"first_half", "zones", "alone"}
    assert set(table["beside"]) == {"film", "second_half"}
    film = load_table(folder / "data/calibrate/film.parquet", SCHOOL)
    assert len(film) == 6 * 200 and len(values_of_measure(film, "polarisation")) == 200
    assert Project().school_rule.horizon == 1
    assert Project().school_rule.zones.attraction == numbers["attraction"]
    assert len(Project().school_rule.steps.move) > 100


def test_rounding_changes_no_number_of_the_film_and_how_points_swim(tmp_path, monkeypatch):
    """So git has the numbers of the film, and the table of how they swim is among the data."""
    numbers, tables = [], []
    for shift in (0, 1e-12):

        def shift_vectors(*where, shift=shift):
            place, heading = complex_vectors(*where)
            return place * (1 + shift), heading

        monkeypatch.setattr(finloop.calibrate.film, "complex_vectors", shift_vectors)
        to = tmp_path / str(shift)
        numbers.append(run(to, monkeypatch, swim(TRUE, frames=200), steps=250))
        tables.append(pd.read_csv(to / "data/calibrate/company.csv").set_index("shoal"))
    assert numbers[0] == numbers[1]
    assert tables[0].loc["first_half"].equals(tables[1].loc["first_half"])
    assert not tables[0].loc["zones"].equals(tables[1].loc["zones"])


def test_a_film_of_one_fish_says_so_and_the_pipeline_goes_on(tmp_path, monkeypatch, capsys):
    alone = swim(NO_ZONES, fish=1, frames=200)
    numbers = run(tmp_path, monkeypatch, alone, "calibrate.repulsion_radius_bl=2.0")
    assert ", 0 and 0 times" in capsys.readouterr().err
    assert numbers["fitted"] == 0 and numbers["fish"] == 1
    assert Project().school_rule.zones == replace(COUZIN, repulsion=2.0)
    assert len(Project().school_rule.steps.move) > 50  # by these it swims among its own kind


def test_of_several_films_the_first_alone_teaches(zones_run, tmp_path, monkeypatch):
    first, second = swim(TRUE, frames=200), swim(NO_ZONES, frames=300, seed=1)
    later = second.assign(frame=second["frame"] + 200, track_id=second["track_id"] + 6)
    both = pd.concat([first, later], ignore_index=True).astype(FEATURES.pandas_dtypes)
    parts = [
        JoinedFilm("x", "x.mp4", 0, 0, "broken"), JoinedFilm("a", "a.mp4", 0, 200),
        JoinedFilm("b", "b.mp4", 200, 500),
    ]  # fmt: skip
    assert run(tmp_path, monkeypatch, both, parts=parts) == zones_run[1]


def test_the_verb_returns_the_rule_of_the_stage(zones_run, monkeypatch):
    monkeypatch.chdir(zones_run[0])
    monkeypatch.setattr(CalibrateSettings, "horizon", 1.0)
    film = SimpleNamespace(arena=ARENA)
    rule, stored = finloop.find_zones(swim(TRUE, frames=200), film), Project().school_rule
    assert (rule.zones, rule.horizon, rule.similar_steps) == (
        stored.zones,
        stored.horizon,
        stored.similar_steps,
    )
    assert rule.steps.move.tolist() == stored.steps.move.tolist()
    for name in ("move_per_pull", "turn_per_pull"):
        assert getattr(rule.steps, name) == getattr(stored.steps, name)
    with pytest.warns(UserWarning, match="Couzin"):
        assert finloop.find_zones(swim(NO_ZONES, fish=1, frames=50), film).zones == COUZIN
    monkeypatch.setattr(CalibrateSettings, "horizon", "auto")
    with pytest.warns(UserWarning, match="Couzin"), pytest.raises(FinloopError, match="too short"):
        finloop.find_zones(swim(NO_ZONES, fish=1, frames=2), film)
