"""A gait: two key frames and γ, how unevenly time passes, make a cycle (§4.2, Fig. 9).

Glossary: *phase* 0…1 of a cycle; *keys* 1, 2, 1', 2' at phases 0, s, ½, ½ + s with s the *split*;
*subcycles* A 1→2, B 2→1', C 1'→2', D 2'→1; *tau* 0…1 evenly within one; γ bends the clock f;
*coarse* the number of coefficients in the approximation, at any number of points. So scale m means
the same for contours of 64 and of 256 points, and γ per scale fits both; γ per coefficient fits the
number of points that it was fitted to. An open contour is mirrored: 2n points, 2 `coarse`
coefficients in the approximation.

Between the key frames c_from and c_to of a subcycle the model is

    c(τ) = c_to + f(τ) d,   d = c_from − c_to,   f(τ) = 1 − (1 + γ)τ + γτ² = (1 − τ) − γ τ(1 − τ).

It is linear in γ, so least squares over frames y has a closed form:

    γ = −Σ τ(1 − τ) ⟨d, y − c_to − (1 − τ) d⟩ / Σ τ²(1 − τ)² ‖d‖²

The inner products run over what shares a γ: a limb, a scale, a coefficient, or one coordinate of it
(`gait.settings.Sharing`). c and d are wavelet coefficients, which the paper's f_m takes one by one.

Mostly the second half repeats the first by symmetry. "swap", an animal from the side: 1' is 1 with
the left and right limbs exchanged. "mirror", a fish from above: 1' is 1 reflected in the axis of
the body, with left and right parts exchanged, too. So C is the partner's A, D is the partner's B,
and γ belongs to A and B alone. Without symmetry, "none", as in a gallop, all four key frames are
given, and γ belongs to A, B, C and D.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Discriminator, Field, Tag

from finloop.base.arrays import Ints, Points
from finloop.base.errors import FinloopError
from finloop.base.settings import check_values
from finloop.curve.wavelet import (
    close_by_mirroring,
    count_halvings,
    drop_details,
    inverse_transform,
    scale_slices,
    wavelet_transform,
)
from finloop.gait.settings import Sharing, Symmetry

LETTERS: Mapping[Symmetry, str] = {"swap": "AB", "mirror": "AB", "none": "ABCD"}
"""By symmetry: the subcycles with a γ. They make up the first half of the cycle, or all of it."""
SHARINGS: tuple[Sharing, ...] = get_args(Sharing)
"""From one γ a limb to one for each coordinate of a coefficient."""
POOLED = "*"  # the id whose γ holds for contours that a gait does not name
MOST_GAMMA = 1000.0  # beyond it γ is a typing error, or that of a coordinate that hardly moves
DECIMALS = 6  # of a gait's record: far below what a film shows
# For errors about a gait's record: what is wanted, and what to do.
WANTED = "a gait as the stage `gait` writes it"
DO = "correct it by the examples in data/gaits/, or fit a gait: dvc repro gait"


def _check_power_of_two(count: int) -> int:
    """Return the count unchanged; ValueError unless it is a power of two."""
    if count & (count - 1):
        raise ValueError("no power of two")
    return count


def _check_spans(spans: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Return spans (from, to) of phase unchanged; ValueError if one is invalid or two overlap.

    A span is at most one cycle long, and may end in the next cycle: to ≤ 2.
    """
    if not all(0 <= start < end <= min(2, start + 1) for start, end in spans):
        raise ValueError("no list of [from, to], 0 ≤ from < to ≤ 2")
    ordered = sorted(spans)
    # After the last span comes the first one again, a cycle later.
    next_starts = [start for start, _ in ordered[1:]] + [start + 1 for start, _ in ordered[:1]]
    if any(end > start for (_, end), start in zip(ordered, next_starts, strict=True)):
        raise ValueError("spans that overlap")
    return spans


