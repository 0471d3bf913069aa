"""Judge the animals of a film: whether they are large, sharp and clear of the border."""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from finloop.base.arrays import Floats, Ints
from finloop.base.finding import Finding

# Values from which something is a fault.
SHORT_PX = 35.0  # body length; of 40 px, headings of a drawn carp are off by 1.4°, of 60 by 0.8°
EDGE_PCT = 8.0  # of the body length; sharp films have 1 to 6, small animals more
BORDER_PCT = 10.0
# Measured: carp, trout, sunfish 0, zebrafish 0.2; flies whose legs come and go 1.3, a mouse with
# its tail 2.3, a dog and a person before a hedge 2.4.
PARTS_PCT = 0.5
# Ninth tenth of an animal's area over the first. Measured: trout, sunfish, zebrafish 1.05 to 1.08,
# flies 1.14, mouse 1.22, carp 1.25, a dog beside a person 1.33.
AREA_RANGE = 1.4
UNKNOWN_PCT = 1.0  # of the frames; one or two that a hand covers do not matter
LIGHT_RANGE = 1.5  # cut-outs from a light so much weaker have as much more noise

_OFF = 0.1  # of the area; an animal that bends or turns changes more slowly
_WINDOW = 5  # frames


def measure_area_jumps(track: Ints, frame: Ints, area_px: Floats) -> float:
    """Return the percentage of frames in which an animal's area jumps by more than 10 %.

    The area jumps if it differs by so much from the median of five successive frames, the frame in
    their middle: parts of the animal come or go for a moment. NaN if no track has five successive
    frames. track, frame, area (rows,): of each silhouette of an animal, in any order.
    """
    order = np.lexsort((frame, track))
    track, frame, area_px = track[order], frame[order], area_px[order]
    if len(track) < _WINDOW:
        return float("nan")
    last = _WINDOW - 1
    whole = (track[last:] == track[:-last]) & (frame[last:] - frame[:-last] == last)
    areas = np.lib.stride_tricks.sliding_window_view(area_px, _WINDOW)[whole]
    if not len(areas):
        return float("nan")
    usual = np.median(areas, axis=1)
    return float(100 * (np.abs(areas[:, _WINDOW // 2] - usual) > _OFF * usual).mean())


def measure_area_range(track: Ints, area_px: Floats) -> float:
    """Return by what factor an animal's area varies: its 90 % quantile over its 10 % quantile.

    It is the median over the tracks, each weighted by its frames. track, area_px (rows,): of each
    silhouette of an animal, in any order.
    """
    order = np.argsort(track, kind="stable")
    tracks = np.split(area_px[order], np.flatnonzero(np.diff(track[order])) + 1)
    ranges = [np.quantile(areas, 0.9) / np.quantile(areas, 0.1) for areas in tracks]
    return float(np.median(np.repeat(ranges, [len(areas) for areas in tracks])))


class LightFacts(NamedTuple):
    """What the light of a film's frames does, relative to the empty tank.

    light_sd_pct: standard deviation over the mean, per cent; light_range: brightest over darkest
    frame; both NaN if no frame's light is known. light_unknown_pct: percentage of frames whose
    light is unknown; their cut-outs are as bright as filmed.
    """

    light_sd_pct: float
    light_range: float
    light_unknown_pct: float


def summarize_light(light: Floats) -> LightFacts:
    """Return facts about the light (frames,) of a film; NaN is unknown."""
    known = light[np.isfinite(light)]
    if not len(known):
        return LightFacts(math.nan, math.nan, 100.0)
    return LightFacts(
        light_sd_pct=100 * float(known.std() / known.mean()),
        light_range=float(known.max() / known.min()),
        light_unknown_pct=100 * (1 - len(known) / len(light)),
    )


def _judge_light(light: LightFacts) -> Finding:
    """Return the finding on the light in which cut-outs are stored."""
    if light.light_unknown_pct == 100:
        return Finding(
            "light", True, "Whether the light changes cannot be told: the floor is plain black or "
            "white. Cut-outs are as bright as filmed.",
        )  # fmt: skip
    advice = "One light for the whole film: lamps and exposure set by hand, no white floor."
    if light.light_unknown_pct > UNKNOWN_PCT:
        return Finding(
            "light", False,
            f"In {light.light_unknown_pct:.0f} % of the frames the light is unknown, as where the "
            "tank is plain white or a lamp lights only a part: cut-outs there are as bright as "
            "filmed, all others are in even light.",
            advice,
        )  # fmt: skip
    return Finding(
        "light", light.light_range < LIGHT_RANGE,
        f"The light differs by {light.light_sd_pct:.1f} % from frame to frame (SD), the brightest "
        f"is {light.light_range:.2f} times the darkest; cut-outs are stored in even light.",
        advice,
    )  # fmt: skip


def list_findings(metrics: Mapping[str, float]) -> Iterator[Finding]:
    """Yield findings on the animals' size, outlines, border, parts and shadow, light and tank.

    metrics: of the stage `extract`, by name.
    """
    length_px, edge_px = metrics["typical_length_px"], metrics["typical_edge_px"]
    is_long = length_px >= SHORT_PX
    yield Finding(
        "size", is_long, f"A typical animal is {length_px:.0f} px long.",
        f"Film nearer, or with more pixels: {SHORT_PX:.0f} px are the least, 60 to 150 are good.",
    )  # fmt: skip
    if is_long:  # of a small animal every outline is wide
        share_pct = 100 * edge_px / length_px
        yield Finding(
            "sharpness", share_pct < EDGE_PCT,
            f"Its outline is {edge_px:.1f} px wide, {share_pct:.1f} % of its length.",
            "Focus by hand; a shutter of 1/250 s or shorter, with more light.",
        )  # fmt: skip
    at_border, isolated = metrics["silhouettes_at_border"], metrics["silhouettes_fish"]
    share_pct = 100 * at_border / max(1, at_border + isolated)
    yield Finding(
        "border", share_pct < BORDER_PCT,
        f"{share_pct:.0f} % of the silhouettes are cut off by the edge of the picture or arena.",
        "Film from farther away, so that the whole tank is seen; or give a larger clip.arena.",
    )  # fmt: skip
    jumps_pct = metrics["area_jumps_pct"]
    if not math.isnan(jumps_pct):
        yield Finding(
            "parts", jumps_pct < PARTS_PCT,
            f"The area of an animal jumps by more than 10 % for a moment in {jumps_pct:.1f} % of "
            "the frames.",
            "Parts come and go, such as legs, fins or a tail: more light on them, a floor of one "
            "brightness, or a smaller extract.outline_contrast_ratio.",
        )  # fmt: skip
    area_range = metrics["area_range"]
    yield Finding(
        "shadow", area_range < AREA_RANGE,
        f"An animal's area differs by a factor of {area_range:.2f} (a tenth of the frames is above "
        "that range, a tenth below).",
        "A shadow or mirror image as dark as the animal may count as part of it, and is then in "
        "its cut-outs: light from all sides or from below, a darker or rougher floor.",
    )  # fmt: skip
    yield _judge_light(LightFacts(*(metrics[name] for name in LightFacts._fields)))
    grain = metrics["tank_grain_grey"]
    yield Finding(
        "tank", True,
        f"The empty tank has a grain of {grain:.1f} grey levels, and so has an animation's."
        if grain else "The film shows no grain of the empty tank: an animation's stands still.",
    )  # fmt: skip
