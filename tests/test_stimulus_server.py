"""The pages and inputs of a session over the wire: strangers, hostile messages, a real browser."""

import asyncio
import json
from contextlib import contextmanager
from itertools import product

import numpy as np
import pytest
from browser import chromium
from conftest import wait_for
from hostile import count_objects, hostile_messages
from serving import serving
from toy_stimulus import feed_of, plan_of, session_of
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from finloop.io.journal import save_journal
from finloop.live.web import AccessPolicy
from finloop.stimulus.desk import handle_request, session_status
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

CONDITIONS = {
    "known": {"seconds": 0.8, "motion": {"goals": [[0.2, 0.2], [0.8, 0.8]]}},
    "live": {
        "seconds": 0.8,
        "motion": {"rule": {"rule": "approach"}},
        "look": {"as": "silhouette"},
    },
}
READY = {"do": "ready", "width": 1280, "height": 720, "ratio": 1, "renderer": "r", "agent": "a"}


@contextmanager
def running(folder, token=None, digest=False, **plan):
    """A session that is served; its file is there when the block ends."""
    plan = plan_of(plan.pop("conditions", CONDITIONS), **plan)
    session, _ = session_of(folder, plan, RealClock())
    session.feed.facts["digest"] = digest
    room = SessionHub(session, "toy", folder / "display.json")
    session.connect_outputs(room.send, room.send_trigger)

    def make_server(listens, port, started):
        return create_session_server(listens, AccessPolicy(port, token), room, list, started)

    with serving(make_server) as (address, _):
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


# --- hostile messages


GOOD = [
    READY, {"do": "ping", "sent": 1.5}, {"do": "key", "key": " "}, {"do": "hidden", "on": True},
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
    assert session.counts.verdicts["malformed"] > 300
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
                                way.recv(timeout=5)
            assert wait_for(lambda: session.phase == "done", 120)
    assert session.done == {1: "done", 2: "done"}
    record = open_session_record(tmp_path / "toy.parquet")
    assert replan_session(record, session.context, session.protocol).different == 0
    assert "Traceback" not in capfd.readouterr().err


def test_the_first_page_is_the_display_and_others_are_mirrors(tmp_path):
    with running(tmp_path) as (address, session):
        with way_in(address, "display") as first, way_in(address, "display") as second:
            for page in (first, second):
                page.send(json.dumps(READY))
                assert b'"hello"' in page.recv(timeout=10)
            for number, page in ((3, second), (4, first)):
                page.send(np.array([number, 0, 0, 0, 0, 0, 0, 0.0]).tobytes())
            assert wait_for(lambda: session.counts.frames, 120) and session.displays == 2
    record = open_session_record(tmp_path / "toy.parquet")
    assert [row["number"] for row in record.read_rows("frame")] == [4]


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
                assert wait_for(lambda: session.phase == "waiting", 120)
                way.send('{"do":"trigger","name":"stop"}')
                way.send('{"do":"trigger","name":"go"}')
                heard += [way.recv(timeout=10), way.recv(timeout=10)]
            assert wait_for(lambda: session.phase == "done", 120)
    assert heard == ["begin 1 known", "end 1", "begin 2 live", "end 2"]


def test_a_session_is_aborted_in_the_middle_and_loses_nothing(tmp_path):
    conditions = {"b": {"seconds": 30.0, "motion": {"wander": True}}}
    with running(tmp_path, conditions=conditions) as (address, session):
        with way_in(address, "experimenter", max_queue=None) as desk:
            desk.send('{"do":"start"}')
            assert wait_for(lambda: session.phase == "running", 120)
            desk.send(json.dumps({"do": "note", "text": "the fish sleeps"}))
            desk.send('{"do":"abort"}')
            assert wait_for(lambda: session.phase == "done", 120)
    record = open_session_record(tmp_path / "toy.parquet")
    texts = [row["text"] for row in record.read_rows("event", "trial")]
    assert any("the fish sleeps" in text for text in texts)
    assert any('"what": "abort", "number": 1' in text for text in texts)


# --- a real browser


def test_a_session_in_a_browser_is_drawn_again_pixel_for_pixel(tmp_path):
    with chromium() as browser:
        long = {name: one | {"seconds": 1.2} for name, one in CONDITIONS.items()}
        with running(tmp_path, digest=True, conditions=long) as (address, session):
            page = browser.new_page(viewport={"width": 640, "height": 480})
            bad = []
            page.on("pageerror", lambda error: bad.append(str(error)))
            page.goto(f"http://{address}/show")
            assert wait_for(lambda: session.display is not None, 120)
            desk = way_in(address, "experimenter", max_queue=None)
            with desk, way_in(address, "animals", None) as way:
                desk.send('{"do":"start"}')
                number = 0
                while session.phase != "done":
                    place = 100 + 80 * (number // 10 % 2)
                    way.send(json.dumps({"t": number / 30, "id": 1, "x": place, "y": place}))
                    number += 1
                    page.wait_for_timeout(30)
            assert wait_for(lambda: session.counts.frames > 8, 120)
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
            assert wait_for(lambda: (page.wait_for_timeout(20), server.should_exit)[1], 60)
            page.close()
        assert not bad and room.compared == room.shown == len(frames) and room.different == []


def test_a_wait_on_the_real_clock_ends_in_time():
    clock = RealClock()

    async def measure_lateness():
        due = clock.read_time() + 0.01
        await clock.wait_until(due)
        return clock.read_time() - due

    assert asyncio.run(measure_lateness()) >= 0