def _check_coefficient_gammas(rows: tuple[tuple[float, ...], ...]) -> tuple[tuple[float, ...], ...]:
    """Return γ, a row for each coefficient, unchanged; ValueError unless it is 2^k equal rows."""
    if len({len(row) for row in rows}) > 1:
        raise ValueError("one γ for some coefficients, and two, x and y, for others")
    _check_power_of_two(len(rows))
    return rows


def _tag_gammas(values: Any) -> str:
    """Return whether the γ in a record are for "coefficients" (lists) or for "scales"."""
    nested = isinstance(values, list | tuple) and values and isinstance(values[0], list | tuple)
    return "coefficients" if nested else "scales"


# γ beyond ±1 makes a limb turn back.
Number = Annotated[float, Field(ge=-MOST_GAMMA, le=MOST_GAMMA)]
ScaleGammas = Annotated[tuple[Number, ...], Field(min_length=1)]
CoefficientGammas = Annotated[
    tuple[Annotated[tuple[Number, ...], Field(min_length=1, max_length=2)], ...],
    AfterValidator(_check_coefficient_gammas),
]
Gammas = Annotated[
    Annotated[ScaleGammas, Tag("scales")] | Annotated[CoefficientGammas, Tag("coefficients")],
    Discriminator(_tag_gammas),
]
Subcycles = Annotated[
    Mapping[Annotated[str, Field(pattern="^[A-D]$")], Gammas], Field(min_length=2, max_length=4)
]
Spans = Annotated[tuple[tuple[float, float], ...], AfterValidator(_check_spans)]


@dataclass(frozen=True)
class Gait:
    """A gait fitted to film. It holds γ but no contours, so it can drive any drawing."""

    name: Annotated[str, Field(min_length=1)]
    symmetry: Symmetry
    frequency_hz: Annotated[float, Field(gt=0, lt=1000)]
    # by id (or POOLED), then by subcycle, see LETTERS: one γ, [γ]; or one for each scale from
    # coarse to fine, [γ, γ …], as `curve.wavelet.scale_slices` has them with `coarse` coefficients
    # in the approximation, the last for all finer scales; or one for each coefficient,
    # [[γ], [γ] …]; or one for each coordinate of each coefficient, [[γ of x, γ of y], …]
    gamma: Annotated[Mapping[str, Subcycles], Field(min_length=1)]
    split: Annotated[float, Field(gt=0, lt=0.5)] = 0.25
    wavelet: str = "coif2"
    coarse: Annotated[int, Field(ge=1, le=2**16), AfterValidator(_check_power_of_two)] = 4
    # by id: spans of phase (from, to) in which the foot is on the ground; `to` may exceed 1. Not
    # for a mirror
    support: Mapping[str, Spans] = field(default_factory=dict)
    source: str = ""
    # of the period; None if it was given, not found
    confidence: Annotated[float, Field(ge=0, le=1)] | None = 1.0
    # cycles, frames: of the film that it was fitted to
    cycles: Annotated[float, Field(ge=0)] = 0.0
    frames: Annotated[int, Field(ge=0)] = 0
    # by clock: RMS distance of contours / body length, on frames held out of the fit
    residuals: Mapping[str, Number] = field(default_factory=dict)
    # by id and subcycle, a number for each γ: how far what it is for moves between the keys, as a
    # share of the contour's motion; the squares add up to 1. Weights for `limb_gamma`
    motion: Mapping[str, Subcycles] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise ValueError unless each subcycle of LETTERS has γ, and a `motion` for each γ."""
        letters = LETTERS.get(self.symmetry)
        for name, subcycles in self.gamma.items():
            if letters is not None and sorted(subcycles) != list(letters):
                raise ValueError(
                    f"gamma.{name} is for {', '.join(sorted(subcycles))}, but a gait of symmetry"
                    f" {self.symmetry} has {', '.join(letters)}"
                )
        for name, subcycles in self.motion.items():
            for letter, values in subcycles.items():
                gammas = self.gamma.get(name, {}).get(letter, ())
                if np.shape(values) != np.shape(gammas):
                    raise ValueError(f"motion.{name}.{letter} has not one number for each γ")

    def contour_gamma(self, name: str, letter: str) -> tuple[Any, ...]:
        """Return the γ of a contour in a subcycle; else that of all contours together; else 0.

        name, letter: the contour's id and the subcycle, A … D.
        """
        return tuple(self.gamma.get(name, self.gamma.get(POOLED, {})).get(letter, (0.0,)))

    def limb_gamma(self, name: str, letter: str) -> float:
        """Return the mean γ of a contour in a subcycle, weighted by the energy of motion.

        name, letter: the contour's id and the subcycle. The weights are squares of `motion`, so
        that the result is the whole limb's least-squares γ. Without `motion` all γ weigh the same.
        """
        gammas = np.array(self.gamma[name][letter])
        weights = np.square(self.motion.get(name, {}).get(letter, np.zeros_like(gammas)))
        return float(np.average(gammas, weights=weights if weights.any() else None))

    @property
    def descriptor(self) -> "Descriptor":
        """Return how the gait's contours become wavelet coefficients."""
        return Descriptor(self.wavelet, self.coarse)


