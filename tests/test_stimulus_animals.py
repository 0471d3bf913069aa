"""Live animals: what trackers say, by any way and however hostile, and where animals are and were."""

import asyncio
import itertools
import json
import math
import queue
import runpy
import socket
import threading
import tracemalloc

import cv2
import numpy as np
import pytest
from conftest import PATIENCE_S, ROOT
from hostile import count_objects, hostile_messages
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder
from websockets.sync.server import serve

import finloop
from finloop.base.errors import FinloopError
from finloop.base.line import MM, PX, TANK, Line
from finloop.drawn import TRUTH
from finloop.io.table import load_table
from finloop.show.web import bind_socket
from finloop.stimulus.animals import TAKEN, LiveAnimals, TankGeometry
from finloop.stimulus.inputs import parse_datagram, parse_osc_packet, receive_datagrams
from finloop.stimulus.protocol import AnimalSettings as Settings
from finloop.stimulus.protocol import RuleSpec
from finloop.stimulus.recorded import NAME, ConnectionFaults, imitate_tracker
from finloop.stimulus.rules import find_rule_target
from finloop.stimulus.tracker import (
    LONGEST,
    MOST_AT_ONCE,
    PointPair,
    fit_calibration,
    parse_sightings,
)

WIDTH, HEIGHT, LENGTH = 400, 300, 40.0


def into(x, y):
    return min(max(x, 10.0), WIDTH - 11.0), min(max(y, 10.0), HEIGHT - 11.0)


TANK_OF = TankGeometry(WIDTH, HEIGHT, LENGTH, into)
GOOD = [
    {"t": 1.5, "id": "1", "x": 20, "y": 30.5}, {"t": -3, "id": 7, "x": 20, "y": 30, "heading": 35.0},
    {"t": 0, "id": "fish A.2: left-most", "x": 0, "y": -1e6, "heading": None, "token": "x"},
    [{"t": 0, "id": 1, "x": 1, "y": 2}, {"t": 0, "id": 2, "x": 3, "y": 4}],
    [{"t": 0, "id": n, "x": 1, "y": 2} for n in range(MOST_AT_ONCE)],
]  # fmt: skip
BAD = [
    "", "null", "[]", "{}", "1", '"x"', "[" * 900, "{" * 400, "\x00", "NaN", "[null]", "[[]]",
    '{"t":NaN,"id":1,"x":1,"y":1}', '{"t":1,"id":1,"x":Infinity,"y":1}', '{"t":1,"id":1,"x":1e999,"y":1}',
    '{"t":1e12,"id":1,"x":1,"y":1}', '{"t":"1","id":1,"x":1,"y":1}', '{"t":1,"id":1.5,"x":1,"y":1}',
    '{"t":1,"id":true,"x":1,"y":1}', '{"t":1,"id":-1,"x":1,"y":1}', '{"t":1,"id":"","x":1,"y":1}',
    '{"t":1,"id":"a\\nb","x":1,"y":1}', '{"t":1,"id":"' + "a" * 41 + '","x":1,"y":1}', '{"t":1,"id":"<b>","x":1,"y":1}',
    '{"t":1,"id":[1],"x":1,"y":1}', '{"t":1,"id":1,"x":1}', '{"t":1,"id":1,"x":1,"y":1,"z":1}',
    '{"t":1,"id":1,"x":1,"y":1,"heading":"up"}', '{"t":1,"id":1,"x":' + "9" * 5000 + ',"y":1}',
    '{"t":1,"id":"\\ud800","x":1,"y":1}', json.dumps([{"t": 0, "id": 1, "x": 1, "y": 2}] * (MOST_AT_ONCE + 1)),
    '{"t":1,"id":1,"x":1,"y":1}' + " " * LONGEST,
]  # fmt: skip


def message(t, x=200.0, y=150.0, id="1", **more):
    return json.dumps({"t": t, "id": id, "x": x, "y": y} | more)


def animals_of(**how):
    return LiveAnimals(Settings(**how), TANK_OF, None)


def verdicts(animals, text, arrived, source="a"):
    return animals.receive_message(text, source, arrived)


# --- messages


