"""A session: what is shown is logged whole, survives a cut, and is planned again bit for bit."""

import argparse
import asyncio
import json
import re
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_stimulus import feed_of, header_of, plan_of, run_dry, scene, session_of
from toy_tank import Drops

import stages.stimulus
from finloop.base.errors import FinloopError
from finloop.edit.schema import FRAME
from finloop.extract.matte import drop_residue
from finloop.io.journal import hold_journal, read_journal, save_journal
from finloop.render.gallery import CutoutSet, Gallery
from finloop.show.drawn import ALPHA, PARTNER, PICTURE, X, Y
from finloop.show.limits import Budget
from finloop.show.page import pack_message
from finloop.show.pictures import PagePictures
from finloop.stimulus.animals import LiveAnimals
from finloop.stimulus.desk import handle_request
from finloop.stimulus.log import SESSION, FrameFacts, Log, parse_frame_records
from finloop.stimulus.motion import ReactiveMotion, TrialSetup, plan_motion
from finloop.stimulus.recorded import DryClock, TimedMessage
from finloop.stimulus.replay import open_session_record, read_displayed_frames, replan_session
from finloop.stimulus.summary import (
    load_log_table,
    measure_reactions_ms,
    measure_tick_errors_ms,
    summarise_session,
)

RULE = {"motion": {"rule": {"rule": "approach"}}}
ABSENT = np.zeros(20, np.float32)  # the page's state of a fish that is not drawn
ABSENT[[PICTURE]] = -1
DISPLAY = {"page": "a", "name": "d", "hidden": False}
GOALS = {"motion": {"goals": [[0.2, 0.2], [0.8, 0.8]]}}
ALL = {
    "fish": {"seconds": 1.0} | GOALS,
    "dot": {"seconds": 1.0, "look": {"as": "dot"}} | GOALS,
    "back": {"seconds": 1.0, "change": {"reversed": True}} | GOALS,
    "live": {"seconds": 1.5} | RULE,
    "yoked": {"seconds": 1.5, "motion": {"again": "live"}},
}


def walk(seed, seconds=30.0, rate=40.0, loss=0.0, jitter=0.0, gaps=False):
    """What a tracker says of an animal that darts about, some of it lost, late, or in no order."""
    rng, place = np.random.default_rng(seed), np.array([200.0, 200.0])
    messages = []
    for number in range(int(seconds * rate)):
        t = number / rate
        if rng.random() < 0.03:
            place = rng.uniform(0, 700, 2)
        if rng.random() < loss or (gaps and t % 5 < 2):
            continue
        text = {"t": round(t, 4), "id": "1", "x": round(place[0], 2), "y": round(place[1], 2)}
        messages.append((t + rng.uniform(0, jitter), json.dumps(text)))
    return sorted(messages)


def test_a_display_shows_the_fish_without_its_residue():
    bodies, stored = scene().bodies, Drops(1)[0].pixels
    count = len(bodies.poses.codes)
    cutouts = CutoutSet(Drops(count), np.full((count, 2), 15.0))
    shown = PagePictures(Gallery({FRAME: cutouts}, bodies, residue=False))(0).pixels
    assert np.array_equal(shown, drop_residue(stored))
    assert np.count_nonzero(shown[..., 1]) < np.count_nonzero(stored[..., 1])


# --- courses


@pytest.fixture(scope="module")
def dry_run(tmp_path_factory):
    """The record of a session of all kinds of conditions, each shown twice, and the session."""
    plan = plan_of(ALL, order="blocks", repeats=2)
    return run_dry(tmp_path_factory.mktemp("dry"), plan, walk(1))[:2]


def test_a_control_shows_the_very_same_motion_in_another_look(dry_run):
    made = dry_run[1]._motions
    np.testing.assert_array_equal(made["fish"], made["dot"])
    np.testing.assert_array_equal(made["back"], made["fish"][::-1])
    np.testing.assert_array_equal(made["yoked"], made["live"][: len(made["yoked"])])


def test_fish_go_to_their_goals_one_after_the_other():
    made, plan = scene(), plan_of({"a": {"seconds": 40.0} | GOALS}, fish=2)
    states = plan_motion(made, TrialSetup(plan.conditions["a"], 2, 3))
    size = np.array([made.tank.width - 1, made.tank.height - 1])
    for fish in range(2):
        first = [np.hypot(*(states[:, fish, [X, Y]] - share * size).T) for share in (0.2, 0.8)]
        there = [np.flatnonzero(one < 1.5 * made.length_px) for one in first]
        assert len(there[0]) and len(there[1]) and there[0][0] < there[1][0]


