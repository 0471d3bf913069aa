"""Write the tracks and cut-outs of a clip's fish (fish paper §2.1-2.2.1).

It connects the package `extract` to files, for the stage `extract` and the library's verb `track`.
"""

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import UndecodableError
from finloop.base.parallel import Threads, Workers, ordered_map
from finloop.extract import film
from finloop.extract.background import Scene
from finloop.extract.given import ExternalTrackLinker
from finloop.extract.grain import choose_spans, empty_tank_pictures
from finloop.extract.load_given import (
    check_external_tracks,
    load_external_tracks,
    save_external_tracks,
)
from finloop.extract.samples import TypicalFish, Verdict, measure_scene_and_fish
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.extract.verdict import (
    LightFacts,
    measure_area_jumps,
    measure_area_range,
    summarize_light,
)
from finloop.io.atomic import require_free_space
from finloop.io.checkpoints import Checkpoints, pack_result
from finloop.io.cutouts import compressed_size, tracks_writer
from finloop.io.movie import VideoWriter
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import save_record
from finloop.io.table import arrow_table
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    GRAIN_NAME,
    KEY_FRAME_EVERY,
    THREADS,
    VideoFacts,
    load_facts,
    load_mask,
    read_chosen_frames,
    read_frames,
    require_frame_count,
)

SCENE_NAME, BACKGROUND_NAME = "scene.json", "background.png"
_LOOKED_AT = 8  # most frames from which the space on the disk is estimated


class Extraction(NamedTuple):
    """What extraction found in a clip: scene facts, verdict counts, and lengths of tracks.

    lengths: frames by track. area_jumps_pct, area_range: see `measure_area_jumps`,
    `measure_area_range`. given: outcomes of another program's places; empty without such tracks.
    lost: numbers of the frames that could not be decoded. light: see `LightFacts`.
    """

    scene: SceneFacts
    verdicts: Counter[Verdict]
    lengths: Counter[int]
    area_jumps_pct: float
    area_range: float
    given: dict[str, float]
    lost: list[int]
    light: LightFacts


def extract_tracks(
    clip: Path, p: ExtractSettings, folder: Path, workers: Workers,
    advance: Callable[[], None] = lambda: None, checkpoints: Checkpoints | None = None,
) -> Extraction:  # fmt: skip
    """Write tracks, cut-outs, scene and background of a clip to a folder; return a summary.

    clip: the folder of the clip. Each of `workers` decodes and measures its own stretches;
    `advance()` is called after each frame. A frame that cannot be decoded counts as one without
    fish. `checkpoints` stores the detections of stretches. FinloopError if the clip cannot be read,
    the disk has too little space, or no fish can be followed.
    """
    facts = load_facts(clip / FACTS_NAME)
    external_tracks = load_external_tracks(clip, facts, p) if p.tracks_path else None
    scene, detector, sample = _measure_clip(clip, facts, p)
    typical = detector.typical
    _refuse_small_disk(folder, facts.frames, sample, checkpoints)
    linker, agreement = None, None
    if external_tracks:
        agreement = check_external_tracks(external_tracks, clip, facts, scene, detector)
        linker = ExternalTrackLinker(external_tracks, typical.length_px, p.min_track_frames)
    stream = _open_stream(clip, facts, checkpoints)
    cuts = [start for start, _ in facts.segments[1:]]
    verdicts, lengths, lost = Counter[Verdict](), Counter[int](), list[int]()
    track_ids, frames, areas = array("i"), array("i"), array("f")  # of every fish in every frame
    light = array("d")  # of every frame

    def note_light(detections: Iterable[film.Detections]) -> Iterator[film.Detections]:
        """Yield the detections of every frame, and keep its light."""
        for detected in detections:
            light.append(detected.light)
            yield detected

    def track_frames() -> Iterator[list[film.TrackedFish]]:
        """Yield the fish of long tracks, frame by frame, and count what the summary needs."""
        found = film.detect_in_clip(stream, scene, detector, workers)
        detections = note_light(film.fill_lost_frames(found, lost))
        tracked = (
            linker.link_frames(detections, cuts)
            if linker
            else film.link_tracks(detections, typical, p, cuts)
        )
        for frame_verdicts, fish in tracked:
            verdicts.update(frame_verdicts)
            lengths.update(f.track_id for f in fish)
            track_ids.extend(f.track_id for f in fish)
            frames.extend(f.frame for f in fish)
            areas.extend(f.fish.area_px for f in fish)
            advance()
            yield fish

    with tracks_writer(folder, tracks_schema(p.points)) as write:
        for fish in film.batch_fish(track_frames()):
            write(film.track_table_rows(fish), film.fish_cutouts(fish))
    if not lengths:
        raise linker.no_track_error() if linker else film.no_track_error(p, verdicts)
    scene_facts = _scene_facts(scene, typical, p.points)
    save_record(folder / SCENE_NAME, scene_facts)
    save_picture(folder / BACKGROUND_NAME, scene.background)
    external_metrics = {}
    if external_tracks and linker and agreement:
        save_external_tracks(folder, external_tracks, p.points)
        external_metrics = linker.metrics(agreement)
    track, frame, area_px = map(np.array, (track_ids, frames, areas))
    jumps_pct = measure_area_jumps(track, frame, area_px)
    area_range = measure_area_range(track, area_px)
    light_facts = summarize_light(np.delete(np.array(light), lost))
    return Extraction(
        scene_facts, verdicts, lengths, jumps_pct, area_range, external_metrics, lost, light_facts
    )


