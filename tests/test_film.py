"""`make film`: any path gets into conf/local/default.yaml and out of params.yaml as it is."""

import shlex
import shutil
import subprocess
import webbrowser
from pathlib import Path

import pytest
import yaml
from conftest import ROOT

from finloop.base.errors import FinloopError
from stages import film
from stages.settings import CONF, LOCAL, PARAMS

ODD = 'my "best" film\'s Fühler, 3 ${HOME} $x #1: [a].mp4'


def put(folder: Path, *names: str) -> list[str]:
    for name in names:
        (folder / name).mkdir()  # of pictures
    return [str(folder / name) for name in names]


def test_a_path_is_taken_as_it_is_and_several_between_spaces(tmp_path, monkeypatch):
    odd, plain, spaced = put(tmp_path, ODD, "a.mp4", "b c.mp4")
    assert film.parse_film_paths(odd) == [odd]
    assert film.parse_film_paths(spaced) == [spaced]
    assert film.parse_film_paths(f"{plain} '{spaced}'") == [plain, spaced]
    assert film.parse_film_paths(shlex.join([odd, plain])) == [odd, plain]
    monkeypatch.chdir(tmp_path)
    assert film.parse_film_paths("a.mp4") == [plain]  # a whole path, wherever the pipeline runs
    assert film.parse_film_paths(f"{tmp_path}/*.mp4") == [f"{tmp_path}/*.mp4"]


@pytest.mark.parametrize(
    ("text", "said"),
    [("", "names no film"), ("gone.mp4", "nothing at .*gone.mp4"), ("it's gone.mp4", "quot"),
     ("/gone/*.mp4", "matches no file")],
)  # fmt: skip
def test_what_is_no_film_is_said(text, said):
    with pytest.raises(FinloopError, match=said):
        film.parse_film_paths(text)


def test_every_path_comes_out_of_params_as_it_went_in(tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / CONF, tmp_path / CONF, ignore=shutil.ignore_patterns("default.yaml.*"))
    (tmp_path / LOCAL).unlink(missing_ok=True)
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    films = put(tmp_path, ODD, "b c.mp4")
    monkeypatch.setenv("FILM", films[0])
    monkeypatch.setattr(film.sys, "argv", ["film", "animate.seconds=7"])
    film.main()
    values = yaml.safe_load(PARAMS.read_text(encoding="utf-8"))
    assert values["clip"]["path"] == films[0] and values["clip"]["source"] == "file"
    assert values["animate"]["seconds"] == 7
    monkeypatch.setenv("FILM", shlex.join(films))
    film.main()
    assert yaml.safe_load(PARAMS.read_text(encoding="utf-8"))["clip"]["path"] == films
    assert "before" not in capsys.readouterr().out  # what `make film` wrote needs no backup


def test_settings_by_hand_are_kept_or_backed_up(tmp_path):
    local = tmp_path / "default.yaml"
    film.name_films(["/a.mp4"], local)
    by_hand = local.read_text() + "extract:\n  noise_sigmas: 5.0\n"
    local.write_text(by_hand)
    assert "left as it is" in film.name_films(["/a.mp4"], local)
    assert local.read_text() == by_hand
    for number, other in enumerate(("/b.mp4", "/c.mp4"), 1):
        local.write_text(by_hand)
        backup = tmp_path / f"default.yaml.before-{number}"
        assert str(backup) in film.name_films([other], local)
        assert backup.read_text() == by_hand and local.read_text() == film.local_conf_text([other])
    local.write_text("clip: [")
    assert "before-3" in film.name_films(["/a.mp4"], local)


def test_make_hands_the_path_over_as_it_is(tmp_path):
    odd = ODD.replace("${HOME}", "$HOME")
    told = subprocess.run(
        ["make", "-n", "film", f"FILM={odd}", f"VENV={tmp_path}/venv", "PYTHON=python3"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    (line,) = [line for line in told.stdout.splitlines() if line.startswith("FILM=")]
    assert shlex.split(line)[0] == f"FILM={odd}"


@pytest.mark.parametrize("words", [["FILM=a.mp4", "b c.mp4"], ["FILM=my", "film.mp4"], ["a.mp4"]])
def test_a_film_beside_the_variable_is_not_left_out_in_silence(words, tmp_path):
    put(tmp_path, "b c.mp4", "a.mp4")
    line = ["make", "-n", "-C", str(tmp_path), "-f", str(ROOT / "Makefile"), "film", *words]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode
    assert f"{words[-1]} is not part of FILM" in done.stderr and "in quotes" in done.stderr


def test_the_report_is_named_and_opened_on_a_desktop_alone(tmp_path, monkeypatch, capsys):
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(film.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for screen, wanted in ((False, []), (True, [(tmp_path / "index.html").as_uri()])):
        if screen:
            monkeypatch.setenv("DISPLAY", ":0")
        film.show_report(tmp_path / "index.html")
        assert opened == wanted and str(tmp_path / "index.html") in capsys.readouterr().out
