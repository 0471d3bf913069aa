"""Independent oscillators: ρ a″ + c a′ + k a = Q (curve paper Eq. 3.16).

Glossary: *a* (m, d) their places, *v* their speeds, in d directions; c, k (m,); γ = c / 2ρ and
r = −γ ± √(γ² − k / ρ) the roots of ρr² + c r + k = 0. (The paper prints r̈, ṙ, e₀ and f₀.)

With ρ = 0 the speed follows from c a′ + k a = Q. Numbers may be complex, as FFTs are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import factorial
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError

NODES = (1 - np.cos(np.pi * np.arange(5) / 4)) / 2
"""Chebyshev's five nodes: fractions of a step at which the force is evaluated."""

_ROUNDS = 60  # most iterations between places and forces
_FINEST = 2**12  # most steps from one time to the next

Numbers = NDArray[np.inexact]
Force = Callable[[float, Numbers], Numbers]
"""The force Q (m, d) as a function of time and places (m, d)."""


@dataclass(frozen=True)
class Oscillators:
    """m independent oscillators: density ρ, the same for all; damping c (m,); stiffness k (m,)."""

    density: float
    damping: Floats
    stiffness: Floats

    def count_root_kinds(self) -> dict[str, int]:
        """Count the oscillators by their roots r: "real", "double" and "complex".

        Real roots creep, complex roots swing. If ρ = 0 every oscillator has one root, and counts as
        real or, with c = 0, as double.
        """
        inside = self.damping**2 - 4 * self.density * self.stiffness
        return {
            "real": int((inside > 0).sum()),
            "double": int((inside == 0).sum()),
            "complex": int((inside < 0).sum()),
        }


class Response(NamedTuple):
    """Factors (t, m) that give places and speeds of m oscillators at t times, for a constant force.

    With a₀, v₀ the first place and speed and Q the force, a = place · a₀ + speed · v₀ + pushed · Q.
    The three `_rate` fields give the speed a′ in the same way.
    """

    place: Floats
    speed: Floats
    pushed: Floats
    place_rate: Floats
    speed_rate: Floats
    pushed_rate: Floats


def response(oscillators: Oscillators, times: Floats, forced: bool = True) -> Response:
    """Return the factors of the solution of Eq. 3.16 at times (t,) since the start.

    forced: False sets the factor `pushed` of the force to 0. The formulas neither cancel nor
    overflow near double roots, which are the limit of real and of complex roots.
    """
    t = np.asarray(times, np.float64)[:, None]
    k = oscillators.stiffness
    if oscillators.density == 0:
        rate = k / oscillators.damping
        place = np.exp(-rate * t)
        none = np.zeros_like(place)
        pushed = t * _mean_decay(rate * t) / oscillators.damping
        return Response(place, none, pushed, -rate * place, none, place / oscillators.damping)
    gamma, square = oscillators.damping / (2 * oscillators.density), k / oscillators.density
    inside = gamma**2 - square
    root, real = np.sqrt(np.abs(inside)), inside >= 0
    slow = np.where(real, square / np.where(real & (gamma + root > 0), gamma + root, 1), gamma)
    even = np.exp(-slow * t)
    speed = even * t
    apart, turn = 2 * root[real] * t, root[~real] * t
    even[:, real] *= (1 + np.exp(-apart)) / 2
    speed[:, real] *= _mean_decay(apart)
    even[:, ~real] *= np.cos(turn)
    speed[:, ~real] *= np.sin(turn) / np.where(turn > 0, turn, 1) + (turn == 0)
    place = even + gamma * speed
    pushed = np.zeros_like(place)
    if forced:
        pushed = (
            t**2
            * _force_response(2 * gamma * t, square * t**2, slow * t, place)
            / oscillators.density
        )
    return Response(
        place, speed, pushed, -square * speed, even - gamma * speed, speed / oscillators.density
    )


def _mean_decay(x: Floats) -> Floats:
    """Return (1 − e^−x) / x, which is 1 at 0."""
    return np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1), 1)


def _force_response(total: Floats, product: Floats, slow: Floats, place: Floats) -> Floats:
    """Return (1 − place) / product, and its limit at 0, without loss of digits.

    −x, −y are the roots in steps of t, `total` = x + y, `product` = xy, `slow` the x nearer 0. With
    D = `_mean_decay` the value is (D(x) − D(y)) / (y − x), or a power series if both are small.
    """
    term, before = np.ones_like(product), np.zeros_like(product)
    series = np.zeros_like(product)
    near, spread = np.minimum(total, 0.5), np.minimum(product, 0.25)
    for n in range(1, 16):
        series += (-1) ** (n + 1) * term / factorial(n + 1)
        term, before = near * term - spread * before, term
    far = product < 0.01 * total**2  # x is much nearer 0 than y
    x, y = np.where(far, slow, 0), np.where(far, total - slow, 1)
    apart = (_mean_decay(x) - _mean_decay(y)) / (y - x)
    rest = (1 - place) / np.where(product > 0, product, 1)
    return np.where((total < 0.5) & (product < 0.25), series, np.where(far, apart, rest))


def motion(
    oscillators: Oscillators, a: Numbers, v: Numbers, times: Floats, force: Numbers | None
) -> tuple[Numbers, Numbers]:
    """Return exact places and speeds, each (t, m, d), of m oscillators under a constant force.

    a, v (m, d): places and speeds at the start; times (t,): since the start; force (m, d), or None
    for none.
    """
    table = Response(*(part[..., None] for part in response(oscillators, times, force is not None)))
    places, speeds = table.place * a + table.speed * v, table.place_rate * a + table.speed_rate * v
    if force is not None:
        places, speeds = places + table.pushed * force, speeds + table.pushed_rate * force
    return places, speeds


