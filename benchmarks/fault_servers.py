"""Servers under attack: ticks, memory and journal while strangers send and connect.

`python -m benchmarks.fault_servers` prints the table and writes benchmarks/fault_servers.csv, for
the results in data/. The live tank and a session with a display run as a user starts them. Each is
left alone, gets 100,000 hostile messages on all its inputs, and then 1,000 connections that are
silent, stop within a request, or send nonsense, all of it twice: the first time fills caches. A
page that is no attacker counts the ticks that reach it, as many a second as the film has frames;
a display draws 60 frames a second of them by itself. `--only tank` or `--only stimulus` runs one.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

import argparse
import json
import random
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from http.client import HTTPConnection, HTTPException
from typing import NamedTuple

import pandas as pd
import psutil
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from benchmarks.pipeline import write_table
from benchmarks.stimulus import Live, connect_page, finish_session, hostile_texts, run_session
from finloop.live.server import MOST_PAGES

MESSAGES, CONNECTIONS, HELD, ASKED = 100_000, 1000, 200, 20
QUIET_S = 8.0
READY = {
    "do": "ready", "page": "counter", "width": 1280, "height": 720, "ratio": 1,
    "renderer": "-", "agent": "-",
}  # fmt: skip
Row = tuple[str, str, str, float]


class Tank(NamedTuple):
    """A running live tank: its program and its address."""

    program: psutil.Process
    address: str


@contextmanager
def run_tank() -> Iterator[Tank]:
    """Run the live tank."""
    command = [sys.executable, "-m", "stages.play", "--no-open", "--port", "0"]
    program = subprocess.Popen(command, stderr=subprocess.PIPE)
    address = ""
    for line in program.stderr or ():
        if match := re.search(rb"open at http://([\d.:]+)/", line):
            address = match[1].decode()
            break
    try:
        yield Tank(psutil.Process(program.pid), address)
    finally:
        program.send_signal(2)
        program.wait(60)


class TickCounter:
    """A page that counts the ticks that reach it, in a thread."""

    def __init__(self, address: str, page: str, greeting: str = "") -> None:
        """Begin to count on a page of a server; greeting: its first message, "" for none."""
        self.ticks = 0
        self._address, self._page, self._greeting = address, page, greeting
        threading.Thread(target=self._take_messages, daemon=True).start()

    def _take_messages(self) -> None:
        """Take messages until the page is closed; acknowledge the live tank's."""
        with suppress(ConnectionClosed), connect_page(self._address, self._page) as page:
            if self._greeting:
                page.send(self._greeting)
            while True:
                message = page.recv(decode=False)
                facts = json.loads(message[4 : 4 + int.from_bytes(message[:4], "little")])
                if "frame" in facts:
                    page.send(json.dumps({"do": "seen", "frame": facts["frame"]}))
                    self.ticks += 1
                self.ticks += facts.get("kind") == "rows" and not facts["cut"]


def send_all(connection: ClientConnection, count: int, seed: int) -> None:
    """Send hostile messages to a WebSocket, and throw away what comes back."""
    with connection as page:

        def drain() -> None:
            """Take what the server sends until the connection ends."""
            with suppress(ConnectionClosed):
                for _ in page:
                    pass

        threading.Thread(target=drain, daemon=True).start()
        for number, text in enumerate(hostile_texts(count, seed)):
            page.send(text.decode("latin-1") if number % 2 else text)


def attack_tank(tank: Tank, seed: int) -> None:
    """Send hostile messages to the live tank, from all pages that it admits beside the counter."""
    pages = MOST_PAGES - 1
    with ThreadPoolExecutor(pages) as attackers:
        for sent in [
            attackers.submit(
                send_all, connect_page(tank.address, "tank"), MESSAGES // pages, seed + n
            )
            for n in range(0, 2 * pages, 2)
        ]:
            sent.result()


