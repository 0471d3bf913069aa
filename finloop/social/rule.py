"""How a fish swims in a school: a step of the film's fish, plus the pull of the others' zones.

The pull of other fish (`social.zones`) is one part of where a fish goes. The rest of its step is
speed, turns and chance. A steered fish takes one of the film's own steps, from a fish equally near
to a wall that moved alike, and adds the pull of the fish around it. The same arguments and
generator state give the same place.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Complex, Floats, Reals
from finloop.base.errors import FinloopError
from finloop.base.schema import Schema, columns
from finloop.social.neighbours import complex_vectors, relative_neighbours
from finloop.social.walls import Walls
from finloop.social.zones import Zones, pull_of_others

SOCIAL_STEPS = Schema(
    *columns("float32", "1", "wall_ahead", "wall_left"),
    *columns("float32", "body length", "last_ahead", "last_left", "move_ahead", "move_left"),
    *columns("float32", "1", "turn_ahead", "turn_left"),
)
"""A row per step. wall: from `Walls.vectors_from_wall`; last: displacement in the step before;
move: displacement without the pull of others; turn: unit vector of the heading afterwards, without
that pull. Vectors are relative to the body: ahead and left."""


@dataclass(frozen=True)
class SocialSteps:
    """The n steps of a film's fish without the pull of other fish, relative to their bodies.

    All are complex (n,). wall: away from the wall, longer if nearer; last: displacement in the step
    before, move: in this step, body lengths; turn: what remains of the heading afterwards, a unit
    vector, without the pull. move_per_pull: body lengths by which a pull of 1 moves a fish;
    turn_per_pull: what a pull of 1 adds to the unit vector of its heading.
    """

    wall: Complex
    last: Complex
    move: Complex
    turn: Complex
    move_per_pull: float
    turn_per_pull: float

    @cached_property
    def _step_scales(self) -> tuple[float, float]:
        """Return the units of `wall` and `last` for the comparison: root mean squares, ≥ 1e-9."""
        wall, last = (float(np.sqrt(np.mean(np.abs(v) ** 2))) for v in (self.wall, self.last))
        return max(wall, 1e-9), max(last, 1e-9)

    @cached_property
    def _tree(self) -> scipy.spatial.KDTree:
        """Return a search tree of all steps and their mirror images, by how they began."""
        vectors = self._search_vectors(self.wall, self.last)
        mirrored_vectors = vectors * (1, -1, 1, -1)  # ahead stays, left and right are swapped
        return scipy.spatial.KDTree(np.concatenate([vectors, mirrored_vectors]))

    def _search_vectors(self, wall: Complex, last: Complex) -> Floats:
        """Return vectors (…, 4) by which steps are compared: away from the wall, and last step."""
        wall, last = wall / self._step_scales[0], last / self._step_scales[1]
        return np.stack([wall.real, wall.imag, last.real, last.imag], axis=-1)

    def sample_similar_steps(
        self, wall: Complex, last: Complex, most_steps: int, rng: np.random.Generator
    ) -> tuple[Complex, Complex]:
        """Return, for m fish, the film's steps that began most like theirs, in random order.

        Mirror images of steps count, too. The results, moves in body lengths and turns, are (m,
        most_steps), complex; fewer if the film has fewer steps. wall, last (m,): the fish's vector
        from the wall (`Walls.vectors_from_wall`) and its last step in body lengths, both relative
        to its heading: ahead is real, left is imaginary.
        """
        count = min(most_steps, 2 * len(self.move))  # steps and their mirror images
        ranks = [*range(1, count + 1)]  # given as a list, even one step has an axis of its own
        _distances, nearest = self._tree.query(self._search_vectors(wall, last), k=ranks)
        chosen = rng.permuted(nearest, axis=-1)
        # As in the tree, the mirror images follow all steps.
        move, turn = (np.concatenate([step, step.conj()]) for step in (self.move, self.turn))
        return move[chosen], turn[chosen]

    def turn_by_pulls(self, turns: Complex, pulls: Complex) -> Complex:
        """Return headings after a step as unit vectors: its turns plus the pulls of other fish.

        All are complex, of any one shape, relative to the body before the step. A fish goes
        straight on (1) where its turn and the pull cancel.
        """
        direction = turns + self.turn_per_pull * pulls
        length = np.abs(direction)
        return np.where(length > 0, direction / np.where(length > 0, length, 1), 1)

    def to_table(self) -> pd.DataFrame:
        """Return the steps as a table with the columns of `SOCIAL_STEPS`."""
        parts = {"wall": self.wall, "last": self.last, "move": self.move, "turn": self.turn}
        return pd.DataFrame({
            f"{name}_{side}": part
            for name, vector in parts.items()
            for side, part in (("ahead", vector.real), ("left", vector.imag))
        })  # fmt: skip

    @classmethod
    def from_table(
        cls, table: pd.DataFrame, move_per_pull: float, turn_per_pull: float
    ) -> "SocialSteps":
        """Return steps from a table with the columns of `SOCIAL_STEPS`, and two pull factors."""
        wall, last, move, turn = (
            table[f"{name}_ahead"].to_numpy(float) + 1j * table[f"{name}_left"].to_numpy(float)
            for name in ("wall", "last", "move", "turn")
        )
        return cls(wall, last, move, turn, move_per_pull, turn_per_pull)


@dataclass(frozen=True)
class SchoolRule:
    """How fish swim in a school: by steps of the film's fish, changed by the others' pull.

    horizon: ticks that a step lasts; similar_steps: number of them from which one is drawn.
    """

    zones: Zones
    steps: SocialSteps
    horizon: int
    similar_steps: int


def require_rule(school_rule: SchoolRule | None) -> SchoolRule:
    """Return a school's rule unchanged; FinloopError if it is None or has no steps."""
    if school_rule is None or not len(school_rule.steps.move):
        raise FinloopError(
            "there are no zones for fish in a school"
            if school_rule is None
            else "the film's tracks are too short for the steps of fish in a school",
            "zones, and steps of a film that shows a fish in three consecutive frames",
            "make them (dvc repro calibrate; in Python find_zones, for "
            "steer(…, school_rule=…)), film longer, or take another rule (matching.rule)",
        )
    return school_rule


