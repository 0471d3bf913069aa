"""Stage `modes-network`: goals become an animation of mode `network` (fish paper Fig. 18)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import PaperAnimator
from finloop.modes.network import network_animator
from finloop.project import Project
from stages.animation import animate, film_data


def open_mode(project: Project) -> PaperAnimator:
    """Return the animator of mode `network`, with the results of the earlier stages."""
    data, settings = film_data(project, project.reel), project.settings
    return network_animator(data, project.model, settings("animate"), settings("network"))


def main() -> None:
    """Write data/animate/network.parquet and the folder data/animate/network/."""
    animate("network", open_mode)


if __name__ == "__main__":
    run(main)
