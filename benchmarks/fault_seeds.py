"""Readers of foreign files, with whole files of each kind and hostile ones, for `fault_files`."""

import io
import json
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import av
import cv2
import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from PIL import Image
from tifffile import imwrite

from benchmarks.mutations import repair_png
from finloop.base.line import PX
from finloop.base.poses import Poses, poses_from_arrays
from finloop.base.program import HOME
from finloop.export.tracks import deeplabcut_tables
from finloop.gait.tool import load_gait
from finloop.io.footage import open_footage
from finloop.io.footage.source import LostFrames
from finloop.io.journal import read_journal, save_journal
from finloop.io.line import load_line
from finloop.io.parameters import read_parameters
from finloop.io.poses import load_poses
from finloop.io.poses.save import save_netcdf
from finloop.io.regions import load_regions
from finloop.io.table import save_csv_in_blocks
from finloop.io.video import load_mask
from finloop.morph.pairs import load_pairing
from finloop.realism.blind import ANSWERS
from finloop.show.drawn import FIELDS
from finloop.stimulus.display import load_display
from finloop.stimulus.log import FORMAT, SESSION, FrameFacts, Log
from finloop.stimulus.protocol_file import load_protocol
from finloop.stimulus.replay import open_session_record, read_displayed_frames
from stages.blind import describe_answers
from stages.study import read_study_file

SIZE = 48, 40  # px of films
FRAMES, NAMES, POINTS = 12, ("anna", "berta"), ("nose", "tail_tip", "centre")
CANARY = "ran"
"""A file that appears in the present folder if a hostile file runs its command."""
Hostile = bytes | Callable[[], bytes]


@dataclass(frozen=True)
class Reader:
    """A reader of foreign files: what it reads, how whole files are made, and hostile ones.

    target: the file in the folder that is mutated. repair: see `mutate`. hostile: contents of the
    target, or functions that make them.
    """

    target: str
    make: Callable[[Path], None]
    read: Callable[[Path], Any]
    repair: Callable[[bytes], bytes] | None = None
    hostile: Sequence[Hostile] = field(default=())


def _poses() -> Poses:
    """Return two animals that swim, with three keypoints."""
    rng = np.random.default_rng(0)
    places = 20 + rng.normal(0, 0.5, (FRAMES, len(NAMES), len(POINTS), 2)).cumsum(axis=0)
    return poses_from_arrays(NAMES, POINTS, np.arange(FRAMES), places, np.ones(places.shape[:3]))


def _centres() -> np.ndarray:
    """Return the places (frames, animals, 2) of the animals' centres."""
    return _poses().places[:, 2].reshape(FRAMES, len(NAMES), 2)


def _frames() -> list[np.ndarray]:
    """Return the frames of a film: a dark animal on a bright tank with noise."""
    rng, (width, height) = np.random.default_rng(0), SIZE
    tank = rng.normal(180, 3, (FRAMES, height, width)).clip(0, 255).astype(np.uint8)
    for k in range(FRAMES):
        tank[k, 15:22, 5 + 2 * k : 17 + 2 * k] = 60
    return list(tank)


# --- tracks


def _read_tracks(name: str, folder: Path) -> None:
    """Load the tracks of a name in a folder."""
    load_poses(folder / name, None, 25.0)


def _make_dlc_h5(folder: Path, kind: str) -> None:
    """Write a table of DeepLabCut as pandas does."""
    table = next(iter(deeplabcut_tables(_poses())))
    table.to_hdf(folder / "a.h5", key="df_with_missing", format=kind)


