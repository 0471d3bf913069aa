"""A gait from the contours of a film: its key frames and γ (curve paper §4.2, Figs. 9 to 11).

The contours are sorted into the cycle of the gait. By symmetry every frame counts in the first half
of the cycle: frames of C and D are the partner's frames of A and B. γ is fitted over the frames of
a subcycle, see `gait.model`. The inner products run over the coefficients of one scale, or of all
scales together, each weighted by its energy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Ints, Points
from finloop.base.errors import FinloopError
from finloop.gait.model import (
    POOLED,
    Gait,
    HalfCycleLayout,
    Symmetry,
    contour_from_descriptor,
    contours_half_cycle_later,
    contours_of_cycle,
    descriptor_slices,
    gamma_fraction,
    gamma_from_fractions,
    key_1_share,
    locate_in_subcycle,
    opposite_limb,
    wavelet_descriptor,
)

WIDEST = 0.125
"""Cycles: largest distance in phase of a frame that stands in for a key, or one frame if longer."""
Gammas = dict[str, dict[str, tuple[float, ...]]]
LEAST = 2  # fewest frames between the keys of a subcycle
ROUNDS = 3
"""Rounds of `correct_key_frames`. They bring γ of the drawn dog within 6 % at any frame rate, from
44 % without correction. With more rounds the cubics follow the noise of few frames."""
LEAST_MOTION = 1e-9  # body lengths: a scale that moves less between the keys gets γ = 0


@dataclass(frozen=True)
class GaitContours:
    """Outlines of an animal, relative to its body, with the phase of its gait in every frame."""

    # closed, (frames, n, 2) by id, n a power of two; NaN in frames without the contour. With
    # symmetry "mirror" they begin at the snout
    contours: Mapping[str, Points]
    phase: Points  # (frames,) in cycles, rising; the whole part counts the cycles
    body_length: float  # in the unit of the contours
    # symmetry, offsets: as in `gait.model.HalfCycleLayout`
    symmetry: Symmetry
    offsets: Mapping[str, Points] | None = None

    def contours_half_cycle_later(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Return the contours, by id, that the animal has half a cycle later, by its symmetry."""
        return contours_half_cycle_later(
            contours, self.symmetry, HalfCycleLayout(offsets=self.offsets)
        )

    def add_hidden_limbs(self) -> "GaitContours":
        """Return the film with NaN for limbs that it never shows; a fish is left unchanged.

        Later a hidden limb follows from its partner by symmetry, see `gait.model.opposite_limb`.
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

    In the unit of the contours. It is the mean difference between a limb and its partner half a
    cycle later, when both are at the same point of their motion. 0 if the film is shorter than a
    cycle, or lacks one of the two limbs.
    """
    out = {name: np.zeros(2) for name in film.contours}
    if film.cycles < 1 - 1e-6:
        return out
    centre = {name: points.mean(axis=1) for name, points in film.contours.items()}
    for name, here in centre.items():
        twin = opposite_limb(name, film.contours)
        if name < twin:
            own, twins = (np.isfinite(centre[limb]).all(axis=1) for limb in (name, twin))
            if own.any() and twins.any():
                phase = film.phase[own] + 0.5
                there = [
                    np.interp(phase, film.phase[twins], centre[twin][twins, k], period=1.0)
                    for k in range(2)
                ]
                out[name] = (here[own] - np.column_stack(there)).mean(axis=0)
                out[twin] = -out[name]
    return out


