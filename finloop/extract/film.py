"""Turn film into tracks of isolated fish with cut-outs, outlines, backbones (§2.1-2.2.1).

Three steps: `samples.measure_scene_and_fish` measures tank, noise and a typical fish on frames of
the whole clip; `detect_in_clip` streams the film once and detects the fish of each frame, on every
core; `link_tracks` links them. Memory holds only some stretches of detections and the fish of
`min_track_frames` frames.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Picture
from finloop.base.cutout import Cutout
from finloop.base.errors import FinloopError, UndecodableError
from finloop.base.parallel import Workers, ordered_map
from finloop.extract.background import Scene, match_scene_to_light
from finloop.extract.samples import TypicalFish, Verdict, judge_silhouette
from finloop.extract.segment import (
    SegmentedFish,
    Silhouette,
    SilhouetteEdge,
    edge_pixels,
    find_silhouettes,
    measure_fish,
)
from finloop.extract.settings import ExtractSettings
from finloop.extract.tracks import SilhouettePlace, TrackLinker

_STRETCH = 240  # most frames that a worker takes at a time
_SPECK = 0.125  # share of a typical fish's area; smaller patches are ignored
_SAMPLE_BYTES = 2**29  # most bytes of the sample frames


class TrackedFish(NamedTuple):
    """One fish in one frame: its track's number, the frame's number, and its measures."""

    track_id: int
    frame: int
    fish: SegmentedFish


def choose_sample_frames(
    most_samples: int, frames: int, frame_shape: tuple[int, ...], key_frame_distance: int
) -> list[int]:
    """Return the numbers of sample frames spread evenly over a clip, ascending.

    Their count is odd and at most `most_samples`, less for a short clip or large frames. frames:
    length of the clip; frame_shape: (h, w[, channels]); key_frame_distance: frames from one key
    frame to the next. If the clip is long enough, only key frames are chosen, which decode fast.
    """
    most = max(1, min(most_samples, frames, _SAMPLE_BYTES // int(np.prod(frame_shape))))
    count = most if most % 2 else most - 1
    numbers = np.linspace(0, frames - 1, count).round().astype(int)
    if frames >= count * key_frame_distance:
        numbers = numbers // key_frame_distance * key_frame_distance
    return numbers.tolist()


def add_learnt_backgrounds(
    frames: Iterable[Picture], scene: Scene, rate_hz: float
) -> Iterator[tuple[Picture, Scene]]:
    """Yield each frame with a scene whose background OpenCV's MOG2 learns from the film.

    The background is renewed every second. frames: (h, w[, 3]); rate_hz: frames per second.
    """
    history = max(2, round(20 * rate_hz))
    model = cv2.createBackgroundSubtractorMOG2(history=history, detectShadows=False)
    model.apply(scene.background, learningRate=1.0)
    for number, frame in enumerate(frames):
        model.apply(frame)
        if number % max(1, round(rate_hz)) == 0:
            scene = replace(scene, background=model.getBackgroundImage())
        yield frame, scene


class Detections(NamedTuple):
    """The silhouettes found in one frame, as three lists with one entry for each, and its light.

    verdicts: whether it is a fish; spots: its place; fish: its measures, None unless it is an
    isolated fish with a backbone. light: brightness relative to the empty tank; NaN if unknown.
    """

    verdicts: list[Verdict]
    spots: list[SilhouettePlace]
    fish: list[SegmentedFish | None]
    light: float = math.nan


Stretch = list[Detections | None]
"""The detections of successive frames; None for a frame that cannot be decoded."""


@dataclass(frozen=True)
class Detector:
    """Finds and measures the fish in single frames.

    arena: (h, w) uint8, 255 inside; typical: a typical fish of the clip, to compare sizes with.
    """

    arena: Picture
    typical: TypicalFish
    settings: ExtractSettings

    def __call__(self, frame: Picture, scene: Scene) -> Detections:
        """Return a frame's silhouettes, found on a background made as bright as the frame."""
        return self.detect(frame, match_scene_to_light(scene, frame))

    def detect(self, frame: Picture, scene: Scene) -> Detections:
        """Return a frame's silhouettes, each with verdict, position, and measures if it is a fish.

        scene: in the light of the frame (`match_scene_to_light`).
        """
        settings = self.settings
        least_area_px = max(settings.least_area_px, _SPECK * self.typical.area_px)
        edge_rule = SilhouetteEdge(
            settings.outline_contrast_ratio, settings.shadow, self.typical.fins, self.typical.thin
        )
        light = math.nan if scene.gains is None else float(scene.gains.mean())
        result = Detections([], [], [], light)
        for silhouette in find_silhouettes(frame, scene, self.arena, least_area_px, edge_rule):
            verdict = judge_silhouette(silhouette, self.typical, settings)
            fish = None
            if verdict == "fish":
                fish = measure_fish(
                    silhouette, frame, scene, settings.points, self.typical.limbs,
                    self.typical.edge_px,
                )  # fmt: skip
            result.verdicts.append(verdict)
            result.spots.append(_silhouette_place(silhouette, fish, bool(settings.tracks_path)))
            result.fish.append(fish)
        return result


