"""Stage `loops`: find where the film can jump to a similar frame (Figs. 8, 10-13)."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from pathlib import Path

import numpy as np

from finloop.distance.map import map_rows
from finloop.features.table import delta_of
from finloop.io.atomic import whole_file, whole_folder
from finloop.io.table import save_csv, save_table
from finloop.loops.graph import loop_graph, routes
from finloop.loops.positions import position_table, routes_table, table_ends
from finloop.loops.search import (
    LOOPS,
    NoLoops,
    as_map,
    find_video_loops,
    least_frames,
    loop_metrics,
)
from finloop.loops.settings import LoopsSettings
from finloop.project import Project
from stages.settings import load

FOLDER, REPORT = Path("data/loops"), Path("reports/loops")
WAYS = 5  # ways from the last end to the first


def write_empty_tables(none: NoLoops) -> None:
    """Write the files of a film without loops: empty tables, and the reason in none.txt."""
    print(f"loops: {none}\n  till then:  only the network mode", file=sys.stderr)
    with whole_folder(FOLDER) as folder:
        save_table(folder / "loops.parquet", LOOPS.empty(), LOOPS)
        (folder / "none.txt").write_text(str(none), encoding="utf-8")
    for name in ("position_table", "routes"):
        with whole_file(REPORT / f"{name}.csv") as part:
            part.write_text("\n", encoding="utf-8")
    save_metrics(REPORT / "metrics.json", {"loops": 0, "ends": 0, "endless_film_pct": 0.0})


def main() -> None:
    """Write data/loops/loops.parquet, and reports/loops/.

    The reports are position_table.csv, routes.csv and the metrics.
    """
    settings: LoopsSettings = load("loops")
    project = Project()
    features, facts = project.features, project.map_facts
    step, track = facts.step_median, features["track_id"].to_numpy()
    pairs = project.pairs
    similar = as_map(pairs, len(features))
    del pairs  # it is large

    try:
        loops, counts = find_video_loops(similar, features, project.rate_hz, step, settings)
    except NoLoops as none:
        write_empty_tables(none)
        return
    graph = loop_graph(loops, track)
    with whole_folder(FOLDER) as folder:
        save_table(folder / "loops.parquet", loops, LOOPS)

    table = position_table(table_ends(graph.ends, track), features)
    with whole_file(REPORT / "position_table.csv") as part:
        table.to_csv(part, lineterminator="\n")
    largest = np.flatnonzero(graph.component == 0).tolist()
    jump_frames = least_frames(delta_of(features), settings)
    ways = routes(graph, largest[-1], largest[0], WAYS, jump_frames=jump_frames)
    save_csv(REPORT / "routes.csv", routes_table(ways, graph, features, step), decimals=3)
    compared = map_rows(features, project.steps)
    metrics = loop_metrics(loops, counts, graph, features, facts, compared)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