def _pickle_in_attribute(name: str) -> bytes:
    """Return a table of DeepLabCut with an attribute whose pickle runs a command."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.h5"
        _make_dlc_h5(Path(folder), "table")
        with h5py.File(path, "a") as file:
            file["df_with_missing"].attrs[name] = np.void(pickle.dumps(_Runs(), 0))
        return path.read_bytes()


def _make_idtracker(folder: Path, ending: str) -> None:
    """Write trajectories as idtracker.ai does."""
    places = _centres()
    record = {
        "trajectories": places, "identities_labels": list(NAMES), "frames_per_second": 25.0,
        "video_paths": [Path("film.mp4")], "areas": {"mean": np.ones(2)}, "length_unit": None,
    }  # fmt: skip
    frame, animal = (axis.ravel() for axis in np.indices(places.shape[:2]))
    x, y = places.reshape(-1, 2).T
    tidy = pd.DataFrame({"frame": frame, "individual": animal, "x": x, "y": y})
    path = folder / f"a{ending}"
    match ending:
        case ".npy":
            np.save(path, np.array(record, dtype=object))
        case "_bare.npy":
            np.save(path, places)
        case ".pickle":
            path.write_bytes(pickle.dumps(record))
        case ".h5":
            with h5py.File(path, "w") as file:
                file["trajectories"] = places
                file.attrs["identities_labels"] = list(NAMES)
        case ".parquet":
            facts = {b"idtrackerai_attributes": json.dumps({"identities_labels": NAMES}).encode()}
            table = pa.Table.from_pandas(tidy)
            pq.write_table(table.replace_schema_metadata(facts | table.schema.metadata), path)
        case ".csv":
            tidy.to_csv(path, index=False)
        case "_wide.csv":
            wide = pd.DataFrame(places.reshape(len(places), -1), columns=["x1", "y1", "x2", "y2"])
            wide.insert(0, "time", np.arange(len(wide)) / 25)
            wide.to_csv(path, index=False)


def _make_trex(folder: Path, ending: str) -> None:
    """Write what TRex exports of an animal."""
    x, y = _centres()[:, 0].T / 50
    fields = {"frame": np.arange(FRAMES), "missing": np.zeros(FRAMES), "X": x, "Y": y}
    fields |= {"X#wcentroid": x + 1, "Y#wcentroid": y}
    if ending == ".npz":
        np.savez(folder / "f_id0.npz", cm_per_pixel=np.array([0.02]), **fields)
        return
    pd.DataFrame(fields).add_suffix(" (cm)").rename(
        columns={"frame (cm)": "frame", "missing (cm)": "missing"}
    ).to_csv(folder / "f_id0.csv", index=False)
    (folder / "f.settings").write_text("threads = 2\ncm_per_pixel = 0.02\n")


def _make_sleap_csv(folder: Path) -> None:
    """Write SLEAP's analysis as CSV."""
    poses = _poses()
    table = pd.DataFrame({"track": [NAMES[k] for k in poses.individual], "frame_idx": poses.frame})
    for k, name in enumerate(POINTS):
        table[f"{name}.x"], table[f"{name}.y"] = poses.places[:, k].T
        table[f"{name}.score"] = 1.0
    table.to_csv(folder / "a.csv", index=False)


def _make_sleap_analysis(folder: Path) -> None:
    """Write SLEAP's analysis as HDF5."""
    cells = _poses().places.reshape(FRAMES, len(NAMES), len(POINTS), 2)
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("tracks", data=cells.transpose(1, 3, 2, 0), compression="gzip")
        file["point_scores"] = np.ones((len(NAMES), len(POINTS), FRAMES))
        file["track_names"], file["node_names"] = np.array(NAMES, "S"), np.array(POINTS, "S")


