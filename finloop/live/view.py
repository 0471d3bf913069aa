"""What pages show of the live tank: the fish, and the texts and marks beside them."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from finloop.animate.kinematics import rotate
from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.edit.bodies import Bodies
from finloop.edit.modes import MODES
from finloop.edit.schema import VERDICTS
from finloop.edit.stretch import describe_decision
from finloop.live import message
from finloop.live.fish import DecisionRecord, LiveFish, PathTask, RuleTask
from finloop.live.tank import LiveTank
from finloop.plan.graph import MotionGraph
from finloop.plan.plan import CandidateVerdicts
from finloop.plan.planner import Planner
from finloop.show.drawn import FILM_LOOK, PICTURE, States, drawn_states
from finloop.show.feed import Feed, TankCanvas
from finloop.show.page import pack_message
from finloop.show.pictures import PagePictures

_TRAIL_S, _TRAIL_EVERY = 2.0, 2  # duration of the trail behind a fish; ticks between its points
_PATH_S, _PATH_EVERY = 1.5, 2  # duration of a candidate's path; ticks between its points
_MOST_CANDIDATES = 40  # shown of a decision
_MOST_PLACES = 100  # places shown of a path


def make_tank_feed(pictures: PagePictures, floor: Picture, rate_hz: float, bodies: Bodies) -> Feed:
    """Return what makes the messages about the fish of a live tank.

    floor: the empty tank, (h, w) or (h, w, 3) uint8. rate_hz: ticks a second. bodies: of the film.
    """
    height, width = pictures.largest_px
    facts = {
        "rate": rate_hz, "fish": message.MOST_FISH, "looks": [FILM_LOOK],
        "posture": bodies.poses.pose.posture.shape[1],
    }  # fmt: skip
    return Feed(TankCanvas(floor, width, height), facts, pictures)


@dataclass
class TankView:
    """The live tank as a page shows it; it carries out the page's requests.

    feed: makes the messages about the fish; bodies: their filmed postures. speed: playback rate
    relative to the film; past_tick: shown instead of the present one; plays_past: whether it goes
    on to the present; explained: number of the fish whose decisions are shown; refused: why the
    last request was refused, "" if it was not; bad_messages, goals_reached: how many there were.
    """

    tank: LiveTank
    feed: Feed
    bodies: Bodies
    paused: bool = False
    speed: float = 1.0
    past_tick: int | None = None
    plays_past: bool = False
    explained: int = 0
    refused: str = ""
    bad_messages: int = 0
    goals_reached: int = 0
    _seq: int = 0  # number of the last message about the fish
    _was_running: bool = False  # at that message
    _facts: dict[str, bytes] = field(default_factory=dict)  # the last messages of other kinds
    _events: tuple[DecisionRecord | None, list[tuple[int, str]]] = (None, [])  # until that decision
    _described: tuple[DecisionRecord, dict[str, Any]] | None = None  # the last decision

    @property
    def shown_tick(self) -> int:
        """Return the tick on screen: the present one, or a past one that the page shows."""
        if self.past_tick is None:
            return self.tank.tick
        return min(max(self.past_tick, self.tank.oldest_tick), self.tank.tick)

    @property
    def is_running(self) -> bool:
        """Return whether ticks pass, those of the tank or of the past that is shown."""
        return not self.paused if self.past_tick is None else self.plays_past

    def handle_request(self, request: message.PageRequest) -> None:
        """Carry out a page's request; if that is impossible, store the reason in `refused`."""
        try:
            self._carry_out(request)
            self.refused = ""
        except FinloopError as error:
            self.refused = f"{error.came}: {error.do}"

    def _carry_out(self, request: message.PageRequest) -> None:
        """Carry out a page's request; FinloopError if that is impossible."""
        tank = self.tank
        match request:
            case message.SetGoal():
                self.past_tick = None
                tank.send_to_goal(request.fish, request.x, request.y, request.drag)
            case message.SetPath():
                self.past_tick = None
                tank.follow_path(request.fish, request.places)
            case message.SetRule():
                self.past_tick = None
                if request.leader is None:
                    tank.swim_in_group(request.fish)
                else:
                    tank.follow_leader(request.fish, request.leader)
            case message.SetZoneWeights():
                tank.set_zone_weights((request.repulsion, request.alignment, request.attraction))
            case message.LetWander():
                tank.let_wander(request.fish)
            case message.SetMode():
                tank.switch_mode(request.mode)
            case message.SetPaused() if self.past_tick is None:
                self.paused = request.on
            case message.SetPaused():
                self.plays_past = not request.on
            case message.AdvanceTick():
                self.paused, self.past_tick = True, None
                self.advance()
            case message.SetPlaybackRate():
                self.speed = request.times
            case message.ShowPastTick():
                self.past_tick, self.plays_past = request.tick, False
            case message.BranchFromPast() | message.ReturnToFuture():
                if isinstance(request, message.BranchFromPast):
                    tank.branch_from(request.tick)
                else:
                    tank.return_to(request.future)
                self.explained = min(self.explained, len(tank.fish) - 1)
                self.paused, self.past_tick = False, None
                self._was_running = False  # the fish are elsewhere at once
            case message.ExplainFish():
                self.explained = min(request.fish, len(tank.fish) - 1)
            case message.SetFishCount():
                tank.set_fish_count(request.fish)
                self.explained = min(self.explained, request.fish - 1)

    def advance(self, ticks: int = 1) -> None:
        """Advance the tank by some ticks, and count the goals that fish reach.

        A past tick that is shown advances instead, until the present one is.
        """
        if self.past_tick is not None:
            self.past_tick = self.shown_tick + ticks
            if self.past_tick >= self.tank.tick:
                self.past_tick, self.plays_past = None, False
            return
        for _ in range(ticks):
            travelling = [fish for fish in self.tank.fish if not fish.reached]
            self.tank.advance()
            self.goals_reached += sum(fish.reached for fish in travelling)

    def opening_messages(self) -> list[bytes]:
        """Return all messages that a new page needs before those of the next tick."""
        return [*self.feed.opening_messages(), *self._facts.values()]

    def frame_messages(self, due_s: float = 0.0, took_ms: float = 0.0) -> list[bytes]:
        """Return the messages that show the tick on screen; of the texts, only those that changed.

        due_s: server's time at which it is shown. While nothing runs, and for the first tick after
        that, it is shown at once. took_ms: how long it took to make the tick before.
        """
        tick, self._seq = self.shown_tick, self._seq + 1
        jump = not (self.is_running and self._was_running)
        self._was_running = self.is_running
        messages = self.feed.tick_messages(self._seq, tick, due_s, self._states(tick), jump=jump)
        facts = self.describe_tick(tick, took_ms)
        parts = {name: facts.pop(name) for name in ("modes", "decision", "events")} | {
            "tank": facts
        }
        for kind, part in parts.items():
            content = pack_message({"kind": kind, kind: part})
            if content != self._facts.get(kind):
                self._facts[kind] = content
                messages.append(content)
        return messages

    def _states(self, tick: int) -> States:
        """Return the states (fish, fields) of all fish at a tick; without picture if not there."""
        rows = [fish.row_at(tick) for fish in self.tank.fish]
        drawn = drawn_states([row for row in rows if row is not None], self.bodies)
        states = np.zeros((len(rows), drawn.shape[1]), np.float32)
        states[:, PICTURE] = -1
        states[[row is not None for row in rows]] = drawn
        return states

    def describe_tick(self, tick: int, took_ms: float = 0.0) -> dict[str, Any]:
        """Return all that the page shows of a tick besides the fish, as values for JSON.

        The keys are those that `play.js` reads. took_ms: how long the tick before took.
        """
        tank, rate = self.tank, self.tank.world.motion.rate_hz
        explained = tank.fish[self.explained : self.explained + 1]  # [] if there is no such fish
        decision = explained[0].decision_at(tick) if explained else None
        return {
            "tick": tick, "now": tank.tick, "oldest": tank.oldest_tick, "rate": round(rate, 3),
            "paused": self.paused, "past": self.past_tick is not None, "runs": self.is_running,
            "futures": [[future.since, future.tick] for future in tank.futures],
            "speed": self.speed,
            "mode": tank.mode, "modes": self._describe_modes(),
            "most": tank.most_fish or message.MOST_FISH, "touch": round(tank.world.touch_px, 1),
            "fish": [self._describe_fish(fish, tick) for fish in tank.fish],
            "explained": self.explained, "refused": self.refused,
            "weights": tank.school_rule.zones.weights if tank.school_rule else None,
            "widths": tank.school_rule.zones.widths if tank.school_rule else None,
            "decision": self._describe_decision(decision) if decision else None,
            "events": self._list_events(explained[0]) if explained else [],
            "bad": self.bad_messages, "reached": self.goals_reached, "ms": round(took_ms, 1),
        }  # fmt: skip

    def _list_events(self, fish: LiveFish) -> list[tuple[int, str]]:
        """Return what happened in the past of a fish; it changes with its last decision alone."""
        last = fish.decision_at(fish.last_tick)
        if last is None or self._events[0] is not last:
            self._events = last, fish.events()
        return self._events[1]

    def _describe_modes(self) -> list[dict[str, str]]:
        """Return name, title, text and colour of every mode, and why it is not available now."""
        return [
            {
                "name": mode, "title": facts.title, "says": f"{facts.sentence} ({facts.source})",
                "colour": facts.colour, "lack": self.tank.explain_unavailable_mode(mode),
            }
            for mode, facts in MODES.items()
        ]  # fmt: skip

    def _describe_fish(self, fish: LiveFish, tick: int) -> dict[str, Any] | None:
        """Return what the page shows of a fish at a tick; None if it was not in the tank."""
        row = fish.row_at(tick)
        if row is None:
            return None
        if tick == self.tank.tick:  # a new request counts from the next tick on
            x, y = (fish.goal.x_px, fish.goal.y_px) if fish.goal else (math.nan, math.nan)
            reached, path_task, rule_task = fish.reached, fish.path_task, fish.rule_task
        else:
            x, y, reached = row.goal_x_px, row.goal_y_px, row.reached
            _, path_task, rule_task, _ = fish.request_at(tick)
        trail = range(tick - round(_TRAIL_S * self.tank.world.motion.rate_hz), tick, _TRAIL_EVERY)
        return {
            "x": round(row.x_px, 1), "y": round(row.y_px, 1),
            "heading": round(row.heading_deg, 1), "speed": round(row.speed, 2),
            "mode": row.mode, "state": row.state,
            "goal": None if math.isnan(x) else [round(x, 1), round(y, 1), reached],
            "path": _describe_path(path_task), "rule": self._leader_index(rule_task),
            "done": reached, "trail": np.rint(fish.past_places(trail)).astype(int).tolist(),
        }  # fmt: skip

    def _leader_index(self, rule_task: RuleTask | None) -> int | None:
        """Return the index of the fish that a rule names as leader; −1: the rule is for a group.

        None without a rule, or if the leader has left the tank.
        """
        if rule_task is None:
            return None
        if rule_task.leader is None:
            return -1
        names = [fish.name for fish in self.tank.fish]
        return names.index(rule_task.leader) if rule_task.leader in names else None

    def _describe_decision(self, decision: DecisionRecord) -> dict[str, Any]:
        """Return what the page shows of a decision of the explained fish, as values for JSON.

        candidates: film rows that could be shown next, of the decision that made the plan; more:
        how many are left out; aim: where the fish heads, x, y [px].
        """
        if self._described is not None and self._described[0] is decision:
            return self._described[1]
        plan = self.tank.fish[self.explained].planning_decision(decision)
        fish, stretch, options = plan.state.fish, decision.stretch, plan.stretch.options
        ranked = [] if options is None else _rank_candidates(options)
        facts = {
            "tick": decision.tick, "mode": decision.mode,
            "why": describe_decision(stretch.decision, decision.target_name, stretch.area),
            "x": round(fish.x, 1), "y": round(fish.y, 1),
            "aim": [round(coordinate, 1) for coordinate in stretch.aim[:2]],
            "planned": plan.tick,
            "more": max(0, len(ranked) - _MOST_CANDIDATES),
            "candidates": [self._describe_candidate(plan, k) for k in ranked[:_MOST_CANDIDATES]],
        }  # fmt: skip
        self._described = decision, facts
        return facts

    def _describe_candidate(self, plan: DecisionRecord, number: int) -> dict[str, Any]:
        """Return what the page shows of a candidate, a film row that could be shown next.

        number: its row in the plan's table. terms, value: the parts of its cost, and the cost, None
        if it cannot be shown; path: places [px] that the fish would reach.
        """
        fish, options, player = plan.state.fish, plan.stretch.options, self.tank.players[plan.mode]
        assert options is not None and isinstance(player, Planner)
        row, cost = int(options.rows[number]), float(options.costs[number])
        impossible, film = not math.isfinite(cost), player.world.film
        turn_deg = float(options.rotations_deg[number])
        path = self._path_along_film(film, (fish.x, fish.y), row, turn_deg)
        return {
            # The mirror image of a row has the row's number plus `filmed_count`.
            "row": row % film.filmed_count, "seam": round(float(options.seams[number]), 2),
            "terms": [
                None if impossible else round(float(term), 2) for term in options.terms[number]
            ],
            "value": None if impossible else round(cost, 2),
            "fails": VERDICTS[options.verdict[number]],
            "taken": number == options.taken, "path": path,
        }  # fmt: skip

    def _path_along_film(
        self, film: MotionGraph, start: tuple[float, float], row: int, turn_deg: float
    ) -> list[list[int]]:
        """Return the path (n, 2) [px] of a fish that plays the film on from a row.

        It ends after 1.5 s, or where the film shows no next frame; every second place is listed.
        turn_deg: by how much the film's motion is turned anticlockwise.
        """
        end = row + round(_PATH_S * self.tank.world.motion.rate_hz)
        stops = row + np.flatnonzero(~film.has_next[row:end])  # rows without a next frame
        end = int(stops[0]) if stops.size else min(end, len(film.has_next) - 1)
        cos, minus_sin = rotate(1.0, 0.0, turn_deg)  # y down
        dx, dy = film.dx[row:end], film.dy[row:end]
        steps = np.column_stack([dx * cos - dy * minus_sin, dx * minus_sin + dy * cos])
        path = np.cumsum(np.vstack([start, steps]), axis=0)[::_PATH_EVERY]
        return np.rint(path).astype(int).tolist()


def _describe_path(path_task: PathTask | None) -> dict[str, Any] | None:
    """Return what the page shows of a path that a fish follows; None without a path.

    places: about 100 of its places, x, y [px], the last included; closed, begun: whether the path
    is closed, and whether the fish has reached its beginning.
    """
    if path_task is None:
        return None
    route = path_task.route
    step = -(-len(route.x) // _MOST_PLACES)  # rounded up
    places = np.rint(np.column_stack([route.x, route.y])).astype(int)
    shown = [*places[:-1:step].tolist(), places[-1].tolist()]
    return {"places": shown, "closed": route.closed, "begun": path_task.begun}


def _rank_candidates(options: CandidateVerdicts) -> list[int]:
    """Return the candidates' numbers: the taken one, then valid, then refused ones; by cost."""

    def rank(number: int) -> tuple[bool, bool, float]:
        """Return the sort key of a candidate; False comes before True."""
        is_refused = options.verdict[number] > 0  # an index in VERDICTS; 0: valid
        return number != options.taken, is_refused, options.costs[number]

    return sorted(range(len(options.rows)), key=rank)
