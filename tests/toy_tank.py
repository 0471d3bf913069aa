"""The live tank of the made-up fish, and messages taken apart, for the tests of the tank and page."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
from toy_film import ARENA, RATE, bodies_of, film_world_of, players_of, rich_film

from finloop.base.cutout import Cutout
from finloop.edit.schema import FRAME
from finloop.live.fish import ROW
from finloop.live.tank import LiveTank
from finloop.live.view import TankView, make_tank_feed
from finloop.render.gallery import CutoutSet, Gallery
from finloop.show.pictures import PagePictures


@cache
def toy_players(join="inertial"):
    return players_of(film_world_of(cross_fade_deltas=0.6, join=join))


def resting_players(share):
    """Players of a film that rests at a share of its rows, picked at random."""
    players = toy_players()
    rest = np.random.default_rng(0).random(len(rich_film().has_next)) < share
    return {
        mode: replace(one, join_rules=replace(one.join_rules, rests=rest))
        for mode, one in players.items()
    }


def drop() -> np.ndarray:
    y, x = np.mgrid[:31, :31] - 15
    alpha = 255 * np.exp(-((x / 4) ** 2) - (y / 4) ** 2)
    return np.round(np.dstack([alpha, alpha])).astype(np.uint8)


class Drops:
    """A store of which every picture is the same drop."""

    def __init__(self, count):
        self.count = count
        self.index = {"height_px": np.full(count, 31), "width_px": np.full(count, 31)}

    def __len__(self):
        return self.count

    def __getitem__(self, row):
        return Cutout(0, 0, 0, 0, drop())


def view_of(mode="matching", fish=1, seed=0, colour=False):
    floor = np.full(ARENA.shape + ((3,) if colour else ()), 200, np.uint8)
    frames, bodies = len(rich_film().has_next), bodies_of(rich_film())
    gallery = Gallery({FRAME: CutoutSet(Drops(frames), np.full((frames, 2), 15.0))}, bodies)
    feed = make_tank_feed(PagePictures(gallery), floor, RATE, bodies)
    return TankView(LiveTank(toy_players(), mode, fish, seed), feed, bodies)


def read(message):
    """A message as the page takes it apart: the facts, the payload."""
    length = int.from_bytes(message[:4], "little")
    return json.loads(message[4 : 4 + length]), message[4 + length :]


def tick_on_screen(view):
    """What is told of the tick on screen: the state, and the states of the fish (fish, fields)."""
    told = {facts["kind"]: payload for facts, payload in map(read, view.frame_messages())}
    state = view.describe_tick(view.shown_tick)
    return state, np.frombuffer(told["rows"], np.float32).reshape(len(state["fish"]), -1)


def played_rows(tank, ticks, fish=0):
    rows = []
    for _ in range(ticks):
        tank.advance()
        rows.append(tank.fish[fish].row_at(tank.tick)[:-1])  # without the pose
    return np.array(rows, ROW)
