"""What a large step from picture to picture costs: the more, the more seldom the film shows one.

A fish that is sent somewhere turns more often than the filmed one, and would show the film's few
quickest turns again and again. So what is shown next is priced by how long the film lets wait for a
step as large: of its n steps k are as large or larger, n / k frames on average. On average over the
film it costs nothing.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from finloop.base.arrays import Floats, Ints, Mask
from finloop.edit.movement import Movement

_SOON = 3  # ticks in which an offset dies away fastest


@dataclass(frozen=True)
class Rarity:
    """What the steps to the film's rows (n,) cost.

    steps (n,): from the row before, 0 where there is none; known (k,): these, rising; share: of the
    frames for which the film lets wait for as large a one, that a step costs; pull: the largest
    step that an offset of 1 in the codes makes in a tick while it dies away.
    """

    steps: Floats
    known: Floats
    share: float
    pull: float

    @classmethod
    def of(
        cls, moved: Movement, codes: Floats, goes_on: Mask, seen: Floats, spring: Floats,
        share: float,
    ) -> "Rarity":  # fmt: skip
        """Of a film (n rows).

        codes (n, c): of its postures; goes_on (n,): whether the next row is the next frame; seen
        (n,): Eq. 5 from a row to the next, NaN where it is not known: there the body's movement
        stands in. spring (t,): what is left of an offset of 1 after 0, 1 … ticks.
        """
        here = goes_on[:-1]
        moves, bends = (one[here] for one in moved)
        step, far = seen[:-1][here], np.linalg.norm(np.diff(codes, axis=0), axis=1)[here]
        sure = np.isfinite(step)
        unit = float(step[sure].sum()) / max(float(moves[sure].sum()), 1e-12)
        steps = np.zeros(len(goes_on))
        steps[1:][here] = np.where(sure, step, unit * moves)
        fastest = float(-np.diff(spring, append=0.0).min(initial=0.0))
        pull = fastest * unit * float(bends.sum()) / max(float(far.sum()), 1e-12)
        return cls(steps, np.sort(steps[1:][here]), share, pull)

    def price(self, steps: Floats) -> Floats:
        """Ticks (…) that steps cost."""
        smaller = np.searchsorted(self.known, steps)
        return self.share * len(self.known) / np.maximum(len(self.known) - smaller, 1)

    @property
    def dear(self) -> Floats:
        """Ticks (n,) that showing all rows up to each costs, beyond their mean."""
        return (self._each - self._each.mean()).cumsum()

    @cached_property
    def _each(self) -> Floats:
        """Ticks (n,) that the step to each row costs."""
        return self.price(self.steps)

    def of_joins(self, rows: Ints, far: Floats) -> Floats:
        """Ticks (k,) that it costs to go on at rows (k,), beside what they cost themselves.

        far (k,): how far they are, in codes, from what is on screen. Rows n, n + 1 … are mirror
        images.
        """
        soon = (rows[:, None] + np.arange(1, 1 + _SOON)) % len(self.steps)
        steps = self.steps[soon] + self.pull * far[:, None]
        return (self.price(steps) - self._each[soon]).sum(1)
