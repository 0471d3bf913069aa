"""γ by least squares from the contours of a film (curve paper §4.2, Fig. 11).

Between keys a and b the model is y = b + f(τ)(a − b), and with f(τ) = (1 − τ) − γ τ(1 − τ) it is
linear in γ, so least squares has a closed form:

    γ = −Σ τ(1 − τ) ⟨a − b, y − b − (1 − τ)(a − b)⟩ / Σ τ²(1 − τ)² ‖a − b‖²

over the frames of a subcycle, the inner products over the coefficients of one scale, or of all
scales together: then each weighs as much as its energy.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from finloop.errors import FinloopError
from finloop.gait.descriptor import clock, contour, descriptor, scale_slices
from finloop.gait.film import Filmed, Keys, Samples, check, keys_of, samples_of
from finloop.gait.model import POOLED, Gait, Points, cycle, subcycle

Gammas = dict[str, dict[str, tuple[float, ...]]]
LEAST = 2
"""Frames in a subcycle, apart from its keys."""
ROUNDS = 3
"""Of `settled`: γ of the drawn dog is within 6 % then at any frame rate, without them within 44 %.

Few and noisy frames lose by more rounds: a cubic then follows the noise.
"""
STILL = 1e-9
"""Share of a body length: a scale that moves less between the keys has no γ; it gets 0."""


def gamma_fit(tau: Points, samples: Points, source: Points, to: Points) -> float:
    """γ of frames (s, k) at tau (s,) between (k,) and (k,): the closed form above.

    0 if nothing moves between the keys, or no frame lies between them.
    """
    way = source - to
    bow = tau * (1 - tau)
    rest = (samples - to) @ way - (1 - tau) * float(way @ way)
    norm = float(bow @ bow) * float(way @ way)
    return float(-(bow @ rest) / norm) if norm > 0 else 0.0


@dataclass(frozen=True)
class Moves:
    """Of one contour in one subcycle: its samples, the coefficients of both keys, its scales."""

    samples: Samples
    source: Points
    to: Points
    scales: list[slice]

    def gammas(self, per_scale: bool, still: float) -> tuple[float, ...]:
        """γ per scale, or one for all; 0 where a scale's points move less than `still` (RMS)."""
        out = []
        for where in self.scales if per_scale else [slice(None)]:
            source, to = self.source[where].ravel(), self.to[where].ravel()
            moving = np.linalg.norm(source - to) > still * np.sqrt(len(self.source))
            flat = self.samples.coefficients[:, where].reshape(len(self.samples.tau), -1)
            out.append(gamma_fit(self.samples.tau, flat, source, to) if moving else 0.0)
        return tuple(out)


def moves_of(
    keys: Keys, samples: Mapping[str, list[Samples]], wavelet: str, coarse: int
) -> dict[tuple[str, int], Moves]:
    """Each contour in subcycles A (0) and B (1)."""
    out = {}
    for name, pair in samples.items():
        for sub, found in enumerate(pair):
            source, to = (descriptor(e, wavelet, coarse) for e in keys.ends(name, sub))
            out[name, sub] = Moves(found, source, to, scale_slices(len(source), coarse))
    return out


def gammas_of(moves: Mapping[tuple[str, int], Moves], per_scale: bool, still: float) -> Gammas:
    """γ of every contour in both subcycles."""
    out: Gammas = {}
    for (name, sub), one in moves.items():
        out.setdefault(name, {})["AB"[sub]] = one.gammas(per_scale, still)
    return out


def _check_samples(samples: Mapping[str, list[Samples]]) -> None:
    few = [
        f"{name!r} in {'AB'[sub]}"
        for name, pair in samples.items()
        for sub, one in enumerate(pair)
        if ((one.tau > 1e-6) & (one.tau < 1 - 1e-6)).sum() < LEAST
    ]
    if few:
        raise FinloopError(
            f"fewer than {LEAST} frames between the keys show {', '.join(few)}",
            f"{LEAST} or more of each contour in each subcycle",
            "give more cycles or a higher frame rate, or leave these contours out",
        )


def settled(
    film: Filmed, split: float, wavelet: str, coarse: int
) -> tuple[Keys, dict[tuple[str, int], Moves]]:
    """Keys that allow for the bend of the way between the frames beside them, and the moves.

    Keys by straight lines between frames are off by that bend. Cubics through the moves, one a
    coefficient, are off by as much when they are cut at the same frames, so that difference is
    taken away, ROUNDS times. A frame at the very phase of a key stays that key.

    Raises
    ------
    FinloopError
        As `keys_of`; if a subcycle of a contour has fewer than LEAST frames between its keys.
    """
    samples = samples_of(film, split, wavelet, coarse)
    _check_samples(samples)
    straight = keys = keys_of(film, split)
    moves = moves_of(keys, samples, wavelet, coarse)
    for _ in range(ROUNDS):
        cut = keys_of(replace(film, contours=_smooth(film, moves, split, wavelet, coarse)), split)
        one, two = (
            {name: key[name] + was[name] - short[name] for name in key}
            for key, was, short in (
                (keys.one, straight.one, cut.one),
                (keys.two, straight.two, cut.two),
            )
        )
        keys = Keys(one, two, film.later(one))
        moves = moves_of(keys, samples, wavelet, coarse)
    return keys, moves


