"""A session: trial after trial on the clock, with all its inputs and outputs logged.

A tick of a motion that is known beforehand is sent half a second early, so that nothing can make it
late. Where fish react to live animals, a tick is planned shortly before it is due; when an animal
moves, the last tick is planned again at once, and the page goes on from what it shows.
"""

import asyncio
import gc
import json
from collections import deque
from collections.abc import Callable
from datetime import datetime
from typing import Any, Protocol

from finloop.stimulus.animals import Heard, LiveAnimals
from finloop.stimulus.course import (
    Reaction,
    States,
    TrialContext,
    collect_motion,
    cue_of,
    plan_motion,
    repeat_motion,
)
from finloop.stimulus.feed import EARLY_S, Feed
from finloop.stimulus.log import FRAME_FIELDS, Log, digest_of, frames_of
from finloop.stimulus.numbers import Numbers
from finloop.stimulus.order import Trial, trigger_text
from finloop.stimulus.protocol import Protocol as Plan
from finloop.stimulus.trigger import trigger_of

_AHEAD_S, _AHEAD = 0.008, 0.25  # s, ticks, that ticks are planned before the page needs them
_FIRST_S = 0.3  # from the beginning of a trial to its first tick: time to send its pictures
_JUMP_S = 0.5  # a larger change of wall clock against session clock is a jump


class Clock(Protocol):
    """The session's clock, which counts seconds."""

    def read_time(self) -> float:
        """Return the present time, s."""
        ...

    async def until(self, time_s: float) -> None:
        """Wait until a session time, s; return at once if it is past."""
        ...


