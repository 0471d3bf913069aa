"""Open every mode at once, for programs that switch between them."""

import sys
from collections.abc import Callable
from functools import partial

from finloop.modes.animator import Animator
from finloop.modes.matching import NothingToUse
from finloop.project import Project
from stages.modes import hybrid, loops, matching, network


def open_modes(project: Project) -> dict[str, Animator]:
    """Return the animators of all modes for which the film shows enough, by name.

    NothingToUse if there is no such mode. stderr reports what each other mode lacks.
    """
    rows = project.sprites["row"].to_numpy()
    makers: dict[str, Callable[[Project], Animator]] = {
        "network": network.open_mode,
        "loops": loops.open_mode,
        "hybrid": hybrid.open_mode,
        "matching": partial(matching.open_mode, sprite_rows=rows),
    }
    made: dict[str, Animator] = {}
    for mode, open_mode in makers.items():
        try:
            made[mode] = open_mode(project)
        except NothingToUse as none:
            print(f"{mode}: {none.came}", file=sys.stderr)
            lack = none
    if not made:
        raise lack
    return made
