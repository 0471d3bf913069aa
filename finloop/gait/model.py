"""A gait: two key frames and a clock give the whole cycle (curve paper §4.2, Figs. 9, 12–14).

Glossary: *phase* 0…1 of a cycle; *keys* 1, 2, 1', 2' at phases 0, s, ½, ½ + s with s the *split*;
*subcycles* A 1→2, B 2→1', C 1'→2', D 2'→1; *tau* 0…1 evenly within one; γ bends the clock f.

The second half repeats the first by symmetry. "swap", an animal from the side: 1' is 1 with the
left and right limbs exchanged. "mirror", a fish from above: 1' is 1 reflected in the axis of the
body, left and right parts exchanged too. So C is A of the partner, D is B of the partner, and γ
belongs to A and B alone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from finloop.errors import FinloopError
from finloop.gait.descriptor import between, few_control

Points = NDArray[np.float64]
Ints = NDArray[np.int64]
Symmetry = Literal["swap", "mirror"]
SYMMETRIES: tuple[Symmetry, ...] = ("swap", "mirror")
SUBCYCLES = ("A", "B", "C", "D")
POOLED = "*"
"""The id whose γ holds for contours that a gait does not name."""


@dataclass(frozen=True)
class Gait:
    """What film teaches of a gait; no contours, so it drives any drawing.

    Attributes
    ----------
    gamma
        By id (or POOLED), then "A" and "B": one γ, or one per scale, coarse to fine as
        `curve.wavelet.scales` has them with `coarse` coefficients in the approximation. Scales
        finer than those named go by the last.
    support
        By id: phases (from, to) in which the foot is on the ground; to may be beyond 1. Swap only.
    confidence
        0…1, of the period.
    cycles, frames
        Of the film it was fitted to.
    residuals
        By clock: RMS distance of contours / body length, on frames left out of the fit.
    """

    name: str
    symmetry: Symmetry
    frequency_hz: float
    gamma: Mapping[str, Mapping[str, tuple[float, ...]]]
    split: float = 0.25
    wavelet: str = "coif2"
    coarse: int = 4
    support: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    source: str = ""
    confidence: float = 1.0
    cycles: float = 0.0
    frames: int = 0
    residuals: Mapping[str, float] = field(default_factory=dict)


def partner(name: str, names: Mapping[str, object] | set[str] | list[str]) -> str:
    """The id with left and right exchanged if it is among `names`, else the id itself."""
    for one, other in (("left", "right"), ("right", "left")):
        if one in name and (swapped := name.replace(one, other)) in names:
            return swapped
    return name


def reversal(n: int, start: int = 0) -> Ints:
    """Order (start − i) mod n of a closed contour's points: the other way round, an involution."""
    return (start - np.arange(n)) % n


def mirrored(points: Points, middle: float = 0.0, order: Ints | None = None) -> Points:
    """Contours (…, n, 2) reflected in the line y = middle, so renumbered that they turn as before.

    Of a film's outline, which starts at the snout, `order` is `reversal(n)`, the default; then
    twice is the identity, as with any order that undoes itself.
    """
    order = reversal(points.shape[-2]) if order is None else order
    return points[..., order, :] * [1, -1] + [0, 2 * middle]


def four_keys(
    one: Mapping[str, Points],
    two: Mapping[str, Points],
    symmetry: Symmetry,
    *,
    middle: float = 0.0,
    orders: Mapping[str, Ints] | None = None,
    offsets: Mapping[str, Points] | None = None,
) -> tuple[dict[str, Points], dict[str, Points], dict[str, Points], dict[str, Points]]:
    """Keys 1, 2, 1', 2' (Fig. 9) from keys 1 and 2, contours (n, 2) by id.

    Parameters
    ----------
    one, two
        Point i of an id belongs to point i of it in the other key, and (swap) of its partner.
    symmetry
        One of SYMMETRIES.
    middle
        y of the axis of a mirror.
    orders
        By id, of a mirror: the points' order, see `mirrored`; an id and its partner share one.
    offsets
        By id (2,), of a swap: how much farther right and down the id hangs on the body than its
        partner does; the partner's is the negative. A limb then keeps its hip.

    Raises
    ------
    FinloopError
        If ids or numbers of points differ between the keys or between partners.
    """
    _check_keys(one, two)
    keys = [{name: np.asarray(key[name], np.float64) for name in one} for key in (one, two)]
    later = [half_later(key, symmetry, middle, orders, offsets) for key in keys]
    return keys[0], keys[1], later[0], later[1]


def half_later(
    contours: Mapping[str, Points],
    symmetry: Symmetry,
    middle: float = 0.0,
    orders: Mapping[str, Ints] | None = None,
    offsets: Mapping[str, Points] | None = None,
) -> dict[str, Points]:
    """Contours (…, n, 2) by id as they are half a cycle later; twice is the identity.

    Parameters as of `four_keys`.

    Raises
    ------
    FinloopError
        If the symmetry is none of SYMMETRIES, or twice would not be the identity.
    """
    if symmetry not in SYMMETRIES:
        raise FinloopError(
            f"the symmetry {symmetry!r}", f"one of {', '.join(SYMMETRIES)}", "choose one of these"
        )
    out = dict[str, Points]()
    for name in contours:
        whose = partner(name, contours)
        if symmetry == "mirror":
            order = (orders or {}).get(name, reversal(contours[whose].shape[-2]))
            twin = (orders or {}).get(whose, order)
            undone = np.array_equal(order[twin], np.arange(len(order)))
            out[name] = mirrored(contours[whose], middle, order)
        else:
            offset = (offsets or {}).get(name, np.zeros(2))
            undone = np.allclose(offset, -np.asarray((offsets or {}).get(whose, -offset)))
            out[name] = contours[whose] + offset
        if not undone:
            raise FinloopError(
                f"half a cycle later, twice, is not {name!r} itself",
                "orders that undo one another, offsets that add up to 0",
                f"set them alike for {name!r} and {whose!r}",
            )
    return out


