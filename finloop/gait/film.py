"""Contours of a film, cut into the cycle of a gait (curve paper §4.2, Figs. 9, 10).

Every frame is brought into the first half of the cycle by the symmetry of the gait: frames of C and
D count as A and B of the partner.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from finloop.errors import FinloopError
from finloop.gait.descriptor import descriptor
from finloop.gait.model import Ints, Points, Symmetry, half_later, partner, subcycle

Mask = NDArray[np.bool_]
WIDEST = 0.125
"""Of a cycle: how far from a key phase a frame may stand in for the key, or one step if longer."""


@dataclass(frozen=True)
class Filmed:
    """Contours of a film in the frame of the body.

    Attributes
    ----------
    contours
        Closed, (frames, n, 2) by id, n a power of two; NaN in frames where one is missing. Those
        of a mirror begin at the snout.
    phase
        (frames,) in cycles, rising: it counts the cycles too.
    body_length
        In the unit of the contours.
    symmetry, offsets
        As of `gait.model.four_keys`.
    """

    contours: Mapping[str, Points]
    phase: Points
    body_length: float
    symmetry: Symmetry
    offsets: Mapping[str, Points] | None = None

    def later(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Contours as they are half a cycle later."""
        return half_later(contours, self.symmetry, offsets=self.offsets)

    def complete(self) -> "Filmed":
        """Of an animal from the side also the limbs that are never seen, all NaN.

        They follow from their partners by symmetry, see `gait.model.partner`.
        """
        if self.symmetry != "swap":
            return self
        contours = dict(self.contours)
        for name, points in self.contours.items():
            for side, other in (("left", "right"), ("right", "left")):
                if side in name:
                    contours.setdefault(name.replace(side, other), np.full_like(points, np.nan))
        return replace(self, contours=contours)

    @property
    def cycles(self) -> float:
        """How many the film shows: frames times the usual step from one to the next."""
        return float(len(self.phase) * np.median(np.diff(self.phase)))


@dataclass(frozen=True)
class Keys:
    """Keys 1 and 2 (n, 2) by id, and 1' that follows from 1."""

    one: dict[str, Points]
    two: dict[str, Points]
    one_later: dict[str, Points]

    def ends(self, name: str, which: int) -> tuple[Points, Points]:
        """The keys that subcycle A (0) or B (1) goes from and to."""
        both = (self.one, self.two) if which == 0 else (self.two, self.one_later)
        return both[0][name], both[1][name]


def check(film: Filmed) -> None:
    """Refuse what no gait can be fitted to.

    Raises
    ------
    FinloopError
        If the film has fewer frames than half a cycle needs, or the phase does not rise.
    """
    if len(film.phase) < 3 or (np.diff(film.phase) <= 0).any():
        raise FinloopError(
            f"{len(film.phase)} frames whose phase does not always rise",
            "at least 3 frames, each later in the cycle than the one before",
            "give a longer film, or find the period of it anew",
        )
    if film.cycles < 0.5:
        raise FinloopError(
            f"{len(film.phase)} frames show {film.cycles:.2f} of a cycle",
            "at least half a cycle: the other half follows by symmetry",
            "give a longer film",
        )


def hips(film: Filmed) -> dict[str, Points]:
    """How far right and down of its partner each limb hangs (2,), the mean of the film.

    Half a cycle apart, when both have the same place in the cycle. 0 where a film of less than a
    cycle, or without one of both, cannot tell.
    """
    out = {name: np.zeros(2) for name in film.contours}
    if film.cycles < 1 - 1e-6:
        return out
    centre = {name: points.mean(axis=1) for name, points in film.contours.items()}
    for name, here in centre.items():
        twin = partner(name, film.contours)
        if name < twin:
            seen, both = (np.isfinite(centre[one]).all(axis=1) for one in (name, twin))
            if seen.any() and both.any():
                phase = film.phase[seen] + 0.5
                there = [
                    np.interp(phase, film.phase[both], centre[twin][both, k], period=1.0)
                    for k in range(2)
                ]
                out[name] = (here[seen] - np.column_stack(there)).mean(axis=0)
                out[twin] = -out[name]
    return out


def keys_of(film: Filmed, split: float) -> Keys:
    """Key frames: at their phases between the two frames beside, over all cycles and both halves.

    A triangle of one frame's step about the phase weighs the frames, so that one cycle gives the
    linear interpolation of its neighbours, a frame at the very phase itself, and several cycles
    the mean of that. Where frames lack, the triangle is widened up to WIDEST. The straight line
    cuts bends short: see `gait.fit.settled`.

    Raises
    ------
    FinloopError
        If a contour is missing in every frame near a key; all such are named.
    """
    phase, here = film.phase, film.contours
    there = film.later(here)
    step = float(np.median(np.diff(phase)))
    found: list[dict[str, Points]] = []
    lacking = []
    for number, at in enumerate((0.0, split), start=1):
        halves = np.round((phase - at) / 0.5)
        apart = np.abs(phase - at - 0.5 * halves)
        key = dict[str, Points]()
        for name, points in here.items():
            nearby = np.where((halves % 2 == 0)[:, None, None], points, there[name])
            seen = np.isfinite(nearby).all(axis=(1, 2))
            width = step
            while not (weight := np.clip(1 - apart / width, 0, None) * seen).any():
                if width >= WIDEST:
                    lacking.append(f"{name!r} near key {number}")
                    break
                width = min(2 * width, WIDEST)
            else:
                key[name] = np.tensordot(weight[seen] / weight.sum(), nearby[seen], 1)
        found.append(key)
    if lacking:
        raise FinloopError(
            f"no frame shows {', '.join(lacking)}",
            f"each contour in a frame within {WIDEST:g} of a cycle of both keys",
            "give more cycles, or leave out the contours that the film does not show",
        )
    return Keys(found[0], found[1], film.later(found[0]))


@dataclass(frozen=True)
class Samples:
    """Frames of one contour in one subcycle: tau (s,), coefficients (s, n, 2), frame numbers."""

    tau: Points
    coefficients: Points
    frame: Ints


def samples_of(film: Filmed, split: float, wavelet: str, coarse: int) -> dict[str, list[Samples]]:
    """Samples of A and B by id, C and D brought over by the symmetry."""
    later = film.later(film.contours)
    second = np.mod(film.phase, 1.0) >= 0.5
    which, tau = subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, list[Samples]]()
    for name, points in film.contours.items():
        points = np.where(second[:, None, None], later[name], points)
        seen = np.isfinite(points).all(axis=(1, 2))
        out[name] = []
        for sub in range(2):
            frame = np.flatnonzero(seen & (which == sub))
            found = descriptor(points[frame], wavelet, coarse)
            out[name].append(Samples(tau[frame], found, frame))
    return out