class Session:
    """Runs the trials of a protocol: plans, sends and logs every tick, and takes all inputs.

    scene: what all trials share; plan: the protocol; trials: in their order; feed: makes the
    messages to the display pages; log, clock: of the session.
    """

    def __init__(
        self, scene: TrialContext, plan: Plan, trials: tuple[Trial, ...], feed: Feed, log: Log,
        clock: Clock,
    ) -> None:  # fmt: skip
        self.scene, self.plan, self.trials = scene, plan, trials
        self.feed, self.log, self.clock = feed, log, clock
        self.animals = LiveAnimals(plan.animals, scene.tank, scene.mm_per_px)
        self.numbers = Numbers()
        self._send: Callable[[bytes], None] = lambda content: None
        self._out: Callable[[str, str], str | None] = lambda to, text: None
        self.phase = "ready"  # waiting, planning, running, pause, done
        self.at = -1  # the trial's index
        self.done: dict[int, str] = {}
        self.patient = True  # whether trials wait for keys and messages
        self.displays = 0
        self.display: dict[str, Any] | None = None  # facts about it
        self.name = self.link = ""  # of the session's file, and the address of the display's page
        self.messages: deque[str] = deque(maxlen=50)
        self.shown: States | None = None  # what was displayed last
        self._motions: dict[str, States] = {}  # of the latest trial of each condition
        self._reaction: Reaction | None = None
        self._seq, self._due, self._tick = 0, 0.0, -1
        self._waits: dict[int, tuple[float, float]] = {}  # by seq: an input, and when it counts
        self._ends: float | None = None  # when the trial ends
        self._first = self._frame = 0  # numbers of a page's first frame, and of the last one
        self._intended = 0.0  # when that frame was due
        self._wanted = {one.motion.again for one in plan.conditions.values()}  # motions to be kept
        self._begun = asyncio.Event()
        self._permit = asyncio.Event()
        self.stopping = self._abort = self._skip = False
        self._wall: float | None = None

    def attach(self, send: Callable[[bytes], None], out: Callable[[str, str], str | None]) -> None:
        """Connect the outputs: display pages, and receivers of triggers.

        send: sends a message to all display pages; out: takes a trigger's receiver and text, sends
        it, and returns what went wrong.
        """
        self._send, self._out = send, out

    # --- the experimenter, keys, triggers

    def start(self) -> None:
        """Begin the session, or the trial that waits."""
        self._begun.set()
        self._permit.set()

    def stop(self) -> None:
        """End the session after this trial."""
        self.stopping = True
        self._note("stop")
        self.start()

    def abort(self) -> None:
        """End the session now."""
        self.stopping = self._abort = True
        self._note("abort")
        self.start()

    def skip(self) -> None:
        """Skip the rest of this trial."""
        self._skip = True
        self._note("skip")
        self._permit.set()

    def note(self, text: str) -> None:
        """Log a note of the experimenter."""
        self._note("note", text=text)

    def key(self, key: str) -> None:
        """Handle a key press at a display, or by the experimenter."""
        self._note("key", key=key)
        if self.phase == "waiting" and key == self.plan.start_key:
            self._permit.set()

    def trouble(self, what: str, **facts: Any) -> None:
        """Show a problem to the experimenter, and log it with the facts about it."""
        self._note(what, **facts)
        words = ", ".join(f"{name} {value}" for name, value in facts.items())
        self.messages.append(
            f"{self.clock.read_time():.1f} s: {what}{': ' if words else ''}{words}"
        )

    def _note(self, what: str, **facts: Any) -> None:
        self.log.event(self.clock.read_time(), what, **facts)

    # --- live animals

    def hear(self, text: str | bytes | None, source: str) -> None:
        """Take a message of a tracker, or one that starts a trial; fish react before this returns.

        source: the sender.
        """
        arrived = self.clock.read_time()
        name = trigger_of(text)
        if name is not None:
            self._note("trigger", name=name, source=source)
            if self.phase == "waiting" and name == self.plan.start_message:
                self._permit.set()
            return
        heard = self.animals.hear(text, source, arrived)
        self.numbers.heard.update(one.verdict for one in heard)
        kept = text.decode(errors="replace") if isinstance(text, bytes) else text or ""
        self.log.input(arrived, source, kept, _verdicts(heard))
        reaction = self._reaction
        if reaction is None or not any(one.is_present for one in heard):
            return
        states = reaction.react(arrived)
        if states is not None:
            now = self.clock.read_time()
            self._emit(self._tick, self._due, states, now, cut=True)
            self._waits[self._seq] = arrived, self._due - 1 / self.scene.rate_hz
            self.numbers.planned.append(1e3 * (now - arrived))

    # --- display

    def frames(self, message: bytes) -> None:
        """Log a page's records of displayed frames, and count missed and late ones."""
        try:
            frames = frames_of(message, self.scene.width)
        except ValueError:
            self.numbers.bad += 1
            return
        for facts, drawn in frames:
            facts = facts.copy()
            facts[0] += self._first
            self.log.frame(facts, drawn)
            _, intended, _, drawn_s, seq, dropped, _, _ = facts[:FRAME_FIELDS]
            self.numbers.frames += 1
            self.numbers.dropped += int(dropped)
            period = (intended - self._intended) / (dropped + 1)
            self.numbers.late += int(facts[0] == self._frame + 1 and drawn_s > intended + period)
            self._frame, self._intended = int(facts[0]), float(intended)
            self.shown = drawn
            for waiting, (arrived, counts) in list(self._waits.items()):
                if waiting <= seq and intended > counts:
                    self.numbers.drawn.append(1e3 * (drawn_s - arrived))
                    del self._waits[waiting]

    def display_came(self, facts: dict[str, Any]) -> None:
        """Note that a display has connected, with facts about it.

        A page counts its frames from 0; the log's numbers go on.
        """
        self._first = (self._frame // 2 + 1) * 2 if self._frame else 0
        self.displays, self.display = self.displays + 1, facts | {"hidden": False}
        self._note("display", **facts)

    def display_left(self) -> None:
        """Note that a display has disconnected."""
        self.displays -= 1
        self.display = None if not self.displays else self.display
        if self.phase in ("running", "waiting"):
            self.trouble("the display has gone", trial=self.trials[self.at].number)

    def set_hidden(self, on: bool) -> None:
        """Note that the display's page is hidden behind another one, or visible again."""
        if self.display is not None:
            self.display["hidden"] = on
        self.trouble("the display's page is hidden" if on else "the display's page is seen again")

    def left_s(self, now: float) -> float | None:
        """Return how long the trial still lasts, s; None where none runs. now: session time, s."""
        return None if self._ends is None else round(max(0.0, self._ends - now), 1)

    def look(self, wall_s: float) -> None:
        """Report a jump of the computer's clock against the session's. wall_s: s since 1970."""
        wall = wall_s - self.clock.read_time()
        if self._wall is not None and abs(wall - self._wall) > _JUMP_S:
            self.trouble("the computer's clock jumped", seconds=round(wall - self._wall, 3))
        self._wall = wall

    # --- trials

    async def run(self) -> None:
        """Run all trials, once `start` is called; return when the session has ended."""
        await self._begun.wait()
        self._note("begin", wall=datetime.now().astimezone().isoformat())
        gc.freeze()  # present objects are not scanned again after each trial
        try:
            for number, trial in enumerate(self.trials):
                if self.stopping:
                    break
                self.at = number
                await self._try(trial)
                if not self.stopping and trial is not self.trials[-1]:
                    await self._wait(self.clock.read_time() + self.plan.pause_s)
        finally:
            gc.unfreeze()
        self.phase = "done"
        self._note("end", wall=datetime.now().astimezone().isoformat())

    async def _try(self, trial: Trial) -> None:
        self._skip, self.phase = False, "planning"
        source = await self._prepare(trial)
        await self._permission()
        if self.stopping:
            return
        if not self._skip:
            self._report(trial, "start")
            self._report(trial, await self._show(trial, source))
        self.done[trial.number] = "skipped" if self._skip else "aborted" * self._abort or "done"
        await asyncio.to_thread(self.log.keep)
        self.phase = "pause"
        gc.collect()  # the fish of the last trial refer to each other: free them now

    async def _prepare(self, trial: Trial) -> States | None:
        cue = cue_of(self.plan, trial)
        motion = cue.condition.motion
        if motion.rule is not None:
            return None
        if motion.again is None:
            states = await asyncio.to_thread(plan_motion, self.scene, cue, trial.seed)
        elif motion.again in self._motions:
            states = repeat_motion(self.scene, cue, self._motions[motion.again])
        else:
            self.trouble("left out, as no trial was shown of", condition=motion.again)
            self._skip = True
            return None
        if trial.condition in self._wanted:
            self._motions[trial.condition] = states
        shown = cue.apply_look_and_fade(states, self.scene)
        for content in self.feed.pictures(shown[: self.scene.ticks(EARLY_S)]):
            self._send(content)  # before the trial begins
        return shown

    async def _permission(self) -> None:
        if self.plan.start == "auto" or not self.patient or self._abort or self._skip:
            return
        self.phase = "waiting"
        self._permit.clear()
        await self._permit.wait()

    def _report(self, trial: Trial, what: str) -> None:
        rule = self.plan.conditions[trial.condition].motion.rule
        now, facts = self.clock.read_time(), trial._asdict()
        facts["early_s"] = self._early_s(rule is None)
        self.log.trial = trial.number
        self.log.entry("trial", now, number=trial.number, text=json.dumps({"what": what} | facts))
        self.log.trial = None if what != "start" else trial.number
        for trigger in self.plan.triggers:
            if (trigger.at == "start") == (what == "start"):
                text = trigger_text(trigger, trial)
                wrong = self._out(trigger.to, text)
                self._note("trigger out", to=trigger.to, text=text)
                if wrong:
                    self.trouble("a trigger was not sent", to=trigger.to, reason=wrong)

    async def _show(self, trial: Trial, source: States | None) -> str:
        self.phase, rate = "running", self.scene.rate_hz
        begin = self.clock.read_time() + _FIRST_S
        ticks = self.scene.ticks(self.plan.conditions[trial.condition].seconds)
        self._ends = begin + ticks / rate
        early = self._early_s(source is not None)
        if source is None:
            self._reaction = Reaction(
                self.scene, cue_of(self.plan, trial), trial.seed, self.animals
            )
            self._reaction.keeps = trial.condition in self._wanted
        for tick in range(ticks):
            due = begin + tick / rate
            await self.clock.until(due - early)
            if self._abort or self._skip:
                break
            now = self.clock.read_time()
            if source is not None:
                self._emit(tick, due, source[tick], now)
            else:
                assert self._reaction is not None
                self._tick, self._due = tick, due
                self._emit(tick, due, self._reaction.tick(now), now)
            if tick > rate * early:
                self.numbers.ticks.append(1e3 * (now - (due - early)))
        else:
            await self._wait(begin + ticks / rate)
        if self._reaction is not None and self._reaction.keeps:
            self._motions[trial.condition] = collect_motion(self._reaction.states)
        self._reaction = self._ends = None
        self._waits.clear()
        self._send(self.feed.clear())
        return "abort" if self._abort else "skip" if self._skip else "end"

    def _early_s(self, known: bool) -> float:
        """Return how long before it is due a tick is planned, or sent where it is known."""
        tick_s = 1 / self.scene.rate_hz  # the page interpolates from the tick before
        return EARLY_S if known else tick_s + min(_AHEAD_S, _AHEAD * tick_s)

    async def _wait(self, time_s: float) -> None:
        """Wait until a time, or until the trial or session is ended."""
        while not (self._abort or self._skip) and self.clock.read_time() < time_s:
            await self.clock.until(min(time_s, self.clock.read_time() + 0.1))

    def _emit(self, tick: int, due: float, states: States, now: float, cut: bool = False) -> None:
        self._seq += 1
        for message in self.feed.rows(self._seq, tick, due, states, cut):
            self._send(message)
        self.log.entry(
            "tick", now, number=tick, intended_s=due, seq=self._seq, digest=digest_of(states),
            verdict="anew" if cut else None,
        )  # fmt: skip


def _verdicts(heard: list[Heard]) -> str:
    return " ".join(one.verdict for one in heard)
