"""Exports, each re-read by a program that is not ours: PyAV with libvpx, Pillow, pandas, pyarrow.

A toy fish is a soft drop of known mass centre, drawn here.
"""

import json
from fractions import Fraction
from importlib.util import find_spec

import av
import cv2
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from conftest import TINY_CARP
from PIL import Image
from scratch import content, prepare, write_frames
from toy_fish import edit_list as toy_edit_list
from toy_fish import mass_centre, rough_picture

import stages.export
import stages.sprites
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError
from finloop.base.poses import Poses
from finloop.edit.schema import EDIT
from finloop.export.pictures import (
    READABLE,
    FishOnlyPainter,
    add_film_sources,
    box_of_all_fish,
    cut_out_fish,
    sprites_of_sequence,
)
from finloop.export.tracks import deeplabcut_tables, keypoints_of_tracks
from finloop.extract.matte import drop_residue
from finloop.extract.table import GIVEN, OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.identity.film import IDENTITIES
from finloop.io.cutouts import CutoutWriter
from finloop.io.movie import AlphaWebpWriter, WebmWriter
from finloop.io.numbers import load_numbers
from finloop.io.poses import load_poses
from finloop.io.poses.save import save_netcdf, save_nwb
from finloop.io.record import save_json, save_record
from finloop.io.table import save_csv_in_blocks, save_table
from finloop.io.video import VideoFacts, save_facts
from finloop.render.gallery import CutoutSet, Gallery
from finloop.render.painter import Box, Painter, PlacedFish, TurnedPicture, pad_picture
from finloop.sprites.orient import SPRITES

ORIENTATIONS = 24  # conf/features/default.yaml

RATE = Fraction(2807, 100)
HEIGHT, WIDTH = 90, 121


