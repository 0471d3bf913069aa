"""Stage `plots-modes`: draw the animations of all modes, beside the film."""

from stages.run import run  # isort: skip  (before numpy)

from stages.plots.draw import draw_all

MODULES = (
    "stages.plots.realism",
    "stages.plots.render",
    "stages.plots.animate",
    "stages.plots.retarget",
)


def main() -> None:
    """Draw the results of the stages animate, retarget, render and realism in reports/modes/."""
    draw_all(MODULES)


if __name__ == "__main__":
    run(main)
