"""The live tank: the time of a tick, the delay of a goal, the effect of hostile messages.

`python -m benchmarks.play` prints the table and writes benchmarks/play.csv. Four fish in mode
`matching` get a new goal every second: on a drawn carp in colour at 1280×720, and on the results in
data/. A tick is planned for every fish and made into messages; the page draws it.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import json
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import psutil
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from benchmarks.animate import STAGES
from benchmarks.pipeline import ROOT, prepare_folder, run_stage, write_table
from finloop.live.message import SetGoal
from finloop.live.server import TankHub, create_tank_server
from finloop.live.view import TankView
from finloop.show.web import bind_socket
from stages.play import open_view

FISH, TICKS, CLICKS, MESSAGES = 4, 3000, 60, 10_000
SIZE = ["clip=carp", "clip.width_px=1280", "clip.height_px=720", "clip.frames=750"]
Row = tuple[str, str, str, float]


@contextmanager
def serve_tank(view: TankView) -> Iterator[ClientConnection]:
    """Run the server in a thread; yield the connection of a page."""
    with bind_socket(0) as listens:
        up, address = threading.Event(), f"127.0.0.1:{listens.getsockname()[1]}"
        server = create_tank_server(view, listens, up.set)
        runs = threading.Thread(target=server.serve_until_stopped)
        runs.start()
        up.wait()
        try:
            where, origin = f"ws://{address}/tank", Origin(f"http://{address}")
            with connect(where, origin=origin, compression=None) as page:
                yield page
        finally:
            server.should_exit = True
            runs.join()


def time_ticks(view: TankView) -> np.ndarray:
    """Return of every tick (n, 3): wall time and processor time [ms], kB of its messages."""
    hub, rng, took = TankHub(view), np.random.default_rng(0), []
    height, width = view.feed.tank.floor.shape[:2]
    for number in range(TICKS):
        wishes = []
        if number % 25 == 0:
            which, x, y = int(rng.integers(FISH)), rng.uniform(0, width), rng.uniform(0, height)
            wishes.append(SetGoal(do="goal", fish=which, x=float(x), y=float(y), drag=False))
        start = time.perf_counter(), time.process_time()
        size = sum(map(len, hub.make_frame(list(wishes), 0, 1)))
        took.append((time.perf_counter() - start[0], time.process_time() - start[1], size / 1e6))
    return 1e3 * np.array(took)


def receive_state(page: ClientConnection, known: dict[str, Any]) -> dict[str, Any]:
    """Receive messages up to the next state, and return it; known: what was told before."""
    while True:
        message = page.recv(timeout=10, decode=False)
        facts = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
        known[facts["kind"]] = facts.get(facts["kind"])
        if facts["kind"] == "tank":
            return facts["tank"]


def time_reactions(page: ClientConnection, width: int, height: int) -> np.ndarray:
    """Return the milliseconds from a click to the first tick with a new decision.

    width, height: of the tank, px.
    """
    rng, took, known = np.random.default_rng(1), [], dict[str, Any]()
    state = receive_state(page, known)
    for _ in range(CLICKS):
        for _ in range(int(rng.integers(1, 12))):
            state = receive_state(page, known)
        x, y = (rng.uniform(0.2, 0.8) * side for side in (width, height))
        start, tick = time.perf_counter(), state["tick"]
        page.send(json.dumps({"do": "goal", "fish": 0, "x": x, "y": y, "drag": False}))
        while True:
            state = receive_state(page, known)
            goal, decision = state["fish"][0]["goal"], known["decision"]
            if goal and abs(goal[0] - x) < 40 and decision and decision["tick"] > tick:
                break
        took.append(1e3 * (time.perf_counter() - start))
    return np.array(took)


def send_random_messages(page: ClientConnection) -> tuple[float, float, int]:
    """Send random messages; return messages per second, memory growth (MiB), bad messages."""
    rng, good = np.random.default_rng(2), b'{"do":"goal","fish":0,"x":10,"y":20,"drag":true}'
    messages: list[bytes | str] = []
    for _ in range(MESSAGES):
        text = bytearray(good)
        for _ in range(int(rng.integers(0, 4))):
            text[rng.integers(len(text))] = rng.integers(32, 127)
        messages.append(rng.bytes(300) if rng.integers(3) == 0 else text.decode())
    process, before, start = psutil.Process(), 0.0, 0.0
    for _ in range(2):  # the first time warms up
        before, start = process.memory_info().rss / 2**20, time.perf_counter()
        bad = receive_state(page, {})["bad"]
        for number, message in enumerate(messages):
            page.send(message)
            if number % 50 == 0:
                receive_state(page, {})
    took = time.perf_counter() - start
    growth = process.memory_info().rss / 2**20 - before
    return MESSAGES / took, growth, receive_state(page, {})["bad"] - bad


def measure_view(view_name: str) -> Iterator[Row]:
    """Yield the rows of the table for the results in the current folder."""
    with open_view("matching", FISH, 0) as view:
        time_ticks(view)  # compiles, and fills the caches
        took = time_ticks(view)
        height, width = view.feed.tank.floor.shape[:2]
        size = f"{width}×{height}"
        view_name = f"{view_name}, {size}, {FISH} fish"
        yield view_name, "ticks that could be shown", "1/s", 1e3 / took[:, 0].mean()
        for share in (50, 99, 100):
            wall, work, kilobytes = np.percentile(took, share, axis=0)
            yield view_name, f"a tick, percentile {share}", "ms", float(wall)
            yield view_name, f"its processor time, percentile {share}", "ms", float(work)
            yield view_name, f"its messages, percentile {share}", "kB", float(kilobytes)
        with serve_tank(view) as page:
            reaction = time_reactions(page, width, height)
            yield view_name, "click to reaction, median", "ms", float(np.median(reaction))
            yield view_name, "click to reaction, longest", "ms", float(reaction.max())
            rate, growth, bad = send_random_messages(page)
            yield view_name, f"{MESSAGES} hostile messages", "1/s", rate
            yield view_name, "of them refused", "1", bad
            yield view_name, "memory that they took", "MiB", growth


def main() -> None:
    """Print and write the table of the live tank."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        prepare_folder(scratch, SIZE)
        for word in STAGES:
            run_stage(scratch, word)
        with chdir(scratch):
            rows = list(measure_view("drawn carp, colour"))
    if (ROOT / "data/gateways").exists():
        with tempfile.TemporaryDirectory() as name, chdir(name):
            prepare_folder(Path(name), [])
            Path("data").symlink_to(ROOT / "data")
            rows += measure_view("results in data/")
    table = pd.DataFrame(rows, columns=["where", "what", "unit", "value"])
    write_table(__file__, table, "%.4g")
    print(f"wanted: 60 ticks/s; percentile 99 ≤ 16 ms; reaction ≤ 100 ms; {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
