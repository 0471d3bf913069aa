"""Stage `tank`: show an edit list in three dimensions: film, pictures, glTF scene, page."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats
from finloop.edit.schema import split_by_fish
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.movie import Mp4Writer
from finloop.io.picture import save_picture
from finloop.io.viewer import save_viewer
from finloop.project import Project
from finloop.tank.body import arc_lengths, median_half_widths
from finloop.tank.camera import FOLLOW, PRESETS, TankSize, camera_views
from finloop.tank.fish import FishSurface
from finloop.tank.gltf import AnimatedFish, encode_tank_glb, principal_shapes, to_gltf_axes
from finloop.tank.scene import TankScene, select_offscreen_renderer
from finloop.tank.settings import TankSettings
from finloop.tank.skin import FishSkins
from finloop.tank.swim import USED, film_body_shapes, poses_in_tank, swimming_heights
from stages.settings import load_settings

OUT, REPORT = Path("data/tank"), Path("reports/tank")
ALT = (
    "A tank with a glass wall on every side; a fish swims in it, as bent and as coloured as it was "
    "filmed from above, over its shadow on the floor of the film."
)
MOMENTS = 3  # on the contact sheet, spread over the film
_SHEET_PX = 480  # width of a picture on the contact sheet


def animated_fish(p: TankSettings, project: Project) -> tuple[list[FishSurface], Floats]:
    """Return the animation's fish as moving 3-D surfaces, and the times (ticks,) [s].

    Only the first `p.seconds` of the edit list of `p.mode` are taken, at least one tick.
    """
    edit, _, tracks, sprites, bodies = project.edit_with_sources(p.mode, "tank", USED)
    edits = split_by_fish(edit[(edit["time_s"] < p.seconds) | (edit["tick"] == 0)])
    time = edits[0]["time_s"].to_numpy(float)
    columns = ["head_x_px", "head_y_px", "heading_deg"]
    film = film_body_shapes(tracks, project.features[columns])
    table = pd.DataFrame() if sprites is None else sprites
    fish_poses = [poses_in_tank(fish_edit, film, table, bodies) for fish_edit in edits]
    typical = median_half_widths(film.half_width, film.backbone)
    length = float(np.median(np.concatenate([arc_lengths(pose.backbone) for pose in fish_poses])))
    centres = tracks[["x_px", "y_px"]].to_numpy(float)
    skins = FishSkins(film, typical, centres, project.cutouts.__getitem__)
    surfaces = []
    for number, pose in enumerate(fish_poses):
        heights = swimming_heights(time, depth=p.water_depth_bl * length, fish=number)
        place = np.c_[pose.centre, heights]
        surfaces.append(FishSurface(pose, place, skins, typical, length))
    return surfaces, time


def _join_sheet(pictures: list[list[np.ndarray]]) -> np.ndarray:
    """Return one picture that shows rows of pictures (h, w, 3), scaled to a width of _SHEET_PX.

    All have one size; each inner list is a row.
    """
    height, width = pictures[0][0].shape[:2]
    size = _SHEET_PX, round(_SHEET_PX * height / width)
    return np.vstack([
        np.hstack([cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in row])
        for row in pictures
    ])  # fmt: skip


def _save_3d_files(
    folder: Path, tank: TankSize, fish: list[FishSurface], project: Project
) -> list[AnimatedFish]:
    """Write the tank with its fish to `folder`: as a scene, tank.glb, and a page, tank.html.

    Return the fish, animated as in both files. fish: surfaces; the first one gives the skin of all.
    """
    first, rate = fish[0], project.rate_hz
    animated = [
        AnimatedFish(
            principal_shapes(surface.points_of_all_ticks(), surface.poses.heading),
            surface.place, surface.poses.heading,
        )
        for surface in fish
    ]  # fmt: skip
    glb = encode_tank_glb(tank, project.background, first.typical_skin(), animated, rate)
    save_bytes(folder / "tank.glb", glb)
    path = [to_gltf_axes((place - tank.middle) / tank.body_length) for place in first.place]
    save_viewer(folder / "tank.html", glb, "A filmed fish in its tank", ALT, path, rate)
    return animated


def main() -> None:
    """Draw the animation in three dimensions: a film, a picture, a glTF scene and a page.

    They are written to data/tank/, a contact sheet and the metrics to reports/tank/.
    """
    p: TankSettings = load_settings("tank")
    select_offscreen_renderer()
    with Project() as project, whole_folder(OUT) as folder:
        facts, rate = project.facts, project.rate_hz
        fish, time = animated_fish(p, project)
        first, ticks = fish[0], len(time)
        depth, size = p.water_depth_bl * first.length_px, (p.width_px, p.height_px)
        tank = TankSize(facts.width_px, facts.height_px, depth, first.length_px, size[0] / size[1])
        cameras = {  # those that follow follow the first fish
            name: camera_views(name, tank, first.place, first.poses.heading, rate)
            for name in (*PRESETS, p.camera)
        }
        living = project.living_tank(load_settings("render").tank)
        with TankScene(project.background, tank, size, len(fish), living) as scene:

            def draw_view(camera: str, tick: int) -> np.ndarray:
                """Return the picture (h, w, 3) of the tank that a camera sees at a tick."""
                shapes = [surface.surface_and_skin_at(tick) for surface in fish]
                return scene.draw_frame(shapes, cameras[camera], tick, time[tick])

            save_picture(folder / "still.png", draw_view(FOLLOW, first.find_strongly_bent_tick()))
            # In the middle of each of MOMENTS equal parts of the film; a row for each camera.
            moments = np.linspace(0, ticks - 1, 2 * MOMENTS + 1).astype(int)[1::2]
            sheet = [[draw_view(name, int(tick)) for tick in moments] for name in PRESETS]
            with (
                report_progress("tank", ticks) as advance,
                Mp4Writer(folder / "tank.mp4", (*size[::-1], 3), facts.frame_rate, p.crf) as film,
            ):
                for tick in range(ticks):
                    film.write(draw_view(p.camera, tick))
                    advance()
        animated = _save_3d_files(folder, tank, fish, project)
    save_picture(REPORT / "contact_sheet.png", _join_sheet(sheet))
    error_px = max(body.shape.error_px for body in animated)
    numbers = {
        "frames": ticks, "duration_s": ticks / rate,
        "gltf_shapes": max(len(body.shape.modes) for body in animated), "gltf_error_px": error_px,
        "gltf_error_pct_of_length": 100 * error_px / first.length_px,
    }  # fmt: skip
    save_metrics(REPORT / "metrics.json", numbers)


if __name__ == "__main__":
    run(main)