def test_what_is_meant_is_understood_and_nothing_else():
    for wish in GOOD:
        text = json.dumps(wish)
        assert parse_sightings(text) == parse_sightings(text.encode())
        assert len(parse_sightings(text)) == (len(wish) if isinstance(wish, list) else 1)
    for text in BAD:
        assert parse_sightings(text) is parse_sightings(text.encode(errors="replace")) is None, text
    assert all(parse_sightings(text) is None for text in (None, b"\xff\xfe{", "\ud800"))
    animals = animals_of()
    assert all(verdicts(animals, text, 1.0) == ["malformed"] for text in [*BAD, None])
    assert animals.recent_animals(1.0) == []


def test_without_animals_in_the_protocol_nothing_is_wanted():
    animals = LiveAnimals(None, TANK_OF, None)
    assert verdicts(animals, message(1), 1.0) == ["unwanted"]
    assert animals.present_animals(1.0) == [] and animals.find_past_place("1", 1.0) is None


# --- verdicts


def test_an_animal_is_there_until_it_was_not_heard_of_for_a_while():
    animals = animals_of(gap_s=0.5)
    assert verdicts(animals, message(7.0, 100, 90), 50.0) == ["taken"]
    assert animals.present_animals(50.5) == [("1", 100, 90, None, 0, 50)]
    assert animals.present_animals(50.51) == animals.recent_animals(111) == []
    assert [one.id for one in animals.recent_animals(110)] == ["1"]
    assert verdicts(animals, message(9.0, id=1), 52.0) == ["taken"]  # 1 and "1" are the same
    assert len(animals.present_animals(52.0)) == 1


def test_what_is_not_later_is_late_and_changes_nothing():
    animals = animals_of()
    verdicts(animals, message(1.0, 100), 11.0)
    before = animals.present_animals(11.1)
    for t in (1.0, 0.96, 0.3):
        assert verdicts(animals, message(t, 300), 11.05) == ["late"]
    for n in range(10):  # a tracker that hangs says the same for ever
        assert verdicts(animals, message(1.0, 300), 12.0 + n) == ["late"]
    assert animals.present_animals(11.1) == before


@pytest.mark.parametrize("zero", [-5000.0, -2.5, 3.0, 1e9])
def test_a_clock_that_jumps_is_a_new_base_and_the_past_stays(zero):
    animals, place = animals_of(), {}
    for n in range(50):
        place[100 + n / 25] = (100.0 + n, 90.0)
        assert verdicts(animals, message(n / 25, *place[100 + n / 25]), 100 + n / 25) == ["taken"]
    if zero < 0:  # a clock that was put back looks like a straggler at first
        assert verdicts(animals, message(1.99 + zero, 500.0, 90.0), 101.99) == ["late"]
    assert verdicts(animals, message(2 + zero, 150.0, 90.0), 102.0) == ["clock"]
    assert verdicts(animals, message(2.04 + zero, 151.0, 90.0), 102.04) == ["taken"]
    for time, wanted in place.items():
        assert animals.find_past_place("1", time) == pytest.approx(wanted, abs=1e-4)
    assert animals.find_past_place("1", 102.02) == pytest.approx((150.5, 90))


def test_messages_held_up_by_a_stall_and_a_straggler_leave_the_past_where_it_was():
    animals = animals_of()
    for n in range(150):  # the last two seconds of them come at once
        at = n / 25 if n < 100 else 6.0
        assert verdicts(animals, message(n / 25, 100.0 + n, 90.0), at) == ["taken"]
    assert verdicts(animals, message(2.5, 500.0, 90.0), 6.0) == ["late"]
    assert verdicts(animals, message(6.0, 250.0, 90.0), 6.0) == ["taken"]
    for n in (10, 50, 90, 120, 149):
        assert animals.find_past_place("1", n / 25) == pytest.approx((100.0 + n, 90.0))


def test_the_first_tracker_keeps_an_animal_while_it_is_heard():
    animals = animals_of(gap_s=0.5)
    assert verdicts(animals, message(1.0, 100), 11.0, "a") == ["taken"]
    assert verdicts(animals, message(5.0, 300), 11.4, "b") == ["rival"]
    assert animals.present_animals(11.4)[0].x == 100
    assert verdicts(animals, message(1.5, 110), 11.5, "a") == ["taken"]
    assert verdicts(animals, message(1.2, 300), 12.2, "b") == ["taken"]  # by a clock of its own
    assert verdicts(animals, message(2.3, 120), 12.3, "a") == ["rival"]
    assert animals.find_past_place("1", 11.5) == pytest.approx((110, 150))
    assert animals.find_past_place("1", 12.2) == (300, 150)


