"""A study: films named on the line or in a file, and the page with a row for each."""

import subprocess
import sys

import cv2
import numpy as np
import pytest
import yaml
from browser import chromium, visit

from finloop.base.errors import FinloopError
from finloop.report.study import COLUMNS, FilmResult, study_page, study_table
from stages.clones import claim_folder
from stages.compose import compose_params
from stages.study import clip_path_overrides, parse_study, read_numbers

MOUSE = {"clip.duration_s": 20.0, "extract.tracks": 9, "realism.hybrid_auc": 0.71}
PICTURE = cv2.imencode(".png", np.full((40, 60, 3), 200, np.uint8))[1].tobytes()


def write(tmp_path, text):
    (tmp_path / "study.yaml").write_text(text, encoding="utf-8")
    return str(tmp_path / "study.yaml")


def test_films_on_the_line_are_named_by_their_files(tmp_path):
    for name in ("a b.mp4", "c.mp4", "sub"):
        (tmp_path / name).mkdir()
    (tmp_path / "sub/c.mp4").mkdir()
    films, _ = parse_study(f"'{tmp_path}/a b.mp4' {tmp_path}/c.mp4 {tmp_path}/sub/c.mp4")
    assert list(films) == ["a-b", "c", "c-2"]
    assert films["a-b"] == ["clip=file", f'clip.path="{tmp_path}/a b.mp4"']


def test_a_file_names_films_with_settings_and_all_compose(tmp_path):
    (tmp_path / "mouse (1).mp4").mkdir()
    films, common = parse_study(write(tmp_path, """
        films:
          mouse: mouse (1).mp4
          pale: {path: mouse (1).mp4, extract.min_contrast_ratio: 0.3}
          carp: {clip: carp, clip.frames: 600, animate.goals: [[0.1, 0.2], [0.5, 0.6]]}
        settings: {animate.trials: 20}
    """))  # fmt: skip
    assert list(films) == ["mouse", "pale", "carp"]
    assert common == ["animate.trials=20"]
    for settings in films.values():
        assert "trials: 20" in compose_params(["~local", *common, *settings])


def test_any_name_of_a_film_composes_as_it_is(tmp_path):
    film = tmp_path / "Fühler, 3 ${HOME} #1 'a'.mp4"
    film.mkdir()
    text = compose_params(["~local", *clip_path_overrides(str(film))])
    assert yaml.safe_load(text)["clip"]["path"] == str(film)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("films: {}", "has no films"),
        ("- a", "has no films"),
        ("films: [x.mp4]", "no `name: path`"),
        ("films: [", "cannot be read"),
        ("films: {a: x.mp4, a: y.mp4}", "duplicate key a"),
        ("films: {a: x.mp4}\nfilms: {b: x.mp4}", "duplicate key films"),
        ("films:\n  a: x.mp4\n b: y.mp4", "line 3"),
        ("films: {a: '${'}", "cannot be read"),
        ("films: {a/b: x.mp4}", "more than letters"),
        ("films: {a: 3}", "neither a path nor settings"),
        ("films: {a: {1: 2}}", "is not a study"),
        ("films: {a: b}\nsettings: {path: 1}", "is not a study"),
        ("films: {a: {path: [x.mp4]}}", "neither a path nor settings"),
        ("films: {a: x.mp4}\nfilm: {}", "it has film"),
        ("films: {a: {clip: carp}, b: {clip: carp}}", "a and b are one film"),
    ],
)
def test_what_is_no_study_is_refused(tmp_path, text, said):
    with pytest.raises(FinloopError, match=said):
        parse_study(write(tmp_path, text))


def test_one_film_by_another_name_is_one_film_unless_its_settings_differ(tmp_path):
    film, link, copy, other = (tmp_path / name for name in ("a.mp4", "b.mp4", "c.mp4", "d.mp4"))
    film.write_bytes(b"film")
    link.symlink_to(film)
    copy.write_bytes(b"film")
    other.write_bytes(b"mlif")
    for again in (film, link, copy):
        with pytest.raises(FinloopError, match="are one film") as refusal:
            parse_study(f"{film} {again}")
        assert refusal.value.do == "take one of them out"
    assert len(parse_study(f"{film} {other}")[0]) == 2
    files = f"films: {{a: {film}, b: {{path: {copy}, bpn.epochs: 3}}}}"
    assert len(parse_study(write(tmp_path, files))[0]) == 2


def test_a_missing_film_or_file_is_refused(tmp_path):
    for text in (str(tmp_path / "gone.mp4"), str(tmp_path / "gone.yaml"), ""):
        with pytest.raises(FinloopError):
            parse_study(text)


def test_a_study_wants_the_folder_for_itself_and_clears_what_a_killed_one_left(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    left = tmp_path / ".dvc/tmp/sweep-1/0"
    left.mkdir(parents=True)
    other = [sys.executable, "-c", "input()", "stages.sweep"]
    with subprocess.Popen(other, stdin=subprocess.PIPE) as process:
        with pytest.raises(FinloopError, match=f"stages.sweep .process {process.pid}"):
            claim_folder("stages.study")
        assert left.exists()
    claim_folder("stages.study")
    assert not left.exists()


def test_the_table_has_a_row_for_each_film_also_for_one_that_failed():
    films = [FilmResult("mouse", ["clip=file"], MOUSE), FilmResult("bad", [], error="no fish")]
    table = study_table(films)
    assert list(table["film"]) == ["mouse", "bad"] and list(table["error"]) == ["", "no fish"]
    assert table["extract.tracks"].tolist()[0] == 9
    assert set(table) == {"film", "error", "settings", *(column.key for column in COLUMNS)}


def test_faults_of_film_fish_and_headings_are_counted_together():
    files = {
        "reports/extract/metrics.json": b'{"numbers": [{"number": "tracks", "value": 9}]}',
        "data/clip/findings.csv": b"what,verdict\nlight,good\nnoise,better otherwise\n",
        "data/features/findings.csv": b"what,verdict\nheadings,better otherwise\n",
    }
    assert read_numbers(files) == {"extract.tracks": 9.0, "film.findings": 2}


def test_the_page_sorts_and_filters(tmp_path):
    films = [
        FilmResult("b<b", ["clip=file"], MOUSE, {"found": PICTURE}, "study/b.html"),
        FilmResult("a10", [], MOUSE | {"extract.tracks": 30}),
        FilmResult("a9", [], error="no fish"),
    ]
    page = tmp_path / "study.html"
    page.write_text(study_page(films, ["animate.trials=20"]), encoding="utf-8")
    assert "b<b" not in page.read_text(encoding="utf-8")
    with chromium() as browser:
        seen = visit(browser, page)
        shown = seen.page
        names = "[...document.querySelectorAll('tbody tr')].filter(r => !r.hidden).map(r => r.cells[0].dataset.value)"
        heading = "thead th:nth-child(%d) button"
        shown.click(heading % 1)
        assert shown.evaluate(names) == ["a9", "a10", "b<b"]
        tracks = [column.key for column in COLUMNS].index("extract.tracks") + 3
        shown.click(heading % tracks)
        assert shown.evaluate(names) == ["b<b", "a10", "a9"]  # one that failed comes last
        shown.click(heading % tracks)
        assert shown.evaluate(names) == ["a10", "b<b", "a9"]
        shown.fill("#filter", "FILE")
        assert shown.evaluate(names) == ["b<b"]
        assert not seen.bad
