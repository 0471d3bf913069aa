"""The server of the live tank, and its page: strangers, hostile messages, slow pages, a browser."""

import asyncio
import json
import socket
from contextlib import contextmanager
from http.client import HTTPConnection
from types import SimpleNamespace

import pytest
from browser import chromium
from conftest import PATIENCE_S, wait_for
from hostile import count_objects, hostile_messages
from serving import serving
from toy_film import school_rule
from toy_tank import read, toy_players, view_of
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

import finloop.live.server as served
from finloop.base.errors import FinloopError
from finloop.edit.modes import MODES, ONE_FISH
from finloop.live import fish as play_fish
from finloop.live.message import LONGEST, MOST_PLACES, parse_message
from finloop.live.server import TankHub, create_tank_server
from finloop.show import hub as show_hub
from finloop.show.hub import Page
from finloop.show.page import build_tank_page
from finloop.show.web import bind_socket, cancel_task
from finloop.social.zones import Zones
from stages.play import _build_parser

GOOD = [
    {"do": "goal", "fish": 0, "x": 10.5, "y": 20, "drag": True}, {"do": "goal", "fish": None, "x": 0, "y": 0, "drag": False},
    {"do": "path", "fish": None, "places": [[10, 20.5]]}, {"do": "path", "fish": 1, "places": [[10**5, -(10**5)]] * MOST_PLACES},
    {"do": "rule", "fish": None, "leader": None}, {"do": "rule", "fish": 2, "leader": 7},
    {"do": "weights", "repulsion": 0, "alignment": 0.5, "attraction": 5}, {"do": "drop", "fish": 7},
    {"do": "mode", "mode": "loops"}, {"do": "pause", "on": True}, {"do": "step"}, {"do": "speed", "times": 8},
    {"do": "look", "tick": 3}, {"do": "look", "tick": None}, {"do": "branch", "tick": 3}, {"do": "return", "future": 1},
    {"do": "explain", "fish": 2}, {"do": "count", "fish": 8}, {"do": "ping", "sent": 12.5, "frames": 3},
]  # fmt: skip
BAD = [
    "", "null", "[]", "{}", "1", '"goal"', "[" * 400, "{" * 400, "\x00", "NaN", '{"do":"quit"}', '{"do":["goal"]}',
    '{"do":"goal","fish":0,"x":NaN,"y":1,"drag":true}', '{"do":"goal","fish":0,"x":1e999,"y":1,"drag":true}',
    '{"do":"goal","fish":0,"x":1e9,"y":1,"drag":true}', '{"do":"goal","fish":0,"x":"1","y":1,"drag":true}',
    '{"do":"goal","fish":8,"x":1,"y":1,"drag":true}', '{"do":"goal","fish":-1,"x":1,"y":1,"drag":true}',
    '{"do":"goal","fish":0.0,"x":1,"y":1,"drag":true}', '{"do":"goal","fish":true,"x":1,"y":1,"drag":true}',
    '{"do":"goal","fish":0,"x":1,"y":1}', '{"do":"goal","fish":0,"x":1,"y":1,"drag":1}',
    '{"do":"goal","fish":0,"x":1,"y":1,"drag":true,"more":1}', '{"do":"mode","mode":"HYBRID"}',
    '{"do":"path","fish":0,"places":[]}', '{"do":"path","fish":0,"places":[[1,2,3]]}',
    '{"do":"path","fish":0,"places":[[1,NaN]]}', '{"do":"path","fish":0,"places":[1,2]}',
    '{"do":"path","fish":0,"places":[' + ",".join(["[1,1]"] * (MOST_PLACES + 1)) + "]}",
    '{"do":"mode","mode":"__class__"}', '{"do":"pause","on":"true"}', '{"do":"speed","times":0}',
    '{"do":"speed","times":-1}', '{"do":"speed","times":1e300}', '{"do":"look","tick":-1}',
    '{"do":"look","tick":1.5}', '{"do":"branch","tick":null}', '{"do":"return","future":-1}', '{"do":"look","tick":' + "9" * 300 + "}", '{"do":"count","fish":0}',
    '{"do":"count","fish":9}', '{"do":"ping","sent":1e300,"frames":1}', '{"do":"ping","sent":1,"frames":1.5}', '{"do":"step"' + " " * LONGEST + "}",
]  # fmt: skip