def gait_to_record(gait: Gait) -> dict[str, Any]:
    """Return a gait as plain values for a JSON file, rounded to DECIMALS.

    FinloopError if the gait is invalid, so that `gait_from_record` would reject its record.
    """
    content = json.loads(json.dumps(_round_floats(asdict(gait))))
    try:
        gait_from_record(content)
    except ValueError as error:
        raise FinloopError(str(error), WANTED, DO) from error
    return content


def gait_from_record(content: Any) -> Gait:
    """Return the gait that plain values of a JSON file describe.

    ValueError, with all problems, if the content is no gait.
    """
    gait, problems = check_values("gait", {"default": Gait}, content)
    if gait is None:
        raise ValueError("no gait: " + "; ".join(problems))
    return gait


def _round_floats(content: Any) -> Any:
    """Return nested plain values with all floats rounded to DECIMALS."""
    if isinstance(content, dict):
        return {key: _round_floats(item) for key, item in content.items()}
    if isinstance(content, list | tuple):
        return [_round_floats(item) for item in content]
    # + 0.0 turns -0.0 into 0.0
    return round(float(content), DECIMALS) + 0.0 if isinstance(content, float) else content


# --- the clock of a subcycle (Fig. 11)


def start_share(tau: Points, gamma: float | Points) -> Points:
    """Return the weight of a subcycle's first key frame: f(τ) = 1 − (1 + γ)τ + γτ² (§4.2).

    The second key frame has the rest. tau: shares 0-1 of the subcycle's time; gamma: the gait
    parameter γ. f falls from 1 at τ = 0 to 0 at τ = 1, evenly if γ = 0. It is monotone if |γ| ≤ 1:
    slow at its start for γ = −1, at its end for γ = 1.
    """
    return 1 - (1 + gamma) * tau + gamma * tau**2


def gamma_fraction(
    tau: Points, frames: Points, start: Points, end: Points
) -> tuple[Points, Points]:
    """Return numerators and denominators of the γ that fits each coordinate best.

    tau (s,): shares 0-1 of the subcycle's time; frames (s, …): coordinates at tau; start, end (…):
    coordinates of the key frames at both ends, whose shape both results have. Coordinates that
    share a γ have that of their sums. Formula: see the top of `gait.model`.
    """
    change = start - end
    bow = tau * (1 - tau)  # f(τ) = (1 − τ) − γ bow
    off_linear = np.tensordot(bow, frames - end, 1) - (bow @ (1 - tau)) * change
    return -off_linear * change, (bow @ bow) * change**2


