"""A session: trial after trial on the clock, with all its inputs and outputs logged.

A tick of a motion that is known beforehand is sent half a second early, so that nothing can make it
late. Where fish react to live animals, a tick is planned shortly before it is due; when an animal
moves, the last tick is planned again at once, and the page goes on from what it shows.
"""

import asyncio
import gc
import json
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from typing import Any, NamedTuple

from finloop.show.drawn import States
from finloop.show.feed import EARLY_S, Feed
from finloop.stimulus.animals import TAKEN, LiveAnimals, Verdict
from finloop.stimulus.limits import InputLimits
from finloop.stimulus.log import FrameFacts, Log, digest_states, parse_frame_records
from finloop.stimulus.motion import ReactiveMotion, TrialContext, TrialSetup, plan_motion
from finloop.stimulus.order import Trial, fill_trigger_text
from finloop.stimulus.protocol import Protocol
from finloop.stimulus.recorded import DryClock
from finloop.stimulus.tracker import LONGEST, parse_trigger

# How long before the page needs it a tick is planned: the shorter of these two times. Planning
# takes a few ms; an earlier tick would not know the latest messages of trackers.
_MOST_LEAD_S, _LEAD_TICKS = 0.008, 0.25
_FIRST_S = 0.3  # from the beginning of a trial to its first tick: time to send its pictures
_JUMP_S = 0.5  # a larger change of wall clock against session clock is a jump
_NO_DISPLAY = "no display shows frames: open its page in front of all other windows"
_RECENT = 512  # latencies kept of each kind
_SILENT_S = 3.0  # a display that reported no frame for so long shows none
_LAST_RECORDS_S = 0.3  # within it a page has sent its records of the last frames


class RealClock:
    """The clock of a session with a display; a wait ends within 0.1 ms of its time."""

    def __init__(self) -> None:
        """Start the clock at 0."""
        self._zero = time.perf_counter()

    def read_time(self) -> float:
        """Return the present session time: seconds since the clock was created."""
        return time.perf_counter() - self._zero

    async def wait_until(self, time_s: float) -> None:
        """Wait until a session time, s."""
        while (left_s := time_s - self.read_time()) > 0:
            # The loop's own timer may be a millisecond late: wait for the rest step by step.
            await asyncio.sleep(left_s - 0.0015 if left_s > 0.002 else 0)


@dataclass
class SessionCounts:
    """The last latencies of a running session [ms], and its counts of frames and messages.

    planned_ms, drawn_ms: from an input to the planned reaction, and to the frame that shows it;
    tick_ms: how much later ticks were planned than due; frames, dropped, late: displayed, missed,
    and drawn too late; bad: invalid messages of pages, and more than a page may send; verdicts: on
    messages of trackers. unwritten: verdicts and events that the log only counts, since the last
    entry about them.
    """

    planned_ms: deque[float] = field(default_factory=partial(deque, maxlen=_RECENT))
    drawn_ms: deque[float] = field(default_factory=partial(deque, maxlen=_RECENT))
    tick_ms: deque[float] = field(default_factory=partial(deque, maxlen=_RECENT))
    frames: int = 0
    dropped: int = 0
    late: int = 0
    bad: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    unwritten: Counter[str] = field(default_factory=Counter)


class _UndrawnReaction(NamedTuple):
    """A tick that was planned again, because an animal moved, and that no frame shows yet.

    Session times, s. arrived_s: of the tracker's message to which fish react. tick_before_s: when
    the tick before is due, after which a frame shows the reaction.
    """

    arrived_s: float
    tick_before_s: float


