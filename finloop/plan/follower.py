"""Swimming along a path, in every mode: by the film, as is foretold, or whichever keeps to it.

At every decision the ways on are followed some seconds ahead along the path, through the film, its
mirror images and their jumps, steered as the fish will be. Their costs are added up: beside the
path and late, seams, changes of speed, what was on screen just now, corrections. The first part of
the cheapest is swum; beside other fish, which may come in its way, no more than a stride of it, and
it is chosen of fewer. As is foretold the same is looked at over the forecast's own graph of similar
rows, and the fish swims as the network foretells. A fish of sprites is sent to a place ahead on the
path; so is one that no way leads on.
"""

from dataclasses import replace

import numpy as np

from finloop.animate.company import Company
from finloop.animate.kinematics import Target
from finloop.animate.route import Route, foot, least_along, place
from finloop.animate.state import Fish, Progress, Run
from finloop.base.arrays import Floats, Ints
from finloop.edit.schema import FILM, FORECAST, FORETOLD, FRAME, JUMP, PLAY, SPOT, TURN
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import wrap_deg
from finloop.forecast.sampling import follow, ways
from finloop.plan import advance, search
from finloop.plan.advance import onward, steered
from finloop.plan.cost import Steering
from finloop.plan.film_swimmer import counted
from finloop.plan.objectives import along_path
from finloop.plan.plan import Options, Plan, seam_to
from finloop.plan.policies import Policy
from finloop.plan.search import SearchStart, Ways
from finloop.plan.space import SearchGraph, reach_of
from finloop.plan.world import FilmWorld, spread

_FEWER = 4  # a fish that has others near it follows so many times fewer ways
_STARTS = 300  # rows that a path is begun from are drawn from so many


