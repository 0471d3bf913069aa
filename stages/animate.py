"""Stage `animate`: compare the animations of all modes by the same measures as the film."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from contextlib import suppress
from pathlib import Path

import pandas as pd

from finloop.animate import encounters, measures
from finloop.animate.motion import MotionStatistics, learn_motion
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import whole_folder
from finloop.io.record import load_json, remake_hint
from finloop.io.table import load_table, save_csv, save_table
from finloop.modes.phases import learn_phases, state_shares
from finloop.plan import path_measures
from finloop.project import Project
from finloop.social.measures import SHOAL, compare_groups, measure_group, split_in_halves
from finloop.social.walls import Walls

ANIMATE, OUT, REPORT = Path("data/animate"), Path("data/animate/beside"), Path("reports/animate")
ENOUGH_REACHED_PCT = 90.0  # a mode that reaches fewer goals becomes a finding


def _played_modes() -> list[str]:
    """Return the names of the modes that have an animation."""
    return [mode for mode in MODES if (ANIMATE / mode / "measures.json").exists()]


def _load_mode_numbers(mode: str) -> dict[str, float]:
    """Return the measures of a mode's animation and of its random trials, by name."""
    numbers: dict[str, float] = {}
    for name in ("measures", "trials"):
        numbers |= load_json(ANIMATE / mode / f"{name}.json", dict, *remake_hint(f"modes-{mode}"))
    return numbers


def _measure_film(
    project: Project, statistics: MotionStatistics, motion: tuple
) -> dict[str, float]:
    """Measure the film in the same way as the modes; return the numbers by name.

    statistics: how the film's fish swim. motion: speed and turn rate of the film's rows.
    """
    features, rate = project.features, project.rate_hz
    steps = project.step_distances[["headed", "as_filmed"]].dropna()["as_filmed"].to_numpy(float)
    numbers = measures.measure_film(features, motion, steps, statistics)
    with suppress(FinloopError):  # the film shows no straight swimming
        phases = learn_phases(features, rate, statistics.delta, project.settings("network"))
        numbers |= state_shares(features, phases)
    if project.settings("matching").fish > 1:
        numbers |= encounters.measure_film_clearance(features)
    return numbers | {"drawn_size": min(map(project.drawn_scale, _played_modes()), default=1.0)}


def compare_schools(project: Project) -> pd.DataFrame:
    """Compare the fish of mode `matching` with the film's; return a row per measure.

    The columns are those of `compare_groups`. The half of the film to which zones are fitted is
    compared in the same way. The table is empty for a single fish.
    """
    if project.settings("matching").fish == 1 or "matching" not in _played_modes():
        return compare_groups({}, {})
    film = load_table(Path("data/calibrate/film.parquet"), SHOAL)
    first, second = split_in_halves(film)
    columns = ["tick", "x_px", "y_px", "heading_deg"]
    edit = load_table(ANIMATE / "matching.parquet", EDIT, columns)
    length_px = project.drawn_scale("matching") * float(project.features["body_length_px"].median())
    walls = Walls(project.arena, length_px)
    shoal = measure_group(
        edit["tick"].to_numpy(), edit[["x_px", "y_px"]].to_numpy(float),
        edit["heading_deg"].to_numpy(float), walls,
    )  # fmt: skip
    return compare_groups(
        {"film": film, "second_half": second}, {"first_half": first, "matching": shoal}
    )


def find_doubts(numbers: dict[str, dict[str, float]]) -> pd.DataFrame:
    """Return a table of what is doubtful about the modes: columns mode, doubt (a sentence).

    numbers: mode → measures by name, of the modes that have an animation.
    """
    rows: list[tuple[str, str]] = []
    for mode, described in MODES.items():
        if mode not in numbers:
            reason = ANIMATE / mode / "reason.json"
            why = load_json(reason, dict, *remake_hint(f"modes-{mode}"))["reason"]
            rows.append((described.title, why))
            continue
        reached = numbers[mode].get("trials_goals_reached_pct", 100.0)
        if reached < ENOUGH_REACHED_PCT:
            rows.append((described.title, f"reaches only {reached:.0f} % of its random goals"))
        if not numbers[mode].get("trials_film_pct", 100.0) and mode == "hybrid":
            why = "never shows the film: too few gateways lead there and back; "
            rows.append((described.title, why + "raise gateways.distance_threshold"))
    return pd.DataFrame(rows, columns=["mode", "doubt"])


def main() -> None:
    """Compare the animations of all modes with the film; write tables and metrics of them."""
    with Project() as project:
        features = project.features
        motion = learn_motion(features, project.rate_hz, infer_delta_frames(features))
        film_motion = measures.motion_of_film(features, motion)
        numbers = {mode: _load_mode_numbers(mode) for mode in _played_modes()}
        film = _measure_film(project, motion, film_motion)
        schools = compare_schools(project)
    parts = [measures.kinematics_table({measures.FILM_MOTION: film_motion})]
    for mode in numbers:
        parts.append(load_table(ANIMATE / mode / "motion.parquet", measures.KINEMATICS))
    with whole_folder(OUT) as folder:
        together = pd.concat(parts, ignore_index=True)
        save_table(folder / "kinematics.parquet", together, measures.KINEMATICS)
        left = ANIMATE / "matching/left.parquet"
        lost = load_table(left, path_measures.LEFT) if left.exists() else path_measures.LEFT.empty()
        beside = pd.DataFrame({**numbers, "film": film}).rename_axis("measure").reset_index()
        tables = {
            "company": schools, "left": lost, "measures": beside, "doubts": find_doubts(numbers),
        }  # fmt: skip
        for name, table in tables.items():
            save_csv(folder / f"{name}.csv", table, decimals=3)
    beside_film = numbers | {"film": film}
    save_metrics(REPORT / "metrics.json", {
        f"{mode}_{name}": value
        for mode, measured in beside_film.items() for name, value in measured.items()
    })  # fmt: skip


if __name__ == "__main__":
    run(main)
