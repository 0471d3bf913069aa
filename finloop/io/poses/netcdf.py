"""Poses as `movement` stores them: netCDF with dimensions time, space, keypoints, individuals.

`xarray.load_dataset` reads it as a dataset of movement, in seconds.
"""

from fractions import Fraction
from pathlib import Path

import numpy as np

from finloop.base.poses import BLOCK, Poses, iterate_blocks
from finloop.io.atomic import whole_file
from finloop.io.poses.extra import import_extra

SOFTWARE = "finloop"


def save_netcdf(path: Path, poses: Poses, rate: Fraction, mm_per_px: float | None = None) -> None:
    """Write poses as netCDF of `movement`, completely or not at all; rate: frames per second.

    If `mm_per_px` is known, the variable `position_mm` has the places in mm. FinloopError if the
    extra `tracks` is not installed.
    """
    h5netcdf, words = import_extra("h5netcdf", path), import_extra("h5py", path).string_dtype()
    sizes = {
        "time": poses.frames, "space": 2,
        "keypoints": len(poses.keypoints), "individuals": len(poses.individuals),
    }  # fmt: skip
    with whole_file(path) as part, h5netcdf.File(part, "w") as file:
        file.dimensions = sizes
        attributes = {"source_software": SOFTWARE, "ds_type": "poses", "time_unit": "seconds"}
        file.attrs.update(attributes | {"fps": float(rate)})
        time = file.create_variable("time", ("time",), np.float64)
        time[:] = np.arange(poses.frames) / float(rate)
        for name, labels in (
            ("space", ("x", "y")), ("keypoints", poses.keypoints),
            ("individuals", poses.individuals),
        ):  # fmt: skip
            file.create_variable(name, (name,), words)[:] = np.array(labels, object)
        kind = {"dtype": np.float32, "fillvalue": np.float32(np.nan), "compression": "gzip"}
        chunk = (min(BLOCK, max(1, poses.frames)), *list(sizes.values())[1:])
        position = file.create_variable("position", tuple(sizes), chunks=chunk, **kind)
        position.attrs["units"] = "px"
        if mm_per_px is not None:
            file.attrs["mm_per_px"] = mm_per_px
            in_mm = file.create_variable("position_mm", tuple(sizes), chunks=chunk, **kind)
            in_mm.attrs["units"] = "mm"
        confidence = file.create_variable(
            "confidence",
            ("time", "keypoints", "individuals"),
            chunks=(chunk[0], *chunk[2:]),
            **kind,
        )
        for start, cells in iterate_blocks(poses):
            here = slice(start, start + len(cells))
            position[here] = places = cells[..., :2].transpose(0, 3, 2, 1)
            if mm_per_px is not None:
                in_mm[here] = places * mm_per_px
            confidence[here] = cells[..., 2].transpose(0, 2, 1)
