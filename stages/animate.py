"""Stage `animate`: compare the animations of all modes by the same measures as the film."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

from contextlib import suppress
from pathlib import Path

import pandas as pd

from finloop.animate import encounters, measures
from finloop.animate.motion import MotionStatistics
from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT
from finloop.io.atomic import whole_folder
from finloop.io.record import load_json, remake_hint
from finloop.io.table import load_table, save_csv, save_table
from finloop.modes.phases import learn_phases, state_shares
from finloop.plan import path_measures
from finloop.project import Project
from finloop.social.measures import SCHOOL, compare_groups, measure_group, split_in_halves
from finloop.social.walls import Walls

ANIMATE, OUT, REPORT = Path("data/animate"), Path("data/animate/beside"), Path("reports/animate")
ENOUGH_REACHED_PCT = 90.0  # a mode that reaches fewer goals becomes a finding
MOST_GHOSTS_PCT = 0.5  # of the ticks: the film itself changes so much in as many frames


def _list_animated_modes() -> list[str]:
    """Return the names of the modes that have an animation; a film may show too little for one."""
    return [mode for mode in MODES if (ANIMATE / mode / "measures.json").exists()]


def _load_mode_numbers(mode: str) -> dict[str, float]:
    """Return the measures of a mode's animation and of its trials to random goals, by name."""
    numbers: dict[str, float] = {}
    for name in ("measures", "trials"):
        numbers |= load_json(ANIMATE / mode / f"{name}.json", dict, *remake_hint(f"modes-{mode}"))
    return numbers


def _measure_film(
    project: Project, statistics: MotionStatistics, motion: tuple[Floats, Floats]
) -> dict[str, float]:
    """Return the same measures of the film as of the modes' animations, by name.

    statistics: how the film's fish swim. motion: speed and turn rate of the film's rows. The number
    `drawn_size` is the smallest scale at which a mode draws its fish, 1 = as filmed.
    """
    features = project.features
    # Between successive frames, where both pictures are known: as filmed, and turned head right.
    steps = project.step_distances[["headed", "as_filmed"]].dropna()["as_filmed"].to_numpy(float)
    numbers = measures.measure_film(features, motion, steps, statistics)
    with suppress(FinloopError):  # the film shows no straight swimming
        phases = learn_phases(statistics, project.settings("network"))
        numbers |= state_shares(features, phases)
    if project.settings("matching").fish > 1:
        numbers |= encounters.measure_film_clearance(features)
    scales = [project.drawn_scale(mode) for mode in _list_animated_modes()]
    return numbers | {"drawn_size": min(scales, default=1.0)}


def compare_schools(project: Project) -> pd.DataFrame:
    """Return a table that compares how fish keep together in mode `matching` and in the film.

    It has a row per group, film and measure, and the columns shoal (the group), beside (the film),
    measure, median (of the group) and distance (Wasserstein's, of group and film). The film's first
    half, to which the zones are fitted, is compared as well, as a yardstick. The table is empty for
    a single fish, or without that mode.
    """
    if project.settings("matching").fish == 1 or "matching" not in _list_animated_modes():
        return compare_groups({}, {})
    film = load_table(Path("data/calibrate/film.parquet"), SCHOOL)
    first_half, second_half = split_in_halves(film)
    columns = ["tick", "x_px", "y_px", "heading_deg"]
    edit = load_table(ANIMATE / "matching.parquet", EDIT, columns)
    length_px = project.drawn_scale("matching") * float(project.features["body_length_px"].median())
    walls = Walls(project.arena, length_px)
    animated = measure_group(
        edit["tick"].to_numpy(), edit[["x_px", "y_px"]].to_numpy(float),
        edit["heading_deg"].to_numpy(float), walls,
    )  # fmt: skip
    return compare_groups(
        {"film": film, "second_half": second_half}, {"first_half": first_half, "matching": animated}
    )


def find_doubts(numbers: dict[str, dict[str, float]]) -> pd.DataFrame:
    """Return a table of the modes' doubtful results: columns mode (its title), doubt (a sentence).

    numbers: mode → measures by name, of the modes that have an animation. Doubtful are a mode
    without an animation, one that misses many of its random goals, one with double images, and a
    hybrid without film.
    """
    rows: list[tuple[str, str]] = []
    for mode, facts in MODES.items():
        if mode not in numbers:
            path = ANIMATE / mode / "reason.json"
            reason = load_json(path, dict, *remake_hint(f"modes-{mode}"))["reason"]
            rows.append((facts.title, reason))
            continue
        reached = numbers[mode].get("trials_goals_reached_pct", 100.0)
        if reached < ENOUGH_REACHED_PCT:
            rows.append((facts.title, f"reaches only {reached:.0f} % of its random goals"))
        ghosts = numbers[mode].get("ghosts_pct", 0.0)
        if ghosts > MOST_GHOSTS_PCT:
            reason = f"shows a double image in {ghosts:.1f} % of its ticks: as the paper does, it "
            remedy = f"mixes pictures of unlike poses; {mode}.join=inertial bends both into one"
            rows.append((facts.title, reason + remedy))
        if not numbers[mode].get("trials_film_pct", 100.0) and mode == "hybrid":
            reason = "never shows the film: too few gateways lead there and back; "
            rows.append((facts.title, reason + "raise gateways.distance_threshold"))
    return pd.DataFrame(rows, columns=["mode", "doubt"])


def main() -> None:
    """Compare the modes' animations with the film; write data/animate/beside/, reports/animate/.

    The tables are kinematics.parquet (speeds and turn rates), company.csv (how the fish keep
    together), left.csv (where fish leave a given path), measures.csv and doubts.csv.
    """
    with Project() as project:
        features = project.features
        motion = project.motion_statistics
        film_motion = measures.motion_of_film(features, motion)
        numbers = {mode: _load_mode_numbers(mode) for mode in _list_animated_modes()}
        film = _measure_film(project, motion, film_motion)
        schools = compare_schools(project)
    motions = [measures.kinematics_table({measures.FILM_MOTION: film_motion})]
    for mode in numbers:
        motions.append(load_table(ANIMATE / mode / "motion.parquet", measures.KINEMATICS))
    departures = path_measures.DEPARTURES.empty()
    if (path := ANIMATE / "matching/left.parquet").exists():
        departures = load_table(path, path_measures.DEPARTURES)
    doubts = find_doubts(numbers)
    measured = numbers | {"film": film}
    table = pd.DataFrame(measured).rename_axis("measure").reset_index()
    tables = {"company": schools, "left": departures, "measures": table, "doubts": doubts}
    with whole_folder(OUT) as folder:
        kinematics = pd.concat(motions, ignore_index=True)
        save_table(folder / "kinematics.parquet", kinematics, measures.KINEMATICS)
        for name, table in tables.items():
            save_csv(folder / f"{name}.csv", table, decimals=3)
    metrics: dict[str, float] = {}
    for mode, values in measured.items():
        metrics |= {f"{mode}_{name}": value for name, value in values.items()}
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
