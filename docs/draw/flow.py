"""The stages of dvc.yaml and their dependencies as an SVG."""

import re
from pathlib import Path
from xml.sax.saxutils import escape

import networkx as nx
import yaml

from benchmarks.pipeline import does_make_data, does_read
from finloop.edit.modes import MODES, RETARGET
from stages.origins import output_paths

BOX, GAP, MARGIN = (92, 34), (36, 18), 4  # px: of a box, between boxes, around all
ALL_MODES = "modes-…"  # the stages of all modes, in one box
PLACES = {  # column and row of every box
    "clip": (0, 1), "extract": (1, 1), "features": (2, 1),
    "bpn": (3, 0), "distance": (3, 1), "sprites": (3, 2), "pose": (3, 3), "calibrate": (3, 4),
    "identity": (3, 5), "gait": (3, 6), "morph": (3, 7),
    "loops": (4, 1), "gateways": (4, 2), "jumps": (4, 3), "forecast": (5, 3), ALL_MODES: (6, 2),
    "retarget": (6, 4),
    "animate": (7, 0), "render": (7, 1), "tank": (7, 2), "export": (7, 5), "realism": (8, 0),
    "report": (9, 2),
}  # fmt: skip
TIP = (
    '<marker id="tip" viewBox="0 0 8 8" refX="1" refY="4" markerWidth="6" markerHeight="6" '
    'orient="auto"><path d="M0 0L8 4L0 8z"/></marker>'
)
STYLE = """
text { font: 15px system-ui, sans-serif; text-anchor: middle; dominant-baseline: central; }
text { fill: #16242b; }
rect { fill: #ffffff; stroke: #005f86; stroke-width: 1.5; }
path { fill: none; stroke: #51636c; stroke-width: 1.5; marker-end: url(#tip); }
marker path { fill: #51636c; stroke: none; marker-end: none; }
@media (prefers-color-scheme: dark) {
  text { fill: #e8eff2; } rect { fill: #1a252b; stroke: #7cc7e8; }
  path { stroke: #a3b5be; } marker path { fill: #a3b5be; }
}
"""


def _box(stage: str) -> str:
    """Return the box of a stage."""
    return ALL_MODES if stage.startswith("modes-") else stage


def _reads(dep: str, out: str) -> bool:
    """Return whether a stage with dependency `dep` reads an output `out`.

    A parameter in the path matches the name of any mode: `data/animate/${render.mode}`.
    """
    if "${" in dep:
        return any(re.sub(r"\$\{[^}]*\}", mode, dep) == out for mode in (*MODES, RETARGET))
    return does_read(dep, out)


def flow(dvc_yaml: str) -> nx.DiGraph:
    """Return the reduced graph of boxes, with edges from each box to those that depend on it.

    A box is a stage, or the stages of all modes. The stages `code` and `params`, which only check,
    and the stages `plots-…`, which only draw, have no box; what waits for drawings waits for what
    is drawn.
    """
    stages = yaml.safe_load(dvc_yaml)["stages"]
    graph = nx.DiGraph()
    graph.add_nodes_from(map(_box, stages))
    homes = {out: _box(name) for name, stage in stages.items() for out in output_paths(stage)}
    for name, stage in stages.items():
        for dep in stage.get("deps", []):
            for out, home in homes.items():
                if home != _box(name) and _reads(dep, out):
                    graph.add_edge(home, _box(name))
    graph = nx.transitive_closure(graph)
    graph.remove_nodes_from([name for name in stages if not does_make_data(name)])
    return nx.transitive_reduction(graph)


def svg(dvc_yaml: str) -> str:
    """Return the SVG, readable on light and dark pages."""
    graph = flow(dvc_yaml)
    pitch = BOX[0] + GAP[0], BOX[1] + GAP[1]

    def corner(name: str) -> tuple[int, int]:
        column, row = PLACES[name]
        return MARGIN + pitch[0] * column, MARGIN + pitch[1] * row

    lines = []
    for one, other in sorted(graph.edges):
        (x1, y1), (x2, y2) = corner(one), corner(other)
        y1, y2, last = y1 + BOX[1] // 2, y2 + BOX[1] // 2, x2 - GAP[0]
        middle = last + GAP[0] // 2
        lines.append(
            f'<path d="M{x1 + BOX[0]} {y1}H{last}C{middle} {y1} {middle} {y2} {x2 - 6} {y2}"/>'
        )
    for name in sorted(graph):
        x, y = corner(name)
        lines.append(f'<rect x="{x}" y="{y}" width="{BOX[0]}" height="{BOX[1]}" rx="7"/>')
        lines.append(f'<text x="{x + BOX[0] // 2}" y="{y + BOX[1] // 2}">{escape(name)}</text>')
    columns, rows = (max(PLACES[name][axis] for name in graph) for axis in (0, 1))
    width, height = (
        2 * MARGIN + p * n + b for p, n, b in zip(pitch, (columns, rows), BOX, strict=True)
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}">\n<title>The stages and what each waits for</title>\n'
        f"<style>{STYLE}</style>\n<defs>{TIP}</defs>\n" + "\n".join(lines) + "\n</svg>\n"
    )


def save_flow(path: Path, dvc_yaml: Path) -> None:
    """Write the SVG for a dvc.yaml."""
    path.write_text(svg(dvc_yaml.read_text(encoding="utf-8")), encoding="utf-8")
