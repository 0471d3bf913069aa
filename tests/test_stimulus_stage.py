"""The program `stages.stimulus` on a film: listed, run dry, checked, recovered; what it refuses."""

import argparse
import json
import shutil
import sys
from pathlib import Path

import pytest
import yaml
from browser import WITHIN, chromium, hold_time
from conftest import wait_for
from tiny_run import TinyRun

import stages.stimulus
from finloop.base.errors import FinloopError
from finloop.io.journal import save_journal
from finloop.project import Project
from finloop.stimulus.display import DisplayCalibration, save_display
from finloop.stimulus.protocol_file import load_protocol
from finloop.stimulus.replay import SessionRecord, open_session_record
from stages.stimulus_scene import display_file, load_display_calibration, open_scene

CONDITIONS = {
    "goals": {"seconds": 1.0, "motion": {"goals": [[0.2, 0.5], [0.8, 0.5]]}},
    "dot": {"seconds": 1.0, "motion": {"goals": [[0.2, 0.5], [0.8, 0.5]]}, "look": {"as": "dot"}},
    "live": {"seconds": 1.5, "motion": {"rule": {"rule": "follow", "distance": 1.0}}},
    "yoked": {"seconds": 1.5, "motion": {"again": "live"}},
}


@pytest.fixture(scope="module")
def stimulus_run(tmp_path_factory, tiny_run: TinyRun):
    folder = tmp_path_factory.mktemp("stimulus")
    tiny_run.bring(folder, ["animate", "export"])
    shutil.copy2(tiny_run.folder / "params.yaml", folder / "params.yaml")
    (folder / "conf").symlink_to(tiny_run.folder / "conf")
    return folder


@pytest.fixture
def workspace(stimulus_run, monkeypatch):
    monkeypatch.setattr("finloop.stimulus.motion._WARM_UP_TICKS", 5)
    monkeypatch.chdir(stimulus_run)
    return stimulus_run


def protocol(folder, name="protocol.yaml", **more):
    values = {"version": 1, "name": "tiny", "seed": 2, "display": {"calibrated": False}}
    values |= {"animals": {"unit": "px"}, "conditions": CONDITIONS} | more
    (folder / name).write_text(yaml.safe_dump(values))
    return str(folder / name)


