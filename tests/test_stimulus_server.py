"""The pages and inputs of a session over the wire: strangers, hostile messages, a real browser."""

import asyncio
import errno
import json
import resource
import socket
import subprocess
import sys
from argparse import Namespace
from contextlib import contextmanager, suppress
from functools import partial
from http.client import HTTPConnection
from itertools import product
from unittest.mock import Mock

import numpy as np
import psutil
import pytest
from browser import chromium
from conftest import PATIENCE_S, wait_for
from hostile import count_objects, hostile_messages
from pythonosc.osc_message_builder import OscMessageBuilder
from serving import serving
from toy_stimulus import feed_of, plan_of, session_of
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import stages.stimulus
from finloop.io.journal import save_journal
from finloop.show import web
from finloop.show.web import MOST_PLAIN, AccessPolicy, AppServer, PlainConnection, bind_socket
from finloop.stimulus.desk import handle_request, session_status
from finloop.stimulus.inputs import receive_datagrams
from finloop.stimulus.log import SESSION
from finloop.stimulus.replay import open_session_record, read_displayed_frames, replan_session
from finloop.stimulus.serve import (
    ReplayHub,
    SessionHub,
    create_display_server,
    create_session_server,
    parse_display_message,
)
from finloop.stimulus.session import RealClock
from finloop.stimulus.summary import summarise_session

CONDITIONS = {
    "known": {"seconds": 0.8, "motion": {"goals": [[0.2, 0.2], [0.8, 0.8]]}},
    "live": {
        "seconds": 0.8,
        "motion": {"rule": {"rule": "approach"}},
        "look": {"as": "silhouette"},
    },
}
READY = {
    "do": "ready",
    "page": "a",
    "width": 1280,
    "height": 720,
    "ratio": 1,
    "renderer": "r",
    "agent": "a",
}


@contextmanager
def running(
    folder, token=None, digest=False, listens_at="127.0.0.1", inputs=list, draws=True, **plan
):
    """A session that is served; its file is there when the block ends.

    inputs: takes the session; makes the tasks that receive messages by other ways. draws: whether
    the session is told that a display shows frames; else a test has one.
    """
    plan = plan_of(plan.pop("conditions", CONDITIONS), **plan)
    session, _ = session_of(folder, plan, RealClock())
    session.feed.facts["digest"] = digest
    if draws:
        session.is_display_drawing = lambda: True
    room = SessionHub(session, "toy", folder / "display.json")
    session.connect_outputs(room.send, room.send_trigger)

    def make_server(listens, port, started):
        tasks = list if inputs is list else partial(inputs, session)
        return create_session_server(listens, AccessPolicy(port, token), room, tasks, started)

    with serving(make_server, host=listens_at) as (address, server):
        session.server = server
        yield address, session
    session.log.close()
    save_journal(folder / "toy.journal", folder / "toy.parquet", SESSION)


def way_in(address, path, origin=True, **how):
    origin = f"http://{address}" if origin is True else origin
    return connect(f"ws://{address}/{path}", origin=origin, compression=None, **how)


# --- strangers


def test_only_its_own_pages_and_programs_are_let_in(tmp_path):
    with running(tmp_path) as (address, _):
        elsewhere = "http://elsewhere.example"
        wrong = product(("experimenter", "display"), (None, elsewhere, f"https://{address}"))
        for path, origin in (*wrong, ("animals", elsewhere)):
            with pytest.raises(InvalidStatus), way_in(address, path, origin):
                pass
        for path, origin in (("experimenter", True), ("display", True), ("animals", None)):
            with way_in(address, path, origin):  # a program has no origin
                pass


def test_whoever_comes_from_another_machine_shows_the_token(tmp_path):
    with running(tmp_path, token="secret") as (address, _):
        for token in ("", "?token=", "?token=secre", "?token=s%C3%A9"):
            with pytest.raises(InvalidStatus), way_in(address, f"animals{token}", None):
                pass
        for path, origin in (("animals", None), ("display", True)):
            with way_in(address, f"{path}?token=secret", origin):
                pass


