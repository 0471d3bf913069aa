"""The stimulus: its reaction time, dropped frames, and the effect of hostile messages.

`python -m benchmarks.stimulus` prints the table and writes benchmarks/stimulus.csv, for the results
in data/. A session runs as for a user, as a program of its own, with headless Chromium (software
WebGL, 1280×720) as its display; the figures come from the session's file. `--minutes 60` sets the
length of the long session. The summary of any session has the figures of a real display.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
import asyncio
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd
import psutil
import yaml
from playwright.sync_api import Page, sync_playwright
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from benchmarks.pipeline import write_table
from finloop.io.journal import save_journal
from finloop.project import Project
from finloop.show.drawn import PICTURE, X, Y
from finloop.stimulus.log import SESSION, Log
from finloop.stimulus.order import order_trials
from finloop.stimulus.protocol import Protocol, RuleSpec
from finloop.stimulus.protocol_file import parse_protocol
from finloop.stimulus.recorded import DryClock, TimedMessage
from finloop.stimulus.replay import (
    SessionRecord,
    open_session_record,
    read_displayed_frames,
    replan_session,
)
from finloop.stimulus.session import Session
from finloop.stimulus.summary import load_log_table, measure_reactions_ms, measure_tick_errors_ms
from stages.stimulus_scene import FilmedScene, open_scene

GPU = ["--no-sandbox", "--enable-unsafe-swiftshader"]
RATE_HZ = 60.0  # rate of the tracker
MESSAGES = 10_000
REHEARSAL = {
    "version": 1, "name": "-", "seed": 0,
    "conditions": {"-": {"seconds": 1.0, "motion": {"wander": True}}},
}  # fmt: skip
Row = tuple[str, str, str, float]


class Live(NamedTuple):
    """A running session: its program, address, display, folder and UDP ports."""

    program: psutil.Process
    address: str
    page: Page
    folder: Path
    ports: tuple[int, int]  # for messages as JSON, and as OSC
    udp: socket.socket

    def send(self, text: bytes, osc: bool = False) -> None:
        """Send a tracker's message by UDP, to the port for JSON or to that for OSC."""
        self.udp.sendto(text, ("127.0.0.1", self.ports[osc]))


def free_ports(port_count: int) -> list[int]:
    """Return free UDP ports."""
    ports = []
    for _ in range(port_count):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
            server.bind(("127.0.0.1", 0))
            ports.append(server.getsockname()[1])
    return ports


@contextmanager
def run_session(protocol: dict[str, Any], *options: str) -> Iterator[Live]:
    """Run a session with a display; at the end of the block it ends and leaves its file."""
    json_port, osc_port = free_ports(2)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        folder = Path(name)
        plan = folder / "protocol.yaml"
        plan.write_text(yaml.safe_dump({"version": 1, "display": {"calibrated": False}} | protocol))
        command = [sys.executable, "-m", "stages.stimulus", "show", str(plan), "--no-open"]
        command += ["--port", "0", "--out", name, *options]
        command += ["--udp", str(json_port), "--osc", str(osc_port)]
        program = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL)
        address = ""
        for line in program.stderr or ():
            if match := re.search(rb"http://([\d.:]+)/", line):
                address = match[1].decode()
                break
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=GPU)
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(f"http://{address}/show")
        page.wait_for_timeout(3000)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            ports = json_port, osc_port
            yield Live(psutil.Process(program.pid), address, page, folder, ports, udp)
        browser.close()
        program.send_signal(2)
        program.wait(60)


def connect_page(address: str, page: str) -> ClientConnection:
    """Return a connection to a server as one of its pages makes it, such as "experimenter"."""
    return connect(
        f"ws://{address}/{page}", origin=Origin(f"http://{address}"),
        compression=None, max_queue=4, max_size=None,
    )  # fmt: skip