def _smooth(
    film: Filmed, moves: Mapping[tuple[str, int], Moves], split: float, wavelet: str, coarse: int
) -> dict[str, Points]:
    """The film's contours as cubics between the keys have them; NaN where the film's are."""
    which, tau = subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, Points]()
    for name, points in film.contours.items():
        out[name] = np.empty_like(points)
        for sub in range(2):
            one, now = moves[name, sub], tau[which == sub]
            rest = one.samples.coefficients - predicted(one, one.samples.tau, np.zeros(1))
            size = np.linalg.lstsq(
                _bends(one.samples.tau), rest.reshape(len(rest), -1), rcond=None
            )[0]
            bend = (_bends(now) @ size).reshape(-1, *one.to.shape)
            found = predicted(one, now, np.zeros(1)) + bend
            out[name][which == sub] = contour(found, points.shape[1], wavelet, coarse)
    later, second = film.later(out), np.mod(film.phase, 1.0) >= 0.5
    return {
        name: np.where(
            np.isfinite(points), np.where(second[:, None, None], later[name], out[name]), np.nan
        )
        for name, points in film.contours.items()
    }


def _bends(tau: Points) -> Points:
    """What a cubic is beside a straight line between both ends of it, (s, 2)."""
    bow = tau * (1 - tau)
    return np.column_stack([bow, bow * (1 - 2 * tau)])


def fit(
    film: Filmed,
    name: str,
    frequency_hz: float,
    *,
    split: float = 0.25,
    wavelet: str = "coif2",
    coarse: int = 4,
    per_scale: bool = False,
    source: str = "",
    confidence: float = 1.0,
    residuals: Mapping[str, float] | None = None,
) -> tuple[Gait, Keys]:
    """The gait of a film and its two key frames.

    γ of POOLED is that of all contours together. `residuals` are those of `gait.compare`.

    Raises
    ------
    FinloopError
        As `check` and `settled`.
    """
    check(film)
    keys, moves = settled(film, split, wavelet, coarse)
    still = STILL * film.body_length
    gamma = gammas_of(moves, per_scale, still)
    gamma[POOLED] = {"AB"[sub]: (_pooled(moves, sub),) for sub in range(2)}
    gait = Gait(
        name=name,
        symmetry=film.symmetry,
        frequency_hz=frequency_hz,
        gamma=gamma,
        split=split,
        wavelet=wavelet,
        coarse=coarse,
        source=source,
        confidence=confidence,
        cycles=film.cycles,
        frames=len(film.phase),
        residuals=dict(residuals or {}),
    )
    if film.symmetry == "mirror":
        return gait, keys
    return replace(gait, support=support_of(film, keys, gait)), keys


def _pooled(moves: Mapping[tuple[str, int], Moves], sub: int) -> float:
    """γ of all contours of a subcycle together: the closed form with its sums over all."""
    above = below = 0.0
    for (_, which), one in moves.items():
        if which == sub:
            tau, way = one.samples.tau, (one.source - one.to).ravel()
            flat = (one.samples.coefficients - one.to).reshape(len(tau), -1)
            bow = tau * (1 - tau)
            above -= float(bow @ (flat @ way - (1 - tau) * float(way @ way)))
            below += float(bow @ bow) * float(way @ way)
    return above / below if below > 0 else 0.0


def support_of(film: Filmed, keys: Keys, gait: Gait) -> dict[str, tuple[tuple[float, float], ...]]:
    """By limb, when its foot is on the ground: from its foremost place to its hindmost.

    Of an animal that heads for screen right; the foot is the point that lies lowest. Limbs are the
    contours that have a partner.
    """
    frames = 240
    out = dict[str, tuple[tuple[float, float], ...]]()
    turning = cycle(keys.one, keys.two, gait, frames, offsets=film.offsets)
    for name, points in turning.items():
        if any(side in name for side in ("left", "right")):
            x = points[:, int(points[..., 1].mean(axis=0).argmax()), 0]
            start = int(x.argmax()) / frames
            stop = int(x.argmin()) / frames
            out[name] = ((start, stop if stop > start else stop + 1.0),)
    return out


def predicted(one: Moves, tau: Points, gamma: Points) -> Points:
    """Coefficients (s, n, 2) of the model at tau (s,); γ (n,) or (1,)."""
    return one.to + clock(tau[:, None], gamma)[..., None] * (one.source - one.to)