def interpolate_key_frames(film: GaitContours, split: float) -> KeyFrames:
    """Interpolate the gait's key frames 1, 2 and 1' from the film's frames nearest in phase.

    split: phase of key 2, in cycles. All cycles and both halves count. Weights fall linearly to 0
    at one frame's step from the key's phase. Missing frames widen the weights up to WIDEST. For the
    error of the interpolation see `gait.fit.correct_key_frames`. FinloopError if a contour is
    missing in every frame near a key; the message names all such contours.
    """
    phase, here = film.phase, film.contours
    there = film.contours_half_cycle_later(here)
    step = float(np.median(np.diff(phase)))
    keys: list[dict[str, Points]] = []
    lacking = []
    for number, key_phase in enumerate((0.0, split), start=1):
        halves = np.round((phase - key_phase) / 0.5)
        apart = np.abs(phase - key_phase - 0.5 * halves)
        key = dict[str, Points]()
        for name, points in here.items():
            nearby = np.where((halves % 2 == 0)[:, None, None], points, there[name])
            present = np.isfinite(nearby).all(axis=(1, 2))
            width = step
            while not (weight := np.clip(1 - apart / width, 0, None) * present).any():
                if width >= WIDEST:
                    lacking.append(f"{name!r} near key {number}")
                    break
                width = min(2 * width, WIDEST)
            else:
                key[name] = np.tensordot(weight[present] / weight.sum(), nearby[present], 1)
        keys.append(key)
    if lacking:
        raise FinloopError(
            f"no frame shows {', '.join(lacking)}",
            f"each contour in a frame within {WIDEST:g} of a cycle of both keys",
            "use more cycles, or omit the contours that the film does not show",
        )
    return KeyFrames(keys[0], keys[1], film.contours_half_cycle_later(keys[0]))


@dataclass(frozen=True)
class SubcycleFrames:
    """The s frames of a film that show one contour in one subcycle, between two key frames.

    tau (s,): shares 0-1 of the subcycle; coefficients (s, n, 2): of the contour; frame (s,):
    numbers of the frames in the film.
    """

    tau: Points
    coefficients: Points
    frame: Ints


def sort_into_subcycles(
    film: GaitContours, split: float, wavelet: str, coarse: int
) -> dict[str, list[SubcycleFrames]]:
    """Sort a film's frames into subcycles, between key frames: by contour id, those in A and in B.

    By symmetry they include the frames of C and D. split: phase of key 2, in cycles; wavelet: of
    the descriptor; coarse: coefficients of its coarsest scale.
    """
    later = film.contours_half_cycle_later(film.contours)
    second = np.mod(film.phase, 1.0) >= 0.5
    which, tau = locate_in_subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, list[SubcycleFrames]]()
    for name, points in film.contours.items():
        points = np.where(second[:, None, None], later[name], points)
        present = np.isfinite(points).all(axis=(1, 2))
        out[name] = []
        for sub in range(2):
            frame = np.flatnonzero(present & (which == sub))
            coefficients = wavelet_descriptor(points[frame], wavelet, coarse)
            out[name].append(SubcycleFrames(tau[frame], coefficients, frame))
    return out


@dataclass(frozen=True)
class Subcycle:
    """A contour between two key frames: wavelet coefficients of the keys and of film frames."""

    samples: SubcycleFrames  # the film's frames in the subcycle
    # start, end: the key frames at both ends, (n, 2)
    start: Points
    end: Points
    scales: list[slice]  # the slice of each scale in the n coefficients

    def gamma_fraction(self, scale: slice = slice(None)) -> tuple[float, float]:
        """Return the gait parameter γ of some coefficients as numerator and denominator.

        Fractions of several sets can be summed, see `gamma_from_fractions`. scale: the slice.
        """
        frames = self.samples.coefficients[:, scale].reshape(len(self.samples.tau), -1)
        return gamma_fraction(
            self.samples.tau, frames, self.start[scale].ravel(), self.end[scale].ravel()
        )

    def gammas(self, per_scale: bool, still: float) -> tuple[float, ...]:
        """Fit the gait parameter γ: return one per scale, coarse to fine, or one for all scales.

        still: γ is 0 where points move less than this (RMS), in the unit of the contours.
        """
        out = []
        for scale in self.scales if per_scale else [slice(None)]:
            distance = np.linalg.norm(self.start[scale].ravel() - self.end[scale].ravel())
            moves = distance > still * np.sqrt(len(self.start))
            out.append(gamma_from_fractions([self.gamma_fraction(scale)]) if moves else 0.0)
        return tuple(out)

    def predict(self, tau: Points, gamma: Points) -> Points:
        """Predict wavelet coefficients (s, n, 2) at tau (s,), shares 0-1 of the subcycle.

        gamma: (n,), one for each coefficient, or (1,) for all.
        """
        return self.end + key_1_share(tau[:, None], gamma)[..., None] * (self.start - self.end)


