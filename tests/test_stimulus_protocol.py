"""Protocols of a stimulus: what they allow, their order, their seeds, and controls of a motion."""

import re
from collections import Counter
from hashlib import sha256
from itertools import pairwise, permutations
from typing import get_args

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare

from finloop.base.errors import FinloopError
from finloop.show.drawn import ALPHA, HEADING, LOOK, MIRRORED, PARTNER, PICTURE, POSTURE, X, Y
from finloop.stimulus.animals import Verdict
from finloop.stimulus.listing import describe_protocol
from finloop.stimulus.motion import (
    TrialSetup,
    apply_change,
    count_ticks_to_plan,
    fade_opacities,
    interpolate_states,
)
from finloop.stimulus.order import fill_trigger_text, find_source_trial, order_trials
from finloop.stimulus.protocol import (
    AnimalSettings,
    Condition,
    DisplayRequirements,
    Look,
    Motion,
    MotionChange,
    Protocol,
    RuleSpec,
    Trigger,
    derive_motion_seed,
)
from finloop.stimulus.protocol_file import MOST_BYTES, load_protocol, parse_protocol, read_yaml

EXAMPLE = ROOT / "examples/protocol.yaml"
HEAD = "version: 1\nname: toy\nseed: 1\n"
WANDER = {"seconds": 10, "motion": {"wander": True}}


def plan(conditions, **more):
    return parse_protocol({"version": 1, "name": "toy", "seed": 5, "conditions": conditions} | more)


def yoked_condition(name, seconds=10.0, **more):
    return {"seconds": seconds, "motion": {"again": name}} | more


def names(protocol, seed=5):
    return tuple(one.condition for one in order_trials(protocol.model_copy(update={"seed": seed})))


# --- controls


def states_of(ticks=21, fish=3, seed=0):
    """Motion as a display draws it: any places, headings all around, pictures that change."""
    draw = np.random.default_rng(seed)
    states = draw.normal(size=(ticks, fish, POSTURE + 6)).astype(np.float32)
    states[..., HEADING] = draw.uniform(-np.pi, np.pi, (ticks, fish))
    states[..., [PICTURE, PARTNER]] = draw.integers(0, 900, (ticks, fish, 2))
    states[..., MIRRORED], states[..., LOOK], states[..., ALPHA] = 0, 0, 1
    return states


def test_a_motion_that_is_reversed_twice_is_itself():
    states, back = states_of(), MotionChange(reversed=True)
    once = apply_change(states, back, 21)
    assert np.array_equal(once[0], states[-1])
    assert np.array_equal(apply_change(once, back, 21), states)


@pytest.mark.parametrize("change", [None, MotionChange(), MotionChange(speed=1.0)])
def test_what_changes_nothing_changes_nothing(change):
    states = states_of()
    assert np.array_equal(apply_change(states, change, len(states)), states)
    assert count_ticks_to_plan(change, 21) == 21


def test_twice_the_speed_takes_half_the_time():
    states = states_of(21)
    states[..., X] = 3 * np.arange(21)[:, None]
    fast = apply_change(states, MotionChange(speed=2.0), 11)
    assert len(fast) - 1 == (len(states) - 1) / 2
    assert np.allclose(np.diff(fast[..., X], axis=0), 6)
    assert np.array_equal(fast, states[::2])
    slow = apply_change(states, MotionChange(speed=0.5), 41)
    assert len(slow) - 1 == 2 * (len(states) - 1)
    assert np.allclose(np.diff(slow[..., X], axis=0), 1.5)
    assert np.array_equal(slow[::2], states)
    back = apply_change(states, MotionChange(speed=2.0, reversed=True), 11)
    assert np.array_equal(back, states[::-2])