def subcycle(phase: Points, split: float) -> tuple[Ints, Points]:
    """Which subcycle (0…3 for A…D) and which tau in [0, 1) phases of any shape fall in."""
    ends = _ends(split)
    phase = np.mod(phase, 1.0)
    which = np.searchsorted(ends[1:-1], phase, side="right")
    return which, (phase - ends[which]) / (ends[which + 1] - ends[which])


def gamma_of(gait: Gait, name: str, which: int) -> tuple[float, ...]:
    """γ of an id in subcycle A (0) or B (1); an id that the gait does not name goes by POOLED."""
    of = gait.gamma.get(name, gait.gamma.get(POOLED))
    return (0.0,) if of is None else of[SUBCYCLES[which]]


def cycle(
    one: Mapping[str, Points],
    two: Mapping[str, Points],
    gait: Gait,
    frames: int,
    *,
    middle: float = 0.0,
    orders: Mapping[str, Ints] | None = None,
    offsets: Mapping[str, Points] | None = None,
    closed: Mapping[str, bool] | None = None,
    control: int | None = None,
) -> dict[str, Points]:
    """A whole cycle, (frames, n, 2) by id, from two keys and γ (Figs. 12–14).

    Frame k is at phase k / frames, so the frame after the last is the first.

    Parameters
    ----------
    one, two, middle, orders, offsets
        As for `four_keys`.
    gait
        Its γ, split and symmetry are used.
    frames
        At least 4.
    closed
        By id; True if not named.
    control
        Control points of each contour (Fig. 14), a power of two; None = all.

    Raises
    ------
    FinloopError
        As `four_keys`; if frames are below 4, or γ per scale or control points are asked of
        contours whose number of points is no power of two.
    """
    return at_phases(
        one, two, gait, np.arange(_checked_frames(frames)) / frames, middle=middle, orders=orders,
        offsets=offsets, closed=closed, control=control,
    )  # fmt: skip


def at_phases(
    one: Mapping[str, Points],
    two: Mapping[str, Points],
    gait: Gait,
    phases: Points,
    *,
    middle: float = 0.0,
    orders: Mapping[str, Ints] | None = None,
    offsets: Mapping[str, Points] | None = None,
    closed: Mapping[str, bool] | None = None,
    control: int | None = None,
) -> dict[str, Points]:
    """As `cycle`, at any phases (f,)."""
    keys = four_keys(one, two, gait.symmetry, middle=middle, orders=orders, offsets=offsets)
    phases = np.mod(np.asarray(phases, np.float64), 1.0)
    which, tau = subcycle(np.mod(phases, 0.5), gait.split)
    out = dict[str, Points]()
    for name in one:
        loop = (closed or {}).get(name, True)
        frames = np.empty((len(which), *keys[0][name].shape))
        for sub in range(2):
            source, to = keys[sub][name], keys[sub + 1][name]
            gamma = gamma_of(gait, name, sub)
            frames[which == sub] = between(
                source, to, tau[which == sub], gamma, gait.wavelet, gait.coarse, loop
            )
        if control is not None:
            frames = few_control(frames, control, gait.wavelet, loop)
        out[name] = frames
    # C and D are the images of A and B, not computed anew: a descriptor is not quite the same
    # for a contour that is numbered the other way round.
    later = half_later(out, gait.symmetry, middle, orders, offsets)
    return {
        name: np.where((phases < 0.5)[:, None, None], frames, later[name])
        for name, frames in out.items()
    }


def _ends(split: float) -> Points:
    if not 0 < split < 0.5:
        raise FinloopError(
            f"a split of {split:g}", "between 0 and 0.5", "put key 2 between keys 1 and 1'"
        )
    return np.array([0.0, split, 0.5, 0.5 + split, 1.0])


def _checked_frames(frames: int) -> int:
    if frames < 4:
        raise FinloopError(
            f"a cycle of {frames} frames", "at least 4, one a key", "ask for 24 frames or more"
        )
    return frames


def _check_keys(one: Mapping[str, Points], two: Mapping[str, Points]) -> None:
    """Refuse keys that do not belong together, all that is wrong in one message."""
    wrong = [
        f"{name!r} only in key {which}"
        for which, here, there in ((1, one, two), (2, two, one))
        for name in here
        if name not in there
    ]
    for name in one:
        if name in two and len(one[name]) != len(two[name]):
            wrong.append(f"{name!r} has {len(one[name])} points in key 1, {len(two[name])} in 2")
        other = partner(name, one)
        if name < other and len(one[name]) != len(one[other]):
            wrong.append(
                f"{name!r} has {len(one[name])} points, its partner {other!r} {len(one[other])}"
            )
    if wrong or not one:
        raise FinloopError(
            f"the keys do not belong together: {'; '.join(wrong[:6]) or 'no contours'}",
            "the same ids and numbers of points in both keys and in left and right",
            "give contours that belong together the same id and resample them alike",
        )
