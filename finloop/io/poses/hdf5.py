"""Tracks in HDF5: SLEAP's project and analysis, NWB with ndx-pose, the netCDF of movement.

h5py alone reads them. The libraries of these programs do more: they open films that a file names,
and build classes from it.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from finloop.base.poses import Poses, poses_from_arrays, poses_from_rows
from finloop.io.limits import refuse_bomb
from finloop.io.poses.extra import import_extra

_MOST_NAMES, _MOST_LETTERS = 100_000, 1_000_000
_POSES = "processing/behavior/PoseEstimation"  # in NWB, where movement and ndx-pose put it
_EDGES_OF_PIXELS = 1.1  # SLEAP's formats before count places from a pixel's edge, not its centre
_PREDICTED = 1  # an instance of SLEAP that the network found; 0: one that a person set


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for a block; FinloopError if h5py is not installed."""
    with import_extra("h5py", path).File(path) as file:
        yield file


def read_values(dataset: Any) -> NDArray[Any]:
    """Return a dataset of an HDF5 file as an array; ValueError if it holds other than numbers.

    Its fields hold numbers, too, if it is a table. FinloopError if it declares far more than its
    file can hold.
    """
    kinds = [dataset.dtype[name].base for name in dataset.dtype.names or ()] or [dataset.dtype]
    if any(kind.kind not in "biuf" for kind in kinds):
        raise ValueError(f"{dataset.name} holds {dataset.dtype}, not numbers")
    path = Path(dataset.file.filename)
    name = f"{dataset.name} of {path}, {tuple(dataset.shape)},"
    refuse_bomb(name, dataset.nbytes, path.stat().st_size, "export the tracks again")
    return np.asarray(dataset[()])


def read_names(dataset: Any) -> list[str]:
    """Return a dataset of texts; ValueError if they are too many or too long for names."""
    if len(dataset) > _MOST_NAMES:
        raise ValueError(f"{dataset.name} has {len(dataset)} names")
    names, letters = [], 0
    for k in range(len(dataset)):  # one by one: all may refer to one long text
        names.append(_decode(dataset[k]))
        letters += len(names[-1])
        if letters > _MOST_LETTERS:
            raise ValueError(f"{dataset.name} has names of more than {_MOST_LETTERS} letters")
    return names


def _decode(text: Any) -> str:
    """Return an HDF5 text, which h5py gives as bytes or as a text."""
    return text.decode() if isinstance(text, bytes) else str(text)


def _number_names(names: list[str], count: int) -> tuple[str, ...]:
    """Return the names of so many animals; id_0, id_1, … if the file names none."""
    return tuple(names or (f"id_{k}" for k in range(count)))


def read_sleap_analysis(path: Path) -> Poses:
    """Load poses of an analysis that SLEAP exported, .h5."""
    with open_hdf5(path) as file:
        tracks = read_values(file["tracks"])  # (animals, 2, keypoints, frames)
        places = tracks.transpose(3, 0, 2, 1).astype(float)
        confidence = None
        if "point_scores" in file:
            confidence = read_values(file["point_scores"]).transpose(2, 0, 1).astype(float)
        names = _number_names(read_names(file["track_names"]), places.shape[1])
        nodes = tuple(read_names(file["node_names"]))
    return poses_from_arrays(names, nodes, np.arange(len(places)), places, confidence)


def read_sleap_project(path: Path) -> Poses:
    """Load poses of a project of SLEAP, .slp: those of its first film and last skeleton.

    Where a person has set an animal in a frame, that counts, else the last prediction; an animal
    without a track counts only if the project has no tracks.
    """
    with open_hdf5(path) as file:
        facts = file["metadata"].attrs
        text = facts["json"]
        project = json.loads(text.tobytes() if isinstance(text, np.ndarray) else _decode(text))
        version = float(facts.get("format_id", 1.0))
        tracks = [str(json.loads(name)[1]) for name in read_names(file["tracks_json"])]
        frames, instances = (read_values(file[name]) for name in ("frames", "instances"))
        points = [read_values(file[name]) for name in ("points", "pred_points")]
    skeleton = project["skeletons"][-1]
    nodes = skeleton.get("nx_graph", skeleton)["nodes"]
    keypoints = tuple(str(project["nodes"][node["id"]]["name"]) for node in nodes)
    frames = frames[frames["video"] == frames["video"].min()]
    if tracks:
        instances = instances[instances["track"] >= 0]
    instances = instances[np.isin(instances["frame_id"], frames["frame_id"])]
    frames = frames[np.argsort(frames["frame_id"])]
    place = np.searchsorted(frames["frame_id"], instances["frame_id"])
    frame = frames["frame_idx"][place].astype(np.int64)
    animal = instances["track"].astype(np.int64) if tracks else np.zeros(len(frame), np.int64)
    is_user = instances["instance_type"] != _PREDICTED
    # Of each animal in each frame, the last row in this order counts.
    order = np.lexsort((np.arange(len(frame)), is_user, animal, frame))
    is_last = np.diff(frame[order], append=-1) != 0
    is_last |= np.diff(animal[order], append=-1) != 0
    rows = order[is_last]
    first, end = (instances[f"point_id_{name}"][rows].astype(np.int64) for name in ("start", "end"))
    if (end - first != len(keypoints)).any() or (first < 0).any():
        raise ValueError("its animals have other points than its skeleton")
    size = len(rows) * len(keypoints) * 3 * 8
    refuse_bomb(path, size, path.stat().st_size, "export the analysis of SLEAP, .h5")
    values = np.full((len(rows), len(keypoints), 3), np.nan)
    for kind, chosen in zip(points, (is_user[rows], ~is_user[rows]), strict=True):
        table = kind[first[chosen][:, None] + np.arange(len(keypoints))]
        names = kind.dtype.names or ()
        for k, name in enumerate(name for name in ("x", "y", "score") if name in names):
            values[chosen, :, k] = np.where(table["visible"], table[name], np.nan)
    if version < _EDGES_OF_PIXELS:
        values[..., :2] -= 0.5
    animals = _number_names(tracks, 1)
    return poses_from_rows(
        animals, keypoints, frame[rows], animal[rows], values[..., :2], values[..., 2]
    )


