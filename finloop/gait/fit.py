"""A gait from the contours of a film: its key frames and γ (curve paper §4.2, Figs. 9 to 11).

The contours are sorted into the cycle of the gait. By symmetry every frame counts in the first half
of the cycle: frames of C and D are the partner's frames of A and B. γ is fitted over the frames of
a subcycle, see `gait.model`: one for a limb, a scale, a coefficient or a coordinate.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from finloop.base.arrays import Mask, Points
from finloop.base.errors import FinloopError
from finloop.gait.model import (
    MOST_GAMMA,
    POOLED,
    SHARINGS,
    Descriptor,
    Gait,
    HalfCycleLayout,
    Symmetry,
    contours_at_phases,
    contours_half_cycle_later,
    gamma_fraction,
    gamma_from_fractions,
    locate_in_subcycle,
    opposite_limb,
    start_share,
)
from finloop.gait.settings import Sharing

WIDEST = 0.125
"""Cycles: largest distance in phase of a frame that stands in for a key, or one frame if longer."""
SubcycleKey = tuple[str, str]
"""A subcycle of a contour: its id, and "A" or "B"."""
LEAST = 2  # fewest frames between the keys of a subcycle
ROUNDS = 3
"""Rounds of `fit_key_frames`. They bring γ of the drawn dog within 6 % at any frame rate, from
44 % without correction. With more rounds the cubics follow the noise of few frames."""
LEAST_MOTION = 1e-5
"""Body lengths, RMS over the contour: what moves less between the keys has its parent's γ.

A γ is the bend of a course divided by its length; of a coordinate that hardly moves it is noise.
"""


@dataclass(frozen=True)
class GaitContours:
    """Outlines of an animal, relative to its body, with the phase of its gait in every frame."""

    # closed, (frames, n, 2) by id, n a power of two; NaN in frames without the contour. With
    # symmetry "mirror" they begin at the snout
    contours: Mapping[str, Points]
    phase: Points  # (frames,) in cycles, rising; the whole part counts the cycles
    body_length: float  # in the unit of the contours
    symmetry: Symmetry  # what half a cycle later is like, see `gait.model`
    # (2,) by id: how much farther right and down a limb hangs than its left-right partner
    offsets: Mapping[str, Points] | None = None

    def contours_half_cycle_later(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Return the contours, by id, that the animal has half a cycle later, by its symmetry."""
        return contours_half_cycle_later(
            contours, self.symmetry, HalfCycleLayout(offsets=self.offsets)
        )

    def add_hidden_limbs(self) -> "GaitContours":
        """Return the film with a contour of NaN for each limb that is hidden in all frames.

        That is a left limb whose right partner is shown, or the other way round; later it follows
        from the partner by symmetry. A film of symmetry "mirror", a fish, is returned unchanged.
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
        """Number of gait cycles that the film shows: frames times the median step of phase."""
        return float(len(self.phase) * np.median(np.diff(self.phase)))


@dataclass(frozen=True)
class KeyFrames:
    """The key frames 1, 2 and 1' (half a cycle after 1) of a gait: contours (n, 2) by id."""

    first: dict[str, Points]
    second: dict[str, Points]
    first_later: dict[str, Points]


def check_phases(film: GaitContours) -> None:
    """Raise FinloopError if the film covers less than half a cycle, or its phase does not rise."""
    if len(film.phase) < 3 or (np.diff(film.phase) <= 0).any():
        raise FinloopError(
            f"{len(film.phase)} frames whose phase does not always rise",
            "at least 3 frames, each later in the cycle than the previous frame",
            "use a longer film, or find its period again",
        )
    if film.cycles < 0.5:
        raise FinloopError(
            f"{len(film.phase)} frames show {film.cycles:.2f} of a cycle",
            "at least half a cycle: the other half follows by symmetry",
            "use a longer film",
        )