def gamma_from_fractions(fractions: Iterable[tuple[Points, Points]]) -> float:
    """Return the one γ that fits several sets of coordinates together best.

    fractions: numerators and denominators of each set, see `gamma_fraction`; all are summed, so
    sets that move more count more. γ is 0 if nothing moves, or no frame lies between the keys.
    """
    numerator, denominator = np.sum([[np.sum(a), np.sum(b)] for a, b in fractions], axis=0)
    return float(numerator / denominator) if denominator > 0 else 0.0


# --- contours as wavelet descriptors


class Descriptor(NamedTuple):
    """How contours become wavelet coefficients (§2.2): wavelet, and size of the coarsest scale.

    wavelet: its name; coarse: number of coefficients of the coarsest scale, a power of two. Of an
    open contour (not closed) n counts both halves: it is mirrored, and has 2 `coarse`.
    """

    wavelet: str = "coif2"
    coarse: int = 4

    def count_levels(self, n: int, closed: bool = True) -> int:
        """Return how many halvings take n points to the coarsest scale; 0 if n is not larger."""
        levels = count_halvings(n) - (self.coarse.bit_length() - 1)  # log₂ n − log₂ coarse
        return max(0, levels if closed else levels - 1)  # open: 2 `coarse` in the coarsest scale

    def coefficients(self, points: Points, closed: bool = True) -> Points:
        """Return the wavelet coefficients of contours (…, n, 2): (…, n, 2), if open (…, 2n, 2)."""
        points = points if closed else close_by_mirroring(points)
        levels = self.count_levels(points.shape[-2], closed)
        return wavelet_transform(points, self.wavelet, levels)

    def contours(self, coefficients: Points, n: int, closed: bool = True) -> Points:
        """Return the contours (…, n, 2) with given coefficients: the inverse of `coefficients`.

        coefficients: (…, n, 2), of an open contour (…, 2n, 2).
        """
        levels = self.count_levels(coefficients.shape[-2], closed)
        return inverse_transform(coefficients, self.wavelet, levels)[..., :n, :]

    def scales(self, n: int, closed: bool = True) -> list[slice]:
        """Return the slice of each scale in n coefficients, from coarse to fine."""
        return scale_slices(n, self.count_levels(n, closed))

    def spread_gammas(self, gammas: ArrayLike, n: int, closed: bool = True) -> Points:
        """Return γ for each of n coefficients, (n, 1), or for x and y of each, (n, 2).

        gammas: one of all, or one per scale from coarse to fine, the last for all finer scales; or
        one per coefficient, (n, 1), or per coordinate, (n, 2), which are returned unchanged.
        FinloopError if those are not n.
        """
        values = np.asarray(gammas, np.float64)
        if values.ndim == 1:
            spread = np.empty((n, 1))
            for number, scale in enumerate(self.scales(n, closed)):
                spread[scale] = values[min(number, len(values) - 1)]
            return spread
        if len(values) != n:
            raise FinloopError(
                f"γ for {len(values)} coefficients, and contours with {n}",
                "contours with as many points as those that γ was fitted to",
                "pool γ first: pool_gammas, as for another drawing",
            )
        return values


def interpolate_contours(
    start: Points,
    end: Points,
    tau: Points,
    gammas: ArrayLike,
    descriptor: Descriptor,
    closed: bool = True,
) -> Points:
    """Return the contours (frames, n, 2) between two key frames (n, 2) of a subcycle.

    tau (frames,): 0 at `start`, 1 at `end`. A contour is end + f(τ) (start − end), f =
    `start_share`. gammas: γ as in `Gait.gamma`; descriptor: how contours become coefficients;
    closed: whether they are closed. FinloopError if γ are of another number of coefficients.
    """
    tau, gamma = tau[:, None, None], np.asarray(gammas, np.float64)
    if gamma.size == 1:  # All coefficients, and so all points, move alike: no transform is needed.
        return end + start_share(tau, gamma.ravel()) * (start - end)
    difference = descriptor.coefficients(start - end, closed)
    shares = start_share(tau, descriptor.spread_gammas(gamma, len(difference), closed))
    return end + descriptor.contours(shares * difference, len(end), closed)