class ClipStream(NamedTuple):
    """How to read a clip: its length, frames per second, key frames, and stored detections.

    stride: frames from one key frame to the next. read: yields the frames start … stop − 1, (h, w)
    or (h, w, 3) uint8. load_or_make: returns the detections that are stored under a name, or makes
    and stores them; None stores nothing. A cluster pickles both functions.
    """

    read: Callable[..., Iterator[Picture]]
    frames: int
    rate_hz: float
    stride: int = 1
    load_or_make: Callable[[str, Callable[[], "Stretch"]], "Stretch"] | None = None


def detect_in_clip(
    clip: ClipStream, scene: Scene, detector: Detector, workers: Workers
) -> Iterator[Detections | None]:
    """Yield the detections of every frame of a clip in order; None for a damaged frame.

    Each of `workers` reads stretches that begin at key frames, so no frame is decoded in vain. A
    background by MOG2 depends on all earlier frames: then one worker reads all, nothing is stored,
    and a damaged frame raises UndecodableError.
    """
    if detector.settings.background == "mog2":
        frames = clip.read(start=0, stop=clip.frames)
        adapted = add_learnt_backgrounds(frames, scene, clip.rate_hz)
        return (detector(frame, frame_scene) for frame, frame_scene in adapted)
    # At least four stretches for each worker if the clip is long enough; all but the last one are
    # a whole number of strides long.
    wanted_length = min(_STRETCH, clip.frames // (4 * workers.count))
    length = max(1, wanted_length // clip.stride) * clip.stride
    starts = range(0, clip.frames, length)
    spans = [(start, min(start + length, clip.frames)) for start in starts]
    work = partial(_load_or_detect, clip, scene, detector)
    return (frame for stretch in ordered_map(work, spans, workers) for frame in stretch)


def _load_or_detect(
    clip: ClipStream, scene: Scene, detector: Detector, span: tuple[int, int]
) -> Stretch:
    """Return the detections in successive frames of a clip: stored ones, or new ones.

    span: (start, stop), the frames start … stop − 1.
    """
    compute = partial(_detect_span, clip, scene, detector, span)
    if clip.load_or_make is None:
        return compute()
    return clip.load_or_make("{:09d}-{:09d}".format(*span), compute)


def _detect_span(
    clip: ClipStream, scene: Scene, detector: Detector, span: tuple[int, int]
) -> Stretch:
    """Return the detections in successive frames of a clip, computed anew.

    span: (start, stop), the frames start … stop − 1. A damaged frame and those after it, up to the
    next key frame, have None.
    """
    start, stop = span
    detections: Stretch = []
    while (number := start + len(detections)) < stop:
        try:
            for frame in clip.read(start=number, stop=stop):
                detections.append(detector(frame, scene))
            break
        except UndecodableError:
            damaged = start + len(detections)
            key_frame = (damaged // clip.stride + 1) * clip.stride
            detections += [None] * (min(key_frame, stop) - damaged)
    return detections


def fill_lost_frames(
    detections: Iterable[Detections | None], lost_frames: list[int]
) -> Iterator[Detections]:
    """Yield the detections of every frame; empty ones for frames that could not be decoded.

    lost_frames: receives the numbers of these frames.
    """
    for number, detected in enumerate(detections):
        if detected is None:
            lost_frames.append(number)
        yield detected or Detections([], [], [])


def link_tracks(
    detections: Iterable[Detections], typical: TypicalFish, settings: ExtractSettings,
    cuts: Sequence[int] = (),
) -> Iterator[tuple[Counter[Verdict], list[TrackedFish]]]:  # fmt: skip
    """Link fish of successive frames to tracks; yield verdict counts and tracked fish by frame.

    Verdicts of its silhouettes are counted. Fish wait until their track has `min_track_frames`
    frames; then all are yielded with the present frame. Fish of shorter tracks never are. cuts:
    numbers of frames before which the film is cut, and tracks end.
    """
    gate_px = settings.max_link_distance_bl * typical.length_px
    linker = TrackLinker(gate_px, settings.step_area_ratio)
    waiting: dict[int, list[TrackedFish]] = {}
    long_tracks: set[int] = set()
    for number, detected in enumerate(detections):
        if number in cuts:
            linker.end_tracks()
        ids = linker.link_frame(detected.spots)
        ready: list[TrackedFish] = []  # fish of long tracks, to yield with this frame
        for track, measures in zip(ids, detected.fish, strict=True):
            if track is None or measures is None:
                continue
            waiting.setdefault(track, []).append(TrackedFish(track, number, measures))
            if track in long_tracks or len(waiting[track]) >= settings.min_track_frames:
                long_tracks.add(track)
                ready += waiting.pop(track)
        alive = {track for track in ids if track is not None}
        waiting = {track: fishes for track, fishes in waiting.items() if track in alive}
        long_tracks &= alive
        yield Counter(detected.verdicts), ready


def _silhouette_place(
    silhouette: Silhouette, fish: SegmentedFish | None, with_outline: bool
) -> SilhouettePlace:
    """Return a silhouette's position: mass centre of a fish, else the middle of its box.

    fish: the measures of the silhouette, None if it is no isolated fish; with_outline: whether to
    add the pixels of its edge.
    """
    (h, w), x0, y0 = silhouette.mask.shape, silhouette.x0, silhouette.y0
    x, y = (fish.x_px, fish.y_px) if fish else (x0 + w / 2, y0 + h / 2)
    outline = edge_pixels(silhouette) if with_outline else None
    box, isolated = (x0, y0, x0 + w, y0 + h), fish is not None
    return SilhouettePlace(x, y, silhouette.area_px, box, isolated, outline)


def batch_fish(fish: Iterable[list[TrackedFish]]) -> Iterator[list[TrackedFish]]:
    """Join lists of fish to longer ones of at least 512, which are faster to write.

    The last may be shorter, or empty.
    """
    batch: list[TrackedFish] = []
    for listed in fish:
        batch += listed
        if len(batch) >= 512:
            yield batch
            batch = []
    yield batch


class NoTrackError(FinloopError):
    """The error that no track of a film is long enough."""


def no_track_error(settings: ExtractSettings, verdicts: Counter[Verdict]) -> NoTrackError:
    """Return the error that no track is long enough; it counts the silhouettes by verdict."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in verdicts.items())
    return NoTrackError(
        f"no fish could be followed for {settings.min_track_frames} frames (silhouettes: {counts})",
        "fish that swim by themselves, clear of the border",
        "allow shorter tracks (extract.min_track_frames), other sizes "
        "(extract.min_area_ratio, extract.max_area_ratio), or set clip.arena",
    )


def fish_cutouts(fish: Iterable[TrackedFish]) -> Iterator[Cutout]:
    """Yield each fish's cut-out: track, frame, position, and pixels with alpha."""
    for tracked in fish:
        found = tracked.fish
        yield Cutout(tracked.track_id, tracked.frame, found.x0, found.y0, found.cutout)


def track_table_rows(fish: Sequence[TrackedFish]) -> pd.DataFrame:
    """Return rows of the table of tracks (`tracks_schema`), one for each given fish."""
    return pd.DataFrame(
        {
            "track_id": [f.track_id for f in fish],
            "frame": [f.frame for f in fish],
            **{
                name: [getattr(f.fish, name) for f in fish]
                for name in ("x_px", "y_px", "area_px", "contrast")
            },
            "length_px": [f.fish.backbone.length_px for f in fish],
            "backbone_x_px": [f.fish.backbone.points_px[:, 0] for f in fish],
            "backbone_y_px": [f.fish.backbone.points_px[:, 1] for f in fish],
            "half_width_px": [f.fish.backbone.half_width_px for f in fish],
            "outline_x_px": [f.fish.outline_px[:, 0] for f in fish],
            "outline_y_px": [f.fish.outline_px[:, 1] for f in fish],
        }
    )
