"""Speed of the tank in three dimensions, drawn in software at 1280×720, frame by frame.

`python -m benchmarks.tank`, in a folder with the results of the pipeline, prints the table and
writes benchmarks/tank.csv: frames per second of each camera, including all work of a frame (shape,
skin, light, drawing, reading the picture back), and of the film with its encoder.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.pipeline import write_table
from finloop.io.movie import Mp4Writer
from finloop.project import Project
from finloop.tank.camera import PRESETS, TOUR, TankSize, camera_views
from finloop.tank.scene import TankScene, select_offscreen_renderer
from stages.settings import load_settings
from stages.tank import animated_fish

SIZE, TICKS, ROUNDS, LEAST_HZ = (1280, 720), 60, 5, 30


def main() -> None:
    """Time the drawing of the tank by camera; print and write the table."""
    select_offscreen_renderer()
    p, rows = load_settings("tank"), []
    with Project() as project:
        facts, background = project.facts, project.background
        animated, times = animated_fish(p, project)
        fish = animated[0]
        depth, aspect = p.water_depth_bl * fish.length_px, SIZE[0] / SIZE[1]
        tank = TankSize(facts.width_px, facts.height_px, depth, fish.length_px, aspect)
        count = min(TICKS, len(fish))
        with TankScene(background, tank, SIZE) as scene:

            def show(camera: str, writer: Mp4Writer | None = None) -> np.ndarray:
                view = camera_views(
                    camera, tank, fish.place, fish.poses.heading, facts.frame_rate_hz
                )
                frame_times = []
                for tick in range(count):
                    start, worked = time.perf_counter(), time.process_time()
                    frame = scene.draw_frame(
                        [fish.surface_and_skin_at(tick)], view, tick, times[tick]
                    )
                    if writer is not None:
                        writer.write(frame)
                    frame_times.append((time.perf_counter() - start, time.process_time() - worked))
                return np.array(frame_times)

            for camera in (*PRESETS, TOUR):
                show(camera)
                frame_times = np.concatenate([show(camera) for _ in range(ROUNDS)])
                rows.append((camera, *frame_rates(frame_times)))
            with tempfile.TemporaryDirectory() as name:
                path = Path(name) / "tank.mp4"
                with Mp4Writer(path, (*SIZE[::-1], 3), facts.frame_rate, p.crf) as writer:
                    rows.append((f"{TOUR}, written as H.264", *frame_rates(show(TOUR, writer))))
    columns = ["camera", "frames_per_s", "quarter_fastest_frames_per_s", "p99_ms", "cpu_ms"]
    table = pd.DataFrame(rows, columns=columns).round(1)
    write_table(__file__, table)
    print(f"wanted: {LEAST_HZ} frames/s; {fish.skins.skin.cache_info().misses} skins made")


def frame_rates(frame_times: np.ndarray) -> tuple[float, ...]:
    """Return frames per second (median, and of the fastest quarter), ms at percentile 99, work.

    Work is the processor time of a frame on all cores, ms: other programs do not count.
    frame_times (n, 2): wall time and processor time of each frame, s.
    """
    wall, work = frame_times.T
    median_s, quarter_s, slow_s = np.quantile(wall, (0.5, 0.25, 0.99))
    return 1 / median_s, 1 / quarter_s, 1000 * slow_s, 1000 * np.median(work)


if __name__ == "__main__":
    main()
