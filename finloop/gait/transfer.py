"""Drive a drawing by a fitted gait: two key poses become a cycle (curve paper §4.2).

Keys 1 and 2 are drawings with the same ids; keys 1' and 2' follow by symmetry. In a "swap" left and
right limbs exchange their poses, so a limb and its partner should hang at the same place of the
body. In a "mirror" the axis is the horizontal middle line of the picture. Without symmetry 1' and
2' are drawings, too.

γ per coefficient stays with the contour that it was fitted to: a drawing begins its contours
elsewhere, and moves other coefficients. So γ is pooled to one a limb, weighted by energy.

Points of two poses correspond although parts turn, as limbs and tails do. A closed contour is
renumbered so that it is most like the other contour, up to a turn. Contours are complex here,
a = x + iy about their mean, and likeness is |z| + UPRIGHT · Re z with z = Σ a_i conj(b_i): |z| is
the likeness after the best turn. The second part decides for contours that look the same turned,
such as an eye: they should not turn.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from finloop.base.arrays import Complex, Ints, Points
from finloop.base.drawing import Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.base.style import Paint
from finloop.curve.contour import Curve, orient_clockwise, resample_curve
from finloop.gait.ground import Ground, Limbs, Support, measure_ground, plant_feet
from finloop.gait.groups import find_limbs, join_contours, name_partners
from finloop.gait.model import (
    LETTERS,
    POOLED,
    Gait,
    HalfCycleLayout,
    Keys,
    check_key_count,
    contours_at_phases,
    four_key_frames,
    locate_in_subcycle,
    opposite_limb,
    reduce_control_points,
    reversed_order,
)
from finloop.gait.settings import Symmetry
from finloop.morph.layers import build_morph, check_pairs, check_sizes, fit_drawing, mix_styles

UPRIGHT = 0.02  # weight of the likeness without a turn
FINE = 8  # start points tried between two points of a contour
ROUNDS = 2  # of the search for the usual turn of a contour
LEAST_FRAMES = 4  # one per key
LIFT = 0.02  # least height of a lifted foot, as a share of the limb's height
DIGITS = (5,)  # significant digits of the larger side: 0.01 px if the drawing has 1000 px


@dataclass(frozen=True)
class Transfer:
    """One gait cycle of an animated drawing, and what may look wrong in it."""

    # one cycle, frame k at phase k / frames; tau rises from 0 at key 1 to 1 at key 1', then falls;
    # without symmetry it is the phase
    morph: Morph
    # before, after: the ground before and after `plant_feet`, lengths in widths of the drawing
    # (key 1, all contours); None if the gait or the drawing has no feet
    before: Ground | None
    after: Ground | None
    # number of frames in which a contour leaves the picture, by id, without zeros
    outside: dict[str, int]
    # feet that should stand in key 2 but are drawn higher than their lifted partners
    lifted: tuple[str, ...]


def animate_drawing(
    key_poses: Sequence[Drawing],
    gait: Gait,
    frames: int,
    points: int = 128,
    control: int | None = None,
    wavelet: str | None = None,
) -> Transfer:
    """Return the gait cycle of a drawing between its key poses, with its feet on the ground.

    The result also says how far feet slide before and after they are put on the ground, which
    contours leave the picture, and which feet are drawn too high (`Transfer`).
    key_poses: 1 and 2, without symmetry also 1' and 2', with the same ids, each contour closed in
    all or open in all; the others are fitted into the picture of the first. frames: of the cycle,
    at least 4. points, control: numbers of points and of control points (Fig. 14, None = no
    reduction) of every contour; powers of two if `control` is set or γ is per scale; wavelet: of
    the control points, by default the gait's. FinloopError if the poses do not match or are too few
    or many, a limb has no height, or a number is out of range.
    """
    check_sizes("cycle", frames, points, LEAST_FRAMES)
    check_key_count(len(key_poses), gait.symmetry)
    key1 = key_poses[0]
    for pose in key_poses[1:]:
        check_pairs(key1, pose)
    limbs = find_limbs(key1, gait)
    new_names = {name: name for name in key1.curves}
    if gait.symmetry != "none":
        new_names = name_partners(limbs, key1.curves)
    fitted = [fit_drawing(pose, key1.width, key1.height) for pose in key_poses]
    poses = [_rename_curves(pose, new_names) for pose in fitted]
    limbs = {limb: [new_names[name] for name in names] for limb, names in limbs.items()}
    closed = {name: curve.closed for name, curve in poses[0].curves.items()}
    keys = match_key_poses(poses, gait.symmetry, points)
    swap = gait.symmetry == "swap"  # an animal from the side
    offsets = _standing_offsets(_join_limbs(keys[0], limbs), gait) if swap else {}
    layout = HalfCycleLayout(
        offsets={name: offsets[limb] for limb in offsets for name in limbs[limb]}
    )
    if gait.symmetry == "mirror":
        orders = mirrored_point_orders(keys[0], keys[1], closed)
        layout = HalfCycleLayout(middle=key1.height / 2, orders=orders)
    phases = np.arange(frames) / frames
    limb_gait = _spread_gamma(pool_gammas(gait), limbs)
    wavelet = wavelet or gait.wavelet
    layers = contours_at_phases(
        keys, limb_gait, phases, layout, closed=closed, control=control, wavelet=wavelet
    )
    four_keys = four_key_frames(keys, gait.symmetry, layout)
    if control is not None:
        for key in four_keys:
            for name, contour in key.items():
                key[name] = reduce_control_points(contour, control, wavelet, closed[name])
    layers = join_contours(layers, four_keys, limbs, closed, phases, gait.split)
    width = float(np.ptp(np.concatenate([curve.points for curve in key1.curves.values()])[:, 0]))
    support = {} if gait.symmetry == "mirror" else gait.support
    planted = plant_feet(layers, support, limbs)
    styles = _mix_styles_over_cycle(poses, keys, planted, phases, gait.split)
    old_names = {new: old for old, new in new_names.items()}
    # tau: with symmetry from 0 at key 1 to 1 at 1', and back
    morph = build_morph(
        key1,
        phases if gait.symmetry == "none" else 1 - np.abs(1 - 2 * phases),
        {old_names[name]: stack for name, stack in planted.items()},
        {old_names[name]: paints for name, paints in styles.items()},
        DIGITS,
        repeats=True,
    )
    rounded = {new_names[name]: stack for name, stack in morph.layers.items()}
    return Transfer(
        morph,
        before=_ground_in_widths(layers, support, limbs, width),
        after=_ground_in_widths(rounded, support, limbs, width),
        outside=_count_frames_outside(morph),
        lifted=_find_lifted_feet(_join_limbs(keys[1], limbs), gait, offsets) if swap else (),
    )


def _mix_styles_over_cycle(
    poses: Sequence[Drawing],
    keys: Keys,
    layers: Mapping[str, Points],
    phases: Points,
    split: float,
) -> dict[str, tuple[Paint, ...]]:
    """Return, by id, each contour's paint at phases (frames,) of a gait cycle.

    poses, keys: the key poses and their contours; with only two, 1' is painted as 1, and 2' as 2.
    layers: contours (frames, n, 2) by id; split: phase of key 2.
    """
    subcycle, share = locate_in_subcycle(phases, split)
    paints = dict[str, dict[int, Paint]]()  # by id and frame
    for number in range(4):
        frames = np.flatnonzero(subcycle == number)
        start, end = number % len(poses), (number + 1) % len(poses)
        stacks = {name: stack[frames] for name, stack in layers.items()}
        ends = keys[start], keys[end]
        styles = mix_styles(poses[start], poses[end], share[frames], stacks, ends)
        for name, painted in styles.items():
            paints.setdefault(name, {}).update(zip(frames.tolist(), painted, strict=True))
    return {name: tuple(by_frame[k] for k in sorted(by_frame)) for name, by_frame in paints.items()}


def _rename_curves(drawing: Drawing, new_names: Mapping[str, str]) -> Drawing:
    """Return a drawing with new ids of its contours; new_names: by old id."""
    curves = {new_names[name]: drawing.curves[name] for name in new_names}
    styles = {new_names[name]: paint for name, paint in drawing.styles.items()}
    return replace(drawing, curves=curves, styles=styles)


def _join_limbs(key: Mapping[str, Points], limbs: Limbs) -> dict[str, Points]:
    """Return the points (m, 2) of all contours of each limb in a key pose, joined, by limb.

    key: points (n, 2) of each contour, by id; limbs: ids of each limb's contours.
    """
    return {limb: np.concatenate([key[name] for name in names]) for limb, names in limbs.items()}


def _spread_gamma(gait: Gait, limbs: Limbs) -> Gait:
    """Return a gait in which each contour of a limb has that limb's γ."""
    gamma = {
        name: gait.gamma[limb]
        for limb, names in limbs.items()
        if limb in gait.gamma
        for name in names
    }
    return replace(gait, gamma={**gait.gamma, **gamma})