def drop(size=31, channels=2, turn=0):
    """A soft drop, larger at its head: premultiplied (size, size, channels)."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    alpha = 255 * np.exp(-((x / 4) ** 2) - (y / (3.5 + 0.1 * x)) ** 2)
    colours = [alpha * share for share in (0.8, 0.5, 0.3)[: channels - 1]]
    return np.rot90(np.round(np.dstack([*colours, alpha])).astype(np.uint8), turn)


def journey(channels, count=9):
    """Fish that turn, grow, fade into one another and leave the picture."""
    rng = np.random.default_rng(1)
    pictures = [pad_picture(rough_picture(rng, 20, 27, channels), 12.7, 9.9) for _ in range(2)]
    for k in range(count):
        a, b = (TurnedPicture(one, 31.0 * k, 0.8 + 0.05 * k) for one in pictures)
        yield (PlacedFish(30.3 + 12 * k, 40.8 - k, a, b, 0.3 if k % 2 else 0.0),)


# --- the fish alone ------------------------------------------------------------------------------


@pytest.mark.parametrize("channels", [2, 4])
def test_a_cutout_in_its_own_place_comes_back_bit_for_bit(channels):
    rng = np.random.default_rng(0)
    for _ in range(10):
        pixels = rough_picture(rng, *rng.integers(5, 30, 2), channels)
        alone = FishOnlyPainter(60, 80, channels - 1)
        one = TurnedPicture(pad_picture(pixels, 10.0, 8.0))
        box = alone.show(PlacedFish(30.0, 20.0, one, None, 0.0))
        where = np.s_[12 - box.top :, 20 - box.left :]
        found = alone.picture_in_box(box)[where][: pixels.shape[0], : pixels.shape[1]]
        colours = pixels[..., :-1].repeat(3 if channels == 2 else 1, axis=2)
        assert np.array_equal(found, np.concatenate([colours, pixels[..., -1:]], axis=2))


@pytest.mark.parametrize("channels", [2, 4])
def test_laid_over_any_tank_it_is_what_the_painter_paints(channels):
    tank = np.random.default_rng(2).integers(0, 256, (HEIGHT, WIDTH, channels - 1), np.uint8)
    alone, painter = FishOnlyPainter(HEIGHT, WIDTH, channels - 1), Painter(tank)
    crop = box_of_all_fish(journey(channels), alone)
    frames = cut_out_fish(journey(channels), alone, crop)
    for fish, frame in zip(journey(channels), frames, strict=True):
        painter.show(*fish)
        alpha = frame[..., 3:] / 255
        faint = frame[..., 3:] * (frame[..., 3:] < 16)  # their colour is their neighbours'
        shown = tank.repeat(4 - len(tank.shape) + (channels == 2) * 2, axis=2).astype(float)
        shown[crop.slices] = alpha * frame[..., :3] + (1 - alpha) * shown[crop.slices]
        error = np.abs(shown - painter.canvas)
        error[crop.slices] -= faint
        assert error.max() <= 2


def test_the_crop_holds_all_there_is_and_little_more():
    alone = FishOnlyPainter(HEIGHT, WIDTH, 1)
    crop = box_of_all_fish(journey(2), alone)
    seen = np.zeros((HEIGHT, WIDTH), bool)
    for frame in cut_out_fish(journey(2), alone, Box(0, 0, HEIGHT, WIDTH)):
        seen |= frame[..., 3] > 0
    rows, columns = (np.flatnonzero(seen.any(axis)) for axis in (1, 0))
    assert crop.top <= rows[0] and crop.bottom > rows[-1]
    assert crop.left <= columns[0] and crop.right > columns[-1]
    assert rows[0] - crop.top < 12 and crop.bottom - rows[-1] < 12 and columns[0] - crop.left < 12


def test_nothing_is_left_of_the_frame_before_and_a_fish_outside_is_not_there():
    one = TurnedPicture(pad_picture(drop(), 15.0, 15.0))
    places = [(20, 20), (60, 50), (-500, 20), (20, 20)]
    rows = [[PlacedFish(x, y, one, None, 0.0)] for x, y in places]
    alone = FishOnlyPainter(HEIGHT, WIDTH, 1)
    frames = [frame.copy() for frame in cut_out_fish(rows, alone, Box(0, 0, HEIGHT, WIDTH))]
    assert np.array_equal(frames[0], frames[3]) and not frames[2].any()
    assert mass_centre(frames[1][..., 3].astype(float)) == pytest.approx([60, 50], abs=0.3)
    assert frames[1][..., 3].sum() == frames[0][..., 3].sum()
    away = [rows[2]]
    assert next(cut_out_fish(away, alone, box_of_all_fish(away, alone))).shape == (1, 1, 4)


def test_colour_reaches_out_under_the_edge():
    """Else a filter of the engine, or 4:2:0, would mix black into it."""
    pixels = np.full((8, 8, 2), 255, np.uint8)
    pixels[..., 0] = 200
    row = PlacedFish(40.0, 40.0, TurnedPicture(pad_picture(pixels, 3.5, 3.5), 20.0), None, 0.0)
    alone = FishOnlyPainter(HEIGHT, WIDTH, 1)
    frame = next(cut_out_fish([[row]], alone, box_of_all_fish([[row]], alone)))
    solid = (frame[..., 3] >= 16).astype(np.uint8)
    beside = (cv2.dilate(solid, np.ones((5, 5))) > solid).astype(bool)
    assert (frame[beside][:, 3] == 0).any() and (frame[beside][:, 3] > 0).any()
    assert np.abs(frame[beside][:, :3].astype(int) - 200).max() <= 3


# --- the edit list -------------------------------------------------------------------------------


def sprite_table(steps=3):
    count = 4 * steps
    words = np.repeat(["straight", "slide", "left", "right"], steps)
    numbers = {column.name: 0.0 for column in SPRITES.columns} | {
        "sprite": np.arange(count), "sequence": words, "step": np.tile(np.arange(steps), 4),
        "phase": "cycle", "track_id": 5, "frame": 70 + np.arange(count), "mirrored": False,
        "scale": 1.2, "x_px": 50.0, "y_px": 40.0, "orientations": ORIENTATIONS,
    }  # fmt: skip
    return pd.DataFrame(numbers, index=range(count))


def edit_list(n, **columns):
    """An edit list of n ticks of a fish that swims to the right, a frame of the film a tick."""
    here = {"source": np.arange(n), "x_px": 30.0 + 3 * np.arange(n), "y_px": 40.0}
    return toy_edit_list(n, **here | columns)


def test_an_edit_list_says_what_it_shows():
    tracks = pd.DataFrame({"track_id": [7, 7, 9], "frame": [3, 4, 0]})
    edit = edit_list(
        3, kind=["frame", "sprite", "sprite"], source=[2, 0, 7],
        orientation=pd.array([None, 1, 24], dtype="Int8"),
        partner_orientation=pd.array([None, None, 1], dtype="Int8"),
        partner_kind=[None, "frame", "sprite"], partner=pd.array([None, 1, 1], dtype="Int32"),
    )  # fmt: skip
    found = add_film_sources(edit, tracks, sprite_table())
    assert found["track_id"].tolist() == [9, 5, 5] and found["frame"].tolist() == [0, 70, 77]
    assert found["atlas"].tolist() == [None, "straight/01/00", "left/24/01"]
    assert found["partner_track_id"].fillna(-1).tolist() == [-1, 7, 5]
    assert found["partner_frame"].fillna(-1).tolist() == [-1, 4, 71]
    assert found["partner_atlas"].tolist() == [None, None, "straight/01/01"]
    assert list(found) == READABLE.names


# --- films with alpha ----------------------------------------------------------------------------


def clip(shape=(45, 71), count=6, colour=(120, 60, 200)):
    """A soft blot that moves, straight alpha."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    for k in range(count):
        alpha = 255 * np.exp(-(((x - 20 - 4 * k) / 9) ** 2) - ((y - 22) / 6) ** 2)
        frame = np.dstack([np.full_like(alpha, level) for level in colour] + [alpha])
        yield (np.round(frame) * (alpha >= 1)[..., None]).astype(np.uint8)


