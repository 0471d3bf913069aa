"""A fitted gait drives another drawing: two key poses become a cycle (curve paper §4.2).

Keys 1 and 2 are drawings with the same ids; keys 1' and 2' follow by symmetry. In a "swap" limbs
whose ids differ by left and right exchange their poses: they should hang on the same place of the
body. In a "mirror" the axis is the horizontal middle line of the picture.
"""

from dataclasses import dataclass, replace
from math import ceil, log10

import numpy as np
from numpy.typing import NDArray

from finloop.base.drawing import Drawing, Morph
from finloop.errors import FinloopError
from finloop.gait.ground import Ground, Support, ground, grounded, supports
from finloop.gait.match import corresponding, mirror_orders
from finloop.gait.model import POOLED, Gait, cycle, partner
from finloop.morph.folds import folds, stays_simple
from finloop.morph.layers import MOST_FRAMES, MOST_POINTS, check_pairs, fitted

LEAST_FRAMES, LEAST_POINTS = 4, 8
LIFTED = 0.02  # of a limb's height
DIGITS = 5  # of the larger side of the drawing: a hundredth of a pixel where that is 1000 px

Points = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Transfer:
    """A drawing that goes.

    Attributes
    ----------
    morph
        One cycle, frame k at phase k / frames. Its tau is 0 at key 1, 1 at key 1', 0 again.
    before, after
        The ground as the drawn keys have it and as the frames have it, lengths in widths of the
        drawing (key 1, all contours); None where the gait or the drawing has no feet.
    outside
        By id: in how many frames the contour leaves the picture; those that do not are left out.
    lifted
        Feet that should stand in key 2 and are drawn higher than their partners, which should not.
    """

    morph: Morph
    before: Ground | None
    after: Ground | None
    outside: dict[str, int]
    lifted: tuple[str, ...]


def transfer(
    one: Drawing,
    two: Drawing,
    gait: Gait,
    frames: int,
    points: int = 128,
    control: int | None = None,
) -> Transfer:
    """The cycle of a drawing from its key poses 1 and 2, feet on the ground.

    Parameters
    ----------
    one, two
        Key poses with the same ids, each contour closed in both or open in both; the second is
        fitted into the picture of the first.
    gait
        Ids of the drawing that it does not name go by its pooled γ.
    frames
        Of the cycle, at least 4.
    points
        Of every contour; a power of two where γ is per scale, or with `control`.
    control
        Control points of every contour (Fig. 14), None for all.

    Raises
    ------
    FinloopError
        If the poses do not belong together, a foot has no height, or a number is out of range.
    """
    _check_numbers(frames, points)
    check_pairs(one, two)
    two = fitted(two, one.width, one.height)
    closed = {name: curve.closed for name, curve in one.curves.items()}
    keys = corresponding(one, two, gait.symmetry, points)
    middle, orders, offsets = one.height / 2, None, None
    if gait.symmetry == "mirror":
        orders = mirror_orders(*keys, closed)
    else:
        offsets = _offsets(keys[0], gait)
    layers = cycle(
        *keys,
        with_pooled(gait),
        frames,
        middle=middle,
        orders=orders,
        offsets=offsets,
        closed=closed,
        control=control,
    )
    width = float(np.ptp(np.concatenate([curve.points for curve in one.curves.values()])[:, 0]))
    support = gait.support if gait.symmetry == "swap" else {}
    before = _ground(layers, support, width)
    layers = grounded(layers, support)
    decimals = DIGITS - ceil(log10(max(one.width, one.height)))
    layers = {name: np.round(stack, decimals) + 0.0 for name, stack in layers.items()}  # no −0
    phase = np.arange(frames) / frames
    morph = Morph(
        tau=1 - np.abs(1 - 2 * phase),
        layers=layers,
        closed=closed,
        folds={name: folds(stack, closed[name]) for name, stack in layers.items()},
        continuous={
            name: stays_simple(np.concatenate([stack, stack[:1]]), closed[name])
            for name, stack in layers.items()
        },
        styles=two.styles | one.styles,
        width=one.width,
        height=one.height,
        decimals=decimals,
    )
    after = _ground(layers, support, width)
    lifted = _lifted(keys[1], gait, offsets) if offsets is not None else ()
    return Transfer(morph, before, after, _outside(morph), lifted)


def repeated(morph: Morph, cycles: int) -> Morph:
    """A cycle several times in a row."""
    return replace(
        morph,
        tau=np.tile(morph.tau, cycles),
        layers={name: np.tile(stack, (cycles, 1, 1)) for name, stack in morph.layers.items()},
        folds={name: np.tile(count, cycles) for name, count in morph.folds.items()},
    )


def with_pooled(gait: Gait) -> Gait:
    """The gait, with a γ for ids that it does not name: the mean of all it has, one for a limb."""
    if POOLED in gait.gamma or not gait.gamma:
        return gait
    pooled = {
        sub: (float(np.mean([np.mean(of[sub]) for of in gait.gamma.values()])),)
        for sub in ("A", "B")
    }
    return replace(gait, gamma={**gait.gamma, POOLED: pooled})


def _offsets(one: dict[str, Points], gait: Gait) -> dict[str, Points]:
    """How much lower a limb stands than its partner where both feet are down in key 1.

    The far limbs of a drawing often stand higher in the picture: farther up on the ground.
    """
    down = {name for name in one if any(0 in run for run in _wrapped(gait, name))}
    return {
        name: np.array([0, one[name][:, 1].max() - one[other][:, 1].max()])
        for name in down
        if (other := partner(name, one)) in down and other != name
    }


def _lifted(two: dict[str, Points], gait: Gait, offsets: dict[str, Points]) -> tuple[str, ...]:
    down = {
        name
        for name, spans in gait.support.items()
        if any(a <= gait.split + turn <= b for a, b in spans for turn in (0, 1))
    }
    out = []
    for name in down & two.keys():
        if (other := partner(name, two)) not in down and other in gait.support:
            lower = two[other][:, 1].max() - two[name][:, 1].max()
            if lower + offsets.get(name, np.zeros(2))[1] > LIFTED * np.ptp(two[other][:, 1]):
                out.append(name)
    return tuple(sorted(out))


def _wrapped(gait: Gait, name: str) -> list[Ints]:
    return [run % LEAST_FRAMES for run in supports(gait.support.get(name, ()), LEAST_FRAMES)]


def _ground(limbs: dict[str, Points], support: Support, width: float) -> Ground | None:
    found = ground(limbs, support)
    if not found.slide:
        return None
    slide = {name: far / width for name, far in found.slide.items()}
    return Ground(found.speed / width, slide)


def _outside(morph: Morph) -> dict[str, int]:
    size = np.array([morph.width, morph.height])
    out = {
        name: int(((stack < 0) | (stack > size)).any(axis=(1, 2)).sum())
        for name, stack in morph.layers.items()
    }
    return {name: count for name, count in out.items() if count}


def _check_numbers(frames: int, points: int) -> None:
    if not LEAST_FRAMES <= frames <= MOST_FRAMES:
        raise FinloopError(
            f"a cycle of {frames} frames",
            f"{LEAST_FRAMES} … {MOST_FRAMES}, one a key at least",
            "ask for 24 frames or more",
        )
    if not LEAST_POINTS <= points <= MOST_POINTS:
        raise FinloopError(
            f"contours of {points} points",
            f"{LEAST_POINTS} … {MOST_POINTS}",
            "ask for 128 points",
        )
