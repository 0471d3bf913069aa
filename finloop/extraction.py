"""A normalised clip as tracks and cut-outs of its fish (fish paper §2.1-2.2.1).

The door from the room `extract` to files: the stage `extract` and the library's verb `track` come
this way.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from finloop.base.parallel import Workers
from finloop.extract import film
from finloop.extract.given import Followed
from finloop.extract.samples import Verdict, survey
from finloop.extract.settings import Settings
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.given_tracks import check_given, given_metrics, load_given, save_given
from finloop.io.film_writer import film_writer
from finloop.io.picture import save_picture
from finloop.io.record import save_record
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    KEY_FRAME_EVERY,
    load_facts,
    load_mask,
    read_frames,
    read_spread,
)

SCENE_NAME, BACKGROUND_NAME = "scene.json", "background.png"


class Extraction(NamedTuple):
    """What was found in a clip: its scene, how silhouettes were judged, frames of each track.

    given: what became of the places in a file of tracks, see `given_metrics`; empty without one.
    """

    scene: SceneFacts
    verdicts: Counter[Verdict]
    lengths: Counter[int]
    given: dict[str, float]


def extract(
    clip: Path,
    p: Settings,
    folder: Path,
    workers: Workers,
    advance: Callable[[], None] = lambda: None,
) -> Extraction:
    """Write tracks, cut-outs, scene and background of a clip's folder to another folder.

    Each of `workers` decodes and measures its own stretches; `advance()` after each
    frame. FinloopError if the clip cannot be read, or no fish can be followed.
    """
    facts = load_facts(clip / FACTS_NAME)
    told = load_given(clip, facts, p) if p.tracks == "file" else None
    mask = load_mask(clip / ARENA_NAME, facts.width_px, facts.height_px)
    arena = mask.astype(np.uint8) * 255
    shape = (facts.height_px, facts.width_px, 3 if facts.colour else 1)
    sample = film.sample_frames(p.samples, facts.frames, shape, KEY_FRAME_EVERY)
    frames = list(read_spread(clip / CLIP_NAME, sample, colour=facts.colour))
    scene, typical = survey(frames, arena, p)
    # One thread each: every core decodes its own stretch.
    read = partial(read_frames, clip / CLIP_NAME, colour=facts.colour, threads=1)
    whole = film.Film(read, facts.frames, facts.frame_rate_hz, KEY_FRAME_EVERY)
    detector = film.Detector(arena, typical, p)
    cuts = [start for start, _ in facts.segments[1:]]
    verdicts: Counter[Verdict] = Counter()
    lengths: Counter[int] = Counter()
    found = check_given(told, clip, facts, scene, detector) if told else None
    followed = Followed(told.given, typical.length_px, p.least_frames) if told else None

    def tracked() -> Iterator[list[film.TrackedFish]]:
        seen = film.detections(whole, scene, detector, workers)
        linked = followed.tracks(seen, cuts) if followed else film.tracks(seen, typical, p, cuts)
        for judged, fish in linked:
            verdicts.update(judged)
            lengths.update(f.track_id for f in fish)
            advance()
            yield fish

    with film_writer(folder, tracks_schema(p.points)) as write:
        for fish in film.batches(tracked()):
            write(film.rows(fish), film.cutouts(fish))
    if not lengths:
        raise film.nothing_followed(p, verdicts)
    tank = SceneFacts(scene.polarity, scene.noise, scene.threshold, *typical, points=p.points)
    save_record(folder / SCENE_NAME, tank)
    save_picture(folder / BACKGROUND_NAME, scene.background)
    given = {}
    if told and followed and found:
        save_given(folder, told.given, p.points)
        given = given_metrics(told, followed, found)
    return Extraction(tank, verdicts, lengths, given)