def run_through(live: Live, meanwhile: Callable[[float], None], step_s: float) -> None:
    """Start a session, and call `meanwhile` with the time every `step_s` until it is done."""
    with connect_page(live.address, "experimenter") as page:
        state = json.loads(page.recv())
        page.send('{"do":"start"}')
        due = time.perf_counter()
        while state["phase"] != "done":
            meanwhile(time.perf_counter())
            due += step_s
            while True:
                waiting_s = due - time.perf_counter()
                try:
                    state = json.loads(page.recv(timeout=max(waiting_s, 0.0)))
                except TimeoutError:
                    break


def finish_session(session: Live) -> SessionRecord:
    """End a session after its trials; return its file, opened."""
    session.page.close()
    session.program.send_signal(2)
    session.program.wait(60)
    return open_session_record(next(session.folder.glob("*.parquet")))


class Swimmer:
    """A simulated live animal that darts, as a tracker reports it."""

    def __init__(self, live: Live, size: tuple[float, float]) -> None:
        """Put the animal into a tank of a size, width and height in px."""
        self._live, self._size, self._begin = live, size, time.perf_counter()
        self._rng = np.random.default_rng(0)
        self._place = np.array([0.5, 0.5])

    def __call__(self, now: float) -> None:
        """Send the animal's present place to the session."""
        if self._rng.random() < 1 / RATE_HZ:
            self._place = self._rng.uniform(0.2, 0.8, 2)  # it jumps about once a second
        x, y = self._place * self._size
        self._live.send(json.dumps({
            "t": now - self._begin, "id": "1", "x": round(x, 1), "y": round(y, 1),
        }).encode())  # fmt: skip


def tank_size() -> tuple[float, float]:
    """Return width and height of the tank, px."""
    height, width = Project().background.shape[:2]
    return float(width), float(height)


def measure_closed_loop(fish: int, seconds: float) -> Iterator[Row]:
    """Yield the reaction times of fish to an animal that a tracker reports."""
    what = f"closed loop, {fish} fish, tracker {RATE_HZ:g} Hz"
    protocol = {
        "name": "loop", "seed": 1, "fish": fish, "animals": {"unit": "px"},
        "conditions": {"approach": {"seconds": seconds, "motion": {"rule": {"rule": "approach"}}}},
    }  # fmt: skip
    with run_session(protocol) as live:
        run_through(live, Swimmer(live, tank_size()), 1 / RATE_HZ)
        yield from frame_timing(what, finish_session(live))


def frame_timing(session_name: str, record: SessionRecord) -> Iterator[Row]:
    """Yield the timing of frames in a session's file, as rows of the table."""
    table = load_log_table(record)
    planned, drawn = measure_reactions_ms(table, record.header["rate_hz"])
    for name, values in (("planned reaction", planned), ("drawn frame", drawn)):
        if len(values):
            for share in (50, 99, 100):
                value = float(np.percentile(values, share))
                yield session_name, f"input to {name}, percentile {share}", "ms", value
            yield session_name, f"input to {name}, so many", "1", len(values)
    error_ms = float(measure_tick_errors_ms(table).std())
    yield session_name, "ticks against the clock, SD", "ms", error_ms
    frames = table[(table["kind"] == "frame") & table["trial"].notna()]
    seconds = float(frames["time_s"].iloc[-1] - frames["time_s"].iloc[0])
    yield session_name, "displayed frames", "1/s", (len(frames) - 1) / seconds
    yield session_name, "dropped frames", "1", float(frames["dropped"].sum())
    yield session_name, "displayed in all", "1", len(frames)
    drawing_ms = float((1e3 * (frames["drawn_s"] - frames["time_s"])).quantile(0.99))
    yield session_name, "drawn after the frame began, percentile 99", "ms", drawing_ms