# --- forces that depend on place and time


def forced_motion(
    oscillators: Oscillators, a: Numbers, v: Numbers, times: Floats, force: Force, tolerance: float
) -> tuple[Numbers, Numbers, float]:
    """Return places and speeds, each (t, m, d), and their error, for a force of place and time.

    a, v (m, d): places and speeds at times[0]; times (t,). The error is the change of the places
    when the steps were last halved, relative to the farthest place; it is at most `tolerance`.
    Within a step the force is a polynomial in time, fitted iteratively at NODES and integrated
    exactly. FinloopError if the force changes too fast.
    """
    if oscillators.density == 0:
        v = (force(float(times[0]), a) - oscillators.stiffness[:, None] * a) / oscillators.damping[
            :, None
        ]
    before, steps = None, 1
    while steps <= _FINEST:
        state = _integrate_steps(oscillators, a, v, times, force, steps, tolerance)
        if state is not None and before is not None:
            size = np.abs(state[0]).max()
            change = float(np.abs(state[0] - before).max() / size) if size else 0.0
            if change <= tolerance:
                return *state, change
        before = None if state is None else state[0]
        steps *= 2
    raise FinloopError(
        f"the force changes too fast for {_FINEST} steps from one time to the next",
        f"a smooth force, with places accurate to {tolerance:g}",
        "smooth or weaken the force, or pass times that lie closer together",
    )


def _integrate_steps(
    oscillators: Oscillators,
    a: Numbers,
    v: Numbers,
    times: Floats,
    force: Force,
    steps: int,
    tolerance: float,
) -> tuple[Numbers, Numbers] | None:
    """Run `forced_motion` with `steps` steps between times; None if the iteration fails."""
    places, speeds = [a], [v]
    width, tables = 0.0, None
    for start, stop in pairwise(times):
        if tables is None or not np.isclose(stop - start, width, rtol=1e-12, atol=0):
            width = stop - start
            tables = _tables(oscillators, width / steps)
        for number in range(steps):
            state = _step(a, v, start + number * width / steps, force, tables, tolerance)
            if state is None:
                return None
            a, v = state
        places.append(a)
        speeds.append(v)
    return np.stack(places), np.stack(speeds)


class Tables(NamedTuple):
    """Factors for one step: `free` without force; `place`, `speed` for the force at each node."""

    step: float
    free: Response
    place: Floats  # (nodes, m, nodes)
    speed: Floats


def _tables(oscillators: Oscillators, step: float) -> Tables:
    """Return the tables, from matrix exponentials of the oscillators' equations.

    With w₀′ = w₁, w₁′ = w₂, … and force w₀ they hold the responses to τ^p / p!, τ in steps.
    """
    m, count = len(oscillators.stiffness), len(NODES)
    first = 1 if oscillators.density == 0 else 2
    system = np.zeros((m, first + count, first + count))
    if oscillators.density == 0:
        system[:, 0, 0] = -step * oscillators.stiffness / oscillators.damping
        system[:, 0, 1] = step / oscillators.damping
        scale = np.ones(m)
    else:  # place and speed per step, the place scaled so that both are of similar size
        scale = np.maximum(1, step * np.sqrt(oscillators.stiffness / oscillators.density))
        system[:, 0, 1] = scale
        system[:, 1, 0] = -(step**2) * oscillators.stiffness / oscillators.density / scale
        system[:, 1, 1] = -step * oscillators.damping / oscillators.density
        system[:, 1, 2] = step**2 / oscillators.density
    chain = np.arange(first, first + count - 1)
    system[:, chain, chain + 1] = 1
    powers_of_system = scipy.linalg.expm(NODES[:, None, None, None] * system)
    powers = np.array([factorial(p) for p in range(count)])
    # Force at the nodes → coefficients of τ^p.
    fit = np.linalg.inv(NODES[:, None] ** np.arange(count))
    place = (powers_of_system[:, :, 0, first:] * powers) @ fit / scale[:, None]
    if oscillators.density == 0:
        at_node = np.eye(count)[:, None]
        speed = (at_node - oscillators.stiffness[:, None] * place) / oscillators.damping[:, None]
    else:
        speed = (powers_of_system[:, :, 1, first:] * powers) @ fit / step
    return Tables(step, response(oscillators, NODES * step), place, speed)


def _step(
    a: Numbers, v: Numbers, start: float, force: Force, tables: Tables, tolerance: float
) -> tuple[Numbers, Numbers] | None:
    """Return places and speeds after one step; None if the iteration does not converge."""
    free = tables.free
    base = free.place[..., None] * a + free.speed[..., None] * v
    places = base
    for _ in range(_ROUNDS):
        pushes = np.stack(
            [force(start + c * tables.step, place) for c, place in zip(NODES, places, strict=True)]
        )
        following = base + np.einsum("jmi,imd->jmd", tables.place, pushes)
        change, size = np.abs(following - places).max(), np.abs(following).max()
        places = following
        if not np.isfinite(size) or change <= 1e-3 * tolerance * size:
            break
    else:
        return None
    if not np.isfinite(size):
        return None
    rate = free.place_rate[-1][:, None] * a + free.speed_rate[-1][:, None] * v
    return places[-1], rate + np.einsum("mi,imd->md", tables.speed[-1], pushes)