def _make_sleap_project(folder: Path) -> None:
    """Write SLEAP's project."""
    poses = _poses()
    rows, count = len(poses.frame), len(POINTS)
    point = [("x", "f8"), ("y", "f8"), ("visible", "?"), ("complete", "?")]
    instance = [
        ("instance_id", "i8"), ("instance_type", "u1"), ("frame_id", "u8"), ("skeleton", "u4"),
        ("track", "i4"), ("from_predicted", "i8"), ("score", "f4"), ("point_id_start", "u8"),
        ("point_id_end", "u8"), ("tracking_score", "f4"),
    ]  # fmt: skip
    frame = [(name, "u8") for name in ("frame_id", "frame_idx", "instance_id_start")]
    frame = [frame[0], ("video", "u4"), *frame[1:], ("instance_id_end", "u8")]
    points = np.zeros(rows * count, [*point, ("score", "f8")])
    points["x"], points["y"] = poses.places.reshape(-1, 2).T
    points["visible"] = True
    instances, frames = np.zeros(rows, instance), np.zeros(FRAMES, frame)
    instances["instance_id"] = np.arange(rows)
    instances["instance_type"], instances["from_predicted"] = 1, -1
    instances["frame_id"], instances["track"] = poses.frame, poses.individual
    instances["point_id_start"] = np.arange(rows) * count
    instances["point_id_end"] = instances["point_id_start"] + count
    frames["frame_id"] = frames["frame_idx"] = np.arange(FRAMES)
    frames["instance_id_start"] = np.arange(FRAMES) * len(NAMES)
    frames["instance_id_end"] = frames["instance_id_start"] + len(NAMES)
    facts = {
        "nodes": [{"name": name} for name in POINTS],
        "skeletons": [{"nodes": [{"id": k} for k in range(count)], "links": []}],
    }
    tracks = [json.dumps([0, name]) for name in NAMES]
    with h5py.File(folder / "a.slp", "w") as file:
        file["points"], file["pred_points"] = np.zeros(0, point), points
        file["instances"], file["frames"] = instances, frames
        file["tracks_json"] = np.array(tracks, "S")
        file.create_group("metadata").attrs.update({"json": json.dumps(facts), "format_id": 1.2})


def _make_nwb(folder: Path) -> None:
    """Write an animal as NWB with ndx-pose does."""
    poses = _poses()
    with h5py.File(folder / "a.nwb", "w") as file:
        file["identifier"] = NAMES[0]
        for k, name in enumerate(POINTS):
            group = file.create_group(f"processing/behavior/PoseEstimation/{name}")
            group.attrs["neurodata_type"] = "PoseEstimationSeries"
            group["data"] = poses.places[poses.individual == 0, k]
            group["confidence"] = np.ones(FRAMES)


def _make_via(folder: Path) -> None:
    """Write the CSV of tracks of VIA."""
    rows = [
        [
            f"{frame:05}.png", 9, "{}", 2, animal, json.dumps({
                "name": "rect", "x": round(x), "y": round(y), "width": 9, "height": 5,
            }), json.dumps({"track": animal + 1}),
        ]
        for frame, animals in enumerate(_centres()) for animal, (x, y) in enumerate(animals)
    ]  # fmt: skip
    names = ["filename", "file_size", "file_attributes", "region_count", "region_id"]
    columns = [*names, "region_shape_attributes", "region_attributes"]
    pd.DataFrame(rows, columns=columns).to_csv(folder / "a.csv", index=False)


def _make_fasttrack(folder: Path) -> None:
    """Write `tracking.txt` of FastTrack."""
    poses = _poses()
    parts = [f"{axis}{part}" for part in ("Head", "Tail", "Body") for axis in "xy"]
    table = pd.DataFrame(poses.places.reshape(len(poses.frame), -1), columns=parts)
    table = table.assign(imageNumber=poses.frame, id=poses.individual)
    table.to_csv(folder / "tracking.txt", sep="\t", index=False)


class _Runs:
    """An object whose pickle runs a program."""

    def __reduce__(self) -> Any:
        """Return the call that unpickling makes."""
        import os

        return os.system, (f"touch {CANARY}",)


def _pickle_twins() -> bytes:
    """Return a pickle of lists within lists: two references each, 2⁶⁰ values written out."""
    nested: Any = [1.0]
    for _ in range(60):
        nested = [nested, nested]
    return pickle.dumps({"trajectories": nested, "identities_labels": nested})


def _dump_hdf5(fill: Callable[[h5py.File], None]) -> bytes:
    """Return an HDF5 file with what a function writes into it."""
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        fill(file)
    return buffer.getvalue()


def _declare_gigabytes(name: str, shape: tuple[int, ...], kind: str, file: h5py.File) -> None:
    """Declare a large array without writing it."""
    file.create_dataset(name, shape, kind, chunks=True, compression="gzip")