def test_more_animals_than_can_be_known_are_a_crowd_till_one_is_lost():
    animals = animals_of(gap_s=0.5)
    for n in range(MOST_AT_ONCE):
        assert verdicts(animals, message(0, id=n), 10 + 0.001 * n) == ["taken"]
    assert verdicts(animals, message(0, id="new"), 10.5) == ["crowd"]
    assert verdicts(animals, message(0, id=0), 10.5) == ["late"]
    assert verdicts(animals, message(0, id="new"), 10.502) == ["taken"]
    assert verdicts(animals, message(0.01, id=0), 10.503) == ["taken"]  # as a new one
    assert len(animals.recent_animals(10.51)) == MOST_AT_ONCE


def test_an_animal_outside_is_moved_in_and_one_at_a_wall_is_not():
    animals, place = animals_of(), {"taken": lambda x, y: (x, y), "outside": into}
    for t, x, y, verdict in (
        (1, 2, 150, "taken"), (2, 395, 297, "taken"), (3, -1, 150, "outside"), (4, 900, -1e6, "outside"), (5, 200, 300, "outside"),
    ):  # fmt: skip
        assert verdicts(animals, message(t, x, y), t) == [verdict] and verdict in TAKEN
        assert animals.present_animals(t)[0][1:3] == place[verdict](x, y)
    round_tank = TankGeometry(WIDTH, HEIGHT, LENGTH, lambda x, y: (200.0, 150.0))
    animals = LiveAnimals(Settings(), round_tank, None)
    assert verdicts(animals, message(1, 239, 150), 1) == ["taken"]
    assert verdicts(animals, message(2, 241, 150), 2) == ["outside"]


# --- motion


@pytest.mark.parametrize("angle", np.linspace(-3, 3, 5))
def test_heading_and_speed_are_those_of_the_way(angle):
    animals = animals_of()
    for n in range(40):
        t = n / 25
        x, y = 200 + 60 * (t - 0.8) * math.cos(angle), 150 - 60 * (t - 0.8) * math.sin(angle)
        animals.receive_message(message(t, x, y), "a", 5 + t)
    (one,) = animals.present_animals(5 + t)
    assert one.heading_rad == pytest.approx(angle) and one.speed == pytest.approx(60)
    for n in range(20):  # it rests, and the tracker trembles
        animals.receive_message(
            message(t + (n + 1) / 25, x + (n % 2), y), "a", 5 + t + (n + 1) / 25
        )
    (one,) = animals.present_animals(5 + t + 0.8)
    assert one.heading_rad == pytest.approx(angle) and one.speed < 6
    animals.receive_message(
        message(t + 3, 300, 50), "a", 8 + t
    )  # lost, and elsewhere: that is no motion
    (one,) = animals.present_animals(8 + t)
    assert one.heading_rad is None and one.speed == 0


def test_the_speed_of_a_seldom_message_is_that_of_the_last_way_and_a_given_heading_counts():
    animals = animals_of(gap_s=1.0)
    for n in range(4):
        animals.receive_message(message(0.8 * n, 100 + 40 * n, heading=90.0), "a", 0.8 * n)
    (one,) = animals.present_animals(2.4)
    assert one.speed == pytest.approx(50) and one.heading_rad == pytest.approx(math.pi / 2)


# --- clocks and the past


def swim_place(t):
    return 200 + 120 * math.sin(0.9 * t), 150 + 90 * math.sin(1.3 * t)


def heard_late(seed, seconds=30, rate=25.0, jitter=0.05, drift=1.0, latency=0.02, zero=77.0):
    """t of a tracker whose clock drifts, the true time, the arrival; in the order of arrival."""
    rng = np.random.default_rng(seed)
    true = np.arange(round(seconds * rate)) / rate
    arrived = true + latency + jitter * rng.random(len(true))
    order = np.argsort(arrived)
    return zip(zero + drift * true[order], true[order], arrived[order], strict=True)


@pytest.mark.parametrize("drift", [1.0, 1.001, 0.999])
def test_jitter_of_50_ms_and_a_clock_that_drifts_hardly_move_the_past(drift):
    plain, errors, ages = animals_of(), [], []
    for t, true, arrived in heard_late(3, drift=drift):
        plain.receive_message(message(t, *swim_place(true)), "a", arrived)
        if true > 5:
            when = arrived - 2.0
            errors.append(math.dist(plain.find_past_place("1", when), swim_place(when - 0.02)))
            ages.append(math.dist(plain.find_past_place("1", when), swim_place(when - 0.045)))
    # The fish swims up to 160 px/s: 1 px is 6 ms. Of the jitter, 25 ms on the average, hardly any is left.
    assert np.percentile(errors, 90) < 1.5 < np.median(ages)


