"""Loops mode: the film plays, and goes on elsewhere at loops, towards the goal (Figs. 10, 11, 17).

At a loop end every way on is looked at: playing on, and each jump. A way is *legal* if it can be
swum within the tank and never ends, leads towards the goal, and does not head away from it when
done (Fig. 19). The position table says where playing forward leads in quadrants; here its exact
displacements are followed, loop after loop, some seconds ahead.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from finloop.animate import kinematics as step
from finloop.animate import search as ahead
from finloop.animate.arena import Tank
from finloop.animate.edit_list import FRAME
from finloop.animate.motion import FILM, Motion
from finloop.animate.network import Fish, Stretch
from finloop.animate.search import Film
from finloop.loops.position_table import quadrant

_HORIZON_S = 3.0  # a way is looked at so far ahead
_STRIDE_S = 0.15  # loop ends nearer to the last decision are passed by
_WIDTH = 24  # ways that are followed at once
_SEAM_S = 0.25  # so long a detour is better than a seam of one median step of the film
_JERK_S = 0.3  # or than a change of speed by one body length/s
_AGAIN_S = 1.0  # or than frames that were on screen just now ...
_MEMORY_S = 20.0  # ... less and less, the longer it is ago
_FREE_S = 0.15  # ways that differ by about so much are equally good
_MOST_ERROR_DEG = 90.0  # a way that heads farther from the goal when done heads away
_ON_SPOT_DEG = 6.0  # per tick, where there is no way at all

Floats = NDArray[np.float64]
Considered = tuple[int, float, float, str, bool]  # row, seam, seconds, the failed test, taken


@dataclass(frozen=True)
class Options:
    """What may be shown next (k,): rows, their rotations, distances in median steps.

    value: seconds to the goal that the best way from there takes, with the worth of its seams,
    infinite where there is none; inside, towards, heads: the three tests of Fig. 19; ticks: how
    long it stays in the tank. Whatever was passed over for better ways fails no test.
    """

    rows: NDArray[np.int64]
    rots: Floats
    seams: Floats
    value: Floats
    ticks: Floats
    inside: NDArray[np.bool_]
    towards: NDArray[np.bool_]
    heads: NDArray[np.bool_]

    @property
    def legal(self) -> NDArray[np.bool_]:
        """Whether a way passes all tests, and was followed to its end."""
        return self.inside & self.towards & self.heads & np.isfinite(self.value)

    def counts(self) -> str:
        """In words: how many ways there were, and how many fail which test."""
        failed = [
            f"{n} {what}"
            for n, what in (
                (int((~self.inside).sum()), "leave the tank or end"),
                (int((self.inside & ~self.towards).sum()), "lead away"),
                (int((self.inside & self.towards & ~self.heads).sum()), "head away"),
            )
            if n
        ]
        number = len(self.rows)
        return f"{number} way{'s' * (number != 1)}" + (f", {', '.join(failed)}" if failed else "")


class LoopMode:
    """The player of loops. `stay_s`: so long a fish stays after a jump before the next one."""

    def __init__(
        self, film: Film, motion: Motion, tank: Tank, touch_px: float, head_px: float,
        stay_s: float,
    ) -> None:  # fmt: skip
        self.film, self.motion, self.tank = film, motion, tank
        self.touch_px, self.head_px = touch_px, head_px
        rate = motion.rate_hz
        self.stay = max(1, round(stay_s * rate))
        self._horizon = max(2, round(_HORIZON_S * rate))
        self._stride = max(1, round(_STRIDE_S * rate))
        self._weights = _SEAM_S * rate, _JERK_S * rate, _AGAIN_S * rate, _MEMORY_S * rate
        swims = film.speed[film.more]
        self.pace = float(np.quantile(swims, 0.75)) * motion.body_length_px / rate
        self.turning = float(np.median(motion.turns.angle_deg / motion.turns.ticks))

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, at a row from which the film goes on for ever."""
        x, y = self.tank.random_point(rng)
        rows = np.flatnonzero(self.film.more[:-1] & self.film.endless[1:])
        fish = Fish(x, y, 0.0, 0.0, FILM, -1)
        fish.shown = np.full(len(self.film.more), -(10**9))
        fish.row = int(rng.choice(rows))
        fish.rot = float(rng.uniform(-180, 180)) if self.film.body else 0.0
        fish.heading = float(step.wrap(self.film.heading[fish.row] + fish.rot))
        fish.since = self.stay
        return fish

    def stretch(self, fish: Fish, at: Floats, name: str, rng: np.random.Generator) -> Stretch:
        """Go on to the next loop end, by the best way towards the point `at` (2,) px."""
        target = self.aim(fish, at)
        options = self.options(fish, target)
        best = choose(options, options.legal, self.motion.rate_hz, rng)
        if best is None:
            best = choose(options, np.isfinite(options.value), self.motion.rate_hz, rng)
        if best is None:
            return self._on_the_spot(fish, target)
        return self.play(fish, self.arrival(fish), options, best, target, at, name)

    def aim(self, fish: Fish, at: Floats) -> Floats:
        """The point to head for: the goal, or what is in sight of the way to it."""
        legal = self.tank.into(*at)
        if np.hypot(legal[0] - fish.x, legal[1] - fish.y) < self.touch_px:
            return at
        seen = self.tank.waypoint(fish.x, fish.y, *legal)
        return at if seen == legal else np.array(seen)

    def arrival(self, fish: Fish) -> tuple[float, float]:
        """Where the fish is at the next tick, by the film."""
        film = self.film
        dx, dy = ahead.moved(film.dx[fish.row], film.dy[fish.row], fish.rot)
        return fish.x + dx, fish.y + dy

    def options(self, fish: Fish, target: Floats) -> Options:
        """The ways on from a fish that is in the film."""
        rows, seams = self._ways_on(fish, fish.since + 1 >= self.stay)
        rots = [self._rotation(fish, int(row)) for row in rows]
        jumps = rows != fish.row + 1
        costs = [
            self.jump_cost(fish, int(row), seam) if jump else 0.0
            for row, seam, jump in zip(rows, seams, jumps, strict=True)
        ]
        since = np.where(jumps, 0, fish.since + 1)
        return self.weigh(self.arrival(fish), fish, rows, rots, seams, costs, since, target)

    def _ways_on(self, fish: Fish, jumps: bool) -> tuple[NDArray[np.int64], Floats]:
        """Rows that can be shown next and need never stop, playing on first, and their seams."""
        film, row = self.film, fish.row + 1
        rows, seams = np.array([row]), np.zeros(1)
        if jumps and film.end[row] >= 0:
            here = slice(film.start[film.end[row]], film.start[film.end[row] + 1])
            rows, seams = np.append(rows, film.to[here]), np.append(seams, film.seam[here])
        goes_on = film.more[rows]
        goes_on[goes_on] = film.endless[rows[goes_on] + 1]
        return rows[goes_on].astype(np.int64), seams[goes_on]

    def _rotation(self, fish: Fish, row: int) -> float:
        """By how much a row is turned that is shown next."""
        if not self.film.body:
            return fish.rot
        return float(step.wrap(self.film.heading[fish.row + 1] + fish.rot - self.film.heading[row]))

    def jump_cost(self, fish: Fish, row: int, seam: float) -> float:
        """What it costs, in ticks, to show a row next that does not follow."""
        faster, ago = self.film.speed[row] - fish.speed, fish.tick - fish.shown[row]
        return float(ahead.jump_cost(seam, faster, float(ago), *self._weights))

    def jump_terms(self, fish: Fish, row: int, seam: float) -> tuple[float, float, float]:
        """The same in seconds: for the seam, the change of speed, what was on screen just now."""
        w_seam, w_speed, w_again, memory = self._weights
        faster, ago = self.film.speed[row] - fish.speed, float(fish.tick - fish.shown[row])
        each = (w_seam, 0.0, 0.0), (0.0, w_speed, 0.0), (0.0, 0.0, w_again)
        seam_s, speed_s, again_s = (
            float(ahead.jump_cost(seam, faster, ago, *weights, memory)) / self.motion.rate_hz
            for weights in each
        )
        return seam_s, speed_s, again_s

    def weigh(
        self, place: tuple[float, float], fish: Fish, rows: ArrayLike, rots: ArrayLike,
        seams: ArrayLike, costs: ArrayLike, since: ArrayLike, target: Floats,
    ) -> Options:  # fmt: skip
        """Look ahead from each of some rows, shown at `place`."""
        film, rate = self.film, self.motion.rate_hz
        numbers, turned = np.array(rows, np.int64), np.array(rots, float)
        value, far, error, ticks, over = ahead.look(
            film.dx, film.dy, film.heading, film.speed, film.more, film.end, film.start, film.to,
            film.seam, film.endless, film.body, fish.shown, self.tank.legal, *place, turned,
            numbers, np.array(costs, float), np.array(since, np.int64), fish.tick, target,
            self.touch_px, self.head_px, self.pace, self.turning, self._horizon, self._stride,
            self.stay, _WIDTH, *self._weights,
        )  # fmt: skip
        now = float(np.hypot(target[0] - place[0], target[1] - place[1]))
        return Options(
            numbers, turned, np.array(seams, float), value / rate, ticks,
            np.isfinite(value) | over, (far < now) | over, (error <= _MOST_ERROR_DEG) | over,
        )  # fmt: skip

    def play(
        self, fish: Fish, place: tuple[float, float], options: Options, best: int,
        target: Floats, at: Floats, name: str,
    ) -> Stretch:  # fmt: skip
        """Show the row chosen at `place`, those after it up to the next loop end or the goal."""
        film = self.film
        jump = fish.row < 0 or options.rows[best] != fish.row + 1
        why = self._why(fish, options, best, name)
        (x, y), row, rot = place, int(options.rows[best]), float(options.rots[best])
        way, shown, touched = [], [], False
        while True:
            heading = film.heading[row] + rot
            way.append((x, y, heading))
            shown.append(row)
            goes_on = film.more[row] and film.endless[row + 1]
            touched = goes_on and bool(step.touches(x, y, heading, self.head_px, at, self.touch_px))
            # The way was looked at no farther than the target, and the horizon.
            arrived = goes_on and step.touches(x, y, heading, self.head_px, target, self.touch_px)
            arrived |= len(shown) >= self._stride and film.end[row + 1] >= 0
            arrived |= len(shown) >= self._horizon
            if touched or arrived or not film.more[row + 1]:
                break
            dx, dy = ahead.moved(film.dx[row], film.dy[row], rot)
            x, y, row = x + dx, y + dy, row + 1
        rows = np.array(shown)
        fish.x, fish.y, fish.heading = x, y, float(step.wrap(way[-1][2]))
        fish.speed, fish.area = float(film.speed[row]), float(film.area[row])
        fish.row, fish.rot, fish.state = row, rot, FILM
        fish.since = len(rows) - 1 if jump else fish.since + len(rows)
        fish.shown[rows] = fish.tick + np.arange(len(rows))
        return Stretch(
            FILM, target, np.array(way), rows, jump, np.nan, touched, why, FRAME,
            np.full(len(rows), rot), considered(options, best), tuple(options.rots.tolist()),
        )  # fmt: skip

    def _why(self, fish: Fish, options: Options, best: int, name: str) -> str:
        row = int(options.rows[best])
        dx, dy = ahead.moved(*self._table(row), float(options.rots[best]))
        led = f"quadrant {quadrant(dx, -dy)} towards {name or 'a place'}"
        what = "play on" if row == fish.row + 1 else f"jump, {options.seams[best]:.2f} steps"
        return f"{what}: {led}; {options.counts()}; {options.value[best]:.1f} s"

    def _table(self, row: int) -> tuple[float, float]:
        """The position table's exact entry: displacement from a row to the next loop end."""
        film, stop = self.film, row
        dx = dy = 0.0
        while film.more[stop] and (stop - row < self._stride or film.end[stop] < 0):
            dx, dy, stop = dx + film.dx[stop], dy + film.dy[stop], stop + 1
        return dx, dy

    def _on_the_spot(self, fish: Fish, target: Floats) -> Stretch:
        """No way within the tank: turn towards the target where it is, while the film goes on."""
        film = self.film
        ways, _ = self._ways_on(fish, jumps=True)
        begin = int(ways[0]) if len(ways) else fish.row
        rows, rot = np.arange(begin, begin + self._stride), self._rotation(fish, begin)
        after = np.minimum(rows[:-1] + 1, film.last)
        goes_on = film.more[after] & film.endless[np.minimum(after + 1, film.last)]
        rows = rows[: 1 + int(np.argmin(np.append(goes_on, False)))]
        error = step.wrap(step.bearing(fish.x, fish.y, *target) - fish.heading)
        turn = np.clip(error / len(rows), -_ON_SPOT_DEG, _ON_SPOT_DEG)
        rots = rot + turn * np.arange(1, len(rows) + 1)
        headings = film.heading[rows] + rots
        way = np.column_stack([np.full(len(rows), fish.x), np.full(len(rows), fish.y), headings])
        jump = begin != fish.row + 1
        fish.row, fish.rot = int(rows[-1]), float(rots[-1])
        fish.heading = float(step.wrap(headings[-1]))
        fish.since = len(rows) - 1 if jump else fish.since + len(rows)
        fish.shown[rows], fish.speed = fish.tick + np.arange(len(rows)), 0.0
        return Stretch(
            FILM, target, way, rows, jump, np.nan, False, "no way on: turn on the spot", FRAME, rots
        )


def choose(
    options: Options, allowed: NDArray[np.bool_], rate_hz: float, rng: np.random.Generator
) -> int | None:
    """One of the best of the allowed ways; None if there is none."""
    if not allowed.any():
        return None
    value = np.where(allowed, options.value, np.inf)
    return int(np.argmin(value + rng.exponential(_FREE_S, len(value))))


def considered(options: Options, best: int | None) -> tuple[Considered, ...]:
    """What was weighed, and whether it was taken; `best` None: nothing of it."""
    fails = np.select(
        [~options.inside, ~options.towards, ~options.heads, ~np.isfinite(options.value)],
        ["tank", "quadrant", "heading", "passed over"],
        "",
    )
    return tuple(
        (int(row), float(seam), float(value), str(fail), i == best)
        for i, (row, seam, value, fail) in enumerate(
            zip(options.rows, options.seams, options.value, fails, strict=True)
        )
    )
