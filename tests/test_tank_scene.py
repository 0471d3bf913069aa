"""The tank drawn by VTK, written as glTF and as a page: what comes out is read back by others."""

import json
import os
import shutil
import signal
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from conftest import wait_for
from scratch import content, prepare
from toy_fish import LENGTH, ROOM, P, edit_list, fish_mask, fish_of, overlap, toy

import stages.tank
from finloop.base.errors import FinloopError
from finloop.edit.schema import EDIT, WHY
from finloop.extract.table import OUTLINE_POINTS, SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.io.cutouts import CutoutWriter
from finloop.io.numbers import load_numbers
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import save_record
from finloop.io.table import save_table
from finloop.io.video import FACTS_NAME, VideoFacts, read_frames, save_facts
from finloop.tank import gltf
from finloop.tank.camera import camera_views
from finloop.tank.scene import TankScene, select_offscreen_renderer

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def _draws():
    try:
        select_offscreen_renderer()
    except FinloopError:
        return False
    return True


drawing = pytest.mark.skipif(not _draws(), reason="no libEGL, no libOSMesa: nothing draws in 3-D")
TURNS = {"rotation_deg": np.linspace(0, 240, 12), "heading_deg": np.linspace(0, 240, 12)}


def swimming(n=12):
    """A fish that turns as it swims, bent one way, then the other."""
    rows = [tick % 12 // 6 for tick in range(n)]
    way = {"x_px": np.linspace(60, 140, n), "y_px": np.linspace(50, 90, n)}
    return edit_list(n, source=rows, **way, **{k: np.resize(v, n) for k, v in TURNS.items()})


# --- VTK -----------------------------------------------------------------------------------------


@drawing
def test_from_above_the_fish_is_where_the_list_puts_it_and_wears_its_skin():
    """Without perspective a pixel of the film is a pixel of the picture."""
    fish = fish_of(edit_list(2, x_px=[70.0, 140.0], y_px=[50.0, 100.0], rotation_deg=[20.0, 200.0]))
    size = (208, 156)
    tank = ROOM._replace(aspect=size[0] / size[1])
    view = camera_views("top", tank, fish.place, fish.poses.heading, 25.0)
    floor = np.full((150, 200), 128, np.uint8)
    floor[:40, :40] = 60
    with TankScene(floor, tank, size) as scene:
        for tick in range(2):
            shown = scene.draw_frame([fish.surface_and_skin_at(tick)], view, tick, 0.0).astype(int)
            vivid = np.abs(shown[..., 0] - shown[..., 2]) > 42  # red or blue: the fish alone is
            seen = vivid[3:153, 4:204]  # the film within the picture
            assert shown[13:33, 14:34].mean() < 80 < 110 < shown[-30:-10, 20:40].mean() < 140
            wanted = fish_mask(fish, tick, seen.shape)
            assert overlap(wanted, seen) > 0.7
            near = cv2.dilate(wanted.astype(np.uint8), np.ones((3, 3))).astype(bool)
            assert not (seen & ~near).any()
            at = np.argwhere(seen).mean(0)[::-1]
            assert at == pytest.approx(fish.place[tick, :2] * (1, -1), abs=2)
        again = scene.draw_frame([fish.surface_and_skin_at(1)], view, 1, 0.0)
        assert np.array_equal(again, shown)  # the same window draws the same again
        left = fish.poses.backbone[1, 8] - fish.poses.backbone[1, 4]
        left = np.array([left[1], -left[0]]) / np.linalg.norm(left)
        middle = fish.place[1, :2] + fish.poses.backbone[1, 6]
        for side, channel in ((3, 0), (-3, 2)):
            x, y = (middle + side * left) * (1, -1) + [4.5, 3.5]
            assert shown[int(y), int(x)].argmax() == channel


@drawing
def test_several_fish_are_drawn_each_with_its_shadow():
    size = (208, 156)
    tank, floor = ROOM._replace(aspect=size[0] / size[1]), np.full((150, 200), 128, np.uint8)
    one, other = (fish_of(edit_list(1, x_px=x, y_px=75.0)) for x in (60.0, 140.0))
    view = camera_views("top", tank, one.place, one.poses.heading, 25.0)
    shown = {}
    for name, fish in {"one": [one], "other": [other], "both": [one, other]}.items():
        with TankScene(floor, tank, size, len(fish)) as scene:
            shown[name] = scene.draw_frame(
                [own.surface_and_skin_at(0) for own in fish], view, 0, 0.0
            )
    left, right = np.s_[:, :100], np.s_[:, 108:]
    assert np.array_equal(shown["both"][left], shown["one"][left])
    assert np.array_equal(shown["both"][right], shown["other"][right])
    assert not np.array_equal(shown["one"][right], shown["other"][right])


# --- glTF ----------------------------------------------------------------------------------------


def test_few_shapes_that_mix_give_every_shape_back():
    fish = fish_of(swimming())
    points = fish.points_of_all_ticks().astype(float)
    heading = fish.poses.heading
    found = gltf.principal_shapes(points, heading)
    back = found.mean + np.einsum("tm,mvc->tvc", found.weights, found.modes)
    cos, sin = np.cos(heading)[:, None], np.sin(heading)[:, None]
    x, y, z = np.moveaxis(back, -1, 0)
    there = np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)
    error = np.linalg.norm(there - points, axis=-1).max()
    assert found.error_px == pytest.approx(error, abs=1e-4) and error < 0.05
    one = gltf.principal_shapes(points, heading, most=0)
    assert one.error_px > 1 and len(one.modes) == 0