def _inflating_chunk(name: str, shape: tuple[int, ...], file: h5py.File) -> None:
    """Write a chunk that unpacks to 2 GB in place of the few bytes that it declares."""
    array = file.create_dataset(name, shape, "f8", chunks=shape, compression="gzip")
    array.id.write_direct_chunk((0,) * len(shape), _deflate_zeros(2**31))


def _deflate_zeros(count: int) -> bytes:
    """Return a deflated stream of at least `count` zeros; its checksum at the end is wrong."""
    packer, part = zlib.compressobj(9, zlib.DEFLATED, -15), 2**22
    block = packer.compress(bytes(part)) + packer.flush(zlib.Z_FULL_FLUSH)
    return b"x\x9c" + block * -(-count // part) + b"\x03\0" + bytes(4)


def _one_long_name(file: h5py.File) -> None:
    """Refer to one text of a million letters 10,000 times."""
    file["tracks"] = np.zeros((2, 2, 3, 5))
    names = file.create_dataset("track_names", (10_000,), h5py.string_dtype())
    names[0] = "a" * 10**6
    file["node_names"] = np.array(POINTS, "S")


def _hostile_arrays() -> list[Hostile]:
    """Return archives of NumPy arrays that declare, or unpack to, gigabytes."""
    head = b"\x93NUMPY\x01\0v\0{'descr': '<f8', 'fortran_order': False, 'shape': (%d,), }"
    declared = (head % 10**12).ljust(127) + b"\n"

    def pack(content: bytes, parts: int) -> bytes:
        """Return an archive with a content and so many parts of 4 MB as the frame numbers."""
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("X.npy", declared)
            with archive.open("frame.npy", "w") as member:
                member.write(content)
                for _ in range(parts):
                    member.write(bytes(2**22))
        return buffer.getvalue()

    filled = (head % (70 * 2**19)).ljust(127) + b"\n"
    return [partial(pack, declared, 0), partial(pack, filled, 70)]


_HOSTILE_PICKLES: list[Hostile] = [
    lambda: pickle.dumps(_Runs()),
    lambda: pickle.dumps({"trajectories": _Runs()}),
    _pickle_twins,
    b"\x80\x04]r\xff\xff\xff\x7f.",  # remembered as number 2³¹ − 1
    b"\x80\x04\x8d\xff\xff\xff\xff\xff\xff\xff\x7f.",  # a text of 2⁶³ − 1 letters
    b"\x80\x02" + b"(" * 100_000 + b"t" * 99_999 + b".",
    b"\x80\x02" + b"]" + b"]a" * 100_000 + b".",
    b"cnumpy\nndarray\nN}U\x0c__setstate__Nst\x86b.",  # sets an attribute of a class
    b"I" + b"9" * 100_000 + b"\n.",
]
_HOSTILE_TABLES: list[Hostile] = [
    b"", b",", b"\xff\xfe", b'"' * 1001, b"a," * 200_000 + b"\n", b"scorer\n" * 1000,
    b"track,frame_idx,a.x,a.y,a.score\n" + b"".join(b"%d,%d,1,2,1\n" % (k, k) for k in range(9999)),
    b"frame,individual,x,y\n0,0,1,2\n999999999999,0,1,2\n",
    b"frame,individual,x,y\n0,0,1,2\n1,999999999999,1,2\n",
]  # fmt: skip
_GIGABYTES = 2, 2, 3, 500_000_000
_HOSTILE_HDF5: list[Hostile] = [
    partial(_dump_hdf5, partial(_declare_gigabytes, "tracks", _GIGABYTES, "f8")),
    partial(_dump_hdf5, partial(_declare_gigabytes, "trajectories", (10**9, 2, 2), "f8")),
    partial(_dump_hdf5, partial(_inflating_chunk, "tracks", (2, 2, 3, 5))),
    partial(_dump_hdf5, partial(_inflating_chunk, "trajectories", (12, 2, 2))),
    partial(_dump_hdf5, _one_long_name),
]


# --- films and pictures


def _read_film(name: str, folder: Path) -> None:
    """Read all frames of a film."""
    footage = open_footage(folder / name, frame_rate_hz=25.0)
    for _ in footage.stream_numbered(LostFrames()):
        pass


def _make_folder(folder: Path, ending: str) -> None:
    """Write a folder of pictures."""
    (folder / "film").mkdir()
    for k, frame in enumerate(_frames()[:4]):
        coded = cv2.imencode(ending, cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))[1]
        (folder / f"film/{k}{ending}").write_bytes(coded.tobytes())