@pytest.mark.parametrize("drift", [1.002, 0.998])
def test_after_a_minute_of_drift_the_clocks_still_agree(drift):
    animals = animals_of()
    for t, true, arrived in heard_late(5, seconds=120, jitter=0.0, drift=drift):
        animals.receive_message(message(t, *swim_place(true)), "a", arrived)
    for when in np.arange(118, 119.9, 0.1):  # of 0.24 s of drift, 39 px
        assert math.dist(animals.find_past_place("1", when), swim_place(when - 0.02)) < 3.5


def test_the_copy_of_an_animal_is_where_it_was_exactly():
    animals, rule = animals_of(), RuleSpec(rule="copy", delay_s=2.0)
    for n in range(500):
        t = n / 32  # exact in binary
        animals.receive_message(message(8 + t, *swim_place(t)), "a", t)
        wanted = into(*swim_place(t - 2)) if t >= 2 else None
        assert find_rule_target(rule, (0.0, 0.0, 0.0), animals, t, TANK_OF) == wanted
    for share in (0.25, 0.5):
        x, y = (1 - share) * np.array(swim_place(5)) + share * np.array(swim_place(5 + 1 / 32))
        assert animals.find_past_place("1", 5 + share / 32) == pytest.approx((x, y))


def test_a_place_in_a_gap_or_before_all_is_not_known():
    animals = animals_of(gap_s=0.5)
    for t, x in ((0.0, 10), (0.4, 50), (2.0, 100), (2.1, 110)):
        animals.receive_message(message(t, x), "a", 20 + t)
    known = {20.2: 30, 20.4: 50, 22.0: 100, 22.6: 110}
    for time, x in known.items():
        assert animals.find_past_place("1", time) == pytest.approx((x, 150))
    assert all(animals.find_past_place("1", time) is None for time in (19.99, 21.0, 22.61))
    assert animals.find_past_place("2", 20.2) is None


def test_a_minute_of_a_quick_camera_is_remembered_and_no_more_is_held():
    animals = animals_of()

    def hear(begin, end, rate):
        for n in range(begin * rate, end * rate):
            animals.receive_message(message(n / rate, 100 + n % 7), "a", n / rate)

    hear(0, 80, 120)
    for ago in range(0, 7200, 300):
        n = 80 * 120 - 1 - ago
        assert animals.find_past_place("1", n / 120) == (100 + n % 7, 150)
    tracemalloc.start()
    try:
        hear(80, 140, 120)
        hear(140, 145, 1000)
        assert tracemalloc.get_traced_memory()[0] < 20_000
    finally:
        tracemalloc.stop()
    assert animals.find_past_place("1", 90) is not None and animals.find_past_place("1", 70) is None


# --- calibration


def pairs(*points):
    return tuple(PointPair(tracker=one, tank=other) for one, other in points)


def view(x, y):
    """A camera that looks aslant at the tank."""
    w = 1 + 0.0005 * x + 0.001 * y
    return (20 + 0.9 * x - 0.1 * y) / w, (5 + 0.2 * x + 0.8 * y) / w


CORNERS = [(0.0, 0.0), (500.0, 0.0), (500.0, 400.0), (0.0, 400.0), (250.0, 100.0)]


def turn(x, y):
    return 50 + 0.6 * x + 0.3 * y, 200 - 0.3 * x + 0.6 * y


def shear(x, y):
    return 50 + 0.6 * x + 0.4 * y, 20 + 0.1 * x + 0.7 * y


def flip(law):
    return lambda x, y: law(x, 400 - y)


KINDS = [
    (2, turn, "down"), (3, shear, "down"), (4, view, "down"), (5, view, "down"),
    (2, flip(turn), "up"), (3, flip(shear), "up"), (5, flip(view), "up"),
]  # fmt: skip


