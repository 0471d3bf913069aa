"""Stage `retarget`: this film's fish swims a track that was recorded elsewhere."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Mapping
from pathlib import Path

from finloop.edit.measures import discontinuity_measures, step_measures
from finloop.edit.pictures import drawn_step_distances, measure_discontinuities
from finloop.edit.schema import EDIT
from finloop.io.atomic import whole_folder
from finloop.io.record import save_json, save_records
from finloop.io.table import save_table
from finloop.project import Project
from finloop.retarget import ASKED, JoinParameters, RetargetData, Retargeted, retarget_track
from finloop.retarget.load import load_track
from finloop.retarget.settings import RetargetSettings
from stages.settings import load_settings

OUT, REPORT = Path("data/retarget"), Path("reports/retarget")
EDIT_LIST = Path("data/animate/retarget.parquet")


def load_retarget_data(project: Project) -> RetargetData:
    """Return what retargeting needs of the film: rate, arena, pictures, poses and looks."""
    return RetargetData(
        project.rate_hz, project.arena, project.film_reel, project.poses, project.row_looks,
        project.map_facts.size,
    )  # fmt: skip


def _retarget_film(p: RetargetSettings) -> Retargeted:
    """Let the film's fish swim the track of `p.tracks`; return its edit list and numbers."""
    with Project() as project:
        steps = project.step_distances[["headed", "as_filmed"]].dropna()
        film, join = load_retarget_data(project), load_settings("matching").join
        joining = JoinParameters(load_settings("jumps"), load_settings("animate"), join)
        result = retarget_track(load_track(film, p), film, p, joining)
        drawn_steps = drawn_step_distances(result.edit, film.pictures)
        joins, _ = measure_discontinuities(result.edit, film.pictures)
    numbers = {
        **result.numbers,
        **step_measures(drawn_steps, steps["as_filmed"].to_numpy(float)),
        **discontinuity_measures(joins, steps["headed"].to_numpy(float)),
    }
    return result._replace(numbers=numbers)


def describe_flaws(numbers: Mapping[str, float]) -> list[str]:
    """Return sentences on what is wrong in a retargeted track: no pose, gaps, leaving the tank.

    numbers: `Retargeted.numbers`; read are with_postures, left_out_s, duration_s, outside_ticks.
    """
    sentences = []
    if not numbers["with_postures"]:
        sentences.append(
            "the track has no pose (that takes three points along the body): the fish bends as "
            "in the film at the same speed and turn rate"
        )
    if numbers["left_out_s"] > 0:
        sentences.append(
            f"the fish swims the longest stretch without a gap, {numbers['duration_s']:.1f} s; "
            f"{numbers['left_out_s']:.1f} s are left out"
        )
    if numbers["outside_ticks"]:
        sentences.append(f"the fish leaves the tank in {numbers['outside_ticks']} ticks")
    return sentences


def main() -> None:
    """Let the film's fish swim a track of another animal; write data/retarget/ and an edit list.

    data/retarget/ has the requested poses. Without `retarget.tracks` both are empty.
    """
    p: RetargetSettings = load_settings("retarget")
    if p.tracks is None:
        result = Retargeted(EDIT.empty(), ASKED.empty(), {"ticks": 0})
    else:
        result = _retarget_film(p)
        for note in describe_flaws(result.numbers):
            print(f"retarget: {note}", file=sys.stderr)
    with whole_folder(OUT) as folder:
        save_table(folder / "asked.parquet", result.asked, ASKED)
    with whole_folder(EDIT_LIST.with_suffix("")) as folder:
        save_records(folder / "goals.json", [])
        save_json(folder / "drawn.json", {"size": 1.0})
    save_table(EDIT_LIST, result.edit, EDIT)
    save_metrics(REPORT / "metrics.json", result.numbers)


if __name__ == "__main__":
    run(main)
