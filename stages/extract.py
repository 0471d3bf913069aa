"""Stage `extract`: the normalised clip becomes background, tracks, backbones, cut-outs."""

from stages.run import THREADS, progress, run, save_metrics  # isort: skip  (before numpy)

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from finloop.base.cutout import Cutout
from finloop.errors import FinloopError
from finloop.extract.background import Image, Scene, sample_size
from finloop.extract.film import (
    Detections,
    Detector,
    TrackedFish,
    Verdict,
    detect,
    follow,
    rows,
    survey,
    tracks,
)
from finloop.extract.settings import Settings
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io.atomic import whole_folder
from finloop.io.film_writer import film_writer
from finloop.io.picture import save_picture
from finloop.io.record import save_record
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    KEY_FRAME_EVERY,
    VideoFacts,
    load_facts,
    load_mask,
    read_frames,
    read_spread,
)
from finloop.parallel import warm_up
from stages.settings import load

CLIP, EXTRACT, REPORT = Path("data/clip"), Path("data/extract"), Path("reports/extract")
LONG = 60  # frames of a long track
WORKERS_NEED = ["finloop.extract.film", "finloop.io.video"]  # imported once, for all workers


def sample(facts: VideoFacts, samples: int, clip: Path = CLIP) -> list[Image]:
    """Frames spread evenly over the clip, key frames where it is long enough to choose."""
    shape = (facts.height_px, facts.width_px, 3 if facts.colour else 1)
    count = sample_size(samples, facts.frames, shape)
    numbers = np.linspace(0, facts.frames - 1, count).round().astype(int)
    if facts.frames >= count * KEY_FRAME_EVERY:
        numbers = numbers // KEY_FRAME_EVERY * KEY_FRAME_EVERY
    return list(read_spread(clip / CLIP_NAME, numbers.tolist(), colour=facts.colour))


def detections(facts: VideoFacts, scene: Scene, detector: Detector) -> Iterator[Detections]:
    """The detections of every frame, in order."""
    # One thread each: every core decodes its own stretch.
    read = partial(read_frames, CLIP / CLIP_NAME, colour=facts.colour, threads=1)
    if detector.settings.background == "mog2":  # a background depends on all frames before
        film = follow(read(start=0, stop=facts.frames), scene, facts.frame_rate_hz)
        return (detector(frame, tank) for frame, tank in film)
    return detect(read, facts.frames, scene, detector, THREADS, KEY_FRAME_EVERY)


def batches(fish: Iterable[list[TrackedFish]]) -> Iterator[list[TrackedFish]]:
    """The same fish in larger batches, which are quicker to write."""
    batch: list[TrackedFish] = []
    for some in fish:
        batch += some
        if len(batch) >= 512:
            yield batch
            batch = []
    yield batch


def cutouts(fish: Iterable[TrackedFish]) -> Iterator[Cutout]:
    """The cut-outs of the fish."""
    for f in fish:
        yield Cutout(f.track_id, f.frame, f.fish.x0, f.fish.y0, f.fish.cutout)


def main() -> None:
    """Make data/extract/ and reports/extract/metrics.json."""
    settings: Settings = load("extract")
    if THREADS > 1:
        warm_up(WORKERS_NEED)
    facts = load_facts(CLIP / FACTS_NAME)
    mask = load_mask(CLIP / ARENA_NAME, facts.width_px, facts.height_px)
    arena = mask.astype(np.uint8) * 255
    scene, typical = survey(sample(facts, settings.samples), arena, settings)
    detector = Detector(arena, typical, settings)
    cuts = [start for start, _ in facts.segments[1:]]
    tally: Counter[Verdict] = Counter()
    lengths: Counter[int] = Counter()

    def linked() -> Iterator[list[TrackedFish]]:
        for verdicts, fish in tracks(detections(facts, scene, detector), typical, settings, cuts):
            tally.update(verdicts)
            lengths.update(f.track_id for f in fish)
            advance()
            yield fish

    with whole_folder(EXTRACT) as folder:
        with (
            progress("extract", facts.frames) as advance,
            film_writer(folder, tracks_schema(settings.points)) as write,
        ):
            for fish in batches(linked()):
                write(rows(fish), cutouts(fish))
        if not lengths:
            counts = ", ".join(f"{count} {verdict}" for verdict, count in tally.items())
            raise FinloopError(
                f"no fish could be followed for {settings.least_frames} frames "
                f"(silhouettes: {counts})",
                "fish that swim by themselves, clear of the border",
                "allow shorter tracks (extract.least_frames), other sizes "
                "(extract.least_area_ratio, extract.most_area_ratio), or set clip.arena",
            )
        tank = SceneFacts(
            scene.polarity, scene.noise, scene.threshold, *typical, points=settings.points
        )
        save_record(folder / "scene.json", tank)
        save_picture(folder / "background.png", scene.background)
    save_metrics(REPORT / "metrics.json", metrics(facts.frames, tank, tally, lengths))


def metrics(
    frames: int, tank: SceneFacts, tally: Counter[Verdict], lengths: Counter[int]
) -> dict[str, float]:
    """Numbers on noise, the typical fish, verdicts and the lengths of tracks."""
    long = [count for count in lengths.values() if count >= LONG]
    return {
        "frames": frames,
        "noise_grey": tank.noise_grey,
        "threshold_grey": tank.threshold_grey,
        "typical_area_px": tank.typical_area_px,
        "typical_length_px": tank.typical_length_px,
        "typical_contrast_grey": tank.typical_contrast_grey,
        "silhouettes": tally.total(),
        **{f"silhouettes_{v.replace(' ', '_')}": tally[v] for v in get_args(Verdict)},
        "fish_frames": lengths.total(),
        "tracks": len(lengths),
        f"tracks_of_{LONG}_frames": len(long),
        f"fish_frames_in_tracks_of_{LONG}_frames": sum(long),
        "longest_track_frames": max(lengths.values()),
    }


if __name__ == "__main__":
    cv2.setNumThreads(1)  # the processes already use every core
    run(main)
