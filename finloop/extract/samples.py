"""First measurements, on frames spread over the film: tank, noise, a typical fish.

The background is the median of these frames. But a fish that stays in its place, or moves less than
its length, is in the median itself: a *ghost*. The difference from such a background is the part
that moved, now darker, now brighter, of any size. So where fish are both darker and brighter than
the median, or nothing is found, two other backgrounds are tried: the median without ghosts, and an
even tone. The one whose fish are most alike in size is taken, if it is clearly better.
"""

from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import Literal, NamedTuple

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.base.parallel import ALONE, Threads, ordered_map
from finloop.extract.backbone import trace
from finloop.extract.background import (
    Scene,
    flat_background,
    in_light_of,
    median_background,
    patched_background,
    survey_noise,
)
from finloop.extract.fins import Fins, classify_pale, pale_side
from finloop.extract.segment import Silhouette, SilhouetteEdge, silhouettes
from finloop.extract.settings import ExtractSettings


class Typical(NamedTuple):
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


def judge(silhouette: Silhouette, typical: Typical, settings: ExtractSettings) -> Verdict:
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


class BackgroundSurvey(NamedTuple):
    """The measurements with one background: scene, typical fish, and how much fish differ in area.

    spread: half the width of the middle 68 % of their areas, relative to the median (for Gaussian
    areas the standard deviation); infinite for fewer than one fish in two frames.
    """

    scene: Scene
    typical: Typical
    spread: float


def survey(
    sample: Sequence[Picture], arena: Picture, settings: ExtractSettings, workers: Threads = ALONE
) -> tuple[Scene, Typical]:
    """Measure the scene and a typical fish on sample frames spread over the clip.

    sample: frames (h, w[, 3]); arena: (h, w) uint8, 255 inside. FinloopError if nothing stands out
    from the background, or no silhouette can be an isolated fish.
    """
    if settings.background == "threshold":
        return _survey(sample, flat_background(sample), arena, settings, workers)[:2]
    median, spread = median_background(sample, workers), attrgetter("spread")
    if settings.background != "auto":
        return _survey(sample, median, arena, settings, workers)[
            :2
        ]  # `mog2` starts from the median
    try:
        usual = _survey(sample, median, arena, settings, workers)
    except FinloopError:
        others = _without_ghosts(sample, median, arena, settings, workers)
        if not others:
            raise
        return min(others, key=spread)[:2]
    if usual.scene.polarity != "both":
        return usual[:2]
    others = _without_ghosts(sample, median, arena, settings, workers)
    best = min(others, key=spread, default=usual)
    return (best if best.spread < _BETTER * usual.spread else usual)[:2]


def _without_ghosts(
    sample: Sequence[Picture],
    median: Picture,
    arena: Picture,
    settings: ExtractSettings,
    workers: Threads,
) -> list[BackgroundSurvey]:
    """Measure with the patched median and with an even tone, if there is a fish."""
    least = max(settings.least_contrast, _GHOST)
    patched = partial(patched_background, sample, median, least)
    surveys = []
    for background in (patched, partial(flat_background, sample)):
        with suppress(FinloopError):
            surveys.append(_survey(sample, background(), arena, settings, workers))
    return surveys


def _survey(
    sample: Sequence[Picture],
    background: Picture,
    arena: Picture,
    settings: ExtractSettings,
    workers: Threads,
) -> BackgroundSurvey:
    """Measure with a background; FinloopError as in `survey`."""
    scene = survey_noise(
        sample,
        background,
        settings.polarity,
        settings.noise_sigmas,
        settings.least_contrast,
        workers,
    )
    fins: Fins = "darker" if settings.fins == "auto" and scene.polarity != "bright" else "none"
    ends = SilhouetteEdge(settings.outline_contrast_ratio, settings.shadow, fins)

    def of_frame(ends: SilhouetteEdge, frame: Picture) -> list[Silhouette]:
        lit = in_light_of(scene, frame)
        return list(silhouettes(frame, lit, arena, settings.least_area_px, ends))

    def find_silhouettes(thin: bool) -> tuple[list[Silhouette], Typical, float]:
        look = partial(of_frame, ends._replace(thin=thin))
        some = [s for one in ordered_map(look, sample, workers) for s in one]
        typical, unsteady = typical_fish(some, scene, settings)
        return some, typical._replace(thin=thin), unsteady

    candidates, typical, unsteady = find_silhouettes(settings.thin == "keep")
    if settings.thin == "auto" and unsteady > _UNSTEADY:
        other = find_silhouettes(thin=True)
        if other[-1] < _BETTER * unsteady:
            candidates, typical, _ = other
    areas = [s.area_px for s in candidates if judge(s, typical, settings) == "fish"]
    if 2 * len(areas) < len(sample):
        return BackgroundSurvey(scene, typical, np.inf)
    low, middle, high = np.quantile(areas, (0.16, 0.5, 0.84))
    return BackgroundSurvey(scene, typical, float((high - low) / 2 / middle))


def typical_fish(
    candidates: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> tuple[Typical, float]:
    """Return the typical fish of silhouettes in sample frames, and the relative spread of lengths.

    Its area is the median of the silhouettes' areas, weighted by area and contrast so that dirt,
    bubbles and figures of a clock count little; length and contrast are the medians of the
    silhouettes of about that area. The spread is half the width of the middle 68 % of lengths,
    relative to the median. FinloopError if no silhouette can be an isolated fish.
    """
    free = [s for s in candidates if not s.at_border]
    if not free:
        raise _no_fish(candidates, scene, settings)
    free.sort(key=attrgetter("area_px"))
    weight = np.cumsum([s.area_px * s.contrast for s in free])
    area = free[int(np.searchsorted(weight, 0.5 * weight[-1]))].area_px
    alike = [s for s in free if 0.7 * area <= s.area_px <= 1.4 * area][:200]
    lines = [trace(s.mask, s.field, settings.points, scene.threshold) for s in alike]
    lengths = [line.length_px for line in lines if line is not None]
    if not lengths:
        raise _no_fish(candidates, scene, settings)
    sides = (
        pale_side(s.mask, (s.x0, s.y0), line, s.fins)
        for s, line in zip(alike, lines, strict=True)
        if line is not None and s.fins is not None
    )
    pale = {"keep": "fins", "drop": "gloom"}.get(settings.fins) or classify_pale(sides)
    both: Fins = "brighter" if scene.polarity == "both" else "none"
    fins: Fins = "all" if pale == "fins" else both if pale == "shadow" else "none"
    contrast = float(np.median([s.contrast for s in alike]))
    low, middle, high = np.quantile(lengths, (0.16, 0.5, 0.84))
    return Typical(area, float(middle), contrast, fins), float((high - low) / 2 / middle)


def _no_fish(
    candidates: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> FinloopError:
    if not candidates:
        why = f"nothing differs from the background by more than {scene.threshold:.1f} grey levels"
    elif all(s.at_border for s in candidates):
        why = f"all {len(candidates)} silhouettes touch the edge of the picture or of the arena"
    else:
        why = "every shape that differs from the background is too round to have a backbone"
    return FinloopError(
        f"no fish found: {why}",
        "fish that swim clear of the edge, darker or brighter than the tank",
        f"try {'' if settings.background == 'auto' else 'extract.background=auto, '}another "
        "extract.polarity, or a lower extract.noise_sigmas; set clip.arena; "
        "or take a film in which the fish moves about",
    )