def command(monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", ["stimulus", *map(str, words)])
    stages.stimulus.main()


def test_it_is_listed_run_dry_and_planned_again(workspace, tmp_path, monkeypatch, capsys):
    path = protocol(tmp_path)
    command(monkeypatch, "list", path)
    listed = capsys.readouterr().out
    assert all(name in listed for name in CONDITIONS)
    spoil = ["--loss", "0.2", "--jitter", "0.05", "--gap", "0.5"]
    command(monkeypatch, "dry", path, "--out", tmp_path, "--animal", "track:0", *spoil)
    assert listed.strip() in capsys.readouterr().out
    [session] = tmp_path.glob("*.parquet")
    assert not list(tmp_path.glob("*.journal"))
    words = session.with_suffix(".md").read_text()
    assert "a dry run" in words and all(f"| {name} |" in words for name in CONDITIONS)
    command(monkeypatch, "replay", session, "--check")
    assert ", 0 differ" in capsys.readouterr().out


def test_a_dry_run_says_how_often_a_fish_is_outside_the_screen(
    workspace, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("stages.stimulus_scene.DISPLAYS", tmp_path)
    path = protocol(tmp_path, conditions={"goals": CONDITIONS["goals"]})
    facts = {"width_px": 400, "height_px": 300, "ratio": 1.0, "refresh_hz": 60.0}
    for name, scale in (("large", None), ("small", 50.0)):
        display = DisplayCalibration(**facts, scale=scale)
        save_display(tmp_path / f"{name}.json", display)
    command(monkeypatch, "dry", path, "--out", tmp_path, "--display", "large")
    told = capsys.readouterr().out
    assert "0.0 % of the area" in told and "0.00 % of the ticks" in told
    with pytest.raises(SystemExit, match="1"):
        command(monkeypatch, "dry", path, "--out", tmp_path / "b", "--display", "small")
    assert "the screen 400 × 300 px" in capsys.readouterr().out
    assert list(tmp_path.glob("b/*.parquet"))  # the session is whole before


def test_points_of_another_tank_are_refused_before_anything_runs(
    workspace, tmp_path, monkeypatch, capsys
):
    places = [[0, 0], [4999, 0], [4999, 4999], [0, 4999]]
    points = [{"tracker": place, "tank": place} for place in places]
    path = protocol(tmp_path, animals={"points": points})
    for name in ("list", "dry"):
        with pytest.raises(FinloopError, match="corners of a tank of 5000 × 5000 px"):
            command(monkeypatch, name, path, *(["--out", tmp_path] if name == "dry" else []))
    assert not list(tmp_path.glob("*.parquet"))
    width, height = Project().facts.width_px, Project().facts.height_px
    for pair in points:
        pair["tank"] = [
            min(x, size - 1) for x, size in zip(pair["tank"], (width, height), strict=True)
        ]
    command(monkeypatch, "list", protocol(tmp_path, animals={"points": points}))
    assert f"which is {width} × {height}:" in capsys.readouterr().out


def test_a_journal_that_was_left_becomes_a_session(workspace, tmp_path, monkeypatch, capsys):
    kept = []

    def cut(journal, path, schema):
        kept.append(journal.read_bytes())
        with pytest.raises(FinloopError, match="its session runs"):  # it has not ended yet
            stages.stimulus.recover(argparse.Namespace(journal=journal))
        return save_journal(journal, path, schema)

    with monkeypatch.context() as patch:
        patch.setattr(stages.stimulus, "save_journal", cut)
        command(monkeypatch, "dry", protocol(tmp_path), "--out", tmp_path / "a")
    assert not list((tmp_path / "a").glob("*.journal"))  # of a session that ended in order
    journal = tmp_path / "left.journal"
    journal.write_bytes(kept[0][: len(kept[0]) * 3 // 4])
    command(monkeypatch, "recover", journal)
    record = open_session_record(tmp_path / "left.parquet")
    assert sum(1 for _ in record.read_rows("tick")) > 10 and journal.exists()
    assert "recovered" in (tmp_path / "left.md").read_text()
    whole = (tmp_path / "left.parquet").read_bytes()
    with pytest.raises(FinloopError, match=r"left\.parquet exists already"):
        command(monkeypatch, "recover", journal)
    assert (tmp_path / "left.parquet").read_bytes() == whole
    with pytest.raises(FinloopError, match="cannot be read"):
        command(monkeypatch, "recover", tmp_path / "none.journal")


def test_a_session_of_another_film_is_refused(workspace, tmp_path, monkeypatch):
    command(monkeypatch, "dry", protocol(tmp_path), "--out", tmp_path)
    [session] = tmp_path.glob("*.parquet")
    with monkeypatch.context() as patch:
        patch.setattr("stages.stimulus_scene._MADE_FROM", ("clip/facts.json",))
        with pytest.raises(FinloopError, match=r"from another film\n"):
            command(monkeypatch, "replay", session, "--check")
    header = open_session_record(session).header
    header["animate"]["goal_radius_bl"] = 9.0
    monkeypatch.setattr(
        stages.stimulus, "open_session_record", lambda path: SessionRecord(path, header)
    )
    with pytest.raises(FinloopError, match=r"from another animate\.goal_radius_bl"):
        command(monkeypatch, "replay", session, "--check")


def test_a_display_must_be_calibrated_where_the_protocol_says_so(workspace, tmp_path, monkeypatch):
    path = protocol(tmp_path, display={"calibrated": True})
    with pytest.raises(FinloopError, match="the display wall is not calibrated"):
        command(monkeypatch, "show", path, "--display", "wall", "--port", "0")
    with pytest.raises(FinloopError, match="letters, digits"):
        display_file("../wall")
    size = {"width_px": 1280, "height_px": 720, "ratio": 1.0, "px_per_mm": 3.5}
    wall = DisplayCalibration(**size, refresh_hz=60.0)
    save_display(display_file("wall"), wall)
    try:
        assert load_display_calibration("wall", True) == wall.model_dump(mode="json")
        display_file("wall").write_text(json.dumps({"version": 2}))
        with pytest.raises(FinloopError, match="another version"):
            load_display_calibration("wall", True)
    finally:
        display_file("wall").unlink()


def test_a_track_wants_a_protocol_with_animals(workspace, tmp_path, monkeypatch):
    known = {"goals": CONDITIONS["goals"]}
    path = protocol(tmp_path, animals=None, conditions=known)
    with pytest.raises(FinloopError, match="no live animals"):
        command(monkeypatch, "dry", path, "--animal", "track:0", "--out", tmp_path)


def test_the_length_of_a_fish_on_the_display_settles_its_scale(workspace, tmp_path):
    path = protocol(tmp_path, display={"calibrated": True, "fish_mm": 35.0})
    with open_scene(load_protocol(Path(path))) as scene:
        assert scene.context.mm_per_px * scene.context.length_px == pytest.approx(35.0)


def test_the_page_that_stands_alone_plays_the_edit_list(workspace):
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 640, "height": 480})
        bad = []
        page.on("pageerror", lambda error: bad.append(str(error)))
        page.on("request", lambda one: one.url.startswith(WITHIN) or bad.append(one.url))
        page.clock.install()
        page.goto((workspace / "data/export/stimulus.html").absolute().as_uri())
        pictures = []
        assert wait_for(lambda: page.evaluate("!!(drawer && drawer.box)"))
        hold_time(page)
        page.keyboard.press("Space")
        for _ in range(3):
            page.clock.run_for(400)
            pictures.append(page.screenshot())
        assert not bad and len(set(pictures)) == 3  # it moves
