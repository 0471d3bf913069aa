"""Who swims in mode `matching`, and the next stretch: to a goal, along a path, or anywhere."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from finloop.animate.cast import Cast
from finloop.animate.company import ALONE, Company, can_stay, company_of, near_first
from finloop.animate.kinematics import Target
from finloop.animate.places import somewhere
from finloop.animate.route import Route
from finloop.animate.rule import Rule
from finloop.animate.shoal import NoRoom
from finloop.animate.state import Effort, Progress, State
from finloop.base.arrays import Floats
from finloop.edit.build import Sources
from finloop.edit.joins import Joins
from finloop.edit.schema import CONSIDERED, FRAME, TURN, VERDICTS, Goal
from finloop.edit.stretch import Stretch, Swim
from finloop.plan.fallback import Avoidance
from finloop.plan.follower import Follower
from finloop.plan.objectives import effort, wish
from finloop.plan.plan import after
from finloop.plan.policies import Policy
from finloop.plan.walls import fits
from finloop.plan.world import FilmWorld
from finloop.social.rule import Shoaling

_PLACES = 200  # a place clear of the other fish is drawn so often


@dataclass(frozen=True)
class Player:
    """Whoever swims. policy: what may be shown next; joins: how pictures follow on others.

    shoaling: how fish swim by zones; None where nothing was learnt of it.
    """

    policy: Policy
    waters: FilmWorld
    cast: Cast
    joins: Joins
    shoaling: Shoaling | None = None

    most_fish = None

    @cached_property
    def sources(self) -> Sources:
        """What its edit lists can show."""
        film, motion = self.waters.film, self.waters.motion
        own = slice(0, film.filmed)
        return Sources(
            motion.rate_hz, motion.body_length_px, film.heading[own], film.scale[own],
            film.more[own], np.ones(1), np.zeros(1, np.int64), 1, self.joins,
            ("matching", "matching"),
        )  # fmt: skip

    def begin(
        self, rng: np.random.Generator, route: Route | None = None, company: Company = ALONE
    ) -> State:
        """A fish somewhere in the tank, clear of the walls and of the others.

        Or at the beginning of a path, whoever else is there. NoRoom where, of many places drawn,
        none is clear.
        """
        if route is not None:
            return State(self.follower.begin(route, rng), np.zeros(2))
        for _ in range(_PLACES):
            fish = self.policy.begin(rng)
            place = np.array([fish.x, fish.y, fish.heading])
            fits_in = fits(self.waters.bounds, fish.picture, *place)
            if fits_in and can_stay(company, fish.picture, place, fish.tick):
                return State(fish, np.zeros(2))
        others = company.places.shape[1]
        raise NoRoom(
            f"in the tank there is no room for another fish beside {others}",
            f"at most {others} fish",
            "take fewer fish, or let them overlap (matching.overlap=true)",
        )

    def company(self, others: Floats, start: int) -> Company:
        """What a fish that decides at a tick knows of the others (n, m, 4), of `Plans.others`."""
        p = self.waters.settings
        if p.overlap or not others.shape[1]:
            return ALONE
        return company_of(others, start, self.cast.discs, self.waters.ticks(p.give_way))

    def among(self, state: State, others: Floats) -> State:
        """A state that decides among others (n, m, 4), of `Plans.others`.

        It looks for those alone that it can come near.
        """
        fish = state.fish
        company = self.company(others, fish.tick)
        if company.near:
            company = near_first(company, fish.x, fish.y, self.waters.farthest)
        return state._replace(fish=replace(fish, company=company))

    @cached_property
    def _avoidance(self) -> Avoidance:
        return Avoidance(self.policy, self.waters)

    @cached_property
    def follower(self) -> Follower:
        """Whoever follows paths as this player swims."""
        return Follower(self.policy, self.waters)

    def step(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """The next stretch to the goal, along a path, by a rule, or anywhere, and the state then.

        The same state, goal and generator state give the same stretch. Nothing else is changed.
        """
        waters, place, left = self.waters, state.place, 0
        fish = state.fish
        if isinstance(goal, Route):
            whole, path = self.follower.next(fish, state.path, goal, rng)
            stretch = self._avoidance.kept_clear(fish, whole, rng)
            # How far along a path a shorter one leads the next step finds from where it was.
            path = path if stretch is whole else Progress(state.path.along)
            return stretch, State(after(fish, stretch, waters), place, path=path)
        wished, free, tried = False, False, Effort()
        if isinstance(goal, Goal):
            tried = effort(state.effort, fish, goal, waters, rng)
            x, y = tried.detour if fish.tick < tried.until else tried.goal
        else:
            place, left, wished = self._target(state, goal, rng)
            x, y = place
            free = not wished and waters.settings.wander == "film"
        spot = Target(float(x), float(y), waters.touch_px, waters.head_px, free)
        film = self.policy.film
        if fish.tick < tried.until and film.faces_wall(fish):
            stretch = film.stay(fish, spot)
        else:
            stretch = self.policy.next(fish, spot, rng)
        stretch = self._avoidance.kept_clear(fish, stretch, rng)
        if fish.tick < tried.until and stretch.touched:  # it was the place of a detour
            stretch, tried = replace(stretch, touched=False), tried._replace(until=fish.tick)
        keeps = not isinstance(goal, Goal) and not stretch.touched
        turns = stretch.state == TURN and not wished
        left = max(0, left - len(stretch.way) * (not turns)) if keeps else 0
        return stretch, State(after(fish, stretch, waters), place, left, wished, tried)

    def _target(
        self, state: State, rule: Rule | None, rng: np.random.Generator
    ) -> tuple[Floats, int, bool]:
        """A place (2,) px that is no goal, for how many ticks, and whether a rule wishes it."""
        if state.left > 0 and state.wished and rule is not None and rule.leader is None:
            return state.place, state.left, True
        wished = None if rule is None else wish(rule, state.fish, self.waters, rng)
        if wished is not None:
            return *wished, True
        if state.left > 0 and not state.wished:
            return state.place, state.left, False
        return *somewhere(self.waters, state.fish, rng), False

    def is_clear(self, state: State, stretch: Stretch) -> bool:
        """Whether a stretch from a state meets no other fish, now or where it ends."""
        return self._avoidance.ticks(state.fish, stretch) == len(stretch.way)

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """A stretch that began in a state, stopped after some ticks, and the state then."""
        short = stretch.cut(ticks)
        # How far along a path it is then the next step finds from where it was.
        path = Progress(state.path.along)
        return short, state._replace(fish=after(state.fish, short, self.waters), path=path)

    def hull(self, kind: str, source: int) -> Floats:
        """The outline of a frame or sprite."""
        if kind == FRAME:
            return self.cast.frame_hulls[source : source + 1][0].astype(float)
        return self.cast.sprite_hulls[source]


def considered(swum: Swim, ticks: int, filmed: int, fish: int = 0) -> pd.DataFrame:
    """What was weighed in the first `ticks` ticks, with the columns of `CONSIDERED`.

    filmed: rows of the film, after which its mirror images are counted; fish: its number.
    """
    begins = np.cumsum([0] + [len(s.way) for s in swum.stretches])
    rows = [
        (tick, row % filmed, row >= filmed, seam, value, VERDICTS[verdict], i == o.taken)
        for tick, o in zip(begins, (s.options for s in swum.stretches), strict=False)
        if tick < ticks and o is not None
        for i, (row, seam, value, verdict) in enumerate(
            zip(o.rows, o.seams, o.value, o.verdict, strict=True)
        )
    ]
    table = pd.DataFrame(rows, columns=CONSIDERED.names[1:])
    table.insert(0, "fish", fish)
    return table.assign(value_s=table["value_s"].astype(float).replace(np.inf, np.nan))
