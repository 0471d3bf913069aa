"""Joins: how a picture follows one that does not precede it in the film.

A *join* is a tick whose picture is not the film's next one. Inertialization (Bollo 2018) continues
the posture, its velocity and the heading: the offset of what the old picture would have shown from
the new one,

    x(τ) = (x₀ (1 + a τ) + v₀ τ) exp(−a τ),    τ ticks after the join,

decays as a critically damped spring and is added to the new picture. The equation is linear in x₀
and v₀, so what is left of one join adds to the next. While the animal rests the offset stays: τ
counts only the ticks at which it moves. A cross-fade in that pose blends light and skin. FADE mixes
the two pictures as they are, CUT changes at once.

D. Bollo, Inertialization: High-Performance Animation Transitions in "Gears of War", GDC 2018.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask
from finloop.edit.bodies import Bodies, Body, resting_rows
from finloop.edit.schema import CUT, FRAME, INERTIAL, SPRITE
from finloop.features.table import wrap_deg

_DECAY = 4.743865  # a with (1 + a) exp(−a) = 0.05: x(τ) without velocity falls to 5 % at τ = 1
_LASTS = 2.0  # times the duration of a join, after which less than 0.1 % of its offset is left
_SETTLING = 3  # ticks more that a join changes: the velocity before it counts, too


class JoinTimes(Protocol):
    """The parameters of joins, as in `animate`; Δ is the time over which motion is measured.

    A join that is "auto" takes at least `join_frames` ticks, and `join_least` to `join_most` Δ. The
    animal rests below the share `rest` of the film's movement.
    """

    join_frames: ClassVar[int]
    join_least: ClassVar[float]
    join_most: ClassVar[float]
    rest: ClassVar[float]

    @property
    def join_time_deltas(self) -> Literal["auto"] | float:
        """Return the time of a join in Δ, or "auto": as long as a pose persists in the film."""

    @property
    def cross_fade_deltas(self) -> float:
        """Return the time of a cross-fade, in Δ."""


@dataclass(frozen=True)
class JoinRules:
    """How pictures that do not follow each other in the film are joined.

    kind: INERTIAL, FADE or CUT; fade: ticks of a cross-fade; decay: ticks after which 5 % of an
    offset are left; bodies: the film's; rests (n,): whether the animal rests at each row of the
    film.
    """

    kind: str
    fade: int
    decay: float
    bodies: Bodies
    rests: Mask

    @property
    def most_ticks(self) -> int:
        """Return for how many ticks a join changes the pictures after it, at most.

        Ticks at which the animal rests do not count.
        """
        return max(self.fade, self._spring_ticks) + _SETTLING

    @property
    def _spring_ticks(self) -> int:
        """Return the ticks after which hardly any offset of a join is left; 0 if not INERTIAL."""
        return int(np.ceil(_LASTS * self.decay)) if self.kind == INERTIAL else 0

    def count_moving(self, kind: str, number: Ints) -> int:
        """Return in how many of k pictures the animal moves; only at these an offset fades.

        kind: SPRITE, all of which count, or FRAME; number (k,): rows, plus n for mirror images.
        """
        return len(number) if kind == SPRITE else int((~self.rests[number % len(self.rests)]).sum())

    def spring_response(self) -> tuple[Floats, Floats]:
        """Return what is left of an offset of 1, and of a velocity of 1, after 0, 1 … ticks.

        Both are offsets (k,) of a critically damped spring after t ticks: (1 + r t) exp(−r t) and
        t exp(−r t), where the rate r is such that 5 % of an offset are left after `decay` ticks.
        """
        rate, ticks = _DECAY / self.decay, np.arange(self._spring_ticks)
        share_left = np.exp(-rate * ticks)
        return (1 + rate * ticks) * share_left, ticks * share_left


def resolve_join_rules(p: JoinTimes, kind: str, bodies: Bodies, delta: int) -> JoinRules:
    """Return how pictures are joined, with the times of the parameters converted to ticks.

    kind: INERTIAL, FADE or CUT; delta: Δ in ticks. An automatic join lasts as long as the film's
    postures.
    """
    if p.join_time_deltas == "auto":
        time = min(max(bodies.poses.memory_frames / delta, p.join_least), p.join_most)
        ticks = max(time * delta, float(p.join_frames))
    else:
        ticks = max(p.join_time_deltas * delta, 1.0)
    fade = 0 if kind == CUT else round(p.cross_fade_deltas * delta)
    return JoinRules(kind, fade, decay=ticks, bodies=bodies, rests=resting_rows(bodies, p.rest))


@dataclass(frozen=True)
class PictureSequence:
    """Which picture is shown at each tick, and how it is turned; all (ticks,).

    frame: whether the picture is a frame of the film, else a sprite; number: row of the frame, or
    number of the sprite; rotation_deg: by how much a frame is turned; mirrored: whether a frame is.
    """

    frame: Mask
    number: Ints
    rotation_deg: Floats
    mirrored: Mask


def sum_past_values(weights: Floats, values: Floats) -> Floats:
    """Return the weighted sum of past values, Σ_k weights[k] · values[t − k], at every tick t.

    The result is (n, c) like values. `scipy.signal.lfilter` does the same, but its import takes 0.9
    s in every process.
    """
    return np.apply_along_axis(lambda x: np.convolve(weights, x)[: len(x)], axis=0, arr=values)


class InertializedPictures(NamedTuple):
    """How inertialization changes the pictures of some ticks: poses, rotations and cross-fades.

    begins (k,): ticks of joins between pictures of different moments, whose light may differ; codes
    (ticks, c): of the pose to draw in; posed (ticks,): whether that pose is drawn; turn_deg
    (ticks,): rotation that is added, degrees.
    """

    begins: Ints
    codes: NDArray[np.float32]
    posed: Mask
    turn_deg: Floats


def inertialize_pictures(
    shown: PictureSequence, line_deg: Floats, rules: JoinRules
) -> InertializedPictures:
    """Find the joins in pictures (ticks,); return them, and poses and rotations to smooth them.

    line_deg (ticks,): direction in which the fish swims and in which sprites are drawn, degrees.
    """
    bodies, frame = rules.bodies, shown.frame
    drawn = bodies.picture_bodies(
        frame, shown.number, np.where(frame, shown.rotation_deg, line_deg), shown.mirrored
    )
    due = _due_bodies(drawn, shown, line_deg, bodies)
    joins, moves = _find_joins(drawn, due, frame, rules)
    old, new = due.select(joins), drawn.select(joins)
    offset, velocity = _join_offsets(drawn, old, joins, bodies)
    remaining, posed = _remaining_offsets(offset, velocity, joins, moves, rules)
    codes = bodies.codes(drawn)
    codes[posed] += remaining[posed, :-1]
    # A posture near a filmed one is possible; others are moved to the nearest possible one.
    shapes = bodies.poses.shapes
    doubtful = posed & (np.linalg.norm(remaining[:, :-1], axis=1) > shapes.gap)
    if doubtful.any():
        codes[doubtful] = shapes.nearest_codes(codes[doubtful]).codes
    begins = joins[~bodies.are_near_in_film(old, new, rules.fade)]
    return InertializedPictures(begins, codes.astype(np.float32), posed, remaining[:, -1])


def _due_bodies(drawn: Body, shown: PictureSequence, line_deg: Floats, bodies: Bodies) -> Body:
    """Return the bodies (ticks,) that would be shown if the film played on from the tick before.

    Before the first tick there is none: that one is not used. drawn (ticks,): the bodies in the
    pictures shown; line_deg (ticks,): direction in which the fish swims; a sprite turns with it.
    """
    last = np.maximum(np.arange(len(line_deg)) - 1, 0)  # the tick before
    due = bodies.next_body(drawn.select(last))
    sprite_turn = line_deg - line_deg[last]
    sprite_turn = sprite_turn - bodies.sprite_turn_deg(shown.frame[last], shown.number[last])
    return due._replace(heading_deg=due.heading_deg + np.where(shown.frame[last], 0.0, sprite_turn))


def _find_joins(drawn: Body, due: Body, frame: Mask, rules: JoinRules) -> tuple[Ints, Mask]:
    """Return the ticks (k,) of joins, and at which ticks (ticks,) the animal moves.

    It does not move where it rests in the film and the film plays on. drawn (ticks,): the bodies in
    the pictures shown; due (ticks,): what the film would show there; frame (ticks,): whether a
    picture is a frame, not a sprite.
    """
    previous, current, due = (
        bodies.select(ticks)
        for bodies, ticks in ((drawn, np.s_[:-1]), (drawn, np.s_[1:]), (due, np.s_[1:]))
    )
    follows = (current.row == due.row) & (current.mirrored == due.mirrored)
    follows &= (frame[1:] == frame[:-1]) & rules.bodies.goes_on[previous.row]
    moves = np.append(True, ~(follows & rules.rests[current.row]))
    # A picture that is held is a join only when it is shown the second time. While it is held,
    # what remains of joins decays, as when the animal moves.
    is_held = (current.row[1:] == previous.row[1:]) & (previous.row[1:] == previous.row[:-1])
    follows[1:] |= is_held
    return np.flatnonzero(~follows) + 1, moves


def _remaining_offsets(
    offset: Floats, velocity: Floats, joins: Ints, moves: Mask, rules: JoinRules
) -> tuple[Floats, Mask]:
    """Fade out the offsets of joins; return what is left at each tick, and where any join lasts.

    offset, velocity, and what is left, are (ticks, c + 1): c pose codes, then degrees. While the
    animal rests, offsets stay: the spring knows only the ticks at which it moves. Where a join
    lasts is a mask (ticks,).
    """
    offset_decay, velocity_decay = rules.spring_response()
    remaining = sum_past_values(offset_decay, offset[moves])
    remaining += sum_past_values(velocity_decay, velocity[moves])
    moving_tick = np.cumsum(moves) - 1  # each tick counted in ticks at which the animal moves
    latest_join = np.full(len(remaining), -(2**31))  # by moving tick; before the first: long ago
    latest_join[moving_tick[joins]] = moving_tick[joins]
    since_join = moving_tick - np.maximum.accumulate(latest_join)[moving_tick]
    return remaining[moving_tick], since_join < len(offset_decay)


def _join_offsets(drawn: Body, old: Body, joins: Ints, bodies: Bodies) -> tuple[Floats, Floats]:
    """Return the offset of the body at each join, and of its velocity per tick.

    Both are the body that the film would show minus the drawn one, (ticks, c + 1), 0 at other
    ticks: c pose codes (principal-component scores), then the heading in degrees. drawn: bodies of
    all ticks; old (k,): those that the film would show at the joins.
    """
    new, ticks = drawn.select(joins), len(drawn.row)
    ahead = np.minimum(joins + 1, ticks - 1)  # the tick after each join
    plays_on = (ahead > joins) & ~np.isin(ahead, joins)
    old_turn_deg = wrap_deg(old.heading_deg - drawn.heading_deg[joins - 1])  # due at the join
    new_turn_deg = wrap_deg(drawn.heading_deg[ahead] - new.heading_deg)
    # Where the new picture does not play on, its turn is unknown and counts as unchanged.
    new_turn_deg = np.where(plays_on, new_turn_deg, old_turn_deg)
    is_held = (drawn.row[ahead] == new.row) & (ahead > joins)  # its pose has no velocity
    codes = bodies.codes(old) - bodies.codes(new)
    code_velocity = bodies.code_velocity(old) - bodies.code_velocity(new) * ~is_held[:, None]
    offset, velocity = np.zeros((2, ticks, codes.shape[1] + 1))
    offset[joins] = np.column_stack([codes, wrap_deg(old.heading_deg - new.heading_deg)])
    velocity[joins] = np.column_stack([code_velocity, old_turn_deg - new_turn_deg])
    return offset, velocity


def cross_fade_partners(
    shown: PictureSequence, begins: Ints, fade: int, following: Callable[[str, int], int]
) -> tuple[PictureSequence, Floats]:
    """Return the pictures (ticks,) that fade out in cross-fades, and their shares (ticks,), or 0.

    shown: the pictures that fade in. From each tick of `begins` on, the old picture plays on for
    `fade` ticks, and its share falls. following(kind, number): returns the number of the picture
    that plays after another of that kind, FRAME or SPRITE.
    """
    ticks = len(shown.number)
    partner, weight = PictureSequence(
        frame=np.zeros(ticks, bool), number=np.zeros(ticks, np.int64), rotation_deg=np.zeros(ticks),
        mirrored=np.zeros(ticks, bool),
    ), np.zeros(ticks)  # fmt: skip
    for first in begins:
        frame, number = bool(shown.frame[first - 1]), int(shown.number[first - 1])
        for tick in range(first, min(first + fade, ticks)):
            number = following(FRAME if frame else SPRITE, number)
            partner.frame[tick], partner.number[tick] = frame, number
            partner.rotation_deg[tick] = shown.rotation_deg[first - 1]
            partner.mirrored[tick] = shown.mirrored[first - 1]
            weight[tick] = 1 - (tick - first + 1) / (fade + 1)
    return partner, weight