def _make_film(folder: Path, name: str, codec: str, pixels: str) -> None:
    """Write a film with FFmpeg."""
    with av.open(str(folder / name), "w") as container:
        stream: Any = container.add_stream(codec, rate=25)
        stream.width, stream.height = SIZE
        stream.pix_fmt = pixels
        for frame in _frames():
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame, "gray")))
        container.mux(stream.encode(None))


def _make_gif(folder: Path) -> None:
    """Write a GIF that moves."""
    first, *others = map(Image.fromarray, _frames())
    first.save(folder / "a.gif", save_all=True, append_images=others, duration=40)


def _make_stack(folder: Path, compression: str | None) -> None:
    """Write a TIFF stack with ImageJ's facts."""
    options: dict[str, Any] = {"compression": compression, "imagej": compression is None}
    imwrite(folder / "a.tif", np.stack(_frames()), **options)


def _make_array(folder: Path, ending: str) -> None:
    """Write a film as an array."""
    film = np.stack(_frames())
    if ending == ".npy":
        np.save(folder / "a.npy", film)
        return
    with h5py.File(folder / "a.h5", "w") as file:
        file.create_dataset("film", data=film, compression="gzip").attrs["fps"] = 25.0


def _png_of_size(width: int, height: int) -> bytes:
    """Return a PNG that declares a size; its pixels are few."""
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", zlib.compress(bytes(9999))), (b"IEND", b""))
    chunks = (struct.pack(">I", len(data)) + kind + data + b"crc!" for kind, data in parts)
    return repair_png(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))


def _large_png() -> bytes:
    """Return a PNG of 2.6 MB that unpacks to 2.4 GB."""
    width = height = 28_000
    packed = _deflate_zeros(height * (1 + 3 * width))
    parts = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)), (b"IDAT", packed))
    chunks = (struct.pack(">I", len(data)) + kind + data + b"crc!" for kind, data in parts)
    return repair_png(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))


def _tiff_of_size(width: int, strip: bytes) -> bytes:
    """Return a TIFF of two deflated pages that declare a side; their pixels are one strip."""
    content = b"II*\0\x08\0\0\0"
    for page in range(2):
        tags = (
            (256, 4, width), (257, 4, width), (258, 3, 8), (259, 3, 8), (262, 3, 1),
            (273, 4, 8 + 2 * 126), (277, 3, 1), (278, 4, width), (279, 4, len(strip)),
        )  # fmt: skip
        entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
        content += struct.pack("<H", len(tags)) + entries + struct.pack("<I", 0 if page else 134)
        content = content.ljust(134 + 126 * page, b"\0")
    return content + strip


def _inflating_strip() -> bytes:
    """Return a deflated strip of 2 GB."""
    return _deflate_zeros(2**31)


_HOSTILE_PNGS: list[Hostile] = [
    partial(_png_of_size, 100_000, 100_000), partial(_png_of_size, 30_000, 30_000),
    partial(_png_of_size, 2**31 - 1, 1), _large_png, b"", b"\x89PNG\r\n\x1a\n",
]  # fmt: skip
_HOSTILE_STACKS: list[Hostile] = [
    lambda: _tiff_of_size(100_000, b"x\x9c"), lambda: _tiff_of_size(64, _inflating_strip()),
    lambda: _tiff_of_size(16_000, zlib.compress(bytes(16))), b"", b"II*\0", b"II*\0\x08\0\0\0",
]  # fmt: skip
_HOSTILE_FILMS: list[Hostile] = [
    b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:9/a.ts\n#EXT-X-ENDLIST\n",
    b"ffconcat version 1.0\nfile '/etc/passwd'\n",
    b"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nm=video 9 RTP/AVP 96\n",
    b"<?xml version='1.0'?><MPD><Period/></MPD>",
    b"",
    b"\0" * 100_000,
]
_HOSTILE_FILM_ARRAYS: list[Hostile] = [
    partial(_dump_hdf5, partial(_declare_gigabytes, "film", (4, 100_000, 100_000), "u1")),
    partial(_dump_hdf5, partial(_inflating_chunk, "film", (4, 32, 32))),
    partial(_dump_hdf5, partial(_declare_gigabytes, "film", (10**6, 2000, 2000), "u1")),
]


