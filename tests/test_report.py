"""The page: what it holds, that it needs nothing else, and that everybody can read it."""

import re
import shutil
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from browser import chromium, visit
from conftest import ROOT
from scratch import content, prepare, put_clip, write_frames

import stages.report
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.io.movie import Mp4Writer, load_film_below_size
from finloop.io.numbers import load_numbers
from finloop.io.picture import save_picture
from finloop.report.figures import CHAPTERS
from finloop.report.page import encode_webp, render_template
from finloop.report.tables import MEASURES, format_number, measures_table, mode_headline_numbers

FIGURES = [figure for chapter in CHAPTERS for figure in chapter.figures]
GREY = np.full((48, 64), 128, np.uint8)
PHONE = {"viewport": {"width": 360, "height": 740}}


def write_film(path: Path, frames: list[np.ndarray]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_frames(Mp4Writer(path, frames[0].shape, Fraction(25), 20), frames)


def fill(folder: Path) -> None:
    """What the stages before would have left: a film, some numbers, every picture but two."""
    rng = np.random.default_rng(1)
    put_clip(folder, [GREY] * 3)
    slope = np.tile(np.arange(320, dtype=np.uint8), (240, 1))
    moving = [np.roll(slope, 3 * k, 1) for k in range(50)]
    write_film(folder / "data/render/hybrid_marked.mp4", moving)
    for figure in FIGURES[2:]:
        save_picture(folder / "reports" / figure.path, rng.integers(0, 255, (90, 120, 3), np.uint8))
    beside = folder / "data/animate/beside"
    beside.mkdir(parents=True)
    measures_in_git().to_csv(beside / "measures.csv", index=False)
    (beside / "doubts.csv").write_text("mode,doubt\nLoops,reaches only 29 % of its random goals\n")
    for name in (
        "reports/animate/metrics.json", "reports/features/metrics.json", "reports/features/table1.csv",
        "benchmarks/table2.csv",
    ):  # fmt: skip
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)


def measures_in_git() -> pd.DataFrame:
    """The measures of all modes and of the film, from the numbers that git keeps."""
    columns: dict[str, dict[str, float]] = {name: {} for name in (*MODES, "film")}
    for name, value in load_numbers(ROOT / "reports/animate").items():
        mode, _, measure = name.partition("_")
        columns[mode][measure] = value
    return pd.DataFrame(columns).rename_axis("measure").reset_index()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path, "clip=carp", "bpn.hidden_units=7")
    fill(tmp_path)
    return tmp_path


# --- what is shown


def test_every_picture_of_the_pipeline_is_declared_once():
    paths = [figure.path for figure in FIGURES]
    assert len(set(paths)) == len(paths) and len({figure.id for figure in FIGURES}) == len(paths)
    pipeline = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    made = {
        out.removeprefix("reports/")
        for stage in pipeline.values()
        for out in stage.get("outs", [])
        if out.startswith("reports/") and out != "reports/index.html"
    }
    assert {out for out in made if not any(path.startswith(out) for path in paths)} == set()
    assert {path for path in paths if not path.startswith(tuple(made))} == set()


def test_figures_say_what_they_show():
    for figure in FIGURES:
        assert len(figure.alt) > 20 and figure.caption.endswith("."), figure.path
        assert figure.alt != figure.caption
    numbers = {figure.number for figure in FIGURES}
    for wanted in ("3", "4", "5", "7", "9", "10", "11", "12", "13", "14", "15", "16", "17"):
        assert any(re.search(rf"\b{wanted}\b", one) for one in numbers), wanted


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (1.0, "1"), (7312, "7,312"), (0.12345, "0.12"), (12.345, "12.3"), (1.5e-6, "1.50e-06"),
     (-3.14159, "-3.14"), (float("nan"), ""), (None, ""), ("several hours", "several hours")],
)  # fmt: skip
def test_numbers_are_short(value, text):
    assert format_number(value) == text


def test_measures_name_what_there_is_and_give_the_film_its_own_halves():
    found = measures_in_git()
    table = measures_table(found)
    missing = {one.key for one in MEASURES} - {*found["measure"]}
    assert len(table.rows) == len(MEASURES) - len(missing)
    assert all(key.startswith("path_") for key in missing)  # it was sent to goals
    assert {len(row) for row in table.rows} == {len(table.columns)} == {len(MODES) + 3}
    (speed,) = [row for row in table.rows if row[0].startswith("speed")]
    halves = found.set_index("measure").loc["speed_halves_kinematic_distance_sd", "film"]
    assert speed[len(MODES) + 1] == format_number(halves) != ""
    assert measures_table(found.drop(columns="loops")).columns[1:3] == ["Network", "Hybrid"]