def save_tank_pictures(clip: Path, folder: Path, scene: SceneFacts) -> tuple[float, str]:
    """Write pictures of the empty tank, from which an animation's tank gets the film's grain.

    Return the grain, grey levels, and "". If the film shows none there is no file, the grain is 0,
    and the text says why: the animation's tank stands still. clip: folder of the film's clip.
    folder: where `extract_tracks` has written its files. scene: facts that it found.
    """
    facts, background = load_facts(clip / FACTS_NAME), load_picture(folder / BACKGROUND_NAME)
    lack = "the film is too short, or its frames are too large"
    for start, stop in choose_spans(facts.segments, background.shape):
        frames = read_frames(clip / CLIP_NAME, colour=facts.colour, start=start, stop=stop)
        try:
            found = empty_tank_pictures(
                frames, background, scene.threshold_grey, scene.typical_length_px
            )
        except UndecodableError:
            lack = "too many frames of the film cannot be decoded"
            continue
        if not found.lack:
            coding = facts.width_px, facts.height_px, facts.frame_rate, facts.colour
            with VideoWriter(folder / GRAIN_NAME, *coding, crf=0) as writer:
                for picture in found.pictures:
                    writer.write(picture)
            return found.grain_grey, ""
        lack = found.lack
    return 0.0, lack


def _open_stream(clip: Path, facts: VideoFacts, checkpoints: Checkpoints | None) -> film.ClipStream:
    """Return how workers read the clip in a folder, and store their detections in `checkpoints`."""
    # One thread per worker: every core decodes its own stretch.
    read = partial(read_frames, clip / CLIP_NAME, colour=facts.colour, threads=1)
    store = checkpoints.load_or_make if checkpoints else None
    return film.ClipStream(read, facts.frames, facts.frame_rate_hz, KEY_FRAME_EVERY, store)


def _measure_clip(
    clip: Path, facts: VideoFacts, p: ExtractSettings
) -> tuple[Scene, film.Detector, list[film.Detections]]:
    """Return a clip's scene, the detector of its fish, and detections in sample frames.

    UndecodableError if no frame can be decoded, FinloopError if no fish is found.
    """
    mask = load_mask(clip / ARENA_NAME, facts.width_px, facts.height_px)
    arena = mask.astype(np.uint8) * 255
    frames = load_sample_frames(clip / CLIP_NAME, facts, p.samples)
    scene, typical = measure_scene_and_fish(frames, arena, p, Threads(THREADS))
    detector = film.Detector(arena, typical, p)
    every = math.ceil(len(frames) / _LOOKED_AT)
    return scene, detector, [detector(frame, scene) for frame in frames[::every]]


def _scene_facts(scene: Scene, typical: TypicalFish, points: int) -> SceneFacts:
    """Return the facts about scene and typical fish that later stages need."""
    return SceneFacts(
        polarity=scene.polarity, noise_grey=scene.noise, threshold_grey=scene.threshold,
        typical_area_px=typical.area_px, typical_length_px=typical.length_px,
        typical_contrast_grey=typical.contrast, fins=typical.fins, points=points,
        thin=typical.thin, typical_edge_px=typical.edge_px, limbs=typical.limbs,
    )  # fmt: skip


def describe_lost_frames(lost: Sequence[int], facts: VideoFacts) -> str:
    """Return a sentence that names the frames (`lost`, ascending) that cannot be decoded."""
    runs = np.split(np.array(lost), np.flatnonzero(np.diff(lost) > 1) + 1)
    named = ", ".join(f"{run[0]}-{run[-1]} ({run[0] / facts.frame_rate_hz:.2f} s)" for run in runs)
    return f"{len(lost)} of {facts.frames} frames cannot be decoded, and are left out: {named}"


def load_sample_frames(path: Path, facts: VideoFacts, most_samples: int) -> list[Picture]:
    """Return at most `most_samples` decodable frames (h, w[, 3]), spread over a clip.

    UndecodableError if none can be decoded.
    """
    require_frame_count(path, facts.frames)
    shape = (facts.height_px, facts.width_px, 3 if facts.colour else 1)
    numbers = film.choose_sample_frames(most_samples, facts.frames, shape, KEY_FRAME_EVERY)
    # One thread per decoder: several threads would decode frames after a key frame in vain.
    read = partial(read_chosen_frames, path, colour=facts.colour, threads=1)
    parts = [part.tolist() for part in np.array_split(numbers, THREADS)]
    try:
        pieces = ordered_map(lambda part: list(read(part)), parts, Threads(THREADS))
        return [frame for piece in pieces for frame in piece]
    except UndecodableError:  # read one by one, only the damaged frames are lost
        frames: list[Picture] = []
        for number in numbers:
            with suppress(UndecodableError):
                frames += read([number])
        if not frames:
            raise
        return frames


def _refuse_small_disk(
    folder: Path, frames: int, sample: Sequence[film.Detections], checkpoints: Checkpoints | None
) -> None:
    """Raise FinloopError if the disk has too little space for the results of a film.

    frames: length of the film; sample: detections in some of its frames. While rows are put in
    order, table and cut-outs (pixels of fish with alpha) exist twice, beside the checkpoints.
    """
    isolated = [found for detections in sample for found in detections.fish if found is not None]
    fish = [film.TrackedFish(0, number, found) for number, found in enumerate(isolated)]
    size_bytes = 0.0
    if fish:
        table = arrow_table(
            film.track_table_rows(fish), tracks_schema(len(fish[0].fish.backbone.points_px)), ""
        )
        size_bytes = 2 * (table.nbytes + sum(map(compressed_size, film.fish_cutouts(fish))))
    stored_bytes = 0
    if checkpoints is not None:
        size_bytes += len(pack_result(list(sample)))
        stored_bytes = checkpoints.stored_bytes()
    wanted_bytes = size_bytes / len(sample) * frames - stored_bytes
    require_free_space(
        folder, wanted_bytes, f"the results of {frames} frames", "take a shorter film"
    )