def decode_webm(path):
    """The frames of a WebM by libvpx, which alone knows of alpha: time, RGB, alpha."""
    with av.open(str(path)) as film:
        assert film.format.name == "matroska,webm"
        stream = film.streams.video[0]
        assert stream.codec_context.name == "vp9" and stream.metadata["alpha_mode"] == "1"
        reader = av.CodecContext.create("libvpx-vp9", "r")
        packets = [packet for packet in film.demux(stream) if packet.size]
        for frame in [frame for packet in [*packets, None] for frame in reader.decode(packet)]:
            assert frame.format.name == "yuva420p"
            plane = frame.planes[3]
            alpha = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
            rgb = frame.reformat(format="rgb24", src_colorspace=5).to_ndarray()
            yield frame.time, rgb, alpha[: plane.height, : plane.width]


@pytest.mark.parametrize("shape", [(46, 72), (45, 71)])
def test_a_webm_comes_back_with_its_alpha(tmp_path, shape):
    given = list(clip(shape))
    write_frames(WebmWriter(tmp_path / "a.webm", given[0].shape, RATE, 8), given)
    found = list(decode_webm(tmp_path / "a.webm"))
    assert len(found) == len(given)
    for k, ((time, rgb, alpha), frame) in enumerate(zip(found, given, strict=True)):
        assert time == pytest.approx(k / RATE, abs=0.001)  # WebM's clock
        assert alpha.shape == (46, 72)
        difference = np.abs(alpha[: shape[0], : shape[1]].astype(int) - frame[..., 3])
        assert difference.max() <= 6
        assert not alpha[shape[0] :].any() and not alpha[:, shape[1] :].any()
        fish = frame[..., 3] > 200
        assert np.abs(rgb[: shape[0], : shape[1]][fish].astype(int) - (120, 60, 200)).max() <= 6
    grey = WebmWriter(tmp_path / "grey.webm", (46, 72, 4), RATE, 8)  # which stays grey
    write_frames(grey, clip((46, 72), 2, (90, 90, 90)))
    for _, rgb, alpha in decode_webm(tmp_path / "grey.webm"):
        assert np.ptp(rgb[alpha > 100], axis=1).max() == 0


def test_an_animated_webp_comes_back_with_its_alpha(tmp_path):
    given = list(clip())
    write_frames(AlphaWebpWriter(tmp_path / "a.webp", given[0].shape, RATE, 90), given)
    with Image.open(tmp_path / "a.webp") as film:
        assert (film.n_frames, film.mode, film.size, film.info["loop"]) == (6, "RGBA", (71, 45), 0)
        for k, frame in enumerate(given):
            film.seek(k)
            film.load()
            found = np.array(film.convert("RGBA"))
            assert np.array_equal(found[..., 3], frame[..., 3])  # without loss
            fish = frame[..., 3] > 200
            assert np.abs(found[fish][:, :3].astype(int) - (120, 60, 200)).max() <= 8


