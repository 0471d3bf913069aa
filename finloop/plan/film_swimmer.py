"""Loops mode: the film plays, and goes on elsewhere at loops, towards the goal (Figs. 10, 11, 17).

At a loop end every way on is looked at: playing on, and each jump. The position table (Fig. 11)
says in quadrants where playing forward leads; here its exact displacements are followed, loop after
loop, some seconds ahead.
"""

from dataclasses import replace
from functools import cached_property

import numpy as np

from finloop.animate import kinematics as step
from finloop.animate.kinematics import Target, aim_in
from finloop.animate.state import Fish
from finloop.edit.schema import FILM, FORECAST, FRAME, JUMP, PLAY, SPOT, VERDICTS
from finloop.edit.stretch import Decision, Stretch
from finloop.loops.positions import quadrant
from finloop.plan import advance, search
from finloop.plan.objectives import to_goal
from finloop.plan.plan import Options
from finloop.plan.search import SearchStart, Ways
from finloop.plan.space import SearchGraph, footage_of, reach_of, search_graph
from finloop.plan.walls import beyond
from finloop.plan.world import FilmWorld

_WIDER = 8  # times as many ways are followed where, of those that were, none leads on


class FilmSwimmer:
    """Swims by the film."""

    def __init__(self, waters: FilmWorld) -> None:
        self.waters = waters
        p = waters.settings
        self.rules = waters.cost_weights(p.look_ahead, p.stride, p.beam, p.again)
        self._wide = self.rules._replace(beam=_WIDER * p.beam)

    @cached_property
    def space(self) -> SearchGraph:
        """The film as it is searched."""
        return search_graph(self.waters.film, self.waters.bounds, self.rules)

    @cached_property
    def footage(self) -> SearchGraph:
        """The film as paths are followed through it."""
        stride = max(1, self.waters.ticks(self.waters.settings.path_stride))
        return footage_of(self.space, reach_of(self.waters), stride)

    def begin(self, rng: np.random.Generator) -> Fish:
        """A fish somewhere in the tank, at a row from which the film goes on for ever."""
        film = self.waters.film
        x, y = self.waters.tank.random_point(rng)
        row = int(rng.choice(np.flatnonzero(film.more[:-1] & film.endless[1:])))
        rot = float(rng.uniform(-180, 180)) if film.body else 0.0
        heading = float(step.wrap(film.heading[row] + rot))
        return Fish(x, y, heading, 0.0, FILM, -1, row=row, rot=rot, since=self.rules.stay)

    def swim(self, fish: Fish, goal: Target, rng: np.random.Generator) -> Stretch:
        """Go on to the next loop end, by the best way towards the goal."""
        aim = self.aim(fish, goal)
        options = self.choose(self.options(fish, aim), rng)
        if options.taken < 0:
            return self.stay(fish, aim)
        return self.play(fish, options, goal, aim)

    def aim(self, fish: Fish, goal: Target) -> Target:
        """The point to head for: the goal, or what is in sight of the way to it."""
        aim = aim_in(self.waters.tank, (fish.x, fish.y), goal, self.waters.touch_px)
        return goal if aim[:2] == self.waters.tank.into(goal.x, goal.y) else aim

    def options(self, fish: Fish, aim: Target) -> Options:
        """The ways on from a fish that is in the film, or swims as is foretold.

        The latter goes over to other rows when it likes, so it may jump at once.
        """
        jumps = fish.state == FORECAST or fish.since + 1 >= self.rules.stay
        return self.weigh(fish, aim, self._ways_on(fish, jumps))

    def _ways_on(self, fish: Fish, jumps: bool) -> Ways:
        """Ways on that need never stop, playing on first; jumps: whether the fish may jump."""
        return search.ways_on(self.waters.film, fish.row + 1, fish.rot, jumps)

    def weigh(self, fish: Fish, aim: Target, ways: Ways) -> Options:
        """Look ahead from ways (k,) that could be shown next.

        The cheapest ways are much alike, and may all run into one wall. Then more are followed.
        """
        rate = self.waters.motion.rate_hz
        here = SearchStart(
            *self.arrival(fish), fish.tick, fish.speed, fish.since, fish.recent, fish.repeat,
            fish.company, int(self.waters.film.rest[fish.row + 1]),
            self.waters.price_of_rest(fish, aim),
        )  # fmt: skip
        goal = to_goal(aim)
        terms, found, _ = search.weigh(self.space, ways, here, goal, self.rules)
        if found.over.any() and np.isinf(found.value).all():  # passed-over ones may
            terms, found, _ = search.weigh(self.space, ways, here, goal, self._wide)
        verdict = search.verdicts(found)
        terms, value = terms / rate, found.value / rate
        return Options(ways.rows, ways.rots, ways.seams, terms, value, found.ticks, verdict)

    def arrival(self, fish: Fish) -> tuple[float, float]:
        """Where the fish is at the next tick, by the film."""
        return advance.arrival(self.waters.film, fish.x, fish.y, fish.row, fish.rot)

    def choose(self, options: Options, rng: np.random.Generator) -> Options:
        """Return the options, one of the best of those that stay in the tank taken, if any."""
        if not np.isfinite(options.value).any():
            return options
        motion = self.waters.motion
        free_s = self.waters.settings.free * motion.delta / motion.rate_hz
        free = rng.exponential(free_s, len(options.value))
        return replace(options, taken=int(np.argmin(options.value + free)))

    def play(self, fish: Fish, options: Options, goal: Target, aim: Target) -> Stretch:
        """Show the row that is taken, and those after it up to the next loop end or the goal."""
        row, rot = int(options.rows[options.taken]), float(options.rots[options.taken])
        path, touched, (dx, dy) = advance.play(
            self.waters.film, (*self.arrival(fish), rot), row, (goal, aim), self.rules
        )
        plays = row == fish.row + 1
        reason = PLAY if plays else JUMP
        return Stretch(
            FILM, path, np.arange(row, row + len(path)), not plays, aim, touched,
            decision(options, reason, int(quadrant(dx, -dy))), FRAME, np.full(len(path), rot),
            options=options,
        )  # fmt: skip

    def faces_wall(self, fish: Fish) -> bool:
        """Whether the fish is in the film, and has no room ahead to turn aside."""
        bounds, room = self.waters.bounds, self.rules.room
        there = fish.x, fish.y, fish.heading
        return fish.row >= 0 and fish.state == FILM and beyond(bounds, *there, room) > 0.0

    def stay(self, fish: Fish, aim: Target, turns: bool = True) -> Stretch:
        """No way on: stay in place while the film goes on. turns: whether towards the aim."""
        film, most_deg = self.waters.film, self.waters.brisk.turn_deg
        ways = self._ways_on(fish, jumps=True).rows
        begin, last = int(ways[0]) if len(ways) else fish.row, len(film.more) - 1
        rot = fish.rot
        if film.body:
            rot = float(step.wrap(film.heading[fish.row + 1] + rot - film.heading[begin]))
        rows = np.arange(begin, begin + self.rules.stride)
        next_row = np.minimum(rows[:-1] + 1, last)
        goes_on = film.more[next_row] & film.endless[np.minimum(next_row + 1, last)]
        rows = rows[: 1 + int(np.argmin(np.append(goes_on, False)))]
        filmed = film.heading[rows] + rot
        way = np.empty((len(rows), 3))
        way[:, 0], way[:, 1] = fish.x, fish.y
        bearing = step.bearing(fish.x, fish.y, aim.x, aim.y)
        before = heading = fish.heading
        for k, own in enumerate(filmed):
            if turns:
                heading += step.towards_by(step.wrap(own - before), bearing - heading, most_deg)
            way[k, 2], before = heading, own
        rots = way[:, 2] - film.heading[rows]
        return Stretch(
            FILM, way, rows, begin != fish.row + 1, aim, False, Decision(SPOT), FRAME, rots
        )  # fmt: skip


def decision(options: Options, reason: str, leads: int) -> Decision:
    """Why the way is taken that is; leads: the quadrant to which (Fig. 11)."""
    seam = np.nan if reason == PLAY else float(options.seams[options.taken])
    value_s = float(options.value[options.taken])
    return counted(Decision(reason, seam=seam, value_s=value_s, quadrant=leads), options)


def counted(decision: Decision, options: Options) -> Decision:
    """A decision, with how many ways were weighed for it, and how many fail which test."""
    counts = np.bincount(options.verdict, minlength=len(VERDICTS)).tolist()
    _, tank, quadrant, heading, _ = counts  # in the order of VERDICTS
    return decision._replace(
        ways=len(options.rows), ways_tank=tank, ways_quadrant=quadrant, ways_heading=heading
    )