@contextmanager
def tank(view=None, ends_with=None, **how):
    """The server of a tank, running beside; yields its address, and the view.

    ends_with: the error that ends it.
    """
    view = view or view_of(**how)

    def make_server(listens, _port, started):
        return create_tank_server(view, listens, started)

    with serving(make_server, ends_with) as (address, _):
        yield address, view


def look_in(address, origin=True, **how):
    origin = f"http://{address}" if origin is True else origin
    return connect(f"ws://{address}/tank", origin=origin, compression=None, max_queue=2, **how)


def say(page, **wish):
    page.send(json.dumps(wish))


def next_state(page):
    """The next state that a page is told."""
    while True:
        facts, _ = read(page.recv(timeout=PATIENCE_S))
        if facts["kind"] == "tank":
            return facts["tank"]


def until(page, wanted):
    """The first state that is as wanted, of a page that looks on."""
    for _ in range(4000):  # a minute's ticks at least
        state = next_state(page)
        if wanted(state):
            return state
    raise AssertionError(f"never as wanted; at last {state}")


class Silent:
    """A connection that takes nothing; what it was closed with."""

    def __init__(self):
        self.closed = []

    async def close(self, *why):
        self.closed.append(why)


# --- messages


def test_what_is_meant_is_understood_and_nothing_else():
    for wish in GOOD:
        assert parse_message(json.dumps(wish)).do == wish["do"]
    for text in BAD:
        assert parse_message(text) is None, text
        assert parse_message(text.encode()) is None, text
    assert parse_message(None) is None and parse_message(b"\xff\xfe{") is None
    for wish in GOOD:  # a field is missing, of another type, or one too many
        for name in wish:
            less = {key: value for key, value in wish.items() if key != name}
            assert parse_message(json.dumps(less)) is None
            assert parse_message(json.dumps(wish | {name: {"a": [1]}})) is None
        assert parse_message(json.dumps(wish | {"more": 1})) is None


def test_hostile_messages_neither_crash_nor_grow(monkeypatch):
    monkeypatch.setattr(play_fish, "HISTORY", 50)
    view = view_of(fish=2)
    host, pages = TankHub(view), [Page(Silent()) for _ in range(3)]

    def hear():
        for part in range(8):
            for number, text in enumerate(hostile_messages(600, part, GOOD, BAD)):
                host.handle_content(pages[number % 3], text)
                if number % 300 == 0:
                    assert len(host.requests) <= 25
                    host.make_frame(*host.take_requests(), ticks=4)
            for text in ('{"do":"mode","mode":"matching"}', '{"do":"count","fish":2}',
                         '{"do":"pause","on":false}'):  # fmt: skip
                host.handle_content(pages[0], text)
            host.make_frame(*host.take_requests(), ticks=20)
            for page in pages:
                while not page.waiting.empty():  # the answers to pings
                    page.waiting.get_nowait()
            toy_players()["network"].mode.cached_turn.cache_clear()
            yield

    counts = count_objects(hear())
    assert host.view.bad_messages > 2000
    # What is held differs with what the fish do just then, within bounds that do not rise.
    assert max(counts[4:]) - max(counts[:4]) < 400, counts


def test_text_that_is_no_utf8_ends_the_connection_without_a_traceback(capfd):
    with tank() as (address, _):
        with look_in(address) as page:
            page.send(b"\xff\xfe{", text=True)
            with pytest.raises(ConnectionClosed) as closed:
                for _ in range(100):
                    page.recv(timeout=PATIENCE_S)
            assert closed.value.sent.code == 1007
        with look_in(address) as page:
            assert until(page, lambda s: s["bad"] == 1)
    assert capfd.readouterr().err == ""