@pytest.mark.parametrize("writer", [WebmWriter, AlphaWebpWriter])
def test_same_frames_same_bytes_and_whole_or_not_at_all(tmp_path, writer):
    def write(frames):
        write_frames(writer(tmp_path / "a.film", (45, 71, 4), RATE, 20), frames)

    write(clip())
    first = content(tmp_path)
    write(clip())
    assert content(tmp_path) == first
    with pytest.raises(ValueError, match="wanted"):
        write([*clip(count=2), np.zeros((45, 71, 3), np.uint8)])
    assert content(tmp_path) == first and len(first) == 1


# --- tracks as poses -----------------------------------------------------------------------------


def straight_tracks(lengths, points=5):
    """Straight fish 40 px long, headed right; every second row of the backbone begins at the tail."""
    rows, features = [], []
    for track, length in lengths.items():
        for frame in range(2, 2 + length):
            head = np.array([100.0 + 3 * frame, 10.0 * track])
            line = head - np.linspace(0, 40, points)[:, None] * [1, 0]
            given = line[::-1] if frame % 2 else line
            rows.append((track, frame, *(head - (18, 0)), given[:, 0], given[:, 1]))
            features.append((*head, 0.75))
    names = ["track_id", "frame", "x_px", "y_px", "backbone_x_px", "backbone_y_px"]
    tracks = pd.DataFrame(rows, columns=names)
    names = ["head_x_px", "head_y_px", "head_confidence"]
    return tracks, pd.DataFrame(features, columns=names)


@pytest.mark.parametrize("body_points", [0, 1, 2, 3])
def test_points_lie_from_head_to_tail_at_equal_distances(body_points):
    found = keypoints_of_tracks(*straight_tracks({4: 6, 8: 9}), 20, body_points, 1, 10)
    body = [f"body_{n + 1}" for n in range(body_points)]
    assert found.individuals == ("track_4", "track_8") and found.frames == 20
    assert found.keypoints == ("head", *body, "tail", "centre")
    assert found.frame.tolist() == sorted([*range(2, 8), *range(2, 11)])
    x = 100.0 + 3 * found.frame
    along = np.linspace(0, 40, body_points + 2)
    assert np.allclose(found.places[:, :-1, 0], x[:, None] - along)
    assert np.allclose(found.places[:, -1, 0], x - 18)
    assert np.array_equal(found.places[:, 0, 1], np.array([40.0, 80.0])[found.individual])
    assert (found.confidence[:, :-1] == 0.75).all() and (found.confidence[:, -1] == 1).all()


def test_short_tracks_are_left_out_and_of_the_rest_the_longest_stay():
    tables = straight_tracks({1: 3, 2: 9, 3: 5, 4: 7})
    every = keypoints_of_tracks(*tables, 20, 1, 4, 9).individuals
    assert every == ("track_2", "track_3", "track_4")
    few = keypoints_of_tracks(*tables, 20, 1, 4, 2)
    assert few.individuals == ("track_2", "track_4") and len(few.frame) == 16
    assert keypoints_of_tracks(*tables, 20, 1, 10, 9).individuals == ("track_2",)


def test_another_programs_animals_are_each_one_whatever_their_tracks():
    tracks, features = straight_tracks({1: 3, 2: 9, 3: 5, 4: 7})
    tracks.loc[tracks["track_id"] == 3, "frame"] += 20
    animals = tracks["track_id"].map({1: "berta", 2: "anna", 3: "berta", 4: "carl"})
    found = keypoints_of_tracks(tracks, features, 40, 0, 8, 9, animals)
    assert found.individuals == ("anna", "berta") and len(found.frame) == 9 + 3 + 5
    berta = found.individual == 1
    assert found.frame[berta].tolist() == [*range(2, 5), *range(22, 27)]
    assert found.places[berta, 0, 1].tolist() == [10.0] * 3 + [30.0] * 5


