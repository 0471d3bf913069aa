"""Draw the pictures of single stages: `python -m stages.plots bpn loops`."""

from stages.run import run  # isort: skip  (before numpy)

import argparse

from stages.plots import film, modes, motion
from stages.plots.draw import draw_all

MODULES = {name.rpartition(".")[2]: name for part in (film, motion, modes) for name in part.MODULES}


def main() -> None:
    """Draw the pictures of the stages that the command line names."""
    parser = argparse.ArgumentParser("python -m stages.plots", description=__doc__)
    parser.add_argument(
        "stages", nargs="+", choices=MODULES, metavar="stage", help=", ".join(MODULES)
    )
    draw_all([MODULES[stage] for stage in parser.parse_args().stages])


if __name__ == "__main__":
    run(main)