def partner_offsets(film: GaitContours) -> dict[str, Points]:
    """Return how far right and down of its left-right partner each limb hangs: (2,) by id.

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


def interpolate_key_frames(film: GaitContours, split: float) -> KeyFrames:
    """Return the gait's key frames 1, 2 and 1', interpolated from the frames nearest in phase.

    split: phase of key 2, in cycles. All cycles and both halves count. FinloopError if a contour is
    missing in every frame near a key; the message names all such contours.
    """
    first, second = _interpolate_key(film, 0.0), _interpolate_key(film, split)
    missing = [
        f"{name!r} near key {number}"
        for number, key in enumerate((first, second), start=1)
        for name in film.contours
        if name not in key
    ]
    if missing:
        raise FinloopError(
            f"no frame shows {', '.join(missing)}",
            f"each contour in a frame within {WIDEST:g} of a cycle of both keys",
            "use more cycles, or omit the contours that the film does not show",
        )
    return KeyFrames(first, second, film.contours_half_cycle_later(first))


def _interpolate_key(film: GaitContours, key_phase: float) -> dict[str, Points]:
    """Return the contours (n, 2), by id, at a key's phase, from the frames nearest in phase.

    Frames half a cycle from the key count with the symmetric pose. Contours that no frame near the
    key shows are left out.
    """
    later = film.contours_half_cycle_later(film.contours)
    step = float(np.median(np.diff(film.phase)))  # cycles from frame to frame
    half_cycles = np.round((film.phase - key_phase) / 0.5)  # from the key to the frame, whole
    shows_key = (half_cycles % 2 == 0)[:, None, None]  # else the symmetric pose does
    distance = np.abs(film.phase - key_phase - 0.5 * half_cycles)
    key = dict[str, Points]()
    for name, points in film.contours.items():
        poses = np.where(shows_key, points, later[name])
        shown = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
        weight = _weights_near_key(distance, shown, step)
        if weight.any():
            key[name] = np.tensordot(weight[shown] / weight.sum(), poses[shown], axes=1)
    return key


def _weights_near_key(distance: Points, shown: Mask, width: float) -> Points:
    """Return the weights (frames,) of frames in a key: 1 at the key, linearly to 0 at `width`.

    distance (frames,): from the key, in cycles, as `width` is; shown: which frames count. While all
    weights are 0 the width doubles, up to WIDEST; with that, too, they may all be 0.
    """
    weight = np.clip(1 - distance / width, 0, None) * shown
    if weight.any() or width >= WIDEST:
        return weight
    return _weights_near_key(distance, shown, min(2 * width, WIDEST))


@dataclass(frozen=True)
class SubcycleFrames:
    """The s frames of a film that show one contour in one subcycle, between two key frames.

    tau (s,): shares 0-1 of the subcycle; coefficients (s, n, 2): of the contour.
    """

    tau: Points
    coefficients: Points


def sort_into_subcycles(
    film: GaitContours, split: float, descriptor: Descriptor
) -> dict[SubcycleKey, SubcycleFrames]:
    """Return a film's frames, sorted by contour and by subcycle, A or B.

    A lies between keys 1 and 2, B between 2 and 1'. Frames in C and D, the second half of the
    cycle, count in A and B with the symmetric pose. split: phase of key 2, in cycles; descriptor:
    how contours become coefficients.
    """
    later = film.contours_half_cycle_later(film.contours)
    in_second_half = (np.mod(film.phase, 1.0) >= 0.5)[:, None, None]
    subcycle, tau = locate_in_subcycle(np.mod(film.phase, 0.5), split)
    samples = dict[SubcycleKey, SubcycleFrames]()
    for name, points in film.contours.items():
        poses = np.where(in_second_half, later[name], points)
        shown = np.isfinite(poses).all(axis=(1, 2))
        for number, letter in enumerate("AB"):
            frames = shown & (subcycle == number)
            coefficients = descriptor.coefficients(poses[frames])
            samples[name, letter] = SubcycleFrames(tau[frames], coefficients)
    return samples


@dataclass(frozen=True)
class Subcycle:
    """A contour between two key frames: wavelet coefficients of the keys and of film frames."""

    samples: SubcycleFrames  # the film's frames in the subcycle
    # start, end: the key frames at both ends, (n, 2)
    start: Points
    end: Points
    scales: list[slice]  # the slice of each scale in the n coefficients

    def gamma_fraction(self) -> tuple[Points, Points]:
        """Return numerators and denominators (n, 2) of γ for each coordinate of a coefficient."""
        samples = self.samples
        return gamma_fraction(samples.tau, samples.coefficients, self.start, self.end)

    def fit_gammas(self, sharing: Sharing, least_motion: float) -> Points:
        """Return the fitted gait parameters γ of whatever has one by `sharing`.

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
        """Return how far whatever has a γ moves between the keys, as a share of the contour's way.

        The result has the shape of `fit_gammas`. Its squares add up to 1, or to 0 at rest.
        """
        squares = (self.start - self.end) ** 2
        total = max(float(squares.sum()), 1e-300)  # never divide by 0
        return np.asarray(np.sqrt(self._sum_sharers(squares, sharing) / total))

    def _sum_sharers(self, parts: Points, sharing: Sharing) -> Points:
        """Return the sums of parts (n, 2), one per coordinate, over those that share a γ.

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
        """Return the wavelet coefficients (s, n, 2) that γ predicts at tau (s,).

        tau: shares 0-1 of the subcycle's time; gamma: of each coefficient, (n, 1), of each of its
        coordinates, (n, 2), or of all, (1,).
        """
        return self.end + start_share(tau[:, None, None], gamma) * (self.start - self.end)

    def smooth(self, tau: Points) -> Points:
        """Return the wavelet coefficients (s, n, 2) at tau (s,) of cubics that fit the frames best.

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
    """Return the values (s, 2), at tau (s,), of two cubics that are 0 at τ = 0 and 1."""
    bow = tau * (1 - tau)
    return np.column_stack([bow, bow * (1 - 2 * tau)])