def test_an_address_for_others_lets_in_only_who_shows_the_token(tmp_path):
    """Pages, WebSockets, UDP and OSC, as with --listen, at another address of this machine."""
    options = Namespace(listen="127.0.0.2")
    with bind_socket(0, options.listen) as other:
        policy = stages.stimulus._access_policy(options, other)
        link = stages.stimulus._page_address(options, other, policy, "show")
    assert link.endswith(f"/show?token={policy.token}") and len(policy.token) > 20
    ports, sockets = {}, {}
    for kind in ("udp", "osc"):
        sockets[kind] = bind_socket(0, options.listen, socket.SOCK_DGRAM)
        ports[kind] = sockets[kind].getsockname()

    def receive(session):
        return [
            receive_datagrams(bound, kind, session.receive_message, policy.token)
            for kind, bound in sockets.items()
        ]

    sighting = {"t": 1.0, "id": 1, "x": 30.0, "y": 30.0}
    with running(tmp_path, policy.token, listens_at=options.listen, inputs=receive) as (
        at,
        session,
    ):
        for query, status in (("", 421), ("?token=x", 421), (f"?token={policy.token}", 200)):
            page = HTTPConnection(at)
            page.request("GET", f"/show{query}")
            answer = page.getresponse()
            assert answer.status == status and (b"<script>" in answer.read()) == (status == 200)
            page.close()
        with pytest.raises(InvalidStatus), way_in(at, "animals", None):
            pass
        with way_in(at, f"animals?token={policy.token}", None) as tracker:
            tracker.send(json.dumps(sighting))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
            for number, token in enumerate((None, "x", policy.token)):
                shown = {} if token is None else {"token": token}
                out.sendto(json.dumps(sighting | {"id": 2} | shown).encode(), ports["udp"])
                message = OscMessageBuilder("/finloop/animal")
                for value in ([] if token is None else [token]) + [1.0, number + 3, 30.0, 30.0]:
                    message.add_arg(value)
                out.sendto(message.build().dgram, ports["osc"])
        heard = session.counts.verdicts
        assert wait_for(lambda: heard.total() == 7) and heard["taken"] == 3
    record = open_session_record(tmp_path / "toy.parquet")
    assert policy.token not in str(list(record.read_rows("input", "event")))


# --- silent and idle connections

OPEN = """
import socket, sys
host, port, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
sys.stdin.readline()
held = [socket.create_connection((host, port)) for _ in range(count)]
print("open", flush=True)
sys.stdin.read()
"""


def get_page(address):
    page = HTTPConnection(address, timeout=PATIENCE_S)
    try:
        page.request("GET", "/show")
        return page.getresponse().status
    finally:
        page.close()


def test_silent_connections_do_not_stop_requests(tmp_path, capfd):
    """Two hundred of them, where the program may open sixty files more than it has."""
    most, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with running(tmp_path) as (address, session):
        command = [sys.executable, "-c", OPEN, *address.split(":"), "200"]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as silent:
            few = psutil.Process().num_fds() + 60
            resource.setrlimit(resource.RLIMIT_NOFILE, (few, hard))
            try:
                silent.stdin.write(b"\n")
                silent.stdin.flush()
                assert silent.stdout.readline() == b"open\n"
                for _ in range(5):
                    assert get_page(address) == 200
                with way_in(address, "animals", None) as way:
                    way.send('{"t": 1.0, "id": 1, "x": 30.0, "y": 30.0}')
                    assert wait_for(lambda: session.counts.verdicts.total())
                connections = session.server.server_state.connections.copy()
                assert sum(isinstance(one, PlainConnection) for one in connections) <= MOST_PLAIN
            finally:
                resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
                silent.kill()
    assert "Traceback" not in capfd.readouterr().err


def test_a_connection_that_asks_for_nothing_ends(tmp_path, monkeypatch):
    with running(tmp_path) as (address, _), way_in(address, "animals", None) as way:
        for sent in (b"", b"GET / HTTP/1.1\r\nHost: x"):  # nothing, and half a request
            with socket.create_connection(address.split(":"), timeout=PATIENCE_S) as silent:
                silent.sendall(sent)
                monkeypatch.setattr(web, "PATIENCE_S", 0.0)
                with suppress(ConnectionResetError):
                    assert silent.recv(1) == b""
                monkeypatch.undo()
        way.send("{")  # a WebSocket stays
        assert way.ping().wait(PATIENCE_S)