def some_poses():
    """Two fish in eight frames, each in two of them."""
    rng = np.random.default_rng(0)
    return Poses(
        ("track_4", "track_8"), ("head", "tail", "centre"), 8, np.array([0, 1, 0, 1]),
        np.array([0, 0, 4, 6]), rng.uniform(-5, 900, (4, 3, 2)), rng.random((4, 3)),
    )  # fmt: skip


def assert_holds_poses(dataset, given, individuals):
    """Whether a dataset of movement holds these poses and nothing else."""
    position = dataset.position.transpose("time", "individuals", "keypoints", "space")
    names = [given.individuals[k] for k in individuals]
    assert list(map(str, dataset.individuals.values)) == names
    assert list(map(str, dataset.keypoints.values)) == list(given.keypoints)
    assert list(dataset.space.values) == ["x", "y"]
    np.testing.assert_allclose(dataset.time, np.arange(8) / float(RATE), atol=1e-6)
    rows = np.isin(given.individual, individuals)
    fish = given.individual[rows] - individuals[0]
    assert np.isfinite(position.values).sum() == rows.sum() * 6
    cells = given.frame[rows], fish
    np.testing.assert_allclose(position.values[cells], given.places[rows], atol=1e-3)
    confidence = dataset.confidence.transpose("time", "individuals", "keypoints").values
    np.testing.assert_allclose(confidence[cells], given.confidence[rows], atol=1e-6)


@pytest.mark.filterwarnings("ignore")  # of movement and of what it imports
def test_movements_netcdf_is_read_by_xarray_and_valid_for_movement(tmp_path):
    pytest.importorskip("movement", reason="the extra `tracks` is not installed: make tracks")
    import xarray
    from movement.io import save_poses
    from movement.validators.datasets import ValidPosesInputs

    given = some_poses()
    save_netcdf(tmp_path / "tracks.nc", given, RATE)
    save_netcdf(tmp_path / "scaled.nc", given, RATE, 0.25)
    scaled = xarray.load_dataset(tmp_path / "scaled.nc")
    ValidPosesInputs.validate(scaled)
    assert (scaled.position.units, scaled.position_mm.units) == ("px", "mm")
    np.testing.assert_allclose(scaled.position_mm, 0.25 * scaled.position, rtol=1e-6)
    for engine in ("h5netcdf", "netcdf4"):
        dataset = xarray.load_dataset(tmp_path / "tracks.nc", engine=engine)
        assert_holds_poses(dataset, given, [0, 1])
    ValidPosesInputs.validate(dataset)
    assert (dataset.fps, dataset.time_unit, dataset.ds_type) == (float(RATE), "seconds", "poses")
    save_poses.to_dlc_file(dataset, tmp_path / "again.csv", split_individuals=False)
    again = load_poses(tmp_path / "again.csv", None, 25.0)
    assert again.individuals == given.individuals
    np.testing.assert_allclose(again.places, given.places, atol=1e-3)
    back = load_poses(tmp_path / "tracks.nc", None, 25.0)
    assert back.frame.tolist() == given.frame.tolist()
    np.testing.assert_allclose(back.places, given.places, atol=1e-3)


@pytest.mark.filterwarnings("ignore")
def test_nwb_is_read_by_pynwb_and_by_movement(tmp_path):
    pytest.importorskip("movement", reason="the extra `tracks` is not installed: make tracks")
    from movement.io import load_dataset
    from pynwb import NWBHDF5IO

    given = some_poses()
    save_nwb(tmp_path / "nwb", given, RATE)
    assert {path.name for path in (tmp_path / "nwb").iterdir()} == {"track_4.nwb", "track_8.nwb"}
    for number, name in enumerate(given.individuals):
        with NWBHDF5IO(tmp_path / f"nwb/{name}.nwb", "r") as file:
            read = file.read()
            pose = read.processing["behavior"]["PoseEstimation"]
            assert (read.identifier, pose.source_software) == (name, "finloop")
            assert set(pose.pose_estimation_series) == set(given.keypoints)
            head = np.asarray(pose.pose_estimation_series["head"].data)
        rows = given.individual == number
        np.testing.assert_allclose(head[given.frame[rows]], given.places[rows, 0])
        dataset = load_dataset(tmp_path / f"nwb/{name}.nwb", source_software="NWB")
        assert_holds_poses(dataset.sel(keypoints=list(given.keypoints)), given, [number])
    save_nwb(tmp_path / "scaled", given, RATE, 0.25)
    with NWBHDF5IO(tmp_path / "scaled/track_4.nwb", "r") as file:
        pose = file.read().processing["behavior"]["PoseEstimation"]
        head = pose.pose_estimation_series["head"]
        assert (head.unit, head.conversion) == ("millimeters", 0.25)
        rows = given.individual == 0
        scaled = head.get_data_in_units()[given.frame[rows]]
        np.testing.assert_allclose(scaled, 0.25 * given.places[rows, 0])