def build_subcycles(
    keys: KeyFrames, samples: Mapping[str, list[SubcycleFrames]], wavelet: str, coarse: int
) -> dict[tuple[str, int], Subcycle]:
    """Return, by contour id and number (0: A, 1: B), what lies between two key frames.

    samples: by contour id, the film's frames in A and those in B; wavelet, coarse as in
    `sort_into_subcycles`.
    """
    out = {}
    ends = keys.first, keys.second, keys.first_later
    for name, pair in samples.items():
        for sub, frames in enumerate(pair):
            start, end = (
                wavelet_descriptor(key[name], wavelet, coarse) for key in ends[sub : sub + 2]
            )
            out[name, sub] = Subcycle(frames, start, end, descriptor_slices(len(start), coarse))
    return out


def fit_all_gammas(
    subcycles: Mapping[tuple[str, int], Subcycle], per_scale: bool, still: float
) -> Gammas:
    """Fit gait parameters γ: return by id, then by "A" and "B", one per scale or one for all.

    still: γ is 0 where points move less than this (RMS), in the unit of the contours.
    """
    out: Gammas = {}
    for (name, sub), contour_subcycle in subcycles.items():
        out.setdefault(name, {})["AB"[sub]] = contour_subcycle.gammas(per_scale, still)
    return out


def correct_key_frames(
    film: GaitContours, split: float, wavelet: str, coarse: int
) -> tuple[KeyFrames, dict[tuple[str, int], Subcycle]]:
    """Interpolate key frames without flattening the curved motion between film frames.

    Return them and the subcycles between them, by (id, 0 for A or 1 for B). A smooth model of the
    film, a cubic for each coefficient of each subcycle, shows by how much linear interpolation
    (`interpolate_key_frames`) is wrong; ROUNDS times that is subtracted. A frame exactly at a key's
    phase stays that key. split, wavelet, coarse as in `sort_into_subcycles`. FinloopError as in
    `interpolate_key_frames`, or if a subcycle of a contour has fewer than LEAST frames between its
    keys.
    """
    samples = sort_into_subcycles(film, split, wavelet, coarse)
    few = [
        f"{name!r} in {'AB'[sub]}"
        for name, pair in samples.items()
        for sub, frames in enumerate(pair)
        if ((frames.tau > 1e-6) & (frames.tau < 1 - 1e-6)).sum() < LEAST
    ]
    if few:
        raise FinloopError(
            f"fewer than {LEAST} frames between the keys show {', '.join(few)}",
            f"{LEAST} or more of each contour in each subcycle",
            "use more cycles or a higher frame rate, or omit these contours",
        )
    linear = keys = interpolate_key_frames(film, split)
    subcycles = build_subcycles(keys, samples, wavelet, coarse)
    for _ in range(ROUNDS):
        model = replace(
            film, contours=_fit_smooth_contours(film, subcycles, split, wavelet, coarse)
        )
        short = interpolate_key_frames(model, split)
        first, second = (
            {name: key[name] + film_key[name] - model_key[name] for name in key}
            for key, film_key, model_key in (
                (keys.first, linear.first, short.first),
                (keys.second, linear.second, short.second),
            )
        )
        keys = KeyFrames(first, second, film.contours_half_cycle_later(first))
        subcycles = build_subcycles(keys, samples, wavelet, coarse)
    return keys, subcycles