# --- texts


def _write(name: str, content: str, folder: Path) -> None:
    """Write a text."""
    (folder / name).write_text(content)


def _nest_brackets(begin: str, end: str, depth: int) -> bytes:
    """Return a text of brackets within brackets."""
    return (begin * depth + end * depth).encode()


def _laughs() -> bytes:
    """Return YAML whose aliases stand for 9⁹ values."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)]
    return "\n".join([*lines, "pairs: *a8", "films: *a8", "conditions: *a8"]).encode()


_HOSTILE_YAML: list[Hostile] = [
    _laughs, partial(_nest_brackets, "[", "]", 100_000),
    partial(_nest_brackets, "{a: ", "}", 20_000),
    b"a: &a [*a]\n", b"a: &a {<<: *a}\n", b"!!python/object/apply:os.system [true]\n",
    b"films: !!python/name:os.system\n", b"? [a]\n: 1\n", b"- " * 50_000, b"",
    b"films: {a: ${oc.env:HOME}, b: ${films}}\n", b"films: {a: '${oc.decode:[1]}'}\n",
]  # fmt: skip
_HOSTILE_JSON: list[Hostile] = [
    partial(_nest_brackets, "[", "]", 200_000),
    partial(_nest_brackets, '{"a":', "}", 100_000),
    b"",
    b"null",
    b"9" * 10_000,
    b'"\\ud800"',
    b"[NaN, Infinity, 1e999]",
    b"{}",
    b"[]",
]


def _make_session(folder: Path) -> None:
    """Write a session of two frames: its journal, and its Parquet file."""
    log = Log(folder / "a.journal", {"format": FORMAT, "finloop": "0", "protocol": {}})
    log.add_entry("trial", 0.0, text='{"what": "start"}')
    for number in range(4):
        log.add_entry("tick", number / 60, number=number, intended_s=0.0, seq=number, digest=7)
        facts = FrameFacts(number, 0.0, number / 60, 0.0, number, 0, 2, 9)
        log.add_frame(facts, np.ones((2, len(FIELDS) + 5), np.float32), None)
    log.close()
    save_journal(folder / "a.journal", folder / "a.parquet", SESSION)


def _read_session(folder: Path) -> None:
    """Read a session's record as `summary` and `replay` do."""
    record = open_session_record(folder / "a.parquet")
    list(record.read_rows("trial", "tick", "input"))
    list(read_displayed_frames(record))


def _read_journal(folder: Path) -> None:
    """Read a journal as `recover` does."""
    with read_journal(folder / "a.journal") as (_, parts):
        for _ in parts:
            pass


def _make_lines(folder: Path) -> None:
    """Write a path as CSV and as Parquet."""
    x, y = _centres()[:, 0].T
    table = pd.DataFrame({"x": x, "y": y, "time_s": np.arange(FRAMES) / 25})
    table.to_csv(folder / "a.csv", index=False)
    table.to_parquet(folder / "a.parquet", index=False)


def _make_mask(folder: Path) -> None:
    """Write a mask."""
    mask = np.full(SIZE[::-1], 255, np.uint8)
    mask[:5] = 0
    (folder / "a.png").write_bytes(cv2.imencode(".png", mask)[1].tobytes())


def _make_regions(folder: Path) -> None:
    """Write masks of a limb in two frames."""
    (folder / "regions/leg").mkdir(parents=True)
    for k in range(2):
        mask = np.zeros(SIZE[::-1], np.uint8)
        mask[5:20, 5 + k : 25] = 255
        path = folder / f"regions/leg/{k:04}.png"
        path.write_bytes(cv2.imencode(".png", mask)[1].tobytes())


