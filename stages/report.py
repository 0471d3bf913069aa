"""Stage `report`: show all results on one page, reports/index.html."""

from stages.run import THREADS, run, save_metrics  # isort: skip  (before numpy)

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.finding import FINDINGS_NAME
from finloop.base.parallel import Threads, ordered_map
from finloop.base.settings import WORDS
from finloop.edit.modes import MODES
from finloop.io.atomic import save_bytes
from finloop.io.findings import load_faults
from finloop.io.movie import load_film_below_size
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture
from finloop.io.table import load_csv
from finloop.io.video import FACTS_NAME, VideoFacts, load_facts
from finloop.report.figures import CHAPTERS, Chapter, Figure
from finloop.report.page import WebP, data_uri, encode_webp, render_template
from finloop.report.settings import ReportSettings
from finloop.report.tables import (
    Table,
    format_number,
    headline_table,
    measures_table,
    mode_headline_numbers,
    table_of_data_frame,
)
from stages.settings import list_overrides, load_settings, read_params

REPORTS, CLIP, RENDER = Path("reports"), Path("data/clip"), Path("data/render")
EXTRACT, FEATURES = Path("data/extract"), Path("data/features")
FAULTS = REPORTS / "film/findings"  # pictures of faults of the film
TIMES = Path("benchmarks/table2.csv")
_NARROWEST_PX = 600  # width to which pictures of too large a page are reduced
TIMES_TITLE = "Table 2: computing times, as `python -m benchmarks.table2` measured them once"
OUT, METRICS = REPORTS / "index.html", REPORTS / "report/metrics.json"
SOURCES = {
    "zebrafish": (
        "Real zebrafish",
        "The zebrafish footage comes from the package idtrackerai (GPL-3.0-or-later) and stays its "
        "authors': who hands this page on hands on their footage. The program's licence is MIT.",
    ),
    "carp": ("A drawn carp", "The program draws the carp; both are under the MIT licence."),
    "file": ("Own footage", "The footage stays its authors'. The program's licence is MIT."),
}
TANK, BESIDE = Path("data/tank/tank.html"), Path("data/animate/beside")
TABLES = {  # by chapter
    "filmed": (
        ("data/extract/films.csv", "The films, and how their fish are matched to the first film's"),
        ("reports/features/table1.csv", "Table 1: the film's fish in every orientation"),
        ("data/sprites/table1_after.csv", "Table 1 after synthesis: the sprites"),
    ),
    "swimming": (
        (
            "data/realism/auc.csv",
            "Told by its motion and by its picture: AUC, and loss without a channel",
        ),
    ),
    "curves": (
        ("data/morph/connection.csv", "Tables 1, 2 of the curve paper: connection coefficients"),
        ("data/morph/folds.csv", "Frames in which a contour crosses itself"),
    ),
    "gait": (
        ("data/gait/by_contour.csv", "Errors of six clocks on held-out frames, in body lengths"),
        ("data/gait/gamma.csv", "γ of limbs, beside the true one"),
    ),
    "checks": (
        (f"{CLIP}/{FINDINGS_NAME}", "Quality of the film, with advice"),
        (f"{EXTRACT}/{FINDINGS_NAME}", "How its animals are seen, with advice"),
        (f"{FEATURES}/{FINDINGS_NAME}", "Its rate, with advice"),
    ),
}


def _load_webp(path: Path, p: ReportSettings) -> WebP:
    """Return a picture file as WebP, reduced to the report's largest width."""
    return encode_webp(load_picture(path), p.max_picture_width_px, p.picture_quality)


