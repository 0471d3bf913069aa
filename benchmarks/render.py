"""Speed of drawing at 1280×720 RGB, against the copy of one frame through memory in the same run.

`python -m benchmarks.render` prints the table and writes benchmarks/render.csv. A frame is done
when the canvas holds all of it. The fish is a drawn carp, at any angle and any subpixel place.
Drawing takes one core; its seconds are of processor time, so other programs do not slow it down.
The file encoders are measured last, on their own, by the clock.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.pipeline import prepare_folder, run_stage, write_table
from benchmarks.speed import time_call, time_pairs
from finloop.base.settings import settings
from finloop.edit.bodies import Bodies
from finloop.edit.schema import FRAME, Goal
from finloop.features.table import USED, measure_features
from finloop.io.movie import FilmWriter, Mp4Writer, WebpWriter
from finloop.io.video import THREADS
from finloop.pose import compute_film_poses
from finloop.project import Project
from finloop.render.gallery import CutoutSet, Gallery
from finloop.render.living import LivingTank
from finloop.render.marks import MarkPainter
from finloop.render.painter import Painter, PlacedFish

SIZE = ["clip.width_px=1280", "clip.height_px=720", "clip.frames=100"]
TICKS, RATE = 300, Fraction(25)
LEAST_HZ = {"one fish": 1000, "eight fish": 300}  # over the living tank


def swim_in_circle(
    gallery: Gallery, bodies: Bodies, fades: bool = False, seed: int = 0, bends: bool = False
) -> list[PlacedFish]:
    """Return a fish on a wide circle, cross-faded with a partner or in the partner's posture."""
    rng = np.random.default_rng(seed)
    start, rotation = rng.uniform(0, 2 * np.pi, 2)
    angle = start + 0.01 * np.arange(TICKS)
    row, partner = (np.arange(TICKS) + first for first in (0, 9))
    count = len(bodies.poses.codes)
    codes = bodies.poses.codes[partner % count]
    edit = pd.DataFrame({
        "x_px": 640 + 300 * np.cos(angle), "y_px": 360 - 200 * np.sin(angle), "kind": FRAME,
        "source": row % count, "orientation": 0, "rotation_deg": np.degrees(rotation + angle),
        "scale": 1.02, "mirrored": False, "weight": 0.4 * fades, "partner_kind": FRAME,
        "partner": partner % count, "partner_orientation": 0,
        "partner_rotation_deg": np.degrees(rotation + angle), "partner_scale": 1.02,
        "partner_mirrored": False, "pose": pd.Series(list(codes) if bends else None, range(TICKS)),
    })  # fmt: skip
    return [gallery.place_fish(tick) for tick in edit.replace({np.nan: None}).itertuples()]