def test_a_motion_that_was_broken_off_stays_as_it_ended():
    again = {"seconds": 2.0, "motion": {"again": "a"}}
    made, plan = scene(), plan_of({"a": {"seconds": 2.0} | GOALS, "b": again})
    whole = plan_motion(made, TrialSetup(plan.conditions["a"], 1, 3))
    short = plan_motion(made, TrialSetup(plan.conditions["b"], 1, 3), {"a": whole[:20]})
    assert len(short) == len(whole)
    np.testing.assert_array_equal(short[:20], whole[:20])
    assert (short[20:] == whole[19]).all()


def test_fading_changes_nothing_but_alpha(tmp_path):
    made, plan = scene(), plan_of({"a": {"seconds": 1.5} | RULE}, fade_s=0.4)
    told = []
    for fade in (0.0, 0.4):
        animals = LiveAnimals(plan.animals, made.tank, None)
        reaction = ReactiveMotion(made, TrialSetup(plan.conditions["a"], 1, 1, 0, fade), animals)
        ticks = range(made.count_ticks(1.5))
        told.append(np.stack([reaction.plan_tick(tick / made.rate_hz) for tick in ticks]))
    plain, faded = told
    assert (plain[..., ALPHA] == 1).all() and faded[0, 0, ALPHA] == faded[-1, 0, ALPHA] == 0
    rest = [n for n in range(plain.shape[2]) if n != ALPHA]
    np.testing.assert_array_equal(plain[..., rest], faded[..., rest])


def test_more_fish_than_there_is_room_for_are_refused(monkeypatch):
    made, plan = scene(), plan_of({"a": {"seconds": 1.0} | GOALS})
    monkeypatch.setattr("finloop.plan.planner._MOST_TRIES", 0)  # no place is looked for
    with pytest.raises(FinloopError, match="room for 0 fish"):
        plan_motion(made, TrialSetup(plan.conditions["a"], 2, 3))


# --- closed loop


def greatest(states):
    """The greatest step of a fish's place from tick to tick."""
    return float(np.hypot(*np.diff(states[:, 0, [X, Y]], axis=0).T).max())


def test_spoiled_messages_make_no_fish_jump(tmp_path):
    made = scene()
    goals = plan_of({"a": {"seconds": 30.0} | GOALS}).conditions["a"]
    free = plan_motion(made, TrialSetup(goals, 1, 1))
    plan = plan_of({"live": {"seconds": 12.0} | RULE})
    _, session, _ = run_dry(tmp_path, plan, walk(2, 13), made, "clean")
    spoiled = walk(2, 13, loss=0.2, jitter=0.05, gaps=True)
    _, other, _ = run_dry(tmp_path, plan, spoiled, made, "spoiled")
    assert other.counts.verdicts["late"] > 5 and other.counts.verdicts["taken"] > 100
    for one in (session, other):
        assert greatest(one._motions["live"]) <= greatest(free) * 1.001


def test_a_fish_comes_to_a_still_animal_sooner_than_left_alone(tmp_path):
    still = [(t / 30, json.dumps({"t": t / 30, "id": 1, "x": 150.0, "y": 150.0}))
             for t in range(1200)]  # fmt: skip
    plan, made = plan_of({"live": {"seconds": 30.0} | RULE}), scene()
    near = []
    for messages in (still, []):
        _, session, _ = run_dry(tmp_path, plan, messages, made, f"s{len(messages)}")
        way = session._motions["live"][:, 0, [X, Y]] - 150
        near.append(np.hypot(*way.T).min())
    assert near[0] < 1.5 * made.length_px and near[0] < near[1]


# --- the log