def _load_chapters(
    p: ReportSettings,
) -> Iterator[tuple[Chapter, list[tuple[Figure, WebP]], list[Table]]]:
    """Yield each chapter of the report that has pictures, with its pictures and tables.

    A picture or table whose file is missing is left out.
    """
    for chapter in CHAPTERS:
        figures = [figure for figure in chapter.figures if (REPORTS / figure.path).is_file()]
        paths = [REPORTS / figure.path for figure in figures]
        coded = ordered_map(partial(_load_webp, p=p), paths, Threads(THREADS))
        pictures = list(zip(figures, coded, strict=True))
        tables = [
            table_of_data_frame(load_csv(Path(path)), caption)
            for path, caption in TABLES.get(chapter.id, ())
            if Path(path).is_file()
        ]
        if pictures:
            yield chapter, pictures, tables


def _describe_film(facts: VideoFacts, source: str, features: Mapping[str, float]) -> str:
    """Return sentences on the film: origin, frames, size, and lengths in mm where known.

    source: where the clip is from, a key of SOURCES. features: numbers of the stage `features`.
    """
    fish = f", {features['fish_frames']:,} pictures of fish" if features else ""
    size = f"{facts.width_px}×{facts.height_px} px at {facts.frame_rate_hz:.4g} Hz"
    scale = ""
    if "body_length_median_mm" in features:
        wide, high = (format_number(features[f"tank_{side}_mm"]) for side in ("width", "height"))
        length = format_number(features["body_length_median_mm"])
        speed = format_number(features.get("speed_median_mm_s"))
        scale = f"The picture is {wide}×{high} mm, an animal {length} mm long; "
        scale += f"its median speed is {speed} mm/s. " if speed else ""
    return (
        f"{SOURCES[source][0]}: {facts.frames:,} frames of {size}{fish}. {scale}"
        "From them, an animation that swims where it is sent."
    )


def _list_doubts() -> pd.DataFrame:
    """Return a table of all doubtful results: first those of films, then those of modes.

    Columns: about (film or mode), doubt (a sentence), picture (file in FAULTS) and caption. The
    last two are NaN where no frame shows the fault.
    """
    faults = load_faults([FEATURES, CLIP, EXTRACT])  # heads that may be tails come first
    if (path := FAULTS / "pictures.csv").is_file():
        pictures = load_csv(path, as_text=True)
        faults = faults.merge(pictures, "left", ["film", "what"])
    faults["about"] = faults["film"].replace("", "The film")
    faults["doubt"] = faults["measured"] + " " + faults["what to do"]
    tables = [faults, load_csv(BESIDE / "doubts.csv").rename(columns={"mode": "about"})]
    doubts = pd.concat(tables, ignore_index=True)
    return doubts.reindex(columns=["about", "doubt", "picture", "caption"])


def _describe_animation(mode: str, marks: bool) -> str:
    """Return the text that stands below the animation's film on the report.

    mode: of the animation, or "retarget". marks: whether goals and path are drawn in the film.
    """
    if mode == "retarget":
        does, shown = "The fish swims as another animal did", "The line is its path"
    else:
        does = f"The fish swims to its goals in turn (mode {mode}), then wanders"
        shown = "Rings are goals, the line is its path"
    return f"{does}. No sound." + (f" {shown}." if marks else "")


def _comparison_film(p: ReportSettings) -> dict[str, Any]:
    """Return the template's values for the film that shows all modes side by side.

    Without such a film the field `beside` is "".
    """
    fields: dict[str, Any] = {"beside": "", "modes": list(MODES.values())}
    path = RENDER / "modes.mp4"
    if path.is_file():
        film, poster = load_film_below_size(path, round(p.max_film_mb * 1e6 / 2))
        fields |= {
            "beside": data_uri("video/mp4", film),
            "beside_poster": encode_webp(poster, p.max_picture_width_px, p.picture_quality),
        }
    return fields


def _list_parameters(
    values: Mapping[str, Mapping[str, Any]], changes: list[str]
) -> dict[str, list[tuple[str, str, bool]]]:
    """Return, by group, each parameter's name, value as text, and whether it differs from conf/.

    values: by group and name. changes: what is not as in conf/, as overrides `group.name=value` or
    `group=variant`; the latter marks all parameters of the group.
    """
    changed = {change.partition("=")[0] for change in changes}
    return {
        group: [
            (name, json.dumps(value).strip('"'), bool({f"{group}.{name}", group} & changed))
            for name, value in parameters.items()
        ]
        for group, parameters in values.items()
    }


