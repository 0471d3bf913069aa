"""Stage `loops`: find where the film can jump to a similar frame (Figs. 8, 10-13)."""

from stages.run import run, save_metrics  # isort: skip  (before numpy)

import sys
from pathlib import Path

import numpy as np

from finloop.distance.map import find_map_rows
from finloop.features.table import infer_delta_frames
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.table import save_csv, save_table
from finloop.loops.graph import build_loop_graph, find_routes
from finloop.loops.positions import choose_table_ends, position_table, route_table
from finloop.loops.search import (
    LOOPS,
    NoLoopsError,
    find_video_loops,
    least_loop_frames,
    loop_metrics,
    to_sparse_map,
)
from finloop.loops.settings import LoopsSettings
from finloop.project import Project
from stages.settings import load_settings

FOLDER, REPORT = Path("data/loops"), Path("reports/loops")
ROUTES = 5  # most routes listed, from the last loop end to the first


def _write_empty_tables(reason: NoLoopsError) -> None:
    """Write the files of a film without loops: empty tables, and the reason in none.txt."""
    print(f"loops: {reason}\n  till then:  only the network mode", file=sys.stderr)
    with whole_folder(FOLDER) as folder:
        save_table(folder / "loops.parquet", LOOPS.empty(), LOOPS)
        (folder / "none.txt").write_text(str(reason), encoding="utf-8")
        for name in ("position_table", "routes"):
            save_bytes(folder / f"{name}.csv", b"\n")
    save_metrics(REPORT / "metrics.json", {"loops": 0, "ends": 0, "endless_film_pct": 0.0})


def main() -> None:
    """Find the video loops, pairs of similar frames of a track with some time between them.

    data/loops/ gets the loops, the position table (Fig. 11) and routes between loop ends,
    reports/loops/ the metrics. A film without loops gives empty tables.
    """
    settings: LoopsSettings = load_settings("loops")
    project = Project()
    features, facts = project.features, project.map_facts
    step, track = facts.step_median, features["track_id"].to_numpy()
    similar = to_sparse_map(project.similar_pairs, len(features))
    project.forget("similar_pairs")  # the table is large
    try:
        loops, counts = find_video_loops(similar, features, project.rate_hz, step, settings)
    except NoLoopsError as reason:
        _write_empty_tables(reason)
        return
    graph = build_loop_graph(loops, track)
    with whole_folder(FOLDER) as folder:
        save_table(folder / "loops.parquet", loops, LOOPS)

    table = position_table(choose_table_ends(graph.ends, track), features)
    save_bytes(FOLDER / "position_table.csv", table.to_csv(lineterminator="\n").encode())
    jump_frames = least_loop_frames(infer_delta_frames(features), settings)
    largest = np.flatnonzero(graph.component == 0).tolist()  # ends that reach each other
    # As an example, routes from the last of these ends back to the first.
    routes = find_routes(graph, largest[-1], largest[0], ROUTES, jump_frames=jump_frames)
    save_csv(FOLDER / "routes.csv", route_table(routes, graph, features, step), decimals=3)
    compared = find_map_rows(features, project.step_distances)
    metrics = loop_metrics(loops, counts, graph, features, facts, compared)
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
