"""Poses as NWB with the extension ndx-pose: a file for each animal, as that format requires."""

import re
import warnings
from dataclasses import replace
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import numpy as np

from finloop.base.poses import Poses, iterate_blocks
from finloop.io.poses.extra import import_extra
from finloop.io.poses.netcdf import SOFTWARE

_UNKNOWN = datetime(1970, 1, 1, tzinfo=UTC)
_ABOUT = (
    "Points of one animal in a film, in px. Times are from the beginning of the film; when it was "
    "taken is not known, and session_start_time says 1970."
)


def save_nwb(folder: Path, poses: Poses, rate: Fraction, mm_per_px: float | None = None) -> None:
    """Write poses as NWB, a file <animal>.nwb each, in a new folder; rate: frames per second.

    Places are in px; if `mm_per_px` is known, each series' `conversion` gives millimetres.
    Characters that a file's name cannot hold become _. FinloopError if the extra `tracks` is not
    installed.
    """
    load, save = (
        import_extra("movement.io.load_poses", folder),
        import_extra("movement.io.save_poses", folder),
    )
    config, pynwb = (
        import_extra("movement.io.nwb", folder).NWBFileSaveConfig,
        import_extra("pynwb", folder),
    )
    import_extra("loguru", folder).logger.disable("movement")
    folder.mkdir(parents=True)
    series = {} if mm_per_px is None else {"unit": "millimeters", "conversion": mm_per_px}
    for number, name in enumerate(poses.individuals):
        rows = poses.individual == number
        animal = replace(
            poses, individuals=(name,), individual=np.zeros(rows.sum(), np.int64),
            frame=poses.frame[rows], places=poses.places[rows], confidence=poses.confidence[rows],
        )  # fmt: skip
        cells = np.concatenate([block for _, block in iterate_blocks(animal)])
        about = {"identifier": name, "session_description": _ABOUT, "session_start_time": _UNKNOWN}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            dataset = load.from_numpy(
                cells[..., :2].transpose(0, 3, 2, 1), cells[..., 2].transpose(0, 2, 1),
                [name], list(poses.keypoints), float(rate), SOFTWARE,
            )  # fmt: skip
            document = save.to_nwb_file(dataset, config(
                nwbfile_kwargs=about, pose_estimation_series_kwargs=series,
            ))  # fmt: skip
            plain = re.sub(r"[^\w.-]", "_", name)
            path = folder / f"{plain}.nwb"
            if path.exists():
                path = folder / f"{plain}_{number + 1}.nwb"
            with pynwb.NWBHDF5IO(path, "w") as file:
                file.write(document)
