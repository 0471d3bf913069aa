"""Benchmarks: memory rises with the work, whatever the process that measures has held; films."""

import math

import numpy as np
import pandas as pd
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from benchmarks import films, identities, scale
from benchmarks.pipeline import ROOT, peak_mib

HOLD = "held = b'x' * ({} << 20)"


def test_peak_memory_rises_with_what_a_process_holds_whatever_this_one_does():
    here = b"x" * (200 << 20)
    least, more, most = (peak_mib(ROOT, "-c", HOLD.format(size)) for size in (0, 100, 300))
    assert least < 60 < len(here) >> 20
    assert more - least == pytest.approx(100, abs=5)
    assert most - more == pytest.approx(200, abs=5)


def test_peak_memory_is_that_of_the_largest_process_and_fails_with_it():
    """Also where the workers of a stage do the work."""
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD.format(200)!r}])"
    assert peak_mib(ROOT, "-c", code) > 200
    with pytest.raises(SystemExit, match="ZeroDivisionError"):
        peak_mib(ROOT, "-c", "1 / 0")


# --- films


@pytest.mark.parametrize(
    "name", ["a'b.mp4", 'a"b.mp4', "a\\b.mp4", "a${b}.mp4", "a\\${b}.mp4", "ä, {b}=c.mp4", "end\\"]
)
def test_the_path_of_a_film_comes_through_hydra_as_it_is(name, tmp_path):
    path = tmp_path / name
    *_, override = films.file_overrides(path)
    value = OverridesParser.create().parse_override(override).value()
    assert OmegaConf.create({"path": str(value)}).path == str(path.resolve())


def test_names_of_films_are_checked_before_the_first_one_is_run(tmp_path, capsys):
    (tmp_path / "a.mp4").touch()
    here, absent, drawn = str(tmp_path / "a.mp4"), str(tmp_path / "b.mp4"), "98 frames"
    args = films.parse_arguments([here, "--only", drawn])
    assert args.films == [here] and args.only == [drawn]
    assert films.parse_arguments([here]).only == list(films.DRAWN)
    for line, wrong in (([here, absent], absent), ([here, "--only", drawn, here], here)):
        with pytest.raises(SystemExit):
            films.parse_arguments(line)
        assert f"['{wrong}']" in capsys.readouterr().err


def test_films_of_one_name_have_rows_of_their_own():
    assert films.film_keys(["a/film.mp4", "b/film.mp4", "b/other.mp4"]) == [
        "a/film.mp4", "b/film.mp4", "other",
    ]  # fmt: skip


def test_a_film_that_fails_is_a_row_and_the_next_one_is_run(tmp_path, monkeypatch):
    def run_or_fail(folder, overridden, last):
        if overridden == ["bad"]:
            raise SystemExit("stage failed:\nfinloop: no fish\n  do:     take some")
        return {"rows": 7}

    monkeypatch.setattr(films, "run_pipeline", run_or_fail)
    monkeypatch.setattr(films, "_TABLE", tmp_path / "films.csv")
    for row in films.measure_films([("one", ["bad"]), ("98 frames", None)], tmp_path, ["render"]):
        films.keep_row(pd.DataFrame([row]))
    table = pd.read_csv(tmp_path / "films.csv")
    assert list(table["film"]) == ["one", "drawn carp, 98 frames"]
    assert table["failed"][0] == "no fish" and table["rows"][1] == 7
    assert table["failed"].isna()[1] and table["rows"].isna()[0]


def test_a_film_that_is_run_up_to_features_has_no_numbers_of_modes(tmp_path, monkeypatch):
    monkeypatch.setattr(films, "prepare_folder", lambda folder, overrides: None)
    numbers = {"fish_frames": 7, "delta_s": 0.2, "heading_jumps_pct": 1.5}
    monkeypatch.setattr(films, "run_stage", lambda folder, stage: numbers)
    row = films.run_pipeline(tmp_path, [], ["features"])
    known = {name for name, value in row.items() if value is not None}
    assert known == {"rows", "delta_s", "heading_jumps_pct", "video"} and not row["video"]


# --- identities


@pytest.fixture
def two_fish():
    """Two fish that swim side by side, four body lengths apart, for 20 frames."""
    frame, animal = np.divmod(np.arange(40), 2)
    places = {"x_px": 3.0 * frame, "y_px": 40.0 * animal}
    return pd.DataFrame({"frame": frame, "animal": animal, **places})


def switches(truth, told):
    return identities.identity_switches(identities.match_places(truth, told, 10.0))


def test_other_names_are_no_switches(two_fish):
    told = two_fish.assign(animal=7 - two_fish["animal"])
    of = identities.match_places(two_fish, told, 10.0)
    assert len(of) == identities.count_right_animals(of) == 40
    assert not len(identities.identity_switches(of))