def test_formats_of_the_extra_name_it_where_it_is_missing(tmp_path, monkeypatch):
    missing = "finloop.io.poses.extra.import_module"
    monkeypatch.setattr(missing, lambda name: __import__("no_" + name))
    for save, name in ((save_netcdf, "tracks.nc"), (save_nwb, "nwb")):
        with pytest.raises(FinloopError, match="extra `tracks`"):
            save(tmp_path / name, some_poses(), RATE)
    assert not content(tmp_path)


@pytest.mark.parametrize("block", [3, 1024])
def test_deeplabcuts_layout_is_read_by_pandas(tmp_path, block):
    given = some_poses()
    individual, frame = given.individual, given.frame
    save_csv_in_blocks(tmp_path / "tracks.csv", deeplabcut_tables(given, block), decimals=3)
    found = pd.read_csv(tmp_path / "tracks.csv", header=[0, 1, 2, 3], index_col=0)
    assert list(found.columns.names) == ["scorer", "individuals", "bodyparts", "coords"]
    assert found.index.tolist() == list(range(8)) and found.shape == (8, 18)
    assert found.columns[0] == ("finloop", "track_4", "head", "x")
    for row in range(4):
        fish = found["finloop"][given.individuals[individual[row]]].loc[frame[row]]
        for k, name in enumerate(given.keypoints):
            wanted = [*given.places[row, k], given.confidence[row, k]]
            assert fish[name].tolist() == pytest.approx(wanted, abs=0.0006)
    assert found.notna().to_numpy().sum() == 4 * 9  # no fish anywhere else


# --- the stage -----------------------------------------------------------------------------------