def read_nwb(path: Path) -> Poses:
    """Load poses from an NWB file with ndx-pose, of one animal, or a folder with one for each.

    ValueError if the animals of a folder have different keypoints or one name.
    """
    files = sorted(path.glob("*.nwb")) if path.is_dir() else [path]
    animals = [_read_nwb_file(file) for file in files]
    if len({animal.keypoints for animal in animals}) != 1:
        raise ValueError("its animals have different keypoints")
    names = tuple(name for animal in animals for name in animal.individuals)
    if len(set(names)) < len(names):
        raise ValueError(f"animals of one name: {', '.join(names)}")
    counts = [len(animal.frame) for animal in animals]
    return poses_from_rows(
        names, animals[0].keypoints, np.concatenate([animal.frame for animal in animals]),
        np.repeat(np.arange(len(animals)), counts),
        np.concatenate([animal.places for animal in animals]),
        np.concatenate([animal.confidence for animal in animals]),
    )  # fmt: skip


def _read_nwb_file(path: Path) -> Poses:
    """Load the poses of the animal in an NWB file; a series of places is a keypoint."""
    with open_hdf5(path) as file:
        if _POSES not in file:
            raise ValueError(f"it has no {_POSES}")
        series = {
            name: item for name, item in file[_POSES].items()
            if _decode(item.attrs.get("neurodata_type", "")) == "PoseEstimationSeries"
        }  # fmt: skip
        if not series or len(series) > _MOST_NAMES:
            raise ValueError(f"{_POSES} has {len(series)} series of places")
        data = [read_values(item["data"]).astype(float) for item in series.values()]
        scores = [
            read_values(item["confidence"]).astype(float) if "confidence" in item else None
            for item in series.values()
        ]
        name = _decode(file["identifier"][()])
    frames = max(map(len, data))
    refuse_bomb(path, frames * len(data) * 24, path.stat().st_size, "export the tracks again")
    values = np.full((frames, 1, len(data), data[0].shape[1] + 1), np.nan)
    for k, (places, confidence) in enumerate(zip(data, scores, strict=True)):
        values[: len(places), 0, k, :-1] = places
        if confidence is not None:
            values[: len(confidence), 0, k, -1] = confidence
    places, confidence = values[..., :-1], values[..., -1]
    return poses_from_arrays((name,), tuple(series), np.arange(frames), places, confidence)


def read_movement(path: Path, rate_hz: float) -> Poses:
    """Load poses from a dataset of movement, a netCDF file of version 4.

    rate_hz: frames per second, for a file that has times and no rate. Boxes around animals give
    their centres.
    """
    with open_hdf5(path) as file:
        position = file["position"]
        axes = [_axis_name(position, k) for k in range(position.ndim)]
        if not {"time", "space", "individuals"} <= set(axes):
            raise ValueError("it holds no positions by time, space and individual")
        places = _order_axes(position, axes, ("time", "individuals", "keypoints", "space"))
        confidence = None
        if "confidence" in file:
            axes = [_axis_name(file["confidence"], k) for k in range(file["confidence"].ndim)]
            confidence = _order_axes(file["confidence"], axes, ("time", "individuals", "keypoints"))
        space = read_names(file["space"])
        names = read_names(file["individuals"])
        keypoints = read_names(file["keypoints"]) if "keypoints" in file else ["centre"]
        time = read_values(file["time"]).astype(float)
        if _decode(file.attrs.get("time_unit", "")) == "seconds":
            time = time * float(np.ravel(file.attrs.get("fps", rate_hz))[0])
    places = places[..., [space.index(axis) for axis in "xyz" if axis in space]]
    frames = np.rint(time).astype(np.int64)
    return poses_from_arrays(tuple(names), tuple(keypoints), frames, places, confidence)


def _axis_name(dataset: Any, axis: int) -> str:
    """Return the name of a dimension of a netCDF variable."""
    return str(dataset.dims[axis][0].name).rsplit("/", 1)[-1]


def _order_axes(dataset: Any, axes: list[str], wanted: tuple[str, ...]) -> NDArray[Any]:
    """Return a netCDF variable with its axes in the wanted order; a missing axis has length 1."""
    values = read_values(dataset).astype(float)
    for name in wanted:
        if name not in axes:
            values, axes = values[..., None], [*axes, name]
    return values.transpose([axes.index(name) for name in wanted])
