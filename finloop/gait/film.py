"""Contours of a film, sorted into the cycle of a gait (curve paper §4.2, Figs. 9, 10).

By symmetry every frame counts in the first half of the cycle: frames of C and D are the partner's
frames of A and B.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Ints, Points
from finloop.base.errors import FinloopError
from finloop.gait.descriptor import descriptor
from finloop.gait.model import Layout, Symmetry, half_later, partner, subcycle

WIDEST = 0.125
"""Cycles: largest distance in phase of a frame that stands in for a key, or one frame if longer."""


@dataclass(frozen=True)
class GaitContours:
    """Contours of a film in the frame of the body, with the phase of every frame."""

    # closed, (frames, n, 2) by id, n a power of two; NaN in frames without the contour. With
    # symmetry "mirror" they begin at the snout
    contours: Mapping[str, Points]
    phase: Points  # (frames,) in cycles, rising; the whole part counts the cycles
    body_length: float  # in the unit of the contours
    # symmetry, offsets: as in `gait.model.Layout`
    symmetry: Symmetry
    offsets: Mapping[str, Points] | None = None

    def contours_half_cycle_later(self, contours: Mapping[str, Points]) -> dict[str, Points]:
        """Return what contours of this animal look like half a cycle later, by its symmetry."""
        return half_later(contours, self.symmetry, Layout(offsets=self.offsets))

    def complete(self) -> "GaitContours":
        """Return the film with hidden limbs added as NaN, if the animal is seen from the side.

        A hidden limb follows from its partner by symmetry, see `gait.model.partner`.
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
        """Return the number of gait cycles in the film: frames times the median step of phase."""
        return float(len(self.phase) * np.median(np.diff(self.phase)))


@dataclass(frozen=True)
class Keys:
    """The key frames 1, 2 and 1' (half a cycle after 1): contours (n, 2) by id."""

    first: dict[str, Points]
    second: dict[str, Points]
    first_later: dict[str, Points]

    def ends(self, name: str, which: int) -> tuple[Points, Points]:
        """Return the contours (n, 2) of an id at which subcycle A (0) or B (1) begins and ends."""
        start, end = (self.first, self.second) if which == 0 else (self.second, self.first_later)
        return start[name], end[name]


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


def hip_offsets(film: GaitContours) -> dict[str, Points]:
    """Return how far right and down of its partner each limb hangs: (2,) by id, the contours' unit.

    It is the mean over the film of the difference between a limb and its partner half a cycle
    later, when both are at the same point of their motion. 0 if the film is shorter than a cycle,
    or lacks one of the two limbs.
    """
    out = {name: np.zeros(2) for name in film.contours}
    if film.cycles < 1 - 1e-6:
        return out
    centre = {name: points.mean(axis=1) for name, points in film.contours.items()}
    for name, here in centre.items():
        twin = partner(name, film.contours)
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


def keys_of(film: GaitContours, split: float) -> Keys:
    """Return key frames by linear interpolation, the mean over all cycles and both halves.

    split: phase of key 2, in cycles. Weights fall linearly to 0 at one frame's step from the key's
    phase. So one cycle gives the interpolation between the two frames beside the phase, and several
    cycles give its mean. Missing frames widen the weights up to WIDEST. For the error of the
    interpolation see `gait.fit.corrected_keys`. FinloopError if a contour is missing in every frame
    near a key; the message names all such contours.
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
    return Keys(keys[0], keys[1], film.contours_half_cycle_later(keys[0]))


@dataclass(frozen=True)
class Samples:
    """The s frames that show one contour in one subcycle.

    tau (s,): shares 0-1 of the subcycle; coefficients (s, n, 2): of the contour; frame (s,):
    numbers of the frames in the film.
    """

    tau: Points
    coefficients: Points
    frame: Ints


def samples_of(
    film: GaitContours, split: float, wavelet: str, coarse: int
) -> dict[str, list[Samples]]:
    """Return, by id, the film's frames in subcycle A and in B: a list of two `Samples`.

    By symmetry they include the frames of C and D. split: phase of key 2, in cycles; wavelet,
    coarse: of the descriptor.
    """
    later = film.contours_half_cycle_later(film.contours)
    second = np.mod(film.phase, 1.0) >= 0.5
    which, tau = subcycle(np.mod(film.phase, 0.5), split)
    out = dict[str, list[Samples]]()
    for name, points in film.contours.items():
        points = np.where(second[:, None, None], later[name], points)
        present = np.isfinite(points).all(axis=(1, 2))
        out[name] = []
        for sub in range(2):
            frame = np.flatnonzero(present & (which == sub))
            coefficients = descriptor(points[frame], wavelet, coarse)
            out[name].append(Samples(tau[frame], coefficients, frame))
    return out