def test_who_asks_without_pause_is_not_heard_and_a_page_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(web, "_REQUESTS", 5)
    monkeypatch.setattr(web, "_REQUESTS_PER_S", 0)
    with running(tmp_path) as (address, session), way_in(address, "animals", None) as way:
        answers = []
        for _ in range(20):
            with suppress(ConnectionError):
                answers.append(get_page(address))
        assert answers == [200] * 4  # the program's own request is the fifth
        way.send('{"t": 1.0, "id": 1, "x": 30.0, "y": 30.0}')
        assert wait_for(lambda: session.counts.verdicts.total())


def test_only_connections_that_are_overdue_end():
    class Transport:
        def __init__(self, is_closing):
            self.is_closing, self.ended = lambda: is_closing, False

        def abort(self):
            self.ended = True

    with bind_socket(0) as listens:
        server = AppServer(listens, AccessPolicy(1), {}, [], list, lambda: None)
        plain = PlainConnection.__new__(PlainConnection)
        sockets = [Mock(), Mock()]
        for one, is_closing in zip((plain, *sockets), (False, False, True), strict=True):
            one.transport = Transport(is_closing)
            server.server_state.connections.add(one)
        for now_s, ended in ((5.0, [False] * 3), (14.9, [False] * 3), (15.1, [True, False, True])):
            server.end_overdue_connections(now_s)
            assert [one.transport.ended for one in (plain, *sockets)] == ended


def test_a_lack_of_files_is_said_once(capfd):
    loop = asyncio.new_event_loop()
    with bind_socket(0) as listens:
        server = AppServer(listens, AccessPolicy(1), {}, [], list, lambda: None)
        for _ in range(1000):
            server.handle_loop_error(loop, {"exception": OSError(errno.EMFILE, "too many")})
    loop.close()
    assert capfd.readouterr().err.count("\n") == 1


# --- hostile messages


GOOD = [
    READY, {"do": "ping", "sent": 1.5, "frames": 3}, {"do": "key", "key": " "}, {"do": "hidden", "on": True},
    {"do": "display", "display": {}}, {"do": "note", "text": "<b>"}, {"do": "trigger", "name": "x"},
    {"t": 1.5, "id": "1", "x": 3.0, "y": 4.0}, [{"t": 2, "id": 1, "x": 3, "y": 4}], [[[[[]]]]], None, {},
]  # fmt: skip


def test_no_message_of_a_page_breaks_the_session(tmp_path):
    session, _ = session_of(tmp_path, plan_of(CONDITIONS), RealClock())
    buttons = '"start"', '"stop"', '"abort"', '"skip"'

    def hear():
        for turn in range(6):
            for content in hostile_messages(500, turn, GOOD):
                text = content if isinstance(content, str) else None
                parse_display_message(text)
                session.record_frames(content if text is None else text.encode())
                session.receive_message(content, "a")
                if text is None or not any(button in text for button in buttons):
                    handle_request(session, text)
            session.log.write_entries()
            yield

    counts = count_objects(hear())
    assert session.phase == "ready" and session.counts.bad > 300
    heard = session.counts.verdicts
    assert heard["malformed"] + heard["flood"] > 300
    assert max(counts[3:]) - max(counts[:3]) < 300, counts
    assert json.dumps(session_status(session))
    session.log.close()


def test_hostile_messages_over_the_wire_leave_a_trial_as_it_is(tmp_path, capfd):
    with running(tmp_path) as (address, session):
        with way_in(address, "experimenter", max_queue=None) as desk:
            desk.send('{"do":"start"}')
            for path in ("display", "animals", "experimenter"):
                with way_in(address, path, max_queue=None) as way:
                    for text in hostile_messages(150, 7, GOOD):
                        if "start" not in str(text) and "abort" not in str(text):
                            way.send(text)
                for content in (b"\xff\xfe{", "x" * 200_000):  # no UTF-8; too long
                    with way_in(address, path, max_queue=None) as way:
                        with pytest.raises(ConnectionClosed):
                            way.send(content, text=True)
                            while True:
                                way.recv(timeout=PATIENCE_S)
            assert wait_for(lambda: session.phase == "done")
    assert session.done == {1: "done", 2: "done"}
    record = open_session_record(tmp_path / "toy.parquet")
    assert replan_session(record, session.context, session.protocol).different == 0
    assert "Traceback" not in capfd.readouterr().err


