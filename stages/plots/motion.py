"""Stage `plots-motion`: draw the material of the modes, from the networks to the gateways."""

from stages.run import run  # isort: skip  (before numpy)

from stages.plots.draw import draw_all

MODULES = (
    "stages.plots.loops",
    "stages.plots.forecast",
    "stages.plots.distance",
    "stages.plots.gateways",
    "stages.plots.sprites",
    "stages.plots.bpn",
)


def main() -> None:
    """Draw the results of bpn, forecast, sprites, distance, loops, gateways in reports/motion/."""
    draw_all(MODULES)


if __name__ == "__main__":
    run(main)
