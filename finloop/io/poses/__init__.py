"""Tracks of another program as poses: which program made them, and where animals are in each frame.

`movement` reads every format that it knows; it is optional (the extra `tracks`). This package reads
idtracker.ai and TRex, which `movement` does not know.
"""

from collections.abc import Callable
from pathlib import Path
from typing import get_args

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, Software
from finloop.io.poses import idtracker, trex
from finloop.io.poses.by_movement import read as by_movement
from finloop.io.poses.software import software_of

__all__ = ["load_poses"]

_OWN: dict[Software, Callable[[Path], Poses]] = {"idtracker.ai": idtracker.read, "TRex": trex.read}


def load_poses(
    path: Path, software: Software | None, rate_hz: float, parameter: str = "extract.tracks_path"
) -> Poses:
    """Load the named points of all animals from a tracking program's file, or a folder of files.

    Frames are those of the film that the program tracked, from 0. FinloopError if there is nothing,
    the format is unknown or not that of `software`, the file is damaged, is three-dimensional, or
    holds no animal.

    software: the program that made it; None = detect it from the file. rate_hz: of the film, for a
    file that has times and no rate. parameter: the one that names the file, for messages.
    """
    if not path.exists():
        raise FinloopError(
            f"there is nothing at {path.absolute()}",
            f"tracks of {', '.join(get_args(Software))}",
            f"correct {parameter}, or make it absolute: an experiment may run in another folder",
        )
    software = software_of(path) if software is None else software
    own = _OWN.get(software)
    poses = own(path) if own else by_movement(path, software, rate_hz)
    if not len(poses.frame):
        raise FinloopError(
            f"{path} does not say where any animal is",
            "tracks with at least one place",
            "export them again",
        )
    return poses