def glb_of(*fish):
    background = np.full((150, 200, 3), (40, 90, 140), np.uint8)
    headings = [one.poses.heading for one in fish]
    every = [
        gltf.AnimatedFish(
            gltf.principal_shapes(one.points_of_all_ticks(), heading), one.place, heading
        )
        for one, heading in zip(fish, headings, strict=True)
    ]
    return gltf.encode_tank_glb(ROOM, background, fish[0].typical_skin(), every, 25.0)


@pytest.mark.parametrize("count", [1, 2])
def test_vtk_reads_the_scene_and_finds_the_fish_at_every_tick(count, tmp_path):
    """VTK's own reader plays the animation: its points are those of the edit list."""
    from vtkmodules.vtkIOGeometry import vtkGLTFReader

    every = [fish_of(swimming()), fish_of(swimming().assign(x_px=np.linspace(140, 60, 12)))][:count]
    (tmp_path / "tank.glb").write_bytes(glb_of(*every))
    reader = vtkGLTFReader()
    reader.SetFileName(str(tmp_path / "tank.glb"))
    reader.ApplyDeformationsToGeometryOn()
    reader.UpdateInformation()
    assert reader.GetNumberOfAnimations() == 1
    assert reader.GetAnimationDuration(0) == pytest.approx(11 / 25, abs=1e-6)
    reader.EnableAnimation(0)
    reader.SetFrameRate(25)
    reader.UpdateInformation()
    for tick in (0, 5, 11):
        reader.UpdateTimeStep(tick / 25)
        meshes = _meshes(reader.GetOutput())
        sizes = sorted(len(points) for points in meshes)
        wanted = [fish.surface_and_skin_at(tick)[0].reshape(-1, 3) - ROOM.middle for fish in every]
        seen = [points for points in meshes if len(points) == len(wanted[0])]
        for points, one in zip(seen, wanted, strict=True):
            there = np.array([gltf.to_gltf_axes(point / LENGTH) for point in one])
            assert np.abs(points - there).max() < 0.002
        assert sizes[0] == 4 and len(sizes) == 4 + 2 * count  # floor, water, glass, edges; shadows


def _meshes(block):
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if hasattr(block, "GetNumberOfBlocks"):
        parts = [block.GetBlock(i) for i in range(block.GetNumberOfBlocks())]
        return [mesh for part in parts if part is not None for mesh in _meshes(part)]
    return [vtk_to_numpy(block.GetPoints().GetData()).copy()]


def test_the_files_own_numbers_are_true():
    """Lengths, offsets and bounds as the standard wants them, read from the bytes alone."""
    data = glb_of(fish_of(swimming()))
    assert data[:4] == b"glTF" and int.from_bytes(data[8:12], "little") == len(data)
    size = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + size]), data[20 + size + 8 :]
    assert document["buffers"][0]["byteLength"] == len(binary)
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view["byteOffset"]
        assert start % 4 == 0 and view["byteLength"] == accessor["count"] * width * int(kind[2])
        read = np.frombuffer(binary[start : start + view["byteLength"]], kind).reshape(-1, width)
        if "min" in accessor:
            found = read.min(0).tolist(), read.max(0).tolist()
            assert found == (accessor["min"], accessor["max"])
    pictures = [document["bufferViews"][image["bufferView"]] for image in document["images"]]
    for view in pictures:
        coded = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        colours = cv2.imdecode(np.frombuffer(coded, np.uint8), cv2.IMREAD_COLOR)
        assert colours.shape in ((150, 200, 3), (64, 128, 3))
        if colours.shape == (150, 200, 3):
            assert colours[75, 100] == pytest.approx([140, 90, 40], abs=4)  # blue, green, red
    assert glb_of(fish_of(swimming())) == data


def test_numbers_that_are_none_are_not_written():
    with pytest.raises(ValueError, match="NaN"):
        gltf.GlbDocument().add_array(np.array([0.0, np.nan], np.float32))


# --- the stage -----------------------------------------------------------------------------------


