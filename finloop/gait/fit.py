"""A gait from the contours of a film: its key frames and γ (curve paper §4.2, Figs. 10, 11).

γ is fitted over the frames of a subcycle, see `gait.clock`. The inner products run over the
coefficients of one scale, or of all scales together, each weighted by its energy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.gait.clock import clock, gamma_fit, gamma_sums
from finloop.gait.descriptor import contour, descriptor, scale_slices
from finloop.gait.film import GaitContours, Keys, Samples, check_phases, keys_of, samples_of
from finloop.gait.model import POOLED, Gait, Layout, cycle, subcycle

Gammas = dict[str, dict[str, tuple[float, ...]]]
LEAST = 2  # fewest frames between the keys of a subcycle
ROUNDS = 3
"""Rounds of `corrected_keys`. They bring γ of the drawn dog within 6 % at any frame rate, from 44 %
without correction. With more rounds the cubics follow the noise of few frames."""
LEAST_MOTION = 1e-9  # body lengths: a scale that moves less between the keys gets γ = 0


@dataclass(frozen=True)
class Subcycle:
    """One contour in one subcycle, as n wavelet coefficients."""

    samples: Samples  # the film's frames in the subcycle
    # start, end: the key frames at both ends, (n, 2)
    start: Points
    end: Points
    scales: list[slice]  # the slice of each scale in the n coefficients

    def sums(self, scale: slice = slice(None)) -> tuple[float, float]:
        """Return numerator and denominator of γ (`gamma_sums`) for a scale, by default for all."""
        frames = self.samples.coefficients[:, scale].reshape(len(self.samples.tau), -1)
        return gamma_sums(
            self.samples.tau, frames, self.start[scale].ravel(), self.end[scale].ravel()
        )

    def gammas(self, per_scale: bool, still: float) -> tuple[float, ...]:
        """Return one γ per scale, coarse to fine, or a single one for all scales.

        still: γ is 0 where points move less than this (RMS), in the unit of the contours.
        """
        out = []
        for scale in self.scales if per_scale else [slice(None)]:
            way = np.linalg.norm(self.start[scale].ravel() - self.end[scale].ravel())
            moves = way > still * np.sqrt(len(self.start))
            out.append(gamma_fit([self.sums(scale)]) if moves else 0.0)
        return tuple(out)

    def predict(self, tau: Points, gamma: Points) -> Points:
        """Return the predicted coefficients (s, n, 2) at tau (s,), shares 0-1 of the subcycle.

        gamma: (n,), one for each coefficient, or (1,) for all.
        """
        return self.end + clock(tau[:, None], gamma)[..., None] * (self.start - self.end)


def subcycles_of(
    keys: Keys, samples: Mapping[str, list[Samples]], wavelet: str, coarse: int
) -> dict[tuple[str, int], Subcycle]:
    """Return every contour in subcycles A (0) and B (1), with key (id, 0 or 1).

    samples: by id, the frames in A and in B.
    """
    out = {}
    for name, pair in samples.items():
        for sub, frames in enumerate(pair):
            start, end = (descriptor(key, wavelet, coarse) for key in keys.ends(name, sub))
            out[name, sub] = Subcycle(frames, start, end, scale_slices(len(start), coarse))
    return out


def gammas_of(
    subcycles: Mapping[tuple[str, int], Subcycle], per_scale: bool, still: float
) -> Gammas:
    """Return γ of every contour, by id and then by "A" and "B": one per scale, or one for all.

    still: γ is 0 where points move less than this (RMS), in the unit of the contours.
    """
    out: Gammas = {}
    for (name, sub), contour_subcycle in subcycles.items():
        out.setdefault(name, {})["AB"[sub]] = contour_subcycle.gammas(per_scale, still)
    return out


def _check_samples(samples: Mapping[str, list[Samples]]) -> None:
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


def corrected_keys(
    film: GaitContours, split: float, wavelet: str, coarse: int
) -> tuple[Keys, dict[tuple[str, int], Subcycle]]:
    """Return key frames corrected for the curvature of the motion, and the subcycles between them.

    The subcycles have keys (id, 0 for A or 1 for B). `keys_of` interpolates linearly between the
    frames beside a key, which flattens the curved motion. A model of the film, a cubic for each
    coefficient of each subcycle, gives the error: the same interpolation of the model is off by as
    much. ROUNDS times that difference is subtracted. A frame exactly at a key's phase stays that
    key. FinloopError as in `keys_of`, or if a subcycle of a contour has fewer than LEAST frames
    between its keys.
    """
    samples = samples_of(film, split, wavelet, coarse)
    _check_samples(samples)
    linear = keys = keys_of(film, split)
    subcycles = subcycles_of(keys, samples, wavelet, coarse)
    for _ in range(ROUNDS):
        model = replace(film, contours=_smooth(film, subcycles, split, wavelet, coarse))
        short = keys_of(model, split)
        first, second = (
            {name: key[name] + film_key[name] - model_key[name] for name in key}
            for key, film_key, model_key in (
                (keys.first, linear.first, short.first),
                (keys.second, linear.second, short.second),
            )
        )
        keys = Keys(first, second, film.contours_half_cycle_later(first))
        subcycles = subcycles_of(keys, samples, wavelet, coarse)
    return keys, subcycles


def _smooth(
    film: GaitContours,
    subcycles: Mapping[tuple[str, int], Subcycle],
    split: float,
    wavelet: str,
    coarse: int,
) -> dict[str, Points]:
    """Return the film's contours, each coefficient a cubic between the keys; NaN stays NaN."""
    which, tau = subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, Points]()
    for name, points in film.contours.items():
        out[name] = np.empty_like(points)
        for sub in range(2):
            model, own_tau = subcycles[name, sub], tau[which == sub]
            sample_tau = model.samples.tau
            rest = model.samples.coefficients - model.predict(sample_tau, np.zeros(1))
            size = np.linalg.lstsq(_bends(sample_tau), rest.reshape(len(rest), -1), rcond=None)[0]
            bend = (_bends(own_tau) @ size).reshape(-1, *model.end.shape)
            coefficients = model.predict(own_tau, np.zeros(1)) + bend
            out[name][which == sub] = contour(coefficients, points.shape[1], wavelet, coarse)
    later, second = film.contours_half_cycle_later(out), np.mod(film.phase, 1.0) >= 0.5
    return {
        name: np.where(
            np.isfinite(points), np.where(second[:, None, None], later[name], out[name]), np.nan
        )
        for name, points in film.contours.items()
    }