TICKS, FRAMES = 12, 30
SETTINGS = *TINY_CARP, "export.mode=network", "export.stimulus_seconds=0"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """What the stage reads: one fish of 30 frames, twelve sprites, an edit list of both."""
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path, *SETTINGS, "export.webp_seconds=0.2")
    data = tmp_path / "data"
    facts = VideoFacts("file", WIDTH, HEIGHT, FRAMES, RATE, True, ((0, FRAMES),))
    save_facts(data / "clip/facts.json", facts)
    scene = SceneFacts("dark", 1.0, 5.0, 90.0, 20.0, 50.0, "all", 5)
    save_record(data / "extract/scene.json", scene)
    frame = np.arange(FRAMES)
    x, lines = 30.0 + frame, {"length_px": 20.0, "area_px": 90.0, "contrast": 50.0}
    ring = [np.zeros(OUTLINE_POINTS)] * FRAMES
    tracks = pd.DataFrame(
        {"track_id": 5, "frame": frame, "x_px": x, "y_px": 40.0, **lines}
        | {f"{name}_px": [np.full(5, 1.0)] * FRAMES for name in ("half_width", "backbone_y")}
        | {"backbone_x_px": [place + np.linspace(10, -10, 5) for place in x]}
        | {"outline_x_px": ring, "outline_y_px": ring}
    )
    tracks["backbone_y_px"] = [np.full(5, 40.0)] * FRAMES
    save_table(data / "extract/tracks.parquet", tracks, tracks_schema(5))
    features = pd.DataFrame({column.name: 0.0 for column in FEATURES.columns}, index=frame)
    features = features.assign(
        track_id=5, frame=frame, head_x_px=x + 10, head_y_px=40.0, head_confidence=0.9,
        orientation=1, orientations=ORIENTATIONS, swimming_type=0, body_length_px=20.0,
    )  # fmt: skip
    save_table(data / "features/features.parquet", features, FEATURES)
    told = {"track_id": [5], "identity": 0, "after_track": -1, "gap_frames": 0, "probability": 1.0}
    told = pd.DataFrame(told)
    save_table(data / "identity/identities.parquet", told, IDENTITIES)
    sprites = sprite_table()
    save_table(data / "sprites/sprites.parquet", sprites, SPRITES)
    with CutoutWriter(data / "extract/cutouts.arrow") as writer:
        for k in frame:
            writer.write(Cutout(5, int(k), 15 + int(k), 25, drop(channels=4)))
    with CutoutWriter(data / "sprites/sprites.arrow", sprites=True) as writer:
        for sprite in range(len(sprites)):
            for number in range(1, ORIENTATIONS + 1):
                pixels = drop(channels=4, turn=(number - 1) // 6) // [*[1 + sprite % 3] * 3, 1]
                key = sprite, number
                writer.write(Cutout(*key, 35, 25, pixels.astype(np.uint8), *key))
    stages.sprites.write_atlas(data / "sprites", sprites, 2048, float(RATE))
    kinds = np.array(["frame", "sprite"])[np.arange(TICKS) // 6]
    ticks, sprite = np.arange(TICKS), kinds == "sprite"
    number = pd.Series(ticks + 1, dtype="Int8").where(sprite)
    source = np.where(sprite, 0, ticks)
    edit = edit_list(TICKS, kind=kinds, source=source, orientation=number, speed=1.5)
    save_table(data / "animate/network.parquet", edit, EDIT)
    save_json(data / "animate/network/drawn.json", {"size": 1.0})
    return tmp_path


@pytest.mark.filterwarnings("ignore")
def test_the_stage_names_another_programs_animals_and_writes_its_formats_in_mm_too(folder):
    given = pd.DataFrame({"track_id": 5, "frame": range(FRAMES), "animal": "anna"})
    given[["head_x_px", "head_y_px", "tail_x_px", "tail_y_px"]] = np.nan
    save_table(folder / "data/extract/given.parquet", given, GIVEN)
    facts = VideoFacts("file", WIDTH, HEIGHT, FRAMES, RATE, True, ((0, FRAMES),), mm_per_px=0.25)
    save_facts(folder / "data/clip/facts.json", facts)
    extra = find_spec("movement") is not None
    asked = ["export.tracks_netcdf=true", "export.tracks_nwb=true"] if extra else []
    prepare(folder, *SETTINGS, "export.webp_seconds=0.2", *asked)
    stages.export.main()
    out = folder / "data/export"
    px, mm = (
        pd.read_csv(out / f"{name}.csv", header=[0, 1, 2, 3], index_col=0)["finloop"]["anna"]
        for name in ("tracks", "tracks_mm")
    )
    assert list(px) == list(mm)
    for name, values in px.items():
        scale = 1 if name[1] == "likelihood" else 0.25
        np.testing.assert_allclose(mm[name], scale * values, atol=0.001)
    listed = pd.read_csv(out / "network.csv")
    for name in ("x", "y", "aim_x", "aim_y"):
        np.testing.assert_allclose(listed[f"{name}_mm"], 0.25 * listed[f"{name}_px"], atol=1e-3)
    np.testing.assert_allclose(listed["speed_mm_s"], 0.25 * 20 * listed["speed"], atol=1e-3)
    assert listed["speed"].max() > 0
    assert (out / "tracks.nc").exists() == (out / "nwb/anna.nwb").exists() == extra


def test_the_stage_hands_everything_on(folder):
    stages.export.main()
    out = folder / "data/export"
    films = json.loads((out / "films.json").read_text())
    words = ("straight", "slide", "left", "right")
    assert set(films["films"]) == {"network", *words} and films["frame_rate_hz"] == 28.07
    for name, film in films["films"].items():
        shown = [alpha for _, _, alpha in decode_webm(out / f"{name}.webm")]
        assert len(shown) == film["frames"] == (TICKS if name == "network" else 3)
        odd = film["height_px"] % 2, film["width_px"] % 2
        assert shown[0].shape == (film["height_px"] + odd[0], film["width_px"] + odd[1])
        with Image.open(out / f"{name}.webp") as webp:
            assert webp.size == (film["width_px"], film["height_px"])
            assert webp.n_frames == (6 if name == "network" else 3)  # 0.2 s
            visible = np.asarray(webp.convert("RGBA"))[..., 3]
            away_px = cv2.distanceTransform((visible < 26).astype(np.uint8), cv2.DIST_L2, 5)
            assert visible[away_px > 3].max() == 0  # on any ground, no smudge around the fish
        for k, alpha in enumerate(shown):
            centre = mass_centre(alpha.astype(float))
            if name == "network":  # the fish is where the edit list says
                place = 30 + 3 * k - film["left_px"], 40 - film["top_px"]
            else:
                place = film["pivot_x_px"], film["pivot_y_px"]
            assert centre == pytest.approx(place, abs=1.5)  # a drop's centre is not amid it

    table = pq.read_table(out / "network.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units == {column.name: column.unit for column in READABLE.columns}
    rows, listed = table.to_pandas(), pd.read_csv(out / "network.csv")
    shown = [one for one in rows if one != "pose" and "_mm" not in one]  # no scale is known
    assert list(listed) == shown and len(listed) == TICKS
    assert rows[["x_mm", "speed_mm_s"]].isna().all(axis=None)
    assert np.allclose(listed["x_px"], rows["x_px"], atol=1e-4)
    assert listed["frame"].tolist() == [*range(6), *[70] * 6]

    atlas = json.loads((out / "atlas-0.json").read_text())
    assert set(listed["atlas"].dropna()) <= set(atlas["frames"])
    with Image.open(out / atlas["meta"]["image"]) as page:
        box = atlas["frames"]["left/07/02"]["frame"]
        part = np.array(page)[box["y"] :, box["x"] :][: box["h"], : box["w"]]
    assert np.array_equal(part[..., 3], drop_residue(drop(turn=1))[..., 1])

    tracks = pd.read_csv(out / "tracks.csv", header=[0, 1, 2, 3], index_col=0)
    tracks = tracks["finloop"]["animal_0"]
    assert np.allclose(tracks["head"]["x"], 40 + np.arange(FRAMES))
    assert np.allclose(tracks["body_2"]["x"], 30 + np.arange(FRAMES))
    metrics = load_numbers(folder / "reports/export")
    assert metrics["track_rows_share"] == metrics["animals"] == 1 and metrics["frames"] == TICKS


def test_a_second_run_gives_the_same_bytes_and_clears_what_was_there(folder):
    prepare(folder, *SETTINGS, "export.webp_seconds=0.0")
    (folder / "data/export").mkdir()
    (folder / "data/export/loops.webm").write_text("of another mode")
    stages.export.main()
    first = content(folder / "data/export")
    assert "loops.webm" not in first and "network.webp" not in first and "left.webp" in first
    stages.export.main()
    assert content(folder / "data/export") == first


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (lambda f: (f / "data/animate/network.parquet").unlink(), "there is no data.animate.network.parquet(.|\n)*export.mode"),
        (lambda f: save_table(f / "data/animate/network.parquet", edit_list(3, source=99), EDIT), "wanted a frame"),
        (lambda f: save_table(f / "data/sprites/sprites.parquet", sprite_table(2), SPRITES), "mass centre for every"),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_said_and_nothing_is_left(folder, harm, said):
    harm(folder)
    with pytest.raises(FinloopError, match=said):
        stages.export.main()
    assert not content(folder / "data/export")


def test_a_cycle_keeps_the_mass_centre_in_the_middle():
    store = [Cutout(0, 0, 35, 25, drop()) for _ in range(12 * ORIENTATIONS)]
    own = np.array([35, 25]) + mass_centre(drop()[..., -1].astype(float))
    gallery = Gallery({"sprite": CutoutSet(store, own[None].repeat(12, 0), ORIENTATIONS)})
    steps, half = sprites_of_sequence(sprite_table(), "left", gallery)
    alone = FishOnlyPainter(2 * half + 1, 2 * half + 1, 1)
    crop = box_of_all_fish(steps, alone)
    assert len(steps) == 3 and {one.fish.scale for (one,) in steps} == {1.2}
    for frame in cut_out_fish(steps, alone, crop):
        at = mass_centre(frame[..., 3].astype(float)) + (crop.left, crop.top)
        assert at == pytest.approx([half, half], abs=0.02)