def test_names_that_change_places_are_two_switches(two_fish):
    later = two_fish["frame"] >= 12
    told = two_fish.assign(animal=np.where(later, 1 - two_fish["animal"], two_fish["animal"]))
    found = switches(two_fish, told[~told["frame"].isin([11, 12])])  # a gap hides none
    assert found[["frame", "last_frame", "was", "becomes"]].to_numpy().tolist() == [
        [13, 10, 0, 1], [13, 10, 1, 0],
    ]  # fmt: skip
    assert identities.count_right_animals(identities.match_places(two_fish, told, 10.0)) == 24


def test_places_in_doubt_are_not_compared(two_fish):
    near = two_fish["frame"].between(8, 10)
    truth = two_fish.assign(y_px=np.where(near, two_fish["animal"], two_fish["y_px"]))
    animal = np.where(near, 1 - truth["animal"], truth["animal"])
    told = truth.assign(animal=animal, x_px=truth["x_px"] + 0.6)
    of = identities.match_places(truth, told, 10.0)
    assert sorted(of["frame"].unique()) == [k for k in range(20) if not 8 <= k <= 10]
    assert not len(identities.identity_switches(of))


def test_shares_are_of_all_fish_and_frames(two_fish):
    told = two_fish[two_fish["frame"] < 15]
    told = told.assign(animal=told["animal"] + (told["frame"] > 9) * 2)
    row = identities.summarize_program(told, 2, 20, identities.match_places(two_fish, told, 10.0))
    assert row == {
        "animals": 4, "fish_frames_pct": 75.0, "fish_frames_of_most_pct": 50.0, "switches": 2,
        "same_animal_pct": 50.0,
    }  # fmt: skip


@pytest.mark.parametrize("succeeds", [True, False])
def test_a_program_has_succeeded_where_it_made_trajectories(tmp_path, succeeds):
    """Its status is 1 in both cases."""
    program = identities.tracker_command(tmp_path / "environment")
    program.parent.mkdir(parents=True)
    home = "session_film/trajectories"
    made = f"mkdir -p {home}; cp ../places.npy {home}/trajectories.npy"
    program.write_text(f"#!/bin/sh\n{made if succeeds else ''}\nexit 1\n")
    program.chmod(0o755)
    np.save(tmp_path / "places.npy", np.full((5, 2, 2), 20.0))
    (folder := tmp_path / "made").mkdir()
    film = identities.Film(tmp_path / "film.avi", [], 2, (0, 0, 40, 30), 130, 100)
    if succeeds:
        told = identities.track_by_idtracker(film, folder, tmp_path / "environment", [])
        assert len(told) == 10 and (told["x_px"] == 20).all()
    else:
        with pytest.raises(SystemExit, match="made no trajectories"):
            identities.track_by_idtracker(film, folder, tmp_path / "environment", [])


def test_rows_are_kept_beside_those_of_other_films(tmp_path, monkeypatch):
    """A figure that is not known, and settings that are empty, stay so."""
    monkeypatch.setattr(identities, "TABLE", tmp_path / "table.csv")
    row = {"film": "A", "program": "its", "settings": "", "time_s": 1.234, "processor_s": np.nan}
    for changes in ({}, {"film": "B"}, {"time_s": 5.678}):
        identities.keep_rows(pd.DataFrame([row | changes]))
    lines = (tmp_path / "table.csv").read_text().splitlines()
    assert lines[1:] == ["A,its,,5.68,", "B,its,,1.23,"]


# --- scale


def test_time_that_grows_as_n_to_the_k_has_that_exponent():
    n = pd.Series([1e4, 1e5, 1e6])
    assert scale.growth_exponent(n, 3e-4 * n**1.5) == pytest.approx(1.5)
    assert 1 < scale.growth_exponent(n, n * n.map(math.log)) < 1.1


def test_a_stage_that_has_figures_is_not_run_again(tmp_path, monkeypatch):
    runs = []

    def measure_stage(folder, word):
        runs.append(word)
        return {"seconds": 1.5}

    monkeypatch.setattr(scale, "measure_stage", measure_stage)
    assert [scale.stage_figures(tmp_path, "jumps") for _ in range(2)] == [{"seconds": 1.5}] * 2
    assert runs == ["jumps"]


def test_time_after_extraction_is_that_of_the_stages_and_disk_that_of_all():
    rows = [(scale.FILM, 50, 9.0), ("pose", 2, 1.0), ("jumps", 3, 0.5), ("start", 7, 0.0)]
    table = pd.DataFrame(rows, columns=["stage", "seconds", "disk_gib"])
    table = table.assign(pictures=100, processor_s=table["seconds"], memory_gib=table["seconds"])
    table.loc[0, ["processor_s", "memory_gib"]] = float("nan")
    (row,) = scale.sum_stages(table).to_dict("records")
    assert (row["seconds"], row["processor_s"], row["memory_gib"]) == (5, 5, 3)
    assert row["disk_gib"] == 10.5 and row["stage"] == scale.TOGETHER
    table.loc[table["stage"] == "pose", "processor_s"] = math.nan
    assert math.isnan(scale.sum_stages(table)["processor_s"].item())  # not the sum of the others
