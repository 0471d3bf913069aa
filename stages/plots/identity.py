"""Picture of `identity`: the tracks of each animal over time."""

from pathlib import Path

from finloop.io.picture import save_figure
from finloop.plots.identity import draw_timeline
from finloop.project import Project


def main() -> None:
    """Draw the tracks of each animal over time, reports/film/identity/timeline.png."""
    project = Project()
    figure = draw_timeline(project.identities, project.features, project.rate_hz)
    save_figure(Path("reports/film/identity/timeline.png"), figure)
