"""A session of the made-up fish that lasts no time, for the tests of the stimulus."""

import asyncio

import numpy as np
from toy_film import bodies_of, rich_film
from toy_tank import Drops, toy_players

from finloop.edit.schema import FRAME
from finloop.io.journal import save_journal
from finloop.render.gallery import CutoutSet, Gallery
from finloop.show.feed import Feed, TankCanvas
from finloop.show.pictures import PagePictures
from finloop.stimulus.log import FORMAT, SESSION, Log
from finloop.stimulus.motion import TrialContext
from finloop.stimulus.order import order_trials
from finloop.stimulus.protocol_file import parse_protocol
from finloop.stimulus.recorded import DryClock, TimedMessage
from finloop.stimulus.replay import open_session_record
from finloop.stimulus.session import Session

LIVE = {"unit": "px"}


def scene():
    return TrialContext(toy_players()["matching"], bodies_of(rich_film()))


def plan_of(conditions, **more):
    values = {"version": 1, "name": "toy", "seed": 5, "display": {"calibrated": False}}
    return parse_protocol(values | {"animals": LIVE} | more | {"conditions": conditions})


def feed_of(made, plan, slots=(64, 64), **facts):
    height, width = made.world.tank.arena.shape
    count, middle = len(made.bodies.poses.codes), (15.0, 15.0)
    cutout_set = CutoutSet(Drops(count), np.full((count, 2), middle))
    gallery = Gallery({FRAME: cutout_set}, made.bodies)
    looks = [look.to_json_values for look in plan.looks]
    more = {"rate": made.rate_hz, "posture": made.posture, "looks": looks, "fish": plan.fish}
    more |= {"mm_per_px": None, "display": None, "mode": "session", "digest": False, "keys": []}
    floor = np.full((height, width), 200, np.uint8)
    return Feed(TankCanvas(floor, *slots), more | {"name": "toy"} | facts, PagePictures(gallery))


def header_of(made, plan, **more):
    return {
        "format": FORMAT, "finloop": "0", "begun": "now", "software": {"numpy": "2"},
        "protocol": plan.model_dump(mode="json", by_alias=True), "film": "toy",
        "rate_hz": made.rate_hz, "looks": [look.to_json_values for look in plan.looks], "display": None, "folder": ".",
    } | more  # fmt: skip


def session_of(folder, plan, clock, made=None, name="toy", **more):
    made = made or scene()
    log = Log(folder / f"{name}.journal", header_of(made, plan, **more))
    sent = []
    session = Session(made, plan, order_trials(plan), feed_of(made, plan), log, clock)
    session.connect_outputs(sent.append, lambda to, text: None)
    return session, sent


def run_dry(folder, plan, messages=(), made=None, name="toy"):
    """The record of a session without display; messages: (time, text) of a tracker."""
    clock = DryClock(iter([TimedMessage(*message) for message in messages]))
    session, sent = session_of(folder, plan, clock, made, name)
    clock.receive, session.waits_for_starts = session.receive_message, False
    session._repeated.update(plan.conditions)  # all motions are looked at afterwards
    session.start()
    asyncio.run(session.run_trials())
    session.log.close()
    path = folder / f"{name}.parquet"
    save_journal(folder / f"{name}.journal", path, SESSION)
    return open_session_record(path), session, sent