def test_the_headline_leaves_out_what_was_not_measured():
    assert mode_headline_numbers({"network_goals_reached_pct": 50.0}, "network") == [
        ("50 %", "of its goals reached")
    ]


def test_values_are_escaped(tmp_path: Path):
    effects = {"caption": "<script>", "columns": ["<b>"], "rows": [["<i>", "&", ""]]}
    row = {"name": "<u>", "best": False, "commit": "", "values": [0.5], "texts": ["<s>"]}
    text = render_template(
        "compare.html.j2",
        {"title": "</title>", "texts": ["<q>"], "effects": effects, "charts": [("</script>", '{"a":"</script>"}')],
         "rows": [row], "parameters": ["<ins>"], "measures": [], "same": ["<del>"], "fronts": [], "previews": {},
         "seeds": False, "chance": "5%", "no_effect": "", "axes": "{}", "plotly": ""},
    )  # fmt: skip
    for raw in ("<b>", "<i>", "<u>", "<s>", "<q>", "<ins>", "<del>", "</title>:"):
        assert raw not in text
    assert text.count("</script>") == 2  # the page's own


def test_a_picture_becomes_small_and_keeps_its_shape():
    wide = encode_webp(np.zeros((300, 900, 3), np.uint8), 300, 80)
    assert (wide.width, wide.height) == (300, 100)
    assert encode_webp(GREY, 300, 80)[1:] == (64, 48)