@pytest.mark.parametrize("count, law, y_axis", KINDS)
def test_points_settle_where_places_are_and_headings_follow(count, law, y_axis):
    points = pairs(*((one, law(*one)) for one in CORNERS[:count]))
    known = fit_calibration(Settings(points=points, y_axis=y_axis), None)
    assert known.error_px < 1e-6
    down, step = 1 if y_axis == "up" else -1, 1e-4
    for x, y in [(10.0, 20.0), (333.0, 222.0), (100.0, 390.0)]:
        assert known.map_place(x, y) == pytest.approx(law(x, y))
        for heading in (-170.0, -20.0, 45.0, 90.0):
            angle, here = math.radians(heading), law(x, y)
            there = law(x + step * math.cos(angle), y + down * step * math.sin(angle))
            way = math.atan2(here[1] - there[1], there[0] - here[0])
            turned = known.map_heading_rad(x, y, heading)
            assert math.remainder(turned - way, math.tau) == pytest.approx(0, abs=1e-4)
            back = known.map_to_tracker(*known.map_place(x, y), turned)
            assert back == pytest.approx((x, y, heading))


def test_the_zero_of_a_tracker_may_lie_behind_its_camera():
    far = pairs(*(((x + 1000, y + 1000), view(x, y)) for x, y in CORNERS))
    known = fit_calibration(Settings(points=far), None)
    assert known.map_place(1333.0, 1222.0) == pytest.approx(view(333.0, 222.0))
    assert math.dist(known.map_place(-2000.0, -2000.0), (0, 0)) > 1e6


def test_points_that_do_not_fit_tell_how_far_they_are_off():
    points = pairs(*((one, view(*one)) for one in CORNERS))
    off = points[4].model_copy(update={"tank": (points[4].tank[0] + 10, points[4].tank[1])})
    assert 1 < fit_calibration(Settings(points=(*points[:4], off)), None).error_px < 10


def test_mm_are_px_by_the_scale_of_the_film():
    animals = LiveAnimals(Settings(unit="mm"), TANK_OF, 0.25)
    animals.receive_message(message(1.0, 25, 50, heading=90.0), "a", 1.0)
    assert animals.present_animals(1.0)[0][1:4] == pytest.approx((100, 200, math.pi / 2))


A, B, C, D = [(point, point) for point in CORNERS[:4]]


@pytest.mark.parametrize("wrong, said", [
    ({"unit": "mm"}, "neither the film's scale nor points"), ({"y_axis": "up"}, "upwards"),
    ({"unit": "mm", "y_axis": "up"}, "upwards"), ({"points": pairs(A)}, "one pair"), ({"points": pairs(A, A)}, "2 points of the tank are the same"),
    ({"points": pairs(A, B, ((250, 0), (250, 0)))}, "tracker lie on one line"),
    ({"points": pairs(A, B, ((250, 0), (250, 1)), D)}, "4 points of the tracker"),
    ({"points": pairs(A, B, (C[0], D[1]), (D[0], C[1]))}, "wrong order"),
    ({"points": pairs(A, B, (C[0], (20, 380)), (D[0], (480, 400)))}, "wrong order"),
])  # fmt: skip
def test_what_is_wrong_with_a_calibration_is_said_at_once(wrong, said):
    with pytest.raises(FinloopError, match=said):
        LiveAnimals(Settings(**wrong), TANK_OF, None)


# --- hostile messages


def hostile(count, seed=0):
    """Messages at random, two fifths of them of animals that are known or unknown."""
    rng = np.random.default_rng(seed)
    for n, text in enumerate(hostile_messages(count, seed, GOOD, BAD)):
        if n % 5 == 0:
            text = message(
                rng.normal(n / 25, 0.1), *rng.normal(200, 150, 2), id=str(rng.integers(3))
            )
        elif n % 5 == 1:
            text = message(10.0 ** rng.integers(9) * rng.normal(), id=int(rng.integers(10**6)))
        yield text


def test_hostile_messages_neither_crash_nor_grow(capfd, caplog):
    animals = animals_of()

    def hear():
        for part in range(1, 6):
            for n, text in enumerate(hostile(1000, part)):
                now = 100 * part + n / 25
                assert animals.receive_message(text, f"source {n % 40}", now)
                if n % 9 == 0:
                    for one in animals.present_animals(now)[:2]:
                        animals.find_past_place(one.id, now - 3)
            yield
            assert len(animals.recent_animals(now)) == MOST_AT_ONCE

    counts = count_objects(hear())
    assert max(counts) - min(counts) < 200, counts
    assert capfd.readouterr() == ("", "") and not caplog.records


# --- UDP and OSC


def osc(*arguments, address="/finloop/animal"):
    builder = OscMessageBuilder(address)
    for one in arguments:
        builder.add_arg(one, "d" if isinstance(one, float) else None)
    return builder.build()


