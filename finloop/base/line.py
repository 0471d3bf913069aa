"""A path from a file or a track: places, and optionally times and headings."""

from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError

PX, TANK, MM = "px", "tank", "mm"
"""Units of places: px of the clip; shares of the width and height of the tank, the box around where
fish may swim, or for a recorded track of the whole picture, from the upper left; mm."""

TRACK = "track:"
"""Prefix of a track's number where a track of the film stands in place of a file."""


class Line(NamedTuple):
    """A path for a fish to swim: n places, and optionally a time and a heading of each, (n,)."""

    name: str  # of the file or track it comes from, for messages
    x: Floats
    y: Floats
    unit: str  # of x and y: PX, TANK or MM
    time_s: Floats | None = None
    heading_deg: Floats | None = None  # anticlockwise, 0 = to the right
    closed: bool = False  # whether the last place leads back to the first
    rows: Ints | None = None  # (n,) row numbers in the feature table, if the path is a track


def check_line(line: Line) -> Line:
    """Return a path unchanged if a fish can swim it; else raise FinloopError.

    The error lists all problems: numbers that are not finite, fewer than two different places, and
    times that decrease.
    """
    problems = []
    columns = {"x": line.x, "y": line.y, "time": line.time_s, "heading": line.heading_deg}
    for name, values in columns.items():
        if values is None:
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            problems.append(f"{len(bad)} of {len(line.x)} rows have no {name}, row {bad[0]} first")
    places = np.column_stack([line.x, line.y])
    if not problems and not (places != places[:1]).any():
        count = f"{len(places)} place" + "s" * (len(places) != 1)
        problems.append(f"{count}, none of which lies apart from the first")
    if line.time_s is not None:
        back = np.flatnonzero(np.diff(line.time_s) < 0)
        if len(back):
            problems.append(
                f"time decreases {len(back)} times, first from {line.time_s[back[0]]:g} s "
                f"to {line.time_s[back[0] + 1]:g} s"
            )
    if problems:
        raise FinloopError(
            f"{line.name} is no path:\n    " + "\n    ".join(problems),
            "two or more places that differ, finite numbers, and times that do not decrease",
            "leave out rows without a place, sort the others by time, or give no times",
        )
    return line
