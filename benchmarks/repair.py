"""Check and repair of a minute of 1080p that flickers and shakes, compared with decoding it.

`python -m benchmarks.repair` draws the film, makes its clip, and writes benchmarks/repair.csv with
the processor time of each part. Coding the clip is no part. The film has 10 seconds; what is done
for each frame counts six times, what is done for a sample of the film once.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import functools
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import av
import cv2
import numpy as np
import pandas as pd

from benchmarks.pipeline import write_table
from benchmarks.speed import decode_film
from finloop.base.arrays import Picture
from finloop.base.settings import settings
from finloop.clip import check, rewrite
from finloop.clip.write import open_clip_source
from finloop.io.footage import open_footage
from finloop.io.footage.source import LostFrames

WIDTH, HEIGHT, RATE = 1920, 1080, 30
DRAWN, TIMES = 150, 2  # frames that are drawn; how often the film repeats them
MINUTE = 60 * RATE  # frames
PARTS = {
    "undoing light and shake": (rewrite._FrameCorrector, "correct_frame"),
    "checking each frame": (check.ClipTally, "add_frame"),
    "empty tank": (check, "_empty_tank"),
    "frames that are examined": (check, "_examine_frames"),
    "reading the sample": (rewrite._FilmSample, "read_stretches"),
}
"""Class or module, and name, of each function that is timed; the first two run for each frame."""
PER_FRAME = list(PARTS)[:2]


def draw_frames() -> Iterator[Picture]:
    """Yield RGB frames of a marked tank: light flickers by 4 %, the camera shakes by 2 px."""
    rng = np.random.default_rng(0)
    grain = rng.integers(0, 256, (HEIGHT + 20, WIDTH + 20, 3), np.uint8)
    tank = cv2.normalize(cv2.GaussianBlur(grain, (0, 0), 3), None, 60, 200, cv2.NORM_MINMAX)
    noise = [rng.normal(0, 2, (HEIGHT, WIDTH, 1)) for _ in range(5)]
    for k in range(DRAWN):
        x, y = rng.uniform(5, 9, 2)
        moved = cv2.warpAffine(tank, np.array([[1, 0, -x], [0, 1, -y]]), (WIDTH, HEIGHT))
        frame = moved * (1 + 0.04 * np.sin(1.7 * k)) + noise[k % 5]
        cv2.ellipse(frame, (300 + 8 * k, 500), (90, 25), 0, 0, 360, (30, 30, 30), -1)
        yield np.clip(frame, 0, 255).astype(np.uint8)


def write_film(path: Path) -> None:
    """Write the drawn frames, repeated `TIMES` times, as H.264 like that of a camera."""
    with av.open(str(path), "w") as film:
        stream = film.add_stream("libx264", rate=RATE, options={"preset": "superfast", "crf": "20"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        frames = list(draw_frames())
        for _ in range(TIMES):
            for frame in frames:
                film.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        film.mux(stream.encode(None))


@contextmanager
def time_parts() -> Iterator[tuple[dict[str, float], dict[str, int]]]:
    """Yield the processor seconds and the calls of each of `PARTS`, which grow in the block."""
    seconds, calls = defaultdict[str, float](float), defaultdict[str, int](int)

    def add_timer(part: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that does the work and counts its time."""

        @functools.wraps(work)
        def run(*args: Any, **options: Any) -> Any:
            start = time.thread_time()
            try:
                return work(*args, **options)
            finally:
                seconds[part] += time.thread_time() - start
                calls[part] += 1

        return run

    with ExitStack() as stack:
        for part, (home, name) in PARTS.items():
            stack.enter_context(patch.object(home, name, add_timer(part, getattr(home, name))))
        yield seconds, calls


def processor_time(work: Callable[[], Any]) -> float:
    """Return the processor seconds that some work takes, in all threads."""
    start = time.process_time()
    work()
    return time.process_time() - start


def main() -> None:
    """Time decoding, check and repair; print and write the table."""
    frames = DRAWN * TIMES
    with tempfile.TemporaryDirectory() as scratch:
        film = Path(scratch) / "film.mp4"
        write_film(film)
        p = settings("clip", source="file", path=str(film))
        frame = next(draw_frames())  # loads the compiled kernels
        rewrite._FrameCorrector(frame, light=True, place=True).correct_frame(frame)
        with time_parts() as (seconds, calls):
            result = rewrite.make_clip(p, open_clip_source(p), Path(scratch))
        assert result.mended == {"even_light", "steady"}, result.mended
        decoding = min(processor_time(lambda: decode_film(film)) for _ in range(3))
        to_rgb = processor_time(
            lambda: list(map(id, open_footage(film).stream_numbered(LostFrames())))
        )
    minute = {"decoding": decoding * MINUTE / frames, "decoding to RGB": to_rgb * MINUTE / frames}
    for part, duration in seconds.items():
        # Beside the film's frames, a function of each frame has run for those of the sample.
        in_minute = calls[part] + MINUTE - frames if part in PER_FRAME else calls[part]
        minute[part] = duration / calls[part] * in_minute
    minute["check and repair"] = sum(minute[part] for part in PARTS)
    table = pd.DataFrame({"what": list(minute), "s_per_minute": list(minute.values())})
    table["times_decoding"] = table["s_per_minute"] / minute["decoding"]
    write_table(__file__, table.round(2))


if __name__ == "__main__":
    main()
