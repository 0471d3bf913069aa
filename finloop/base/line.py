"""A line from a file or a track: places, and maybe times and headings."""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError

PX, TANK, MM = "px", "tank", "mm"
"""Units of places: px of the clip; shares of the tank's width and height, from the upper left; mm.
"""

TRACK = "track:"
"""Before the number of a track of the film, in place of a file."""


class Line(NamedTuple):
    """Places x, y (n,) in a unit, and maybe the time (s) and the heading (degrees) at each.

    name: of what it was read from, for messages; closed: whether the last place leads to the first;
    rows (n,): of the film, where it is a track.
    """

    name: str
    x: Floats
    y: Floats
    unit: str
    time_s: Floats | None = None
    heading_deg: Floats | None = None
    closed: bool = False
    rows: Ints | None = None


def checked_line(line: Line) -> Line:
    """The line; FinloopError lists all that is wrong with it.

    Two places at least must differ, every number be finite, and no time be before the one before.
    """
    problems = []
    columns = {"x": line.x, "y": line.y, "time": line.time_s, "heading": line.heading_deg}
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(line.x if values is None else values))
        if values is not None and len(bad):
            problems.append(f"{len(bad)} of {len(line.x)} rows have no {name}, row {bad[0]} first")
    places = np.column_stack([line.x, line.y])
    if not problems and not (places != places[:1]).any():
        count = f"{len(places)} place" + "s" * (len(places) != 1)
        problems.append(f"{count}, none of which lies apart from the first")
    if line.time_s is not None:
        back = np.flatnonzero(np.diff(line.time_s) < 0)
        if len(back):
            problems.append(
                f"time runs backwards {len(back)} times, first from {line.time_s[back[0]]:g} s "
                f"to {line.time_s[back[0] + 1]:g} s"
            )
    if problems:
        raise FinloopError(
            f"{line.name} is no path:\n    " + "\n    ".join(problems),
            "two or more places that lie apart, finite numbers, and times in their order",
            "leave out rows without a place, sort the others by time, or give no times",
        )
    return line