def ready_page(page, identity):
    page.send(json.dumps(READY | {"page": identity}))
    assert b'"hello"' in page.recv(timeout=PATIENCE_S)


def frame_record(*numbers):
    return b"".join(np.array([number, 0, 0, 0, 0, 0, 0, 0.0]).tobytes() for number in numbers)


def test_displays_are_counted_by_identity_and_frames_are_logged_in_order(tmp_path):
    """Two pages; the first is resized, connects again, and goes: its mirror becomes the display."""
    with running(tmp_path) as (address, session):
        counts = session.counts
        with way_in(address, "display") as second:
            with way_in(address, "display") as first:
                first.send(frame_record(1))  # before it is ready, it is no display
                ready_page(first, "a")
                assert wait_for(lambda: session.displays == 1)
                ready_page(second, "b")
                assert wait_for(lambda: session.displays == 2)
                assert "mirrors the display: pages 2" in session.messages[-1]
                for width in (1920, 1280, 1920):
                    size = {"width": width, "height": 1080, "ratio": 1}
                    first.send(json.dumps({"do": "resized"} | size))
                    assert wait_for(lambda at=width: session.display["width"] == at)
                second.send(json.dumps({"do": "key", "key": "x"}))  # a mirror's key is not heard
                second.send(json.dumps({"do": "hidden", "on": True}))
                second.send(frame_record(40, 41))  # a mirror's
                first.send(frame_record(2, 3))
                assert wait_for(lambda: counts.frames == 2)
                with way_in(address, "display") as again:
                    ready_page(again, "a")
                    with pytest.raises(ConnectionClosed):
                        while True:
                            first.recv(timeout=PATIENCE_S)
                    assert session.displays == 2 and session.display["page"] == "a"
                    again.send(frame_record(3, 4, 5))  # one of them twice
                    assert wait_for(lambda: counts.frames == 4) and counts.bad == 1
            assert wait_for(lambda: session.display["page"] == "b")
            assert session.displays == 1 and session.display["hidden"]
            second.send(frame_record(43, 44))
            assert wait_for(lambda: counts.frames == 6)
        assert wait_for(lambda: session.displays == 0) and session.display is None
    record = open_session_record(tmp_path / "toy.parquet")
    assert not [row for row in record.read_rows("event") if '"key"' in row["text"]]
    # The parity stays, which the photodiode's square shows.
    assert [row["number"] for row in record.read_rows("frame")] == [2, 3, 4, 5, 7, 8]
    [_, shown] = summarise_session(record).split("## Display")
    assert shown.partition("## Timing")[0].count("1280 × 720 px") == 2


def test_a_calibration_changes_what_is_said_of_the_screen(tmp_path):
    session, _ = session_of(tmp_path, plan_of(CONDITIONS), RealClock())
    said = iter([None, ("it shows all", False), ("it shows a part", True)])
    hub = SessionHub(session, "toy", tmp_path / "display.json", lambda: next(said))
    assert session_status(session)["screen"] is None
    display = {"width_px": 9, "height_px": 9, "ratio": 1, "refresh_hz": 60.0}
    for words in ("it shows all", "it shows a part"):
        message = parse_display_message(json.dumps({"do": "display", "display": display}))
        hub.handle_message(Mock(), message)
        assert session_status(session, with_constants=False)["screen"][0] == words
    session.log.close()


def test_start_is_refused_until_the_display_reports_frames(tmp_path):
    with running(tmp_path, draws=False) as (address, session):
        desk = way_in(address, "experimenter", max_queue=None)
        with desk, way_in(address, "display", max_queue=None) as page:
            refused = iter(range(1, 9))

            def assert_refused():
                desk.send('{"do":"start"}')
                number = next(refused)
                assert wait_for(lambda: len(session.messages) == number)
                assert "no display shows frames" in session.messages[-1]
                assert session.phase == "ready"

            assert_refused()  # nothing is connected yet but a page that is not ready
            page.send(json.dumps(READY))
            page.send(json.dumps({"do": "ping", "sent": 1.0, "frames": 0}))
            assert wait_for(lambda: session.display)
            assert_refused()  # it is there, and draws nothing
            page.send(json.dumps({"do": "ping", "sent": 2.0, "frames": 30}))
            assert wait_for(session.is_display_drawing)
            desk.send('{"do":"start"}')
            assert wait_for(lambda: session.phase != "ready")
            desk.send('{"do":"abort"}')
            assert wait_for(lambda: session.phase == "done")