@given(
    ticks=st.integers(1, 300), speed=st.floats(0.1, 8), back=st.booleans(), more=st.integers(0, 50)
)
def test_as_much_is_planned_as_is_shown(ticks, speed, back, more):
    change = MotionChange(speed=speed, reversed=back)
    wanted = count_ticks_to_plan(change, ticks)
    assert (wanted - 2) < (ticks - 1) * speed <= wanted - 1 + 1e-6
    states = np.zeros((wanted + more, 1, POSTURE), np.float32)
    states[..., X] = np.arange(len(states))[:, None]
    shown = apply_change(states, change, ticks)
    assert len(shown) == ticks
    assert shown[..., X].min() >= 0 and shown[..., X].max() <= wanted - 1  # of the first part
    assert np.allclose(np.abs(np.diff(shown[..., X], axis=0)), speed, atol=1e-3)


def test_what_is_still_does_not_move():
    states, still = states_of(), MotionChange(still=True)
    assert count_ticks_to_plan(still, 500) == 1
    shown = apply_change(states[:1], still, 500)
    assert shown.shape == (500, *states.shape[1:])
    assert np.array_equal(shown, np.broadcast_to(states[0], shown.shape))


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_between_two_ticks(share):
    states = states_of(400, 1)
    at = np.arange(399) + share
    shown = interpolate_states(states, at)
    before, after = states[:-1].astype(float), states[1:].astype(float)
    # The heading turns the shorter way: what is left to both ends is what lies between them.
    way = np.abs((after - before)[..., HEADING])
    way = np.minimum(way, 2 * np.pi - way)
    for tick, part in ((before, share), (after, 1 - share)):
        turn = np.abs((shown - tick)[..., HEADING]) % (2 * np.pi)
        assert np.allclose(np.minimum(turn, 2 * np.pi - turn), part * way, atol=1e-4)
    for linear in (X, Y, ALPHA, POSTURE, POSTURE + 5):
        mixed = (1 - share) * before + share * after
        assert np.allclose(shown[..., linear], mixed[..., linear], atol=1e-5)
    nearer = before if share < 0.5 else after
    assert np.array_equal(shown[..., PICTURE : LOOK + 1], nearer[..., PICTURE : LOOK + 1])
    assert np.array_equal(interpolate_states(states, np.arange(400.0)), states)


def test_a_fish_that_comes_or_goes_does_not_slide_in_from_nowhere():
    states = states_of(3, 2)
    states[1, 0, PICTURE] = -1
    shown = interpolate_states(states, np.array([0.4, 0.6, 1.4, 1.6]))
    assert np.array_equal(shown[:, 0], states[[0, 1, 1, 2], 0])
    assert not np.array_equal(shown[:, 1], states[[0, 1, 1, 2], 1])


def test_fish_get_their_look_and_fade_in_and_out():
    setup = TrialSetup(Condition(seconds=1.0, motion=Motion(wander=True)), 3, 0, look=3, fade_s=0.5)
    states = states_of(41)
    states[..., ALPHA] = 0.5
    shown = setup.apply_look_and_fade(states, 20.0)
    alpha = shown[:, 0, ALPHA]
    assert alpha[0] == alpha[-1] == 0 and np.all(alpha[10:31] == 0.5)
    assert np.allclose(np.diff(alpha[:11]), 0.05) and np.array_equal(alpha, alpha[::-1])
    assert np.all(shown[..., LOOK] == 3)
    rest = [column for column in range(states.shape[2]) if column not in (ALPHA, LOOK)]
    assert np.array_equal(shown[..., rest], states[..., rest])
    assert np.all(states[..., ALPHA] == 0.5) and np.all(states[..., LOOK] == 0)  # what was given
    assert np.all(fade_opacities(3, 0) == 1)
    assert np.array_equal(fade_opacities(5, 100) > 0, [False, True, True, True, False])


# --- seeds


