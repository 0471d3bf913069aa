"""The experimenter's page, in a real browser, before a server that says what a test wants."""

import json
import queue
import threading
from http import HTTPStatus
from typing import get_args

import pytest
from browser import Visit, chromium, hold_time
from conftest import PATIENCE_S, wait_for
from playwright.sync_api import expect
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

from finloop.show.page import build_experimenter_page, make_content_policy
from finloop.stimulus.animals import Verdict

expect.set_options(timeout=1000 * PATIENCE_S)  # a hang ends, a busy machine does not
PAGE = build_experimenter_page()
WHOLE = {
    "protocol": "shoal or dot", "seed": 7, "file": "session-1.parquet", "link": "http://10.0.0.2:8751/show",
    "tank": [1200, 800], "calibrated": True, "gap_s": 0.5, "mm_per_px": 0.25, "demands": ["a calibrated display"],
    "trials": [[1, 1, 1, "fish", 60.0], [2, 1, 1, "dot", 60.0], [3, 2, 2, "dot", 60.0], [4, 2, 2, "fish", 60.0]],
}  # fmt: skip
STATE = {
    "phase": "running", "now": 93.4, "trial": 1, "left_s": 45.2, "done": {"1": "done"}, "start": " ",
    "display": {"name": "lab", "width": 1920, "height": 1080, "ratio": 1.0, "renderer": "ANGLE (lab)", "calibrated": True, "refresh_hz": 59.94, "hidden": False},
    "displays": 1, "draws": True, "frames": 5520, "dropped": 3, "late": 1,
    "latency": {"planned_ms": [1.84, 4.06], "drawn_ms": [14.2, 27.9], "tick_ms": None},
    "fish": [[600.0, 200.0, 0.5, 120.0, 1.0]],
    "animals": [["larva 1", 300.0, 500.0, 1.57, 0.02], ["larva 2", 900.0, 600.0, None, 4.0]],
    "heard": {"rival": 4, "taken": 1210}, "messages": ["10.0 s: older", "91.0 s: newer"],
}  # fmt: skip
SIZE = {"width": 1400, "height": 950}


class Desk:
    """A server of the page alone. `say`: a state, to the page that came last; `wishes`: of pages."""

    def __init__(self):
        self.wishes, self.came = queue.Queue(), queue.Queue()
        self.server = serve(self._attend, "127.0.0.1", 0, process_request=self._answer)
        self.address = "{}:{}".format(*self.server.socket.getsockname())
        self.runs = threading.Thread(target=self.server.serve_forever)
        self.runs.start()

    def _answer(self, connection, request):
        if request.path.startswith("/experimenter"):
            assert request.headers["Origin"] == f"http://{self.address}"
            return None
        answer = connection.respond(HTTPStatus.OK, PAGE)
        del answer.headers["Content-Type"]
        answer.headers["Content-Type"] = "text/html; charset=utf-8"
        sources = f"img-src data:; connect-src ws://{self.address}"
        answer.headers["Content-Security-Policy"] = make_content_policy(PAGE, sources)
        return answer

    def _attend(self, connection):
        self.came.put(connection)
        try:
            for text in connection:
                self.wishes.put(json.loads(text))
        except ConnectionClosed:
            pass

    def next(self):
        return self.wishes.get(timeout=PATIENCE_S)

    def close(self):
        self.server.shutdown()
        self.runs.join(PATIENCE_S)


@pytest.fixture(scope="module")
def browser():
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def desk(browser):
    one = Desk()
    yield one
    one.close()


class Opened(Visit):
    """The page, told a state; `tell` tells another, with some changes. Its clock stands still."""

    def __init__(self, desk, page, query=""):
        self.desk, self.now = desk, 93.4
        super().__init__(page)
        page.clock.install()
        hold_time(page)
        page.goto(f"http://{desk.address}/{query}")
        self.connection = desk.came.get(timeout=PATIENCE_S)

    def tell(self, whole=None, **changes):
        self.now += 0.1  # a state is told by its time, of the page's own making
        state = STATE | {"now": round(self.now, 2)} | changes
        self.connection.send(json.dumps(state if whole is None else whole | state))
        assert wait_for(lambda: self.page.evaluate("state?.now") == state["now"])

    def _note_request(self, request):
        if not request.url.startswith(f"http://{self.desk.address}/"):
            super()._note_request(request)


def open_page(browser, desk, query=""):
    context = browser.new_context(viewport=SIZE)
    return Opened(desk, context.new_page(), query)


@pytest.fixture
def desk_page(browser, desk):
    one = open_page(browser, desk)
    one.tell(WHOLE)
    yield one
    assert one.bad == [] and desk.wishes.empty()
    one.page.context.close()


