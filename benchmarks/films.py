"""The pipeline up to `render` on various films, with no parameter but the path.

`python -m benchmarks.films [FILM …]` draws carp as a fast, a slow, a flickering, a shaking, a
short, a large and a small film, and runs the pipeline on each of them and on the given films.
films.csv gets a row per film, which replaces the film's old row; a failed film has the reason.
`--realism` runs that stage, too; `--features` stops at that stage, and leaves the rest empty.
"""

import argparse
import re
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hydra.core.override_parser.types import Quote, QuotedString

from benchmarks.pipeline import ROOT, data_stages, prepare_folder, run_stage
from finloop.base.settings import settings
from finloop.drawn.carp.film import film_frames
from finloop.drawn.truth import TRUTH
from finloop.edit.modes import MODES
from finloop.io.movie import VideoWriter
from finloop.io.table import save_csv, save_table
from finloop.io.video import TRUTH_NAME

DRAWN: dict[str, dict[str, Any]] = {
    "1.4 s at 500 Hz": {"frames": 700, "frame_rate_hz": 500.0},
    "60 s at 12 Hz": {"frames": 720, "frame_rate_hz": 12.0},
    "98 frames": {"frames": 98},
    "40 px long, 40 s": {"frames": 1000, "body_length_px": 40.0},
    "400 px long, 12 s": {"frames": 300, "body_length_px": 400.0, "width_px": 1920,
                          "height_px": 1440},
    "light that flickers by 10 %, 16 s": {"frames": 400},
    "camera that shakes by 2 px, 16 s": {"frames": 400},
}  # fmt: skip
_RATE = 25
_TABLE = ROOT / "benchmarks/films.csv"


def disturb_film(disturbance: str, pictures: Iterator[np.ndarray]) -> Iterator[np.ndarray]:
    """Yield the pictures of a film with flickering light or from a shaking camera."""
    rng = np.random.default_rng(0)
    for picture in pictures:
        if "flickers" in disturbance:
            yield np.clip(picture * rng.uniform(0.9, 1.1), 0, 255).astype(np.uint8)
        else:
            yield np.roll(picture, rng.integers(-2, 3, 2), axis=(0, 1))


def drawn_film_overrides(name: str, folder: Path) -> list[str]:
    """Return the overrides of a drawn film; write the file of a disturbed film.

    The truth of the undisturbed film lies beside that file.
    """
    values = DRAWN[name]
    if "flickers" not in name and "shakes" not in name:
        return ["clip=carp", *(f"clip.{key}={value}" for key, value in values.items())]
    carp = settings("clip", source="carp", **values)
    path = folder / "film.mp4"
    truth: list[dict[str, Any]] = []

    def pictures() -> Iterator[np.ndarray]:
        for picture, rows in film_frames(carp):
            truth.extend(rows)
            yield np.asarray(picture)

    with VideoWriter(path, carp.width_px, carp.height_px, Fraction(_RATE), carp.colour) as writer:
        for picture in disturb_film(name, pictures()):
            writer.write(picture)
    save_table(path.with_name(TRUTH_NAME), pd.DataFrame(truth), TRUTH)
    return file_overrides(path)


def file_overrides(path: Path) -> list[str]:
    """Return the overrides for a film at this path, as Hydra reads them."""
    # `${` begins the name of another value; only the backslashes right before it count twice.
    name = re.sub(r"(\\*)\$\{", r"\1\1\\${", str(path.resolve()))
    return ["clip=file", f"clip.path={QuotedString(name, Quote.double).with_quotes()}"]