def test_conditions_of_one_motion_have_one_seed_whatever_their_looks():
    protocol = plan({
        "fish": WANDER,
        "dot": WANDER | {"look": {"as": "dot"}, "seconds": 3},
        "back": WANDER | {"change": {"reversed": True}},
        "goal": {"seconds": 10, "motion": {"goal": [0.5, 0.5]}},
        "goals": {"seconds": 10, "motion": {"goals": [[0.5, 0.5]]}},
    }, repeats=3, order="shuffled")  # fmt: skip
    seeds = {}
    for trial in order_trials(protocol):
        assert 0 <= trial.seed < 2**53
        seeds.setdefault(trial.repeat, {})[trial.condition] = trial.seed
    for repeat, of in seeds.items():
        assert of["fish"] == of["dot"] == of["back"] == derive_motion_seed(protocol, "fish", repeat)
    assert len({seed for of in seeds.values() for seed in of.values()}) == 9
    other = protocol.model_copy(update={"seed": 6})
    assert derive_motion_seed(other, "fish", 1) != seeds[1]["fish"]
    digest = sha256(b'[5, "{\\"wander\\":true}", 1]').hexdigest()
    assert seeds[1]["fish"] == int(digest[:14], 16) >> 3  # its first 53 bits, for ever


def test_looks_have_numbers_of_their_own():
    protocol = plan({
        "a": WANDER, "b": WANDER | {"look": {"as": "dot", "colour": [9, 8, 7]}},
        "c": WANDER | {"look": {"as": "fish", "contrast": 1}},
    })  # fmt: skip
    assert [look.to_json_values for look in protocol.looks] == [
        {"as": "fish", "contrast": 1.0, "size": 1.0, "colour": None},
        {"as": "dot", "contrast": 1.0, "size": 1.0, "colour": [9, 8, 7]},
    ]
    looks = [protocol.looks.index(one.look) for one in protocol.conditions.values()]
    assert looks == [0, 1, 0]


# --- orders


def valid_orders(protocol, blocks=False):
    """All orders that may be, by trying every one."""
    count = protocol.repeats
    every = set(permutations(list(protocol.conditions) * count))
    for order in every:
        first = {name: order.index(name) for name in protocol.conditions}
        again = {name: one.motion.again for name, one in protocol.conditions.items()}
        if any(of and first[of] > first[name] for name, of in again.items()):
            continue
        size = len(protocol.conditions)
        parts = [order[at : at + size] for at in range(0, len(order), size)]
        if not blocks or (
            all(len(set(part)) == size for part in parts)
            and all(a[-1] != b[0] for a, b in pairwise(parts))
        ):
            yield order


CHAIN = {"a": WANDER, "b": yoked_condition("a"), "c": yoked_condition("b")}
PAIR = {"a": WANDER, "b": yoked_condition("a"), "c": WANDER}


FREE, YOKED = {"a": WANDER, "b": WANDER}, {"a": WANDER, "b": yoked_condition("a")}
ORDERS = [
    (FREE, "shuffled", 3), (CHAIN, "shuffled", 2), (FREE | {"c": WANDER}, "blocks", 2), (PAIR, "blocks", 2),
]  # fmt: skip


@pytest.mark.parametrize("conditions, order, repeats", ORDERS)
def test_every_permitted_order_is_as_likely(conditions, order, repeats):
    protocol = plan(conditions, order=order, repeats=repeats)
    every = sorted(valid_orders(protocol, order == "blocks"))
    counts = Counter(names(protocol, seed) for seed in range(40 * len(every)))
    assert set(counts) == set(every)
    assert chisquare([counts[one] for one in every]).pvalue > 1e-3 or len(every) == 1