@pytest.fixture(scope="module")
def one_page(browser, desk):
    return open_page(browser, desk)


@pytest.fixture
def shown_page(one_page):
    """A page that is told everything anew; it shows states, and nobody presses anything."""
    one_page.page.set_viewport_size(SIZE)
    one_page.page.emulate_media(color_scheme="light")
    one_page.tell(WHOLE)
    yield one_page
    assert one_page.bad == []


def text(opened, name):
    return opened.page.locator(f"#{name}").inner_text()


def test_a_state_is_shown(shown_page):
    desk_page, page = shown_page, shown_page.page
    assert text(desk_page, "protocol") == "shoal or dot" and "seed 7" in text(desk_page, "facts")
    assert text(desk_page, "what") == "Trial 2 of 4: dot" and text(desk_page, "left") == "0:45"
    part = page.locator("#part").evaluate("bar => bar.value")
    assert part == pytest.approx(1 - 45.2 / 60, abs=1e-3)
    states = page.locator("#trials tr").evaluate_all("rows => rows.map(row => row.dataset.state)")
    assert states == ["done", "running", "", ""]
    assert page.locator("#trials tr[aria-current]").inner_text().split()[:2] == ["2", "dot"]
    shown = {
        "display": ("1920 × 1080 px", "59.94 Hz", "ANGLE (lab)"),
        "latency": ("1.8\t4.1", "14.2\t27.9"), "frames": ("3 dropped (0.05 %)", "1 late"),
    }  # fmt: skip
    assert all(word in text(desk_page, name) for name, words in shown.items() for word in words)
    heard = text(desk_page, "heard").split("\n")
    assert heard == ["taken\t1,210", "refused: another tracker names the same animal\t4"]
    assert page.locator("#heard tr.warn").all_inner_texts() == heard[1:]
    assert text(desk_page, "log").split("\n") == ["91.0 s: newer", "10.0 s: older"]
    assert text(desk_page, "summary") == "1 fish shown, 2 live animals, 1 lost"
    assert "Trial 2, dot, runs." in page.locator("#told").inner_text()
    desk_page.tell(trial=1, phase="pause", left_s=14.2, done={"1": "done", "2": "skipped"})
    assert text(desk_page, "what") == "Next: trial 3, dot" and text(desk_page, "left") == "0:14"
    states = page.locator("#trials tr").evaluate_all("rows => rows.map(row => row.dataset.state)")
    assert states == ["done", "skipped", "next", ""]
    assert "2 of 4, 1 of them not whole; 2:00 of trials to come" in text(desk_page, "count")
    done = {"1": "done", "2": "aborted"}
    desk_page.tell(phase="done", left_s=None, done=done, heard={}, messages=[])
    assert text(desk_page, "what") == "The session has ended"
    assert page.locator("#unheard").is_visible() and page.locator("#quiet").is_visible()


def test_every_verdict_on_an_input_is_put_in_words(shown_page):
    shown_page.tell(heard=dict.fromkeys(get_args(Verdict), 1))
    words = shown_page.page.locator("#heard th").all_inner_texts()
    assert len(words) == len(get_args(Verdict)) and words[0] == "taken"
    assert all(" " in word for word in words[1:]), words


def test_what_is_amiss_with_the_display_is_said(shown_page):
    amiss = {"calibrated": False, "refresh_hz": None, "hidden": True}
    shown_page.tell(display=STATE["display"] | amiss, displays=2)
    warnings = shown_page.page.locator("#display dd.warn").all_inner_texts()
    assert len(warnings) == 3 and "the protocol demands it" in warnings[0]
    shown_page.tell(phase="ready", trial=-1, draws=False)
    assert "no display shows frames" in text(shown_page, "what")
    assert "none come: no trial can start" in text(shown_page, "display")
    shown_page.tell(draws=False)
    assert "none come: fish may be unseen" in text(shown_page, "display")
    shown_page.tell(phase="done", draws=False)
    assert "none come" not in text(shown_page, "display")
    shown_page.tell(phase="waiting", start="auto", draws=False)
    assert "as no display showed frames" in text(shown_page, "phase")
    assert not shown_page.page.locator("#nodisplay").is_visible()
    shown_page.tell(display=None, displays=0)
    link = shown_page.page.locator("#nodisplay a")
    assert link.is_visible() and link.get_attribute("href") == WHOLE["link"]
    shown_page.tell(WHOLE | {"link": "javascript:alert(1)"}, display=None, displays=0)
    assert link.get_attribute("href") is None


ENABLED = {
    "ready": "start abort", "planning": "skip stop abort", "waiting": "start skip stop abort",
    "running": "skip stop abort", "pause": "skip stop abort", "saving": "", "done": "",
}  # fmt: skip