def _make_answers(folder: Path) -> None:
    """Write answers of a blind test."""
    rows = [[k, "left", "right" if k % 2 else "left", k % 2 == 0, 2.5] for k in range(8)]
    pd.DataFrame(rows, columns=list(ANSWERS)).to_csv(folder / "a.csv", index=False)


_DISPLAY = {"version": 1, "width_px": 1920, "height_px": 1080, "ratio": 1.0, "refresh_hz": 60.0}
_STUDY = (
    "films: {carp: {clip: carp, clip.frames: 600}, b: {path: b.mp4}}\nsettings: {clip.end_s: 2.0}"
)
_PAIRS = (
    "pairs: {eye: left_eye, body: [head, tail]}\nvanish: [hat]\npins: {eye: [[[1, 2], [3, 4]]]}"
)


def _tracks(name: str, make: Callable[[Path], None], hostile: Sequence[Hostile] = ()) -> Reader:
    """Return a reader of tracks in a file."""
    return Reader(name, make, partial(_read_tracks, name), None, hostile)


def _film(
    name: str, make: Callable[[Path], None], hostile: Sequence[Hostile] = (),
    film: str | None = None, repair: Callable[[bytes], bytes] | None = None,
) -> Reader:  # fmt: skip
    """Return a reader of a film; film: what is opened, if it is not the mutated file."""
    return Reader(name, make, partial(_read_film, film or name), repair, hostile)


