"""Stage `modes-hybrid`: goals become an animation of mode `hybrid` (fish paper Fig. 19)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import Animator
from finloop.modes.hybrid import hybrid_animator
from finloop.project import Project
from stages.animation import write_animation


def open_mode(project: Project) -> Animator:
    """Return the animator of mode `hybrid`; without loops or gateways, that of `network`."""
    settings = project.settings
    return hybrid_animator(
        project.sprite_assets, project.network_mode, project.loops, project.gateways,
        settings("animate"), settings("loops"), settings("hybrid"),
    )  # fmt: skip


def main() -> None:
    """Plan the animation of mode `hybrid` and measure it; write data/animate/hybrid*."""
    write_animation("hybrid", open_mode)


if __name__ == "__main__":
    run(main)
