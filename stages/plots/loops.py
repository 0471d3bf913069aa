"""Pictures of `loops`: where they are in time and tank (Figs. 8, 10–13), and how they look."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.features.table import delta_of
from finloop.io.picture import save_figure
from finloop.loops.graph import loop_graph
from finloop.loops.positions import position_table, table_ends
from finloop.loops.search import least_frames
from finloop.loops.settings import Settings
from finloop.plots import loops as draw
from finloop.project import Project
from stages.settings import load

REPORT = Path("reports/loops")
BEST = 6  # loops drawn, and as many of the worst


def main() -> None:
    """Draw over_time.png, over_tank.png, fig11.png and best_and_worst.png."""
    p: Settings = load("loops")
    project = Project()
    loops = project.loops
    if loops.empty:
        why = (project.data / "loops/none.txt").read_text(encoding="utf-8")
        for name in ("over_time", "over_tank", "fig11", "best_and_worst"):
            save_figure(REPORT / f"{name}.png", draw.message(why))
        return
    features, tank = project.features, project.background
    track = features["track_id"].to_numpy()
    graph = loop_graph(loops, track)
    ends = table_ends(graph.ends, track)
    save_figure(REPORT / "over_time.png", draw.over_time(loops, graph, track, project.rate_hz))
    save_figure(REPORT / "over_tank.png", draw.over_tank(loops, graph, features, tank))
    fig11 = draw.table_picture(position_table(ends, features), ends, features)
    save_figure(REPORT / "fig11.png", fig11)
    gap = least_frames(delta_of(features), p)
    with project:
        reel, facts = project.film_reel, project.map_facts
        best, worst = (
            list(draw.examples(some.iloc[draw.apart(some, gap, BEST)], reel, facts))
            for some in (loops, loops[::-1])
        )
    save_figure(REPORT / "best_and_worst.png", draw.best_and_worst(best, worst))


if __name__ == "__main__":
    run(main)
