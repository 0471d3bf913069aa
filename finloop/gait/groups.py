"""Move all contours of a limb together: those of one group of a drawing (curve paper §4.2).

A limb is a contour or a group of contours, such as a leg, its paw and a patch. Each contour is
blended between its own two poses. The points of a leg and of its paw then run a little differently
along their contours, and with a γ per scale at different times. So all contours but the largest are
shifted: each keeps the place at its neighbour that it has in both key poses.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from finloop.base.arrays import Floats, Points
from finloop.base.drawing import Curve, Drawing
from finloop.base.errors import FinloopError
from finloop.base.paint import shape_of
from finloop.curve.contour import nearest_on_curve
from finloop.gait.ground import Limbs
from finloop.gait.model import Gait, Keys, locate_in_subcycle, opposite_limb

NEAR = 0.001  # share of a contour's size: contours that are nearer than this touch
POWER = 3  # of distances, in the weights of shifts
FAR = 5  # a point that is so many times nearer to the carrier than to another moves by itself
CUT = 0.5  # share of the distance between two points that corners may be cut by, in both keys


def find_limbs(drawing: Drawing, gait: Gait) -> dict[str, list[str]]:
    """Return the ids of the contours of each limb, in drawing order.

    The limb of a contour is the first that the gait names of: its id, its groups from the nearest
    outwards. Else it is its nearest group that does not hold the whole drawing, or its own id.
    """
    named = gait.gamma.keys() | gait.support.keys()
    groups_of_contours = [set(drawing.groups.get(name, ())) for name in drawing.curves]
    everything = set.intersection(*groups_of_contours) if groups_of_contours else set()
    limbs = dict[str, list[str]]()
    for name in drawing.curves:
        shape = shape_of(name)
        groups = drawing.groups.get(name, ())
        known = (
            limb
            for limb in (shape, *groups)
            if limb in named or opposite_limb(limb, named) in named
        )
        outer = (group for group in groups if group not in everything)
        limbs.setdefault(next(known, next(outer, shape)), []).append(name)
    return limbs


def name_partners(limbs: Limbs, names: Mapping[str, object]) -> dict[str, str]:
    """Return new ids of contours, by old id, in which left and right partners differ only by side.

    Contours keep ids that say so already, such as `paw_left`. Others are numbered in their limb:
    `fore_left`, `fore_left/2`. names: of all contours. FinloopError if a limb and its partner have
    different numbers of contours.
    """
    new_names = dict[str, str]()
    for limb, contours in limbs.items():
        partner = opposite_limb(limb, limbs)
        count, partner_count = len(contours), len(limbs[partner])
        if count != partner_count:
            raise FinloopError(
                f"the limb {limb!r} has {count} contours, {partner!r} {partner_count}",
                "the same contours in left and right limbs, in the same order",
                f"draw what one of {limb!r} and {partner!r} lacks",
            )
        twins = {name: opposite_limb(name, names) for name in contours}
        is_paired = partner == limb or all(
            twin != name and twin in limbs[partner] for name, twin in twins.items()
        )
        for number, name in enumerate(contours, 1):
            numbered = limb if number == 1 else f"{limb}/{number}"
            new_names[name] = name if is_paired else numbered
    return new_names


def join_contours(
    layers: Mapping[str, Points],
    keys: Keys,
    limbs: Limbs,
    closed: Mapping[str, bool],
    phases: Floats,
    split: float,
) -> dict[str, Points]:
    """Return contours (frames, n, 2) by id, shifted so that each limb's contours stay together.

    layers: contours at phases (frames,) of a gait cycle; keys: key frames 1, 2, 1', 2', contours
    (n, 2) by id; closed: by id; split: phase of key 2. In the key frames nothing moves.
    """
    joined = {name: stack.copy() for name, stack in layers.items()}
    subcycle, tau = locate_in_subcycle(phases, split)
    for names in limbs.values():
        for name, carrier in _find_carriers(names, keys[0]):
            for number in range(4):
                frames = subcycle == number
                start, end = keys[number], keys[(number + 1) % 4]
                joined[name][frames] += _shifts_to_carrier(
                    joined[name][frames],
                    joined[carrier][frames],
                    [(key[name], key[carrier]) for key in (start, end)],
                    tau[frames],
                    closed[carrier],
                )
    return joined


def _find_carriers(names: Sequence[str], key: Mapping[str, Points]) -> list[tuple[str, str]]:
    """Return pairs (contour, carrier): which contour each smaller contour of a limb stays with.

    The carrier is the nearest of the largest contour and those listed before. key: contours (n, 2)
    by id.
    """
    largest = max(names, key=lambda name: float(np.hypot(*np.ptp(key[name], axis=0))))
    placed, left, pairs = [largest], [name for name in names if name != largest], []
    while left:
        gaps = {
            (name, carrier): np.linalg.norm(key[name][:, None] - key[carrier], axis=-1).min()
            for name in left
            for carrier in placed
        }
        name, carrier = min(gaps, key=lambda pair: gaps[pair])
        pairs.append((name, carrier))
        placed.append(name)
        left.remove(name)
    return pairs


def _shifts_to_carrier(
    stack: Points,
    carrier: Points,
    keys: Sequence[tuple[Points, Points]],
    tau: Floats,
    closed: bool,
) -> Points:
    """Return shifts (frames, n, 2) that keep a contour at its place on its carrier.

    Each point of the contour has a nearest place on the carrier in both keys, and a gap from it.
    Between the keys, place and gap are interpolated, which gives the shift of each point. Averages
    of these count. A point with the gap g weighs 1 / ((g + ε) (r + FAR g + ε))^POWER at the
    distance r. So what touches the carrier stays on it, and the rest keeps its shape.

    stack, carrier: contours (frames, n, 2); keys: of contour and carrier, (n, 2) each, at both
    ends; tau (frames,): share of the way from the first key to the second; closed: whether the
    carrier is.
    """
    (first, first_gap), (last, last_gap) = (
        nearest_on_curve(points, Curve(line, closed)) for points, line in keys
    )
    count = carrier.shape[1]
    way = last - first
    if closed:  # the shorter way round
        way = (way + count / 2) % count - count / 2
    share = tau[:, None]
    goal = _points_at(carrier, first + share * way)
    goal = goal + (1 - share)[..., None] * first_gap + share[..., None] * last_gap
    own = keys[0][0]
    near = NEAR * float(np.hypot(*np.ptp(own, axis=0)))
    gap = np.linalg.norm(first_gap, axis=1) + np.linalg.norm(last_gap, axis=1)
    # Contours that touch are drawn through few points, which cut their corners.
    gap = np.maximum(gap - CUT * np.linalg.norm(np.diff(own, axis=0), axis=1).mean(), 0)
    apart = np.linalg.norm(own[:, None] - own, axis=-1)
    weights = 1 / ((gap + near) * (apart + FAR * gap[:, None] + near)) ** POWER
    shifts: Points = (weights / weights.sum(axis=1, keepdims=True)) @ (goal - stack)
    return shifts


def _points_at(lines: Points, places: Floats) -> Points:
    """Return points (frames, m, 2) of closed polylines (frames, n, 2), between their vertices.

    places (frames, m): vertex numbers, with the share of the way to the next; beyond n they go on
    from 0.
    """
    count = lines.shape[1]
    before = np.floor(places).astype(int)
    share = (places - before)[..., None]
    rows = np.arange(len(lines))[:, None]
    points: Points = (1 - share) * lines[rows, before % count] + share * lines[
        rows, (before + 1) % count
    ]
    return points