def build_subcycles(
    keys: KeyFrames, samples: Mapping[SubcycleKey, SubcycleFrames], descriptor: Descriptor
) -> dict[SubcycleKey, Subcycle]:
    """Return the subcycles A and B of each contour, between its key frames.

    samples: from `sort_into_subcycles`; descriptor: how contours become coefficients.
    """
    ends = {"A": (keys.first, keys.second), "B": (keys.second, keys.first_later)}
    subcycles = {}
    for (name, letter), frames in samples.items():
        start, end = (descriptor.coefficients(key[name]) for key in ends[letter])
        subcycles[name, letter] = Subcycle(frames, start, end, descriptor.scales(len(start)))
    return subcycles


def _nest_tuples(values: Points) -> tuple[Any, ...]:
    """Return an array as nested tuples of plain numbers, as a `Gait` holds them."""
    return tuple(tuple(row) if isinstance(row, list) else row for row in values.tolist())


def fit_key_frames(
    film: GaitContours, split: float, descriptor: Descriptor
) -> tuple[KeyFrames, dict[SubcycleKey, Subcycle]]:
    """Return a film's key frames, and the subcycles between them.

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
    subcycles = build_subcycles(keys, samples, descriptor)
    for _ in range(ROUNDS):
        smooth = _fit_smooth_contours(film, subcycles, split, descriptor)
        # The key frames are exact in the model, so its interpolation differs by the error alone.
        flattened = interpolate_key_frames(replace(film, contours=smooth), split)
        first, second = dict[str, Points](), dict[str, Points]()
        for name in keys.first:
            first[name] = keys.first[name] + linear.first[name] - flattened.first[name]
            second[name] = keys.second[name] + linear.second[name] - flattened.second[name]
        keys = KeyFrames(first, second, film.contours_half_cycle_later(first))
        subcycles = build_subcycles(keys, samples, descriptor)
    return keys, subcycles


def _refuse_few_frames(samples: Mapping[SubcycleKey, SubcycleFrames]) -> None:
    """Raise FinloopError if fewer than LEAST frames between two keys show a contour."""
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
    """Return the film's contours smoothed in time, each coefficient a cubic between the key frames.

    The cubics go through the key frames. NaN stays NaN. split: phase of key 2, in cycles;
    descriptor: how contours become coefficients.
    """
    # At first every frame counts as one of the first half of the cycle: in A or B.
    subcycle, tau = locate_in_subcycle(np.mod(film.phase, 0.5), split)
    first_half = dict[str, Points]()
    for name, points in film.contours.items():
        first_half[name] = np.empty_like(points)
        for number, letter in enumerate("AB"):
            frames = subcycle == number
            coefficients = subcycles[name, letter].smooth(tau[frames])
            first_half[name][frames] = descriptor.contours(coefficients, points.shape[1])
    later = film.contours_half_cycle_later(first_half)
    in_second_half = (np.mod(film.phase, 1.0) >= 0.5)[:, None, None]
    smooth = dict[str, Points]()
    for name, points in film.contours.items():
        poses = np.where(in_second_half, later[name], first_half[name])
        smooth[name] = np.where(np.isfinite(points), poses, np.nan)
    return smooth


def fit_gait(
    film: GaitContours,
    name: str,
    frequency_hz: float,
    *,
    split: float = 0.25,
    wavelet: str = "coif2",
    coarse: int = 4,
    sharing: Sharing = "limb",
) -> tuple[Gait, KeyFrames]:
    """Return the gait that fits the contours of a film, and its key frames.

    name: of the gait; split: phase of key 2, in cycles; wavelet, coarse: of the `Descriptor`;
    sharing: what has a γ of its own, see `Subcycle.fit_gammas`. The one γ of POOLED belongs to all
    contours together. `source`, `confidence` and `residuals` are not filled in. FinloopError if the
    film shows less than half a cycle, its phase does not rise, or it shows a contour in too few
    frames.
    """
    check_phases(film)
    keys, subcycles = fit_key_frames(film, split, Descriptor(wavelet, coarse))
    gamma: dict[str, dict[str, Any]] = {name: {} for name in (*film.contours, POOLED)}
    motion: dict[str, dict[str, Any]] = {name: {} for name in film.contours}
    for (limb, letter), subcycle in subcycles.items():
        gammas = subcycle.fit_gammas(sharing, LEAST_MOTION * film.body_length)
        gamma[limb][letter] = _nest_tuples(gammas)
        motion[limb][letter] = _nest_tuples(subcycle.motion_shares(sharing))
    for letter in "AB":
        fractions = [subcycles[limb, letter].gamma_fraction() for limb in film.contours]
        gamma[POOLED][letter] = (gamma_from_fractions(fractions),)
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
    if film.symmetry == "mirror":
        return gait, keys
    return replace(gait, support=_ground_contact_phases(film, keys, gait)), keys


def _ground_contact_phases(
    film: GaitContours, keys: KeyFrames, gait: Gait
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return when each foot is on the ground: by id, one span (from, to) of phase, in cycles.

    A foot is down from its foremost to its hindmost place; the animal heads for screen right. Only
    contours with "left" or "right" in their id have a foot: the point that is lowest on average.
    """
    phases = np.arange(240) / 240
    spans = dict[str, tuple[tuple[float, float], ...]]()
    layout = HalfCycleLayout(offsets=film.offsets)
    for name, points in contours_at_phases(keys.first, keys.second, gait, phases, layout).items():
        if "left" in name or "right" in name:
            lowest = int(points[..., 1].mean(axis=0).argmax())  # y points down
            foot_x = points[:, lowest, 0]
            start, stop = float(phases[foot_x.argmax()]), float(phases[foot_x.argmin()])
            spans[name] = ((start, stop if stop > start else stop + 1.0),)
    return spans
