"""The planner of mode `matching`: takes a fish and its goal, returns the next stretch.

A goal is what is requested of a fish: a place, a path (`Route`), a rule, or nothing. Its task is
the path, or the place to touch as a `Target`, that a plan is made for. The objective of one search
is the path, or the target's nearest waypoint in sight.

One search (`finloop.plan.search`) compares branches: through the film where one leads on, else by
the forecast's predictions. The fish swims the first part of the best branch. Where no branch leads
on, `finloop.plan.fallback` decides what the fish does.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from finloop.animate.kinematics import Target, bearing, touches_target, wrap
from finloop.animate.memory import remember_rows
from finloop.animate.obstacles import (
    NO_OBSTACLES,
    Obstacles,
    can_stay,
    make_obstacles,
    sort_near_first,
)
from finloop.animate.places import random_wander_place
from finloop.animate.route import Route, find_nearest_on_route, nearest_search_start, point_along
from finloop.animate.rule import Rule
from finloop.animate.shoal import NoRoom
from finloop.animate.silhouettes import Silhouettes
from finloop.animate.state import Fish, Progress, State
from finloop.base.arrays import Floats, Ints
from finloop.edit.build import EditInputs
from finloop.edit.joins import JoinRules
from finloop.edit.schema import AS_PREDICTED, FILM, FRAME, JUMP, NO_WAY, PLAY, SPOT, WAITING, Goal
from finloop.edit.stretch import Decision, Stretch
from finloop.features.table import wrap_deg
from finloop.loops.positions import quadrant_of_displacement
from finloop.plan.cost import CHANCE, RARITY, TIME, CostWeights
from finloop.plan.fallback import Fallback
from finloop.plan.graph import drawn_rotations, random_fish_in_film
from finloop.plan.objectives import (
    ANYWHERE,
    Objective,
    path_objective,
    place_by_rule,
    target_objective,
)
from finloop.plan.plan import CandidateVerdicts, Plan
from finloop.plan.search import Candidates, SearchStart, beam_search, make_candidates
from finloop.plan.sources import MotionSource, Passage
from finloop.plan.walls import fits_in_tank
from finloop.plan.world import FilmWorld
from finloop.social.rule import SchoolRule

_MOST_TRIES = 200  # tries to draw a place clear of the other fish: a nearly full tank needs many
_FEWER = 4  # divides the beam of a fish that wanders, or that has others near it, to save time
_STARTS = 300  # random rows of which the best begins a path: in more, hardly a better one is found


@dataclass(frozen=True)
class Planner:
    """Moves fish in mode `matching`.

    world: tank and film; film, prediction: motion sources, at least one of them; silhouettes:
    outlines of all pictures; join_rules: how pictures are joined; school_rule: how fish swim by
    zones, None where the film shows none; sprite_rows (s,): the film's row behind each sprite, from
    which a fish of another mode goes on.
    """

    world: FilmWorld
    film: MotionSource | None
    prediction: MotionSource | None
    silhouettes: Silhouettes
    join_rules: JoinRules
    school_rule: SchoolRule | None
    sprite_rows: Ints

    most_fish = None

    @cached_property
    def edit_inputs(self) -> EditInputs:
        """Return the inputs of an edit list: ticks per second, headings, sizes, joins."""
        film, motion = self.world.film, self.world.motion
        filmed = slice(0, film.filmed_count)  # the rows after these are mirror images
        # This mode shows no sprites: the arrays of sprites hold one that is never shown.
        return EditInputs(
            motion.rate_hz, motion.body_length_px, heading_deg=film.heading[filmed],
            scale=film.scale[filmed], goes_on=film.has_next[filmed], sprite_scale=np.ones(1),
            sprite_after=np.zeros(1, np.int64), orientations=1, join_rules=self.join_rules,
            frame_mode="matching", sprite_mode="matching",
        )  # fmt: skip

    # --- where a fish begins, and which others it knows

    def begin(
        self, rng: np.random.Generator, route: Route | None = None,
        obstacles: Obstacles = NO_OBSTACLES,
    ) -> State:  # fmt: skip
        """Return the state of a fish at a random place, clear of the walls and of the other fish.

        With a route the fish is at its beginning, even if another fish is there. NoRoom where none
        of many random places is clear.
        """
        if route is not None:
            return State(self._begin_route(route, rng), np.zeros(2))
        source = self._first_source
        for _ in range(_MOST_TRIES):
            fish = random_fish_in_film(source.graph.film, self.world.tank, rng)
            fish = fish._replace(state=source.state)
            pose = np.array([fish.x, fish.y, fish.heading])
            fits_in = fits_in_tank(self.world.bounds, fish.picture, *pose)
            if fits_in and can_stay(obstacles, fish.picture, pose, fish.tick):
                return State(fish, np.zeros(2))
        others = obstacles.places.shape[1]
        raise NoRoom(
            f"in the tank there is no room for another fish beside {others}",
            f"at most {others} fish",
            "take fewer fish, or let them overlap (matching.overlap=true)",
        )

    def _begin_route(self, route: Route, rng: np.random.Generator) -> Fish:
        """Return a fish at the beginning of a route, in the row that leads best along it."""
        source = self._first_source
        graph, rows = source.graph, source.graph.film.rows
        lasting = graph.film.lasting_rows
        n = min(_STARTS, len(lasting))
        sampled = np.sort(rng.choice(lasting, n, replace=False))
        x, y = map(float, point_along(route, 0.0))
        rotations_deg = np.zeros(n)
        if graph.film.jumps_keep_heading:
            # Each row is turned so that the film leads along the route's first body length.
            previews = graph.previews[sampled]
            next_x, next_y = point_along(route, self.world.motion.body_length_px)
            route_rad = np.arctan2(y - next_y, next_x - x)
            film_rad = np.arctan2(-previews["dy"], previews["dx"])
            rotations_deg = np.asarray(wrap_deg(np.degrees(route_rad - film_rad)), float)
        candidates = make_candidates(sampled, rotations_deg, seams=np.zeros(n))
        rest_cost = self.world.tempo.cost_of_rest_on_path(0.0, self.world.settings.path_rest_cost)
        nothing_shown = np.zeros((0, 3), np.int64)
        tick_before = route.begins - 1
        start = SearchStart(x, y, tick_before, recent=nothing_shown, rest_cost=rest_cost)
        objective = path_objective(route, self.world.steering)
        plan = self._search_plan(source, candidates, start, objective)
        best = plan.taken if plan else 0  # any row, if none leads on
        row, rotation_deg = int(sampled[best]), float(rotations_deg[best])
        heading = float(wrap_deg(rows["heading"][row] + rotation_deg))
        return Fish(
            x,
            y,
            heading,
            speed=0.0,
            state=source.state,
            sprite=-1,
            row=row,
            rotation_deg=rotation_deg,
        )

    @property
    def _first_source(self) -> MotionSource:
        """Return the motion source that a fish begins with: the film, else the predictions."""
        source = self.film or self.prediction
        assert source is not None
        return source

    def others_to_avoid(self, other_plans: Floats, tick: int) -> Obstacles:
        """Return the other fish as obstacles for a fish that decides at `tick`.

        There are none where fish may overlap. other_plans (n, m, 4): x, y px, heading, picture of m
        others in n ticks, from `tick` on. When a plan has ended, that fish counts as staying where
        it ends; `give_way` Δ after the longest plan's end it does not count any more.
        """
        p = self.world.settings
        if p.overlap or not other_plans.shape[1]:
            return NO_OBSTACLES
        return make_obstacles(
            other_plans, tick, self.silhouettes.discs, ticks_after=self.world.to_ticks(p.give_way)
        )

    def with_obstacles(self, state: State, other_plans: Floats) -> State:
        """Replace the other fish that a state knows by their present plans; return the new state.

        Those near enough to be met come first. other_plans (n, m, 4): x, y px, heading, picture of
        m others in n ticks, from the fish's present tick on.
        """
        fish = state.fish
        obstacles = self.others_to_avoid(other_plans, fish.tick)
        if obstacles.near_count:  # until it is sorted, all others count as near
            obstacles = sort_near_first(obstacles, fish.x, fish.y, self.world.farthest_px)
        if obstacles is fish.obstacles:  # no others, before and now: both are `NO_OBSTACLES`
            return state
        return state._replace(fish=fish._replace(obstacles=obstacles))

    # --- what comes next

    def plan(
        self, state: State, goal: Goal | Route | Rule | None, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """Return the next stretch of a fish for its goal, path or rule, and the state after it.

        A fish without a goal gets a place for some ticks; when they are over, the next call chooses
        another. The same state, goal and generator state give the same result. Only the generator
        is changed.
        """
        # A fish of a mode with sprites may be in no row of the film.
        if state.fish.row < 0:
            state = state._replace(fish=self._fish_in_film(state.fish))
        if isinstance(goal, Route):
            return self._plan_on_route(state, goal, rng)
        fish = state.fish
        target, place, place_ticks_left, by_rule = self._choose_target(state, goal, rng)
        objective = target_objective(self._next_waypoint(fish, target))
        # A plan to a free target, which need not be touched, goes on when the place changes.
        task = ANYWHERE if target.free else target
        planned, progress = self._plan_or_stay(fish, state.progress, objective, task, rng)
        stretch = self._fallback.keep_clear(fish, planned)
        if stretch is not planned:  # another stretch took its place: the plan does not go on
            progress = Progress()
        # A fish without a goal swims to its place until it touches it, or its ticks are over.
        keeps_place = not isinstance(goal, Goal) and not stretch.touches_goal
        ticks = max(0, place_ticks_left - len(stretch.trajectory)) if keeps_place else 0
        return stretch, State(self._fish_after(fish, stretch), place, ticks, by_rule, progress)

    def _choose_target(
        self, state: State, goal: Goal | Rule | None, rng: np.random.Generator
    ) -> tuple[Target, Floats, int, bool]:
        """Choose the target of a fish without a path; return it, and what its state stores of it.

        Stored are the place (2,), its ticks, and whether a rule requested it; a goal is not stored.
        The target is free where the fish only wanders and goes where the film goes.
        """
        world = self.world
        if isinstance(goal, Goal):
            target = Target(float(goal.x_px), float(goal.y_px), world.touch_px, world.head_px)
            return target, state.place, 0, False
        place, ticks, by_rule = self._choose_place(state, goal, rng)
        free = not by_rule and world.settings.wander == "film"
        target = Target(float(place[0]), float(place[1]), world.touch_px, world.head_px, free)
        return target, place, ticks, by_rule

    def _choose_place(
        self, state: State, rule: Rule | None, rng: np.random.Generator
    ) -> tuple[Floats, int, bool]:
        """Choose a place for a fish without a goal; return x, y px (2,), ticks, whether by a rule.

        The ticks are those for which the fish swims there. A rule goes first; where it requests
        nothing, the place is a random one. A place behind a leader is chosen anew every time.
        """
        holds = state.place_ticks_left > 0
        if holds and state.by_rule and rule is not None and rule.leader is None:
            return state.place, state.place_ticks_left, True
        rule_place = None if rule is None else place_by_rule(rule, state.fish, self.world, rng)
        if rule_place is not None:
            return *rule_place, True
        if holds and not state.by_rule:
            return state.place, state.place_ticks_left, False
        return *random_wander_place(self.world, state.fish, rng), False

    def _next_waypoint(self, fish: Fish, target: Target) -> Target:
        """Return the point to head for: the target, or the last one in sight on a path to it."""
        tank = self.world.tank
        legal = tank.nearest_legal_point(target.x, target.y)
        if np.hypot(legal[0] - fish.x, legal[1] - fish.y) < self.world.touch_px:
            return target
        x, y = tank.waypoint(fish.x, fish.y, *legal)
        return target if (x, y) == legal else target._replace(x=x, y=y)

    def _plan_on_route(
        self, state: State, route: Route, rng: np.random.Generator
    ) -> tuple[Stretch, State]:
        """Return the next stretch of a fish on a route, and the state after it.

        Where the planned stretch comes too near to a wall or another fish, another one takes its
        place, and the rest of the plan is dropped.
        """
        fish, before = state.fish, state.progress
        search_start = nearest_search_start(route, before.along, fish.tick)
        along_px, _x, _y = find_nearest_on_route(route, fish.x, fish.y, search_start)
        at_fish = before._replace(along=float(along_px))
        objective = path_objective(route, self.world.steering)
        planned, progress = self._plan_or_stay(fish, at_fish, objective, route, rng)
        stretch = self._fallback.keep_clear(fish, planned)
        if stretch is not planned:
            # The next call searches on from the old place along the route for the new one.
            progress = Progress(before.along)
        return stretch, state._replace(fish=self._fish_after(fish, stretch), progress=progress)

    def _plan_or_stay(
        self, fish: Fish, before: Progress, objective: Objective, task: Route | Target,
        rng: np.random.Generator,
    ) -> tuple[Stretch, Progress]:  # fmt: skip
        """Go on with a fish's plan, or search a new one; return its next stretch and progress.

        The present plan goes on if it is for the same task, else a search makes one. Where no plan
        leads on, the fish stays in place. before: its progress and plan up to now; objective: of
        the search; task: the whole route, or the target, that a plan is for.
        """
        along_px = before.along
        if before.runs and _is_same_task(before.task, task):
            stretch, progress = self._swim_next_run(fish, before, objective, plan=None)
            if len(stretch.trajectory):
                return stretch, progress
        plans = self._best_plans(fish, along_px, objective, rng)
        if plans and (terms := self._turn_first_terms(fish, plans[0], objective, rng)):
            return self._stay(fish, along_px, objective, task, plans, terms), Progress(along_px)
        for plan in plans:
            runs = plan.first_runs(self._ticks_between_searches(objective))
            planned = Progress(along_px, task, runs, motion=plan.state)
            stretch, progress = self._swim_next_run(fish, planned, objective, plan)
            if len(stretch.trajectory):
                return stretch, progress
        return self._stay(fish, along_px, objective, task, plans), Progress(along_px)

    def _turn_first_terms(
        self, fish: Fish, plan: Plan, objective: Objective, rng: np.random.Generator
    ) -> tuple[float, ...]:
        """Return the cost, by term in s, of turning to the target on the spot, then swimming there.

        () if `plan`, which swims at once, costs as little, or there is no target. The film never
        shows such a turn: each tick of it costs itself, and as much as a step that the film shows
        once. The other fish count as they are now, before the turn.
        """
        aim, world = objective.aim, self.world
        if aim.free or len(objective.route.x):
            return ()
        cost_at_once = self._full_cost(plan)
        to_aim_deg = bearing(fish.x, fish.y, aim.x, aim.y)
        turn_deg = float(wrap(to_aim_deg - fish.heading))
        turn_ticks = abs(turn_deg) / world.most_spot_turn_deg
        turn_cost = turn_ticks * (1 + world.rarest_step_cost)
        far_px = float(np.hypot(aim.x - fish.x, aim.y - fish.y)) - aim.touch_px
        least_cost = turn_cost + max(far_px, 0.0) / self._weights.fast_px
        if turn_ticks < 1 or least_cost >= cost_at_once:
            return ()
        turned = fish._replace(
            heading=to_aim_deg, rotation_deg=float(wrap(fish.rotation_deg + turn_deg))
        )
        plans = self._best_plans(turned, 0.0, objective, rng)
        if not plans or turn_cost + self._full_cost(plans[0]) >= cost_at_once:
            return ()
        terms = plans[0].outcomes.terms[plans[0].taken].copy()
        terms[CHANCE] = 0.0
        terms[TIME] += turn_ticks
        terms[RARITY] += turn_ticks * world.rarest_step_cost
        return tuple((terms / world.motion.rate_hz).tolist())

    def _stay(
        self, fish: Fish, along_px: float, objective: Objective, task: Route | Target,
        plans: list[Plan], turn_first_terms: tuple[float, ...] = (),
    ) -> Stretch:  # fmt: skip
        """Return the stretch of a fish that stays in place.

        A goal on which it rests counts as touched. along_px: how far the fish is along the path;
        plans: the best first: the stretch says what the best one compared, and that nothing of it
        was taken; turn_first_terms: the cost of turning first, by term, if the fish stays to turn.
        """
        stretch = self._fallback.stay(fish, self._point_ahead(objective, along_px))
        target = task if isinstance(task, Target) else ANYWHERE
        if not target.free and touches_target(*stretch.trajectory[0], target):
            stretch = replace(stretch.cut(1), touches_goal=True)
        if not plans:
            return stretch
        verdicts = replace(plans[0].verdicts(self.world.motion.rate_hz), taken=-1)
        decision = verdicts.add_to_decision(stretch.decision)
        if turn_first_terms:
            decision = decision._replace(
                value_s=sum(turn_first_terms), taken_terms=turn_first_terms
            )
        return replace(stretch, options=verdicts, decision=decision)

    def _best_plans(
        self, fish: Fish, along_px: float, objective: Objective, rng: np.random.Generator
    ) -> list[Plan]:
        """Return the plans to try, the best first: one by the film, one by the forecast, or both.

        The forecast is asked only where no branch of the film leads on, or all cost more than
        leaving the path. along_px: how far the fish is along the path. [] if no row can be shown.
        """
        filmed = self._best_plan(self.film, fish, along_px, objective, rng)
        if filmed is not None and not self._needs_prediction(filmed, fish, objective):
            return [filmed]
        predicted = self._best_plan(self.prediction, fish, along_px, objective, rng)
        plans = [plan for plan in (filmed, predicted) if plan is not None]
        # Of equal costs, infinite ones too, the longest plan is first.
        return sorted(plans, key=lambda plan: (self._full_cost(plan), -plan.outcomes.ticks.max()))

    def _full_cost(self, plan: Plan) -> float:
        """Return the cost of a plan, in ticks; a predicted one also pays for leaving the film.

        Leaving the film costs as much as a discontinuity of one natural step.
        """
        return plan.cost + self._weights.seam * (plan.state != FILM)

    def _needs_prediction(self, plan: Plan, fish: Fish, objective: Objective) -> bool:
        """Return whether a plan by the film leads nowhere, or costs more than leaving the path.

        Leaving the path means swimming `path_max_offset_bl` beside it, as far behind on a path with
        times, and without progress on one without.
        """
        route, p = objective.route, self.world.settings
        if not len(route.x):
            return not np.isfinite(plan.cost)
        square_offset = p.path_max_offset_bl**2
        tick_cost = p.path_offset_cost * square_offset
        if route.is_timed:
            tick_cost += p.path_late_cost * square_offset
        else:
            tick_cost += self._cost_of_rest(fish, objective)
        return plan.cost > tick_cost * float(sum(plan.ticks))

    def _best_plan(
        self, source: MotionSource | None, fish: Fish, along_px: float, objective: Objective,
        rng: np.random.Generator,
    ) -> Plan | None:  # fmt: skip
        """Return the cheapest plan of a fish by one motion source; None where it has no candidates.

        along_px: px along the path.
        """
        if source is None:
            return None
        found = source.candidates(fish, self._cost_of_rest(fish, objective), along_px)
        if found is None:
            return None
        candidates, start = found
        if not len(objective.route.x):
            noise_ticks = self.world.settings.choice_noise * self.world.motion.delta
            candidates.terms[:, CHANCE] = rng.exponential(noise_ticks, len(candidates.rows))
        return self._search_plan(source, candidates, start, objective)

    def _search_plan(
        self, source: MotionSource, candidates: Candidates, start: SearchStart,
        objective: Objective,
    ) -> Plan | None:  # fmt: skip
        """Return the cheapest plan from the candidates of a search; None where no row can be shown.

        source: the motion source of the candidates. The beam is narrow for a fish that wanders or
        has others near it. For one that wanders alone, the search is repeated with the whole beam
        where none of the branches leads on, which are much alike and may all run into one wall.
        """
        weights = self._weights
        if start.obstacles.near_count:
            weights = self._narrow_weights
        elif objective.aim.free and not len(objective.route.x):
            weights = self._narrow_weights._replace(retry_beam=self._weights.beam)
        horizon = self._ticks_between_searches(objective) + self._look_ahead_ticks
        outcomes, rows = beam_search(source.graph, candidates, start, objective, weights, horizon)
        if not len(rows):
            return None
        first_rows, ticks = rows.tolist(), source.graph.nodes["leg"][rows].tolist()
        taken = candidates.rows.tolist().index(first_rows[0])
        ticks[-1] -= max(sum(ticks) - horizon, 0)  # the last leg ends at the horizon
        return Plan(source.state, candidates, outcomes, taken, first_rows, ticks)

    def _swim_next_run(
        self, fish: Fish, before: Progress, objective: Objective, plan: Plan | None
    ) -> tuple[Stretch, Progress]:
        """Swim the next run of a plan; return the stretch, and the progress with the later runs.

        The stretch has no tick where the run leaves the tank at once. The later runs are dropped
        where this one ends early. before: progress and planned runs; plan: result of the search
        that chose the run, None if an earlier search chose it.
        """
        run, *later_runs = before.runs
        source = self.film if before.motion == FILM else self.prediction
        assert source is not None
        target = before.task if isinstance(before.task, Target) else ANYWHERE
        passage = source.swim_run(fish, run, before.along, objective, target)
        on_path, trajectory = len(objective.route.x) > 0, passage.trajectory
        verdicts = None if plan is None else plan.verdicts(self.world.motion.rate_hz)
        stretch = Stretch(
            source.state, trajectory, passage.rows, begins_with_transition=passage.jumps,
            aim=self._point_ahead(objective, passage.along_px),
            touches_goal=passage.touches_target,
            decision=_explain_run(fish, source.state, passage, on_path, verdicts), kind=FRAME,
            rotation_deg=drawn_rotations(self.world.film.rows, passage.rows, trajectory),
            past=passage.past, steer=passage.corrections if on_path else None, options=verdicts,
        )  # fmt: skip
        is_whole = len(trajectory) == run.ticks and not passage.touches_target
        later = tuple(later_runs) if is_whole else ()
        return stretch, before._replace(along=passage.along_px, runs=later)

    def _point_ahead(self, objective: Objective, along_px: float) -> Target:
        """Return the point that a fish heads for: its target, or a body length ahead on its path.

        along_px: px along the path.
        """
        if not len(objective.route.x):
            return objective.aim
        ahead_px = along_px + self.world.motion.body_length_px
        x, y = map(float, point_along(objective.route, ahead_px))
        return Target(x, y, self.world.touch_px, self.world.head_px)

    def _cost_of_rest(self, fish: Fish, objective: Objective) -> float:
        """Return what every tick on the spot costs a fish, in ticks; < 0 only where it wanders."""
        tempo, p = self.world.tempo, self.world.settings
        if len(objective.route.x):
            return tempo.cost_of_rest_on_path(fish.lag, p.path_rest_cost)
        cost = tempo.cost_of_rest(fish.lag, p.rest_cost)
        return cost if objective.aim.free else max(cost, 0.0)

    # --- what plans are made of

    @property
    def _weights(self) -> CostWeights:
        """Return the settings of the search and the weights of its costs."""
        return self.world.cost_weights

    @cached_property
    def _narrow_weights(self) -> CostWeights:
        """Return the settings of a narrower search, for a fish that wanders or has others near."""
        return self._weights._replace(beam=1 + self._weights.beam // _FEWER)

    def _ticks_between_searches(self, objective: Objective) -> int:
        """Return how many ticks of a plan the fish swims before the next search."""
        return self._commit_ticks[len(objective.route.x) > 0]

    @cached_property
    def _commit_ticks(self) -> tuple[int, int]:
        """Return for how many ticks a fish swims by a plan: two numbers, without and with a path.

        Then the next search comes. They are a whole number of strides.
        """
        p, stride = self.world.settings, self._weights.stride
        off_path, on_path = (
            stride * max(1, self.world.to_ticks(time_deltas) // stride)
            for time_deltas in (p.replan_interval_deltas, p.path_commit)
        )
        return off_path, on_path

    @cached_property
    def _look_ahead_ticks(self) -> int:
        """Return how many ticks a search looks ahead beyond those that the fish swims by it."""
        return self.world.to_ticks(self.world.settings.look_ahead_deltas)

    @cached_property
    def _fallback(self) -> Fallback:
        """Return the fallback, which moves a fish whose plan leads nowhere or is blocked."""
        return Fallback(self.world)

    def _fish_in_film(self, fish: Fish) -> Fish:
        """Return a fish that a sprite shows as a fish in the film, at the sprite's film row."""
        row = int(self.sprite_rows[fish.sprite])
        rotation_deg = float(wrap(fish.heading - self.world.film.heading[row]))
        return fish._replace(state=FILM, sprite=-1, row=row, rotation_deg=rotation_deg)

    def _fish_after(self, fish: Fish, stretch: Stretch) -> Fish:
        """Return the fish as it is at the end of a stretch that began with `fish`."""
        world, ticks, last_row = self.world, len(stretch.trajectory), int(stretch.number[-1])
        film_row = world.film.rows[last_row]
        x, y, heading = map(float, stretch.trajectory[-1])
        stays = stretch.decision.reason in (SPOT, WAITING)
        forget_tick = fish.tick - world.settings.repeat_memory * world.motion.delta
        recent = remember_rows(
            fish.recent, int(stretch.number[0]), last_row, fish.tick, forget_tick
        )
        past = stretch.past  # states of the forecast, the oldest first; in `Fish` the newest first
        assert stretch.rotation_deg is not None
        return Fish(
            x, y, float(wrap(heading)), speed=0.0 if stays else float(film_row["speed"]),
            state=stretch.state, sprite=-1, phase=fish.phase, area=float(film_row["area"]),
            tick=fish.tick + ticks, row=last_row, rotation_deg=float(stretch.rotation_deg[-1]),
            recent=recent, past=None if past is None else np.ascontiguousarray(past[ticks:][::-1]),
            lag=world.tempo.lag_after(fish.lag, stretch.trajectory, (fish.x, fish.y)),
        )  # fmt: skip

    # --- questions about stretches and pictures

    def is_clear(self, state: State, stretch: Stretch) -> bool:
        """Return whether a fish that swims a whole stretch, then stays, meets no other fish."""
        return self._fallback.count_free_ticks(state.fish, stretch) == len(stretch.trajectory)

    def cut(self, state: State, stretch: Stretch, ticks: int) -> tuple[Stretch, State]:
        """Cut a stretch that began in `state` after some ticks; return it and the state then."""
        short = stretch.cut(ticks)
        # The next call searches on from the old place along the path for the new one.
        progress = Progress(state.progress.along)
        return short, state._replace(fish=self._fish_after(state.fish, short), progress=progress)


