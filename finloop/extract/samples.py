"""First measurements, on frames spread over the film: tank, noise, a typical fish.

The background is the median of these frames. But a fish that stays in its place, or moves less than
its length, is in the median itself: a *ghost*. The difference from such a background is the part
that moved, now darker, now brighter, of any size. So where fish are both darker and brighter than
the median, or nothing is found, two other backgrounds are tried: the median without ghosts, and an
even tone. The one whose fish are most alike in size is taken, if it is clearly better.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.base.parallel import ALONE, Threads, ordered_map
from finloop.extract.backbone import trace_backbone
from finloop.extract.background import (
    Scene,
    background_without_ghosts,
    flat_background,
    match_scene_to_light,
    measure_scene,
    median_background,
)
from finloop.extract.fins import Fins, classify_pale_pixels, find_pale_side
from finloop.extract.segment import Silhouette, SilhouetteEdge, find_silhouettes
from finloop.extract.settings import ExtractSettings


class TypicalFish(NamedTuple):
    """A typical fish of the clip: its silhouette's area, backbone's length [px], and contrast.

    contrast: grey levels of the difference image. fins: which pale pixels beyond silhouettes are
    shown with them; thin: whether pale thin parts belong to the silhouette.
    """

    area_px: float
    length_px: float
    contrast: float
    fins: Fins
    thin: bool = False


Verdict = Literal["fish", "at border", "too large", "too small", "too pale"]
"""Whether a silhouette is one isolated fish, or the reason why not."""

_GHOST = 12.0  # grey levels, least contrast of a ghost; 6-30 give trout and sunfish the same fish
# Share of the median's spread below which another background is clearly better: without ghosts
# 0.04-0.14 was measured (trout, sunfish, a carp of three beats), of a shaking camera 1.00.
_BETTER = 0.67
# How much lengths differ; below that thin parts are not searched. Measured: mouse 0.20, larva
# 0.07, zebrafish 0.05; with thin parts 0.11, 0.01, 0.10.
_UNSTEADY = 0.04


def judge_silhouette(
    silhouette: Silhouette, typical: TypicalFish, settings: ExtractSettings
) -> Verdict:
    """Return whether a silhouette is one isolated fish, or why not, by place, size and contrast."""
    if silhouette.contrast < settings.min_contrast_ratio * typical.contrast:
        return "too pale"
    if silhouette.at_border:
        return "at border"
    if silhouette.area_px > settings.max_area_ratio * typical.area_px:
        return "too large"
    if silhouette.area_px < settings.min_area_ratio * typical.area_px:
        return "too small"
    return "fish"


class _BackgroundTrial(NamedTuple):
    """What was measured with one background: scene, typical fish, and how much fish vary in area.

    spread: half the width of the middle 68 % of their areas, relative to the median; infinite for
    fewer than one fish in two frames.
    """

    scene: Scene
    typical: TypicalFish
    spread: float


def measure_scene_and_fish(
    sample_frames: Sequence[Picture],
    arena: Picture,
    settings: ExtractSettings,
    workers: Threads = ALONE,
) -> tuple[Scene, TypicalFish]:
    """Measure the scene and a typical fish on sample frames spread over the clip.

    sample_frames: (h, w[, 3]); arena: (h, w) uint8, 255 inside. FinloopError if nothing stands out
    from the background, or no silhouette can be an isolated fish.
    """
    measure = partial(_measure_with_background, sample_frames, arena, settings, workers)
    if settings.background == "threshold":
        return measure(flat_background(sample_frames))[:2]
    median, spread = median_background(sample_frames, workers), attrgetter("spread")
    if settings.background != "auto":  # `mog2` starts from the median
        return measure(median)[:2]

    def without_ghosts() -> Iterator[_BackgroundTrial]:
        """Yield the measurements with those other backgrounds on which a fish is found."""
        with suppress(FinloopError):
            ghost = max(settings.least_contrast, _GHOST)
            yield measure(background_without_ghosts(sample_frames, median, ghost))
        with suppress(FinloopError):
            yield measure(flat_background(sample_frames))

    try:
        usual = measure(median)
    except FinloopError:
        if best := min(without_ghosts(), key=spread, default=None):
            return best[:2]
        raise
    if usual.scene.polarity != "both":
        return usual[:2]
    best = min(without_ghosts(), key=spread, default=usual)
    return (best if best.spread < _BETTER * usual.spread else usual)[:2]


def _measure_with_background(
    sample_frames: Sequence[Picture],
    arena: Picture,
    settings: ExtractSettings,
    workers: Threads,
    background: Picture,
) -> _BackgroundTrial:
    """Measure noise, polarity and a typical fish on sample frames, against a given background.

    FinloopError as in `measure_scene_and_fish`. arena: (h, w) uint8, 255 inside.
    """
    sigmas, least = settings.noise_sigmas, settings.least_contrast
    scene = measure_scene(sample_frames, background, settings.polarity, sigmas, least, workers)
    fins: Fins = "darker" if settings.fins == "auto" and scene.polarity != "bright" else "none"
    ends = SilhouetteEdge(settings.outline_contrast_ratio, settings.shadow, fins)

    def find_in_frame(ends: SilhouetteEdge, frame: Picture) -> list[Silhouette]:
        lit = match_scene_to_light(scene, frame)
        return list(find_silhouettes(frame, lit, arena, settings.least_area_px, ends))

    def search_sample(thin: bool) -> tuple[list[Silhouette], TypicalFish, float]:
        find = partial(find_in_frame, ends._replace(thin=thin))
        silhouettes = [s for one in ordered_map(find, sample_frames, workers) for s in one]
        typical, unsteady = find_typical_fish(silhouettes, scene, settings)
        return silhouettes, typical._replace(thin=thin), unsteady

    candidates, typical, unsteady = search_sample(settings.thin == "keep")
    if settings.thin == "auto" and unsteady > _UNSTEADY:
        with_thin = search_sample(thin=True)
        if with_thin[-1] < _BETTER * unsteady:
            candidates, typical, _ = with_thin
    areas = [s.area_px for s in candidates if judge_silhouette(s, typical, settings) == "fish"]
    spread = _median_and_spread(areas)[1] if 2 * len(areas) >= len(sample_frames) else np.inf
    return _BackgroundTrial(scene, typical, spread)


def _median_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Return the median, and half the width of the middle 68 % of the values relative to it.

    Of Gaussian values the second is the standard deviation over the mean.
    """
    low, middle, high = np.quantile(values, (0.16, 0.5, 0.84))
    return float(middle), float((high - low) / 2 / middle)