def main() -> None:
    """Write reports/index.html, the page of all results, and metrics to reports/report/.

    FinloopError if the page is larger than `report.max_page_mb` even with the narrowest pictures.
    """
    page, figures = fit_page(_make_page, load_settings("report"))
    save_bytes(OUT, page)
    save_metrics(METRICS, {"figures": figures})


def fit_page(
    make_page: Callable[[ReportSettings], tuple[bytes, int]], p: ReportSettings
) -> tuple[bytes, int]:
    """Return the page that `make_page` makes, with pictures so narrow that it is small enough.

    make_page: returns the page and its number of figures. FinloopError if the page is larger than
    `p.max_page_mb` even with pictures of _NARROWEST_PX. Each try makes the whole page again.
    """
    page, figures = make_page(p)
    while len(page) > p.max_page_mb * 1e6:
        if p.max_picture_width_px <= _NARROWEST_PX:
            raise FinloopError(
                f"the page would be {len(page) / 1e6:.1f} MB, with pictures"
                f" {p.max_picture_width_px} px wide",
                f"at most {p.max_page_mb:.1f} MB (report.max_page_mb)",
                "lower report.max_film_mb, or raise report.max_page_mb",
            )
        width_px = max(_NARROWEST_PX, round(0.8 * p.max_picture_width_px))
        p = replace(p, max_picture_width_px=width_px)
        page, figures = make_page(p)
    return page, figures


def _make_page(p: ReportSettings) -> tuple[bytes, int]:
    """Return the page of all results, and how many figures it has."""
    params = read_params()
    values = {word: params[word] for word in WORDS}  # without groups on which no result depends
    mode, source = values["render"]["mode"], values["clip"]["source"]
    marked_film = RENDER / f"{mode}_marked.mp4"
    film_path = marked_film if marked_film.is_file() else RENDER / f"{mode}.mp4"
    film, poster = load_film_below_size(film_path, round(p.max_film_mb * 1e6))
    numbers = {word: load_numbers(REPORTS / word) for word in values if word != "report"}
    chapters, changes = list(_load_chapters(p)), list_overrides(values)
    doubts = _list_doubts()
    page = _comparison_film(p) | {
        "title": "A fish, filmed once and steered for ever",
        "facts": _describe_film(load_facts(CLIP / FACTS_NAME), source, numbers["features"]),
        "film": data_uri("video/mp4", film),
        "poster": encode_webp(poster, p.max_picture_width_px, p.picture_quality),
        "film_text": _describe_animation(mode, film_path == marked_film),
        "headline": mode_headline_numbers(numbers["animate"] | numbers["realism"], mode),
        "doubts": table_of_data_frame(doubts[["about", "doubt"]], "What is doubtful"),
        "faults": {  # by row of the doubts
            row: {"picture": _load_webp(FAULTS / fault["picture"], p), "caption": fault["caption"]}
            for row, fault in doubts.dropna().iterrows()
        },
        "measures": measures_table(load_csv(BESIDE / "measures.csv")),
        "sections": chapters,
        "table_2": table_of_data_frame(load_csv(TIMES), TIMES_TITLE, 3),
        "tank": f"../{TANK.as_posix()}" if TANK.is_file() else "",
        "parameters": _list_parameters(values, changes),
        "commands": [
            "make setup",
            ".venv/bin/dvc exp run" + "".join(f" -S '{change}'" for change in changes),
            "xdg-open reports/index.html",
        ],
        "numbers": [headline_table(part, stage) for stage, part in numbers.items() if part],
        "licence": SOURCES[source][1],
    }
    text = render_template("report.html.j2", page).encode()
    return text, sum(len(pictures) for _, pictures, _ in chapters)


if __name__ == "__main__":
    run(main)
