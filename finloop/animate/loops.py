"""Loops mode: the film plays, and goes on elsewhere at loops, towards the goal (Figs. 10, 11, 17).

At a loop end every way on is looked at: playing on, and each jump. The position table (Fig. 11)
says in quadrants where playing forward leads; here its exact displacements are followed, loop after
loop, some seconds ahead. `verdicts` are the tests of Fig. 19.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from finloop.animate import kinematics as step
from finloop.animate import search
from finloop.animate.edit_list import ENTER, FRAME, JUMP, PLAY, SPOT, VERDICTS
from finloop.animate.kinematics import Spot
from finloop.animate.motion import FILM
from finloop.animate.search import Candidates, Found, Here, Rules
from finloop.animate.state import Decision, Fish, Options, Stretch, Waters
from finloop.base.arrays import Floats, Ints, Mask
from finloop.features.table import wrap_deg
from finloop.loops.positions import displacement, next_end, quadrant


def verdicts(
    found: Found, before: float, most_error_deg: float, free: bool = False
) -> NDArray[np.int8]:
    """The tests of Fig. 19 on ways (k,): the first that each fails, as its number in `VERDICTS`.

    A way must stay in the tank and not come to a dead end; must lead towards the goal, which is
    `before` px away when it begins; and must head at most `most_error_deg` off the goal when done.
    free: whether the fish only wanders, and need only stay in the tank.
    """
    verdict = np.zeros(len(found.value), np.int8)
    if not free:  # The last first: a test that comes earlier has the last word.
        verdict[found.error > most_error_deg] = VERDICTS.index("heading")
        verdict[found.far >= before] = VERDICTS.index("quadrant")
    verdict[np.isinf(found.value)] = VERDICTS.index("tank")
    verdict[found.over] = VERDICTS.index("passed over")
    return verdict


class FilmSwimmer:
    """Swims by the film."""

    def __init__(self, waters: Waters) -> None:
        self.waters = waters
        motion, settings, rate = waters.motion, waters.settings, waters.motion.rate_hz
        swims = waters.film.speed[waters.film.more]
        self.rules = Rules(
            pace=float(np.quantile(swims, 0.75)) * motion.body_length_px / rate,
            turning=float(np.median(motion.turns.angle_deg / motion.turns.ticks)),
            horizon=max(2, waters.ticks(settings.look_ahead_s)),
            stride=max(1, waters.ticks(settings.stride_s)),
            stay=max(1, waters.ticks(settings.stay_s)),
            beam=settings.beam,
            seam=settings.seam_s * rate,
            jerk=settings.jerk_s * rate,
            again=settings.again_s * rate,
            memory=settings.memory_s * rate,
        )

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, at a row from which the film goes on for ever."""
        film = self.waters.film
        x, y = self.waters.tank.random_point(rng)
        row = int(rng.choice(np.flatnonzero(film.more[:-1] & film.endless[1:])))
        rot = float(rng.uniform(-180, 180)) if film.body else 0.0
        heading = float(step.wrap(film.heading[row] + rot))
        return Fish(x, y, heading, 0.0, FILM, -1, row=row, rot=rot, since=self.rules.stay)

    def swim(self, fish: Fish, goal: Spot, rng: np.random.Generator) -> Stretch:
        """Go on to the next loop end, by the best way towards the goal."""
        aim = self.aim(fish, goal)
        options = self.options(fish, aim)
        for allowed in (options.legal, np.isfinite(options.value)):
            taken = self.choose(options, allowed, rng)
            if taken is not None:
                return self.play(fish, taken, goal, aim)
        return self._on_the_spot(fish, aim)

    def aim(self, fish: Fish, goal: Spot) -> Spot:
        """The point to head for: the goal, or what is in sight of the way to it."""
        aim = self.waters.aim(fish, goal, self.waters.touch_px)
        return goal if aim[:2] == self.waters.tank.into(goal.x, goal.y) else aim

    def options(self, fish: Fish, aim: Spot) -> Options:
        """The ways on from a fish that is in the film."""
        film = self.waters.film
        rows, seams = self._ways_on(fish, fish.since + 1 >= self.rules.stay)
        jumps = rows != fish.row + 1
        rots = np.full(len(rows), fish.rot)
        if film.body:
            rots = wrap_deg(film.heading[fish.row + 1] + fish.rot - film.heading[rows])
        return self.weigh(fish, aim, rows, rots, np.where(jumps, seams, np.nan))

    def _ways_on(self, fish: Fish, jumps: bool) -> tuple[Ints, Floats]:
        """Rows that can be shown next and need never stop, playing on first, and their seams."""
        film, row = self.waters.film, fish.row + 1
        rows, seams = np.array([row]), np.zeros(1)
        if jumps and film.end[row] >= 0:
            here = slice(film.start[film.end[row]], film.start[film.end[row] + 1])
            rows, seams = np.append(rows, film.to[here]), np.append(seams, film.seam[here])
        plays = film.plays(rows)
        return rows[plays].astype(np.int64), seams[plays]

    def weigh(self, fish: Fish, aim: Spot, rows: Ints, rots: Floats, seams: Floats) -> Options:
        """Look ahead from rows (k,) that could be shown next; seam NaN: not a jump, the film's own.

        Showing a row costs its seam, its change of speed, and more where it, or what follows within
        the shortest stay, was on screen just now; playing on costs this last part alone.
        """
        film, waters, rate = self.waters.film, self.waters, self.waters.motion.rate_hz
        last = search.last_on_screen(fish.recent, len(film.more))
        soon = np.minimum(rows[:, None] + np.arange(self.rules.stay), len(last) - 1)
        faster = film.speed[rows] - fish.speed
        ago = (fish.tick - last[soon].max(1)).astype(float)
        jumps = ~np.isnan(seams)
        terms = np.array(search.jump_cost(seams, faster, ago, self.rules)).T
        terms[~jumps, :2] = 0.0
        x, y = self.arrival(fish)
        costs, since = terms[:, 0] + terms[:, 1] + terms[:, 2], np.where(jumps, 0, fish.since + 1)
        candidates, here = Candidates(rows, rots, costs, since), Here(x, y, fish.tick, last)
        found = search.look(film, waters.tank.legal, candidates, here, aim, self.rules)
        before = float(np.hypot(aim.x - x, aim.y - y))
        verdict = verdicts(found, before, waters.settings.most_error_deg, aim.free)
        seams, value = np.where(jumps, seams, 0.0), found.value / rate
        return Options(rows, rots, seams, terms / rate, value, found.ticks, verdict)

    def arrival(self, fish: Fish) -> tuple[float, float]:
        """Where the fish is at the next tick: by the film, or at its speed if it shows sprites."""
        film, motion = self.waters.film, self.waters.motion
        if fish.row < 0:
            forward = fish.speed * motion.body_length_px / motion.rate_hz
            return step.ahead(fish.x, fish.y, fish.heading, forward, 0.0)
        dx, dy = search.moved(film.dx[fish.row], film.dy[fish.row], fish.rot)
        return fish.x + dx, fish.y + dy

    def choose(self, options: Options, allowed: Mask, rng: np.random.Generator) -> Options | None:
        """The options, one of the best of the allowed taken; None if there is none."""
        if not allowed.any():
            return None
        value = np.where(allowed, options.value, np.inf)
        free = rng.exponential(self.waters.settings.free_s, len(value))
        return replace(options, taken=int(np.argmin(value + free)))

    def play(self, fish: Fish, options: Options, goal: Spot, aim: Spot) -> Stretch:
        """Show the row that is taken, and those after it up to the next loop end or the goal."""
        row, rot = int(options.rows[options.taken]), float(options.rots[options.taken])
        way = np.zeros(1, search.WAY)
        way["x"], way["y"] = self.arrival(fish)
        way["row"], way["rot"] = row, rot
        path, touched = search.swim(self.waters.film, way, goal, aim, self.rules)
        plays = row == fish.row + 1 and fish.row >= 0
        return Stretch(
            FILM, path, np.arange(row, row + len(path)), not plays, aim, touched,
            self.decision(options, ENTER if fish.row < 0 else PLAY if plays else JUMP), FRAME,
            np.full(len(path), rot), options=options,
        )  # fmt: skip

    def decision(self, options: Options, reason: str) -> Decision:
        """Why the way is taken that is."""
        film, taken = self.waters.film, options.taken
        row = int(options.rows[taken])
        end = next_end(film.more, film.end, row, self.rules.stride)
        dx, up = displacement(film.x, film.y, row, end)
        dx, down = search.moved(float(dx), -float(up), float(options.rots[taken]))
        decision = Decision(
            reason,
            seam=np.nan if reason == PLAY else float(options.seams[taken]),
            value_s=float(options.value[taken]),
            quadrant=int(quadrant(dx, -down)),
        )
        return counted(decision, options)

    def _on_the_spot(self, fish: Fish, aim: Spot) -> Stretch:
        """No way within the tank: turn towards the aim where it is, while the film goes on."""
        film, spot_deg = self.waters.film, self.waters.settings.spot_deg
        ways, _ = self._ways_on(fish, jumps=True)
        begin, last = int(ways[0]) if len(ways) else fish.row, len(film.more) - 1
        rot = fish.rot
        if film.body:
            rot = float(step.wrap(film.heading[fish.row + 1] + rot - film.heading[begin]))
        rows = np.arange(begin, begin + self.rules.stride)
        next_row = np.minimum(rows[:-1] + 1, last)
        goes_on = film.more[next_row] & film.endless[np.minimum(next_row + 1, last)]
        rows = rows[: 1 + int(np.argmin(np.append(goes_on, False)))]
        error = step.wrap(step.bearing(fish.x, fish.y, aim.x, aim.y) - fish.heading)
        turn = np.clip(error / len(rows), -spot_deg, spot_deg)
        rots = rot + turn * np.arange(1, len(rows) + 1)
        way = np.empty((len(rows), 3))
        way[:, 0], way[:, 1], way[:, 2] = fish.x, fish.y, film.heading[rows] + rots
        return Stretch(
            FILM, way, rows, begin != fish.row + 1, aim, False, Decision(SPOT), FRAME, rots
        )  # fmt: skip


def counted(decision: Decision, options: Options) -> Decision:
    """A decision, with how many ways were weighed for it, and how many fail which test."""
    counts = np.bincount(options.verdict, minlength=len(VERDICTS)).tolist()
    _, tank, quadrant, heading, _ = counts  # in the order of VERDICTS
    return decision._replace(
        ways=len(options.rows), ways_tank=tank, ways_quadrant=quadrant, ways_heading=heading
    )
