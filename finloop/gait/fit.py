"""Fit a gait to the contours of a film: its key frames and γ (curve paper §4.2, Figs. 9–11).

The contours are sorted into the cycle of the gait. By symmetry every frame counts in the first half
of the cycle: frames of C and D are the partner's frames of A and B. Without symmetry every frame
counts where it is, and key frames 1' and 2' are measured as 1 and 2 are. γ is fitted over the
frames of a subcycle, see `gait.model`: one for a limb, a scale, a coefficient or a coordinate.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from finloop.base.arrays import Ints, Mask, Points
from finloop.base.errors import FinloopError
from finloop.curve.wavelet import find_wavelet
from finloop.gait.model import (
    KEY_NAMES,
    LETTERS,
    MOST_GAMMA,
    POOLED,
    SHARINGS,
    Descriptor,
    Gait,
    HalfCycleLayout,
    Keys,
    contours_at_phases,
    contours_half_cycle_later,
    exchange_second_half,
    four_key_frames,
    gamma_fraction,
    gamma_from_fractions,
    locate_with_symmetry,
    opposite_limb,
    start_share,
)
from finloop.gait.settings import Sharing, Symmetry

WIDEST = 0.125
"""Cycles: largest distance in phase of a frame that stands in for a key, or one frame if longer."""
ROUNDING = 1e-9  # cycles: a frame that is nearer to a key counts as on either side of it
SubcycleKey = tuple[str, str]
"""A subcycle of a contour: its id, and a letter of LETTERS."""
LEAST = 2  # fewest frames between the keys of a subcycle
ROUNDS = 3
"""Rounds of `fit_key_frames`. They bring γ of the drawn dog within 6 % at any frame rate, from
44 % without correction. With more rounds the cubics follow the noise of few frames."""
LOW = 0.05  # share of a limb's height: a foot on the ground is no higher above it
GROUND = 0.9  # quantile of the heights of a foot, from the highest on, that is the ground
SUPPORT_STEPS = 240  # moments of a cycle at which feet are looked at
LEAST_MOTION = 1e-5
"""Body lengths, RMS over the contour: what moves less between the keys has its parent's γ.

