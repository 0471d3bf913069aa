"""Tracks that `movement` reads: DeepLabCut, SLEAP, LightningPose, Anipose, NWB, VIA, its own."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, Software, poses_of
from finloop.io.poses.extra import import_extra, not_installed, unreadable


def read(path: Path, software: Software, rate_hz: float) -> Poses:
    """Load poses with `movement` from a file, or from a folder of NWB files, one per animal.

    rate_hz: frames per second of the film, for a file that has times and no rate. FinloopError if
    it is not what `software` writes.
    """
    files = sorted(path.glob("*.nwb")) if path.is_dir() else [path]
    sets = [_dataset(file, software) for file in files]
    if len({tuple(dataset.keypoints.values) for dataset in sets}) > 1:
        raise unreadable(path, software, "its animals have different keypoints")
    names = [str(name) for dataset in sets for name in dataset.individuals.values]
    if len(set(names)) < len(names):
        raise unreadable(path, software, f"animals of one name: {', '.join(names)}")
    frames = [_frames(dataset, rate_hz) for dataset in sets]
    times = np.unique(np.concatenate(frames))
    keypoints = tuple(str(name) for name in sets[0].keypoints.values)
    places = np.full((len(times), len(names), len(keypoints), 2), np.nan)
    confidence = np.full(places.shape[:-1], np.nan)
    first = 0
    for dataset, frame in zip(sets, frames, strict=True):
        rows, last = np.searchsorted(times, frame), first + dataset.sizes["individuals"]
        order = ("time", "individuals", "keypoints")
        places[rows, first:last] = dataset.position.transpose(*order, "space").values
        if "confidence" in dataset:
            confidence[rows, first:last] = dataset.confidence.transpose(*order).values
        first = last
    return poses_of(tuple(names), keypoints, times, places, confidence)


def _dataset(path: Path, software: Software) -> Any:
    """Load an xarray dataset of movement: position (time, space, keypoints, individuals)."""
    xarray = import_extra("xarray", path)
    load = import_extra("movement.io", path).load_dataset
    import_extra("loguru", path).logger.disable("movement")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if software == "movement":
                dataset = xarray.load_dataset(path)
            else:
                dataset = load(path, source_software=software)
    except ImportError as error:
        raise not_installed(path, error) from error
    except Exception as error:  # a library of many formats may raise anything for a damaged file
        raise unreadable(path, software, f"{type(error).__name__}: {error}") from error
    if "position" not in dataset or not {"time", "space", "individuals"} <= set(dataset.dims):
        raise unreadable(path, software, "it holds no positions by time, space and individual")
    if dataset.sizes["space"] != 2:
        raise FinloopError(
            f"{path} holds places in {dataset.sizes['space']} dimensions",
            "places in the picture of one camera, x and y in px",
            "give the tracks that were made in this film, before they were triangulated",
        )
    if "keypoints" not in dataset.dims:  # of boxes
        dataset = dataset.expand_dims(keypoints=["centre"])
    return dataset.sel(space=["x", "y"])


def _frames(dataset: Any, rate_hz: float) -> np.ndarray:
    """Return the numbers of the frames, (times,)."""
    time = dataset.time.values.astype(float)
    if dataset.attrs.get("time_unit") == "seconds":
        time = time * float(dataset.attrs.get("fps") or rate_hz)
    return np.rint(time).astype(np.int64)
