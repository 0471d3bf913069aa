"""The stage `morph`, end to end in a folder of its own."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT, TINY_CARP
from scratch import content, prepare, same_but_figures
from tiny_run import stage_run

import stages.morph
from finloop.base.errors import FinloopError
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture

SMALL = tuple(one for one in TINY_CARP if one.startswith("morph."))


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    shutil.copytree(ROOT / "data/drawings", tmp_path / "data/drawings")
    monkeypatch.chdir(tmp_path)
    return tmp_path


morph_run = stage_run("morph")


@pytest.mark.usefixtures("no_drawing")
def test_stage_makes_what_dvc_expects_the_same_each_time(morph_run, folder):
    shutil.copytree(morph_run, folder, dirs_exist_ok=True)
    first = content(folder / "data/morph") | content(folder / "reports/morph")
    stage = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]["morph"]
    named = [next(iter(o)) if isinstance(o, dict) else o for o in stage["outs"] + stage["metrics"]]
    for out in named:
        assert (folder / out).exists(), out
    assert {path.name for path in (folder / "data/morph").iterdir()} == {
        f"fold_free{ending}"
        for ending in (
            ".svg",
            ".css.svg",
            ".json",
            ".lottie.json",
            ".spine.json",
            ".spine.atlas",
            ".webp",
            ".mp4",
        )
    } | {"finloop-white.png", "connection.csv", "folds.csv"}
    for number in range(2, 8):
        assert load_picture(folder / f"reports/morph/figures/fig{number}.png").std() > 5
    numbers = load_numbers(folder / "reports/morph")
    assert numbers["hoop_error_runge_kutta"] < 1e-4
    assert numbers["hoop_error_decoupled"] > 0.37  # dropping off-diagonals is no small error
    assert numbers["hoop_largest_rise_of_energy_share"] <= 1e-9
    assert 1 < numbers["hoop_rest_time"] < 4
    assert 0.45 < numbers["hoop_frictionless_least_displacement_share"] < 0.55  # it never rests
    errors = [numbers[f"hoop_{count}_points_error_radii"] for count in (4, 8, 16, 32)]
    assert errors == sorted(errors, reverse=True) and errors[-1] < 0.02
    prepare(folder, *SMALL)
    stages.morph.main()
    again = content(folder / "data/morph") | content(folder / "reports/morph")
    assert same_but_figures(first, again)


@pytest.mark.usefixtures("no_drawing")
def test_numbers_tell_what_was_made(folder, monkeypatch):
    # As above, whatever the method.
    monkeypatch.setattr(stages.morph, "_draw_released_hoop", lambda _: {})
    monkeypatch.setattr(stages.morph.MorphSettings, "back", False)
    prepare(folder, *SMALL, "morph.method=linear")
    stages.morph.main()
    numbers = load_numbers(folder / "reports/morph")
    assert (numbers["contours"], numbers["frames"]) == (11, 6)
    assert numbers["fold_free_contours_that_fold"] == 0
    assert 13 < numbers["off_diagonal_energy_coif2_2_levels_pct"] < 17
    folds = pd.read_csv(folder / "data/morph/folds.csv")
    assert set(folds["method"]) == {"linear", "physical", "fold_free"} and len(folds) == 33
    frames = json.loads((folder / "data/morph/linear.json").read_text())["frames"]
    assert [frame["tau"] for frame in frames] == pytest.approx(list(np.linspace(0, 1, 6)))
    table = pd.read_csv(folder / "data/morph/connection.csv").set_index(["wavelet", "l"])
    assert table.loc[("db4", 0), "mu"] == pytest.approx(4.165973640696, abs=1e-11)
    assert table.loc[("coif2", 7), "nu_normalised"] == pytest.approx(-2.70434e-7, abs=1e-10)


@pytest.mark.usefixtures("no_drawing")
def test_forces_move_the_physical_morph(folder, monkeypatch, capsys):
    monkeypatch.setattr(stages.morph, "_draw_released_hoop", lambda _: {})
    monkeypatch.setattr(stages.morph, "_draw_curve_paper_figures", lambda _: {})
    monkeypatch.setattr(stages.morph, "METHODS", ("linear", "physical"))
    monkeypatch.setattr(stages.morph.MorphSettings, "frame_rate_hz", 2.0)
    face = folder / "data/drawings/face_a.svg"
    dashed = face.read_text().replace("<path", '<path stroke="#000" stroke-dasharray="9"', 1)
    face.write_text(dashed)
    forces = 'morph.forces=["gravity=3","floor=390"]'
    physics = ("morph.damping=4", "morph.stiffness_damping=0.05", "morph.frames=12")
    prepare(folder, *SMALL, "morph.method=physical", forces, *physics)
    stages.morph.main()
    assert "morph: Spine shows dashes as a whole line" in capsys.readouterr().err
    assert 0 < load_numbers(folder / "reports/morph")["rest_time_s"] < 5
    frames = json.loads((folder / "data/morph/physical.json").read_text())["frames"]
    assert len(frames) == 12  # it does not go back
    lowest = [max(y for points in frame["layers"].values() for _, y in points) for frame in frames]
    assert lowest[0] < 360 < 385 < lowest[-1] < 390.1


@pytest.mark.parametrize(
    ("asked", "said"),
    [("morph.contour_points=100", "power of two"), ("morph.wavelet=db2", "H"),
     ("morph.level=9", "fewer than 4 control points"),
     ("morph.pairs=none.yaml", "none.yaml"),
     ('morph.forces=["gravity=1"]', "set method=physical"),
     ('morph.forces=["rain=1"]', "'rain' is none of gravity"),
     ("morph.mass=-1", "mass")],
)  # fmt: skip
@pytest.mark.usefixtures("no_drawing")
def test_what_is_wrong_is_said_and_nothing_is_lost(folder, monkeypatch, asked, said):
    monkeypatch.setattr(stages.morph, "_draw_released_hoop", lambda _: {})
    (folder / "data/morph").mkdir(parents=True)
    (folder / "data/morph/kept.txt").write_text("kept")
    with pytest.raises(FinloopError, match=said):
        prepare(folder, *SMALL, asked)
        stages.morph.main()
    assert (folder / "data/morph/kept.txt").read_text() == "kept"