A γ is the bend of a course divided by its length; of a coordinate that hardly moves it is noise.
"""


@dataclass(frozen=True)
class GaitContours:
    """Contours of an animal in every frame, relative to its body, with the phase of its gait."""

    # closed, (frames, n, 2) by id, n a power of two; NaN in frames without the contour. With
    # symmetry "mirror" they begin at the snout
    contours: Mapping[str, Points]
    phase: Points  # (frames,) in cycles, rising; the whole part counts the cycles
    body_length: float  # in the unit of the contours
    symmetry: Symmetry  # what half a cycle later is like, see `gait.model`
    # (2,) by id: how much farther right and down a limb hangs than its left-right partner
    offsets: Mapping[str, Points] | None = None

    @property
    def layout(self) -> HalfCycleLayout:
        """Return how contours lie in the second half of the cycle, compared with the first."""
        return HalfCycleLayout(offsets=self.offsets)

    def contours_half_cycle_later(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Return the contours, by id, that symmetry predicts half a cycle later."""
        return contours_half_cycle_later(contours, self.symmetry, self.layout)

    def exchange_second_half(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Return contours by id; those in the second half of a cycle are replaced by symmetry."""
        return exchange_second_half(contours, self.phase, self.symmetry, self.layout)

    def locate_in_subcycle(self, split: float) -> tuple[Ints, Points]:
        """Return the number of each frame's subcycle, and what share of it is over (0-1).

        C counts as A, and D as B, if the film has a symmetry. split: phase of key 2, in cycles.
        """
        return locate_with_symmetry(self.phase, self.symmetry, split)

    def add_hidden_limbs(self) -> "GaitContours":
        """Return the film with a contour of NaN for each limb whose partner alone is shown.

        That is a left limb whose right partner is shown, or the other way round; later it follows
        from the partner by symmetry. Films of other symmetries than "swap" are returned unchanged.
        """
        if self.symmetry != "swap":
            return self
        contours = dict(self.contours)
        for name, points in self.contours.items():
            for side, opposite in (("left", "right"), ("right", "left")):
                if side in name:
                    contours.setdefault(name.replace(side, opposite), np.full_like(points, np.nan))
        return replace(self, contours=contours)

    @property
    def cycles(self) -> float:
        """Return how many gait cycles the film shows: frames times the median step of phase."""
        return float(len(self.phase) * np.median(np.diff(self.phase)))


def check_phases(film: GaitContours) -> None:
    """Raise FinloopError if the film shows too little of a gait cycle, or its phase does not rise.

    Half a cycle is needed, or a whole one without symmetry.
    """
    if len(film.phase) < 3 or (np.diff(film.phase) <= 0).any():
        raise FinloopError(
            f"{len(film.phase)} frames whose phase does not always rise",
            "at least 3 frames, each later in the cycle than the previous frame",
            "use a longer film, or find its period again",
        )
    part = len(LETTERS[film.symmetry]) / 4
    if film.cycles < part - 1e-6:
        raise FinloopError(
            f"{len(film.phase)} frames show {film.cycles:.2f} of a cycle",
            "at least half a cycle: the other half follows by symmetry"
            if part < 1
            else "a whole cycle: no part of it follows by symmetry",
            "use a longer film",
        )


def partner_offsets(film: GaitContours) -> dict[str, Points]:
    """Return, by id, how far right and down (2,) of its left-right partner each limb lies.

    The unit is that of the contours. It is the mean difference between a limb and its partner half
    a cycle later, when both are at the same point of their motion. (0, 0) if the film is shorter
    than a cycle, or never shows one of the two limbs.
    """
    offsets = {name: np.zeros(2) for name in film.contours}
    if film.cycles < 1 - 1e-6:
        return offsets
    centres = {name: points.mean(axis=1) for name, points in film.contours.items()}
    for name, centre in centres.items():
        partner = opposite_limb(name, film.contours)
        if partner <= name:  # a limb without a partner, or a pair that is done already
            continue
        partner_centre = centres[partner]
        shown = np.isfinite(centre).all(axis=1)
        partner_shown = np.isfinite(partner_centre).all(axis=1)
        if shown.any() and partner_shown.any():
            later, known = film.phase[shown] + 0.5, film.phase[partner_shown]
            x, y = partner_centre[partner_shown].T
            partner_later = [np.interp(later, known, values, period=1.0) for values in (x, y)]
            offsets[name] = (centre[shown] - np.column_stack(partner_later)).mean(axis=0)
            offsets[partner] = -offsets[name]
    return offsets


def interpolate_key_frames(film: GaitContours, split: float) -> list[dict[str, Points]]:
    """Return the key frames 1 and 2 of a gait, interpolated from the frames nearest in phase.

    Without symmetry 1' and 2' come after them. split: phase of key 2, in cycles. All cycles count,
    and by symmetry both halves. FinloopError if a contour is missing in every frame near a key; the
    message names all such contours.
    """
    phases = [0.0, split, 0.5, 0.5 + split][: len(LETTERS[film.symmetry])]
    keys = [_interpolate_key(film, phase) for phase in phases]
    missing = [
        f"{name!r} near key {title}"
        for title, key in zip(KEY_NAMES, keys, strict=False)
        for name in film.contours
        if name not in key
    ]
    if missing:
        raise FinloopError(
            f"no frame shows {', '.join(missing)}",
            f"each contour in a frame within {WIDEST:g} of a cycle of all keys",
            "use more cycles, or omit the contours that the film does not show",
        )
    return keys


def _interpolate_key(film: GaitContours, key_phase: float) -> dict[str, Points]:
    """Return the contours (n, 2), by id, at a key's phase, from the frames nearest in phase.

    By symmetry, frames half a cycle from the key count with the symmetric pose. Contours that no
    frame near the key shows are left out.
    """
    step = float(np.median(np.diff(film.phase)))  # cycles from frame to frame
    period = 1.0 if film.symmetry == "none" else 0.5
    periods = np.round((film.phase - key_phase) / period)  # from the key to the frame, whole
    offset = film.phase - key_phase - period * periods
    key = dict[str, Points]()
    if film.symmetry == "none":
        later, shows_key = film.contours, np.ones((len(periods), 1, 1), bool)
    else:
        later = film.contours_half_cycle_later(film.contours)
        shows_key = (periods % 2 == 0)[:, None, None]  # else the symmetric pose does
    for name, points in film.contours.items():
        poses = np.where(shows_key, points, later[name])
        shown = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
        weight = _weights_near_key(offset, shown, step)
        if weight.any():
            key[name] = np.tensordot(weight[shown], poses[shown], axes=1)
    return key


def _weights_near_key(offset: Points, shown: Mask, step: float) -> Points:
    """Return the weights (frames,) with which frames are averaged to a key frame.

    Frames within a width count, from 1 at the key linearly to 0. They give the key as the straight
    line through them that fits best. The width is a frame's step or, if that does not reach frames
    on both sides, up to WIDEST. If none reaches both sides, frames on one side give their mean.

    offset (frames,): from the key, in cycles, as `step` is; shown: which frames count.
    """
    one_side = np.zeros(len(offset))
    width = step
    while True:
        weight = np.clip(1 - np.abs(offset) / width, 0, None) * shown
        near = offset[weight > 0]
        if near.size:
            weight /= weight.sum()
            if near.min() <= ROUNDING and near.max() >= -ROUNDING:
                from_mean = offset - weight @ offset
                spread = max(float(weight @ from_mean**2), 1e-300)  # never divide by 0
                return weight * (1 - (weight @ offset) * from_mean / spread)
            if not one_side.any():
                one_side = weight
        if width >= WIDEST:
            return one_side
        width = min(2 * width, WIDEST)


@dataclass(frozen=True)
class SubcycleFrames:
    """The s frames that show one contour in one subcycle, between two key frames.

    tau (s,): shares 0-1 of the subcycle; coefficients (s, n, 2): of the contour.
    """

    tau: Points
    coefficients: Points


def sort_into_subcycles(
    film: GaitContours, split: float, descriptor: Descriptor
) -> dict[SubcycleKey, SubcycleFrames]:
    """Return a film's frames as wavelet coefficients, sorted by contour and subcycle.

    By symmetry, frames in C and D count in A and B with the symmetric pose. split: phase of key 2,
    in cycles; descriptor: how contours become coefficients.
    """
    subcycle, tau = film.locate_in_subcycle(split)
    samples = dict[SubcycleKey, SubcycleFrames]()
    for name, poses in film.exchange_second_half(film.contours).items():
        shown = np.isfinite(poses).all(axis=(1, 2))
        for number, letter in enumerate(LETTERS[film.symmetry]):
            frames = shown & (subcycle == number)
            coefficients = descriptor.coefficients(poses[frames])
            samples[name, letter] = SubcycleFrames(tau[frames], coefficients)
    return samples


@dataclass(frozen=True)
class Subcycle:
    """A contour's wavelet coefficients in two key frames, and in the film frames between them."""

    samples: SubcycleFrames  # the film's frames in the subcycle
    # start, end: the key frames at both ends, (n, 2)
    start: Points
    end: Points
    scales: list[slice]  # the slice of each scale in the n coefficients

    def gamma_fraction(self) -> tuple[Points, Points]:
        """Return numerators and denominators (n, 2) of the γ of each coefficient's x and y."""
        samples = self.samples
        return gamma_fraction(samples.tau, samples.coefficients, self.start, self.end)

    def fit_gammas(self, sharing: Sharing, least_motion: float) -> Points:
        """Return the gait parameters γ that fit the limb, its scales, or finer parts best.

        That is (1,) for the limb, (m,) for its m scales from coarse to fine, (n, 1) for its
        coefficients, or (n, 2) for their x and y. least_motion: what moves no more than this (RMS
        over the contour) from key to key, in the unit of the contours, has the γ of its parent, and
        so has a γ beyond ±MOST_GAMMA. The parent of a coordinate is its coefficient, then its
        scale, then the limb, whose own parent is 0.
        """
        parts = *self.gamma_fraction(), (self.start - self.end) ** 2
        least_square = least_motion**2 * len(self.start)
        gammas = np.zeros(1)
        for level in SHARINGS[: SHARINGS.index(sharing) + 1]:
            if level == "coefficient":  # the parents are scales
                gammas = np.repeat(gammas, [scale.stop - scale.start for scale in self.scales])
                gammas = gammas[:, None]
            numerator, denominator, square = (self._sum_sharers(part, level) for part in parts)
            clear = (square > least_square) & (denominator > 0)
            fitted = numerator / np.where(clear, denominator, np.inf)
            gammas = np.where(clear & (np.abs(fitted) <= MOST_GAMMA), fitted, gammas)
        return gammas

    def motion_shares(self, sharing: Sharing) -> Points:
        """Return the share of the contour's motion between the keys (RMS) that belongs to each γ.

        The result has the shape of `fit_gammas`. Its squares add up to 1, or to 0 at rest.
        """
        squares = (self.start - self.end) ** 2
        total = max(float(squares.sum()), 1e-300)  # never divide by 0
        return np.asarray(np.sqrt(self._sum_sharers(squares, sharing) / total))

    def _sum_sharers(self, parts: Points, sharing: Sharing) -> Points:
        """Return values (n, 2) summed over the coordinates that share one γ.

        The result has the shape of `fit_gammas`.
        """
        if sharing == "coordinate":
            return parts
        sums = parts.sum(axis=1, keepdims=True)
        if sharing == "coefficient":
            return sums
        starts = [scale.start for scale in self.scales] if sharing == "scale" else [0]
        return np.add.reduceat(sums[:, 0], starts)

    def predict(self, tau: Points, gamma: Points) -> Points:
        """Return the wavelet coefficients (s, n, 2) that γ predicts at times tau (s,).

        tau: shares 0-1 of the subcycle's time; gamma: of each coefficient, (n, 1), of each of its
        coordinates, (n, 2), or of all, (1,).
        """
        return self.end + start_share(tau[:, None, None], gamma) * (self.start - self.end)

    def smooth(self, tau: Points) -> Points:
        """Return wavelet coefficients (s, n, 2) at tau (s,), from cubics fitted to the frames.

        The cubics go through both key frames. tau: shares 0-1 of the subcycle's time.
        """
        linear = np.zeros(1)  # γ: evenly from key to key
        # The cubics are this straight motion, plus a part that is 0 at both keys.
        bend = self.samples.coefficients - self.predict(self.samples.tau, linear)
        factors = np.linalg.lstsq(
            _evaluate_two_cubics(self.samples.tau), bend.reshape(len(bend), -1), rcond=None
        )[0]
        curved = (_evaluate_two_cubics(tau) @ factors).reshape(-1, *self.end.shape)
        return self.predict(tau, linear) + curved


def _evaluate_two_cubics(tau: Points) -> Points:
    """Return the values (s, 2) at tau (s,) of two cubics that are 0 at tau 0 and 1."""
    bow = tau * (1 - tau)
    return np.column_stack([bow, bow * (1 - 2 * tau)])


def build_subcycles(
    film: GaitContours, keys: Keys, split: float, descriptor: Descriptor
) -> dict[SubcycleKey, Subcycle]:
    """Return all subcycles of a film, by contour and letter (A … D).

    keys: two key frames, or four without symmetry; split: phase of key 2, in cycles; descriptor:
    how contours become coefficients.
    """
    samples = sort_into_subcycles(film, split, descriptor)
    return _join_keys_and_samples(film, keys, samples, descriptor)


def _join_keys_and_samples(
    film: GaitContours,
    keys: Keys,
    samples: Mapping[SubcycleKey, SubcycleFrames],
    descriptor: Descriptor,
) -> dict[SubcycleKey, Subcycle]:
    """Return the subcycles of each contour, made of its key frames and its film frames."""
    four_keys = four_key_frames(keys, film.symmetry, film.layout)
    letters = LETTERS[film.symmetry]
    subcycles = {}
    for (name, letter), frames in samples.items():
        number = letters.index(letter)
        ends = four_keys[number][name], four_keys[(number + 1) % 4][name]
        start, end = (descriptor.coefficients(contour) for contour in ends)
        subcycles[name, letter] = Subcycle(frames, start, end, descriptor.scales(len(start)))
    return subcycles


def _nest_tuples(values: Points) -> tuple[Any, ...]:
    """Return an array as nested tuples of plain numbers, as a `Gait` holds them."""
    return tuple(tuple(row) if isinstance(row, list) else row for row in values.tolist())


def fit_key_frames(
    film: GaitContours, split: float, descriptor: Descriptor
) -> tuple[list[dict[str, Points]], dict[SubcycleKey, Subcycle]]:
    """Return a film's key frames, corrected for curved motion, and the subcycles between them.

    Linear interpolation of the keys (`interpolate_key_frames`) flattens the curved motion between
    film frames. A smooth model of the film, a cubic for each coefficient of each subcycle, shows by
    how much. This error is subtracted, in ROUNDS rounds. A frame exactly at a key's phase stays
    that key.
    split: phase of key 2, in cycles; descriptor: how contours become coefficients. FinloopError if
    no frame near a key, or fewer than LEAST frames in a subcycle, show a contour.
    """
    samples = sort_into_subcycles(film, split, descriptor)
    _refuse_few_frames(samples)
    linear = keys = interpolate_key_frames(film, split)
    subcycles = _join_keys_and_samples(film, keys, samples, descriptor)
    for _ in range(ROUNDS):
        smooth = _fit_smooth_contours(film, subcycles, split, descriptor)
        # The key frames are exact in the model, so its interpolation differs by the error alone.
        flattened = interpolate_key_frames(replace(film, contours=smooth), split)
        keys = [
            {name: key[name] + straight[name] - flat[name] for name in key}
            for key, straight, flat in zip(keys, linear, flattened, strict=True)
        ]
        subcycles = _join_keys_and_samples(film, keys, samples, descriptor)
    return keys, subcycles


def _refuse_few_frames(samples: Mapping[SubcycleKey, SubcycleFrames]) -> None:
    """Raise FinloopError if fewer than LEAST frames show a contour between two key frames."""
    few = [
        f"{name!r} in {letter}"
        for (name, letter), frames in samples.items()
        if ((frames.tau > 1e-6) & (frames.tau < 1 - 1e-6)).sum() < LEAST  # none at a key counts
    ]
    if few:
        raise FinloopError(
            f"fewer than {LEAST} frames between the keys show {', '.join(few)}",
            f"{LEAST} or more of each contour in each subcycle",
            "use more cycles or a higher frame rate, or omit these contours",
        )


def _fit_smooth_contours(
    film: GaitContours,
    subcycles: Mapping[SubcycleKey, Subcycle],
    split: float,
    descriptor: Descriptor,
) -> dict[str, Points]:
    """Return a film's contours smoothed in time by one cubic for each coefficient and subcycle.

    The cubics go through the key frames. NaN stays NaN. split: phase of key 2, in cycles;
    descriptor: how contours become coefficients.
    """
    subcycle, tau = film.locate_in_subcycle(split)
    smooth = dict[str, Points]()
    for name, points in film.contours.items():
        smooth[name] = np.empty_like(points)
        for number, letter in enumerate(LETTERS[film.symmetry]):
            frames = subcycle == number
            coefficients = subcycles[name, letter].smooth(tau[frames])
            smooth[name][frames] = descriptor.contours(coefficients, points.shape[1])
    smooth = film.exchange_second_half(smooth)
    return {
        name: np.where(np.isfinite(points), smooth[name], np.nan)
        for name, points in film.contours.items()
    }


def fit_gait(
    film: GaitContours,
    name: str,
    frequency_hz: float,
    *,
    split: float = 0.25,
    wavelet: str = "coif2",
    coarse: int = 4,
    sharing: Sharing = "limb",
) -> tuple[Gait, list[dict[str, Points]]]:
    """Return the gait that fits the contours of a film, and its key frames 1 and 2.

    Without symmetry there are 1' and 2', too.

    name: of the gait; split: phase of key 2, in cycles; wavelet, coarse: of the `Descriptor`;
    sharing: what has a γ of its own, see `Subcycle.fit_gammas`. The one γ of POOLED belongs to all
    contours together. `source`, `confidence` and `residuals` are not filled in. FinloopError if the
    film shows too little of a cycle, its phase does not rise, it shows a contour in too few frames,
    or the wavelet is not orthogonal.
    """
    check_phases(film)
    if not find_wavelet(wavelet).orthogonal:
        raise FinloopError(
            f"the wavelet {wavelet} is not orthogonal",
            "an orthogonal wavelet: only then does a coefficient weigh as the points that it moves",
            "set gait.wavelet to coif2, db4 or sym8",
        )
    keys, subcycles = fit_key_frames(film, split, Descriptor(wavelet, coarse))
    gamma: dict[str, dict[str, Any]] = {name: {} for name in (*film.contours, POOLED)}
    motion: dict[str, dict[str, Any]] = {name: {} for name in film.contours}
    for (limb, letter), subcycle in subcycles.items():
        gammas = subcycle.fit_gammas(sharing, LEAST_MOTION * film.body_length)
        gamma[limb][letter] = _nest_tuples(gammas)
        motion[limb][letter] = _nest_tuples(subcycle.motion_shares(sharing))
    for letter in LETTERS[film.symmetry]:
        fractions = [subcycles[limb, letter].gamma_fraction() for limb in film.contours]
        pooled = gamma_from_fractions(fractions)
        gamma[POOLED][letter] = (min(max(pooled, -MOST_GAMMA), MOST_GAMMA),)
    gait = Gait(
        name=name,
        symmetry=film.symmetry,
        frequency_hz=frequency_hz,
        gamma=gamma,
        motion={} if sharing == "limb" else motion,  # one γ needs no weight
        split=split,
        wavelet=wavelet,
        coarse=coarse,
        cycles=film.cycles,
        frames=len(film.phase),
    )
    if film.symmetry == "swap":
        gait = replace(gait, support=_ground_contact_of_walk(film, keys, gait))
    if film.symmetry == "none":
        gait = replace(gait, support=_ground_contact_in_film(film))
    return gait, keys


def _has_foot(name: str) -> bool:
    """Return whether a contour is a limb with a foot: its id contains a side."""
    return "left" in name or "right" in name


def _ground_contact_of_walk(
    film: GaitContours, keys: Keys, gait: Gait
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return when each foot of a walk is on the ground: a span of phase, in cycles, by limb.

    In a walk a foot is down from its foremost to its hindmost place; the animal heads for screen
    right. A foot is the point of a limb that is lowest on average.
    """
    phases = np.arange(SUPPORT_STEPS) / SUPPORT_STEPS
    spans = dict[str, tuple[tuple[float, float], ...]]()
    for name, points in contours_at_phases(keys, gait, phases, film.layout).items():
        if _has_foot(name):
            lowest = int(points[..., 1].mean(axis=0).argmax())  # y points down
            foot_x = points[:, lowest, 0]
            start, stop = float(phases[foot_x.argmax()]), float(phases[foot_x.argmin()])
            spans[name] = ((start, stop if stop > start else stop + 1.0),)
    return spans


def _ground_contact_in_film(film: GaitContours) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return when each foot is seen on the ground: a span of phase, in cycles, by limb.

    A lifted foot may move back, too, as in a gallop. So a foot is down in a frame if it moves back,
    the animal heading for screen right, and is no higher above the ground than a share LOW of the
    limb's height. Such frames hold for half a step before and after; the longest span counts. A
    limb that no frame shows on the ground has none.
    """
    step = float(np.median(np.diff(film.phase)))
    moments = np.arange(SUPPORT_STEPS) / SUPPORT_STEPS
    offset = moments[:, None] - film.phase
    is_near = np.abs(offset - np.round(offset)) <= step / 2 + ROUNDING  # (moments, frames)
    spans = dict[str, tuple[tuple[float, float], ...]]()
    for name, points in film.contours.items():
        shown = np.isfinite(points).all(axis=(1, 2))
        if not _has_foot(name) or shown.sum() < 2:
            continue
        limb = points[shown]
        y = limb[..., 1]  # points down
        bottom, height = y.max(axis=1), np.median(np.ptp(y, axis=1))
        foot_x = limb[:, int(y.mean(axis=0).argmax()), 0]
        moves_back = np.gradient(foot_x, film.phase[shown]) < 0
        is_low = bottom >= np.quantile(bottom, GROUND) - LOW * height
        votes = is_near[:, shown].astype(float)
        down = (votes @ (is_low & moves_back)) > votes.sum(axis=1) / 2
        if down.any() and not down.all():
            start, count = _longest_run(down)
            spans[name] = ((start / SUPPORT_STEPS, (start + count) / SUPPORT_STEPS),)
    return spans


def _longest_run(mask: Mask) -> tuple[int, int]:
    """Return start and length of the longest run of True in a mask that repeats, (frames,).

    The mask is neither true nor false everywhere.
    """
    edges = np.flatnonzero(mask != np.roll(mask, 1))  # where a run begins
    lengths = np.diff(edges, append=edges[0] + len(mask))
    longest = np.where(mask[edges], lengths, 0).argmax()
    return int(edges[longest]), int(lengths[longest])
