"""Open every mode at once, for programs that switch between them."""

import sys
from importlib import import_module

from finloop.edit.modes import MODES
from finloop.modes.animator import Animator
from finloop.modes.matching import NothingToUse
from finloop.project import Project


def open_modes(project: Project) -> dict[str, Animator]:
    """Return the animators of all modes for which the film shows enough, by name.

    NothingToUse if there is no such mode. stderr reports what each other mode lacks.
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