def find_typical_fish(
    silhouettes: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> tuple[TypicalFish, float]:
    """Return the typical fish among silhouettes of sample frames, and the spread of lengths.

    Its area is the median of the silhouettes' areas, weighted by area and contrast so that dirt and
    bubbles count little; length and contrast are the medians of the silhouettes of about that area.
    FinloopError if no silhouette can be an isolated fish.
    """
    free = sorted((s for s in silhouettes if not s.at_border), key=attrgetter("area_px"))
    if not free:
        raise _no_fish_error(silhouettes, scene, settings)
    weight = np.cumsum([s.area_px * s.contrast for s in free])
    area = free[int(np.searchsorted(weight, 0.5 * weight[-1]))].area_px
    alike = [s for s in free if 0.7 * area <= s.area_px <= 1.4 * area][:200]
    traced = [
        (s, line)
        for s in alike
        if (line := trace_backbone(s.mask, s.field, settings.points, scene.threshold)) is not None
    ]
    if not traced:
        raise _no_fish_error(silhouettes, scene, settings)
    sides = (
        find_pale_side(s.mask, (s.x0, s.y0), line, s.fins)
        for s, line in traced
        if s.fins is not None
    )
    pale = {"keep": "fins", "drop": "gloom"}.get(settings.fins) or classify_pale_pixels(sides)
    fins: Fins = "none"
    if pale == "fins":
        fins = "all"
    elif pale == "shadow" and scene.polarity == "both":
        fins = "brighter"
    contrast = float(np.median([s.contrast for s in alike]))
    length, spread = _median_and_spread([line.length_px for _, line in traced])
    return TypicalFish(area, length, contrast, fins), spread


def _no_fish_error(
    silhouettes: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> FinloopError:
    """Return the error for sample frames without an isolated fish, with the reason."""
    if not silhouettes:
        why = f"nothing differs from the background by more than {scene.threshold:.1f} grey levels"
    elif all(s.at_border for s in silhouettes):
        why = f"all {len(silhouettes)} silhouettes touch the edge of the picture or of the arena"
    else:
        why = "every shape that differs from the background is too round to have a backbone"
    return FinloopError(
        f"no fish found: {why}",
        "fish that swim clear of the edge, darker or brighter than the tank",
        f"try {'' if settings.background == 'auto' else 'extract.background=auto, '}another "
        "extract.polarity, or a lower extract.noise_sigmas; set clip.arena; "
        "or take a film in which the fish moves about",
    )