@given(
    seed=st.integers(0, 2**53 - 1), count=st.integers(1, 7), repeats=st.integers(1, 6),
    order=st.sampled_from(["given", "shuffled", "blocks"]),
)  # fmt: skip
def test_what_holds_of_any_order(seed, count, repeats, order):
    conditions = {f"c{number}": WANDER for number in range(count)}
    if count > 3:
        conditions["c3"] = yoked_condition("c1")
    protocol = plan(conditions, order=order, repeats=repeats, seed=seed)
    rows = order_trials(protocol)
    assert [one.number for one in rows] == list(range(1, count * repeats + 1))
    for name in conditions:
        assert [one.repeat for one in rows if one.condition == name] == list(range(1, repeats + 1))
    of = [find_source_trial(protocol, rows, one) for one in rows]
    for one, shown in zip(rows, of, strict=True):
        assert (shown is not None) == (one.condition == "c3" and count > 3)
        if shown:
            before = [row for row in rows[: one.number - 1] if row.condition == "c1"]
            assert shown == before[-1]
    if order != "shuffled":
        for block in range(1, repeats + 1):
            held = [one.condition for one in rows if one.block == block]
            assert sorted(held) == sorted(conditions)
            assert order == "blocks" or held == list(conditions)
    if order == "blocks" and count > 1:
        assert all(a.condition != b.condition for a, b in pairwise(rows))


def test_an_order_is_the_same_on_any_machine():
    """Made with the code as it stood at first: a protocol must give the same order for ever."""
    conditions = dict.fromkeys("abcde", WANDER) | {"f": yoked_condition("b")}
    for order, wanted in (("shuffled", "aeddcbdcbfaeacffbe"), ("blocks", "bdefacfdecbacadfbe")):
        assert "".join(names(plan(conditions, order=order, repeats=3), 2026)) == wanted


# --- what a protocol says


def test_the_example_is_a_protocol_and_comes_back_from_its_values():
    protocol = load_protocol(EXAMPLE)
    values = protocol.model_dump(mode="json", by_alias=True)
    assert parse_protocol(values, EXAMPLE.parent) == protocol
    assert set(protocol.conditions) == {one.condition for one in order_trials(protocol)}
    kinds = {one.motion.kind for one in protocol.conditions.values()}
    assert {"rule", "again", "wander"} <= kinds


def test_a_start_is_a_key_or_a_message_or_none():
    for key, page in (("space", " "), ("enter", "Enter"), ("g", "g"), ("ß", "ß")):
        protocol = plan({"a": WANDER}, start={"key": key})
        assert (protocol.start_key, protocol.start_message) == (page, None)
        again = parse_protocol(protocol.model_dump(mode="json", by_alias=True))
        assert again.start_key == page
    for start, message in (({"message": "go"}, "go"), ("auto", None)):
        protocol = plan({"a": WANDER}, start=start)
        assert (protocol.start_key, protocol.start_message) == (None, message)


def test_a_trigger_names_its_trial():
    text = "{{{at}}} {trial}/{block}/{repeat} {condition}"
    protocol = plan(
        {"{trial}": WANDER, "b": WANDER},
        triggers=[{"at": "end", "to": "udp://lab-pc.local:5005", "text": text}], repeats=2,
    )  # fmt: skip
    said = [fill_trigger_text(protocol.triggers[0], one) for one in order_trials(protocol)]
    assert said == ["{end} 1/1/1 {trial}", "{end} 2/1/1 b", "{end} 3/2/2 {trial}", "{end} 4/2/2 b"]