def test_a_film_is_made_smaller_only_if_it_must(tmp_path: Path):
    path = tmp_path / "film.mp4"
    noise = np.random.default_rng(0).integers(0, 255, (2, 240, 800), np.uint8)
    write_film(path, [*noise])
    size = path.stat().st_size
    film, poster = load_film_below_size(path, size)
    assert film == path.read_bytes() and poster.shape == (240, 800, 3)
    less, _ = load_film_below_size(path, size // 2)
    assert len(less) <= size // 2
    assert load_film_below_size(path, size // 2)[0] == less  # the same bytes each time
    with pytest.raises(FinloopError, match="max_film_mb"):
        load_film_below_size(path, 1000)


# --- the stage


def test_stage_makes_one_whole_page_the_same_each_time(folder: Path):
    stages.report.main()
    first = content(folder / "reports")
    numbers = load_numbers(folder / "reports/report")
    assert numbers["figures"] == len(FIGURES) - 2  # those that are missing are left out
    page = (folder / "reports/index.html").read_text()
    assert "-S &#39;clip=carp&#39; -S &#39;bpn.hidden_units=7&#39;" in page
    assert "Table 2" in page and "several hours" in page and "drawn carp" in page
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
    stages.report.main()
    assert content(folder / "reports") == first
    prepare(folder, "clip=carp", "report.max_page_mb=0.01")
    with pytest.raises(FinloopError, match="max_page_mb"):
        stages.report.main()
    assert content(folder / "reports") == first


def test_a_page_that_is_too_large_gets_narrower_pictures_and_is_refused_at_last(folder: Path):
    settings, widths = stages.report.load_settings("report"), list[int]()

    def make_page(p):
        widths.append(p.max_picture_width_px)
        return bytes(p.max_picture_width_px * 1000), 3

    assert stages.report.fit_page(make_page, settings)[1] == 3 and len(widths) == 1
    page, _ = stages.report.fit_page(make_page, replace(settings, max_page_mb=0.9))
    assert len(page) < 0.9e6 and widths == sorted(widths, reverse=True)
    with pytest.raises(FinloopError, match="600 px wide"):
        stages.report.fit_page(make_page, replace(settings, max_page_mb=0.5))


CONTRAST = """() => {
  const light = c => { const [r, g, b] = c.match(/[\\d.]+/g).map(Number).map(v => (v /= 255) <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4);
    return .2126 * r + .7152 * g + .0722 * b; };
  const behind = e => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor; if (!/, 0\\)$/.test(c)) return c; } return "rgb(255,255,255)"; };
  return Math.min(...[...document.querySelectorAll("h1,h2,h3,p,a,td,th,dt,dd,summary,strong,.number")].filter(e => e.offsetParent && !e.closest("dialog")).map(e => {
    const [a, b] = [light(getComputedStyle(e).color), light(behind(e))].sort((x, y) => y - x); return (a + .05) / (b + .05); })); }"""


def test_faults_of_the_film_are_doubtful_and_its_virtues_are_not(folder: Path):
    for stage in ("clip", "extract"):
        Path(f"data/{stage}").mkdir(parents=True, exist_ok=True)
        Path(f"data/{stage}/findings.csv").write_text(
            "what,verdict,measured,what to do\n"
            f"a,good,{stage} is well,\nb,better otherwise,{stage} is bad.,Mend {stage}.\n"
        )
    stages.report.main()
    page = Path("reports/index.html").read_text()
    head = page[: page.index('id="animation"')]
    assert "clip is bad. Mend clip." in head and "extract is bad. Mend extract." in head
    assert "is well" not in head and "extract is well" in page


def test_a_fault_that_is_seen_in_a_frame_has_its_picture_beside_it(folder: Path):
    Path("data/clip/findings.csv").write_text(
        "film,what,verdict,measured,what to do\n"
        "1,a,better otherwise,It is bad.,Mend it.\n2,a,better otherwise,It is late.,Hurry.\n"
    )
    home = Path("reports/film/findings")
    save_picture(home / "1_a.png", np.zeros((6, 8, 3), np.uint8))
    (home / "pictures.csv").write_text("film,what,picture,caption\n1,a,1_a.png,Frame 7: a fault.\n")
    stages.report.main()
    page = Path("reports/index.html").read_text()
    head, rest = page.split('id="animation"', 1)
    bad, late = (row for row in head.split("<tr>") if "It is" in row)
    assert "It is bad. Mend it." in bad and "data:image/webp" in bad
    assert "<figcaption>Frame 7: a fault.</figcaption>" in bad
    assert "It is late. Hurry." in late and "<img" not in late and "Frame 7" not in rest


def test_in_a_browser_nothing_is_missing_and_everybody_can_read_it(folder: Path):
    stages.report.main()
    with chromium() as browser:
        for how in ({"color_scheme": "light"}, {"color_scheme": "dark", **PHONE}):
            seen = visit(browser, folder / "reports/index.html", **how)
            page = seen.page
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
            assert page.evaluate(CONTRAST) >= 4.5
            page.evaluate("for (const one of document.images) one.loading = 'eager'")
            page.evaluate(
                "Promise.all([...document.images].filter(i => i.src).map(i => i.decode()))"
            )
            assert seen.bad == []
        assert page.locator("main figure img").count() == len(FIGURES) - 2
        assert page.locator("main img:not([alt]), main img[alt='']").count() == 0
        levels = page.evaluate("[...document.querySelectorAll('h1,h2,h3')].map(h => +h.tagName[1])")
        assert levels.count(1) == 1 and np.diff(levels).max() <= 1
        for mark in ("header", "nav", "main", "footer"):
            assert page.locator(mark).count() == 1
        links = page.evaluate(
            "[...document.querySelectorAll('a')].map(a => a.hash).filter(Boolean)"
        )
        assert all(page.locator(link).count() == 1 for link in links)
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.className") == "skip"
        jumped = """async () => { const v = document.querySelector("video");
            if (v.readyState < 1) await new Promise(done => v.onloadedmetadata = done);
            v.currentTime = 1; await new Promise(done => v.onseeked = done); return [v.duration, v.currentTime]; }"""
        assert page.evaluate(jumped) == pytest.approx([2, 1], abs=0.05)
        page.locator(".zoom").first.focus()
        page.keyboard.press("Enter")
        assert page.locator("dialog[open] img").get_attribute("alt") == FIGURES[2].alt
        page.keyboard.press("Escape")
        assert page.locator("dialog[open]").count() == 0
        assert seen.bad == []
        faulty = folder / "faulty.html"  # what is wrong would have been told
        faulty.write_text(
            '<img src="none.png"><script src="http://localhost:9/x.js"></script><script>nothing()</script>'
        )
        bad = " ".join(visit(browser, faulty).bad)
        assert all(word in bad for word in ("none.png", "localhost:9", "nothing is not defined"))
