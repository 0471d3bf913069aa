"""Benchmarks: memory rises with the work, whatever the process that measures has held; films."""

import subprocess
import sys

import pandas as pd
import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from benchmarks import films
from benchmarks.pipeline import ROOT, peak_mib

HOLD = "held = b'x' * ({} << 20)"


def test_peak_memory_rises_with_what_a_process_holds():
    least, more, most = (peak_mib(ROOT, "-c", HOLD.format(size)) for size in (0, 100, 300))
    assert least < 60
    assert more - least == pytest.approx(100, abs=5)
    assert most - more == pytest.approx(200, abs=5)


def test_peak_memory_does_not_begin_at_that_of_the_process_that_asks():
    code = "from benchmarks.pipeline import *; print(peak_mib(ROOT, '-c', ''))"
    small, large = (
        float(subprocess.check_output([sys.executable, "-c", f"{hold}; {code}"], cwd=ROOT))
        for hold in ("pass", HOLD.format(500))
    )
    assert large == pytest.approx(small, abs=5)


def test_peak_memory_is_that_of_the_largest_process():
    """Also where the workers of a stage do the work."""
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {HOLD.format(200)!r}])"
    assert peak_mib(ROOT, "-c", code) > 200


def test_a_process_that_fails_has_no_peak():
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
    args = films.arguments([here, "--only", drawn])
    assert args.films == [here] and args.only == [drawn]
    assert films.arguments([here]).only == list(films.DRAWN)
    for line, wrong in (([here, absent], absent), ([here, "--only", drawn, here], here)):
        with pytest.raises(SystemExit):
            films.arguments(line)
        assert f"['{wrong}']" in capsys.readouterr().err


def test_films_of_one_name_have_rows_of_their_own():
    assert films.keys(["a/film.mp4", "b/film.mp4", "b/other.mp4"]) == [
        "a/film.mp4", "b/film.mp4", "other",
    ]  # fmt: skip


def test_a_film_that_fails_is_a_row_and_the_next_one_is_run(tmp_path, monkeypatch):
    def ended(folder, overridden, last):
        if overridden == ["bad"]:
            raise SystemExit("stage failed:\nfinloop: no fish\n  do:     take some")
        return {"rows": 7}

    monkeypatch.setattr(films, "ended", ended)
    monkeypatch.setattr(films, "_TABLE", tmp_path / "films.csv")
    for row in films.results([("one", ["bad"]), ("98 frames", None)], tmp_path, ["render"]):
        films.keep(pd.DataFrame([row]))
    table = pd.read_csv(tmp_path / "films.csv")
    assert list(table["film"]) == ["one", "drawn carp, 98 frames"]
    assert table["failed"][0] == "no fish" and table["rows"][1] == 7
    assert table["failed"].isna()[1] and table["rows"].isna()[0]
