"""Tracks in tables: DeepLabCut, LightningPose, FastTrack, VIA, the CSV of SLEAP's analysis.

A table of DeepLabCut has a column for each number of each keypoint of each animal. Its head has the
rows scorer, individuals (of several animals), bodyparts and coords. LightningPose writes the same,
with a row `set` where a frame belonged to the training.
"""

import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.base.poses import Poses, poses_from_arrays, poses_from_rows
from finloop.io.limits import refuse_bomb
from finloop.io.poses.hdf5 import open_hdf5, read_names, read_values
from finloop.io.poses.pickled import load_plain_pickle
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
    """
    read = _read_csv if path.suffix.lower() in TEXTS else _read_hdf5
    labels, frame, values = read(path)
    # A label is (scorer, animal, keypoint, coordinate); a file of one animal leaves its name out.
    columns = [
        (label[1] if len(label) == 4 else software, label[-2], label[-1]) for label in labels
    ]
    animals, keypoints = _find_animals(columns, path)
    size = len(frame) * len(animals) * len(keypoints) * len(_COORDS) * 8
    refuse_bomb(path, size, path.stat().st_size, "export the tracks again")
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
    with open_hdf5(path) as file:
        group = file[_KEY]
        if "table" in group:
            rows = read_values(group["table"])
            blocks = [name for name in rows.dtype.names or () if name != "index"]
            values = np.concatenate([rows[name].reshape(len(rows), -1) for name in blocks], axis=1)
            axes: Any = load_plain_pickle(io.BytesIO(group.attrs["non_index_axes"]))
            return [_read_label(label) for label in axes[0][1]], rows["index"], values
        # Fixed format: for each row of the head, its different words, and each column's word.
        levels = [
            np.array(read_names(group[f"axis0_level{k}"]))[read_values(group[f"axis0_label{k}"])]
            for k in range(int(group.attrs["axis0_nlevels"]))
        ]
        labels = list(zip(*levels, strict=True))
        return labels, read_values(group["axis1"]), read_values(group["block0_values"])


def _read_label(label: Any) -> tuple[str, ...]:
    """Return the words above a column; ValueError if they are no words."""
    if not isinstance(label, tuple) or not all(isinstance(word, str) for word in label):
        raise ValueError("its columns are not named by words")
    return label


def read_sleap_csv(path: Path) -> Poses:
    """Load poses from the CSV of SLEAP's analysis: a row for each animal in each frame.

    Columns are track, frame_idx, and for each node node.x, node.y, node.score. All animals without
    a track are one animal.
    """
    table = pd.read_csv(io.StringIO(read_plain_csv(path)))
    nodes = [name.removesuffix(".x") for name in table if name.endswith(".x")]
    columns = [[f"{node}.{part}" for part in ("x", "y", "score")] for node in nodes]
    values = table[np.ravel(columns)].to_numpy(float).reshape(len(table), len(nodes), 3)
    frame, animal = table["frame_idx"].to_numpy(np.int64), table["track"].fillna("animal")
    return _poses_from_named_rows(frame, animal, nodes, values)


def read_fasttrack(path: Path) -> Poses:
    """Load poses of FastTrack's `tracking.txt`, or of the folder with it: head, centre and tail.

    It has a row for each animal in each frame, with the columns xHead, yHead, xBody, yBody, xTail,
    yTail, imageNumber and, of several animals, id.
    """
    path = path / FASTTRACK_NAME if path.is_dir() else path
    columns = [f"{axis}{part}" for part in _FASTTRACK_PARTS.values() for axis in "xy"]
    table = pd.read_csv(io.StringIO(read_plain_csv(path)))
    places = table[columns].to_numpy(float).reshape(len(table), len(_FASTTRACK_PARTS), 2)
    frame = table["imageNumber"].to_numpy(np.int64)
    animal = table["id"] if "id" in table else pd.Series(np.zeros(len(table), np.int64))
    return _poses_from_named_rows(frame, animal, list(_FASTTRACK_PARTS), places)


def read_via(path: Path) -> Poses:
    """Load the centres of the boxes that VIA tracked, from its CSV with a row for each box.

    Pictures are numbered by their attribute `frame`, else by the number at the end of their name;
    the first picture is frame 0, and the others follow it without gaps. `track` names the animal.
    """
    table = pd.read_csv(io.StringIO(read_plain_csv(path)), dtype=str, keep_default_na=False)
    columns = ("file_attributes", "region_shape_attributes", "region_attributes")
    files, boxes, regions = ([json.loads(text) for text in table[name]] for name in columns)
    number = [
        int(facts["frame"] if "frame" in facts else re.findall(r"\d+", Path(name).stem)[-1])
        for facts, name in zip(files, table["filename"], strict=True)
    ]
    corners = np.array(
        [[box[key] for key in ("x", "y", "width", "height")] for box in boxes], float
    )
    confidence = np.array([float(facts.get("confidence", "nan")) for facts in regions])
    centres = corners[:, :2] + corners[:, 2:] / 2
    values = np.concatenate([centres, confidence[:, None]], axis=1)[:, None]
    animal = pd.Series([f"id_{int(facts['track'])}" for facts in regions])
    _, frame = np.unique(number, return_inverse=True)
    return _poses_from_named_rows(frame, animal, ["centre"], values)


def _poses_from_named_rows(
    frame: Ints, animal: pd.Series, keypoints: list[str], values: Floats
) -> Poses:
    """Return the poses in rows, each of an animal, by its name, in a frame.

    frame (rows,): numbers; animal (rows,): names; values (rows, keypoints, 2 or 3): x, y, perhaps
    confidence.
    """
    number, names = pd.factorize(animal)
    confidence = values[..., 2] if values.shape[-1] > 2 else None
    return poses_from_rows(
        tuple(map(str, names)), tuple(keypoints), frame, number, values[..., :2], confidence
    )
