"""What a fish does whose plan leads nowhere, or is blocked: stay, turn on the spot, give way.

The ladder, from the first to the last: swim the free part of a stretch; stay and turn on the spot;
drift away from the fish that blocks it, or more and more aside; stay with the same picture.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from finloop.animate.kinematics import Target, bearing, turn_towards_aim, wrap
from finloop.animate.obstacles import count_lasting_ticks
from finloop.animate.state import Fish
from finloop.base.arrays import Floats
from finloop.base.kernel import kernel
from finloop.edit.schema import FILM, FORECAST, FRAME, SPOT, WAITING
from finloop.edit.stretch import Decision, Stretch
from finloop.plan.graph import MotionGraph, row_can_play_on
from finloop.plan.search import film_candidates
from finloop.plan.walls import keep_inside
from finloop.plan.world import FilmWorld

_AWAY_BL = 3.0  # body lengths from a fish to the place that it drifts to: farther than it comes
_ASIDE_DEG = (0.0, 50.0, -50.0, 100.0, -100.0)  # directions of drift, tried one after the other
_DRIFT = 0.05  # body lengths in a Δ, of a fish whose plan leads nowhere or is blocked


class Fallback:
    """Finds what a fish does whose plan leads nowhere or is blocked by a wall or another fish."""

    def __init__(self, world: FilmWorld) -> None:
        """Keep the tank and film of the fish; compute how far a fish drifts in a tick, px."""
        self._world = world
        self._drift_px = _DRIFT * world.motion.body_length_px / world.motion.delta

    def stay(self, fish: Fish, target: Target) -> Stretch:
        """Return a stretch in place: the film plays on, and the fish turns towards the target.

        It shows the film's next row, or the best jump in place of it, and the rows after that: a
        stride (ticks between two checks of a branch) at most, and up to where the film ends. It
        turns as its pictures do, or faster: then its head moves at most as a fast fish swims.
        """
        world = self._world
        rows, trajectory = _turn_in_place(
            world.film, fish.row, fish.rotation_deg, np.array([fish.x, fish.y, fish.heading]),
            target, most_ticks=world.cost_weights.stride, most_deg=world.most_spot_turn_deg,
        )  # fmt: skip
        return Stretch(
            FORECAST if fish.state == FORECAST else FILM, trajectory, rows,
            begins_with_transition=int(rows[0]) != fish.row + 1, aim=target, touches_goal=False,
            decision=Decision(SPOT), kind=FRAME,
            rotation_deg=trajectory[:, 2] - world.film.heading[rows],
        )  # fmt: skip

    def keep_clear(self, fish: Fish, stretch: Stretch) -> Stretch:
        """Return the free part of a stretch, clear of walls and fish, or one that gives way.

        A fish that turns on the spot, but has no such tick inside the tank, stays at the wall. A
        fish moves aside if another one blocks it, or if it turns on the spot so near to another
        that they may touch.
        """
        turns_on_spot = stretch.decision.reason == SPOT
        if turns_on_spot:  # every other stretch already ends before the walls
            inside = self._part_inside_tank(stretch)
            kept = inside or self._stay_at_wall(fish, Target(*stretch.aim))
            stretch = replace(kept, decision=stretch.decision, options=stretch.options)
        obstacles, others = fish.obstacles, fish.obstacles.places[0]  # where the others are now
        if not len(others):
            return stretch
        ticks = self.count_free_ticks(fish, stretch)
        if ticks and not turns_on_spot:
            return stretch.cut(ticks)
        distances = np.hypot(others[:, 0] - fish.x, others[:, 1] - fish.y)
        nearest = int(distances.argmin())
        if ticks and distances[nearest] >= 2 * obstacles.discs.reach:  # too far away to touch
            return stretch.cut(ticks)
        return self._move_aside(fish, *others[nearest, :2].tolist())

    def _move_aside(self, fish: Fish, x: float, y: float) -> Stretch:
        """Move a fish aside from another fish at x, y px; return the free part of the stretch.

        Free is inside the tank and clear of other fish. Where nothing is free, the fish stays in
        place with its present picture for one tick.
        """
        for stretch in self._stretches_giving_way(fish, x, y):
            inside = self._part_inside_tank(stretch)
            if inside is not None and (ticks := self.count_free_ticks(fish, inside)):
                return inside.cut(ticks)
        return stretch.cut(1)  # the last stretch to give way: the present picture, in place

    def count_free_ticks(self, fish: Fish, stretch: Stretch) -> int:
        """Return the most ticks of a stretch after which a fish can stop, clear of other fish.

        fish: at the beginning of the stretch.
        """
        return count_lasting_ticks(fish.obstacles, stretch.pictures, stretch.trajectory, fish.tick)

    def _part_inside_tank(self, stretch: Stretch) -> Stretch | None:
        """Return the part of a stretch before it leaves the tank; None if no tick is inside.

        A tick too near to a wall is moved off it, by at most as much as a fast fish swims in a
        tick; the part ends where that is not enough. A stretch that need not change is returned
        itself.
        """
        most_px, numbers = self._world.cost_weights.fast_px, stretch.pictures.astype(np.int64)
        inside = keep_inside(self._world.bounds, numbers, stretch.trajectory, most_px)
        if np.array_equal(inside, stretch.trajectory):
            return stretch
        if not len(inside):
            return None
        # Cut or moved, the last tick is not where it touched the goal.
        return replace(stretch.cut(len(inside)), trajectory=inside, touches_goal=False)

    def _stay_at_wall(self, fish: Fish, target: Target) -> Stretch:
        """Return a stretch for a fish that stays where its next picture would overlap a wall.

        It drifts towards open water, and turns to the target where there is room. Where no picture
        fits, it stays with the present one.
        """
        x, y = self._world.tank.nearest_legal_point(fish.x, fish.y)
        open_water = Target(x, y, touch_px=0.0, head_px=0.0)
        for staying in self._in_place_stretches(fish, target):
            drifting = replace(staying, trajectory=self._add_drift(fish, staying, open_water))
            if (inside := self._part_inside_tank(drifting)) is not None:
                return inside
        return staying  # the last of them: the present picture, without drift

    def _stretches_giving_way(self, fish: Fish, x: float, y: float) -> Iterator[Stretch]:
        """Yield stretches in which a fish drifts away from another fish at x, y px, best first.

        The later ones lead more and more aside; in the last it stays with its present picture.
        """
        for aside_deg in _ASIDE_DEG:
            away = self._place_away_from(fish, x, y, aside_deg)
            for staying in self._in_place_stretches(fish, away):
                drifting = self._add_drift(fish, staying, away)
                yield replace(staying, trajectory=drifting, decision=Decision(WAITING))
        # The last stretch in place shows the present picture; here it has no drift.
        yield replace(staying, decision=Decision(WAITING))

    def _place_away_from(self, fish: Fish, x: float, y: float, aside_deg: float) -> Target:
        """Return a target about 3 body lengths from the fish, in the direction away from x, y px.

        aside_deg: degrees by which the direction is turned to the left. A target that is outside
        the tank is moved into it.
        """
        distance = _AWAY_BL * self._world.motion.body_length_px
        angle = np.arctan2(fish.y - y, fish.x - x) + np.radians(aside_deg)
        to_x, to_y = fish.x + distance * np.cos(angle), fish.y + distance * np.sin(angle)
        place = self._world.tank.nearest_legal_point(float(to_x), float(to_y))
        return Target(*place, touch_px=0.0, head_px=0.0)

    def _in_place_stretches(self, fish: Fish, target: Target) -> Iterator[Stretch]:
        """Yield two stretches in place: one turns to a target, one keeps the present picture."""
        turning = self.stay(fish, target)
        yield turning
        n = len(turning.trajectory)
        poses = np.tile((fish.x, fish.y, fish.heading), (n, 1))
        rows, rotations_deg = np.full(n, fish.row), np.full(n, fish.rotation_deg)
        yield replace(
            turning,
            trajectory=poses,
            number=rows,
            rotation_deg=rotations_deg,
            begins_with_transition=False,
        )

    def _add_drift(self, fish: Fish, stretch: Stretch, target: Target) -> Floats:
        """Return the trajectory (n, 3) of a stretch in place, with a slow drift to a target."""
        distances = np.arange(1, len(stretch.trajectory) + 1) * self._drift_px
        offset = np.subtract(target[:2], (fish.x, fish.y))
        direction = offset / max(float(np.hypot(*offset)), 1e-9)
        trajectory = stretch.trajectory.copy()
        trajectory[:, :2] = (fish.x, fish.y) + distances[:, None] * direction
        return np.asarray(trajectory)


@kernel
def _turn_in_place(  # type: ignore[no-untyped-def]
    film: MotionGraph, row: int, rotation_deg: float, pose: Floats, target: Target, most_ticks: int,
    most_deg: float,
):  # fmt: skip
    """Turn a fish on the spot to a target; return the rows (n,) and trajectory (n, 3) shown.

    row: on screen, turned by `rotation_deg`; pose (3,) and each trajectory row: x, y px, heading;
    most_ticks: largest n; most_deg: largest correction of the film's own turn in a tick.
    """
    # The first row: the film's next one if it can play on for ever, else its best jump, if any.
    first_row, last_film_row = row, len(film.rows) - 1
    if film.rows[row].has_next:
        candidates = film_candidates(film, row + 1, rotation_deg)
        if candidates.rows.size:
            first_row = candidates.rows[0]
    if film.jumps_keep_heading:
        next_heading = film.rows[min(row + 1, last_film_row)].heading + rotation_deg
        rotation_deg = wrap(next_heading - film.rows[first_row].heading)
    ticks = 1
    while ticks < most_ticks and row_can_play_on(film.rows, min(first_row + ticks, last_film_row)):
        ticks += 1
    trajectory = np.empty((ticks, 3))
    # The fish turns as in the film, corrected towards the target.
    x, y, heading = pose[0], pose[1], pose[2]
    target_deg, before_deg = bearing(x, y, target.x, target.y), heading
    for k in range(ticks):
        filmed_deg = film.rows[first_row + k].heading + rotation_deg
        heading += turn_towards_aim(wrap(filmed_deg - before_deg), target_deg - heading, most_deg)
        trajectory[k, 0], trajectory[k, 1], trajectory[k, 2] = x, y, heading
        before_deg = filmed_deg
    return first_row + np.arange(ticks), trajectory