def test_the_listing_says_all_that_is_shown_and_demanded(tmp_path):
    protocol = load_protocol(EXAMPLE)
    text = describe_protocol(protocol, order_trials(protocol))
    lines = text.splitlines()
    assert lines[0] == "motion or looks: 35 trials, in blocks; seed 2026"
    assert "takes 0:52:00" in lines  # 35 trials of 60 s, 34 pauses of 30 s
    assert "the very same motion in each repeat: fish, dot, still, backwards, empty" in lines
    assert "required: fish that are 30 mm long on the display" in lines
    assert not any(line != line.rstrip() for line in lines)
    rows = lines[-35:]
    assert [int(row.split()[0]) for row in rows] == list(range(1, 36))
    assert rows[1].split()[1] == "0:01:30"
    assert all(("as trial" in row) == ("yoked" in row) for row in rows)
    (tmp_path / "way.csv").write_text("x,y\n0,0\n1,1\n")
    protocol = parse_protocol(
        {
            "version": 1, "name": "all", "seed": 1, "fish": 2, "animals": {"unit": "mm"},
            "display": {"calibrated": False}, "start": {"key": "space"},
            "conditions": {
                "goals": {"seconds": 1, "motion": {"goals": [[0, 1]] * 5}},
                "way": {"seconds": 1, "motion": {"path": "way.csv"}, "change": {"speed": 2}},
                "all": {"seconds": 1, "motion": {"company": True}, "change": {"still": True}},
                "after": {"seconds": 1, "motion": {"rule": {"rule": "follow", "animal": "7"}}},
                "grey": {"seconds": 1, "motion": {"goal": [0, 0]},
                         "look": {"as": "dot", "contrast": 0.5, "size": 2, "colour": [1, 2, 3]}},
            },
        },
        tmp_path,
    )  # fmt: skip
    text = describe_protocol(protocol, order_trials(protocol))
    for word in (
        "to (0, 1), (0, 1), (0, 1) and 2 more", "along way.csv", "2 times as fast", "in a group",
        "still", "follow, animal 7", "dot, contrast 0.5, size 2, colour 1-2-3", "space bar",
        "any display", "waits for a start", "from, at the earliest", "places in mm",
    ):  # fmt: skip
        assert word in text, word


# --- what is refused


def complaint(folder, content):
    """What is said of a file, line by line, without its head."""
    path = folder / "bad.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(FinloopError) as caught:
        load_protocol(path)
    return caught.value.came.splitlines()[1:]


def refuse(folder, content, *wanted):
    """All complaints, each of which must begin with what is wanted of it."""
    lines = [line.strip() for line in complaint(folder, content)]
    assert len(lines) == len(wanted), lines
    for line, beginning in zip(lines, wanted, strict=True):
        assert line.startswith(beginning), line