def test_they_do_no_harm_over_the_wire_either():
    with tank() as (address, _):
        with look_in(address) as page:
            for text in hostile_messages(600, 9, GOOD, BAD):
                try:
                    page.send(text)
                except ConnectionClosed as error:
                    raise AssertionError("it was thrown out") from error
            say(page, do="count", fish=1)
            say(page, do="pause", on=False)
            bad = until(page, lambda s: s["bad"] > 200 and len(s["fish"]) == 1)["bad"]
        with look_in(address) as page:  # one too large ends the connection, not the tank
            page.send("x" * 100_000)
            with pytest.raises(ConnectionClosed):
                for _ in range(100):
                    page.recv(timeout=PATIENCE_S)
        with look_in(address) as page:
            assert until(page, lambda s: s["bad"] > bad)["tick"]


# --- pages


def test_of_each_kind_of_wish_only_the_last_is_kept_in_their_order():
    host, page = TankHub(view_of(fish=2)), Page(Silent())
    for x in range(50):
        for fish, drag in ((0, x > 0), (1, True)):
            goal = {"do": "goal", "fish": fish, "x": x, "y": fish, "drag": drag}
            host.handle_content(page, json.dumps(goal))
    host.handle_content(page, '{"do":"drop","fish":0}')
    wishes, steps = host.take_requests()
    assert [(wish.do, wish.fish) for wish in wishes] == [("goal", 0), ("goal", 1), ("drop", 0)]
    assert wishes[0].x == 49 and not wishes[0].drag and wishes[1].drag and steps == 0
    for _ in range(1000):
        host.handle_content(page, '{"do":"step"}')
    wishes, steps = host.take_requests()
    assert 1 < steps < 100 and wishes == [] and host.take_requests() == ([], 0)


def test_a_page_that_takes_nothing_is_disconnected_and_holds_up_no_other(monkeypatch):
    monkeypatch.setattr(show_hub, "_MOST_WAITING", 5)

    async def story():
        host = TankHub(view_of())
        slow, quick, new = pages = [Page(Silent()) for _ in range(3)]
        host.pages += pages
        slow.is_open = quick.is_open = True
        for number in range(9):
            host.send(b"%d" % number)
            assert await asyncio.wait_for(quick.waiting.get(), PATIENCE_S) == b"%d" % number
        await asyncio.sleep(0)
        assert host.pages == [quick, new] and new.waiting.empty()
        assert [len(page.connection.closed) for page in pages] == [1, 0, 0]

    asyncio.run(story())


@pytest.mark.parametrize(("rest_s", "heard"), [(3600.0, range(2, 3)), (0.0, range(1000, 9999))])
def test_after_each_message_of_a_page_there_is_a_rest(monkeypatch, rest_s, heard):
    class Flood:
        async def receive(self):
            return {"type": "websocket.receive", "text": "x"}

        async def send_bytes(self, frame):
            pass

    async def story():
        host = TankHub(view_of())
        floods = [asyncio.create_task(host.serve_page(Flood())) for _ in range(2)]
        for _ in range(1000):  # of all tasks each has its turn
            await asyncio.sleep(0)
        assert host.view.bad_messages in heard  # of both pages
        for flood in floods:
            await cancel_task(flood)

    monkeypatch.setattr(TankHub, "rest_s", rest_s)
    asyncio.run(story())


def test_nothing_is_reckoned_while_nobody_looks_on():
    with tank() as (address, view):
        with look_in(address) as page:
            until(page, lambda s: s["tick"] > 3)
        ticks = []

        def still():
            ticks.append(view.tank.tick)
            return len(ticks) > 4 and ticks[-5] == ticks[-1]  # five of its ticks' time

        assert wait_for(still, every=0.05)
        with look_in(address) as page:
            until(page, lambda s: s["tick"] > ticks[-1])