def test_only_what_can_be_done_now_can_be_pressed(shown_page):
    for phase, enabled in ENABLED.items():
        shown_page.tell(phase=phase, trial=-1 if phase == "ready" else 1)
        for name in ("start", "skip", "stop", "abort"):
            found = shown_page.page.locator(f"#{name}").is_enabled()
            assert found == (name in enabled.split()), (phase, name)


def test_buttons_and_keys_say_what_they_mean(desk_page, desk):
    page = desk_page.page
    for how in ("click", "key"):
        buttons = ("start", "s", "waiting"), ("skip", "k", "pause"), ("stop", "e", "running")
        for name, key, phase in buttons:
            desk_page.tell(WHOLE, phase=phase)
            page.locator("body").press(key) if how == "key" else page.click(f"#{name}")
            assert desk.next() == {"do": name}
    assert page.locator("#stop").get_attribute("aria-pressed") == "true"
    desk_page.tell(phase="waiting")
    page.locator("body").press(" ")  # starts the trial, as before the display
    assert desk.next() == {"do": "key", "key": " "}
    page.uncheck("#keys")
    page.locator("body").press("s")
    page.click("#start")
    assert desk.next() == {"do": "start"} and desk.wishes.empty()


def test_what_cannot_be_undone_is_asked_once_more(desk_page, desk):
    page, dialog = desk_page.page, desk_page.page.locator("#ask")
    for name, key in (("abort", "a"), ("skip", "k")):
        page.click(f"#{name}")
        assert dialog.is_visible() and "trial" in dialog.inner_text()
        page.keyboard.press("Enter")  # what is focused first does no harm
        expect(dialog).to_be_hidden()
        page.locator("body").press(key)
        page.keyboard.press("Escape")
        expect(dialog).to_be_hidden()
        assert desk.wishes.empty()
        page.click(f"#{name}")
        page.click("#yes")
        assert desk.next() == {"do": name}
    page.click("#skip")
    desk_page.tell(trial=2, left_s=60.0)  # another trial runs by now
    expect(dialog).to_be_hidden()
    page.click("#abort")
    desk_page.tell(trial=2, phase="pause", left_s=9.0)  # a trial ends: the question is the same
    assert dialog.is_visible()
    page.click("#no")


def test_a_note_is_sent_and_keys_typed_in_it_are_only_text(desk_page, desk):
    page = desk_page.page
    page.locator("body").press("n")
    page.keyboard.type(" a fish jumped: sake  ")
    page.keyboard.press("Control+Enter")
    assert desk.next() == {"do": "note", "text": "a fish jumped: sake"}
    assert page.input_value("#note") == "" and "noted at" in text(desk_page, "said")
    page.click("#add")  # nothing to add
    page.fill("#note", "x")
    page.click("#add")
    assert desk.next() == {"do": "note", "text": "x"}


def test_hostile_texts_are_shown_as_text(shown_page):
    bad = "<img src=x onerror=\"document.title='hacked'\"><b>&amp;"
    whole = WHOLE | {
        "protocol": bad, "file": bad, "link": bad, "demands": [bad],
        "trials": [[1, 1, 1, bad, 60.0], [2, 1, 1, bad, 60.0]],
    }  # fmt: skip
    shown_page.tell(
        whole, display=STATE["display"] | {"name": bad}, heard={bad: 1}, messages=[bad],
        animals=[[bad, 1.0, 2.0, None, 0.1]], done={"1": bad}, start=bad,
    )  # fmt: skip
    for name in ("protocol", "facts", "what", "display", "heard", "log", "trials"):
        assert bad in text(shown_page, name), name
    shown_page.tell(phase=bad, display=None)
    assert text(shown_page, "phase") == bad and bad in text(shown_page, "nodisplay")
    assert shown_page.page.locator("img, main b").count() == 0
    assert "hacked" not in shown_page.page.title() or shown_page.page.title().startswith("<img")


