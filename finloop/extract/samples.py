"""Measure first, on frames spread over the film: tank, noise, a typical fish.

The background is the median of these frames. But a fish that stays in its place, or moves less than
its length, is in the median itself: a *ghost*. The difference from such a background is the part
that moved, now darker, now brighter, of any size. So two other backgrounds are tried: the median
without ghosts, and an even tone. The one whose fish are most alike in size is taken, if it is
clearly better.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from operator import attrgetter
from typing import Literal, NamedTuple

import cv2
import numpy as np

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.base.parallel import ALONE, Threads, ordered_map
from finloop.extract.backbone import Backbone, cut_limbs, trace_backbone
from finloop.extract.background import (
    Polarity,
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
    """A typical fish of the clip: its area [px²], backbone's length [px], and contrast.

    contrast: grey levels of the difference image. fins: which pale pixels beyond silhouettes are
    shown with them; thin: whether pale thin parts belong to the silhouette. edge_px: how wide the
    outline is, where the animal blends with the tank. limbs: whether it has limbs, which are no
    part of the backbone.
    """

    area_px: float
    length_px: float
    contrast: float
    fins: Fins
    thin: bool = False
    edge_px: float = 0.0
    limbs: bool = False


Verdict = Literal["fish", "at border", "too large", "too small", "too pale"]
"""Whether a silhouette is one isolated fish, or the reason why not."""

_GHOST = 12.0  # grey levels, least contrast of a ghost; 6-30 give trout and sunfish the same fish
# Share of the median's spread below which another background is clearly better: without ghosts
# 0.04-0.14 was measured (trout, sunfish, a carp of three beats), of a shaking camera 1.00.
_BETTER = 0.67
# How much lengths differ; below that thin parts are not searched. Measured: mouse 0.20, larva
# 0.07, zebrafish 0.05; with thin parts 0.11, 0.01, 0.10.
_UNSTEADY = 0.04
# Most limbs of an animal that counts as without: a thin tail. Medians over the fish of sample
# frames: zebrafish, trout, carp 0, sunfish, mouse 1, flies 3; more than one is seen in 90 % of the
# flies, and in 17 % of the mouse's and the sunfish's silhouettes.
_LIKE_LIMBS = 1
_COUNTED = 60  # most silhouettes whose limbs are counted


def judge_silhouette(
    silhouette: Silhouette, typical: TypicalFish, settings: ExtractSettings
) -> Verdict:
    """Return the verdict on a silhouette: "fish" if it is one isolated fish, else why not.

    Its place, and its size and contrast relative to the typical fish, decide.
    """
    if silhouette.contrast < settings.min_contrast_ratio * typical.contrast:
        return "too pale"
    if silhouette.at_border:
        return "at border"
    if silhouette.area_px > settings.max_area_ratio * typical.area_px:
        return "too large"
    if silhouette.area_px < settings.min_area_ratio * typical.area_px:
        return "too small"
    return "fish"


class _SimilarFish(NamedTuple):
    """The fish of sample frames that are about as large as the typical one.

    typical: the typical fish; its fins and edge_px are not known yet. length_spread: half the width
    of the middle 68 % of lengths, relative to the median. traced: silhouettes with backbones.
    """

    typical: TypicalFish
    length_spread: float
    traced: list[tuple[Silhouette, Backbone]]


class _BackgroundTrial(NamedTuple):
    """The scene and the similar fish that were measured against one background.

    area_spread: half the width of the middle 68 % of the fish's areas, relative to the median;
    infinite if there are fewer fish than half the frames.
    """

    scene: Scene
    similar: _SimilarFish
    area_spread: float


def measure_scene_and_fish(
    sample_frames: Sequence[Picture], arena: Picture, settings: ExtractSettings,
    workers: Threads = ALONE,
) -> tuple[Scene, TypicalFish]:  # fmt: skip
    """Return the scene and a typical fish, measured on sample frames of the clip.

    sample_frames: (h, w[, 3]); arena: (h, w) uint8, 255 inside. With background `auto`, other
    backgrounds than the median are tried: a fish that hardly moved leaves a ghost in the median.
    Another one is taken if fish vary clearly less in area on it, or none is found on the median.
    FinloopError if no background shows an isolated fish.
    """
    measure = partial(_measure_with_background, sample_frames, arena, settings, workers)
    if settings.background == "threshold":
        trial = measure(flat_background(sample_frames))
    else:
        median = median_background(sample_frames, workers)
        if settings.background == "auto":
            trial = _try_backgrounds(measure, sample_frames, median, settings.least_contrast)
        else:  # `mog2` starts from the median
            trial = measure(median)
    return trial.scene, _add_fins_and_edge(trial.similar, trial.scene, settings)


def _try_backgrounds(
    measure: Callable[[Picture], _BackgroundTrial], sample_frames: Sequence[Picture],
    median: Picture, least_contrast: float,
) -> _BackgroundTrial:  # fmt: skip
    """Return the trial of the best background: median, median without ghosts, or an even tone.

    measure: tries a background (h, w[, 3]); FinloopError if no fish is found on it. median: of the
    sample frames; least_contrast: of a fish, grey levels. FinloopError if none shows a fish.
    """
    others: list[_BackgroundTrial] = []
    with suppress(FinloopError):
        ghost = max(least_contrast, _GHOST)
        others.append(measure(background_without_ghosts(sample_frames, median, ghost)))
    with suppress(FinloopError):
        others.append(measure(flat_background(sample_frames)))
    best_other = min(others, key=attrgetter("area_spread"), default=None)
    try:
        with_median = measure(median)
    except FinloopError:
        if best_other is None:
            raise
        return best_other
    if best_other and best_other.area_spread < _BETTER * with_median.area_spread:
        return best_other
    return with_median


def _measure_with_background(
    sample_frames: Sequence[Picture], arena: Picture, settings: ExtractSettings, workers: Threads,
    background: Picture,
) -> _BackgroundTrial:  # fmt: skip
    """Return the scene, similar fish, and the spread of areas against a given background.

    The last is infinite if there are fewer fish than half the frames. Setting `thin` "auto": thin
    parts belong to fish if this makes their lengths clearly more alike.
    sample_frames: (h, w[, 3]); arena: (h, w) uint8, 255 inside; background: (h, w[, 3]).
    FinloopError if no silhouette can be an isolated fish.
    """
    sigmas, least = settings.noise_sigmas, settings.least_contrast
    scene = measure_scene(sample_frames, background, settings.polarity, sigmas, least, workers)
    fins: Fins = "darker" if settings.fins == "auto" and scene.polarity != "bright" else "none"
    edge_rule = SilhouetteEdge(settings.outline_contrast_ratio, settings.shadow, fins)

    def find_in_frame(edge_rule: SilhouetteEdge, frame: Picture) -> list[Silhouette]:
        """Return the silhouettes of one sample frame."""
        lit = match_scene_to_light(scene, frame)
        return list(find_silhouettes(frame, lit, arena, settings.least_area_px, edge_rule))

    def search_sample(thin: bool) -> tuple[list[Silhouette], _SimilarFish]:
        """Return the silhouettes of all frames, and the similar fish among them.

        thin: whether pale thin parts belong to silhouettes.
        """
        find = partial(find_in_frame, edge_rule._replace(thin=thin))
        by_frame = ordered_map(find, sample_frames, workers)
        silhouettes = [silhouette for listed in by_frame for silhouette in listed]
        similar = _find_similar_fish(silhouettes, scene, settings)
        return silhouettes, similar._replace(typical=similar.typical._replace(thin=thin))

    silhouettes, similar = search_sample(settings.thin == "keep")
    # Where lengths differ, silhouettes may end at different places of a pale, thin tail.
    is_steady = similar.typical.limbs or similar.length_spread <= _UNSTEADY
    if settings.thin == "auto" and not is_steady:
        with_thin = search_sample(thin=True)
        if with_thin[1].length_spread < _BETTER * similar.length_spread:
            silhouettes, similar = with_thin
    areas = [
        s.area_px for s in silhouettes if judge_silhouette(s, similar.typical, settings) == "fish"
    ]
    are_enough = 2 * len(areas) >= len(sample_frames)
    area_spread = _median_and_spread(areas)[1] if are_enough else np.inf
    return _BackgroundTrial(scene, similar, area_spread)


def _median_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """Return the median of values and their relative spread: half the width of the middle 68 %.

    For Gaussian values the second number is the standard deviation divided by the mean.
    """
    low, middle, high = np.quantile(values, (0.16, 0.5, 0.84))
    return float(middle), float((high - low) / 2 / middle)


def find_typical_fish(
    silhouettes: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> tuple[TypicalFish, float]:
    """Return the typical fish among silhouettes, and the relative spread of fish's lengths.

    Its area is the median of the silhouettes' areas, weighted by area and contrast so that dirt and
    bubbles count little. All else is of the silhouettes with about that area: length, contrast and
    edge_px are medians; fins are chosen by `_choose_fins`; it has limbs if the median number of
    limbs is above one, for a thin tail looks like one. The spread is half the width of the middle
    68 % of lengths, relative to the median. FinloopError if no silhouette can be an isolated fish.
    """
    similar = _find_similar_fish(silhouettes, scene, settings)
    return _add_fins_and_edge(similar, scene, settings), similar.length_spread


def _find_similar_fish(
    silhouettes: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> _SimilarFish:
    """Return the silhouettes with about the area of a typical fish; see `find_typical_fish`."""
    away_from_border = sorted(
        (s for s in silhouettes if not s.at_border), key=attrgetter("area_px")
    )
    if not away_from_border:
        raise _no_fish_error(silhouettes, scene, settings)
    weight = np.cumsum([s.area_px * s.contrast for s in away_from_border])
    area = away_from_border[int(np.searchsorted(weight, 0.5 * weight[-1]))].area_px
    # 200 are enough for medians.
    similar = [s for s in away_from_border if 0.7 * area <= s.area_px <= 1.4 * area][:200]
    to_count = similar[:: 1 + len(similar) // _COUNTED]
    limbs = bool(np.median([cut_limbs(s.mask)[1] for s in to_count]) > _LIKE_LIMBS)
    trace = partial(trace_backbone, points=settings.points, floor=scene.threshold, limbs=limbs)
    traced = [(s, line) for s in similar if (line := trace(s.mask, s.field)) is not None]
    if not traced:
        raise _no_fish_error(silhouettes, scene, settings)
    contrast = float(np.median([s.contrast for s in similar]))
    length, spread = _median_and_spread([line.length_px for _, line in traced])
    return _SimilarFish(TypicalFish(area, length, contrast, "none", limbs=limbs), spread, traced)


def _add_fins_and_edge(
    similar: _SimilarFish, scene: Scene, settings: ExtractSettings
) -> TypicalFish:
    """Return the typical one of similar fish, with its fins and the width of its outline."""
    fins = _choose_fins(similar.traced, settings.fins, scene.polarity)
    edge_px = float(np.median([measure_edge_width(s) for s, _ in similar.traced]))
    return similar.typical._replace(fins=fins, edge_px=edge_px)


def _choose_fins(
    traced: Sequence[tuple[Silhouette, Backbone]], setting: Literal["auto", "keep", "drop"],
    polarity: Polarity,
) -> Fins:  # fmt: skip
    """Return which pale pixels beside bodies belong to the fish: all, the brighter, or none.

    setting: "keep" gives "all", "drop" gives "none", "auto" classifies the pixels. Fins give "all".
    A shadow gives "none", but "brighter" if the fish's polarity is "both": pixels brighter than the
    tank are no shadow. Gloom, the floor dimmed all around an animal, gives "none".
    traced: silhouettes with their backbones.
    """
    if setting != "auto":
        return "all" if setting == "keep" else "none"
    kind = classify_pale_pixels(
        find_pale_side(s.mask, (s.x0, s.y0), line, s.pale)
        for s, line in traced
        if s.pale is not None
    )
    if kind == "fins":
        return "all"
    return "brighter" if kind == "shadow" and polarity == "both" else "none"


def measure_edge_width(silhouette: Silhouette) -> float:
    """Return how wide a silhouette's blurred outline is [px]: its contrast over its slope.

    The slope [grey levels / px] of the difference image is measured where that falls to half of the
    contrast. Its upper quartile along the outline counts: skin marks and pale fins are less steep.
    """
    field, half = silhouette.field.astype(np.float32), silhouette.contrast / 2
    inside = ((field > half) & silhouette.mask).astype(np.uint8)
    rim = (inside - cv2.erode(inside, np.ones((3, 3), np.uint8))).view(bool)
    # scale: Sobel's weights add up to 8
    slope = np.hypot(*(cv2.Sobel(field, cv2.CV_32F, x, 1 - x, scale=1 / 8) for x in (0, 1)))
    return silhouette.contrast / max(float(np.quantile(slope[rim], 0.75)), 1e-6)


def _no_fish_error(
    silhouettes: Sequence[Silhouette], scene: Scene, settings: ExtractSettings
) -> FinloopError:
    """Return the error that no sample frame shows an isolated fish; its message says why."""
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