# --- the experimenter, triggers


def test_a_trial_waits_for_its_message_and_triggers_go_out(tmp_path):
    triggers = [{"at": "start", "to": "socket", "text": "begin {trial} {condition}"},
                {"at": "end", "to": "socket", "text": "end {trial}"}]  # fmt: skip
    with running(tmp_path, start={"message": "go"}, triggers=triggers) as (address, session):
        desk = way_in(address, "experimenter", max_queue=None)
        with way_in(address, "animals", None) as way, desk:
            assert json.loads(desk.recv())["phase"] == "ready"
            desk.send('{"do":"start"}')
            heard = []
            for _ in range(2):
                assert wait_for(lambda: session.phase == "waiting")
                way.send('{"do":"trigger","name":"stop"}')
                way.send('{"do":"trigger","name":"go"}')
                heard += [way.recv(timeout=PATIENCE_S), way.recv(timeout=PATIENCE_S)]
            assert wait_for(lambda: session.phase == "done")
    assert heard == ["begin 1 known", "end 1", "begin 2 live", "end 2"]


def test_a_session_is_aborted_in_the_middle_and_loses_nothing(tmp_path):
    conditions = {"b": {"seconds": 30.0, "motion": {"wander": True}}}
    with running(tmp_path, conditions=conditions) as (address, session):
        with way_in(address, "experimenter", max_queue=None) as desk:
            desk.send('{"do":"start"}')
            assert wait_for(lambda: session.phase == "running")
            desk.send(json.dumps({"do": "note", "text": "the fish sleeps"}))
            desk.send('{"do":"abort"}')
            assert wait_for(lambda: session.phase == "done")
    record = open_session_record(tmp_path / "toy.parquet")
    texts = [row["text"] for row in record.read_rows("event", "trial")]
    assert any("the fish sleeps" in text for text in texts)
    assert any('"what": "abort", "number": 1' in text for text in texts)


# --- a real browser


def test_a_session_in_a_browser_is_drawn_again_pixel_for_pixel(tmp_path):
    with chromium() as browser:
        long = {name: one | {"seconds": 1.2} for name, one in CONDITIONS.items()}
        with running(tmp_path, digest=True, draws=False, conditions=long) as (address, session):
            page = browser.new_page(viewport={"width": 640, "height": 480})
            bad = []
            page.on("pageerror", lambda error: bad.append(str(error)))
            page.goto(f"http://{address}/show")
            assert wait_for(session.is_display_drawing)
            desk = way_in(address, "experimenter", max_queue=None)
            with desk, way_in(address, "animals", None) as way:
                desk.send('{"do":"start"}')
                number = 0
                while session.phase != "done":
                    place = 100 + 80 * (number // 10 % 2)
                    way.send(json.dumps({"t": number / 30, "id": 1, "x": place, "y": place}))
                    number += 1
                    page.wait_for_timeout(30)
            assert wait_for(lambda: session.counts.frames > 8)
            page.close()
        record = open_session_record(tmp_path / "toy.parquet")
        frames = list(read_displayed_frames(record))
        drawn = [one for one in frames if len(one.states)]
        assert len(drawn) > 8 and all(one.digest for one in frames)
        assert len({one.digest for one in drawn}) > 4  # it moves
        assert replan_session(record, session.context, session.protocol).different == 0
        feed = feed_of(session.context, session.protocol, mode="replay", digest=True)
        room = ReplayHub(feed, read_displayed_frames(record), quick=True)

        def make_server(listens, port, started):
            return create_display_server(listens, AccessPolicy(port), room, started)

        with serving(make_server) as (address, server):
            page = browser.new_page(viewport={"width": 640, "height": 480})
            page.goto(f"http://{address}/")
            assert wait_for(lambda: (page.wait_for_timeout(20), server.should_exit)[1])
            page.close()
        assert not bad and room.compared == room.shown == len(frames) and room.different == []


def test_a_wait_on_the_real_clock_ends_in_time():
    clock = RealClock()

    async def measure_lateness():
        due = clock.read_time() + 0.01
        await clock.wait_until(due)
        return clock.read_time() - due

    assert asyncio.run(measure_lateness()) >= 0
