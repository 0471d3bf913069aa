"""Speed of `extract` + `features`, each as a ratio against a named limit or peer in the same run.

`python -m benchmarks.speed` prints the table and writes benchmarks/speed.csv. Every pair runs in
turn, A B A B …, and the table has the median of the pairwise ratios, which a drifting machine
speed does not affect. On zebrafish A, files are read and written as the stages do, without pictures
and the start of Python. On a film ten times as long the two stages run as commands, from start to
end.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import av
import cv2
import numpy as np
import pandas as pd
from skan import Skeleton, summarize
from skimage.graph import route_through_array
from skimage.morphology import skeletonize

from benchmarks.pipeline import prepare_folder, run_stage, write_table
from finloop.base.parallel import Processes, Threads, start_fork_server
from finloop.base.settings import settings
from finloop.drawn.carp.film import film_frames
from finloop.extract.backbone import trace_backbone
from finloop.extract.film import (
    ClipStream,
    Detector,
    batch_fish,
    detect_in_clip,
    fill_lost_frames,
    fish_cutouts,
    link_tracks,
    track_table_rows,
)
from finloop.extract.samples import measure_scene_and_fish
from finloop.extract.segment import SilhouetteEdge, find_silhouettes
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import tracks_schema
from finloop.extract.write import load_sample_frames
from finloop.features.table import FEATURES, FeaturesSettings, measure_features
from finloop.io.cutouts import tracks_writer
from finloop.io.movie import VideoWriter
from finloop.io.table import load_table, save_table
from finloop.io.video import KEY_FRAME_EVERY, load_facts, read_frames, save_facts
from finloop.io.wheel import fetch_zebrafish_clips, find_cache_folder
from stages.extract import WORKERS_NEED
from stages.run import THREADS

PAIRS, LONG_PAIRS = 5, 3
TIMES = 10  # length of the long film / zebrafish A


def time_call(
    work: Callable[[], Any], clock: Callable[[], float] = time.perf_counter
) -> tuple[float, Any]:
    """Return the seconds that `work` takes by a clock, and its result."""
    start = clock()
    result = work()
    return clock() - start, result


def time_pairs(
    ours: Callable[[], Any], theirs: Callable[[], Any], pairs: int = PAIRS,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[float, float, float, Any]:  # fmt: skip
    """Return the median seconds of both, the median ratio ours / theirs, and our result."""
    ours(), theirs()
    times = []
    for _ in range(pairs):
        our_s, result = time_call(ours, clock)
        times.append((our_s, time_call(theirs, clock)[0]))
    return (
        median(our for our, _ in times),
        median(their for _, their in times),
        median(our / their for our, their in times),
        result,
    )


def decode_film(path: Path) -> int:
    """Decode a film to grey frames, with as many threads as the stages use."""
    count = 0
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        stream.thread_type = "AUTO"
        stream.codec_context.thread_count = THREADS
        for frame in container.decode(stream):
            np.frombuffer(memoryview(frame.planes[0]), np.uint8)
            count += 1
    return count


def extract_and_features(clip: Path, out: Path, p: ExtractSettings, q: FeaturesSettings) -> int:
    """Run the work of both stages without pictures; return the number of fish-frames."""
    facts = load_facts(clip / "facts.json")
    arena = np.full((facts.height_px, facts.width_px), 255, np.uint8)
    frames = load_sample_frames(clip / "clip.mp4", facts, p.samples)
    scene, typical = measure_scene_and_fish(frames, arena, p, Threads(THREADS))
    read = partial(read_frames, clip / "clip.mp4", colour=facts.colour, threads=1)
    detector = Detector(arena, typical, p)
    whole = ClipStream(read, facts.frames, facts.frame_rate_hz, KEY_FRAME_EVERY)
    found = detect_in_clip(whole, scene, detector, Processes(THREADS))
    cuts = [start for start, _ in facts.segments[1:]]
    linked = link_tracks(fill_lost_frames(found, []), typical, p, cuts)
    with tracks_writer(out, tracks_schema(p.points)) as write:
        for lot in batch_fish(fish_of_frame for _, fish_of_frame in linked):
            write(track_table_rows(lot), fish_cutouts(lot))
    table = load_table(out / "tracks.parquet", tracks_schema(p.points))
    measured, _ = measure_features(table, facts.frame_rate_hz, q)
    save_table(out / "features.parquet", measured, FEATURES)
    return len(measured)


def lengthen_clip(folder: Path) -> None:
    """Make the clip in a folder `TIMES` as long by repeating it."""
    clip = folder / "data/clip"
    facts = load_facts(clip / "facts.json")
    segments = [(k * facts.frames, (k + 1) * facts.frames) for k in range(TIMES)]
    longer = replace(facts, frames=TIMES * facts.frames, segments=tuple(segments))
    with VideoWriter.from_facts(clip / "long.mp4", longer) as writer:
        for _ in range(TIMES):
            for frame in read_frames(clip / "clip.mp4"):
                writer.write(frame)
    (clip / "long.mp4").replace(clip / "clip.mp4")
    save_facts(clip / "facts.json", longer)


def run_both_stages(folder: Path) -> int:
    """Run the stages `extract` and `features`; return the number of fish-frames."""
    fish = run_stage(folder, "extract")["fish_frames"]
    run_stage(folder, "features")
    return int(fish)


def carp_masks(count: int, p: ExtractSettings) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return masks and difference images of the drawn carp, default size, in `count` frames."""
    film = film_frames(settings("clip", source="carp", frames=count, colour=False))
    frames = [frame for frame, _ in film]
    arena = np.full(frames[0].shape, 255, np.uint8)
    scene, _ = measure_scene_and_fish(frames[:: max(1, count // 41)], arena, p)
    edge = SilhouetteEdge(p.outline_contrast_ratio, p.shadow, "all")
    return [
        (silhouette.mask, silhouette.field)
        for frame in frames
        for silhouette in find_silhouettes(frame, scene, arena, 200, edge)
    ]


def skan_length(masks: list[np.ndarray]) -> float:
    """Return the total length of the longest branches, by the peer skan."""
    return sum(
        float(summarize(Skeleton(skeletonize(mask)), separator="-")["branch-distance"].max())
        for mask in masks
    )


def skimage_length(masks: list[np.ndarray]) -> int:
    """Return the total length of the longest skeleton paths, by the peer scikit-image."""
    total = 0
    for mask in masks:
        skeleton = skeletonize(mask)
        neighbours = cv2.filter2D(
            skeleton.astype(np.uint8), -1, np.ones((3, 3)), borderType=cv2.BORDER_CONSTANT
        )
        ends = np.argwhere(skeleton & (neighbours == 2))
        cost = np.where(skeleton, 1.0, 1e6)
        paths = [
            route_through_array(cost, first, last, geometric=True)
            for i, first in enumerate(ends)
            for last in ends[i + 1 :]
        ]
        total += len(max(paths, key=lambda path: path[1])[0]) if paths else 0
    return total


def main() -> None:
    """Time both stages and their peers; print and write the table."""
    results = []
    cv2.setNumThreads(1)
    start_fork_server(WORKERS_NEED)
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        prepare_folder(scratch, ["clip=zebrafish", "clip.parts=A"])
        p, q = settings("extract"), settings("features")
        run_stage(scratch, "clip")
        clip, source = scratch / "data/clip", fetch_zebrafish_clips("A", find_cache_folder())[0]
        for name, path in (("normalised clip", clip / "clip.mp4"), ("source file", source)):
            mine, theirs, ratio, fish = time_pairs(
                lambda: extract_and_features(clip, scratch, p, q), partial(decode_film, path)
            )
            print(f"zebrafish A: {fish} fish-frames, {fish / mine:.0f} fish/s")
            results.append((f"extract + features / only decoding the {name}", mine, theirs, ratio))
        lengthen_clip(scratch)
        long = partial(run_both_stages, scratch), partial(decode_film, clip / "clip.mp4")
        mine, theirs, ratio, fish = time_pairs(*long, LONG_PAIRS)
        print(f"{TIMES} times as long: {fish} fish-frames, {fish / mine:.0f} fish/s")
        results.append(("both stages as commands, of a film ten times as long / only decoding it",
                        mine, theirs, ratio))  # fmt: skip
        outlines = carp_masks(200, p)
        masks = [mask for mask, _ in outlines]
        for name, work in (
            ("skan.summarize", lambda: skan_length(masks)),
            ("scikit-image + longest path", lambda: skimage_length(masks)),
        ):
            mine, theirs, ratio, _ = time_pairs(
                lambda: [trace_backbone(m, f, p.points, 6.0) for m, f in outlines], work
            )
            print(
                f"backbones of a 110 px carp, one core: {len(masks) / mine:.0f}/s; "
                f"{name}: {len(masks) / theirs:.0f}/s"
            )
            results.append((f"backbones / {name}", mine, theirs, ratio))
    table = pd.DataFrame(results, columns=["what", "ours_s", "theirs_s", "ratio"]).round(4)
    write_table(__file__, table)
    print(f"{THREADS} threads")


if __name__ == "__main__":
    main()