CONDITION = "  a: {seconds: 10, motion: {wander: true}}\n"


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("fish: 0\n", "line 4: fish: should be greater than or equal to 1, got 0"),
        ("fish: two\n", 'line 4: fish: should be a valid integer, got "two"'),
        ("fish: true\n", "line 4: fish: should be a valid integer, got true"),
        ("fish:\n", "line 4: fish: should be a valid integer, got null"),
        ("fsh: 2\n", "line 4: fsh: unknown; did you mean fish?"),
        ("zzz: 2\n", "line 4: zzz: unknown; known: version, name"),
        ("mode: hybrid\n", "line 4: mode: unknown; leave it out: the stimulus is always of mode matching"),
        ("pause_s: .inf\n", 'line 4: pause_s: should be a valid number, got ".inf"'),
        ("pause_s: 1e999\n", "line 4: pause_s: should be a finite number, got Infinity"),
        ("pause_s: 1:30\n", 'line 4: pause_s: should be a valid number, got "1:30"'),
        ("display: {calibrated: no}\n", 'line 4: display.calibrated: should be a valid boolean, got "no"'),
        ("display: 5\n", "line 4: display: should be keys with values, got 5"),
        ("display:\n  fish_mm: 3\n  calibrated: false\n", "line 5: display.fish_mm: requires a calibrated display"),
        ("order: random\n", "line 4: order: should be 'given', 'shuffled' or 'blocks', got"),
        ("start: soon\n", "line 4: start: should be 'auto', got"),
        ("start: {}\n", "line 4: start: should be exactly one of key, message"),
        ("start: {key: F1}\n", 'line 4: start.key: should be space, enter, or one character, got "F1"'),
        ("triggers: {at: end}\n", "line 4: triggers: should be a list, got"),
        ("triggers:\n  - at: start\n    to: tcp://a:1\n    text: b\n", "line 6: triggers[0].to: should be socket, or udp://host:port"),
        ("triggers:\n  - {at: start, to: 'udp://a:99999', text: b}\n", "line 5: triggers[0].to: should be socket"),
        ("triggers:\n  - {at: start, to: socket, text: '{seed}'}\n", "line 5: triggers[0].text: may name {trial}"),
        ("triggers:\n  - {at: start, to: socket, text: '{trial.x}'}\n", "line 5: triggers[0].text: may name"),
        ("triggers:\n  - {at: start, to: socket, text: '{'}\n", "line 5: triggers[0].text: may name"),
        ("triggers:\n  - {at: start, to: socket, text: '{trial:>999999999}'}\n", "line 5: triggers[0].text: may name"),
        ("animals: {unit: inch}\n", "line 4: animals.unit: should be 'px' or 'mm'"),
        ("animals:\n  points:\n    - {tracker: [1, 2], tank: [3, 4]}\n", "line 4: animals: the tracker's calibration is invalid"),
        ("name: ' a'\n", "line 4: name is repeated, first in line 2"),
        ("order: !random given\n", "line 4: the tag !random is not known here"),
        ("<<: {fish: 2}\n", "line 4: << (a merge) is not known here"),
        ("[1, 2]: 3\n", "line 4: a list or a group is no key"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_line(tmp_path, text, wanted):
    refuse(tmp_path, HEAD + text + "conditions:\n" + CONDITION, wanted)


@pytest.mark.parametrize(
    ("condition", "wanted"),
    [
        ("{seconds: 10}", "motion: has no value"),
        ("{motion: {wander: true}}", "seconds: has no value"),
        ("5", "should be keys with values, got 5"),
        ("{seconds: 10, motion: {}}", "motion: should be exactly one of goal, goals"),
        ("{seconds: 10, motion: {wander: true, goal: [0, 0]}}", "motion: should be exactly one of"),
        ("{seconds: 10, motion: {wander: false}}", "motion.wander: should be True, got false"),
        ("{seconds: 10, motion: {goal: [0.5]}}", "motion.goal[1]: has no value"),
        ("{seconds: 10, motion: {goal: [0.5, 2]}}", "motion.goal[1]: should be less than or equal to 1"),
        ("{seconds: 10, motion: {goals: []}}", "motion.goals: "),
        ("{seconds: 10, motion: {path: none.csv}}", "motion.path: there is no file"),
        ("{seconds: 10, motion: {path: bad.yaml}}", "motion.path: should be a file .csv, .parquet, .svg"),
        (f"{{seconds: 10, motion: {{path: {'n' * 300}.csv}}}}", "motion.path: there is no file"),
        ("{seconds: 10, motion: {again: b}}", "motion.again: there is no condition b"),
        ("{seconds: 10, motion: {again: a}}", "motion.again: never has a motion of its own: a shows a again"),
        ("{seconds: 10, motion: {company: true}}", "motion.company: requires at least two fish"),
        ("{seconds: 10, motion: {rule: {rule: follow}}}", "motion.rule: requires live animals"),
        ("{seconds: 10, motion: {rule: {rule: obey}}}", "motion.rule.rule: should be 'approach'"),
        ("{seconds: 10, motion: {wander: true}, look: {colour: [1, 2, 3]}}", "look: colour is of a dot"),
        ("{seconds: 10, motion: {wander: true}, look: {as: cube}}", "look.as: should be 'fish', 'dot' or"),
        ("{seconds: 10, motion: {wander: true}, change: {still: true, speed: 2}}", "change: what is still"),
        ("{seconds: 10, motion: {wander: true}, change: {speed: 9}}", "change.speed: should be less than"),
        ("{seconds: 0, motion: {wander: true}}", "seconds: should be greater than or equal to 0.1"),
        ("{seconds: 86400, motion: {wander: true}, change: {speed: 2}}", "seconds: is too long for 1 fish"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_condition_is_said(tmp_path, condition, wanted):
    where = "conditions.a: " if wanted.startswith("should be keys") else "conditions.a."
    refuse(tmp_path, f"{HEAD}conditions:\n  a: {condition}\n", f"line 5: {where}{wanted}")


def test_what_contradicts_itself_is_refused(tmp_path):
    start = HEAD + "animals: {}\nconditions:\n"
    rule = "  a: {seconds: 10, motion: {rule: {rule: follow}}, change: {reversed: true}}\n"
    refuse(tmp_path, start + rule, "line 6: conditions.a.change: requires a motion that is known")
    again = "  {}: {{seconds: 1, motion: {{again: {}}}}}\n".format
    circle = "".join(again(*pair) for pair in ("ab", "bc", "ca"))
    said = "line {}: conditions.{}.motion.again: never has a motion of its own".format
    wanted = [said(6, "a"), said(7, "b"), said(8, "c")]
    refuse(tmp_path, start + circle, *wanted)
    refuse(tmp_path, start + circle + again("d", "a"), *wanted)  # it leads into the circle
    before = again("b", "a") + CONDITION
    refuse(tmp_path, start + before, "line 6: conditions.b.motion.again: comes before a in the")
    load = start.replace("animals: {}", "order: shuffled") + before
    (tmp_path / "good.yaml").write_text(load)
    assert names(load_protocol(tmp_path / "good.yaml")) == ("a", "b")
    longer = CONDITION + "  b: {seconds: 6, motion: {again: a}, change: {speed: 2}}\n"
    refuse(tmp_path, start + longer, "line 7: conditions.b.seconds: takes 12 s of the motion of a")
    still = longer.replace("speed: 2", "still: true")
    (tmp_path / "good.yaml").write_text(start + still)
    load_protocol(tmp_path / "good.yaml")
    fades = start.replace("animals: {}", "fade_s: 6") + CONDITION
    refuse(tmp_path, fades, "line 6: conditions.a.seconds: should be at least two fades of 6 s")
    many = start.replace("animals: {}", "repeats: 5001") + CONDITION + CONDITION.replace("a:", "b:")
    refuse(tmp_path, many, "line 4: repeats: gives more than 10000 trials")


def test_all_that_is_wrong_is_said_at_once_in_the_order_of_its_lines(tmp_path):
    text = (
        "version: 2\nname: toy\nseed: -1\nfish: 1\nfish: 2\nspeed: 1\nconditions:\n"
        "  a: {seconds: long, motion: {wander: true}}\n"
        "  b:\n    seconds: 10\n    motion: {again: aa}\n"
        "  c: {seconds: 10, motion: {path: none.csv}}\n"
    )
    lines = [line.strip().split(":")[:2] for line in complaint(tmp_path, text)]
    assert [(line, what.strip()) for line, what in lines] == [
        ("line 5", "fish is repeated, first in line 4"),
        ("line 1", "version"), ("line 3", "seed"), ("line 6", "speed"),
        ("line 8", "conditions.a.seconds"), ("line 11", "conditions.b.motion.again"),
        ("line 12", "conditions.c.motion.path"),
    ]  # fmt: skip
    assert "did you mean a?" in complaint(tmp_path, text)[5]


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)
NO_PROTOCOL = [
    ("", "the file is empty"), ("# a comment\n", "the file is empty"),
    ("- 1\n", "line 1: should be keys with values, got [1]"), ("a: [1\n", "line 2, column 1: no YAML"),
    ("a: b: c\n", "line 1, column 5: no YAML: mapping values are not allowed"),
    ("a: 1\n---\nb: 2\n", "line 2, column 1: no YAML: expected a single document"),
    ("a: *b\n", "line 1, column 4: no YAML: found undefined alias"),
    ("a: \x00\n", "no YAML: unacceptable character"), (b"name: a\nseed: \xff\n", "line 2: no UTF-8"),
    (b"#" * (MOST_BYTES + 1), "larger than 1 MB"), ("[" * 10_000, "it is nested too deeply"),
    ("a: &a {b: *a}\n", "line 1: nested too deeply, or an anchor within itself"),
    (BOMB, "more than 100000 values, anchors written out"),
]  # fmt: skip


def test_a_file_that_is_no_yaml_is_refused(tmp_path):
    with pytest.raises(FinloopError, match=r"none\.yaml cannot be read \(No such file"):
        load_protocol(tmp_path / "none.yaml")
    with pytest.raises(FinloopError, match="cannot be read"):
        load_protocol(tmp_path)
    for content, wanted in NO_PROTOCOL:
        refuse(tmp_path, content, wanted)


@pytest.mark.parametrize(
    "change", [lambda text: "\ufeff" + text, lambda text: text.replace("\n", "\r\n")]
)
def test_editors_of_other_systems_are_understood(tmp_path, change):
    path = tmp_path / "good.yaml"
    path.write_bytes(change(EXAMPLE.read_text(encoding="utf-8")).encode())
    assert load_protocol(path).name == "motion or looks"


def test_values_are_those_of_yaml_1_2():
    text = (
        "[null, ~, , true, True, false, no, on, 0, -0, 17, 010, 0x1f, 1_000, 1e3, .5, -2., 1.5E-3,"
        " .inf, 1:30, 2026-01-01, '1', \"true\", e5, 1e]"
    ).replace(", ,", ", ~,")
    assert read_yaml(text).values == [
        None, None, None, True, True, False, "no", "on", 0, 0, 17, "010", "0x1f", "1_000", 1000.0,
        0.5, -2.0, 0.0015, ".inf", "1:30", "2026-01-01", "1", "true", "e5", "1e",
    ]  # fmt: skip
    keys = read_yaml("1: a\ntrue: b\n2026-01-01: c\n").values
    assert keys == {"1": "a", "true": "b", "2026-01-01": "c"}
    shared = read_yaml("a: &way {wander: true}\nb: *way\n")
    assert shared.values == {"a": {"wander": True}, "b": {"wander": True}}
    assert shared.line(("b", "wander", 3)) == 1 and shared.line(("b",)) == 2


GUIDE = (ROOT / "docs/stimulus.md").read_text(encoding="utf-8")


def test_the_guide_shows_a_protocol_and_names_every_field_rule_and_verdict():
    (block,) = re.findall(r"```yml\n(.*?)```", GUIDE, re.DOTALL)
    shown = parse_protocol(read_yaml(block).values)
    assert shown.order == "blocks" and set(shown.conditions) == {"fish", "dot"}
    models = (
        Protocol, DisplayRequirements, AnimalSettings, Trigger, Condition, Motion, Look,
        MotionChange, RuleSpec,
    )  # fmt: skip
    fields = {field.alias or name for one in models for name, field in one.model_fields.items()}
    assert {name for name in fields if not re.search(rf"[`{{ ]{name}: ", GUIDE)} == set()
    for rule in get_args(RuleSpec.model_fields["rule"].annotation):
        assert f"| `{rule}` |" in GUIDE
    for verdict in get_args(Verdict):
        assert f"| {verdict} |" in GUIDE


LINES = EXAMPLE.read_text(encoding="utf-8").splitlines()


@given(
    st.one_of(
        st.text(max_size=60),
        st.lists(st.sampled_from([*"[]{}:,-&*!'\"\\ \n#|>", "a", "1", "<<", "\\ud800", "~"]), max_size=30).map("".join),
        st.tuples(st.integers(0, len(LINES) - 1), st.sampled_from(["", "a: 1", "  - 1", "\t", "fish: {}", "conditions: 3", '"\\ud800": "\\ud800"'])).map(
            lambda cut: "\n".join([*LINES[: cut[0]], cut[1], *LINES[cut[0] + 1 :]])
        ),
    )
)  # fmt: skip
@settings(max_examples=60)
def test_nothing_but_a_plain_complaint_comes_of_any_text(tmp_path_factory, text):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(text.encode(errors="surrogatepass"))
    try:
        load_protocol(path)
    except FinloopError as error:
        assert str(error).encode().decode()  # it can be printed
