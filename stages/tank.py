"""Stage `tank`: an edit list in three dimensions: film, pictures, glTF scene, page."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.features.table import FEATURES
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.cutouts import open_cutouts
from finloop.io.movie import Mp4Writer
from finloop.io.picture import load_picture, save_picture
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.io.viewer import save_viewer
from finloop.tank.body import lengths, typical_width
from finloop.tank.camera import FOLLOW, PRESETS, Room, views
from finloop.tank.display import choose_window
from finloop.tank.fish import Fish
from finloop.tank.gltf import shapes, tank_glb, upright
from finloop.tank.scene import Scene
from finloop.tank.settings import Settings
from finloop.tank.skin import Skins
from finloop.tank.swim import USED, film_bodies, heights, poses
from stages.edit import DATA, load_drawn
from stages.settings import load

EXTRACT, OUT, REPORT = DATA / "extract", DATA / "tank", Path("reports/tank")
ALT = (
    "A tank with a glass wall on every side; a fish swims in it, as bent and as coloured as it was "
    "filmed from above, over its shadow on the floor of the film."
)
MOMENTS = 3  # on the contact sheet, spread over the film
_SHEET_PX = 480  # width of a picture on the contact sheet


@contextmanager
def opened(p: Settings) -> Iterator[tuple[Fish, pd.DataFrame]]:
    """The fish of the edit list, for the seconds that are filmed, and that part of the list."""
    edit, _, tracks, sprites, bodies = load_drawn(p.mode, "tank", USED)
    edit = edit[edit["fish"] == 0]
    edit = edit.iloc[: max(1, int((edit["time_s"] < p.seconds).sum()))]
    columns = ["head_x_px", "head_y_px", "heading_deg"]
    film = film_bodies(tracks, load_table(DATA / "features/features.parquet", FEATURES, columns))
    pose = poses(edit, film, pd.DataFrame() if sprites is None else sprites, bodies)
    typical = typical_width(film.half_width, film.backbone)
    length = float(np.median(lengths(pose.backbone)))
    place = np.c_[pose.centre, heights(edit["time_s"].to_numpy(float), p.depth * length)]
    with open_cutouts(EXTRACT / "cutouts.arrow") as store:
        centres = tracks[["x_px", "y_px"]].to_numpy(float)
        skins = Skins(film, typical, centres, store.__getitem__)
        yield Fish(pose, place, skins, typical, length), edit


def sheet(pictures: list[list[np.ndarray]]) -> np.ndarray:
    """One picture of rows of pictures, reduced in size."""
    height, width = pictures[0][0].shape[:2]
    size = _SHEET_PX, round(_SHEET_PX * height / width)
    return np.vstack([
        np.hstack([cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in row])
        for row in pictures
    ])  # fmt: skip


def main() -> None:
    """Make data/tank/, reports/tank/."""
    p: Settings = load("tank")
    choose_window()
    facts = load_facts(DATA / "clip" / FACTS_NAME)
    background, rate = load_picture(EXTRACT / "background.png"), facts.frame_rate_hz
    with opened(p) as (fish, edit), whole_folder(OUT) as folder:
        heading, time = fish.poses.heading, edit["time_s"].to_numpy(float)
        depth, size = p.depth * fish.length_px, (p.width_px, p.height_px)
        room = Room(facts.width_px, facts.height_px, depth, fish.length_px, size[0] / size[1])
        names = (*PRESETS, p.camera)
        cameras = {name: views(name, room, fish.place, heading, rate) for name in names}
        with Scene(background, room, size) as scene:

            def picture(camera: str, tick: int) -> np.ndarray:
                return scene.frame(*fish.at(tick), cameras[camera], tick, time[tick])

            save_picture(folder / "still.png", picture(FOLLOW, fish.bent()))
            moments = np.linspace(0, len(fish) - 1, 2 * MOMENTS + 1).astype(int)[1::2]
            rows = [[picture(name, int(tick)) for tick in moments] for name in PRESETS]
            with (
                progress("tank", len(fish)) as advance,
                Mp4Writer(folder / "tank.mp4", (*size[::-1], 3), facts.frame_rate, p.crf) as film,
            ):
                for tick in range(len(fish)):
                    film.write(picture(p.camera, tick))
                    advance()
        shape = shapes(fish.points(), heading)
        glb = tank_glb(room, background, fish.typical_skin(), shape, fish.place, heading, rate)
        save_bytes(folder / "tank.glb", glb)
        way = [upright((place - room.middle) / room.length) for place in fish.place]
        save_viewer(folder / "tank.html", glb, "A filmed fish in its tank", ALT, way, rate)
    save_picture(REPORT / "contact_sheet.png", sheet(rows))
    numbers = {
        "frames": len(fish), "duration_s": len(fish) / rate, "gltf_shapes": len(shape.modes),
        "gltf_error_px": shape.error_px,
        "gltf_error_pct_of_length": 100 * shape.error_px / fish.length_px,
    }  # fmt: skip
    save_metrics(REPORT / "metrics.json", numbers)


if __name__ == "__main__":
    run(main)
