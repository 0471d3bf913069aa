"""Pictures of `loops`: where they are in time and tank, and how they look (Figs. 8, 10–13)."""

from collections.abc import Iterator
from pathlib import Path

from matplotlib.figure import Figure

from finloop.features.table import infer_delta_frames
from finloop.io.checksums import check_file
from finloop.io.picture import save_figure
from finloop.loops.graph import build_loop_graph
from finloop.loops.positions import choose_table_ends, position_table
from finloop.loops.search import find_loop_candidates, least_loop_frames, to_sparse_map
from finloop.loops.settings import LoopsSettings
from finloop.plots import loops as draw
from finloop.plots.improper_loop import figure13, find_most_improper_loop
from finloop.plots.loop_groups import figure12
from finloop.plots.loop_routes import figure10, find_three_routes
from finloop.plots.parts import draw_message
from finloop.project import Project
from stages.settings import load_settings

REPORT = Path("reports/motion/loops")
NAMES = ("over_time", "over_tank", "fig10", "fig11", "best_and_worst")
BEST = 6  # loops drawn, and as many of the worst


def main() -> None:
    """Draw the loops over time and tank, the best and the worst, and Figs. 10, 11 and 13."""
    p: LoopsSettings = load_settings("loops")
    with Project() as project:
        if project.loops.empty:
            why = check_file(project.data / "loops/none.txt").read_text(encoding="utf-8")
            figures = iter([(name, draw_message(why)) for name in NAMES])
        else:
            figures = _draw_loops(project, p)
        save_figure(REPORT / "fig13.png", _draw_improper(project, p))
        for name, figure in figures:
            save_figure(REPORT / f"{name}.png", figure)


def _draw_loops(project: Project, p: LoopsSettings) -> Iterator[tuple[str, Figure]]:
    """Yield name and figure of each of NAMES, for a film that has loops (similar frames)."""
    loops, features, reel = project.loops, project.features, project.film_reel
    facts, rate_hz = project.map_facts, project.rate_hz
    track = features["track_id"].to_numpy()
    graph = build_loop_graph(loops, track)
    yield "over_time", figure12(loops, graph, features, rate_hz)
    yield "over_tank", draw.draw_loops_over_tank(loops, graph, features, project.background)
    routes = find_three_routes(loops, track)
    if routes is None:
        why = "Fig. 10: no track has four loops between whose ends there are three ways as in the "
        yield "fig10", draw_message(f"{why}paper.")
    else:
        yield "fig10", figure10(routes, reel, facts.frame_of_reference, facts.step_median)
    ends = choose_table_ends(graph.ends, track)
    yield "fig11", draw.figure11(position_table(ends, features), ends, features)
    gap = least_loop_frames(infer_delta_frames(features), p)
    pictures = []
    for ranked in (loops, loops[::-1]):  # from the best, and from the worst
        chosen = ranked.iloc[draw.choose_separate_loops(ranked, gap, BEST)]
        pictures.append(list(draw.loop_pictures(chosen, reel, facts)))
    best, worst = pictures
    yield "best_and_worst", draw.figure8(best, worst)


def _draw_improper(project: Project, p: LoopsSettings) -> Figure:
    """Return Fig. 13 of the fish paper, or a figure that says that no loop is improper.

    Along an improper loop the fish travels against its heading.
    """
    features, reel, facts = project.features, project.film_reel, project.map_facts
    pairs = to_sparse_map(project.similar_pairs, len(features))
    threshold = p.distance_threshold * facts.step_median
    candidates, counts = find_loop_candidates(pairs, features, threshold, p)
    loop = find_most_improper_loop(candidates, features, p.improper_angle_deg)
    if loop is None:
        return draw_message(
            f"Fig. 13: of {counts['minima']} pairs of similar frames none travels more than "
            f"{p.improper_angle_deg:g}° (loops.improper_angle_deg) off the fish's heading."
        )
    track, frame = (features[name].to_numpy() for name in ("track_id", "frame"))
    ends = [f"frame {frame[row]} of track {track[row]}" for row in (loop.a, loop.b)]
    steps = loop.filtered / facts.step_median
    caption = (
        f"a pair that is no loop: {' and '.join(ends)}, {steps:.2f} natural steps apart "
        f"(a loop: {p.distance_threshold:g} at most);\n"
        f"it travels {loop.off_deg:.0f}° off the heading "
        f"(a loop: {p.improper_angle_deg:g}° at most). "
        f"{counts['improper_dropped']} of {counts['minima']} similar pairs are improper"
    )
    return figure13(loop, reel, facts.frame_of_reference, project.background, caption)