def measure_long_show(fish: int, minutes: float) -> Iterator[Row]:
    """Yield frames and memory of a motion known beforehand, over a long time."""
    what = f"known motion, {fish} fish, {minutes:g} min"
    protocol = {
        "name": "long", "seed": 1, "fish": fish, "pause_s": 0.5, "repeats": max(1, round(minutes)),
        "conditions": {"wander": {"seconds": 60, "motion": {"wander": True}}},
    }  # fmt: skip
    memory: list[float] = []
    with run_session(protocol) as live:
        begin = time.perf_counter()
        run_through(live, lambda now: memory.append(live.program.memory_info().rss / 2**20), 1.0)
        took = time.perf_counter() - begin
        heap = live.page.evaluate("performance.memory ? performance.memory.usedJSHeapSize : 0")
        record = finish_session(live)
        yield what, "took", "s", took
        yield from frame_timing(what, record)
        quarter = len(memory) // 4
        yield what, "memory of the server, second quarter", "MiB", float(
            np.median(memory[quarter : 2 * quarter]))  # fmt: skip
        yield what, "memory of the server, last quarter", "MiB", float(np.median(memory[-quarter:]))
        yield what, "memory of the page's script at the end", "MiB", heap / 2**20
        yield what, "file of the session", "MB", record.path.stat().st_size / 1e6


def displayed_speeds(record: SessionRecord) -> np.ndarray:
    """Return the speed (n,) of a single fish between displayed frames, px/s."""
    steps, last = [], None
    for frame in read_displayed_frames(record):
        is_visible = len(frame.states) and frame.states[0, PICTURE] >= 0
        present = (frame.shown_s, frame.states[0, [X, Y]].astype(float)) if is_visible else None
        if last is not None and present is not None:
            steps.append(float(np.hypot(*(present[1] - last[1]))) / (present[0] - last[0]))
        last = present
    return np.array(steps)


def measure_poor_input() -> Iterator[Row]:
    """Yield the steps of fish that follow an animal with lost, late or missing input."""
    seconds, steps = 60.0, {}
    conditions = {
        "wander": {"seconds": seconds, "motion": {"wander": True}},
        "follow": {"seconds": seconds, "motion": {"rule": {"rule": "follow"}}},
    }
    options = ["--animal", "track:0", "--loss", "0.2", "--jitter", "0.05", "--gap", "2"]
    for name, condition in conditions.items():
        protocol = {"name": name, "seed": 1, "conditions": {name: condition}}
        with run_session(protocol | {"animals": {"unit": "px"}}, *options) as live:
            run_through(live, lambda now: None, 1.0)
            steps[name] = displayed_speeds(finish_session(live))
    for name, values in steps.items():
        what = f"one fish, {name}, 20 % lost, 50 ms jitter, gaps of 2 s"
        for share in (50, 99.9, 100):
            value = float(np.percentile(values, share) / steps["wander"].max())
            measure = f"step between frames / greatest of wander, percentile {share:g}"
            yield what, measure, "1", value


def hostile_texts(count: int, seed: int) -> Iterator[bytes]:
    """Yield random bytes, and valid messages with changed bytes."""
    rng, good = np.random.default_rng(seed), b'{"t":1.5,"id":"1","x":100.0,"y":80.0,"heading":12}'
    for _ in range(count):
        if rng.integers(3) == 0:
            yield rng.bytes(300)
            continue
        text = bytearray(good)
        for _ in range(int(rng.integers(1, 5))):
            text[rng.integers(len(text))] = rng.integers(0, 256)
        yield bytes(text)


def send_hostile_messages() -> Iterator[Row]:
    """Send hostile messages to every input during a trial; yield the effects."""
    what = f"{MESSAGES} hostile messages on each of five inputs"
    protocol = {
        "name": "flood", "seed": 1, "animals": {"unit": "px"},
        "conditions": {"avoid": {"seconds": 120, "motion": {"rule": {"rule": "avoid"}}}},
    }  # fmt: skip
    with run_session(protocol) as live:
        with connect_page(live.address, "experimenter") as page:
            page.send('{"do":"start"}')
            page.recv()
        for turn in range(2):  # the first time warms up; memory counts from the second on
            before = live.program.memory_info().rss / 2**20
            for text in hostile_texts(MESSAGES, turn):
                live.send(text)
                live.send(text, osc=True)
            for path in ("animals", "display", "experimenter"):
                with connect_page(live.address, path) as page:
                    for number, text in enumerate(hostile_texts(MESSAGES, turn)):
                        page.send(text.decode("latin-1") if number % 2 else text)
                        if path == "experimenter" and number % 20 == 0:
                            page.recv()
        growth = live.program.memory_info().rss / 2**20 - before
        with connect_page(live.address, "experimenter") as page:
            refused = json.loads(page.recv())["heard"].get("malformed", 0)
            page.send('{"do":"abort"}')
        record = finish_session(live)
        yield what, "memory that they took", "MiB", growth
        yield what, "positions refused", "1", refused
        yield from frame_timing(what, record)


