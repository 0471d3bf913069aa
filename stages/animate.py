"""Stage `animate`: compare the animations of all modes by the same measures as the film."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import pandas as pd

from finloop.animate import encounters, measures
from finloop.animate.motion import MotionStatistics, learn
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT
from finloop.features.table import delta_of
from finloop.io.atomic import whole_folder
from finloop.io.record import load_json, remake_hint
from finloop.io.table import load_table, save_csv, save_table
from finloop.modes.phases import learn_phases, state_shares
from finloop.plan import path_measures
from finloop.project import Project
from finloop.social.measures import SHOAL, compare_groups, halves, shoal_table
from finloop.social.walls import Walls

ANIMATE, OUT, REPORT = Path("data/animate"), Path("data/animate/beside"), Path("reports/animate")
ENOUGH_REACHED_PCT = 90.0  # a mode that reaches fewer goals becomes a finding


def played_modes() -> list[str]:
    """Return the modes that have an animation."""
    return [mode for mode in MODES if (ANIMATE / mode / "measures.json").exists()]


def mode_numbers(mode: str) -> dict[str, float]:
    """Return the measures of a mode's animation and of its random trials, name → number.

    They come from data/animate/<mode>/measures.json and trials.json.
    """
    numbers: dict[str, float] = {}
    for name in ("measures", "trials"):
        numbers |= load_json(ANIMATE / mode / f"{name}.json", dict, *remake_hint(f"modes-{mode}"))
    return numbers


def film_numbers(project: Project, motion: MotionStatistics, moved: tuple) -> dict[str, float]:
    """Return the measures of the film that can be compared with those of the modes, name → number.

    motion: statistics of the film's motion; moved: speeds and turn rates from
    `measures.motion_of_film`.
    """
    features, rate = project.features, project.rate_hz
    steps = project.steps[["headed", "as_filmed"]].dropna()
    numbers = measures.measure_film(features, moved, steps["as_filmed"].to_numpy(float), motion)
    try:
        phases = learn_phases(features, rate, motion.delta, project.settings("network"))
        numbers |= state_shares(features, phases)
    except FinloopError:  # the film shows no straight swimming
        pass
    if project.settings("matching").fish > 1:
        numbers |= encounters.measure_film_clearance(features)
    return numbers | {"drawn_size": min(map(project.size, played_modes()), default=1.0)}


def compare_schools(project: Project) -> pd.DataFrame:
    """Return how the fish of mode `matching` differ from the film's, a row per measure.

    The rows are those of `compare_groups`. The first half of the film, to which zones are fitted,
    is compared in the same way. The table is empty for a single fish.
    """
    if project.settings("matching").fish == 1 or "matching" not in played_modes():
        return compare_groups({}, {})
    film = load_table(Path("data/calibrate/film.parquet"), SHOAL)
    first, second = halves(film)
    columns = ["tick", "x_px", "y_px", "heading_deg"]
    edit = load_table(ANIMATE / "matching.parquet", EDIT, columns)
    length_px = project.size("matching") * float(project.features["body_length_px"].median())
    walls = Walls(project.arena, length_px)
    shoal = shoal_table(
        edit["tick"].to_numpy(), edit[["x_px", "y_px"]].to_numpy(float),
        edit["heading_deg"].to_numpy(float), walls,
    )  # fmt: skip
    return compare_groups(
        {"film": film, "second_half": second}, {"first_half": first, "matching": shoal}
    )


def doubts(numbers: dict[str, dict[str, float]]) -> pd.DataFrame:
    """Return the findings about the modes, columns mode and doubt (a sentence).

    numbers: mode → measures, of the modes that have an animation.
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
            rows.append(
                (
                    described.title,
                    "never shows the film: too few gateways lead there and back; "
                    "raise gateways.distance_threshold",
                )
            )
    return pd.DataFrame(rows, columns=["mode", "doubt"])


def main() -> None:
    """Write data/animate/beside/kinematics.parquet and reports/animate/.

    The reports are measures.csv, doubts.csv, left.csv, company.csv and the metrics.
    """
    with Project() as project:
        features = project.features
        motion = learn(features, project.rate_hz, delta_of(features))
        moved = measures.motion_of_film(features, motion)
        numbers = {mode: mode_numbers(mode) for mode in played_modes()}
        film = film_numbers(project, motion, moved)
        parts = [measures.kinematics({measures.FILM_MOTION: moved})]
        parts += [
            load_table(ANIMATE / mode / "motion.parquet", measures.KINEMATICS) for mode in numbers
        ]
        save_csv(REPORT / "company.csv", compare_schools(project), decimals=3)
    with whole_folder(OUT) as folder:
        save_table(
            folder / "kinematics.parquet", pd.concat(parts, ignore_index=True), measures.KINEMATICS
        )
    left = ANIMATE / "matching/left.parquet"
    lost = load_table(left, path_measures.LEFT) if left.exists() else path_measures.LEFT.empty()
    save_csv(REPORT / "left.csv", lost, decimals=3)
    beside = pd.DataFrame({**numbers, "film": film}).rename_axis("measure").reset_index()
    save_csv(REPORT / "measures.csv", beside, decimals=3)
    save_csv(REPORT / "doubts.csv", doubts(numbers), decimals=3)
    every = numbers | {"film": film}
    metrics = {f"{mode}_{name}": value for mode in every for name, value in every[mode].items()}
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