class Follower:
    """Follows paths. policy: of its mode."""

    def __init__(self, policy: Policy, waters: FilmWorld) -> None:
        self.policy, self.waters = policy, waters
        motion, p = waters.motion, waters.settings
        self.spread = spread(waters.film, motion.delta)
        self.rules = waters.cost_weights(p.path_ahead, p.path_stride, p.path_beam, p.path_again)
        self.steering = Steering(
            turn=max(p.path_share * self.spread.turn_deg / motion.delta, 1e-6),
            shift=p.path_share * motion.body_length_px / motion.rate_hz,
            brisk=self.rules.pace * motion.rate_hz / motion.body_length_px,
            reach=reach_of(waters), length_px=motion.body_length_px,
            across=p.path_across, late=p.path_late,
            heading=p.path_heading, effort=p.path_effort,
        )  # fmt: skip
        self._swum = self.rules.stride * max(1, waters.ticks(p.path_plan) // self.rules.stride)
        self._alone = self.rules._replace(horizon=self.rules.horizon + self._swum)
        # Beside others it looks after every stride, and at fewer ways.
        self.rules = self.rules._replace(
            horizon=self.rules.horizon + self.rules.stride, beam=1 + p.path_beam // _FEWER
        )
        self._film = self._foretold = None
        if policy.shows_film:
            self._film = policy.film.footage
        if policy.forecast is not None:
            self._foretold = policy.forecast.footage

    def begin(self, route: Route, rng: np.random.Generator) -> Fish:
        """A fish at the beginning of the path, in the row from which it can be followed best."""
        footage = self._film or self._foretold
        assert footage is not None
        x, y = map(float, place(route, 0.0))
        rows = footage.film.rows
        plays = np.flatnonzero(rows["more"][:-1] & rows["endless"][:-1] & rows["endless"][1:])
        some = np.sort(rng.choice(plays, min(_STARTS, len(plays)), replace=False))
        ticks = np.minimum(footage.run[some], self.steering.reach)
        dx, dy = (rows[axis][some + ticks] - rows[axis][some] for axis in "xy")
        ahead = place(route, self.steering.length_px)
        towards = np.arctan2(y - ahead[1], ahead[0] - x)
        rots = wrap_deg(np.degrees(towards - np.arctan2(-dy, dx)))
        if not footage.film.body:
            rots = np.zeros_like(rots)
        begin = Ways(some, rots, np.zeros(len(some)), np.zeros(len(some), bool))
        slow = self.waters.tempo.price_along(0.0, self.waters.settings.path_pace)
        none = np.zeros((0, 3), np.int64)
        here = SearchStart(x, y, route.begins - 1, 0.0, self.rules.stay, none, slow=slow)
        plan = self._best(footage, begin, here, 0.0, route)
        best = plan.taken if plan else 0
        row, rot = int(some[best]), float(rots[best])
        state, of_film = (FILM, rot) if footage is self._film else (FORECAST, 0.0)
        heading = float(wrap_deg(rows["heading"][row] + rot))
        return Fish(x, y, heading, 0.0, state, -1, row=row, rot=of_film, since=self.rules.stay)

    def next(
        self, fish: Fish, path: Progress, route: Route, rng: np.random.Generator
    ) -> tuple[Stretch, Progress]:
        """What is shown next, and how the fish gets on with the path then."""
        since = least_along(route, path.along, fish.tick)
        path = path._replace(along=float(foot(route, fish.x, fish.y, since)[0]))
        asked = path.route is route and (path.foretold or self._film is not None)
        if path.runs and asked and not fish.company.near:
            stretch, on = self._go_on(fish, path, Decision(PLAY), None)
            if len(stretch.way):
                return stretch, on
        film, told = self._by_film(fish, path.along, route), None
        if film is None or (self._foretold is not None and self._leaves(film, fish, route)):
            told = self._as_foretold(fish, path.along, route)
        plans = [one for one in (film, told) if one is not None]
        # To leave the film is as dear as a seam of one natural step.
        if film and told and film.value > told.value + self.rules.seam:
            plans.reverse()
        for plan in plans:
            runs = plan.runs(self.rules.stride if fish.company.near else self._swum)
            planned = Progress(path.along, route, runs, plan is told)
            rate = self.waters.motion.rate_hz
            decision = Decision(PLAY, value_s=plan.value / rate, ways=len(plan.ways.rows))
            stretch, on = self._go_on(fish, planned, decision, plan.options(rate))
            if len(stretch.way):
                return stretch, on
        stretch, along = self._sent(fish, path.along, route, rng)
        return stretch, Progress(along)

    def _leaves(self, plan: Plan, fish: Fish, route: Route) -> bool:
        """Whether a plan is as dear as to leave the path and stand still all the time."""
        beside = self.waters.settings.path_left**2
        price = self.steering.across * beside
        price += self.steering.late * beside if route.timed else self._slow(fish)
        return plan.value > price * plan.ticks.sum()

    def _go_on(
        self, fish: Fish, path: Progress, decision: Decision, options: Options | None
    ) -> tuple[Stretch, Progress]:
        """The next run of a plan; beside others a stride of it at most."""
        assert path.route is not None
        run, *later = path.runs
        if fish.company.places.shape[1] and run.ticks > self.rules.stride:
            stride = self.rules.stride
            later.insert(0, Run(run.row + stride, run.ticks - stride))
            run = Run(run.row, stride)
        swim = self._swim if path.foretold else self._play
        stretch, along = swim(run, fish, path.along, path.route, decision)
        if options is not None and not path.foretold:
            stretch = replace(stretch, options=options, decision=counted(stretch.decision, options))
        runs = tuple(later) if len(stretch.way) == run.ticks else ()
        return stretch, path._replace(along=along, runs=runs)

    def _by_film(self, fish: Fish, along: float, route: Route) -> Plan | None:
        """The best way on by the film; None where there is none."""
        if self._film is None or fish.row < 0 or not self._film.film.more[fish.row]:
            return None
        film, jumps = self._film.film, fish.since + 1 >= self.rules.stay
        every = search.ways_on(film, fish.row + 1, fish.rot, jumps)
        x, y = advance.arrival(film, fish.x, fish.y, fish.row, fish.rot)
        here = self._here(fish, x, y)._replace(
            tick=fish.tick + 1, rest=int(film.rest[fish.row + 1])
        )
        return self._best(self._film, every, here, along, route)

    def _as_foretold(self, fish: Fish, along: float, route: Route) -> Plan | None:
        """The best row to follow; None where there is no forecast, or no row."""
        swimmer, footage = self.policy.forecast, self._foretold
        if swimmer is None or footage is None:
            return None
        fish, _ = swimmer.with_past(fish)
        rows, stays = ways(swimmer.sampler, fish.row)[0], footage.film.more[fish.row]
        if stays and fish.since < self.rules.stay:
            rows = rows[rows == fish.row]
        rows = np.ascontiguousarray(rows[footage.film.endless[rows]], np.int64)
        rots = np.asarray(wrap_deg(fish.heading - footage.film.heading[rows]), float)
        every = Ways(rows, rots, np.zeros(len(rows)), rows != fish.row)
        rest = int(footage.film.rest[fish.row])
        here = self._here(fish, fish.x, fish.y)._replace(rest=rest)
        return self._best(footage, every, here, along, route)

    def _here(self, fish: Fish, x: float, y: float) -> SearchStart:
        """What matters of a fish that is at x, y when it decides."""
        return SearchStart(
            x, y, fish.tick, fish.speed, fish.since, fish.recent, fish.repeat,
            _a_tick_later(fish.company), slow=self._slow(fish),
        )  # fmt: skip

    def _slow(self, fish: Fish) -> float:
        """Ticks that a tick on the spot costs a fish on a path without times."""
        return self.waters.tempo.price_along(fish.lag, self.waters.settings.path_pace)

    def _best(
        self, footage: SearchGraph, every: Ways, here: SearchStart, along: float, route: Route
    ) -> Plan | None:
        """The cheapest of some ways, or the longest where all come to an end."""
        if not len(every.rows):
            return None
        rules = self.rules if here.company.near else self._alone
        path = along_path(route, self.steering)
        terms, found, rows = search.weigh(footage, every, here, path, rules, along)
        if not len(rows):
            return None
        taken = int(np.flatnonzero(every.rows == rows[0])[0])
        ends = np.minimum(np.cumsum(footage.leg[rows]), rules.horizon)
        legs = np.diff(ends, prepend=0)
        return Plan(float(found.value[taken]), every, taken, terms, found, rows, legs)

    def _play(
        self, run: Run, fish: Fish, along: float, route: Route, decision: Decision
    ) -> tuple[Stretch, float]:
        """Play a run of the film."""
        assert self._film is not None
        film, row = self._film.film, run.row
        seam, rot = seam_to(film, fish, row)
        arrives = advance.arrival(film, fish.x, fish.y, fish.row, fish.rot)
        begins = np.array([
            [fish.x, fish.y, fish.heading], [*arrives, film.rows["heading"][row] + rot]
        ])  # fmt: skip
        way = onward(self._film, begins, row, rot, run.ticks - 1 + self.steering.reach)
        ticks = min(run.ticks, len(way) - 1)
        numbers = np.arange(row, row + ticks)
        speed = np.append(film.speed[fish.row], film.speed[row : row + len(way) - 2])
        swum, used, on = self._steered(way, speed, numbers, (along, fish.tick), route)
        numbers, plays = numbers[: len(swum)], row == fish.row + 1
        if not plays:
            decision = decision._replace(reason=JUMP, seam=seam)
        return Stretch(
            FILM, swum, numbers, not plays, self._aim(route, on), False, decision, FRAME,
            wrap_deg(swum[:, 2] - film.heading[numbers]), steer=used,
        ), on  # fmt: skip

    def _swim(
        self, run: Run, fish: Fish, along: float, route: Route, decision: Decision
    ) -> tuple[Stretch, float]:
        """Follow a run of the film as is foretold."""
        swimmer, footage = self.policy.forecast, self._foretold
        assert swimmer is not None and footage is not None
        sampler, row = swimmer.sampler, run.row
        fish, past = swimmer.with_past(fish)
        foretold = follow(sampler, past, row, run.ticks, sampler.control[row])
        states = np.ascontiguousarray(foretold[::-1])
        begins = swimmer.course(states, fish, row)
        last = row + len(states)
        rot = float(begins[-1, 2] - footage.film.rows["heading"][last])
        way = onward(footage, begins, last, rot, self.steering.reach)
        speed = footage.film.speed[row : row + len(way) - 1]
        numbers = row + 1 + np.arange(len(states))
        swum, used, on = self._steered(way, speed, numbers, (along, fish.tick), route)
        ticks = len(swum)
        numbers = numbers[:ticks]
        return Stretch(
            FORECAST, swum, numbers, row != fish.row, self._aim(route, on), False,
            decision._replace(reason=FORETOLD), FRAME,
            wrap_deg(swum[:, 2] - self.waters.film.heading[numbers]),
            past=np.concatenate([past[::-1], states[:ticks]]), steer=used,
        ), on  # fmt: skip

    def _sent(
        self, fish: Fish, along: float, route: Route, rng: np.random.Generator
    ) -> tuple[Stretch, float]:
        """Towards a place ahead on the path, as to any goal, and steered."""
        aim = self._aim(route, along)
        stretch = self.policy.next(fish, aim, rng)
        if stretch.decision.reason == SPOT:
            return replace(stretch, touched=False), along
        if stretch.state != TURN:
            stretch = stretch.cut(self.rules.stride)
        px = np.array([[fish.x, fish.y, fish.heading]])
        way = np.concatenate([px, stretch.way])
        step = np.hypot(*np.diff(way[:, :2], axis=0).T)
        speed = step * self.waters.motion.rate_hz / self.steering.length_px
        swum, used, on = self._steered(way, speed, stretch.pictures, (along, fish.tick), route)
        if not len(swum):
            return replace(stretch, touched=False), along
        stretch = replace(stretch.cut(len(swum)), way=swum, steer=used, touched=False)
        if stretch.kind == FRAME:
            rot = wrap_deg(swum[:, 2] - self.waters.film.heading[stretch.number])
            stretch = replace(stretch, rot=rot)
        return stretch, on

    def _steered(
        self, way: Floats, speed: Floats, numbers: Ints, begins: tuple[float, int], route: Route
    ) -> tuple[Floats, Floats, float]:
        """See `steering.steered`."""
        speed, numbers = np.ascontiguousarray(speed, float), numbers.astype(np.int64)
        return steered(way, speed, numbers, begins, route, (self.waters.bounds, self.steering))

    def _aim(self, route: Route, along: float) -> Target:
        """A place a body length ahead on the path."""
        x, y = map(float, place(route, along + self.steering.length_px))
        return Target(x, y, self.waters.touch_px, self.waters.head_px)


def _a_tick_later(company: Company) -> Company:
    """The company of a fish, as paths count: the first tick that is swum is `fish.tick` + 1."""
    return company._replace(start=company.start + 1, until=company.until + 1)
