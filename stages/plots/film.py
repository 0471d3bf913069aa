"""Stage `plots-film`: draw what the film shows, from its check to the shapes of the fish."""

from stages.run import run  # isort: skip  (before numpy)

from stages.plots.draw import draw_all

MODULES = (
    "stages.plots.extract",
    "stages.plots.features",
    "stages.plots.findings",
    "stages.plots.clip",
    "stages.plots.identity",
    "stages.plots.calibrate",
    "stages.plots.pose",
)


def main() -> None:
    """Draw the results of clip, extract, features, identity, calibrate, pose in reports/film/."""
    draw_all(MODULES)


if __name__ == "__main__":
    run(main)