def edit_columns(placed_fish: list[PlacedFish]) -> pd.DataFrame:
    """Return the columns of the edit list that `MarkPainter` reads."""
    states = ["straight", "turn", "slide", "accelerate", "decelerate"]
    return pd.DataFrame(
        {
            "fish": 0,
            "x_px": [fish.x_px for fish in placed_fish],
            "y_px": [fish.y_px for fish in placed_fish],
            "time_s": np.arange(TICKS) / float(RATE),
            "mode": "network",
            "kind": "sprite",
            "mirrored": False,
            "pose": None,
            "state": [states[tick // 20 % len(states)] for tick in range(TICKS)],
            "goal": ["AB"[tick // 100 % 2] for tick in range(TICKS)],
        }
    )


def ways_to_draw(
    background: np.ndarray, gallery: Gallery, bodies: Bodies
) -> dict[str, Callable[[], None]]:
    """Return functions that draw all ticks, by name."""
    school = [swim_in_circle(gallery, bodies, seed=seed) for seed in range(8)]
    cross_faded_and_bent = [swim_in_circle(gallery, bodies, True, seed, True) for seed in range(8)]
    fading = swim_in_circle(gallery, bodies, fades=True)
    bent = swim_in_circle(gallery, bodies, bends=True)
    rng = np.random.default_rng(0)
    pictures = [rng.integers(0, 256, background.shape, np.uint8) for _ in range(24)]
    light = 1 + 0.02 * np.sin(np.arange(TICKS))
    still, living = Painter(background), Painter(background, tank=LivingTank(pictures))
    lit = Painter(background, tank=LivingTank(pictures, light))

    def draw(fish: list[list[PlacedFish]], painter: Painter = still) -> None:
        for tick, all_fish in enumerate(zip(*fish, strict=True)):
            painter.show(*all_fish, tick=tick)

    def render_with_marks() -> None:
        with_marks = Painter(background, colour=True)
        marks = MarkPainter(
            with_marks, edit_columns(school[0]), [Goal("A", 300.0, 200.0), Goal("B", 900.0, 500.0)]
        )
        for tick, placed in enumerate(school[0]):
            marks.show(tick, placed)

    return {
        "one fish": lambda: draw(school[:1]),
        "one fish, cross-faded": lambda: draw([fading]),
        "one fish, in another pose": lambda: draw([bent]),
        "one fish, joined": lambda: draw(cross_faded_and_bent[:1]),
        "one fish, living tank": lambda: draw(school[:1], living),
        "one fish, living tank in the film's light": lambda: draw(school[:1], lit),
        "one fish, with marks": render_with_marks,
        "eight fish": lambda: draw(school),
        "eight fish, living tank": lambda: draw(school, living),
        "eight fish, living tank in the film's light": lambda: draw(school, lit),
        "eight fish, all joined": lambda: draw(cross_faded_and_bent),
    }


def print_encoder_speeds(
    background: np.ndarray, placed_fish: list[PlacedFish], folder: Path
) -> None:
    """Print how many frames per second the encoders write."""
    painter, frames = Painter(background), []
    for placed in placed_fish[:100]:
        painter.show(placed)
        frames.append(painter.frame.copy())

    def write(writer: FilmWriter) -> None:
        with writer:
            for frame in frames:
                writer.write(frame)

    shape = frames[0].shape
    for name, writer in (
        ("mp4", Mp4Writer(folder / "a.mp4", shape, RATE, 20)),
        ("webp, 480 px wide", WebpWriter(folder / "a.webp", shape, RATE, 480, 75)),
    ):
        print(f"{name}: {len(frames) / time_call(partial(write, writer))[0]:.0f} frames/s")


def main() -> None:
    """Time drawing and encoding; print and write the table."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare_folder(folder, ["clip=carp", *SIZE])
        for stage in ("clip", "extract"):
            run_stage(folder, stage)
        frame, copy = np.zeros((720, 1280, 3), np.uint8), np.zeros((720, 1280, 3), np.uint8)
        with Project(folder) as project:
            background, tracks = project.background, project.tracks(USED)
            table, _ = measure_features(tracks, float(RATE), settings("features"))
            poses = compute_film_poses(tracks, table, settings("pose"))
            bodies = Bodies(poses, np.zeros(len(table), bool), pd.DataFrame())
            cutout_set = CutoutSet(project.cutouts, tracks[["x_px", "y_px"]].to_numpy())
            gallery = Gallery({FRAME: cutout_set}, bodies)

            def copies() -> None:
                for _ in range(TICKS):
                    np.copyto(copy, frame)

            for name_of_way, draw_all in ways_to_draw(background, gallery, bodies).items():
                drawing_s, copying_s, ratio, _ = time_pairs(
                    draw_all, copies, clock=time.process_time
                )
                rows.append((name_of_way, TICKS / drawing_s, TICKS / copying_s, ratio))
            print_encoder_speeds(background, swim_in_circle(gallery, bodies), folder)
    columns = ["drawn", "frames_per_s", "copies_per_s", "time_ratio"]
    table = pd.DataFrame(rows, columns=columns).round(
        {"frames_per_s": 0, "copies_per_s": 0, "time_ratio": 2}
    )
    write_table(__file__, table)
    print(f"wanted over a living tank, frames/s: {LEAST_HZ}; {THREADS} threads")


if __name__ == "__main__":
    main()