def _count_frames_outside(morph: Morph) -> dict[str, int]:
    """Return, by id, the number of frames in which a contour leaves the picture; no zeros."""
    size = [morph.width, morph.height]
    counts = {
        name: int(((stack < 0) | (stack > size)).any(axis=(1, 2)).sum())
        for name, stack in morph.layers.items()
    }
    return {name: count for name, count in counts.items() if count}


def repeat_cycle(morph: Morph, cycles: int) -> Morph:
    """Return the morph of one gait cycle repeated `cycles` times."""
    return morph.take_frames(np.tile(np.arange(len(morph.tau)), cycles))


def pool_gammas(gait: Gait) -> Gait:
    """Return a gait for contours of any number of points: one γ in place of γ per coefficient.

    A contour with γ per coefficient or coordinate gets one γ (`Gait.limb_gamma`); one with γ per
    scale keeps them. Contours that the gait does not name have the γ of POOLED; if it has none,
    that is the mean over its contours.
    """
    gamma = dict(gait.gamma)
    for name, subcycles in gait.gamma.items():
        if any(np.ndim(gammas) > 1 for gammas in subcycles.values()):
            gamma[name] = {letter: (gait.limb_gamma(name, letter),) for letter in subcycles}
    if gamma and POOLED not in gamma:
        pooled = {
            letter: (float(np.mean([gait.limb_gamma(name, letter) for name in gait.gamma])),)
            for letter in LETTERS[gait.symmetry]
        }
        gamma[POOLED] = pooled
    return replace(gait, gamma=gamma, motion={})


