"""Stage `extract`: the normalised clip becomes background, tracks, backbones, cut-outs."""

from stages.run import THREADS, progress, run, save_metrics  # isort: skip  (before numpy)

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import get_args

import cv2
import numpy as np

from finloop.base.parallel import warm_up
from finloop.extract import film
from finloop.extract.samples import Verdict, survey
from finloop.extract.settings import Settings
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io import video
from finloop.io.atomic import whole_folder
from finloop.io.film_writer import film_writer
from finloop.io.picture import save_picture
from finloop.io.record import save_record
from stages.settings import load

CLIP, EXTRACT, REPORT = Path("data/clip"), Path("data/extract"), Path("reports/extract")
LONG = 60  # frames of a long track
WORKERS_NEED = ["finloop.extract.film", "finloop.io.video"]  # imported once, for all workers


def main() -> None:
    """Make data/extract/ and reports/extract/metrics.json."""
    settings: Settings = load("extract")
    if THREADS > 1:
        warm_up(WORKERS_NEED)
    facts = video.load_facts(CLIP / video.FACTS_NAME)
    mask = video.load_mask(CLIP / video.ARENA_NAME, facts.width_px, facts.height_px)
    arena = mask.astype(np.uint8) * 255
    shape = (facts.height_px, facts.width_px, 3 if facts.colour else 1)
    sample = film.sample_frames(settings.samples, facts.frames, shape, video.KEY_FRAME_EVERY)
    frames = list(video.read_spread(CLIP / video.CLIP_NAME, sample, colour=facts.colour))
    scene, typical = survey(frames, arena, settings)
    # One thread each: every core decodes its own stretch.
    read = partial(video.read_frames, CLIP / video.CLIP_NAME, colour=facts.colour, threads=1)
    clip = film.Film(read, facts.frames, facts.frame_rate_hz, video.KEY_FRAME_EVERY)
    detector = film.Detector(arena, typical, settings)
    cuts = [start for start, _ in facts.segments[1:]]
    tally: Counter[Verdict] = Counter()
    lengths: Counter[int] = Counter()

    def linked() -> Iterator[list[film.TrackedFish]]:
        seen = film.detections(clip, scene, detector, THREADS)
        for verdicts, fish in film.tracks(seen, typical, settings, cuts):
            tally.update(verdicts)
            lengths.update(f.track_id for f in fish)
            advance()
            yield fish

    with whole_folder(EXTRACT) as folder:
        with (
            progress("extract", facts.frames) as advance,
            film_writer(folder, tracks_schema(settings.points)) as write,
        ):
            for fish in film.batches(linked()):
                write(film.rows(fish), film.cutouts(fish))
        if not lengths:
            raise film.nothing_followed(settings, tally)
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
        **{name: value for name, value in asdict(tank).items() if name.endswith(("_grey", "_px"))},
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
