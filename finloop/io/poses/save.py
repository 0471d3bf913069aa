"""Poses in the formats of `movement`: netCDF of all animals, and NWB, a file for each animal."""

import re
import warnings
from dataclasses import replace
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path

import numpy as np

from finloop.base.poses import BLOCK, Poses, iterate_blocks
from finloop.io.atomic import whole_file
from finloop.io.poses.extra import import_extra

_SOFTWARE = "finloop"
_UNKNOWN = datetime(1970, 1, 1, tzinfo=UTC)
_DESCRIPTION = (
    "Points of one animal in a film, in px. Times are from the beginning of the film; when it was "
    "taken is not known, and session_start_time says 1970."
)


def save_netcdf(path: Path, poses: Poses, rate: Fraction, mm_per_px: float | None = None) -> None:
    """Write poses as a netCDF file that `movement` reads, completely or not at all.

    rate: frames per second. Dimensions are time, space, keypoints, individuals. If `mm_per_px` is
    known, the variable `position_mm` has the places in mm. FinloopError if the extra packages
    `tracks` are not installed.
    """
    h5netcdf, text_type = import_extra("h5netcdf", path), import_extra("h5py", path).string_dtype()
    sizes = {
        "time": poses.frames, "space": 2,
        "keypoints": len(poses.keypoints), "individuals": len(poses.individuals),
    }  # fmt: skip
    with whole_file(path) as part, h5netcdf.File(part, "w") as file:
        file.dimensions = sizes
        attributes = {"source_software": _SOFTWARE, "ds_type": "poses", "time_unit": "seconds"}
        file.attrs.update(attributes | {"fps": float(rate)})
        time = file.create_variable("time", ("time",), np.float64)
        time[:] = np.arange(poses.frames) / float(rate)
        for name, labels in (
            ("space", ("x", "y")), ("keypoints", poses.keypoints),
            ("individuals", poses.individuals),
        ):  # fmt: skip
            file.create_variable(name, (name,), text_type)[:] = np.array(labels, object)
        kind = {"dtype": np.float32, "fillvalue": np.float32(np.nan), "compression": "gzip"}
        chunks = (min(BLOCK, max(1, poses.frames)), *list(sizes.values())[1:])
        position = file.create_variable("position", tuple(sizes), chunks=chunks, **kind)
        position.attrs["units"] = "px"
        if mm_per_px is not None:
            file.attrs["mm_per_px"] = mm_per_px
            in_mm = file.create_variable("position_mm", tuple(sizes), chunks=chunks, **kind)
            in_mm.attrs["units"] = "mm"
        axes, without_space = ("time", "keypoints", "individuals"), (chunks[0], *chunks[2:])
        confidence = file.create_variable("confidence", axes, chunks=without_space, **kind)
        # cells: (frames, individuals, keypoints, 3), x, y and confidence.
        for start, cells in iterate_blocks(poses):
            block = slice(start, start + len(cells))
            places = cells[..., :2].transpose(0, 3, 2, 1)
            position[block] = places
            if mm_per_px is not None:
                in_mm[block] = places * mm_per_px
            confidence[block] = cells[..., 2].transpose(0, 2, 1)


def save_nwb(folder: Path, poses: Poses, rate: Fraction, mm_per_px: float | None = None) -> None:
    """Write poses as NWB files (ndx-pose), one <animal>.nwb for each animal, in a new folder.

    rate: frames per second. Places are in px; if `mm_per_px` is known, each series' `conversion`
    gives millimetres. Characters that a file's name cannot hold become _. FinloopError if the extra
    `tracks` is not installed.
    """
    load = import_extra("movement.io.load_poses", folder)
    save = import_extra("movement.io.save_poses", folder)
    config = import_extra("movement.io.nwb", folder).NWBFileSaveConfig
    pynwb = import_extra("pynwb", folder)
    import_extra("loguru", folder).logger.disable("movement")
    folder.mkdir(parents=True)
    series = {} if mm_per_px is None else {"unit": "millimeters", "conversion": mm_per_px}
    for number, name in enumerate(poses.individuals):
        # (frames, 1 individual, keypoints, 3): x, y and confidence.
        blocks = iterate_blocks(_select_animal(poses, number))
        cells = np.concatenate([block for _, block in blocks])
        metadata = {
            "identifier": name,
            "session_description": _DESCRIPTION,
            "session_start_time": _UNKNOWN,
        }
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            dataset = load.from_numpy(
                cells[..., :2].transpose(0, 3, 2, 1), cells[..., 2].transpose(0, 2, 1),
                [name], list(poses.keypoints), float(rate), _SOFTWARE,
            )  # fmt: skip
            document = save.to_nwb_file(dataset, config(
                nwbfile_kwargs=metadata, pose_estimation_series_kwargs=series,
            ))  # fmt: skip
            plain = re.sub(r"[^\w.-]", "_", name)
            path = folder / f"{plain}.nwb"
            if path.exists():
                path = folder / f"{plain}_{number + 1}.nwb"
            with pynwb.NWBHDF5IO(path, "w") as file:
                file.write(document)


def _select_animal(poses: Poses, number: int) -> Poses:
    """Return the poses of one animal alone; number: of the animal among `poses.individuals`."""
    rows = poses.individual == number
    return replace(
        poses, individuals=(poses.individuals[number],),
        individual=np.zeros(rows.sum(), np.int64), frame=poses.frame[rows],
        places=poses.places[rows], confidence=poses.confidence[rows],
    )  # fmt: skip
