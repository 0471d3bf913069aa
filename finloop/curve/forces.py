"""Move curves under forces: gravity, wind, attraction, a floor (curve paper §3.1, §4.2).

Q of Eq. 3.3 is constant or a function of place and time. Its linear part, drag × velocity and
attraction × place, joins C and K, so it is solved exactly, as in `curve.dynamics`. What is left
counts as constant over a short step, with its value at the middle of the step: exact where it is
constant, and halving the step quarters the error elsewhere. The force that holds a point is found
anew in each step: it brings the point back to its place. After each step, points below the floor
are set onto it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.curve.dynamics import (
    Numbers,
    Problem,
    Trajectory,
    convert_problem,
    curve_oscillators,
    fourier_basis,
    oscillator_response,
)

AT_REST = 0.01
"""Share of its top speed (RMS of the points) below which a curve counts as at rest."""


@dataclass(frozen=True)
class Wind:
    """A wind that pulls each point with `drag` × (velocity of the air − velocity of the point).

    gust: share of the wind's speed. With it, eddies travel with the wind (Taylor's frozen
    turbulence): at a place the wind gains gust × speed in a direction that turns round once while
    an eddy, `gust_length` long, passes.
    """

    velocity: tuple[float, float]
    drag: float
    gust: float = 0.0
    gust_length: float = 1.0

    def gust_velocity(self, places: Floats, time: float) -> Floats:
        """Return the velocity (…, 2) that gusts add to the wind at positions (…, 2) and a time.

        Lengths and times are in the units of the wind's velocity.
        """
        along = np.asarray(self.velocity)
        speed = float(np.hypot(*along)) or 1.0
        across = np.array([-along[1], along[0]])
        phase = 2 * np.pi * (places @ (along / speed) - speed * time) / self.gust_length
        return self.gust * (np.sin(phase)[..., None] * along + np.cos(phase)[..., None] * across)


@dataclass(frozen=True)
class Attraction:
    """A pull of each point of a curve to the nearest of `points` (m, 2), like a spring.

    points: one, or those of a curve, as close together as the motion shall be smooth.
    """

    points: Floats
    strength: float


@dataclass(frozen=True)
class Forces:
    """Forces per length on curves, y down, in units of the drawing and of time.

    gravity: acceleration; it moves nothing without density. floor: its y, below which no point
    goes. A point that hits it stops there, without a bounce; `friction` is the share of the lost
    velocity that it loses along the floor, too (Coulomb). is_held (n, k): points of k curves that
    keep their places at rest. FinloopError for numbers that are not finite, or negative strengths.
    """

    gravity: tuple[float, float] = (0.0, 0.0)
    winds: tuple[Wind, ...] = ()
    attractions: tuple[Attraction, ...] = ()
    floor: float | None = None
    friction: float = 0.0
    is_held: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        """Raise FinloopError for numbers that are not finite, or are negative."""
        sizes = [self.friction, *(pull.strength for pull in self.attractions)]
        sizes += [size for wind in self.winds for size in (wind.drag, wind.gust, wind.gust_length)]
        places = [*self.gravity, 0.0 if self.floor is None else self.floor]
        places += [speed for wind in self.winds for speed in wind.velocity]
        targets = [np.ravel(pull.points) for pull in self.attractions]
        is_finite = np.isfinite(np.concatenate([sizes, places, *targets])).all()
        if not is_finite or min(sizes) < 0 or any(wind.gust_length == 0 for wind in self.winds):
            raise FinloopError(
                f"the forces {self}",
                "finite numbers; drag, gust, strength and friction of 0 or more, gust_length above",
                "correct the forces",
            )

    @property
    def drag(self) -> float:
        """Return the summed drag of all winds."""
        return sum(wind.drag for wind in self.winds)

    @property
    def pull(self) -> float:
        """Return the summed strength of all attractions."""
        return sum(attraction.strength for attraction in self.attractions)


class _Field(NamedTuple):
    """The forces per length that are not already in `Forces.drag` and `Forces.pull`.

    constant (n, k, 2): what does not change; varying: the rest, from places (n, k, 2) and a time,
    None if there is none.
    """

    constant: Floats
    varying: Callable[[Floats, float], Floats] | None


def _split_forces(forces: Forces, density: float, rest: Floats) -> _Field:
    """Return forces, without drag and pull, as a constant and a varying part.

    density: of the curves; rest (n, k, 2): their rest shapes. The linear part is in `Forces.drag`
    and `Forces.pull`.
    """
    constant = density * np.asarray(forces.gravity, float) - forces.pull * rest
    targets = []
    for attraction in forces.attractions:
        points = np.reshape(attraction.points, (-1, 2))
        if len(points) == 1:
            constant = constant + attraction.strength * points[0]
        else:
            # Which point is nearest needs few digits: argmax of x · p − |p|² / 2.
            offsets = (points - points[0]).astype(np.float32)
            lengths = (offsets**2).sum(axis=1) / 2
            targets.append((attraction.strength, points, offsets.T, lengths))
    for wind in forces.winds:
        constant = constant + wind.drag * np.asarray(wind.velocity)
    gusty = [wind for wind in forces.winds if wind.gust]

    def vary(places: Floats, time: float) -> Floats:
        """Return the varying part (n, k, 2) of the forces per length at positions and a time."""
        total = np.zeros_like(places)
        for wind in gusty:
            total += wind.drag * wind.gust_velocity(places, time)
        for strength, points, offsets, lengths in targets:
            closeness = (places - points[0]).astype(np.float32) @ offsets - lengths
            total += strength * points[closeness.argmax(axis=-1)]
        return total

    return _Field(constant, vary if gusty or targets else None)


def solve_in_forces(problem: Problem, forces: Forces, substeps: int = 4) -> Trajectory:
    """Return the motion of curves under forces: M q̈ + C q̇ + K q = Q(q, q̇, t) (Eq. 3.3).

    problem: of k curves beside each other, d = 2k, x and y of each in turn; its times are evenly
    spaced, its own force is added to the others. substeps: steps between two times. FinloopError if
    the problem is invalid, its times are uneven, or a curve begins below the floor.
    """
    problem = convert_problem(problem)
    material, times = problem.material, problem.times
    n, intervals = len(problem.rest), np.diff(problem.times)
    if substeps < 1:
        raise FinloopError(f"{substeps} steps between two times", "1 or more", "set 4")
    if not len(intervals) or not np.allclose(intervals, intervals[0], rtol=1e-9):
        raise FinloopError(
            "times that are not evenly spaced", "two times or more, evenly spaced", "space them"
        )
    rest = problem.rest.reshape(n, -1, 2)
    start = problem.state_at_start()
    lowest = float((problem.rest + start[0]).reshape(n, -1, 2)[..., 1].max())
    if forces.floor is not None and lowest > forces.floor + 1e-9 * (1 + abs(lowest)):
        raise FinloopError(
            f"a floor at y = {forces.floor:g} above the lower end of the drawing, y = {lowest:.4g}",
            f"a floor at {lowest:.4g} or below, that is larger",
            "lower the floor, or raise the drawing",
        )
    step = float(intervals[0]) / substeps
    basis = fourier_basis(problem)
    oscillators = curve_oscillators(basis, material)
    oscillators = replace(
        oscillators,
        damping=oscillators.damping + forces.drag,
        stiffness=oscillators.stiffness + forces.pull,
    )
    response = np.stack(oscillator_response(oscillators, np.array([step / 2, step])))
    factors = np.moveaxis(response, 1, 0).reshape(2, 2, 3, -1, 1)  # step, place or rate, of what
    half, whole = (np.moveaxis(factor, 1, 0) for factor in factors)
    holds = _find_holds(forces.is_held, basis.inverse(whole[2])[..., 0])
    field = _split_forces(forces, material.density, rest)
    constant = basis.transform(field.constant.reshape(n, -1) + problem.force_on_points())

    def push(places: Numbers, time: float) -> Numbers:
        """Return the coefficients of the force, from the coefficients of a displacement."""
        if field.varying is None:
            return constant
        places_now = rest + basis.inverse(places).reshape(rest.shape)
        return constant + basis.transform(field.varying(places_now, time).reshape(n, -1))

    state: Numbers = np.stack([basis.transform(part) for part in start])
    motion, force = [start], push(state[0], float(times[0]))
    for number in range(len(intervals) * substeps):
        time = times[0] + number * step
        if field.varying is not None:  # the last force is good enough to find the middle
            force = push(_advance(half[:, 0], state, force), time + step / 2)
        state = _advance(whole, state, force)
        is_shown = (number + 1) % substeps == 0
        if is_shown or forces.floor is not None or holds:
            points = basis.inverse(state)
            if _constrain(points.reshape(2, *rest.shape), rest, forces, holds):
                state = np.fft.rfft(points, axis=1)
            if is_shown:
                motion.append(points)
    displacement, velocity = np.stack(motion, axis=1)
    return Trajectory(times, displacement, velocity)


def _advance(factors: Numbers, state: Numbers, force: Numbers) -> Numbers:
    """Return positions and speeds (2, m, d) of oscillators after one step with a constant force.

    factors: of place, speed and force, (3, 2, m, 1); with (3, m, 1) places (m, d) are returned.
    """
    return np.asarray(factors[0] * state[0] + factors[1] * state[1] + factors[2] * force)


class _Hold(NamedTuple):
    """The held points (h,) of a curve, and how all its points react when they are put back.

    back (2, n, h): change of places and speeds of all points, for each held point that is 1 away.
    """

    curve: int
    points: NDArray[np.intp]
    back: Floats


def _find_holds(is_held: NDArray[np.bool_] | None, response: Floats) -> list[_Hold]:
    """Return one hold for each curve that has held points.

    is_held (n, k); response (2, n): how a force of 1 on point 0 changes the places and speeds of
    all points in a step.
    """
    if is_held is None:
        return []
    holds = []
    for curve in np.flatnonzero(is_held.any(axis=0)):
        points = np.flatnonzero(is_held[:, curve])
        changes = response[:, (np.arange(len(is_held))[:, None] - points) % len(is_held)]
        holds.append(_Hold(int(curve), points, -changes @ np.linalg.inv(changes[0, points])))
    return holds


def _constrain(state: Floats, rest: Floats, forces: Forces, holds: Sequence[_Hold]) -> bool:
    """Put held points back, and raise points to the floor; return whether any may have moved.

    state (2, n, k, 2): displacements and velocities, changed in place: points on the floor also
    lose speed. rest (n, k, 2): places at rest; holds: one for each curve with held points.
    """
    displacement, velocity = state
    moved = bool(holds)
    for curve, held, back in holds:
        state[:, :, curve] += back @ displacement[held, curve]
        state[:, held, curve] = 0.0
    if forces.floor is not None:
        room = forces.floor - rest[..., 1]  # largest y of a displacement
        is_below = displacement[..., 1] > room
        if is_below.any():
            moved = True
            displacement[is_below, 1] = room[is_below]
            lost = np.maximum(velocity[is_below, 1], 0.0)
            slide = velocity[is_below, 0]
            velocity[is_below, 1] -= lost
            velocity[is_below, 0] -= np.clip(slide, -forces.friction * lost, forces.friction * lost)
    return moved


def find_rest_time(motion: Trajectory) -> float | None:
    """Return the time from which on a curve is at rest; None if it still moves at the end.

    Speeds are the RMS of all points, from each time to the next, as a viewer sees them. At rest is
    a curve with at most the share AT_REST of its greatest speed.
    """
    steps = np.diff(motion.displacement, axis=0)
    speed = np.sqrt((steps**2).mean(axis=(1, 2))) / np.diff(motion.times)
    moving = np.flatnonzero(speed > AT_REST * speed.max())
    if not len(moving):
        return float(motion.times[0])
    after = int(moving[-1]) + 1
    return float(motion.times[after]) if after < len(speed) else None
