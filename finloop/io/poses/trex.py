"""Tracks of TRex: a file .npz or .csv for each animal, alone or in a folder.

`X#wcentroid` is the body's centre and `X` the head, in cm unless a CSV says (px). `cm_per_pixel` is
the size of a pixel; where the file lacks it, it is that of TRex's settings, `*.settings`, in the
same folder or the one above. Frames that are `missing` are interpolated there; they are left out.
"""

import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.base.poses import Poses, poses_from_rows
from finloop.io.limits import refuse_bomb
from finloop.io.poses.extra import unreadable_error
from finloop.io.poses.text import TEXTS, read_plain_csv

SOFTWARE, HEAD, CENTRE = "TRex", "head", "centre"
_SCALE = re.compile(r"^[ \t]*cm_per_pixel[ \t]*[=:][ \t]*([\d.eE+-]+)", re.MULTILINE)
_CENTRES = ("#wcentroid", "#centroid", "#pcentroid")


def read_trex(path: Path) -> Poses:
    """Load poses of TRex, head and centre, from a file, a folder of files or its folder `data`.

    FinloopError if nothing there can be read.
    """
    fields_of_files = {file: _load_fields(file) for file in _list_files(path)}
    tracks = {file: fields for file, fields in fields_of_files.items() if "frame" in fields}
    if not tracks:
        raise unreadable_error(path, SOFTWARE, "no file of it has `frame` and places")
    try:
        frames_and_points = [_to_points(fields) for fields in tracks.values()]
    except (KeyError, ValueError) as error:
        raise unreadable_error(
            path, SOFTWARE, f"{error} is missing or of another length"
        ) from error
    frame, places = (np.concatenate(parts) for parts in zip(*frames_and_points, strict=True))
    animal = np.repeat(np.arange(len(tracks)), [len(frame) for frame, _ in frames_and_points])
    # An animal's name is the part after the film's, such as `id3`.
    names = [file.stem.rsplit("_", 1)[-1] for file in tracks]
    if len(set(names)) < len(names):
        names = [file.stem for file in tracks]
    return poses_from_rows(tuple(names), (HEAD, CENTRE), frame, animal, places)


def _list_files(path: Path) -> list[Path]:
    """Return the files with tracks at a path, in natural order: id2 before id10.

    FinloopError if a folder has none.
    """
    if path.is_file():
        return [path]
    home = path / "data" if (path / "data").is_dir() else path
    for suffix in (".npz", ".csv"):
        files = [file for file in home.iterdir() if file.suffix.lower() == suffix]
        if files:
            return sorted(files, key=_number_key)
    raise unreadable_error(path, SOFTWARE, "the folder holds neither .npz nor .csv")


def _number_key(path: Path) -> tuple[list[int], str]:
    """Return a key that sorts files by the numbers in their names: id2 before id10."""
    return [int(number) for number in re.findall(r"\d+", path.stem)], path.name


def _load_fields(path: Path) -> dict[str, np.ndarray]:
    """Load the columns or arrays in one file of TRex, by name without the unit.

    The result also has `cm_per_pixel` if the file or TRex's settings beside it state it.
    """
    if path.suffix.lower() in TEXTS:
        table = pd.read_csv(io.StringIO(read_plain_csv(path)))
        fields = {name.split(" (")[0].strip(): table[name].to_numpy() for name in table}
        if any("(px)" in name for name in table):  # places need no conversion: a scale of 1
            return fields | {"cm_per_pixel": np.ones(1)}
        return _read_scale(path.parent) | fields
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
        refuse_bomb(path, size, path.stat().st_size, "export the tracks again")
    with np.load(path, allow_pickle=False) as file:
        kinds = ("frame", "missing", "cm_per_pixel", "X", "Y")
        names = [name for name in file.files if name.split("#")[0] in kinds]
        return _read_scale(path.parent) | {name: file[name] for name in names}


def _read_scale(folder: Path) -> dict[str, np.ndarray]:
    """Return `{"cm_per_pixel": value}` from TRex's settings; {} if none state it.

    folder: the settings are in it, or in the folder above.
    """
    for file in [*sorted(folder.glob("*.settings")), *sorted(folder.parent.glob("*.settings"))]:
        text = file.read_text("utf-8", errors="replace")
        if found := _SCALE.search(text):
            return {"cm_per_pixel": np.array([float(found[1])])}
    return {}


def _to_points(fields: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Convert the fields of a TRex file to frame numbers (n,) and places (n, 2, 2) in these frames.

    The places are x, y of head and centre, in px, or in cm without a field `cm_per_pixel`; NaN if
    unknown. Frames that TRex marks as missing are left out. KeyError names a missing field.
    """
    frame = fields["frame"].ravel().astype(int)
    cm_per_px = float(np.ravel(fields.get("cm_per_pixel", [1.0]))[0])
    present = ~fields.get("missing", np.zeros(len(frame))).ravel().astype(bool)
    centre_suffix = next((suffix for suffix in _CENTRES if f"X{suffix}" in fields), None)
    points = np.full((len(frame), 2, 2), np.nan)
    # Fields without a suffix are the head's.
    if centre_suffix is None or "X" in fields:
        points[:, 0] = _read_places(fields, "") / cm_per_px
    if centre_suffix is not None:
        points[:, 1] = _read_places(fields, centre_suffix) / cm_per_px
    if np.array_equal(points[:, 0], points[:, 1], equal_nan=True):  # TRex found no posture
        points[:, 0] = np.nan
    return frame[present], points[present]


def _read_places(fields: dict[str, np.ndarray], suffix: str) -> np.ndarray:
    """Return the places (n, 2) in the fields X and Y with a suffix; KeyError if one is missing."""
    return np.stack([fields[f"{axis}{suffix}"].ravel() for axis in "XY"], axis=-1)
