"""Stage `modes-loops`: goals become an animation of mode `loops` (fish paper §4.1-4.2)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import Animator
from finloop.modes.loops import loops_animator
from finloop.project import Project
from stages.animation import write_animation


def open_mode(project: Project) -> Animator:
    """Return the animator of mode `loops`; NothingToUse if the film has no loops."""
    assets, loops, settings = project.film_assets, project.loops, project.settings
    return loops_animator(assets, loops, settings("animate"), settings("loops"))


def main() -> None:
    """Plan the animation of mode `loops` and measure it; write data/animate/loops*."""
    write_animation("loops", open_mode)


if __name__ == "__main__":
    run(main)
