"""Stage `modes-hybrid`: goals become an animation of mode `hybrid` (fish paper Fig. 19)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import PaperAnimator
from finloop.modes.hybrid import hybrid_animator
from finloop.project import Project
from stages.animation import animate, film_data


def open_mode(project: Project) -> PaperAnimator:
    """Return the animator of mode `hybrid`; without loops or gateways it is the network alone."""
    settings = project.settings
    return hybrid_animator(
        film_data(project, project.reel), project.model, project.loops, project.gateways,
        settings("animate"), (settings("network"), settings("loops"), settings("hybrid")),
    )  # fmt: skip


def main() -> None:
    """Write data/animate/hybrid.parquet and the folder data/animate/hybrid/."""
    animate("hybrid", open_mode)


if __name__ == "__main__":
    run(main)