def attack_session(live: Live, seed: int) -> None:
    """Send hostile messages to a session: 60 % of them by UDP and OSC."""
    for text in hostile_texts(3 * MESSAGES // 10, seed):
        live.send(text)
        live.send(text, osc=True)
    for path, share in (("animals", 2), ("display", 1), ("experimenter", 1)):
        send_all(connect_page(live.address, path), share * MESSAGES // 10, seed)


def hold_connections(address: str, page: str) -> tuple[int, float]:
    """Open hostile connections, HELD at a time; return how many requests were answered meanwhile.

    The second number is the longest that one took, s. page: the path that is asked for.
    """
    host, port = address.split(":")
    choose, held, answered, longest = random.Random(0), list[socket.socket](), 0, 0.0
    for number in range(CONNECTIONS):
        with suppress(OSError):
            held.append(socket.create_connection((host, int(port)), timeout=30))
            held[-1].sendall(choose.choice((b"", b"GET / HTTP/1.1\r\nHost:", choose.randbytes(99))))
        if len(held) > HELD:
            held.pop(0).close()
        if number % (CONNECTIONS // ASKED) == 0:
            begin = time.perf_counter()
            with suppress(OSError, HTTPException):
                asks = HTTPConnection(address, timeout=30)
                asks.request("GET", page)
                answered += asks.getresponse().status == 200
                asks.close()
            longest = max(longest, time.perf_counter() - begin)
    for connection in held:
        connection.close()
    return answered, longest


def attack_server(
    name: str, program: psutil.Process, address: str, page: str,
    attack: Callable[[int], None], counter: TickCounter,
) -> Iterator[Row]:  # fmt: skip
    """Yield the rows of one server. page: a path for requests. attack: takes a seed."""

    def measure_rate(work: Callable[[], object]) -> tuple[float, float]:
        """Do some work; return the ticks per second meanwhile, and how long it took [s]."""
        ticks, begin = counter.ticks, time.perf_counter()
        work()
        took = time.perf_counter() - begin
        return (counter.ticks - ticks) / took, took

    for turn in range(2):
        quiet, _ = measure_rate(lambda: time.sleep(QUIET_S))
        memory = program.memory_info().rss / 2**20
        attacked, took = measure_rate(lambda turn=turn: attack(turn))  # type: ignore[misc]
        answers = list[tuple[int, float]]()
        held, _ = measure_rate(lambda: answers.append(hold_connections(address, page)))  # noqa: B023
    yield name, "ticks, left alone", "1/s", quiet
    yield name, f"ticks amid {MESSAGES} hostile messages", "1/s", attacked
    yield name, "messages", "1/s", MESSAGES / took
    yield name, f"ticks amid {CONNECTIONS} hostile connections", "1/s", held
    yield name, f"requests answered, of {ASKED}", "1", answers[0][0]
    yield name, "longest request", "s", answers[0][1]
    growth = program.memory_info().rss / 2**20 - memory
    yield name, "memory that the second turn took", "MiB", growth
    yield name, "open files", "1", program.num_fds()


def measure_tank() -> Iterator[Row]:
    """Yield the rows of the live tank, one fish."""
    with run_tank() as tank:
        yield from attack_server(
            "live tank", tank.program, tank.address, "/", lambda turn: attack_tank(tank, turn),
            TickCounter(tank.address, "tank"),
        )  # fmt: skip


def measure_session() -> Iterator[Row]:
    """Yield the rows of a session with a display, one fish that avoids a live animal."""
    protocol = {
        "name": "attack", "seed": 1, "animals": {"unit": "px"},
        "conditions": {"avoid": {"seconds": 600, "motion": {"rule": {"rule": "avoid"}}}},
    }  # fmt: skip
    with run_session(protocol) as live:
        counter = TickCounter(live.address, "display", json.dumps(READY))
        with connect_page(live.address, "experimenter") as page:
            page.recv()
            page.send('{"do":"start"}')
            while json.loads(page.recv())["phase"] != "running":
                pass
        yield from attack_server(
            "stimulus", live.program, live.address, "/show",
            lambda turn: attack_session(live, turn), counter,
        )  # fmt: skip
        with connect_page(live.address, "experimenter") as page:
            refused = json.loads(page.recv())["heard"]
            page.send('{"do":"abort"}')
            while json.loads(page.recv())["phase"] != "done":
                pass
        table = pq.read_table(finish_session(live).path)
        rows = table.filter(pc.is_in(table["kind"], pa.array(["input", "event"])))
        stream = pa.BufferOutputStream()
        with pa.ipc.new_stream(stream, rows.schema) as writer:
            writer.write_table(rows)
        yield "stimulus", "messages of trackers, by verdict", "1", float(sum(refused.values()))
        yield "stimulus", "inputs and events in the journal", "1", rows.num_rows
        yield "stimulus", "… their size", "MiB", stream.getvalue().size / 2**20


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", choices=("tank", "stimulus"))
    only = parser.parse_args().only
    rows = list[Row]()
    if only != "stimulus":
        rows += measure_tank()
    if only != "tank":
        rows += measure_session()
    table = pd.DataFrame(rows, columns=["server", "what", "unit", "value"])
    write_table(__file__, table, "%.4g", part="server")


if __name__ == "__main__":
    main()