def _standing_offsets(key1: dict[str, Points], gait: Gait) -> dict[str, Points]:
    """Return how much lower (0, y) each limb stands than its partner in key 1, by id.

    key1: contours (n, 2) by id, y down. The far limbs of a drawing often stand higher in the
    picture: farther up on the ground.
    """
    standing = _standing_limbs(gait, 0.0) & key1.keys()
    offsets = dict[str, Points]()
    for name in standing:
        twin = opposite_limb(name, key1)
        if twin in standing and twin != name:
            lower = key1[name][:, 1].max() - key1[twin][:, 1].max()
            offsets[name] = np.array([0, lower])
    return offsets


def _standing_limbs(gait: Gait, phase: float) -> set[str]:
    """Return the ids of the limbs whose foot is on the ground at a phase [cycles]."""
    rounding = 1e-9  # cycles, as in `support_frames`
    moments = phase, phase + 1, phase + 2  # a span ends at 2 at the latest
    return {
        name
        for name, spans in gait.support.items()
        for start, end in spans
        if any(start - rounding <= moment <= end + rounding for moment in moments)
    }


def _find_lifted_feet(
    key2: dict[str, Points], gait: Gait, offsets: Mapping[str, Points]
) -> tuple[str, ...]:
    """Return the ids of feet that stand in key 2 but are drawn above their lifted partners.

    key2: contours (n, 2) by id, y down; offsets: how much lower (0, y) a limb stands than its
    partner if both stand. Above means by more than a share LIFT of the partner's height.
    """
    standing = _standing_limbs(gait, gait.split)
    lifted = []
    for name in standing & key2.keys():
        if (twin := opposite_limb(name, key2)) not in standing and twin in gait.support:
            higher = key2[twin][:, 1].max() - key2[name][:, 1].max()
            if higher + offsets.get(name, np.zeros(2))[1] > LIFT * np.ptp(key2[twin][:, 1]):
                lifted.append(name)
    return tuple(sorted(lifted))