def test_time_passes_as_fast_as_asked_and_a_wish_is_granted_at_once(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(served, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    with tank() as (address, view):
        with look_in(address) as page:
            for times in (1.0, 4.0):
                say(page, do="speed", times=times)
                begin = until(page, lambda s, times=times: s["speed"] == times)["tick"]
                now[0] += 3.5 / view.tank.world.motion.rate_hz
                end = until(page, lambda s, begin=begin: s["tick"] > begin)["tick"]
                assert end - begin == pytest.approx(3.5 * times, abs=1)
            view.speed = 1e-6  # the next tick is due in eleven hours
            for x in (100, 120):
                say(page, do="goal", fish=0, x=x, y=100, drag=False)
                shown = until(page, lambda s, x=x: (s["fish"][0]["goal"] or [0])[0] == x)
                assert shown["tick"] == end


# --- strangers


def got(address, path="/", host=None, method="GET"):
    connection = HTTPConnection(*address.split(":"), timeout=PATIENCE_S)
    connection.putrequest(method, path, skip_host=host is not None)
    if host:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_only_its_own_page_is_let_in():
    with tank() as (address, _):
        port = address.split(":")[1]
        answer, body = got(address)
        assert answer.status == 200 and body == build_tank_page().encode()
        assert "default-src 'none'" in answer.getheader("content-security-policy")
        assert got(address, host=f"localhost:{port}")[0].status == 200
        evil = f"evil.example:{port}"
        for host in (evil[:12], evil, "127.0.0.1", "127.0.0.1:1", f"127.0.0.1:{port}.evil"):
            assert got(address, host=host)[0].status == 421
        for path in ("/x", "/../stages/play.py", "//", "/tank", "/%2e%2e/etc/passwd"):
            assert got(address, path)[0].status == 404
        assert got(address, method="POST")[0].status == 405
        strangers = f"https://{address}", "http://127.0.0.1:1", f"http://{address}.evil"
        for origin in (None, "null", "http://evil.example", *strangers):
            with pytest.raises(InvalidStatus, match="403"):
                look_in(address, origin=origin)
        for origin in (evil, address):
            rebound = socket.create_connection(address.split(":"))  # a name that leads here
            with pytest.raises(InvalidStatus, match="403"):
                connect(f"ws://{evil}/tank", sock=rebound, origin=f"http://{origin}")
        with look_in(address, origin=f"http://localhost:{port}") as page:
            assert read(page.recv(timeout=PATIENCE_S))


def test_too_many_pages_are_sent_away(monkeypatch):
    monkeypatch.setattr(served, "MOST_PAGES", 1)
    with tank() as (address, _):
        with look_in(address) as page, look_in(address) as another:
            with pytest.raises(ConnectionClosed, match="1013"):
                another.recv(timeout=PATIENCE_S)
            assert read(page.recv(timeout=PATIENCE_S))


def test_it_listens_to_this_machine_alone_and_says_so_where_the_port_is_taken():
    with bind_socket(0) as one:
        assert one.getsockname()[0] == "127.0.0.1"
        one.listen()
        with pytest.raises(FinloopError, match=f"port {one.getsockname()[1]} is not available"):
            bind_socket(one.getsockname()[1])
    for port in (70_000, -1):
        with pytest.raises(FinloopError):
            bind_socket(port)
    assert _build_parser().parse_args([]).fish is None  # as matching.fish
    with pytest.raises(SystemExit):
        _build_parser().parse_args(["--fish", "9"])


def test_a_mode_that_there_is_not_is_answered_by_those_that_there_are(capsys):
    assert [_build_parser().parse_args(["--mode", mode]).mode for mode in MODES] == [*MODES]
    with pytest.raises(SystemExit):
        _build_parser().parse_args(["--mode", "nn"])
    told = capsys.readouterr().err
    assert all(mode in told for mode in MODES)
    assert parse_message('{"do":"mode","mode":"nn"}') is None


def test_an_error_of_the_tank_ends_the_server_and_is_told():
    view = view_of()
    view.frame_messages = lambda *_: 1 / 0
    with tank(view, ends_with=ZeroDivisionError) as (address, _):
        with look_in(address) as page, pytest.raises(ConnectionClosed):
            next_state(page)


# --- a browser


def test_in_a_browser_the_fish_is_sent_by_a_click_and_the_past_is_looked_at():
    with tank(mode="network") as (address, view), chromium() as browser:
        page = browser.new_page(viewport={"width": 390, "height": 800})
        wrong, other = [], []
        about_gl = "GL Driver Message"  # the floor is read back once
        page.on("console", lambda one: about_gl in one.text or wrong.append(one.text))
        page.on("pageerror", lambda one: wrong.append(str(one)))
        page.on("request", lambda one: other.append(one.resource_type))

        def wait(what):
            so = wait_for(lambda: page.evaluate(what), every=0.02)
            assert so, (what, page.evaluate("JSON.stringify(state)")[:300], wrong)

        def press(key, what):
            page.keyboard.press(key)
            wait(what)

        def rewind(ticks):
            now = page.evaluate("state.now")
            page.locator("#scrub").fill(str(now - ticks))
            wait(f"state.past && state.tick === {now - ticks}")
            return now

        def place(right, down):
            return box["x"] + right * box["width"], box["y"] + down * box["height"]

        page.goto(f"http://{address}/")
        wait("!!state")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390  # fits a phone
        buttons = page.locator("[data-mode]")
        assert buttons.all_text_contents() == [facts.title for facts in MODES.values()]
        assert page.locator('[data-mode][aria-pressed="true"]').text_content() == "Network"
        assert "network, " in page.locator("#fish").text_content()
        # A mode of the paper has one fish, and no path; the page says so.
        assert page.locator("#path").is_disabled() and page.locator("#lead").is_disabled()
        assert "Matching" in page.locator("#path").get_attribute("title")
        assert page.locator("#count option:not([disabled])").count() == 1
        page.select_option("#speed", "8")
        box = page.locator("#tank").bounding_box()
        x = 0.25 if page.evaluate("state.fish[0].x") > 400 else 0.75
        page.mouse.click(*place(x, 0.5))
        wait("ripples.length > 0 && document.getElementById('hint').hidden")
        wait("state.fish[0].goal !== null")
        goal = page.evaluate("state.fish[0].goal")
        assert goal[:2] == pytest.approx([x * 800, 300], abs=4)
        wait("state.fish[0].goal[2]")  # the fish gets there
        assert "reached its goal" in page.locator("#told").text_content()
        press("Space", "state.paused")
        wait("!ripples.length && !dirty")
        look_nearer(page, place(0.3, 0.4), wait)
        now = rewind(30)
        assert "rewound" in page.locator("#badge").text_content()
        assert page.locator("#why").text_content() != "–"
        page.locator("#scrub").focus()
        for _ in range(9):  # as fast as it goes
            page.keyboard.press("ArrowLeft")
        wait(f"state.tick === {now - 39}")
        press(".", f"state.tick === {now - 38}")
        press("l", "!state.past")
        now = rewind(30)
        press("Space", f"!state.past && state.tick === {now}")  # the past is played on to now
        rewind(30)
        press("b", "!state.past && !state.paused")  # branch from there
        wait(f"state.futures.length === 1 && state.futures[0][1] === {now}")
        page.click("#futures button")
        wait(f"state.futures[0][1] !== {now} && state.events.length > 0")
        press("Space", "state.paused")
        now = rewind(20)
        page.click("#from")
        wait(f"!state.past && state.now >= {now - 20}")
        press("Space", "state.paused")
        rewind(5)
        press("End", "!state.past && state.paused")  # the end of the past is now
        # An arrow moves the goal that the fish swims to, or sets one beside the fish.
        where = "state.fish[0].goal && !state.fish[0].goal[2] ? state.fish[0].goal[0] : {}"
        before = page.evaluate(where.format("state.fish[0].x"))
        page.locator("#tank").focus()
        press("ArrowRight", f"({where.format(0)}) > {min(before + 20, 700)}")
        page.keyboard.press("Space")
        page.mouse.move(box["x"] + 30, box["y"] + 60)  # drag
        page.mouse.down()
        page.mouse.move(*place(0.5, 0.5), steps=5)
        page.mouse.up()
        goal = "state.fish[0].goal"
        wait(f"{goal} && Math.hypot({goal}[0] - 400, {goal}[1] - 300) < 5")
        page.click('[data-mode="matching"]')
        wait("state.mode === 'matching' && !document.getElementById('path').disabled")
        page.keyboard.press("p")  # a triangle, drawn and swum again and again
        corners = [(0.4, 0.3), (0.6, 0.3), (0.5, 0.7), (0.4, 0.3)]
        for number, (right, down) in enumerate(corners):
            page.mouse.move(*place(right, down), steps=8)
            if number == 0:
                page.mouse.down()
        page.mouse.up()
        wait("state.fish[0].path && state.fish[0].path.closed")
        assert page.evaluate("state.fish[0].path.places[0]") == pytest.approx([320, 180], abs=9)
        wait("state.fish[0].path.begun")
        assert "swims its path" in page.locator("#fish").text_content()
        press("Escape", "state.fish[0].path === null && state.fish[0].goal === null")
        page.click('[data-mode="hybrid"]')
        wait("state.mode === 'hybrid' && state.decision.mode === 'hybrid'")
        page.keyboard.press("m")  # the next one
        # The table of candidates stays while the fish swims what it planned.
        rows = "[...document.querySelectorAll('#candidates tr')]"
        whole = "row => row.cells.length === 12 || row.cells[0].colSpan === 12"
        wait(f"{rows}.length > 1 && {rows}.every({whole})")
        said = "document.getElementById('why').textContent.includes('It follows a plan made')"
        wait(f"{said} && {rows}.filter(row => row.className === 'taken').length === 1")
        page.select_option("#count", "2")
        wait("state.fish[1]")
        for mode in ONE_FISH:
            assert page.locator(f'[data-mode="{mode}"]').is_disabled()
            assert "one fish" in page.locator(f'[data-mode="{mode}"]').get_attribute("title")
        page.select_option("#lead", "1")
        wait("state.fish[0].rule === 1")
        assert "follows fish 2" in page.locator("#fish").text_content()
        page.select_option("#who", "1")
        page.select_option("#lead", "0")
        wait("document.getElementById('refused').textContent.includes('fish 2 follows fish 1')")
        assert page.locator("#shoal").is_disabled()  # no zones are known
        view.tank.school_rule = school_rule(Zones(0.0, 0.0, 9.0, 0.0, 0.0, 0.0, 1.0))
        wait("!document.getElementById('shoal').disabled")
        press("c", "state.fish[1].rule === -1 && state.refused === ''")
        page.click("#company summary")
        assert page.locator('[data-weight="0"]').is_disabled()  # there is no zone of repulsion
        page.locator('[data-weight="2"]').fill("2.5")
        wait("state.weights[2] === 2.5")
        assert wrong == [] and set(other) == {"document"}
        assert view.bad_messages == 0


def look_nearer(page, cursor, wait):
    """Zoom and follow: the place under the cursor stays, the fish comes to the middle, as drawn."""
    under = f"(event => place({{clientX: {cursor[0]}, clientY: {cursor[1]}}}))()"
    before = page.evaluate(under)
    page.mouse.move(*cursor)
    page.mouse.wheel(0, -900)
    wait("zoom > 3 && drawer.view.scale > 3 * drawer.whole.scale")
    assert page.evaluate(under) == pytest.approx(before, abs=2)
    page.keyboard.press("f")
    middle = "[0, 1].map(axis => Math.abs(centre[axis] - drawnAt(0)[axis]))"
    edge = "Math.max(hello.width, hello.height) / (2 * zoom)"  # beyond the tank nothing is shown
    wait(f"{middle}.every(far => far < 1 || far < {edge})")
    assert page.evaluate("drawer.rects.length") == 1
    page.keyboard.press("f")
    for _ in range(8):
        page.keyboard.press("Shift+Z")
    wait("zoom === 1 && drawer.view.scale === drawer.whole.scale && drawer.view.left === 0")


def test_without_webgl_the_page_says_what_to_do_and_still_steers():
    with tank() as (address, _), chromium() as browser:
        page = browser.new_page()
        page.add_init_script("""const before = HTMLCanvasElement.prototype.getContext;
          HTMLCanvasElement.prototype.getContext = function (kind, how) {
            return kind === "webgl2" ? null : before.call(this, kind, how); };""")
        page.goto(f"http://{address}/")
        assert wait_for(lambda: page.evaluate("state && !document.getElementById('lacks').hidden"))
        assert "WebGL 2" in page.locator("#lacks").text_content()
        page.keyboard.press("Space")
        assert wait_for(lambda: page.evaluate("state.paused"))
