"""Open every mode at once, for programs that switch between them."""

import sys
from importlib import import_module

from finloop.edit.modes import MODES
from finloop.modes.animator import Animator
from finloop.modes.matching import NothingToUse
from finloop.project import Project


def open_modes(project: Project) -> dict[str, Animator]:
    """Open every mode for which the film shows enough; return mode → animator.

    stderr reports what each other mode lacks. NothingToUse if no mode is left.
    """
    made: dict[str, Animator] = {}
    # A fish that another mode left as a sprite goes on from the row behind it.
    more = {"matching": {"sprite_rows": project.sprites["row"].to_numpy()}}
    for mode in MODES:
        try:
            made[mode] = import_module(f"stages.modes.{mode}").open_mode(
                project, **more.get(mode, {})
            )
        except NothingToUse as none:
            print(f"{mode}: {none.came}", file=sys.stderr)
            lack = none
    if not made:
        raise lack
    return made
