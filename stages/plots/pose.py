"""Picture of `pose`: the first principal shapes of the postures, drawn on an animal of the film."""

from pathlib import Path

from finloop.io.picture import save_picture
from finloop.plots.pose import draw_shapes
from finloop.project import Project


def main() -> None:
    """Draw the principal shapes of the postures on an animal, reports/film/pose/shapes.png."""
    with Project() as project:
        picture = draw_shapes(project.poses, project.cutouts)
    save_picture(Path("reports/film/pose/shapes.png"), picture)