def reduce_control_points(
    points: Points, control: int, wavelet: str, closed: bool = True
) -> Points:
    """Return contours (…, n, 2) rebuilt from only `control` control points each (Fig. 14).

    wavelet: of the transform; closed: whether the contours are closed. FinloopError if `control` is
    no power of two, or exceeds the number of points.
    """
    if control < 1 or control & (control - 1):
        raise FinloopError(
            f"{control} control points", "a power of two", "set 4, 16 or 64 control points"
        )
    level = count_halvings(points.shape[-2]) - (control.bit_length() - 1)
    if level < 0:
        raise FinloopError(
            f"{control} control points for contours of {points.shape[-2]} points",
            "at most as many control points as points",
            "set fewer control points, or give the contours more points",
        )
    return drop_details(points, wavelet, level, closed) if level else points


# --- symmetry


def opposite_limb(name: str, names: Mapping[str, object] | set[str] | list[str]) -> str:
    """Return the id of the left-right partner of a limb if `names` has it, else the id itself."""
    for side, opposite in (("left", "right"), ("right", "left")):
        if side in name and (swapped := name.replace(side, opposite)) in names:
            return swapped
    return name


def reversed_order(n: int, start: int = 0) -> Ints:
    """Return the indices (n,) that reverse a closed contour, with point `start` first."""
    return (start - np.arange(n)) % n


def mirror_contours(points: Points, middle: float = 0.0, order: Ints | None = None) -> Points:
    """Return contours (…, n, 2) reflected in the line y = middle, and renumbered.

    order (n,): the points' old numbers in their new order, by default `reversed_order(n)`: an
    outline then still runs clockwise from the snout.
    """
    order = reversed_order(points.shape[-2]) if order is None else order
    return points[..., order, :] * [1, -1] + [0, 2 * middle]


KEY_NAMES = ("1", "2", "1'", "2'")
Keys = Sequence[Mapping[str, Points]]
"""Key frames 1 and 2, without symmetry also 1' and 2': contours (n, 2) by id."""


@dataclass(frozen=True)
class HalfCycleLayout:
    """How contours of the second half of a gait cycle lie, compared with their twins."""

    middle: float = 0.0  # mirror: y of the axis
    # mirror, by id: the points' order, see `mirror_contours`; an id and its partner share one
    orders: Mapping[str, Ints] | None = None
    # swap, by id, (2,): how much farther right and down the limb hangs on the body than its
    # partner, whose offset is the negative. A limb then keeps its hip
    offsets: Mapping[str, Points] | None = None

    def order(self, name: str, count: int) -> Ints:
        """Return the order (count,) in which a mirrored contour takes its twin's points.

        By default the order is reversed.
        """
        return (self.orders or {}).get(name, reversed_order(count))

    def offset(self, name: str) -> Points:
        """Return how far (2,) right and down of its twin a contour lies; 0 if unknown."""
        return np.asarray((self.offsets or {}).get(name, np.zeros(2)))


def check_key_count(count: int, symmetry: Symmetry) -> None:
    """Raise FinloopError unless there are 2 key frames, or 4 if the gait has no symmetry."""
    wanted = len(LETTERS.get(symmetry, "AB"))
    if count != wanted:
        raise FinloopError(
            f"{count} key poses for a gait of symmetry {symmetry!r}",
            "two: 1 and 2" if wanted == 2 else "four: 1, 2, 1' and 2', in this order",
            "give that many, or choose a gait of another symmetry",
        )