def _ground_in_widths(
    layers: Mapping[str, Points], support: Support, limbs: Limbs, width: float
) -> Ground | None:
    """Return the ground's speed and slides, in widths of the drawing; None without feet.

    layers: contours (frames, n, 2) by id; support: spans of phase on the ground by limb; limbs: ids
    of the contours by limb; width: of the drawing, px.
    """
    px = measure_ground(layers, support, limbs)
    if not px.slide:
        return None
    slide = {name: length / width for name, length in px.slide.items()}
    return Ground(px.speed / width, slide)


# --- corresponding points


def match_key_poses(
    poses: Sequence[Drawing], symmetry: Symmetry, points: int
) -> list[dict[str, Points]]:
    """Return key poses as contours (points, 2) by id; equal rows are the same body point.

    If the symmetry is "swap", so it is in left and right limbs: the one that comes first in the
    drawing numbers the points of both limbs in all poses. points: of every contour. FinloopError if
    a limb is closed and its partner or its other pose open.
    """
    keys = [dict[str, Points]() for _ in poses]
    for name, curve in poses[0].curves.items():
        twin = opposite_limb(name, poses[0].curves) if symmetry == "swap" else name
        others = [pose.curves[name] for pose in poses[1:]]
        kinds = {pose.closed for pose in (curve, poses[0].curves[twin], *others)}
        if len(kinds) > 1:
            raise FinloopError(
                f"one of {name!r} and {twin!r} is closed, the other open",
                "contours that are closed in every pose, left and right, or open in every pose",
                "close all of them, or none",
            )
        reference = keys[0].get(twin, resample_curve(orient_clockwise(curve), points).points)
        keys[0][name] = renumber_curve(reference, curve) if twin in keys[0] else reference
        usual_turn = _find_usual_turn(reference, others) if symmetry == "none" else None
        for key, other in zip(keys[1:], others, strict=True):
            key[name] = renumber_curve(reference, other, usual_turn)
    return keys


def _find_usual_turn(reference: Points, others: Sequence[Curve]) -> complex:
    """Return the mean turn of other curves from the reference (n, 2), as a unit number x + iy.

    Both ends of a leg look alike, and between four poses it turns far. So at first the leg counts
    as hanging straight down on average: its uppermost point is above its middle.
    """
    pose = _centred_complex_points(reference)
    usual_turn = -1j * pose[pose.imag.argmin()].conjugate()
    for _ in range(ROUNDS):
        numbered = [renumber_curve(reference, other, usual_turn) for other in others]
        turns = [complex(np.vdot(pose, _centred_complex_points(points))) for points in numbered]
        usual_turn = 1 + sum(turn / max(abs(turn), 1e-300) for turn in turns)
    return complex(usual_turn / max(abs(usual_turn), 1e-300))


