"""What is measured first, on frames spread over the film: tank, noise, a typical fish.

A fish that stays in its place, or moves less than its length, is in the median of the frames, too.
What then differs is the part that moved, now darker, now brighter, of any size. So where both
differ, two other backgrounds are tried, the median without such ghosts and one even tone, and
whichever shows fish of one size is taken.
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.extract.backbone import trace
from finloop.extract.background import (
    Scene,
    flat_background,
    in_light_of,
    median_background,
    patched_background,
    survey_noise,
)
from finloop.extract.segment import Silhouette, silhouettes
from finloop.extract.settings import Settings


class Typical(NamedTuple):
    """A typical fish of the clip: area of its silhouette, length of its backbone, its contrast."""

    area_px: float
    length_px: float
    contrast: float


Verdict = Literal["fish", "at border", "too large", "too small", "too pale"]
"""Whether a silhouette is one isolated fish, or why not."""

_GHOST = 12.0  # grey levels by which a ghost differs from the floor around it, at least
_BETTER = 0.67  # of the spread of areas with the median: what another background must be below


def judge(silhouette: Silhouette, typical: Typical, settings: Settings) -> Verdict:
    """The verdict on a silhouette, by its place, size and contrast."""
    if silhouette.contrast < settings.least_contrast_ratio * typical.contrast:
        return "too pale"
    if silhouette.at_border:
        return "at border"
    if silhouette.area_px > settings.most_area_ratio * typical.area_px:
        return "too large"
    if silhouette.area_px < settings.least_area_ratio * typical.area_px:
        return "too small"
    return "fish"


class Survey(NamedTuple):
    """A tank and its typical fish; spread: of the areas of its fish, relative to their median."""

    scene: Scene
    typical: Typical
    spread: float


def survey(sample: Sequence[Picture], arena: Picture, settings: Settings) -> tuple[Scene, Typical]:
    """Scene and typical fish from frames spread over the clip.

    FinloopError if nothing stands out from the background, or no silhouette can be an isolated
    fish.
    """
    if settings.background != "auto":
        flat = settings.background == "threshold"
        return _survey(sample, flat_background(sample) if flat else median_background(sample),
                       arena, settings)[:2]  # fmt: skip
    middle, ghost = median_background(sample), max(settings.least_contrast, _GHOST)

    def tried(make: Callable[[], Picture]) -> Survey | FinloopError:
        try:
            return _survey(sample, make(), arena, settings)
        except FinloopError as error:
            return error

    usual = tried(lambda: middle)
    if isinstance(usual, Survey) and usual.scene.polarity != "both":
        return usual[:2]
    makers = (
        lambda: patched_background(sample, middle, ghost),
        lambda: flat_background(sample),
    )
    others = [one for one in map(tried, makers) if isinstance(one, Survey)]
    if isinstance(usual, FinloopError) and not others:
        raise usual
    best = min(others, key=lambda one: one.spread, default=usual)
    if isinstance(usual, Survey) and isinstance(best, Survey):
        best = best if best.spread < _BETTER * usual.spread else usual
    assert isinstance(best, Survey)
    return best[:2]


def _survey(
    sample: Sequence[Picture], background: Picture, arena: Picture, settings: Settings
) -> Survey:
    """What is measured with a background."""
    scene = survey_noise(
        sample, background, settings.polarity, settings.noise_sigmas, settings.least_contrast
    )
    candidates = [
        s
        for frame in sample
        for s in silhouettes(
            frame, in_light_of(scene, frame), arena, settings.least_area_px, settings.outline_share
        )
    ]
    typical = typical_fish(candidates, scene, settings)
    areas = [s.area_px for s in candidates if judge(s, typical, settings) == "fish"]
    if 2 * len(areas) < len(sample):  # in every other frame at most
        return Survey(scene, typical, np.inf)
    low, middle, high = np.quantile(areas, (0.16, 0.5, 0.84))
    return Survey(scene, typical, float((high - low) / 2 / middle))


def typical_fish(candidates: Sequence[Silhouette], scene: Scene, settings: Settings) -> Typical:
    """The typical fish of a clip, from silhouettes of sample frames.

    Its area is the median of the silhouettes' areas, weighted by area so that specks of dirt count
    little; length and contrast are the medians of the silhouettes of about that area.
    """
    free = [s for s in candidates if not s.at_border]
    if not free:
        raise _no_fish(candidates, scene)
    areas = np.sort([s.area_px for s in free])
    weight = np.cumsum(areas)
    area = float(areas[np.searchsorted(weight, 0.5 * weight[-1])])
    alike = [s for s in free if 0.7 * area <= s.area_px <= 1.4 * area][:200]
    lines = [trace(s.mask, s.field, settings.points, scene.threshold) for s in alike]
    lengths = [line.length_px for line in lines if line is not None]
    if not lengths:
        raise _no_fish(candidates, scene)
    return Typical(area, float(np.median(lengths)), float(np.median([s.contrast for s in alike])))


def _no_fish(candidates: Sequence[Silhouette], scene: Scene) -> FinloopError:
    if not candidates:
        why = f"nothing differs from the background by more than {scene.threshold:.1f} grey levels"
    elif all(s.at_border for s in candidates):
        why = f"all {len(candidates)} silhouettes touch the edge of the picture or of the arena"
    else:
        why = "what differs from the background is too round to have a backbone"
    return FinloopError(
        f"no fish found: {why}",
        "fish that swim clear of the edge, darker or brighter than the tank",
        "look at the background picture; try extract.background=threshold for a fish that stays in "
        "place, another extract.polarity, a lower extract.noise_sigmas or extract.least_area_px, "
        "or set clip.arena",
    )
