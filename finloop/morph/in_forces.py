"""Drawings that move under forces such as gravity (curve paper §3.1, §4.2, Q of Eq. 3.3).

If each contour moved alone, the eyes would fall through the face to the floor. So the silhouette of
each piece of the drawing is the curve that moves, and what is in it follows (`morph.pieces`).
A shape that a force names is the scene: it stands still.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skimage.measure import points_in_poly

from finloop.base.arrays import Floats, Points
from finloop.base.drawing import Curve, Drawing, Morph
from finloop.base.errors import FinloopError
from finloop.base.paint import shape_of
from finloop.curve.contour import nearest_on_curve, resample_curve
from finloop.curve.dynamics import Oscillators, Problem, oscillator_response
from finloop.curve.forces import (
    AT_REST,
    Attraction,
    Forces,
    Wind,
    find_rest_time,
    solve_in_forces,
)
from finloop.morph.force_list import (
    AttractionForce,
    FloorForce,
    Force,
    GravityForce,
    HoldForce,
    WindForce,
)
from finloop.morph.layers import (
    DIGITS,
    REACH,
    PhysicalOptions,
    build_morph,
    check_pairs,
    check_physics,
    check_sizes,
    fit_drawing,
    mix_styles,
    physical_material,
)
from finloop.morph.match import FULL, Resolution, match_curves
from finloop.morph.pairs import shape_contours
from finloop.morph.pieces import find_pieces, mean_value_weights

TARGET_POINTS = 256  # of a shape that attracts
TOUCH = 0.01
"""Largest distance, in sides of the picture, between a shape and what it holds."""
STEPS = 100
"""Steps in a second, at least: waves in a curve of e₀ = ρ go 1/100 of its length in one."""
MOST_SECONDS = 100
Bools = NDArray[np.bool_]


class ForcedMotion(NamedTuple):
    """A drawing in motion; rest_time: second from which on it is at rest, None if it never is."""

    morph: Morph
    rest_time: float | None


def move_drawing(
    a: Drawing,
    b: Drawing,
    forces: Sequence[Force],
    frames: int,
    frame_rate: Fraction,
    points: int = 256,
    resolution: Resolution = FULL,
    physics: PhysicalOptions = PhysicalOptions(),  # noqa: B008  (immutable)
) -> ForcedMotion:
    """Return the motion of drawing `b`, bent into the shape of `a` and released, under forces.

    a, b: with the same ids, each contour closed in both or open in both; b alone moves if they are
    the same. forces: what moves them, at least one. frames: their number; frame_rate: frames per
    second, and a second is the unit of time τ. points: of every contour and silhouette, a power of
    two. FinloopError if the drawings do not match, have other pieces or pins, a number is out of
    range, or a force names a shape that is not there.
    """
    check_sizes("motion", frames, points, 2)
    check_physics(physics)
    seconds = float((frames - 1) / frame_rate)
    if seconds > MOST_SECONDS:
        raise FinloopError(
            f"the motion makes a film of {seconds:.4g} s",
            f"at most {MOST_SECONDS} s",
            "set fewer frames, or more of them a second",
        )
    check_pairs(a, b)
    if a.pins:
        raise FinloopError(
            f"pins of {', '.join(map(repr, a.pins))}, and forces",
            "pairs without pins: forces move silhouettes, which have none",
            "leave the pins out",
        )
    is_one = b is a
    b = fit_drawing(b, a.width, a.height)
    scene = _find_scene(a, forces)
    bodies = _match_bodies(_without_scene(a, scene), _without_scene(b, scene), points)
    start, rest = bodies.start, bodies.rest
    # No stiffness holds the mean, so forces alone move it: it begins, and rests, where a is.
    moved_rest = rest + (start - rest).mean(axis=0)
    times = np.linspace(0, seconds, frames)
    problem = Problem(
        moved_rest.reshape(points, -1), (start - moved_rest).reshape(points, -1),
        physical_material(physics), times, wavelet=resolution.wavelet,
    )  # fmt: skip
    substeps = max(1, int(np.ceil(STEPS * seconds / (frames - 1))))
    motion = solve_in_forces(problem, _forces_on(a, forces, scene, moved_rest), substeps)
    silhouettes = (motion.displacement + problem.rest).reshape(frames, points, -1, 2)
    side, farthest = max(a.width, a.height), float(np.abs(silhouettes).max())
    if not farthest <= REACH * side:
        raise FinloopError(
            f"forces that move the drawing to {farthest:g}, in a picture {side:g} large",
            f"at most {REACH} times its size",
            "weaken the forces, add a floor or damping, or shorten the film",
        )
    share = _morph_progress(physics, times)
    layers, ends = dict[str, Points](), (dict[str, Points](), dict[str, Points]())
    for name, curve in a.curves.items():
        if shape_of(name) in scene:
            still = resolution.reduce_curves(resample_curve(curve, points).points, curve.closed)
            layers[name] = np.repeat(still[None], frames, axis=0)
            ends[0][name] = ends[1][name] = still
            continue
        first, last = match_curves(curve, b.curves[name], points, resolution)
        piece = bodies.piece_of[name]
        weights = mean_value_weights(first, start[:, piece])
        layers[name] = weights @ silhouettes[:, :, piece]
        if not is_one:
            change = mean_value_weights(last, rest[:, piece]) - weights
            layers[name] += share[:, None, None] * (change @ silhouettes[:, :, piece])
        ends[0][name], ends[1][name] = first, last
    styles = mix_styles(a, b, np.clip(share, 0, 1), layers, ends)
    morph = build_morph(a, np.linspace(0, 1, frames), layers, styles, DIGITS[:1])
    return ForcedMotion(morph, find_rest_time(motion))


class _Bodies(NamedTuple):
    """The moving silhouettes, when released and at rest (n, k, 2), and the contours they carry."""

    start: Floats
    rest: Floats
    piece_of: dict[str, int]


def _match_bodies(a: Drawing, b: Drawing, points: int) -> _Bodies:
    """Return the silhouettes of two drawings in pairs; FinloopError if their pieces differ."""
    if not a.curves:
        raise FinloopError(
            "a drawing of which the forces name every shape",
            "a shape that moves: those that a force names stand still",
            "draw what shall move",
        )
    first, last = find_pieces(a), find_pieces(b)
    pairs = _pair_pieces(first.piece_of, last.piece_of)
    matches = [
        match_curves(curve, last.silhouettes[other], points)
        for curve, other in zip(first.silhouettes, pairs, strict=True)
    ]
    start, rest = (np.stack([match[k] for match in matches], axis=1) for k in (0, 1))
    return _Bodies(start, rest, first.piece_of)


def describe_rest(rest_time: float | None) -> str:
    """Return in words when a motion comes to rest."""
    limit = f"{100 * AT_REST:g} % of its top speed"
    if rest_time is None:
        return f"it still moves at the end, faster than {limit}"
    return f"at rest from {rest_time:.3g} s on, slower than {limit}"


def _find_scene(drawing: Drawing, forces: Sequence[Force]) -> dict[str, list[Curve]]:
    """Return the shapes that forces name, by id; FinloopError if there is no such shape."""
    shapes = shape_contours(drawing)
    scene = dict[str, list[Curve]]()
    for force in forces:
        name = _named_shape(force)
        if name is not None and name not in shapes:
            raise FinloopError(
                f"a force names {name!r}, which is no shape of the first drawing",
                f"one of {', '.join(shapes)}",
                "correct the id, or give the shape that id in the drawing",
            )
        if name is not None:
            scene[name] = shapes[name]
    return scene


def _named_shape(force: Force) -> str | None:
    """Return the id of the shape that a force names, None if it names none."""
    value = getattr(force, fields(force)[0].name)  # what or where comes first
    return value if isinstance(value, str) else None


def _without_scene(drawing: Drawing, scene: dict[str, list[Curve]]) -> Drawing:
    """Return a drawing without the shapes that forces name."""
    curves = {k: curve for k, curve in drawing.curves.items() if shape_of(k) not in scene}
    return replace(drawing, curves=curves)


def _pair_pieces(first: dict[str, int], last: dict[str, int]) -> list[int]:
    """Return, for each piece of the first drawing, the number of its partner in the last.

    FinloopError unless the same contours hang together in both.
    """
    partners = {(piece, last[name]) for name, piece in first.items()}
    counts = len(set(first.values())), len(set(last.values()))
    if not len(partners) == counts[0] == counts[1]:
        raise FinloopError(
            f"drawings of {counts[0]} and {counts[1]} pieces, of other contours each",
            "pieces of the same contours in both: what touches in one touches in the other",
            "move the contours together or apart in one of the drawings",
        )
    return [other for _, other in sorted(partners)]


def _morph_progress(physics: PhysicalOptions, times: Points) -> Points:
    """Return how far (f,), from 0 to 1, contours have morphed at times (f,)."""
    material = physical_material(physics)
    stiffness = np.array([(2 * np.pi) ** 2 * material.elastic])
    damping = material.mass_damping * (material.density or 1) + (
        material.stiffness_damping * stiffness
    )
    oscillator = Oscillators(material.density, damping, stiffness)
    return 1 - oscillator_response(oscillator, times, forced=False).of_place[:, 0]


def _forces_on(
    drawing: Drawing, forces: Sequence[Force], scene: dict[str, list[Curve]], rest: Floats
) -> Forces:
    """Return the forces on silhouettes with rest shapes (n, k, 2), in units of the drawing."""
    height = drawing.height
    gravity = sum(force.strength for force in forces if isinstance(force, GravityForce))
    winds = tuple(
        Wind(
            (height * force.velocity[0], height * force.velocity[1]),
            force.drag,
            force.gust,
            height * force.gust_length,
        )
        for force in forces
        if isinstance(force, WindForce)
    )
    attractions = tuple(
        Attraction(
            _target_points(force.to, scene),
            (2 * np.pi) ** 2 * force.strength,
        )
        for force in forces
        if isinstance(force, AttractionForce)
    )
    floors = [
        (_floor_height(force.y, scene), force.friction)
        for force in forces
        if isinstance(force, FloorForce)
    ]
    floor, friction = min(floors) if floors else (None, 0.0)
    is_held = _held_points(drawing, forces, scene, rest)
    return Forces((0.0, height * gravity), winds, attractions, floor, friction, is_held)


def _held_points(
    drawing: Drawing, forces: Sequence[Force], scene: dict[str, list[Curve]], rest: Floats
) -> Bools | None:
    """Return a mask (n, k) of the points of silhouettes (n, k, 2) that are held; None if none is.

    FinloopError if a shape that shall hold touches nothing.
    """
    names = [force.by for force in forces if isinstance(force, HoldForce)]
    is_held = np.zeros(rest.shape[:2], bool)
    for name in names:
        widths = [
            paint.width
            for layer, paint in drawing.styles.items()
            if shape_of(layer) == name and paint.stroke is not None
        ]
        reach = TOUCH * max(drawing.width, drawing.height) + max(widths, default=0.0) / 2
        touches = _touches(rest.reshape(-1, 2), scene[name], reach)
        if not touches.any():
            raise FinloopError(
                f"the force hold={name}: nothing touches {name!r}",
                "a shape that touches what it holds",
                "move the shapes together",
            )
        is_held |= touches.reshape(is_held.shape)
    return is_held if names else None


def _target_points(place: tuple[float, float] | str, scene: dict[str, list[Curve]]) -> Points:
    """Return the points (m, 2) to which an attraction pulls."""
    if not isinstance(place, str):
        return np.array([place], float)
    return np.concatenate([resample_curve(c, TARGET_POINTS).points for c in scene[place]])


def _floor_height(y: float | str, scene: dict[str, list[Curve]]) -> float:
    """Return the y of a floor; for a shape, that of its upper end."""
    if not isinstance(y, str):
        return y
    return min(float(curve.points[:, 1].min()) for curve in scene[y])


def _touches(points: Points, contours: Sequence[Curve], reach: float) -> Bools:
    """Return a mask (m,) of points (m, 2) that lie in a shape or within `reach` of its contours."""
    near = np.zeros(len(points), bool)
    for curve in contours:
        near |= np.hypot(*nearest_on_curve(points, curve)[1].T) <= reach
        if curve.closed:
            near |= points_in_poly(points, curve.points)
    return near
