"""Stage `modes-loops`: goals become an animation of mode `loops` (fish paper §4.1-4.2)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import PaperAnimator
from finloop.modes.loops import loops_animator
from finloop.project import Project
from stages.animation import animate, film_data


def open_mode(project: Project) -> PaperAnimator:
    """Return the animator of mode `loops`; raise NothingToUse if the film has no loops."""
    data, settings = film_data(project, project.film_reel), project.settings
    return loops_animator(data, project.loops, settings("animate"), settings("loops"))


def main() -> None:
    """Write data/animate/loops.parquet and the folder data/animate/loops/."""
    animate("loops", open_mode)


if __name__ == "__main__":
    run(main)
