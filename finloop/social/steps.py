"""Steps: the displacement of a fish of the film in some time, apart from the others' pull.

The pull of other fish (`zones.pull`) is one part of where a fish goes. The rest, its own step, is
speed, turns and chance. A steered fish takes one of the film's own steps, from a fish equally near
to a wall that moved alike, and adds the pull of the fish around it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Complex, Floats, Ints
from finloop.base.schema import Schema, columns

SOCIAL_STEPS = Schema(
    *columns("float32", "1", "wall_ahead", "wall_left"),
    *columns("float32", "body length", "last_ahead", "last_left", "move_ahead", "move_left"),
    *columns("float32", "1", "turn_ahead", "turn_left"),
)
"""A row per step. wall: from `Walls.near`; last: displacement in the step before; move: own
displacement; turn: own part of the unit vector of the heading afterwards. Vectors of the body."""


@dataclass(frozen=True)
class SocialSteps:
    """The n steps of a film's fish without the pull of the others, as vectors of the body.

    wall, last, move, turn (n,): complex, as in `SOCIAL_STEPS`. forward: BL by which a pull of 1
    moves a fish; onward: what a pull of 1 adds to the unit vector of its heading. Drawing includes
    the mirror images of the steps.
    """

    wall: Complex
    last: Complex
    move: Complex
    turn: Complex
    forward: float
    onward: float

    @cached_property
    def _both_sides(self) -> tuple[Complex, Complex]:
        move, turn = (np.concatenate([one, one.conj()]) for one in (self.move, self.turn))
        return move, turn

    @cached_property
    def _scale(self) -> tuple[float, float]:
        mean = [float(np.sqrt(np.mean(np.abs(one) ** 2))) for one in (self.wall, self.last)]
        return max(mean[0], 1e-9), max(mean[1], 1e-9)

    @cached_property
    def _tree(self) -> scipy.spatial.KDTree:
        own = self._point(self.wall, self.last)
        return scipy.spatial.KDTree(np.concatenate([own, own * (1, -1, 1, -1)]))

    def _point(self, wall: Complex, last: Complex) -> Floats:
        wall, last = wall / self._scale[0], last / self._scale[1]
        return np.stack([wall.real, wall.imag, last.real, last.imag], axis=-1)

    def draw(
        self, wall: Complex, last: Complex, alike: int, rng: np.random.Generator
    ) -> tuple[Complex, Complex]:
        """Draw displacements (BL) and turns for m fish from similar steps of the film.

        Both results are (m, alike), complex, as in `SOCIAL_STEPS`, in random order; fewer if the
        film has fewer steps. wall, last (m,): of the fish, compared with those of the steps.
        """
        count = min(alike, 2 * len(self.move))
        which = self._tree.query(self._point(wall, last), k=[*range(1, count + 1)])[1]
        which = rng.permuted(which, axis=-1)
        move, turn = self._both_sides
        return move[which], turn[which]


def add_pull_to_moves(moves: Complex, pulls: Complex, steps: SocialSteps) -> Complex:
    """Return displacements (…) in BL: a fish's own moves plus the pull of its group.

    moves, pulls: complex, in the frame of the body.
    """
    return moves + steps.forward * pulls


def add_pull_to_turns(turns: Complex, pulls: Complex, steps: SocialSteps) -> Complex:
    """Return new headings (…) as unit vectors: a fish's own turns plus the pull of its group.

    turns, pulls, result: complex, in the frame of the body before the step.
    """
    to = turns + steps.onward * pulls
    size = np.abs(to)
    return np.where(size > 0, to / np.where(size > 0, size, 1), 1)


def rows_of(steps: SocialSteps) -> dict[str, Floats]:
    """Convert steps to the columns of `SOCIAL_STEPS`, name → values (n,)."""
    parts = {"wall": steps.wall, "last": steps.last, "move": steps.move, "turn": steps.turn}
    return {
        f"{name}_{side}": part
        for name, vector in parts.items()
        for side, part in (("ahead", vector.real), ("left", vector.imag))
    }


def steps_of(table: pd.DataFrame, forward: float, onward: float) -> SocialSteps:
    """Convert columns of `SOCIAL_STEPS` back to steps; the inverse of `rows_of`.

    forward, onward: as in `SocialSteps`.
    """
    wall, last, move, turn = (
        table[f"{name}_ahead"].to_numpy(float) + 1j * table[f"{name}_left"].to_numpy(float)
        for name in ("wall", "last", "move", "turn")
    )
    return SocialSteps(wall, last, move, turn, forward, onward)


def last_rows(later: Ints) -> Ints:
    """Return for each row the row before it, from the row after it; −1 where there is none.

    later (n,): the row some time later in the same track, or −1.
    """
    before = np.full(len(later), -1)
    has = np.flatnonzero(later >= 0)
    before[later[has]] = has
    return before