def put(folder, fish=1):
    """What the stages before have made of the toy film, and an edit list."""
    tracks, heads, cutouts = toy()
    ring = [np.zeros(OUTLINE_POINTS, np.float32)] * 2
    tracks = tracks.assign(
        area_px=1.0, contrast=1.0, length_px=LENGTH, outline_x_px=ring, outline_y_px=ring
    )
    save_table(folder / "data/extract/tracks.parquet", tracks, tracks_schema(P))
    scene = SceneFacts("dark", 1, 6, 400, LENGTH, 60, "all", P)
    save_record(folder / "data/extract/scene.json", scene)
    with CutoutWriter(folder / "data/extract/cutouts.arrow") as store:
        for one in cutouts:
            store.write(one)
    save_picture(folder / "data/extract/background.png", np.full((150, 200, 3), 120, np.uint8))
    zero = {column.name: 0 for column in FEATURES.columns} | {"track_id": 3, "frame": [0, 1]}
    save_table(folder / "data/features/features.parquet", heads.assign(
        **{name: value for name, value in zero.items() if name not in heads}
    ), FEATURES)  # fmt: skip
    facts = VideoFacts("file", 200, 150, 2, Fraction(25), True, ((0, 2),))
    save_facts(folder / "data/clip" / FACTS_NAME, facts)
    usual = {
        "speed": 1.0, "motion_area": np.nan, "mode": "network", "state": "straight", "goal": "",
        "aim_x_px": 0.0, "aim_y_px": 0.0, **dict.fromkeys(WHY),
    }  # fmt: skip
    edit = swimming(30).assign(tick=np.arange(30), time_s=np.arange(30) / 25, **usual)
    every = [edit.assign(fish=number, y_px=50.0 + 40 * number) for number in range(fish)]
    save_table(folder / "data/animate/network.parquet", pd.concat(every), EDIT)


def ready(folder, *more):
    small = ("tank.mode=network", "tank.seconds=0.4", "tank.width_px=160", "tank.height_px=96")
    prepare(folder, *small, *more)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    put(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@drawing
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium")
def test_the_stage_and_its_page_in_a_browser_without_a_network(folder):
    from playwright.sync_api import sync_playwright

    ready(folder)
    stages.tank.main()
    assert {*content(Path("data/tank")), *content(Path("reports/tank"))} == {
        "still.png", "tank.mp4", "tank.glb", "tank.html", "metrics.json", "contact_sheet.png"
    }  # fmt: skip
    metrics = load_numbers(Path("reports/tank"))
    assert metrics["frames"] == 10 and metrics["gltf_error_px"] < 0.1
    frames = list(read_frames(Path("data/tank/tank.mp4"), colour=True))
    assert len(frames) == 10 and frames[0].shape == (96, 160, 3)
    assert load_picture(Path("data/tank/still.png")).std() > 10
    with sync_playwright() as play:
        flags = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = play.chromium.launch(executable_path=CHROMIUM, args=flags)
        page = browser.new_page(viewport={"width": 300, "height": 300})
        wrong, asked = [], []
        page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto((folder / "data/tank/tank.html").as_uri())
        tank = "document.getElementById('tank')"
        assert wait_for(lambda: page.evaluate(f"{tank}.loaded && !{tank}.paused"))
        assert page.evaluate(f"[{tank}.availableAnimations, {tank}.paused]") == [["swim"], False]
        page.evaluate("for (const one of document.querySelectorAll('button')) one.click()")
        assert page.evaluate(f"{tank}.paused") and page.inner_text("#play") == "Play"
        assert page.get_attribute("#follow", "aria-pressed") == "true"
        assert not wrong
        processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
        for one in processes["processInfo"]:
            if one["type"] == "GPU":  # it would draw on for seconds before the browser ends
                os.kill(one["id"], signal.SIGKILL)
        browser.close()
    assert all(url.startswith(("file:", "blob:", "data:")) for url in asked)


@drawing
def test_the_stage_takes_several_fish(folder):
    put(folder, fish=3)
    ready(folder)
    stages.tank.main()
    data = (folder / "data/tank/tank.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    names = [node["name"] for node in document["nodes"]]
    assert {"fish", "fish 1", "fish 2", "shadow", "shadow 1", "shadow 2"} <= set(names)
    targets = {names[one["target"]["node"]] for one in document["animations"][0]["channels"]}
    assert len(targets) == 6
    numbers = load_numbers(folder / "reports/tank")
    assert numbers["frames"] == 10 and numbers["gltf_error_px"] < 0.05


@drawing
def test_what_is_wrong_is_said_and_what_was_there_stays(folder, monkeypatch):
    Path("data/tank").mkdir()
    Path("data/tank/still.png").write_text("before")
    ready(folder, "tank.mode=loops")
    with pytest.raises(FinloopError, match=r"no data.animate.loops.parquet"):
        stages.tank.main()
    ready(folder, "tank.seconds=0.04")
    monkeypatch.setattr("finloop.io.viewer._SHA256", "another")
    with pytest.raises(FinloopError, match="whose sha256 is another"):
        stages.tank.main()
    assert set(content(Path("data/tank"))) == {"still.png"} and not Path("reports/tank").exists()