class Session:
    """A session: it plans, sends and logs the ticks of all trials, and handles all inputs."""

    def __init__(
        self, context: TrialContext, protocol: Protocol, trials: tuple[Trial, ...], feed: Feed,
        log: Log, clock: RealClock | DryClock,
    ) -> None:  # fmt: skip
        """Prepare a session; `run_trials` runs it as soon as `start` is called.

        trials: in order; feed: makes the messages to display pages; clock: a `DryClock` for a
        session without a display.
        """
        self.context, self.protocol, self.trials = context, protocol, trials
        self.feed, self.log, self.clock = feed, log, clock
        self.animals = LiveAnimals(protocol.animals, context.tank, context.mm_per_px)
        self.limits = InputLimits()
        self.counts = SessionCounts()
        self._send: Callable[[bytes], None] = lambda content: None
        self._send_trigger: Callable[[str, str], str | None] = lambda to, text: None
        self.watch_tick: Callable[[States], None] = lambda states: None  # gets each planned tick
        self.save_file: Callable[[], None] = lambda: None  # writes the session's file, in a thread
        self.phase = "ready"  # waiting, planning, running, pause, saving, done
        self.trial_index = -1
        self.done: dict[int, str] = {}  # how each trial ended, by its number
        self.waits_for_starts = True  # for keys, messages and a display; False in a dry run
        self.displays = 0
        self.display: dict[str, Any] | None = None  # facts about it
        self.name = self.link = ""  # of the session's file, and the address of the display's page
        # How much of the tank the display shows, in words, and whether it is not all.
        self.screen: tuple[str, bool] | None = None
        self.messages: deque[str] = deque(maxlen=50)
        self.shown: States | None = None  # what was displayed last
        self._motions: dict[str, States] = {}  # of the latest trial of each condition
        self._reaction: ReactiveMotion | None = None
        # Of the tick sent last: number of its message, when it is due, and its number in the trial.
        self._seq, self._due_s, self._tick = 0, 0.0, -1
        self._undrawn_reactions: dict[int, _UndrawnReaction] = {}  # by number of the message
        self._end_s: float | None = None  # of the present trial or pause
        # Of each trial: the number of its first message, when it began, and its own number.
        self._trial_begins: list[tuple[int, float, int]] = []
        self._page: str | None = None  # identity of the last page that was the display
        self._page_offset: int | None = 0  # from its numbers to the log's; None: not known yet
        self._last_frame = -1  # number of the last frame in the log
        self._last_intended_s = 0.0  # when the last frame was due
        # Conditions whose motions others repeat, and which are kept therefore.
        self._repeated = {condition.motion.again for condition in protocol.conditions.values()}
        self._frame_reported_s: float | None = None  # when a display reported a frame last
        self._begun = asyncio.Event()
        self._may_start = asyncio.Event()
        self.stopping = self._abort = self._skip = False
        self._wall_offset_s: float | None = None  # the computer's clock less the session's

    def connect_outputs(
        self, send: Callable[[bytes], None], send_trigger: Callable[[str, str], str | None]
    ) -> None:
        """Set the functions that send messages to display pages and triggers to receivers.

        send: sends a message to all display pages. send_trigger: sends a trigger, given the
        receiver's address and the text, and returns what went wrong, or None.
        """
        self._send, self._send_trigger = send, send_trigger

    # --- the experimenter, keys, triggers

    def start(self) -> None:
        """Begin the session, or the trial that waits; refuse and report it if no display draws."""
        if self.waits_for_starts and not self.is_display_drawing():
            self.report_outside_event("not started", reason=_NO_DISPLAY)
        else:
            self._release()

    def _release(self) -> None:
        """Let the session, or the trial that waits, go on."""
        self._begun.set()
        self._may_start.set()

    def stop(self) -> None:
        """End the session after the present trial, and log that."""
        self.stopping = True
        self.log_outside_event("stop")
        self._release()

    def abort(self) -> None:
        """End the session at once, and log that."""
        self.stopping = self._abort = True
        self.log_outside_event("abort")
        self._release()

    def skip(self) -> None:
        """Skip the rest of the present trial, and log that."""
        self._skip = True
        self.log_outside_event("skip")
        self._may_start.set()

    def press_key(self, key: str) -> None:
        """Log a key press at a display or by the experimenter; it may start a waiting trial."""
        self.log_outside_event("key", key=key)
        if self.phase == "waiting" and key == self.protocol.start_key:
            self.start()

    def log_event(self, what: str, **facts: Any) -> None:
        """Log an event, with facts about it that JSON can hold."""
        text = json.dumps({"what": what, **facts})
        self.log.add_entry("event", self.clock.read_time(), text=text)

    def log_outside_event(self, what: str, **facts: Any) -> None:
        """Log an event that a page or a program caused; only count it if there are too many."""
        if self.limits.may_write_event(len(str(facts)), self.clock.read_time()):
            self.log_event(what, **facts)
        else:
            self.counts.unwritten[f"event {what}"] += 1

    def log_unwritten(self) -> None:
        """Log how many messages and events were only counted since this was logged last."""
        if self.counts.unwritten:
            self.log_event("not written", **self.counts.unwritten)
            self.counts.unwritten.clear()

    def report_event(self, what: str, **facts: Any) -> None:
        """Show an event to the experimenter, and log it, both with facts about it."""
        self.log_event(what, **facts)
        self._show_event(what, facts)

    def report_outside_event(self, what: str, **facts: Any) -> None:
        """Show an event that a page caused to the experimenter; log it, or count it."""
        self.log_outside_event(what, **facts)
        self._show_event(what, facts)

    def _show_event(self, what: str, facts: dict[str, Any]) -> None:
        """Show an event to the experimenter, with facts about it."""
        details = ", ".join(f"{name} {value}" for name, value in facts.items())
        text = f"{what}: {details}" if details else what
        self.messages.append(f"{self.clock.read_time():.1f} s: {text}")

    # --- live animals

    def receive_message(self, text: str | bytes | None, source: str) -> None:
        """Handle a message of a tracker, or one that starts a trial.

        If fish react to the message, the last tick is planned again before this returns. Too many
        messages of a sender are only counted. A message without effect is only counted, too, once
        many have been logged.
        """
        arrived_s, size = self.clock.read_time(), len(text or "")
        if not self.limits.may_hear(source, size, arrived_s):
            self._count_unwritten(["flood"])
            return
        name = parse_trigger(text)
        if name is not None:
            self.log_outside_event("trigger", name=name, source=source)
            if self.phase == "waiting" and name == self.protocol.start_message:
                self.start()
            return
        verdicts = self.animals.receive_message(text, source, arrived_s)
        if not (self.animals.is_changed or self.limits.may_write_refusal(size, arrived_s)):
            self._count_unwritten(verdicts)
            return
        self.counts.verdicts.update(verdicts)
        logged = text.decode(errors="replace") if isinstance(text, bytes) else text or ""
        self.log.add_entry(
            "input", arrived_s, source=source, text=logged[:LONGEST], verdict=" ".join(verdicts)
        )
        if self._reaction is None or set(TAKEN).isdisjoint(verdicts):  # no sighting was stored
            return
        states = self._reaction.replan_tick(arrived_s)
        if states is not None:
            now_s = self.clock.read_time()
            self._send_tick(self._tick, self._due_s, states, now_s, replanned=True)
            tick_before_s = self._due_s - 1 / self.context.rate_hz
            self._undrawn_reactions[self._seq] = _UndrawnReaction(arrived_s, tick_before_s)
            self.counts.planned_ms.append(1e3 * (now_s - arrived_s))

    def _count_unwritten(self, verdicts: list[Verdict]) -> None:
        """Count the verdicts on a message that is not written into the log."""
        self.counts.verdicts.update(verdicts)
        self.counts.unwritten.update(verdicts)

    # --- display

    def note_frame(self) -> None:
        """Note that the display has reported a frame now."""
        self._frame_reported_s = self.clock.read_time()

    def is_display_drawing(self) -> bool:
        """Return whether a display is visible and has reported a frame in the last seconds."""
        if self.display is None or self.display["hidden"] or self._frame_reported_s is None:
            return False
        return self.clock.read_time() - self._frame_reported_s <= _SILENT_S

    def record_frames(self, message: bytes) -> None:
        """Log a page's records of displayed frames; count missed and late ones, and measure delays.

        A delay is the time from a tracker's message to the first frame that shows the reaction to
        it. An invalid message of the page is counted as bad.
        """
        try:
            frames = parse_frame_records(message, self.context.width)
        except ValueError:
            self.counts.bad += 1
            return
        self.note_frame()
        for page_facts, states in frames:
            if self._page_offset is None:  # even, as a page marks odd frames with its white square
                self._page_offset = (self._last_frame + 3 - int(page_facts.number)) // 2 * 2
            number = int(page_facts.number) + self._page_offset
            if number <= self._last_frame:  # not in order
                self.counts.bad += 1
                continue
            facts = page_facts._replace(number=number)
            self.log.add_frame(facts, states, self._find_trial(facts))
            self.shown = states
            # A frame is late if it was drawn after the next one was due. The time between two is
            # known only if the frame just before was recorded, too.
            period_s = (facts.intended_s - self._last_intended_s) / (facts.dropped + 1)
            follows = number == self._last_frame + 1
            self.counts.frames += 1
            self.counts.dropped += int(facts.dropped)
            self.counts.late += int(follows and facts.drawn_s > facts.intended_s + period_s)
            self._last_frame, self._last_intended_s = number, facts.intended_s
            # The first frame that both knew the new plan, and was due after the tick before, shows
            # the reaction.
            for seq, reaction in list(self._undrawn_reactions.items()):
                if seq <= facts.seq and facts.intended_s > reaction.tick_before_s:
                    self.counts.drawn_ms.append(1e3 * (facts.drawn_s - reaction.arrived_s))
                    del self._undrawn_reactions[seq]

    def _find_trial(self, facts: FrameFacts) -> int | None:
        """Return the number of the trial whose fish a frame shows; None if it shows no fish.

        A frame is reported up to 0.2 s later: it may be of a trial that has ended since. It tells
        the plan that it shows; before the first tick is due it shows none, and its time decides.
        """
        if not facts.fish_count:
            return None
        for first_seq, begin_s, number in reversed(self._trial_begins):
            if facts.seq >= first_seq or (facts.seq == 0 and facts.drawn_s >= begin_s):
                return number
        return None

    def set_display(self, facts: dict[str, Any] | None, pages: int) -> None:
        """Note which page is the display, and log it if it, or a fact about it, has changed.

        facts: about it, `page`, its identity, among them; None if there is none. pages: how many
        pages show the session. A display that goes is reported if a trial runs or waits. A page
        counts its frames by itself; the numbers of another page go on after those in the log.
        """
        previous, page = self.display, None if facts is None else facts["page"]
        if pages > max(self.displays, 1):
            self.report_outside_event("another page mirrors the display", pages=pages)
        self.displays, self.display = pages, facts
        has_gone = previous is not None and previous["page"] != page
        if has_gone and self.phase in ("running", "waiting"):
            trial = self.trials[self.trial_index].number
            self.report_outside_event("the display has gone", trial=trial)
        if facts is None:
            return
        if page != self._page:
            self._page, self._frame_reported_s = page, None
            self._page_offset = 0 if self._last_frame < 0 else None
        hidden = {"hidden": None}  # has its own events
        if previous is None or previous | hidden != facts | hidden:
            self.log_outside_event("display", **{k: v for k, v in facts.items() if k != "hidden"})

    def set_hidden(self, on: bool) -> None:
        """Report that the display's page is hidden behind another (`on`), or visible again."""
        if self.display is not None:
            self.display["hidden"] = on
        self.report_outside_event(f"the display's page is {'hidden' if on else 'seen again'}")

    def remaining_s(self, now: float) -> float | None:
        """Return how many s of the present trial or pause are left; None if neither lasts now."""
        return None if self._end_s is None else round(max(0.0, self._end_s - now), 1)

    def check_wall_clock(self, wall_s: float) -> None:
        """Report a jump of the computer's clock against the session's; wall_s: s since 1970."""
        offset_s = wall_s - self.clock.read_time()
        jump_s = 0.0 if self._wall_offset_s is None else offset_s - self._wall_offset_s
        if abs(jump_s) > _JUMP_S:
            self.report_event("the computer's clock jumped", seconds=round(jump_s, 3))
        self._wall_offset_s = offset_s

    # --- trials

    async def run_trials(self) -> None:
        """Run all trials once `start` is called; return when the session's file is written."""
        await self._begun.wait()
        self.log_event("begin", wall=datetime.now().astimezone().isoformat())
        gc.freeze()  # present objects are not scanned again after each trial
        try:
            for number, trial in enumerate(self.trials):
                if self.stopping:
                    break
                self.trial_index = number
                await self._run_trial(trial)
                if not self.stopping and trial is not self.trials[-1]:
                    self._end_s = self.clock.read_time() + self.protocol.pause_s
                    await self._wait_until(self._end_s)
                    self._end_s = None
        finally:
            gc.unfreeze()
        self.phase = "saving"
        self.log_event("end", wall=datetime.now().astimezone().isoformat())
        self.log_unwritten()
        await self.clock.wait_until(self.clock.read_time() + _LAST_RECORDS_S)
        await asyncio.to_thread(self.log.write_entries)
        await asyncio.to_thread(self.save_file)
        self.phase = "done"

    async def _run_trial(self, trial: Trial) -> None:
        """Prepare one trial, wait for its start if it has one, and show it."""
        self._skip, self.phase = False, "planning"
        setup = TrialSetup.from_protocol(self.protocol, trial)
        states = await self._prepare_motion(trial, setup)  # None if planned tick by tick
        waits = self.waits_for_starts and self.protocol.start != "auto"
        if self.waits_for_starts and not (waits or self.is_display_drawing()):
            self.report_event("a trial waits for Start", trial=trial.number, reason=_NO_DISPLAY)
            waits = True
        if waits and not (self._abort or self._skip):
            self.phase = "waiting"
            self._may_start.clear()
            await self._may_start.wait()
        if self.stopping:
            return
        if not self._skip:
            self._report_trial(trial, "start", states is not None)
            ending = await self._show_trial(trial, setup, states)
            self._report_trial(trial, ending, states is not None)
        outcome = "aborted" if self._abort else "done"
        self.done[trial.number] = "skipped" if self._skip else outcome
        await asyncio.to_thread(self.log.write_entries)
        self.phase = "pause"
        gc.collect()  # the fish of the last trial refer to each other: free them now

    async def _prepare_motion(self, trial: Trial, setup: TrialSetup) -> States | None:
        """Plan a trial's motion, send its first pictures; return its states (ticks, fish, fields).

        Look and fading are applied. None if fish react to live animals, and are planned tick by
        tick; or if the trial repeats a motion that was never shown, and is skipped.
        """
        motion = setup.condition.motion
        if motion.rule is not None:
            return None
        if motion.again is not None and motion.again not in self._motions:
            self.report_event("left out, as no trial was shown of", condition=motion.again)
            self._skip = True
            return None
        states = await asyncio.to_thread(plan_motion, self.context, setup, self._motions)
        if trial.condition in self._repeated:
            self._motions[trial.condition] = states
        shown = setup.apply_look_and_fade(states, self.context.rate_hz)
        for content in self.feed.picture_messages(shown[: self.context.count_ticks(EARLY_S)]):
            self._send(content)  # before the trial begins
        return shown

    def _report_trial(self, trial: Trial, what: str, is_planned: bool) -> None:
        """Log that a trial starts or has ended, and send the triggers of its start or its end.

        what: "start", or how it ended. is_planned: whether its motion is known beforehand.
        """
        now, number = self.clock.read_time(), trial.number
        facts = {"what": what, **trial._asdict(), "early_s": self._lead_time_s(is_planned)}
        self.log.trial = number
        if what == "start":
            self._trial_begins.append((self._seq + 1, now, number))
        self.log.add_entry("trial", now, number=number, text=json.dumps(facts))
        if what != "start":  # the entry about its end is the trial's last
            self.log.trial = None
            self.log_unwritten()
        for trigger in self.protocol.triggers:
            if (trigger.at == "start") == (what == "start"):
                text = fill_trigger_text(trigger, trial)
                wrong = self._send_trigger(trigger.to, text)
                self.log_event("trigger out", to=trigger.to, text=text)
                if wrong:
                    self.report_event("a trigger was not sent", to=trigger.to, reason=wrong)

    async def _show_trial(self, trial: Trial, setup: TrialSetup, planned: States | None) -> str:
        """Show a trial tick by tick; return how it ended: "end", "skip" or "abort".

        planned: the states (ticks, fish, fields) if known beforehand; None if fish react.
        """
        # When the trial begins and ends, and who plans its ticks.
        self.phase, rate = "running", self.context.rate_hz
        begin_s = self.clock.read_time() + _FIRST_S
        ticks = self.context.count_ticks(setup.condition.seconds)
        self._end_s = begin_s + ticks / rate
        early_s = self._lead_time_s(planned is not None)
        keeps = trial.condition in self._repeated  # the motion, for a condition that repeats it
        reaction = None
        if planned is None:
            reaction = ReactiveMotion(self.context, setup, self.animals, keeps)
        self._reaction = reaction
        # Plan and send each tick, some time before it is due.
        for tick in range(ticks):
            due_s = begin_s + tick / rate
            await self.clock.wait_until(due_s - early_s)
            if self._abort or self._skip:
                break
            now_s = self.clock.read_time()
            if planned is not None:
                self._send_tick(tick, due_s, planned[tick], now_s)
            elif reaction is not None:
                self._tick, self._due_s = tick, due_s
                self._send_tick(tick, due_s, reaction.plan_tick(now_s), now_s)
            if tick > rate * early_s:  # the first ticks are sent at once, as they are overdue
                self.counts.tick_ms.append(1e3 * (now_s - (due_s - early_s)))
        else:
            await self._wait_until(self._end_s)
        # Clean up, but keep a motion that another condition repeats.
        if reaction is not None and keeps and (motion := reaction.planned_states) is not None:
            self._motions[trial.condition] = motion
        self._reaction = self._end_s = None
        self._undrawn_reactions.clear()
        self._send(self.feed.clear_message())
        return "abort" if self._abort else "skip" if self._skip else "end"

    def _lead_time_s(self, is_planned: bool) -> float:
        """Return how many seconds before its display time a tick is sent.

        is_planned: whether its motion is known beforehand.
        """
        tick_s = 1 / self.context.rate_hz  # the page interpolates from the tick before
        return EARLY_S if is_planned else tick_s + min(_MOST_LEAD_S, _LEAD_TICKS * tick_s)

    async def _wait_until(self, time_s: float) -> None:
        """Wait until a session time, or until the trial is skipped or the session aborted."""
        while not (self._abort or self._skip) and self.clock.read_time() < time_s:
            await self.clock.wait_until(min(time_s, self.clock.read_time() + 0.1))

    def _send_tick(
        self, tick: int, due_s: float, states: States, planned_s: float, replanned: bool = False
    ) -> None:
        """Send a tick's states (fish, fields) to the displays, and log their digest.

        tick: number within the trial. due_s, planned_s: session times when to show it, and when it
        was planned. replanned: whether it was sent before; what was sent then is void.
        """
        self._seq += 1
        if not replanned:
            self.watch_tick(states)
        for message in self.feed.tick_messages(self._seq, tick, due_s, states, replanned):
            self._send(message)
        self.log.add_entry(
            "tick", planned_s, number=tick, intended_s=due_s, seq=self._seq,
            digest=digest_states(states), verdict="anew" if replanned else None,
        )  # fmt: skip