def four_key_frames(
    keys: Keys, symmetry: Symmetry, layout: HalfCycleLayout = HalfCycleLayout()
) -> list[dict[str, Points]]:
    """Return key frames 1, 2, 1', 2' (Fig. 9), contours (n, 2) by id; symmetry gives 1' and 2'.

    keys: 1 and 2, from which the others follow by symmetry; all four if the symmetry is "none".
    Equal point numbers mean the same place of the body in all keys and, if the symmetry is "swap",
    in left-right partners. layout: where the second half of the cycle is placed. FinloopError, with
    up to six problems, if there are too few or too many keys, or ids or numbers of points differ
    between the keys or between partners.
    """
    check_key_count(len(keys), symmetry)
    key1, problems = keys[0], list[str]()
    for title, key in zip(KEY_NAMES[1:], keys[1:], strict=False):
        problems += [f"{name!r} only in key 1, not {title}" for name in key1 if name not in key]
        problems += [f"{name!r} only in key {title}, not 1" for name in key if name not in key1]
        for name in key1.keys() & key.keys():
            if len(key1[name]) != len(key[name]):
                counts = f"{len(key1[name])} points in key 1, {len(key[name])} in {title}"
                problems.append(f"{name!r} has {counts}")
    for name in key1 if symmetry != "none" else ():
        count, twin = len(key1[name]), opposite_limb(name, key1)
        if name < twin and count != len(key1[twin]):
            problems.append(f"{name!r} has {count} points, its partner {twin!r} {len(key1[twin])}")
    if problems or not key1:
        raise FinloopError(
            f"the keys do not match: {'; '.join(problems[:6]) or 'no contours'}",
            "the same ids and numbers of points in all keys and in left and right",
            "give the contours of a pair the same id and resample them alike",
        )
    given = [{name: np.asarray(key[name], np.float64) for name in key1} for key in keys]
    if symmetry == "none":
        return given
    return given + [contours_half_cycle_later(key, symmetry, layout) for key in given]


def contours_half_cycle_later(
    contours: Mapping[str, Points], symmetry: Symmetry, layout: HalfCycleLayout = HalfCycleLayout()
) -> dict[str, Points]:
    """Return the contours (…, n, 2), by id, that symmetry predicts half a cycle later.

    A left limb gets the contour of its right twin, and the other way round; an id without a partner
    is its own twin. symmetry, layout: "swap" moves the twin's contour by the limb's offset;
    "mirror" reflects it in the line y = middle, and takes its points in the limb's order. Two calls
    give the first contours again: FinloopError if the layout prevents that, or there is no such
    symmetry.
    """
    if LETTERS.get(symmetry) != "AB":
        raise FinloopError(
            f"the symmetry {symmetry!r}", "'swap' or 'mirror'", "choose one of these"
        )
    later = dict[str, Points]()
    for name in contours:
        twin = opposite_limb(name, contours)
        if symmetry == "mirror":
            count = contours[twin].shape[-2]
            order, twin_order = layout.order(name, count), layout.order(twin, count)
            twin_undoes_it = np.array_equal(order[twin_order], np.arange(count))
            later[name] = mirror_contours(contours[twin], layout.middle, order)
        else:
            offset = layout.offset(name)
            twin_undoes_it = np.allclose(offset, -layout.offset(twin))
            later[name] = contours[twin] + offset
        if not twin_undoes_it:
            raise FinloopError(
                f"two half cycles later the contour {name!r} is not what it was",
                "orders of points that undo each other, and offsets that add up to 0",
                f"correct the orders or offsets of {name!r} and {twin!r} in the HalfCycleLayout",
            )
    return later


def locate_in_subcycle(phase: Points, split: float) -> tuple[Ints, Points]:
    """Return the subcycle of each phase, 0…3 for A…D, and what share of it is over (0–1).

    phase: in cycles, an array of any shape, which both results have too; split: phase of key 2,
    where A ends. FinloopError unless the split is between 0 and 0.5.
    """
    if not 0 < split < 0.5:
        raise FinloopError(
            f"a split of {split:g}, the phase of key 2",
            "more than 0 and less than 0.5, in cycles",
            "correct the gait's split, such as 0.25",
        )
    ends = np.array([0.0, split, 0.5, 0.5 + split, 1.0])
    phase = np.mod(phase, 1.0)
    subcycle = np.searchsorted(ends[1:-1], phase, side="right")
    return subcycle, (phase - ends[subcycle]) / (ends[subcycle + 1] - ends[subcycle])