def bundle(*contents):
    builder = OscBundleBuilder(IMMEDIATELY)
    for one in contents:
        builder.add_content(one)
    return builder.build().dgram


TRIGGER = '{"do": "trigger", "name": "go"}'


def test_a_datagram_is_the_text_and_a_token_is_asked_for_where_there_is_one():
    text, token = message(1.25, 100.125), message(1.25, token="secret")
    assert parse_datagram(text.encode(), None) == text
    assert parse_datagram(TRIGGER.encode(), None) == TRIGGER
    for good in (token, f"[{token}, {message(1.25, id=2)}]"):
        handed = parse_datagram(good.encode(), "secret")
        wanted = [one.model_copy(update={"token": None}) for one in parse_sightings(good)]
        assert "secret" not in handed and parse_sightings(handed) == wanted
    assert parse_datagram(TRIGGER[:-1].encode() + b', "token": "secret"}', "secret") == TRIGGER
    for wrong in ("Secret", "", "secret ", None, 1, ["secret"], "s\u00e9cret", "\ud800"):
        assert parse_datagram(message(1, token=wrong).encode(), "secret") is None
    assert parse_datagram(text.encode(), "secret") is None and parse_datagram(b"\xff", None) is None
    assert parse_datagram(text.encode().ljust(LONGEST), None)
    assert parse_datagram(text.encode().ljust(LONGEST + 1), None) is None
    for bad in [*BAD, "[" * LONGEST]:
        assert parse_datagram(bad.encode(errors="replace"), "secret") is None


def test_osc_is_the_same_as_json():
    def heard(*arguments, token=None):
        (text,) = parse_osc_packet(osc(*arguments).dgram, token)
        return text if text is None else parse_sightings(text)

    same = parse_sightings(message(1.25, 100.5, 50))
    assert heard(1.25, "1", 100.5, 50) == heard(message(1.25, 100.5, 50)) == same
    assert heard("secret", 1.25, "1", 100.5, 50, token="secret") == same
    same = parse_sightings(message(1.25, 100.5, 50.0, id=3, heading=-20.0))
    assert heard(1.25, 3, 100.5, 50.0, -20.0) == same
    assert parse_osc_packet(osc("secret", TRIGGER).dgram, "secret") == [TRIGGER]
    for wrong in ((), (1.0,), (1.0, "1", 2.0), (1.0, "1", 2.0, 3.0, 4.0, 5.0), (True, "1", 2.0, 3.0),
                  (b"blob", "1", 2.0, 3.0), (math.nan, "1", 2.0, 3.0), ("1", "1", 2.0, 3.0)):  # fmt: skip
        assert heard(*wrong) is None
    for wrong in (("Secret", 1.0, "1", 2.0, 3.0), (1.0, "1", 2.0, 3.0), (1, message(1)),
                  (message(1, token="secret"),), ()):  # fmt: skip
        assert heard(*wrong, token="secret") is None
    assert parse_osc_packet(osc(1.0, "1", 2.0, 3.0, address="/finloop/animals").dgram, None) == [
        None
    ]


def test_an_osc_bundle_is_its_messages():
    two = [osc(1.0, "1", 100.0, 50.0), osc(1.0, "2", 110.0, 50.0)]
    assert [parse_sightings(one)[0].id for one in parse_osc_packet(bundle(*two), None)] == [
        "1",
        "2",
    ]
    (first,) = parse_osc_packet(two[0].dgram, None)
    assert parse_osc_packet(bundle(two[0], osc(address="/other")), None) == [first, None]
    head = b"#bundle\0" + bytes(8)
    for bad in (
        bundle(),
        bundle(*(two * MOST_AT_ONCE)),
        head[:8],
        bundle(*two)[:-3],
        head + b"\xff" * 40,
    ):
        assert None in parse_osc_packet(bad, None)
    deep = two[0].dgram
    for _ in range(400):
        deep = head + len(deep).to_bytes(4) + deep
    assert parse_osc_packet(deep, None) == [None]


def hostile_osc(count):
    rng, content = np.random.default_rng(1), osc(1.0, "1", 2.0, 3.0)
    good = [content.dgram, osc(message(1)).dgram, bundle(content, osc(message(1)))]
    for n in range(count):
        content = bytearray(good[n % 3])
        for _ in range(int(rng.integers(1, 5))):
            content[rng.integers(len(content))] = rng.integers(256)
        yield bytes(content[: rng.integers(1, len(content) + 1)])