def run_random_session(
    scene: FilmedScene, seed: int, folder: Path
) -> tuple[SessionRecord, Protocol]:
    """Run a session of two trials with poor input, without a display, from a seed."""
    rng = np.random.default_rng(seed)
    rules = rng.choice(get_args(RuleSpec.model_fields["rule"].annotation), 2, replace=False)
    plan = parse_protocol({
        "version": 1, "name": "random", "seed": seed, "fish": int(rng.integers(1, 4)),
        "display": {"calibrated": False}, "animals": {"unit": "px"},
        "conditions": {str(rule): {"seconds": 2.0, "motion": {"rule": {"rule": str(rule)}}}
                       for rule in rules},
    })  # fmt: skip
    messages, place = [], rng.uniform(0, 1, 2)
    for number in range(300):
        if rng.random() < 0.05:
            place = rng.uniform(0, 1, 2)
        x, y = place * (scene.context.tank.width, scene.context.tank.height)
        text = json.dumps({"t": number / 50, "id": 1, "x": float(x), "y": float(y)})
        if rng.random() > 0.2:
            messages.append(TimedMessage(number / 50 + rng.uniform(0, 0.05), text))
    order, path = order_trials(plan), folder / f"{seed}.journal"
    log, clock = Log(path, scene.header(plan, order, display=None)), DryClock(sorted(messages))
    session = Session(scene.context, plan, order, scene.feed([], plan.fish), log, clock)
    clock.receive, session.waits_for_starts = session.receive_message, False
    session.start()
    asyncio.run(session.run_trials())
    log.close()
    save_journal(path, path.with_suffix(".parquet"), SESSION)
    return open_session_record(path.with_suffix(".parquet")), plan


def replay_sessions() -> Iterator[Row]:
    """Yield whether random sessions stay equal when replayed from their files."""
    what, ticks, anew, different = "100 random sessions, planned again", 0, 0, 0
    with open_scene(parse_protocol(REHEARSAL)) as scene, tempfile.TemporaryDirectory() as name:
        for seed in range(100):
            record, plan = run_random_session(scene, seed, Path(name))
            replay = replan_session(record, scene.context, plan)
            ticks, different = ticks + replay.ticks, different + replay.different
            anew += sum(row["verdict"] == "anew" for row in record.read_rows("tick"))
    yield what, "ticks", "1", ticks
    yield what, "of them anew, as an animal had moved", "1", anew
    yield what, "ticks that differ", "1", different


def main() -> None:
    """Print and write the table of the stimulus."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--part", choices=["loop", "long", "flood", "spoiled", "replays"])
    options = parser.parse_args()
    parts: dict[str, Callable[[], Iterator[Row]]] = {
        "loop": lambda: iter([*measure_closed_loop(1, 60), *measure_closed_loop(8, 60)]),
        "flood": send_hostile_messages,
        "spoiled": measure_poor_input,
        "replays": replay_sessions,
        "long": lambda: measure_long_show(8, options.minutes),
    }
    rows = [row for name in ([options.part] if options.part else parts) for row in parts[name]()]
    table = pd.DataFrame(rows, columns=["where", "what", "unit", "value"])
    write_table(__file__, table, "%.4g", part="where" if options.part else None)
    wanted = "planned ≤ 5 ms, drawn ≤ 33 ms (99 %), ticks ≤ 1 ms SD; 60 frames/s, none dropped"
    print(f"wanted: {wanted}\n{os.cpu_count()} cores, software WebGL")


if __name__ == "__main__":
    main()