class OtherFish(NamedTuple):
    """The other fish of a tank: places (n, 2) px, y down, and headings (n,) in degrees."""

    places: Reals
    headings_deg: Reals


class DecidingFish(NamedTuple):
    """The fish that decides: x, y in px, heading in degrees, its last step ahead in BL."""

    x: float
    y: float
    heading_deg: float
    last: float


def next_place_in_school(
    fish: DecidingFish, others: OtherFish, school_rule: SchoolRule, walls: Walls,
    rng: np.random.Generator,
) -> tuple[float, float] | None:  # fmt: skip
    """Return the place x, y in px to which a fish swims next; None if no other fish pulls it.

    Steps of the film that began alike are drawn in random order, and the pull of the other fish is
    added to each. The place is the first of their ends that lies in the tank. If all lie outside,
    it is the last, and the caller must move it into the tank.
    """
    place, heading = complex_vectors(
        np.array([[fish.x, fish.y]]), np.array([fish.heading_deg]), walls.length
    )
    group = complex_vectors(others.places, others.headings_deg, walls.length)
    pulls = pull_of_others(
        relative_neighbours(place[:, None], heading[:, None], *group), school_rule.zones
    )
    if pulls[0] == 0:
        return None
    steps, last = school_rule.steps, np.array([fish.last + 0j])
    moves, _ = steps.sample_similar_steps(
        walls.vectors_from_wall(place, heading), last, school_rule.similar_steps, rng
    )
    ends = place + heading * (moves[0] + steps.move_per_pull * pulls)
    inside = walls.is_inside(ends)
    end_px = ends[int(inside.argmax()) if inside.any() else -1] * walls.length
    return float(end_px.real), float(-end_px.imag)  # complex places have y up
