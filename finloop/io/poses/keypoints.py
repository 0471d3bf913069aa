"""Tracks in tables of keypoints: DeepLabCut, LightningPose, FastTrack, the CSV of SLEAP's analysis.

A table of DeepLabCut has a column for each number of each keypoint of each animal. Its head has the
rows scorer, individuals (of several animals), bodyparts and coords. LightningPose writes the same,
with a row `set` where a frame belonged to the training.
"""

import io
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses, poses_from_arrays
from finloop.io.poses.extra import import_extra, unreadable_error
from finloop.io.poses.pickled import load_harmless_pickle
from finloop.io.poses.text import TEXTS, read_plain_csv

_COORDS = ("x", "y", "likelihood")
FASTTRACK_NAME = "tracking.txt"
_FASTTRACK_PARTS = {"head": "Head", "centre": "Body", "tail": "Tail"}  # keypoint: in its columns
_KEY = "df_with_missing"  # of the table in an HDF5 file of DeepLabCut
Labels = list[tuple[str, ...]]
"""The head of a table: for each column its scorer, animal if there are several, keypoint, coord."""


def read_deeplabcut(path: Path, software: str = "DeepLabCut") -> Poses:
    """Load poses of DeepLabCut or LightningPose from a .csv or .h5.

    Keypoints that belong to no animal (`uniquebodyparts` of DeepLabCut) are left out and named on
    the error stream. software: for messages, and the name of an animal that the file does not name.
    FinloopError if the file is none of these.
    """
    read = _read_csv if path.suffix.lower() in TEXTS else _read_hdf5
    try:
        labels, frame, values = read(path)
    except (
        AttributeError, LookupError, OSError, TypeError, ValueError, pickle.UnpicklingError,
    ) as error:  # fmt: skip
        raise unreadable_error(path, software, error) from error
    # A label is (scorer, animal, keypoint, coordinate); a file of one animal leaves its name out.
    columns = [
        (label[1] if len(label) == 4 else software, label[-2], label[-1]) for label in labels
    ]
    animals, keypoints = _find_animals(columns, path)
    cells = np.full((len(frame), len(animals), len(keypoints), len(_COORDS)), np.nan)
    for (animal, keypoint, coord), column in zip(columns, values.T, strict=True):
        if animal in animals and coord in _COORDS:
            place = animals.index(animal), keypoints.index(keypoint), _COORDS.index(coord)
            cells[:, *place] = column
    return poses_from_arrays(tuple(animals), tuple(keypoints), frame, cells[..., :2], cells[..., 2])


def _find_animals(columns: list[tuple[str, str, str]], path: Path) -> tuple[list[str], list[str]]:
    """Return the names of a table's animals, and of the keypoints that every animal has.

    columns: animal, keypoint and coordinate of each column. Animals are those that have the most
    frequent list of keypoints; a message on the error stream names the others, and the file `path`.
    """
    keypoints: dict[str, list[str]] = {}  # of each animal
    for animal, keypoint in dict.fromkeys(column[:2] for column in columns):
        keypoints.setdefault(animal, []).append(keypoint)
    # DeepLabCut calls the owner of `uniquebodyparts` so.
    keypoint_lists = [keypoints[name] for name in keypoints if name != "single"] or [
        *keypoints.values()
    ]
    usual = max(keypoint_lists, key=keypoint_lists.count)
    if others := [name for name in keypoints if keypoints[name] != usual]:
        print(
            f"finloop: {path.name}: {', '.join(others)} has other keypoints than the animals "
            f"({', '.join(keypoints[others[0]])}): left out",
            file=sys.stderr,
        )
    return [name for name in keypoints if keypoints[name] == usual], usual


def _read_csv(path: Path) -> tuple[Labels, Ints, Floats]:
    """Return the labels of the columns, the frames (n,) and the numbers (n, columns) of a CSV.

    A label is the words above a column. ValueError if the file is no such table.
    """
    text = io.StringIO(read_plain_csv(path))
    table = pd.read_csv(text, header=None, index_col=0, dtype=str, keep_default_na=False)
    head = [str(name).strip() for name in table.index[:4]]
    head_rows = head.index("coords") + 1  # scorer, perhaps individuals, bodyparts, coords
    if head[0] != "scorer" or head[head_rows - 2] != "bodyparts":
        raise ValueError(f"its first column begins with {', '.join(head)}")
    labels = list(zip(*table.iloc[:head_rows].to_numpy(), strict=True))
    rows = table.iloc[head_rows:]
    number_columns = [k for k, label in enumerate(labels) if label[-1] in _COORDS]
    if not number_columns:
        raise ValueError("it has no columns x and y")
    cells = rows.iloc[:, number_columns]
    values = cells.apply(pd.to_numeric, errors="coerce").to_numpy(float)
    words = cells.to_numpy()[np.isnan(values)]
    if strange := sorted({word.strip() for word in words} - {"", "nan", "NaN", "NA", "None"}):
        raise ValueError(f"{strange[0]!r} is no number")
    frame = pd.to_numeric(pd.Series(rows.index), errors="coerce")
    if frame.isna().any():  # labelled pictures are named, not numbered
        raise ValueError(f"its rows are named, such as {rows.index[0]!r}, and not numbered")
    return [labels[k] for k in number_columns], frame.to_numpy(np.int64), values