def run_pipeline(folder: Path, overrides: list[str], last_stages: list[str]) -> dict[str, Any]:
    """Run the pipeline on a film up to its last stages; return one row of the table."""
    prepare_folder(folder, [*overrides, "animate.trials=4"])
    numbers = {}
    for stage in data_stages(last_stages):
        numbers[stage] = run_stage(folder, stage)
        if stage == "clip" and (truth_file := folder / TRUTH_NAME).is_file():
            shutil.copyfile(
                truth_file, folder / "data/clip" / TRUTH_NAME
            )  # `features` compares with it
    features, animated = numbers["features"], numbers.get("animate", {})
    row = {
        "rows": features["fish_frames"],
        "delta_s": features["delta_s"],
        "heading_error_median_deg": features.get("truth_heading_error_median_deg"),
        "head_tail_swaps": features.get("truth_head_tail_swaps"),
        "heading_off_travel_median_deg": features.get("heading_off_travel_median_deg"),
        "heading_jumps_pct": features.get("heading_jumps_pct"),
        "film_share_pct": animated.get("matching_film_pct"),
        "video": (folder / "data/render/hybrid.mp4").is_file(),
    }
    for mode in MODES:
        for name in ("trials_goals_reached_pct", "seam_ratio_p95", "steps_above_film_p995_pct",
                     "longest_exact_repeat_s", "frames_outside"):  # fmt: skip
            row[f"{mode}_{name}"] = animated.get(f"{mode}_{name}")
        if "realism" in numbers:
            row[f"{mode}_auc"] = numbers["realism"].get(f"{mode}_auc")
    return row


def keep_row(row: pd.DataFrame) -> None:
    """Write the row of a film into the table, in place of its old row."""
    if _TABLE.is_file():
        table = pd.read_csv(_TABLE)
        row = pd.concat([table[table["film"] != row["film"].iloc[0]], row], ignore_index=True)
    save_csv(_TABLE, row, decimals=3)


def film_keys(films: Sequence[str]) -> list[str]:
    """Return the names of films in the table: file names without suffix, or paths if not unique."""
    stems = Counter(Path(film).stem for film in films)
    return [Path(film).stem if stems[Path(film).stem] == 1 else film for film in films]


def parse_arguments(command_line: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the parsed command line; exit with a message if a film is missing or unknown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("films", nargs="*")
    parser.add_argument("--realism", action="store_true", help="also run the stage realism")
    parser.add_argument("--features", action="store_true", help="only up to the stage features")
    parser.add_argument("--only", nargs="*", default=list(DRAWN), help="only these drawn films")
    parser.add_argument("--keep", type=Path, help="a working folder, which is kept")
    args = parser.parse_args(command_line)
    if strange := [name for name in args.only if name not in DRAWN]:
        parser.error(f"--only {strange}: unknown drawn films; choose from {list(DRAWN)}")
    if absent := [film for film in args.films if not Path(film).is_file()]:
        parser.error(f"no such files: {absent}")
    return args


def failure_reason(error: BaseException) -> str:
    """Return a line with the reason of a failure: the stage's message, else the last line."""
    lines = (str(error).strip() or repr(error)).splitlines()
    messages = [line.removeprefix("finloop: ") for line in lines if line.startswith("finloop: ")]
    return (messages or lines)[-1]


def measure_films(
    films: Sequence[tuple[str, list[str] | None]], folder: Path, last_stages: list[str]
) -> Iterator[dict[str, Any]]:
    """Yield a row for every film, given its key and overrides, None for a drawn film.

    A failed film only has its message under `failed`, and the next film begins.
    """
    for number, (key, overridden) in enumerate(films):
        place = folder / f"film-{number}"
        place.mkdir(parents=True, exist_ok=True)
        row = {"film": key if overridden else f"drawn carp, {key}"}
        try:
            row |= run_pipeline(place, overridden or drawn_film_overrides(key, place), last_stages)
        except (Exception, SystemExit) as error:  # the other films run anyway
            print(error, file=sys.stderr)
            row["failed"] = failure_reason(error)
        yield row


def main() -> None:
    """Run the pipeline on all films; print and write the table; exit with 1 if a film failed."""
    args = parse_arguments()
    last_stages = ["animate", "render", *(["realism"] if args.realism else [])]
    if args.features:
        last_stages = ["features"]
    given_films = zip(
        film_keys(args.films), (file_overrides(Path(film)) for film in args.films), strict=True
    )
    films: list[tuple[str, list[str] | None]] = [
        *((name, None) for name in args.only),
        *given_films,
    ]
    failures = 0
    with tempfile.TemporaryDirectory() as scratch:
        for row in measure_films(films, args.keep or Path(scratch), last_stages):
            print(pd.Series(row).to_string(), end="\n\n", flush=True)
            keep_row(pd.DataFrame([row]))
            failures += "failed" in row
    if failures:
        raise SystemExit(f"{failures} of {len(films)} films failed, see {_TABLE}")


if __name__ == "__main__":
    main()