READERS: dict[str, Reader] = {
    "DeepLabCut csv": _tracks("a.csv", lambda folder: save_csv_in_blocks(
        folder / "a.csv", deeplabcut_tables(_poses()), decimals=3), _HOSTILE_TABLES),
    "DeepLabCut h5 table": _tracks("a.h5", partial(_make_dlc_h5, kind="table"), [
        partial(_pickle_in_attribute, name) for name in ("non_index_axes", "nan_rep", "info")]),
    "DeepLabCut h5 fixed": _tracks("a.h5", partial(_make_dlc_h5, kind="fixed")),
    "SLEAP csv": _tracks("a.csv", _make_sleap_csv, _HOSTILE_TABLES),
    "SLEAP h5": _tracks("a.h5", _make_sleap_analysis, _HOSTILE_HDF5),
    "SLEAP slp": _tracks("a.slp", _make_sleap_project),
    "NWB": _tracks("a.nwb", _make_nwb),
    "movement nc": _tracks("a.nc", lambda folder: save_netcdf(
        folder / "a.nc", _poses(), Fraction(25))),
    "VIA csv": _tracks("a.csv", _make_via),
    "idtracker npy": _tracks("a.npy", partial(_make_idtracker, ending=".npy")),
    "idtracker bare npy": _tracks("a_bare.npy", partial(_make_idtracker, ending="_bare.npy")),
    "idtracker pickle": _tracks(
        "a.pickle", partial(_make_idtracker, ending=".pickle"), _HOSTILE_PICKLES),
    "idtracker h5": _tracks("a.h5", partial(_make_idtracker, ending=".h5"), _HOSTILE_HDF5),
    "idtracker parquet": _tracks("a.parquet", partial(_make_idtracker, ending=".parquet")),
    "idtracker csv": _tracks("a.csv", partial(_make_idtracker, ending=".csv"), _HOSTILE_TABLES),
    "idtracker wide csv": _tracks("a_wide.csv", partial(_make_idtracker, ending="_wide.csv")),
    "TRex npz": _tracks("f_id0.npz", partial(_make_trex, ending=".npz"), _hostile_arrays()),
    "TRex csv": _tracks("f_id0.csv", partial(_make_trex, ending=".csv"), _HOSTILE_TABLES),
    "TRex settings": Reader("f.settings", partial(_make_trex, ending=".csv"),
        partial(_read_tracks, "f_id0.csv"), None, [b"\n" * 10**6, b" " * 10**6]),
    "FastTrack txt": _tracks("tracking.txt", _make_fasttrack),
    "pictures png": _film("film/1.png", partial(_make_folder, ending=".png"), _HOSTILE_PNGS,
        "film", repair_png),
    "pictures jpg": _film("film/1.jpg", partial(_make_folder, ending=".jpg"), film="film"),
    "pictures webp": _film("film/1.webp", partial(_make_folder, ending=".webp"), film="film"),
    "pictures tif": _film("film/1.tif", partial(_make_folder, ending=".tif"), film="film"),
    "pictures jp2": _film("film/1.jp2", partial(_make_folder, ending=".jp2"), film="film"),
    "pictures bmp": _film("film/1.bmp", partial(_make_folder, ending=".bmp"), film="film"),
    "TIFF stack": _film("a.tif", partial(_make_stack, compression=None)),
    "TIFF stack, deflated": _film(
        "a.tif", partial(_make_stack, compression="zlib"), _HOSTILE_STACKS),
    "film npy": _film("a.npy", partial(_make_array, ending=".npy")),
    "film h5": _film("a.h5", partial(_make_array, ending=".h5"), _HOSTILE_FILM_ARRAYS),
    "film mp4": _film("a.mp4", lambda folder: _make_film(
        folder, "a.mp4", "libx264", "yuv420p"), _HOSTILE_FILMS),
    "film avi": _film("a.avi", lambda folder: _make_film(folder, "a.avi", "mjpeg", "yuvj420p")),
    "film mkv": _film("a.mkv", lambda folder: _make_film(folder, "a.mkv", "ffv1", "gray")),
    "film gif": _film("a.gif", _make_gif),
    "mask png": Reader("a.png", _make_mask, lambda folder: load_mask(folder / "a.png", *SIZE),
        repair_png, _HOSTILE_PNGS),
    "masks of limbs": Reader("regions/leg/0001.png", _make_regions, lambda folder: load_regions(
        folder / "regions", np.array, lambda *_: np.zeros(0)), repair_png, _HOSTILE_PNGS),
    "path csv": Reader("a.csv", _make_lines, lambda folder: load_line(folder / "a.csv", PX), None,
        _HOSTILE_TABLES),
    "path parquet": Reader("a.parquet", _make_lines,
        lambda folder: load_line(folder / "a.parquet", PX)),
    "gait json": Reader("a.json", lambda folder: _write("a.json", (
        HOME / "data/gaits/dog_trot.json").read_text(), folder),
        lambda folder: load_gait(folder / "a.json"), None, _HOSTILE_JSON),
    "pairs yaml": Reader("a.yaml", partial(_write, "a.yaml", _PAIRS),
        lambda folder: load_pairing(folder / "a.yaml"), None, _HOSTILE_YAML),
    "study yaml": Reader("a.yaml", partial(_write, "a.yaml", _STUDY),
        lambda folder: read_study_file(folder / "a.yaml"), None, _HOSTILE_YAML),
    "params yaml": Reader("a.yaml", lambda folder: _write("a.yaml", (
        HOME / "params.yaml").read_text(), folder),
        lambda folder: read_parameters(folder / "a.yaml"), None, _HOSTILE_YAML),
    "protocol yaml": Reader("a.yaml", lambda folder: _write("a.yaml", (
        HOME / "examples/protocol.yaml").read_text(), folder),
        lambda folder: load_protocol(folder / "a.yaml"), None, _HOSTILE_YAML),
    "display json": Reader("a.json", partial(_write, "a.json", json.dumps(_DISPLAY)),
        lambda folder: load_display(folder / "a.json"), None, _HOSTILE_JSON),
    "session parquet": Reader("a.parquet", _make_session, _read_session),
    "session journal": Reader("a.journal", _make_session, _read_journal),
    "answers csv": Reader("a.csv", _make_answers,
        lambda folder: describe_answers([folder / "a.csv"]), None, _HOSTILE_TABLES),
}  # fmt: skip
"""All readers of foreign files but SVG, which `fault_drawings` attacks."""