async def flood(kind, contents, wanted, token=None):
    """What is heard of datagrams, as (text, source), and the port that they came from.

    wanted: how many texts each is. Some at a time, as the system drops what is not taken at once.
    """
    heard, count = [], 0
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with bind_socket(0, kind=socket.SOCK_DGRAM) as listens, out:
        taking = asyncio.create_task(
            receive_datagrams(listens, kind, lambda *one: heard.append(one), token)
        )
        for n, one in enumerate(contents):
            out.sendto(one, listens.getsockname())
            count += wanted[n]
            while n % 20 == 19 and len(heard) < count:
                await asyncio.sleep(0)
        while len(heard) < count:
            await asyncio.sleep(0)
        taking.cancel()
        return heard, out.getsockname()[1]


@pytest.mark.parametrize("kind", ["udp", "osc"])
def test_hostile_datagrams_over_the_wire(kind, capfd, caplog):
    if kind == "udp":
        texts = hostile(3000)
        contents = [
            one if isinstance(one, bytes) else one.encode(errors="replace") for one in texts
        ]
        wanted = [[parse_datagram(one, None)] for one in contents]
    else:
        contents = list(hostile_osc(3000))
        wanted = [parse_osc_packet(one, None) for one in contents]
    flooding = flood(kind, contents, [*map(len, wanted)])
    heard, port = asyncio.run(asyncio.wait_for(flooding, PATIENCE_S))
    source = f"{kind}://127.0.0.1:{port}"
    assert heard == [(text, source) for one in wanted for text in one]
    assert 100 < sum(text is None for text, _ in heard) < len(heard) - 100
    assert capfd.readouterr() == ("", "") and not caplog.records


def test_over_the_wire_a_token_is_asked_for_too():
    texts = message(1), message(2, token="wrong"), message(3, token="secret")
    flooding = flood("udp", [text.encode() for text in texts], [1, 1, 1], "secret")
    heard, _ = asyncio.run(asyncio.wait_for(flooding, PATIENCE_S))
    assert [text for text, _ in heard] == [None, None, message(3)]


def test_an_error_of_the_receiver_ends_the_input():
    async def fail():
        with bind_socket(0, kind=socket.SOCK_DGRAM) as listens:
            taking = asyncio.create_task(
                receive_datagrams(listens, "udp", lambda *one: 1 / 0, None)
            )
            await asyncio.sleep(0)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
                out.sendto(b"x", listens.getsockname())
            await asyncio.wait_for(taking, PATIENCE_S)

    with pytest.raises(ZeroDivisionError):
        asyncio.run(fail())


# --- a recorded track


def line_of(unit=PX, scale=(1.0, 1.0), heading=True, seconds=30.0):
    t = np.arange(round(seconds * 25)) / 25
    x, y = np.array([swim_place(one) for one in t]).T
    headings = 20 * t % 360 if heading else None
    return Line("swimmer", x * scale[0], y * scale[1], unit, 3.0 + t, headings)


def test_a_recorded_track_is_said_as_a_live_animal_would_be():
    said, animals = list(imitate_tracker(line_of(), None, TANK_OF)), animals_of()
    assert [due for due, _ in said] == pytest.approx(np.arange(750) / 25)
    for due, text in said:
        assert verdicts(animals, text, 40 + due) in (["taken"], ["outside"])
        (one,) = animals.present_animals(40 + due)
        assert one.id == NAME and (one.x, one.y) == pytest.approx(swim_place(due))
        turned = math.remainder(one.heading_rad - math.radians(20 * due), math.tau)
        assert turned == pytest.approx(0, abs=1e-9)


def test_a_track_is_taken_at_another_rate_and_unit():
    def parse_messages(line, rate, **scale):
        messages = imitate_tracker(line, rate, TANK_OF, **scale)
        return [(due, json.loads(text)) for due, text in messages]

    wanted = parse_messages(line_of(heading=False), None)[::2]
    for line, scale in (
        (line_of(TANK, (1 / 399, 1 / 299), False), None),
        (line_of(MM, (0.5, 0.5), False), 0.5),
    ):
        said = parse_messages(line, 12.5, mm_per_px=scale)
        assert [due for due, _ in said] == pytest.approx([due for due, _ in wanted])
        for (_, one), (_, other) in zip(said, wanted, strict=True):
            assert one == pytest.approx(other) and "heading" not in one
    for due, facts in parse_messages(line_of(), 40.0):  # between 359° and 1° is 0°
        assert math.remainder(facts["heading"] - 20 * due, 360) == pytest.approx(0, abs=1e-6)
    with pytest.raises(FinloopError, match="scale"):
        parse_messages(line_of(MM), None)
    with pytest.raises(FinloopError, match="no times"):
        parse_messages(line_of()._replace(time_s=None), 25.0)