def _fit_smooth_contours(
    film: GaitContours,
    subcycles: Mapping[tuple[str, int], Subcycle],
    split: float,
    wavelet: str,
    coarse: int,
) -> dict[str, Points]:
    """Return the film's contours smoothed in time, each coefficient a cubic between the key frames.

    NaN stays NaN. split, wavelet, coarse as in `sort_into_subcycles`.
    """
    which, tau = locate_in_subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, Points]()
    for name, points in film.contours.items():
        out[name] = np.empty_like(points)
        for sub in range(2):
            model, film_tau = subcycles[name, sub], tau[which == sub]
            sample_tau = model.samples.tau
            rest = model.samples.coefficients - model.predict(sample_tau, np.zeros(1))
            size = np.linalg.lstsq(
                _two_cubics(sample_tau), rest.reshape(len(rest), -1), rcond=None
            )[0]
            bend = (_two_cubics(film_tau) @ size).reshape(-1, *model.end.shape)
            coefficients = model.predict(film_tau, np.zeros(1)) + bend
            out[name][which == sub] = contour_from_descriptor(
                coefficients, points.shape[1], wavelet, coarse
            )
    later, second = film.contours_half_cycle_later(out), np.mod(film.phase, 1.0) >= 0.5
    return {
        name: np.where(
            np.isfinite(points), np.where(second[:, None, None], later[name], out[name]), np.nan
        )
        for name, points in film.contours.items()
    }


def _two_cubics(tau: Points) -> Points:
    """Evaluate two cubics that are 0 at τ = 0 and 1: return their values (s, 2) at tau (s,)."""
    bow = tau * (1 - tau)
    return np.column_stack([bow, bow * (1 - 2 * tau)])


def fit_gait(
    film: GaitContours,
    name: str,
    frequency_hz: float,
    *,
    split: float = 0.25,
    wavelet: str = "coif2",
    coarse: int = 4,
    per_scale: bool = False,
) -> tuple[Gait, KeyFrames]:
    """Fit a gait to the contours of a film; return the gait and its key frames.

    name: of the gait; split: phase of key 2, in cycles; wavelet: of the descriptor; coarse:
    coefficients of its coarsest scale; per_scale: fit one γ for each scale instead of one for all.
    The caller fills in the gait's `source`, `confidence` and `residuals`. The γ of POOLED belongs
    to all contours together. FinloopError as in `check_phases` and `correct_key_frames`.
    """
    check_phases(film)
    keys, subcycles = correct_key_frames(film, split, wavelet, coarse)
    still = LEAST_MOTION * film.body_length
    gamma = fit_all_gammas(subcycles, per_scale, still)
    for sub, letter in enumerate("AB"):
        fractions = [
            model.gamma_fraction() for (_, which), model in subcycles.items() if which == sub
        ]
        gamma.setdefault(POOLED, {})[letter] = (gamma_from_fractions(fractions),)
    gait = Gait(
        name=name,
        symmetry=film.symmetry,
        frequency_hz=frequency_hz,
        gamma=gamma,
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
    """Return when each foot is on the ground: spans of phase by id, as in `Gait.support`.

    A foot is down from its foremost to its hindmost place; the animal heads for screen right. A
    foot is the lowest point of a contour that has "left" or "right" in its id.
    """
    frames = 240
    out = dict[str, tuple[tuple[float, float], ...]]()
    layout = HalfCycleLayout(offsets=film.offsets)
    for name, points in contours_of_cycle(keys.first, keys.second, gait, frames, layout).items():
        if any(side in name for side in ("left", "right")):
            x = points[:, int(points[..., 1].mean(axis=0).argmax()), 0]
            start = int(x.argmax()) / frames
            stop = int(x.argmin()) / frames
            out[name] = ((start, stop if stop > start else stop + 1.0),)
    return out