def locate_with_symmetry(phase: Points, symmetry: Symmetry, split: float) -> tuple[Ints, Points]:
    """Return what `locate_in_subcycle` returns, with C counted as A, and D as B, by symmetry.

    Without symmetry there are all four.
    """
    return locate_in_subcycle(np.mod(phase, len(LETTERS[symmetry]) / 4), split)


# --- the cycle


def contours_at_phases(
    keys: Keys,
    gait: Gait,
    phases: Points,
    layout: HalfCycleLayout = HalfCycleLayout(),
    *,
    closed: Mapping[str, bool] | None = None,
    control: int | None = None,
    wavelet: str | None = None,
) -> dict[str, Points]:
    """Return contours (frames, n, 2), by id, at phases (frames,) of a gait cycle (Figs. 12–14).

    keys: two key frames, or four without symmetry; layout: where the second half of the cycle is
    placed; closed: by id, True if absent; control: to how many control points of a `wavelet`, by
    default the gait's, each contour is reduced, a power of two, None = not. FinloopError if the
    keys do not match, γ is per coefficient of another number of points, or that number is no power
    of two although there is a `control` or γ is per scale.
    """
    four_keys = four_key_frames(keys, gait.symmetry, layout)
    phases = np.mod(np.asarray(phases, np.float64), 1.0)
    subcycle, tau = locate_with_symmetry(phases, gait.symmetry, gait.split)
    cycle = dict[str, Points]()
    for name in four_keys[0]:
        is_closed = (closed or {}).get(name, True)
        gammas = [gait.contour_gamma(name, letter) for letter in LETTERS[gait.symmetry]]
        poses = interpolate_subcycles(
            [key[name] for key in four_keys], gammas, subcycle, tau, gait.descriptor, is_closed
        )
        if control is not None:
            poses = reduce_control_points(poses, control, wavelet or gait.wavelet, is_closed)
        cycle[name] = poses
    return exchange_second_half(cycle, phases, gait.symmetry, layout)


def interpolate_subcycles(
    keys: Sequence[Points], gammas: Sequence[tuple[Any, ...]], subcycle: Ints, tau: Points,
    descriptor: Descriptor, closed: bool = True,
) -> Points:  # fmt: skip
    """Return a contour (frames, n, 2) at given moments of a gait cycle's subcycles.

    keys: the contour (n, 2) in the four key frames; gammas: γ of A and B, without symmetry also of
    C and D; subcycle, tau (frames,): 0 for A, 1 for B …, and the share 0-1 of it that is over.
    """
    poses = np.empty((len(tau), *keys[0].shape))
    for number, gamma in enumerate(gammas):
        frames = subcycle == number
        start, end = keys[number], keys[(number + 1) % len(keys)]
        poses[frames] = interpolate_contours(start, end, tau[frames], gamma, descriptor, closed)
    return poses


def exchange_second_half(
    contours: Mapping[str, Points], phases: Points, symmetry: Symmetry, layout: HalfCycleLayout
) -> dict[str, Points]:
    """Return contours (frames, n, 2) by id; those in the second half are replaced by symmetry.

    The symmetric images turn frames of C and D, at the phases (frames,), into such of A and B, and
    back. So C and D are not computed anew: that would differ a little, as the descriptor depends on
    where a contour begins. Without symmetry all contours are returned unchanged.
    """
    if symmetry == "none":
        return dict(contours)
    later = contours_half_cycle_later(contours, symmetry, layout)
    in_first_half = (np.mod(phases, 1.0) < 0.5)[:, None, None]
    return {name: np.where(in_first_half, poses, later[name]) for name, poses in contours.items()}
