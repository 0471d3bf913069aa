"""Stage `modes-network`: goals become an animation of mode `network` (fish paper Fig. 18)."""

from stages.run import run  # isort: skip  (before numpy)

from finloop.modes.animator import Animator
from finloop.modes.network import network_animator
from finloop.project import Project
from stages.animation import write_animation


def open_mode(project: Project) -> Animator:
    """Return the animator of mode `network`, with the results of earlier stages."""
    p = project.settings("animate")
    return network_animator(project.sprite_assets, project.network_mode, p)


def main() -> None:
    """Plan the animation of mode `network` and measure it; write data/animate/network*."""
    write_animation("network", open_mode)


if __name__ == "__main__":
    run(main)
