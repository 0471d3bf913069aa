"""The frames of the live tank for the page: a picture, and the texts and marks over it.

A frame is 4 bytes, the length of a JSON text, little end first; the text; a JPEG of the tank.
"""

import json
import math
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from finloop.animate.kinematics import rotate
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES
from finloop.edit.schema import VERDICTS
from finloop.edit.stretch import describe_decision
from finloop.live import message
from finloop.live.choice import DecisionRecord, PathTask, RuleTask
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
class EventCounts:
    """Counts of bad messages, of frames that a slow page did not get, and of goals reached."""

    bad: int = 0
    dropped: int = 0
    reached: int = 0


@dataclass
class View:
    """The live tank as it is shown; it carries out the page's requests.

    speed: playback rate relative to the film; looked: a past tick that is shown instead of the
    present one; explained: number of the fish whose decisions are shown; frame: number of the last
    frame; refused: why the last request was refused, "" if it was not.
    """

    tank: LiveTank
    painter: Painter
    gallery: Gallery
    paused: bool = False
    speed: float = 1.0
    looked: int | None = None
    explained: int = 0
    frame: int = 0
    refused: str = ""
    counts: EventCounts = field(default_factory=EventCounts)

    @property
    def tick(self) -> int:
        """Return the tick on screen: the present one, or a past one that the page looks at."""
        if self.looked is None:
            return self.tank.tick
        return min(max(self.looked, self.tank.oldest), self.tank.tick)

    @property
    def runs(self) -> bool:
        """Return whether time passes in the tank: not while it is paused or shows a past tick."""
        return not self.paused and self.looked is None

    def grant(self, wish: message.Wish) -> None:
        """Carry out a page's request; where it is impossible, note why in `refused`."""
        try:
            self._grant(wish)
            self.refused = ""
        except FinloopError as error:
            self.refused = f"{error.came}: {error.do}"

    def _grant(self, wish: message.Wish) -> None:
        tank = self.tank
        match wish:
            case message.SetGoal():
                self.looked = None
                tank.send(wish.fish, wish.x, wish.y, wish.drag)
            case message.SetPath():
                self.looked = None
                tank.follow(wish.fish, wish.places)
            case message.SetRule():
                self.looked = None
                if wish.leader is None:
                    tank.shoal(wish.fish)
                else:
                    tank.lead(wish.fish, wish.leader)
            case message.Weights():
                tank.weigh((wish.repulsion, wish.alignment, wish.attraction))
            case message.Drop():
                tank.drop(wish.fish)
            case message.SetMode():
                tank.switch(wish.mode)
            case message.Pause():
                self.paused, self.looked = wish.on, None
            case message.Step():
                self.paused, self.looked = True, None
                self.advance()
            case message.Speed():
                self.speed = wish.times
            case message.PastTick():
                self.looked = wish.tick
            case message.SwimOn():
                tank.back_to(wish.tick)
                self.explained = min(self.explained, len(tank.fish) - 1)
                self.paused, self.looked = False, None
            case message.Explain():
                self.explained = min(wish.fish, len(tank.fish) - 1)
            case message.Count():
                tank.count(wish.fish)
                self.explained = min(self.explained, wish.fish - 1)

    def advance(self, ticks: int = 1) -> None:
        """Advance the tank by some ticks, and count the goals reached."""
        for _ in range(ticks):
            before = [fish.reached for fish in self.tank.fish]
            self.tank.advance()
            now = [fish.reached for fish in self.tank.fish]
            self.counts.reached += sum(b and not a for a, b in zip(before, now, strict=True))

    def show(self, took_ms: float = 0.0) -> bytes:
        """Return the next frame: a JSON text with its length before it, then a JPEG of the tank.

        took_ms: milliseconds that the frame before took.
        """
        self.frame += 1
        tick, painter = self.tick, self.painter
        rows = [row for fish in self.tank.fish if (row := fish.row_at(tick)) is not None]
        painter.show(*map(self.gallery.place, rows))
        picture = painter.frame
        if picture.ndim == 3:
            picture = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
        coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()
        text = json.dumps(self.state(tick, took_ms), separators=(",", ":")).encode()
        return len(text).to_bytes(4, "little") + text + coded

    def state(self, tick: int, took_ms: float = 0.0) -> dict[str, Any]:
        """Return all that the page shows of a tick besides the picture, as an object for JSON.

        took_ms: milliseconds that the frame before took.
        """
        tank, rate = self.tank, self.tank.rate_hz
        height, width = self.painter.canvas.shape[:2]
        choice = None
        if self.explained < len(tank.fish):
            choice = tank.fish[self.explained].choice(tick)
        return {
            "frame": self.frame, "tick": tick, "now": tank.tick, "oldest": tank.oldest,
            "rate": round(rate, 3), "width": width, "height": height,
            "paused": self.paused, "past": self.looked is not None, "speed": self.speed,
            "mode": tank.mode, "modes": self._modes(), "most": tank.most_fish or message.MOST_FISH,
            "touch": round(tank.world.touch_px, 1),
            "fish": [self._fish(number, tick) for number in range(len(tank.fish))],
            "explained": self.explained, "refused": self.refused,
            "weights": tank.shoaling.zones.weights if tank.shoaling else None,
            "widths": tank.shoaling.zones.widths if tank.shoaling else None,
            "decision": self._decision(choice) if choice else None,
            "bad": self.counts.bad, "dropped": self.counts.dropped,
            "reached": self.counts.reached, "ms": round(took_ms, 1),
        }  # fmt: skip

    def _modes(self) -> list[dict[str, str]]:
        """Return every mode for the page. lack: why it is not available now, if so."""
        return [
            {
                "name": mode, "title": facts.title, "says": f"{facts.sentence} ({facts.source})",
                "colour": facts.colour, "lack": self.tank.describe_lack(mode),
            }
            for mode, facts in MODES.items()
        ]  # fmt: skip

    def _fish(self, number: int, tick: int) -> dict[str, Any] | None:
        fish = self.tank.fish[number]
        row = fish.row_at(tick)
        if row is None:
            return None
        x, y, reached = row.goal_x_px, row.goal_y_px, row.reached
        if tick == self.tank.tick:  # a new goal counts from the next tick on
            x, y = (fish.goal.x_px, fish.goal.y_px) if fish.goal else (math.nan, math.nan)
            reached = fish.reached
        goal = None if math.isnan(x) else [round(x, 1), round(y, 1), reached]
        now = tick == self.tank.tick
        path_task = fish.path_task if now else fish.wish_at(tick).path_task
        order = fish.order if now else fish.wish_at(tick).order
        trail = range(tick - round(_TRAIL_S * self.tank.rate_hz), tick, _TRAIL_EVERY)
        return {
            "x": round(row.x_px, 1), "y": round(row.y_px, 1),
            "heading": round(row.heading_deg, 1), "speed": round(row.speed, 2),
            "mode": row.mode, "state": row.state, "goal": goal, "path": _describe_path(path_task),
            "rule": self._leader_number(order),
            "done": reached,
            "trail": np.rint(fish.places(trail)).astype(int).tolist(),
        }  # fmt: skip

    def _leader_number(self, order: RuleTask | None) -> int | None:
        """Return the number of the leader of a rule, −1 for the group; None without a rule."""
        if order is None or order.leader is None:
            return None if order is None else -1
        names = [fish.name for fish in self.tank.fish]
        return names.index(order.leader) if order.leader in names else None

    def _decision(self, choice: DecisionRecord) -> dict[str, Any]:
        """Return a decision, with the ways that were weighed when its plan was made."""
        plan = self.tank.fish[self.explained].plan_of(choice)
        fish, stretch, options = plan.state.fish, choice.stretch, plan.stretch.options
        ways = [] if options is None else _rank_candidates(options)
        return {
            "tick": choice.tick, "mode": choice.mode,
            "why": describe_decision(stretch.decision, choice.name, stretch.area),
            "x": round(fish.x, 1), "y": round(fish.y, 1),
            "aim": [round(part, 1) for part in stretch.aim[:2]],
            "planned": plan.tick,
            "more": max(0, len(ways) - _MOST_WAYS),
            "ways": [self._describe_candidate(plan, way) for way in ways[:_MOST_WAYS]],
        }  # fmt: skip

    def _describe_candidate(self, choice: DecisionRecord, way: int) -> dict[str, Any]:
        fish, options = choice.state.fish, choice.stretch.options
        assert options is not None
        row, cost = int(options.rows[way]), float(options.value[way])
        ends = not math.isfinite(cost)
        return {
            "row": row % self._film(choice).filmed, "seam": round(float(options.seams[way]), 2),
            "terms": [None if ends else round(float(term), 2) for term in options.terms[way]],
            "value": None if ends else round(cost, 2), "fails": VERDICTS[options.verdict[way]],
            "taken": way == options.taken,
            "path": self._path(self._film(choice), fish.x, fish.y, row, float(options.rots[way])),
        }  # fmt: skip

    def _film(self, choice: DecisionRecord) -> MotionGraph:
        player = self.tank.players[choice.mode]
        assert isinstance(player, Planner)
        return player.world.film

    def _path(self, film: MotionGraph, x: float, y: float, row: int, rot: float) -> list[list[int]]:
        last = row + round(_WAY_S * self.tank.rate_hz)
        stops = np.flatnonzero(~film.has_next[row:last])
        last = row + int(stops[0]) if stops.size else min(last, len(film.has_next) - 1)
        cos, sin = rotate(1.0, 0.0, rot)
        dx, dy = film.dx[row:last], film.dy[row:last]
        steps = np.column_stack([dx * cos - dy * sin, dx * sin + dy * cos])
        way = np.cumsum(np.vstack([[x, y], steps]), axis=0)[::_WAY_EVERY]
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
    ways = range(len(options.rows))
    return sorted(
        ways, key=lambda way: (way != options.taken, options.verdict[way] > 0, options.value[way])
    )