def ink(opened, x, y, reach):
    """How much of each tone there is around a place of the tank, px of the canvas."""
    return opened.page.evaluate(
        """([x, y, reach]) => {
            const map = document.getElementById("map"), scale = map.width / whole.tank[0];
            const of = (w, h) => Object.assign(document.createElement("canvas"), {width: w, height: h}).getContext("2d", {willReadFrequently: true});
            const at = of(map.width, map.height);
            at.drawImage(map, 0, 0);
            const tones = {};
            for (const [name, tone] of [["fish", "--accent"], ["animal", "--taken"], ["lost", "--bad"]]) {
                const probe = of(1, 1);
                probe.fillStyle = colour(tone); probe.fillRect(0, 0, 1, 1);
                tones[name] = [...probe.getImageData(0, 0, 1, 1).data];
            }
            const side = Math.round(2 * reach * scale);
            const seen = at.getImageData(Math.round((x - reach) * scale), Math.round((y - reach) * scale), side, side).data;
            const count = {fish: 0, animal: 0, lost: 0};
            for (let i = 0; i < seen.length; i += 4) for (const name in tones)
                count[name] += [0, 1, 2].every(part => Math.abs(seen[i + part] - tones[name][part]) < 12);
            return count;
        }""",
        [x, y, reach],
    )


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_map_shows_who_is_where(shown_page, scheme):
    shown_page.page.emulate_media(color_scheme=scheme)
    shown_page.tell()
    places = (600, 200), (300, 500), (900, 600)
    fish, animal, lost = (ink(shown_page, *place, 45) for place in places)
    assert fish["fish"] > 300 and fish["animal"] == fish["lost"] == 0
    assert animal["animal"] > 60 and animal["fish"] == animal["lost"] == 0
    assert lost["lost"] > 30 and lost["fish"] == lost["animal"] == 0
    ahead, behind = (ink(shown_page, 300, 500 + dy, 6) for dy in (-24, 24))  # its heading is up
    assert ahead["animal"] > 4 and behind["animal"] == 0


def test_the_way_of_the_last_seconds_is_drawn_and_no_jump(desk_page):
    there = {"animals": [], "heard": {}}
    for step in range(12):
        desk_page.tell(fish=[[300.0 + 15 * step, 400.0, 0.0, 60.0, 1.0]], **there)
    way = desk_page.page.evaluate("trails.get('fish 0').map(([x, y]) => x)")
    assert way == [300.0 + 15 * step for step in range(12)]
    desk_page.tell(fish=[[1000.0, 400.0, 0.0, 60.0, 1.0]], **there)
    assert desk_page.page.evaluate("trails.get('fish 0').length") == 1
    desk_page.now += 10
    desk_page.tell(fish=[[1001.0, 400.0, 0.0, 60.0, 1.0]], **there)
    assert desk_page.page.evaluate("trails.get('fish 0').length") == 1
    desk_page.tell(fish=[], **there)
    assert desk_page.page.evaluate("trails.size") == 0


def test_a_session_that_does_not_answer_is_told_and_found_again(desk_page, desk):
    page = desk_page.page
    assert not page.locator("#alarm").is_visible()
    page.evaluate("heardAt = performance.now() - 7000; alarm()")  # it is silent
    expect(page.locator("#alarm")).to_contain_text("No connection to the session for 7 s")
    desk_page.tell()
    expect(page.locator("#alarm")).to_be_hidden()
    desk_page.connection.close(1013, "too many")
    expect(page.locator("#alarm")).to_contain_text("close one")
    assert not page.locator("#abort").is_enabled() and not page.locator("#add").is_enabled()
    page.clock.run_for(1000)
    desk_page.connection = desk.came.get(timeout=PATIENCE_S)
    desk_page.tell(WHOLE)
    expect(page.locator("#alarm")).to_be_hidden()
    assert page.locator("#abort").is_enabled()


def test_what_a_trial_waits_for_is_said(shown_page):
    starts = {" ": "space bar", "Enter": "enter key", "g": "key g", "go": "message go"}
    for start, said in starts.items():
        shown_page.tell(phase="waiting", start=start, left_s=None)
        assert text(shown_page, "phase") == f"waits for the {said}"
        assert shown_page.page.locator("#start").inner_text() == "Begin trial 2"


def test_nothing_sticks_out_at_any_width(shown_page):
    page = shown_page.page
    long = {"protocol": "p" * 80, "trials": [[1, 1, 1, "c" * 80, 60.0]] * 200}
    for width in (360, 820, 1400):
        page.set_viewport_size({"width": width, "height": 800})
        shown_page.tell(WHOLE)  # no trial far down is in view from before
        shown_page.tell(WHOLE | long, trial=150)
        shown_page.tell(phase="waiting", trial=150, start="m" * 80)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        row, box = (
            page.locator(one).bounding_box() for one in ("#trials tr[aria-current]", "#rolls")
        )
        assert box["y"] <= row["y"] <= box["y"] + box["height"]  # the trial that runs is in view


def test_a_session_that_never_answers_is_told_and_the_token_shown_to_it(browser, desk):
    one = open_page(browser, desk, "?token=abc")
    assert one.connection.request.path == "/experimenter?token=abc"
    assert not one.page.locator("#alarm").is_visible()
    one.connection.close(1008, "no token")
    expect(one.page.locator("#alarm")).to_contain_text("does not answer")
    one.page.clock.run_for(1000)
    desk.came.get(timeout=PATIENCE_S)  # it has tried again
    one.page.context.close()