def _explain_run(
    fish: Fish, state: int, passage: Passage, on_path: bool, verdicts: CandidateVerdicts | None
) -> Decision:
    """Return why a fish swims along a run: the film plays on or jumps, or the run is predicted.

    fish: before the run; state: of the run, FILM or FORECAST; verdicts: of the search that chose
    the run, None if an earlier search chose it. The decision's quadrant, towards which the fish
    swims, is 0 on a path; its exit is NO_WAY where the search had to leave the film.
    """
    reason = AS_PREDICTED if state != FILM else JUMP if passage.jumps else PLAY
    quadrant = 0
    if len(passage.trajectory) and not on_path:
        x, y, _heading = passage.trajectory[-1].tolist()
        quadrant = quadrant_of_displacement(x - fish.x, fish.y - y)
    decision = Decision(reason, seam=passage.seam, quadrant=quadrant)
    if verdicts is None:
        return decision
    leaves_film = state != FILM and fish.state == FILM
    return verdicts.add_to_decision(decision, NO_WAY if leaves_film else "")


def _is_same_task(task: object, other_task: object) -> bool:
    """Return whether two tasks are equal: the same path, or the same place to go to."""
    places = isinstance(task, Target) and isinstance(other_task, Target)
    return task is other_task or (places and task == other_task)
