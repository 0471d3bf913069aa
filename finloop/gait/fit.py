"""A gait from the contours of a film: its key frames and γ (curve paper §4.2, Figs. 10, 11).

γ is fitted over the frames of a subcycle, see `gait.clock`; the inner products are over the
coefficients of one scale, or of all scales together, each weighing as much as its energy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Points
from finloop.base.errors import FinloopError
from finloop.gait.clock import clock, gamma_fit, gamma_sums
from finloop.gait.descriptor import contour, descriptor, scale_slices
from finloop.gait.film import GaitContours, Keys, Samples, check, keys_of, samples_of
from finloop.gait.model import POOLED, Gait, Layout, cycle, subcycle

Gammas = dict[str, dict[str, tuple[float, ...]]]
LEAST = 2  # frames that a subcycle needs between its keys
ROUNDS = 3
"""Rounds of `corrected_keys`. γ of the drawn dog is then within 6 % at any frame rate, uncorrected
within 44 %. In more rounds the cubics follow the noise of few frames."""
LEAST_MOTION = 1e-9  # body lengths: a scale that moves less between the keys gets γ = 0


@dataclass(frozen=True)
class Subcycle:
    """One contour in one subcycle, as coefficients."""

    samples: Samples  # the frames of the film that fall into it
    # start, end: the key frames at its ends, (n, 2)
    start: Points
    end: Points
    scales: list[slice]  # the slice of each scale in the n coefficients

    def sums(self, scale: slice = slice(None)) -> tuple[float, float]:
        """`gamma_sums` of a scale, by default of all scales together."""
        frames = self.samples.coefficients[:, scale].reshape(len(self.samples.tau), -1)
        return gamma_sums(
            self.samples.tau, frames, self.start[scale].ravel(), self.end[scale].ravel()
        )

    def gammas(self, per_scale: bool, still: float) -> tuple[float, ...]:
        """γ per scale, or one for all; 0 for a scale whose points move less than `still` (RMS)."""
        out = []
        for scale in self.scales if per_scale else [slice(None)]:
            way = np.linalg.norm(self.start[scale].ravel() - self.end[scale].ravel())
            moves = way > still * np.sqrt(len(self.start))
            out.append(gamma_fit([self.sums(scale)]) if moves else 0.0)
        return tuple(out)

    def predict(self, tau: Points, gamma: Points) -> Points:
        """Coefficients (s, n, 2) of the model at tau (s,); γ (n,), or (1,) for all."""
        return self.end + clock(tau[:, None], gamma)[..., None] * (self.start - self.end)


def subcycles_of(
    keys: Keys, samples: Mapping[str, list[Samples]], wavelet: str, coarse: int
) -> dict[tuple[str, int], Subcycle]:
    """Every contour in subcycles A (0) and B (1), by (id, subcycle)."""
    out = {}
    for name, pair in samples.items():
        for sub, frames in enumerate(pair):
            start, end = (descriptor(key, wavelet, coarse) for key in keys.ends(name, sub))
            out[name, sub] = Subcycle(frames, start, end, scale_slices(len(start), coarse))
    return out


def gammas_of(
    subcycles: Mapping[tuple[str, int], Subcycle], per_scale: bool, still: float
) -> Gammas:
    """γ of every contour in both subcycles."""
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
            "give more cycles or a higher frame rate, or leave these contours out",
        )


def corrected_keys(
    film: GaitContours, split: float, wavelet: str, coarse: int
) -> tuple[Keys, dict[tuple[str, int], Subcycle]]:
    """Key frames corrected for the curvature of the motion, and the subcycles between them.

    `keys_of` interpolates linearly between the frames beside a key, which cuts the curved motion
    short. The error is estimated on a model of the film, a cubic for each coefficient of each
    subcycle: the same interpolation of the model is off by as much. That difference is taken away,
    ROUNDS times. A frame at the very phase of a key stays that key. FinloopError as `keys_of`; if a
    subcycle of a contour has fewer than LEAST frames between its keys.
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
        keys = Keys(first, second, film.later(first))
        subcycles = subcycles_of(keys, samples, wavelet, coarse)
    return keys, subcycles


def _smooth(
    film: GaitContours,
    subcycles: Mapping[tuple[str, int], Subcycle],
    split: float,
    wavelet: str,
    coarse: int,
) -> dict[str, Points]:
    """The film's contours, each coefficient a cubic between the keys; NaN where the film's are."""
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
    later, second = film.later(out), np.mod(film.phase, 1.0) >= 0.5
    return {
        name: np.where(
            np.isfinite(points), np.where(second[:, None, None], later[name], out[name]), np.nan
        )
        for name, points in film.contours.items()
    }


def _bends(tau: Points) -> Points:
    """The two cubics that are 0 at τ = 0 and 1, at tau (s,): (s, 2)."""
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
    """The gait of a film and its two key frames.

    The gait's `source`, `confidence` and `residuals` are the caller's to fill in. Its γ of POOLED
    is that of all contours together. FinloopError as `check` and `corrected_keys`.

    film: contours with their phases.
    name, frequency_hz: of the gait.
    split: phase of key 2.
    wavelet, coarse: of the descriptor.
    per_scale: one γ for each scale, instead of one for all.
    """
    check(film)
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
    """Spans of phase (from, to) in which each limb's foot is on the ground.

    A foot is down from its foremost to its hindmost place, the animal heading for screen right. It
    is the lowest point of a contour that has "left" or "right" in its id.
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