def _read_hdf5(path: Path) -> tuple[Labels, Ints, Floats]:
    """Return the labels of the columns, the frames (n,) and the numbers (n, columns) of an HDF5.

    A label is the words above a column. pandas writes a table in one of two formats: as rows, with
    the labels as a pickle; or as separate arrays.
    """
    h5py = import_extra("h5py", path)
    with h5py.File(path) as file:
        group = file[_KEY]
        if "table" in group:
            rows = group["table"][()]
            blocks = [name for name in rows.dtype.names if name != "index"]
            values = np.concatenate([rows[name].reshape(len(rows), -1) for name in blocks], axis=1)
            axes: Any = load_harmless_pickle(io.BytesIO(group.attrs["non_index_axes"]))
            return [tuple(map(str, label)) for label in axes[0][1]], rows["index"], values
        # Fixed format: for each row of the head, its different words, and each column's word.
        levels = [
            group[f"axis0_level{k}"][()].astype(str)[group[f"axis0_label{k}"][()]]
            for k in range(int(group.attrs["axis0_nlevels"]))
        ]
        return list(zip(*levels, strict=True)), group["axis1"][()], group["block0_values"][()]


def read_sleap_csv(path: Path) -> Poses:
    """Load poses from the CSV of SLEAP's analysis: a row for each animal in each frame.

    Columns are track, frame_idx, and for each node node.x, node.y, node.score. FinloopError if a
    column is missing, or a track occurs twice in a frame; all animals without one are one track.
    """
    try:
        table = pd.read_csv(io.StringIO(read_plain_csv(path)))
        nodes = [name.removesuffix(".x") for name in table if name.endswith(".x")]
        columns = [[f"{node}.{part}" for part in ("x", "y", "score")] for node in nodes]
        values = table[np.ravel(columns)].to_numpy(float).reshape(len(table), len(nodes), 3)
        frame, animal = table["frame_idx"].to_numpy(np.int64), table["track"].fillna("animal")
    except (LookupError, TypeError, ValueError) as error:
        raise unreadable_error(path, "SLEAP", error) from error
    return _poses_from_rows(path, "SLEAP", frame, animal, nodes, values)


def read_fasttrack(path: Path) -> Poses:
    """Load poses of FastTrack's `tracking.txt`, or of the folder with it: head, centre and tail.

    It has a row for each animal in each frame, with the columns xHead, yHead, xBody, yBody, xTail,
    yTail, imageNumber and, of several animals, id. FinloopError if a column is missing, or an
    animal occurs twice in a frame.
    """
    path = path / FASTTRACK_NAME if path.is_dir() else path
    columns = [f"{axis}{part}" for part in _FASTTRACK_PARTS.values() for axis in "xy"]
    try:
        table = pd.read_csv(io.StringIO(read_plain_csv(path)))
        places = table[columns].to_numpy(float).reshape(len(table), len(_FASTTRACK_PARTS), 2)
        frame = table["imageNumber"].to_numpy(np.int64)
        animal = table["id"] if "id" in table else pd.Series(np.zeros(len(table), np.int64))
    except (LookupError, OSError, TypeError, ValueError) as error:
        raise unreadable_error(path, "FastTrack", error) from error
    return _poses_from_rows(path, "FastTrack", frame, animal, list(_FASTTRACK_PARTS), places)


def _poses_from_rows(
    path: Path, software: str, frame: Ints, animal: pd.Series, keypoints: list[str], values: Floats
) -> Poses:
    """Return the poses in rows, each of an animal in a frame; FinloopError if one occurs twice.

    frame (rows,): numbers; animal (rows,): names; values (rows, keypoints, 2 or 3): x, y, perhaps
    confidence. path, software: for the message.
    """
    duplicated = pd.DataFrame({"frame": frame, "animal": animal.to_numpy()}).duplicated().to_numpy()
    if duplicated.any():
        name = animal[duplicated].iloc[0]
        raise FinloopError(
            f"{path} has several places of the animal {name} in frame {frame[duplicated][0]}",
            f"one row for each animal in each frame, as {software} writes with tracks",
            f"track the animals in {software}, so that each has a name, and export again",
        )
    frames, row = np.unique(frame, return_inverse=True)
    number, names = pd.factorize(animal)
    cells = np.full((len(frames), len(names), len(keypoints), 3), np.nan)
    cells[row, number, :, : values.shape[-1]] = values
    return poses_from_arrays(
        tuple(map(str, names)), tuple(keypoints), frames, cells[..., :2], cells[..., 2]
    )