@pytest.mark.parametrize("count, law, y_axis", KINDS)
def test_a_recorded_track_speaks_for_any_tracker(count, law, y_axis):
    points = pairs(*((one, law(*one)) for one in CORNERS[:count]))
    animals = animals_of(points=points, y_axis=y_axis)
    said = imitate_tracker(line_of(), None, TANK_OF, calibration=animals.calibration)
    for due, text in itertools.islice(said, 100):
        animals.receive_message(text, "a", due)
        assert animals.present_animals(due)[0][1:3] == pytest.approx(swim_place(due))


def test_a_spoiled_track_loses_delays_and_breaks_off_as_wanted():
    def said_with(*faults, **named):
        return list(imitate_tracker(line, None, TANK_OF, ConnectionFaults(*faults, **named)))

    line = line_of(seconds=200.0)
    plain, said = said_with(), said_with(loss=0.2)
    assert set(said) < set(plain) and 0.77 < len(said) / len(plain) < 0.83
    said = said_with(jitter_s=0.05)
    late = [due - json.loads(text)["t"] for due, text in said]
    assert len(said) == len(plain) and 0 <= min(late) < 0.001 and 0.049 < max(late) <= 0.05
    assert [due for due, _ in said] == sorted(due for due, _ in said)
    assert [text for _, text in said] != [text for _, text in plain]  # some overtake others
    gaps = np.diff([due for due, _ in said_with(gap_s=2.0)])
    assert (gaps > 0.05).sum() == 16 and gaps.max() == pytest.approx(2.04, abs=0.041)
    first = said_with(0.2, 0.05, 2.0, seed=3)
    assert first == said_with(0.2, 0.05, 2.0, seed=3) != said_with(0.2, 0.05, 2.0, seed=4)


# --- the example


def test_the_camera_tracker_finds_the_drawn_carp(tmp_path):
    example = runpy.run_path(str(ROOT / "examples/camera_tracker.py"))
    film = finloop.draw_carp(
        tmp_path, frames=40, fish=2, width_px=400, height_px=300, body_length_px=50.0,
        frame_rate_hz=10.0, colour=False,
    )  # fmt: skip
    truth = load_table(film.folder / "truth.parquet", TRUTH)
    video = cv2.VideoCapture(str(film.folder / "clip.mp4"))
    ground = example["median_background"](video)
    frames = [(n / 25, cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY)) for n in range(40)]
    said = list(example["track_animals"](frames, ground, np.full(ground.shape, 20), 2))
    ways = {number: [] for number in (1, 2)}
    for n, animals in enumerate(said):
        places = truth.loc[truth["frame"] == n, ["x_px", "y_px"]].to_numpy()
        assert parse_sightings(json.dumps(animals))
        assert [one["t"] for one in animals] == [n / 25] * 2
        for one in animals:
            far = np.hypot(*(places - [one["x"], one["y"]]).T)
            ways[one["id"]].append((far.min(), int(far.argmin())))
    for way in ways.values():
        off, fish = zip(*way, strict=True)
        assert np.median(off) < 2 and max(off) < 8 and len(set(fish)) == 1
    assert ways[1][0][1] != ways[2][0][1]


def test_the_camera_tracker_sends_json_by_udp_and_by_a_websocket():
    open_sender = runpy.run_path(str(ROOT / "examples/camera_tracker.py"))["open_sender"]
    with bind_socket(0, kind=socket.SOCK_DGRAM) as listens:
        listens.settimeout(PATIENCE_S)
        with open_sender(f"udp://127.0.0.1:{listens.getsockname()[1]}") as send:
            send(message(1))
        assert parse_datagram(listens.recv(2000), None) == message(1)
    came = queue.Queue()
    with serve(lambda one: came.put(one.recv()), "127.0.0.1", 0) as server:
        runs = threading.Thread(target=server.serve_forever)
        runs.start()
        with open_sender(f"ws://127.0.0.1:{server.socket.getsockname()[1]}/animals") as send:
            send(message(2))
            assert came.get(timeout=PATIENCE_S) == message(2)
        server.shutdown()
        runs.join(PATIENCE_S)