def _bends(tau: Points) -> Points:
    """Return the two cubics that are 0 at τ = 0 and 1, at tau (s,): (s, 2)."""
    bow = tau * (1 - tau)
    return np.column_stack([bow, bow * (1 - 2 * tau)])


def fit(
    film: GaitContours,
    name: str,
    frequency_hz: float,
    *,
    split: float = 0.25,
    wavelet: str = "coif2",
    coarse: int = 4,
    per_scale: bool = False,
) -> tuple[Gait, Keys]:
    """Fit a gait to the contours of a film; return the gait and its key frames.

    The caller fills in the gait's `source`, `confidence` and `residuals`. The γ of POOLED belongs
    to all contours together. FinloopError as in `check_phases` and `corrected_keys`.

    Parameters
    ----------
    film
        Contours with their phases.
    name, frequency_hz
        Name of the gait, and its cycles per second.
    split
        Phase of key 2, in cycles.
    wavelet, coarse
        Wavelet of the descriptor, and its number of approximation coefficients.
    per_scale
        Fit one γ for each scale instead of one for all.
    """
    check_phases(film)
    keys, subcycles = corrected_keys(film, split, wavelet, coarse)
    still = LEAST_MOTION * film.body_length
    gamma = gammas_of(subcycles, per_scale, still)
    for sub, letter in enumerate("AB"):
        sums = [model.sums() for (_, which), model in subcycles.items() if which == sub]
        gamma.setdefault(POOLED, {})[letter] = (gamma_fit(sums),)
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
    return replace(gait, support=support_of(film, keys, gait)), keys


def support_of(
    film: GaitContours, keys: Keys, gait: Gait
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return, by id, the spans of phase (from, to) in which a limb's foot is on the ground.

    Phases are in cycles; `to` may exceed 1. A foot is down from its foremost to its hindmost place;
    the animal heads for screen right. A foot is the lowest point of a contour that has "left" or
    "right" in its id.
    """
    frames = 240
    out = dict[str, tuple[tuple[float, float], ...]]()
    layout = Layout(offsets=film.offsets)
    for name, points in cycle(keys.first, keys.second, gait, frames, layout).items():
        if any(side in name for side in ("left", "right")):
            x = points[:, int(points[..., 1].mean(axis=0).argmax()), 0]
            start = int(x.argmax()) / frames
            stop = int(x.argmin()) / frames
            out[name] = ((start, stop if stop > start else stop + 1.0),)
    return out
