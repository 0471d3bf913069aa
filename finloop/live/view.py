"""The frames of the live tank for the page: a picture, and the texts and marks over it."""

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from finloop.animate.kinematics import rotate
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.edit.schema import VERDICTS
from finloop.edit.stretch import describe_decision
from finloop.live import message
from finloop.live.fish import DecisionRecord, LiveFish, PathTask, RuleTask
from finloop.live.page import pack_message
from finloop.live.tank import LiveTank
from finloop.plan.graph import MotionGraph
from finloop.plan.plan import CandidateVerdicts
from finloop.plan.planner import Planner
from finloop.render.gallery import Gallery
from finloop.render.painter import Painter

_TRAIL_S, _TRAIL_EVERY = 2.0, 2  # duration of the trail behind a fish; ticks between its points
_WAY_S, _WAY_EVERY = 1.5, 2  # the same of a way that was weighed
_MOST_WAYS = 40  # ways shown of a decision
_MOST_PLACES = 100  # places shown of a path
_QUALITY = 82  # JPEG


@dataclass
class View:
    """The live tank as it is shown; it carries out the page's requests.

    speed: playback rate relative to the film; past_tick: shown instead of the present one;
    explained: number of the fish whose decisions are shown; frame: number of the last frame;
    refused: why the last request was refused, "" if it was not; bad_messages, dropped_frames,
    goals_reached: how many there were; frames are dropped for a slow page.
    """

    tank: LiveTank
    painter: Painter
    gallery: Gallery
    paused: bool = False
    speed: float = 1.0
    past_tick: int | None = None
    explained: int = 0
    frame: int = 0
    refused: str = ""
    bad_messages: int = 0
    dropped_frames: int = 0
    goals_reached: int = 0

    @property
    def tick(self) -> int:
        """Return the tick on screen: the present one, or a past one that the page looks at."""
        if self.past_tick is None:
            return self.tank.tick
        return min(max(self.past_tick, self.tank.oldest), self.tank.tick)

    @property
    def runs(self) -> bool:
        """Return whether time passes in the tank: not while it is paused or shows a past tick."""
        return not self.paused and self.past_tick is None

    def grant(self, request: message.PageRequest) -> None:
        """Carry out a page's request; where it is impossible, note why in `refused`."""
        try:
            self._grant(request)
            self.refused = ""
        except FinloopError as error:
            self.refused = f"{error.came}: {error.do}"

    def _grant(self, request: message.PageRequest) -> None:
        tank = self.tank
        match request:
            case message.SetGoal():
                self.past_tick = None
                tank.send(request.fish, request.x, request.y, request.drag)
            case message.SetPath():
                self.past_tick = None
                tank.follow(request.fish, request.places)
            case message.SetRule():
                self.past_tick = None
                if request.leader is None:
                    tank.shoal(request.fish)
                else:
                    tank.lead(request.fish, request.leader)
            case message.Weights():
                tank.set_zone_weights((request.repulsion, request.alignment, request.attraction))
            case message.Drop():
                tank.drop(request.fish)
            case message.SetMode():
                tank.switch(request.mode)
            case message.Pause():
                self.paused, self.past_tick = request.on, None
            case message.Step():
                self.paused, self.past_tick = True, None
                self.advance()
            case message.Speed():
                self.speed = request.times
            case message.PastTick():
                self.past_tick = request.tick
            case message.SwimOn():
                tank.back_to(request.tick)
                self.explained = min(self.explained, len(tank.fish) - 1)
                self.paused, self.past_tick = False, None
            case message.Explain():
                self.explained = min(request.fish, len(tank.fish) - 1)
            case message.Count():
                tank.set_fish_count(request.fish)
                self.explained = min(self.explained, request.fish - 1)

    def advance(self, ticks: int = 1) -> None:
        """Advance the tank by some ticks, and count the goals reached."""
        for _ in range(ticks):
            on_the_way = [fish for fish in self.tank.fish if not fish.reached]
            self.tank.advance()
            self.goals_reached += sum(fish.reached for fish in on_the_way)

    def show(self, took_ms: float = 0.0) -> bytes:
        """Return the next frame (`pack_message`): the state, and a JPEG of the tank.

        took_ms: milliseconds that the frame before took.
        """
        self.frame += 1
        tick, painter = self.tick, self.painter
        rows = [row for fish in self.tank.fish if (row := fish.row_at(tick)) is not None]
        painter.show(*map(self.gallery.place_row, rows))
        picture = painter.frame
        if picture.ndim == 3:
            picture = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
        jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        return pack_message(self.state(tick, took_ms), jpeg)

    def state(self, tick: int, took_ms: float = 0.0) -> dict[str, Any]:
        """Return all that the page shows of a tick besides the picture, ready for JSON."""
        tank, rate = self.tank, self.tank.world.motion.rate_hz
        height, width = self.painter.canvas.shape[:2]
        explained = tank.fish[self.explained : self.explained + 1]
        decision = explained[0].decision_at(tick) if explained else None
        return {
            "frame": self.frame, "tick": tick, "now": tank.tick, "oldest": tank.oldest,
            "rate": round(rate, 3), "width": width, "height": height,
            "paused": self.paused, "past": self.past_tick is not None, "speed": self.speed,
            "mode": tank.mode, "modes": self._describe_modes(),
            "most": tank.most_fish or message.MOST_FISH, "touch": round(tank.world.touch_px, 1),
            "fish": [self._describe_fish(fish, tick) for fish in tank.fish],
            "explained": self.explained, "refused": self.refused,
            "weights": tank.shoaling.zones.weights if tank.shoaling else None,
            "widths": tank.shoaling.zones.widths if tank.shoaling else None,
            "decision": self._describe_decision(decision) if decision else None,
            "bad": self.bad_messages, "dropped": self.dropped_frames,
            "reached": self.goals_reached, "ms": round(took_ms, 1),
        }  # fmt: skip

    def _describe_modes(self) -> list[dict[str, str]]:
        """Return every mode for the page. lack: why it is not available now, if so."""
        return [
            {
                "name": mode, "title": facts.title, "says": f"{facts.sentence} ({facts.source})",
                "colour": facts.colour, "lack": self.tank.describe_lack(mode),
            }
            for mode, facts in MODES.items()
        ]  # fmt: skip

    def _describe_fish(self, fish: LiveFish, tick: int) -> dict[str, Any] | None:
        """Return what the page shows of a fish at a tick; None where it was not there."""
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
            "path": _describe_path(path_task), "rule": self._leader_number(rule_task),
            "done": reached, "trail": np.rint(fish.past_places(trail)).astype(int).tolist(),
        }  # fmt: skip

    def _leader_number(self, rule_task: RuleTask | None) -> int | None:
        """Return the number of the leader of a rule, −1 for the group; None without a rule."""
        if rule_task is None or rule_task.leader is None:
            return None if rule_task is None else -1
        names = [fish.name for fish in self.tank.fish]
        return names.index(rule_task.leader) if rule_task.leader in names else None

    def _describe_decision(self, decision: DecisionRecord) -> dict[str, Any]:
        """Return a decision, with the candidates that were weighed when its plan was made."""
        plan = self.tank.fish[self.explained].planning_decision(decision)
        fish, stretch, options = plan.state.fish, decision.stretch, plan.stretch.options
        ranked = [] if options is None else _rank_candidates(options)
        return {
            "tick": decision.tick, "mode": decision.mode,
            "why": describe_decision(stretch.decision, decision.name, stretch.area),
            "x": round(fish.x, 1), "y": round(fish.y, 1),
            "aim": [round(part, 1) for part in stretch.aim[:2]],
            "planned": plan.tick,
            "more": max(0, len(ranked) - _MOST_WAYS),
            "ways": [self._describe_candidate(plan, number) for number in ranked[:_MOST_WAYS]],
        }  # fmt: skip

    def _describe_candidate(self, plan: DecisionRecord, number: int) -> dict[str, Any]:
        fish, options, player = plan.state.fish, plan.stretch.options, self.tank.players[plan.mode]
        assert options is not None and isinstance(player, Planner)
        row, cost = int(options.rows[number]), float(options.value[number])
        ends, film = not math.isfinite(cost), player.world.film
        return {
            "row": row % film.filmed, "seam": round(float(options.seams[number]), 2),
            "terms": [None if ends else round(float(term), 2) for term in options.terms[number]],
            "value": None if ends else round(cost, 2), "fails": VERDICTS[options.verdict[number]],
            "taken": number == options.taken,
            "path": self._path(film, (fish.x, fish.y), row, float(options.rots[number])),
        }  # fmt: skip

    def _path(
        self, film: MotionGraph, start: tuple[float, float], row: int, rot: float
    ) -> list[list[int]]:
        """Return the places that a fish would come to along a row of the film, turned by `rot`."""
        last = row + round(_WAY_S * self.tank.world.motion.rate_hz)
        stops = np.flatnonzero(~film.has_next[row:last])
        last = row + int(stops[0]) if stops.size else min(last, len(film.has_next) - 1)
        cos, sin = rotate(1.0, 0.0, rot)
        dx, dy = film.dx[row:last], film.dy[row:last]
        steps = np.column_stack([dx * cos - dy * sin, dx * sin + dy * cos])
        way = np.cumsum(np.vstack([start, steps]), axis=0)[::_WAY_EVERY]
        return np.rint(way).astype(int).tolist()


def _describe_path(path_task: PathTask | None) -> dict[str, Any] | None:
    """Return a path, and whether the fish has come to its beginning."""
    if path_task is None:
        return None
    route = path_task.route
    every = -(-len(route.x) // _MOST_PLACES)
    places = np.rint(np.column_stack([route.x, route.y])).astype(int)
    shown = [*places[:-1:every].tolist(), places[-1].tolist()]
    return {"places": shown, "closed": route.closed, "begun": path_task.begun}


def _rank_candidates(options: CandidateVerdicts) -> list[int]:
    """Rank the candidates: the chosen one, then those that fail no test, cheapest first."""
    return sorted(
        range(len(options.rows)),
        key=lambda one: (one != options.taken, options.verdict[one] > 0, options.value[one]),
    )
