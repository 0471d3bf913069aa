"""Stage `modes-loops`: goals become an animation of mode `loops` (fish paper §4.1-4.2)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.project import Project

from finloop.modes.animator import FilmData, PaperAnimator
from finloop.modes.loops import loops_animator
from stages.animation import animate


def open_mode(project: Project) -> PaperAnimator:
    """Bring the mode together. NothingToUse if the film has no loops."""
    made = FilmData(
        project.rate_hz, project.arena, project.background, project.film_reel, project.outlines,
        project.poses, project.map_facts, project.steps,
    )  # fmt: skip
    return loops_animator(
        made, project.loops, project.settings("animate"), project.settings("loops")
    )


def main() -> None:
    """Make data/animate/loops.parquet and data/animate/loops/."""
    animate("loops", open_mode)


if __name__ == "__main__":
    run(main)