def renumber_curve(reference: Points, curve: Curve, usual_turn: complex | None = None) -> Points:
    """Return a curve as n points (n, 2), numbered so that it matches `reference` (n, 2) best.

    Both are centred first. A turn between them hardly counts, see `_likeness_of_product`. An open
    curve may be reversed. A closed curve runs clockwise, as `reference` must then, and starts at
    any of n · FINE places: with n places alone, errors of half a step would make feet slide.
    usual_turn: a unit number x + iy, from which the turn of a closed curve differs by no more than
    90°; None = a turn by any angle.
    """
    centred_reference, n = _centred_complex_points(reference), len(reference)
    if not curve.closed:
        points = resample_curve(curve, n).points

        def likeness(numbered: Points) -> float:
            """Return how well points (n, 2) match the reference, point by point; more is better."""
            product = centred_reference @ _centred_complex_points(numbered).conj()
            return float(_likeness_of_product(product))

        return max((points, points[::-1]), key=likeness)
    fine = resample_curve(orient_clockwise(curve), n * FINE).points
    candidates = [fine[start::FINE] for start in range(FINE)]  # n points each, every FINE-th
    # The product for every shift of every candidate, (FINE, n), by FFT.
    spectra = np.fft.fft([_centred_complex_points(points) for points in candidates])
    products = np.fft.ifft(np.fft.fft(centred_reference) * spectra.conj())
    likenesses = _likeness_of_product(products)
    if usual_turn is not None:
        likenesses = np.where((products * usual_turn).real > 0, likenesses, -np.inf)
    best, shift = np.unravel_index(int(likenesses.argmax()), likenesses.shape)
    return np.roll(candidates[int(best)], int(shift), axis=0)


def mirrored_point_orders(
    key1: Mapping[str, Points], key2: Mapping[str, Points], closed: Mapping[str, bool]
) -> dict[str, Ints]:
    """Return the point order (n,) with which each contour is mirrored, by id.

    key1, key2: contours (n, 2) by id; closed: by id. `gait.model.four_key_frames` mirrors key 1
    into 1' and key 2 into 2' with these orders. They fit 1' to 2 and 2' to 1 best, as the cycle
    blends these. An id and its partner share one order.
    """
    orders = dict[str, Ints]()
    for name in key1:
        twin = opposite_limb(name, key1)
        if twin in orders:
            orders[name] = orders[twin]
        else:
            pairs = (key2[name], key1[twin]), (key1[name], key2[twin])
            orders[name] = _mirrored_point_order(pairs, closed[name])
    return orders


def _mirrored_point_order(pairs: Sequence[tuple[Points, Points]], closed: bool) -> Ints:
    """Return the point order (n,) with which a mirrored contour fits another one best.

    pairs: a contour (n, 2), and the contour that is mirrored to fit it; closed: whether all are. A
    closed contour is reversed, and may begin at any point; an open one may be reversed.
    """
    forwards = np.arange(len(pairs[0][0]))
    # Summed over the pairs: if closed, for each start; if open, for both directions.
    start_likenesses, forwards_likeness, backwards_likeness = np.zeros(len(forwards)), 0.0, 0.0
    for first, second in pairs:
        a = _centred_complex_points(first)
        b = _centred_complex_points(second * [1, -1]).conj()
        # Entry s is Σ a_i b_(s−i): the mirrored contour, reversed, begins at its point s.
        start_likenesses += _likeness_of_product(np.fft.ifft(np.fft.fft(a) * np.fft.fft(b)))
        forwards_likeness += float(_likeness_of_product(a @ b))
        backwards_likeness += float(_likeness_of_product(a @ b[::-1]))
    if closed:
        return reversed_order(len(forwards), int(start_likenesses.argmax()))
    return forwards if forwards_likeness >= backwards_likeness else forwards[::-1]


def _likeness_of_product(z: Complex) -> Points:
    """Return how alike two contours are if one is turned best: |z| + UPRIGHT · Re z.

    z is Σ a_i conj(b_i) over the points of both as centred complex numbers, a number or an array,
    as the result. The second part is there for contours that look the same turned, such as an eye:
    they should not turn.
    """
    return np.abs(z) + UPRIGHT * z.real


def _centred_complex_points(points: Points) -> Complex:
    """Return points (n, 2) as complex numbers x + iy (n,), with their mean at 0."""
    return (points - points.mean(axis=0)) @ np.array([1, 1j])
