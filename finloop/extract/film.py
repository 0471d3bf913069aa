"""Film → tracks of isolated fish, each with cut-out, outline and backbone (fish paper §2.1-2.2.1).

The order of things: `survey` looks at frames spread over the clip and says what tank, noise and a
typical fish are; `detected` streams the film once and finds the fish of each frame, on every core;
`tracks` links them in order. Memory holds some stretches of detections and the fish of
`least_frames` frames, however long the clip.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple, Protocol

import cv2
import numpy as np
import pandas as pd

from finloop.errors import FinloopError
from finloop.extract.backbone import trace
from finloop.extract.background import (
    Image,
    Scene,
    flat_background,
    median_background,
    relit,
    survey_noise,
)
from finloop.extract.segment import (
    Fish,
    Silhouette,
    measure,
    silhouettes,
)
from finloop.extract.settings import Settings
from finloop.extract.tracks import Linker, Spot
from finloop.parallel import ordered_map


class Typical(NamedTuple):
    """A typical fish of the clip: area of its silhouette, length of its backbone, its contrast."""

    area_px: float
    length_px: float
    contrast: float


class Found(NamedTuple):
    """One fish of one frame in a track."""

    track_id: int
    frame: int
    fish: Fish


Verdict = Literal["fish", "at border", "too large", "too small", "too pale"]
"""Whether a silhouette is one isolated fish, or why not."""

_STRETCH = 240  # frames that a process works on at a time, at most
_SPECK = 0.125  # of a typical fish's area: what is smaller is not even a neighbour


def judge(silhouette: Silhouette, typical: Typical, settings: Settings) -> Verdict:
    """Say what a silhouette is, by its place, size and contrast."""
    if silhouette.contrast < settings.least_contrast_ratio * typical.contrast:
        return "too pale"
    if silhouette.at_border:
        return "at border"
    if silhouette.area_px > settings.most_area_ratio * typical.area_px:
        return "too large"
    if silhouette.area_px < settings.least_area_ratio * typical.area_px:
        return "too small"
    return "fish"


def survey(sample: Sequence[Image], arena: Image, settings: Settings) -> tuple[Scene, Typical]:
    """Scene and typical fish from frames spread over the clip.

    Raises
    ------
    FinloopError
        If nothing stands out of the background, or no silhouette can be a fish by itself.
    """
    flat = settings.background == "threshold"
    make = flat_background if flat else median_background
    scene = survey_noise(
        sample, make(sample), settings.polarity, settings.noise_sigmas, settings.least_contrast
    )
    found = [
        s
        for frame in sample
        for s in silhouettes(
            frame, relit(scene, frame), arena, settings.least_area_px, settings.outline_share
        )
    ]
    return scene, typical_fish(found, scene, settings)


def typical_fish(found: Sequence[Silhouette], scene: Scene, settings: Settings) -> Typical:
    """Median of the silhouettes' areas weighted by area (specks of dirt weigh little), and the
    length that goes with it."""
    free = [s for s in found if not s.at_border]
    if not free:
        raise _no_fish(found, scene)
    areas = np.sort([s.area_px for s in free])
    weight = np.cumsum(areas)
    area = float(areas[np.searchsorted(weight, 0.5 * weight[-1])])
    alike = [s for s in free if 0.7 * area <= s.area_px <= 1.4 * area][:200]
    lines = [trace(s.mask, s.field, settings.points, scene.threshold) for s in alike]
    lengths = [line.length_px for line in lines if line is not None]
    if not lengths:
        raise _no_fish(found, scene)
    return Typical(area, float(np.median(lengths)), float(np.median([s.contrast for s in alike])))


def _no_fish(found: Sequence[Silhouette], scene: Scene) -> FinloopError:
    if not found:
        seen = f"nothing differs from the background by more than {scene.threshold:.1f} grey levels"
    elif all(s.at_border for s in found):
        seen = f"all {len(found)} silhouettes touch the edge of the picture or of the arena"
    else:
        seen = "what differs from the background is too round to have a backbone"
    return FinloopError(
        f"no fish found: {seen}",
        "fish that swim clear of the edge, darker or brighter than the tank",
        "look at the background picture; try extract.background=threshold for a fish that stays in "
        "place, another extract.polarity, a lower extract.noise_sigmas or extract.least_area_px, "
        "or set clip.arena",
    )


def follow(frames: Iterable[Image], scene: Scene, rate_hz: float) -> Iterator[tuple[Image, Scene]]:
    """Each frame with the background that MOG2 has learnt by then, renewed every second."""
    model = cv2.createBackgroundSubtractorMOG2(
        history=max(2, round(20 * rate_hz)), detectShadows=False
    )
    model.apply(scene.background, learningRate=1.0)
    for number, frame in enumerate(frames):
        model.apply(frame)
        if number % max(1, round(rate_hz)) == 0:
            scene = replace(scene, background=model.getBackgroundImage())
        yield frame, scene


class Detected(NamedTuple):
    """One frame's silhouettes: what each is, where, and the `Fish` of those that are one."""

    verdicts: list[Verdict]
    spots: list[Spot]
    fish: list[Fish | None]


