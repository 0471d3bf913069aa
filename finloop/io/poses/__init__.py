"""Tracks that another program made, as poses: which program, and where animals are in each frame.

`movement` reads every format that it knows; it is optional (the extra `tracks`). idtracker.ai and
TRex, which it does not know, are read here.
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
    """The poses of a file, or of a folder with a file for each animal.

    Frames are those of the film that the program saw, from 0. FinloopError if there is nothing, the
    format is not known or not the one that is said, the file is damaged, is three-dimensional, or
    holds no animal.

    software: that made it; None = as the file shows.
    rate_hz: of the film, for a file that says times and no rate; parameter: that names the file.
    """
    if not path.exists():
        raise FinloopError(
            f"there is nothing at {path.absolute()}",
            f"tracks of {', '.join(get_args(Software))}",
            f"correct {parameter}; give it whole, a temporary experiment starts elsewhere",
        )
    software = software_of(path) if software is None else software
    own = _OWN.get(software)
    poses = own(path) if own else by_movement(path, software, rate_hz)
    if not len(poses.frame):
        raise FinloopError(
            f"{path} says nowhere where an animal is",
            "tracks with at least one place",
            "export them again",
        )
    return poses