def test_all_that_was_kept_survives_a_cut_anywhere(tmp_path):
    log = Log(tmp_path / "a.journal", {"format": 1})
    sizes = []
    for number in range(6):
        log.add_entry("event", float(number), text=json.dumps({"what": "mark", "number": number}))
        log.add_frame(
            FrameFacts(*range(number, number + 8)), np.full((2, 20), number, np.float32), None
        )
        log.write_entries()
        sizes.append((tmp_path / "a.journal").stat().st_size)
    whole = (tmp_path / "a.journal").read_bytes()  # never closed, as after a power failure
    for cut in [*sizes, *(size - 1 for size in sizes), *(size + 9 for size in sizes[:-1])]:
        path = tmp_path / "cut.journal"
        path.write_bytes(whole[:cut])
        with read_journal(path) as (_, parts):
            rows = sum(part.num_rows for part in parts)
        kept = sum(size <= cut for size in sizes)
        assert 4 * kept <= rows < 4 * (kept + 1), cut
    log.close()
    with pytest.raises(FinloopError, match="exists already"):
        Log(tmp_path / "a.journal", {})


HOLD = """
import sys
from pathlib import Path
from finloop.io.journal import hold_journal
with hold_journal(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_journal_is_held_until_its_process_ends_however_it_does(tmp_path):
    path = tmp_path / "a.journal"
    Log(path, {"format": 1}).close()
    command = [sys.executable, "-c", HOLD, path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as session:
        assert session.stdout.readline() == b"held\n"
        with pytest.raises(FinloopError, match="its session runs"), hold_journal(path):
            pass
        session.kill()
        session.wait()
        with hold_journal(path):
            with pytest.raises(FinloopError, match="is being recovered"), hold_journal(path):
                pass  # two at once
    with pytest.raises(FinloopError, match="cannot be read"), hold_journal(tmp_path / "no.journal"):
        pass


@contextmanager
def opened_session(folder):
    """A session of half a second, as the program opens it; files go to `folder`."""
    made, plan = scene(), plan_of({"a": {"seconds": 0.5} | GOALS})
    film = SimpleNamespace(
        context=made,
        feed=lambda *_, **__: feed_of(made, plan),
        header=lambda *_, **__: header_of(made, plan),
    )
    options = argparse.Namespace(out=folder, protocol=folder / "toy.yaml", display=None)
    with stages.stimulus._open_session(options, plan, film, DryClock()) as session:
        session.waits_for_starts = False
        yield session


def test_the_file_is_whole_when_the_session_ends_and_has_later_notes_at_the_exit(tmp_path):
    with opened_session(tmp_path) as session:
        phases, save = [], session.save_file

        def save_file():
            phases.append(session.phase)
            save()

        session.save_file = save_file
        session.start()
        asyncio.run(session.run_trials())
        assert phases == ["saving"] and session.phase == "done"
        [path] = tmp_path.glob("*.parquet")
        record = open_session_record(path)
        events = [json.loads(row["text"])["what"] for row in record.read_rows("event")]
        assert events == ["begin", "end"] and session.name == str(path)
        made = session.context
        assert replan_session(record, made, session.protocol) == (made.count_ticks(0.5), 0)
        assert "1 | a |" in path.with_suffix(".md").read_text()
        session.log_event("note", text="a late one")
    rows = list(open_session_record(path).read_rows("event"))
    assert "a late one" in rows[-1]["text"] and not list(tmp_path.glob("*.journal"))


def test_recover_refuses_a_session_that_runs_overwrites_nothing_and_leaves_the_journal(tmp_path):
    folder = tmp_path / "a"
    with opened_session(folder) as session:
        session.log_event("note", text="first")
        session.log.write_entries()
        [journal] = folder.glob("*.journal")
        cut = tmp_path / "left.journal"
        cut.write_bytes(journal.read_bytes())  # as if the power had failed
        with pytest.raises(FinloopError, match="its session runs"):
            stages.stimulus.recover(argparse.Namespace(journal=journal))
        session.log_event("note", text="last")
    assert [path.suffix for path in sorted(folder.iterdir())] == [".md", ".parquet"]
    assert "text last" in next(folder.glob("*.md")).read_text()
    before = cut.read_bytes()
    stages.stimulus.recover(argparse.Namespace(journal=cut))
    assert cut.read_bytes() == before and "text first" in cut.with_suffix(".md").read_text()
    with pytest.raises(FinloopError, match=r"left\.parquet exists already"):
        stages.stimulus.recover(argparse.Namespace(journal=cut))


# --- too much


def test_a_budget_is_spent_and_comes_back_with_time():
    budget = Budget(10.0, 2.0)
    assert [budget.spend(4, 0.0) for _ in range(3)] == [True, True, False]
    assert budget.spend(4, 1.0) and not budget.spend(1, 1.0)
    assert budget.spend(10, 100.0) and not budget.spend(1, 100.0)  # never more than at first
    assert not budget.spend(11, 1e6)


def flood(folder, messages, name="toy"):
    """A session that gets messages (time, text) before it is started; its record, and itself."""
    now_s = 0.0
    clock = SimpleNamespace(read_time=lambda: now_s)
    session, _ = session_of(folder, plan_of({"live": {"seconds": 0.4} | RULE}), clock, name=name)
    for time_s, source, text in messages:
        now_s = time_s
        session.receive_message(text, source)
    return session


def close_record(session, folder, name="toy"):
    session.log_unwritten()
    session.log.close()
    journal, path = folder / f"{name}.journal", folder / f"{name}.parquet"
    save_journal(journal, path, SESSION)
    return journal.stat().st_size, open_session_record(path)


def test_a_flood_of_refusals_is_counted_and_hardly_written(tmp_path):
    """Six thousand messages of 1 kB in half a second, from ten senders."""
    sender = ("one", *(f"other {number}" for number in range(9)))
    session = flood(tmp_path, (
        (number * 7e-5, sender[number % 10], b"x" * 1000 if number % 2 else '{"t":1,"id":"<"}')
        for number in range(6000)
    ))  # fmt: skip
    heard = dict(session.counts.verdicts)
    assert sum(heard.values()) == 6000 and heard["malformed"] > 1000
    size, record = close_record(session, tmp_path)
    assert size < 2**20
    written = sum(1 for _ in record.read_rows("input"))
    [event] = [json.loads(row["text"]) for row in record.read_rows("event")]
    assert event.pop("what") == "not written" and sum(event.values()) + written == 6000
    summary = summarise_session(record)
    assert f"malformed {heard['malformed']}" in summary
    assert f"only counted, and not in the log: {sum(event.values())}" in summary


def test_a_tracker_is_heard_while_another_program_floods(tmp_path):
    tracker = [(t / 60, "tracker", json.dumps({"t": t / 60, "id": 1, "x": 150.0, "y": 150.0}))
               for t in range(120)]  # fmt: skip
    noise = [(n / 12_000, "noise", "x" * 200) for n in range(12_000)]
    session = flood(tmp_path, sorted(tracker + noise))
    assert session.counts.verdicts["taken"] == 120 and session.counts.verdicts["flood"] > 1000
    _, record = close_record(session, tmp_path)
    rows = [row for row in record.read_rows("input") if row["source"] == "tracker"]
    assert len(rows) == 120


def test_late_messages_that_are_not_written_change_no_tick(tmp_path):
    """What is needed to plan a session again is always written."""
    made, plan = scene(), plan_of({"live": {"seconds": 1.0} | RULE})
    messages = walk(3, 3, loss=0.2, jitter=0.2)
    late = [(time_s, text) for time_s, text in messages for _ in range(3)]
    clock = DryClock(iter([TimedMessage(*message) for message in late]))
    session, _ = session_of(tmp_path, plan, clock, made)
    clock.receive, session.waits_for_starts = session.receive_message, False
    session.limits._refusals.spend(session.limits._refusals._left, 0.0)
    session.start()
    asyncio.run(session.run_trials())
    _, record = close_record(session, tmp_path)
    assert session.counts.verdicts["late"] > sum(1 for _ in record.read_rows("input")) > 10
    assert replan_session(record, made, plan).different == 0


def test_events_that_a_page_causes_are_written_up_to_a_limit(tmp_path):
    session = flood(tmp_path, ())
    for _ in range(5000):
        session.press_key("x" * 40)
        session.set_hidden(True)
    size, record = close_record(session, tmp_path)
    events = Counter(json.loads(row["text"])["what"] for row in record.read_rows("event"))
    assert size < 2**19 and events["key"] > 100 and events["not written"] == 1
    assert len(session.messages) == 50


def test_what_is_no_session_is_refused_in_plain_words(tmp_path):
    plan = plan_of({"a": {"seconds": 0.5} | GOALS})
    run_dry(tmp_path, plan)
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "toy.parquet").read_bytes()[:-20])
    kinds = pq.read_table(tmp_path / "toy.parquet").select(["kind"])
    pq.write_table(kinds, tmp_path / "other.parquet")
    Log(tmp_path / "new.journal", header_of(scene(), plan, format=99, finloop="9.9")).close()
    save_journal(tmp_path / "new.journal", tmp_path / "new.parquet", SESSION)
    for name, said in (("cut", "cannot be read"), ("none", "cannot be read"), ("other", "is no session"),
                       ("new", r"format 99, made by finloop 9\.9")):  # fmt: skip
        with pytest.raises(FinloopError, match=said):
            open_session_record(tmp_path / f"{name}.parquet")
    (tmp_path / "junk.journal").write_bytes(b"not a journal")
    with pytest.raises(FinloopError, match="journal"), read_journal(tmp_path / "junk.journal"):
        pass


def test_displayed_frames_come_back_bit_for_bit(tmp_path):
    rng, width = np.random.default_rng(0), 20
    log, told = Log(tmp_path / "a.journal", {"format": 1}), []
    for number in range(500):
        count = int(rng.integers(0, 4))
        states = rng.normal(size=(count, width)).astype(np.float32)
        states[:, PICTURE] = np.abs(states[:, PICTURE])
        states[rng.random(count) < 0.2] = ABSENT
        log.add_frame(
            FrameFacts(number, 0.1, number / 60, 0, 0, 0, count, number * 3.0), states, None
        )
        told.append((number, number / 60, number * 3, states.tobytes()))
        if rng.random() < 0.05:
            log.write_entries()
    log.close()
    save_journal(tmp_path / "a.journal", tmp_path / "a.parquet", SESSION)
    with pytest.raises(KeyError):
        open_session_record(tmp_path / "a.parquet").header["protocol"]
    back = [(one.number, one.shown_s, one.digest, one.states.tobytes())
            for one in read_displayed_frames(open_session_record(tmp_path / "a.parquet"))]  # fmt: skip
    assert back == told
    refused = 0
    for eighth in range(1, 8):  # a changed bit of what is read is found out
        damaged = bytearray((tmp_path / "a.parquet").read_bytes())
        damaged[len(damaged) * eighth // 8] ^= 1
        (tmp_path / "b.parquet").write_bytes(damaged)
        try:
            frames = list(read_displayed_frames(open_session_record(tmp_path / "b.parquet")))
        except FinloopError as error:
            assert "b.parquet cannot be read" in str(error)
            refused += 1
        else:
            assert [one.states.tobytes() for one in frames] == [one[3] for one in told]
    assert refused > 3


def test_the_analysis_in_the_docs_is_right_on_fish_that_are_not_drawn_yet(tmp_path):
    """Its standard deviations are those of the frames that show a fish."""
    log = Log(tmp_path / "a.journal", {"format": 1})
    places = np.random.default_rng(0).normal(300, 20, (2, 40, 2)).astype(np.float32)
    for trial, condition in enumerate(("fish", "dot"), 1):
        log.trial = trial
        for what in ("start", "end"):
            text = json.dumps({"what": what, "number": trial, "condition": condition})
            log.add_entry("trial", 0.0, number=trial, text=text)
        shown = np.zeros((40, 20), np.float32)
        shown[:, [X, Y]] = places[trial - 1]
        for number, state in enumerate([*[ABSENT] * 20, *shown]):
            log.add_frame(FrameFacts(number, 0, 0, 0, 0, 0, 1, 0), state[None], trial)
    log.close()
    path = tmp_path / "a.parquet"
    save_journal(tmp_path / "a.journal", path, SESSION)
    guide = Path(__file__).parents[1] / "docs/stimulus.md"
    [example] = re.findall(
        r"```python\n(import json\nimport pandas.*?)```", guide.read_text(), re.S
    )
    names = {}
    exec(re.sub(r'"sessions/.*?"', repr(str(path)), example).replace("print(", "found = ("), names)
    wanted = places.std(axis=1, ddof=1)
    assert names["found"].loc[["fish", "dot"]].to_numpy() == pytest.approx(wanted, rel=1e-4)


def test_numbers_that_the_log_cannot_hold_are_refused():
    for name in FrameFacts._fields:
        for value in (2.0**53, -1e300, np.inf, np.nan):
            facts = FrameFacts(*[0.0] * 8)._replace(**{name: value})
            with pytest.raises(ValueError, match="no record of a frame"):
                parse_frame_records(np.array(facts).tobytes(), 20)


@settings(max_examples=60)
@given(st.binary(max_size=400) | st.lists(st.floats(width=32), max_size=60).map(
    lambda numbers: np.array(numbers, "<f8").tobytes()))  # fmt: skip
def test_no_record_of_frames_breaks_the_reader(content):
    try:
        frames = parse_frame_records(content, 20)
    except ValueError:
        return
    assert all(states.shape[1] == 20 and np.isfinite(states).all() for _, states in frames)


# --- planned again


def random_session(folder, seed, made):
    rng = np.random.default_rng(seed)
    rules = ["approach", "keep distance", "follow", "lead", "avoid", "copy", "mirror"]
    names = rng.permutation(rules)
    conditions = {f"c{n}": {"seconds": 0.5, "motion": {"rule": {"rule": str(name)}}}
                  for n, name in enumerate(names[:2])}  # fmt: skip
    conditions["known"] = {"seconds": 0.4} | GOALS
    conditions["yoked"] = {"seconds": 0.4, "motion": {"again": "c0"}}
    plan = plan_of(conditions, seed=int(seed), order="shuffled", fish=int(rng.integers(1, 3)))
    messages = walk(seed, 8, loss=0.2, jitter=0.05)
    return run_dry(folder, plan, messages, made, f"r{seed}"), plan


def test_random_sessions_are_planned_again_bit_for_bit(tmp_path):
    made, anew = scene(), 0
    for seed in range(8):  # `benchmarks.stimulus` plans a hundred of a film
        (record, _, _), plan = random_session(tmp_path, seed, made)
        told = replan_session(record, made, plan)
        assert told.ticks > 20 and told.different == 0, seed
        anew += int((load_log_table(record)["verdict"] == "anew").sum())
    assert anew > 8


def test_another_input_is_found_out(tmp_path):
    made = scene()
    (record, _, _), plan = random_session(tmp_path, 3, made)
    table = pq.read_table(record.path)
    texts = [text and text.replace('"x": ', '"x": 1') for text in table["text"].to_pylist()]
    changed = table.set_column(table.schema.get_field_index("text"), "text", [texts])
    pq.write_table(changed.cast(table.schema), tmp_path / "changed.parquet")
    assert (
        replan_session(open_session_record(tmp_path / "changed.parquet"), made, plan).different > 0
    )


# --- times


def test_the_summary_tells_what_was_shown_and_how_soon(dry_run):
    record, session = dry_run
    text, table = summarise_session(record), load_log_table(record)
    for name in ALL:
        assert text.count(f"| {name} |") == 2
    assert "numpy 2" in text and "taken" in text and "seed 5" in text
    assert session.done == dict.fromkeys(range(1, 11), "done")
    planned_ms, _ = measure_reactions_ms(table, record.header["rate_hz"])
    assert len(planned_ms) and (planned_ms == 0).all()  # nothing lasts on this clock
    errors = measure_tick_errors_ms(table)
    assert len(errors) > 50 and np.abs(errors).max() < 1e-6


def test_names_and_notes_are_no_markup_in_the_summary(tmp_path):
    bad = "<script>x</script>\n# a `b` [c](javascript:d) | *e* &lt; \x1b[31m"
    plan = plan_of({"<b>|a": {"seconds": 0.5} | GOALS}, name="<img src=x onerror=y>")
    session, _ = session_of(tmp_path, plan, DryClock())
    assert handle_request(session, json.dumps({"do": "note", "text": bad}))
    facts = {"name": "<i>", "renderer": bad, "width": 1, "height": 1, "calibrated": False}
    session.set_display(facts | {"page": "a"}, 1)
    session.receive_message("x", "<u>")
    session.waits_for_starts = False
    session.start()
    asyncio.run(session.run_trials())
    text = summarise_session(close_record(session, tmp_path)[1])
    assert not re.search(r"<(?!=)|\x1b", text) and text.count("\n# ") == 0
    assert r"\[c\](javascript:d) \| \*e\* &amp;lt;" in text and "&lt;b&gt;\\|a" in text


def test_input_to_frame_is_the_first_frame_in_which_it_shows(tmp_path):
    plan, clock = plan_of({"live": {"seconds": 3.0} | RULE}), DryClock()
    session, _ = session_of(tmp_path, plan, clock)
    rate, width = session.context.rate_hz, session.context.width
    session.waits_for_starts = False
    session.start()

    async def run_session():
        running = asyncio.create_task(session.run_trials())
        while session._tick < 5:
            await asyncio.sleep(0)
        session.receive_message('{"t": 1.0, "id": 1, "x": 30.0, "y": 30.0}', "a")
        seq, due, heard = session._seq, session._due_s, clock.read_time()
        for number, at in enumerate((due - 1.2 / rate, due - 0.9 / rate, due)):
            facts = np.array([number, at, at, at + 0.004, seq, 0, 0, 0])
            session.record_frames(facts.tobytes())
        await running
        return due, heard

    due, heard = asyncio.run(run_session())
    wanted = 1e3 * (due - 0.9 / rate + 0.004 - heard)
    assert list(session.counts.drawn_ms) == pytest.approx([wanted])
    session.log.close()
    save_journal(tmp_path / "toy.journal", tmp_path / "toy.parquet", SESSION)
    _, drawn = measure_reactions_ms(
        load_log_table(open_session_record(tmp_path / "toy.parquet")), rate
    )
    assert drawn == pytest.approx([wanted])
    assert width > 20


def test_a_clock_that_jumps_is_told(tmp_path):
    session, _ = session_of(tmp_path, plan_of(ALL), DryClock())
    for wall in (100.0, 100.2, 400.0, 400.1, 50.0):
        session.check_wall_clock(wall)
    session.log.close()
    jumps = [text for text in session.messages if "clock jumped" in text]
    assert len(jumps) == 2 and "299.8" in jumps[0]


def test_a_display_that_goes_in_a_trial_is_told_and_frames_count_on(tmp_path):
    session, _ = session_of(tmp_path, plan_of({"a": {"seconds": 1.0} | GOALS}), DryClock())
    session.set_display(DISPLAY, 1)
    record = np.array([6, 0, 0, 0, 0, 0, 0, 0.0]).tobytes()
    session.record_frames(record)
    session.phase, session.trial_index = "running", 0
    session.set_display(None, 0)
    assert session.display is None and "display has gone" in session.messages[-1]
    session.set_display(DISPLAY | {"page": "b"}, 1)
    session.record_frames(np.array([1, 0, 0, 0, 0, 0, 0, 0.0]).tobytes())
    assert session._last_frame == 9  # the parity that the square shows stays
    session.record_frames(b"nonsense")
    assert session.counts.bad == 1
    session.log.close()


def test_frames_that_are_drawn_after_the_next_is_due_are_late(tmp_path):
    session, _ = session_of(tmp_path, plan_of({"a": {"seconds": 1.0} | GOALS}), DryClock())
    session.set_display(DISPLAY, 1)
    for number, took in enumerate((4, 5, 17, 4, 40)):
        at = 10 + number / 60
        session.record_frames(
            np.array([number + 1, at, at, at + took / 1000, 0, 0, 0, 0]).tobytes()
        )
    session.log.close()
    assert (session.counts.frames, session.counts.late) == (5, 2)


def test_a_session_that_is_stopped_while_a_trial_waits_ends_without_it(tmp_path):
    plan = plan_of({"a": {"seconds": 1.0} | GOALS}, start={"key": "space"}, repeats=2)
    session, _ = session_of(tmp_path, plan, DryClock())
    session.set_display(DISPLAY, 1)
    session.note_frame()

    async def run_session():
        session.start()
        running = asyncio.create_task(session.run_trials())
        for number in range(2):
            while session.phase != "waiting":
                await asyncio.sleep(0)
            session.press_key("x")  # another one
            assert session.phase == "waiting" and len(session.done) == number
            session.press_key(" ") if number == 0 else session.stop()
            while session.phase == "waiting":
                await asyncio.sleep(0)
        await running

    asyncio.run(run_session())
    session.log.close()
    assert session.done == {1: "done"} and session.phase == "done"


def test_no_trial_runs_before_a_display_that_has_stopped_to_draw(tmp_path):
    """It went in the pause: neither key nor Start begins the next trial before frames come again."""
    plan = plan_of({"a": {"seconds": 0.5} | GOALS}, repeats=2, pause_s=10)
    session, _ = session_of(tmp_path, plan, DryClock())
    session.set_display(DISPLAY, 1)

    async def run_session():
        session.start()
        assert not session._begun.is_set()
        session.note_frame()
        session.start()
        running = asyncio.create_task(session.run_trials())
        while session.phase != "waiting":
            await asyncio.sleep(0)
        assert session.done == {1: "done"} and "a trial waits for Start" in session.messages[-1]
        session.start()
        session.note_frame()
        session.set_hidden(True)
        session.start()
        await asyncio.sleep(0)
        assert session.phase == "waiting" and "not started" in str(session.messages)
        session.set_hidden(False)
        session.start()
        await running

    asyncio.run(run_session())
    session.log.close()
    assert session.done == {1: "done", 2: "done"}


def test_every_frame_of_a_trial_has_its_number_however_late_it_is_reported(tmp_path):
    """All frames are reported after the last trial, as if the network had been slow."""
    plan = plan_of({"a": {"seconds": 0.5} | GOALS, "b": {"seconds": 0.5} | GOALS})
    session, _ = session_of(tmp_path, plan, DryClock())
    session.waits_for_starts = False
    session.start()
    asyncio.run(session.run_trials())
    rate, wanted = session.context.rate_hz, []
    begins_s = [begin_s for _, begin_s, _ in session._trial_begins]
    for trial, begin_s in enumerate(begins_s, 1):
        seqs = [0, 0, *range(session._trial_begins[trial - 1][0], session._seq // 2 * trial + 1)]
        for tick, seq in enumerate(seqs):  # its fish are not drawn yet, are drawn, have gone
            at = begin_s + tick / rate
            fish = np.zeros(-(-session.context.width // 2) * 8, np.uint8)
            facts = [len(wanted) + 1, at, at, at, seq, 0, 1, 0]
            session.record_frames(np.array(facts, float).tobytes() + fish.tobytes())
            wanted.append(trial)
        session.record_frames(np.array([len(wanted) + 1, at, at, at, 0, 0, 0, 0]).tobytes())
        wanted.append(None)
    _, record = close_record(session, tmp_path)
    assert [row["trial"] for row in record.read_rows("frame")] == wanted
    assert session.counts.bad == 0 and wanted.count(2) > 10


# --- the feed


def read(message):
    """The facts and the payload of a message to the display."""
    length = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + length]), message[4 + length :]


def test_a_picture_is_sent_once_and_slots_are_used_again():
    made, plan = scene(), plan_of({"a": {"seconds": 1.0} | GOALS})
    feed = feed_of(made, plan, slots=(1024, 1024))
    assert feed.slot_count == 256
    states = np.zeros((1, made.width), np.float32)

    def sent_pictures(picture, partner=-1):
        states[0, [PICTURE, PARTNER]] = picture, partner
        facts = [read(one)[0] for one in feed.tick_messages(1, 0, 0.0, states)[:-1]]
        return [(one["picture"], one["slot"]) for one in facts]

    assert sent_pictures(3, 4) == [(3, 0), (4, 1)] and sent_pictures(3, 4) == sent_pictures(4) == []
    for picture in range(10, 10 + 254):
        assert len(sent_pictures(picture)) == 1
    sent_pictures(3)
    assert sent_pictures(9) == [(9, 1)]  # that of 4, long unused
    assert sent_pictures(3) == [] and len(sent_pictures(4)) == 1
    kinds = [read(one)[0]["kind"] for one in feed.opening_messages()]
    assert kinds == ["hello", *["picture"] * 256, "rows"]
    assert read(pack_message({"a": 1}, b"abc")) == ({"a": 1}, b"abc")


def test_a_pause_counts_down_as_a_trial_does(tmp_path):
    plan = plan_of({"a": {"seconds": 0.5} | GOALS}, repeats=2, pause_s=10)
    session, _ = session_of(tmp_path, plan, DryClock())
    session.waits_for_starts, left = False, {"pause": [], "running": []}
    wait_until = session.clock.wait_until

    async def note_left(time_s):
        if session.phase in left:
            left[session.phase].append(session.remaining_s(session.clock.read_time()))
        await wait_until(time_s)

    session.clock.wait_until = note_left
    session.start()
    asyncio.run(session.run_trials())
    session.log.close()
    pause = [seconds for seconds in left["pause"] if seconds is not None]
    assert pause == sorted(pause, reverse=True) and max(pause) == 10 and min(pause) <= 0.1
    assert max(left["running"]) <= 0.8 and session.remaining_s(0.0) is None