@dataclass(frozen=True)
class Detector:
    """Finds the fish of one frame, knowing the arena, a typical fish and the settings."""

    arena: Image
    typical: Typical
    settings: Settings

    def __call__(self, frame: Image, scene: Scene) -> Detected:
        """All silhouettes of `frame`; those that are isolated fish are measured."""
        settings = self.settings
        least = max(settings.least_area_px, _SPECK * self.typical.area_px)
        scene = relit(scene, frame)
        found = list(silhouettes(frame, scene, self.arena, least, settings.outline_share))
        verdicts = [judge(s, self.typical, settings) for s in found]
        fish = [
            measure(s, frame, scene, settings.points) if verdict == "fish" else None
            for s, verdict in zip(found, verdicts, strict=True)
        ]
        spots = [_spot(s, f) for s, f in zip(found, fish, strict=True)]
        return Detected(verdicts, spots, fish)


class Reader(Protocol):
    """Gives the frames start … stop − 1 of a clip; may be sent to another process."""

    def __call__(self, *, start: int, stop: int) -> Iterator[Image]: ...


def detected(
    read: Reader, frames: int, scene: Scene, detector: Detector, workers: int, stride: int = 1
) -> Iterator[Detected]:
    """Detections of every frame in order, worked out on `workers` processes.

    Each reads stretches of the clip by itself, which begin at multiples of `stride` (the distance
    of key frames, so that no frame is decoded for nothing).
    """
    length = min(_STRETCH, max(1, frames // (4 * workers)))
    length = max(1, length // stride) * stride
    spans = [(start, min(start + length, frames)) for start in range(0, frames, length)]
    work = partial(_stretch, read, scene, detector)
    return (one for stretch in ordered_map(work, spans, workers) for one in stretch)


def _stretch(
    read: Reader, scene: Scene, detector: Detector, span: tuple[int, int]
) -> list[Detected]:
    return [detector(frame, scene) for frame in read(start=span[0], stop=span[1])]


def tracks(
    detections: Iterable[Detected], typical: Typical, settings: Settings, cuts: Sequence[int] = ()
) -> Iterator[tuple[Counter[Verdict], list[Found]]]:
    """For each frame its verdicts, and the fish whose tracks are long enough by then.

    A track begins to appear, all its fish at once, when it has `least_frames` frames. Tracks end at
    `cuts`, the numbers of the first frames of further segments.
    """
    linker = Linker(settings.gate_body_lengths * typical.length_px, settings.step_area_ratio)
    waiting: dict[int, list[Found]] = {}
    grown: set[int] = set()
    for number, (verdicts, spots, fish) in enumerate(detections):
        if number in cuts:
            linker.cut()
        ids = linker.step(spots)
        ready: list[Found] = []
        for track, one in zip(ids, fish, strict=True):
            if track is None or one is None:
                continue
            waiting.setdefault(track, []).append(Found(track, number, one))
            if track in grown or len(waiting[track]) >= settings.least_frames:
                grown.add(track)
                ready += waiting.pop(track)
        alive = {track for track in ids if track is not None}
        waiting = {track: fishes for track, fishes in waiting.items() if track in alive}
        grown &= alive
        yield Counter(verdicts), ready


def _spot(silhouette: Silhouette, fish: Fish | None) -> Spot:
    h, w = silhouette.mask.shape
    x0, y0 = silhouette.x0, silhouette.y0
    box = (x0, y0, x0 + w, y0 + h)
    if fish is None:
        return Spot(x0 + w / 2, y0 + h / 2, silhouette.area_px, box, False)
    return Spot(fish.x_px, fish.y_px, silhouette.area_px, box, True)


def rows(found: Sequence[Found]) -> pd.DataFrame:
    """What was found as rows of `tracks_schema`."""
    return pd.DataFrame(
        {
            "track_id": [f.track_id for f in found],
            "frame": [f.frame for f in found],
            "x_px": [f.fish.x_px for f in found],
            "y_px": [f.fish.y_px for f in found],
            "area_px": [f.fish.area_px for f in found],
            "contrast": [f.fish.contrast for f in found],
            "length_px": [f.fish.backbone.length_px for f in found],
            "backbone_x_px": [f.fish.backbone.points_px[:, 0] for f in found],
            "backbone_y_px": [f.fish.backbone.points_px[:, 1] for f in found],
            "half_width_px": [f.fish.backbone.half_width_px for f in found],
            "outline_x_px": [f.fish.outline_px[:, 0] for f in found],
            "outline_y_px": [f.fish.outline_px[:, 1] for f in found],
        }
    )
