"""The live tank of the made-up fish, and frames taken apart, for the tests of the tank and page."""

import json
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from toy_film import ARENA, bodies_of, film_world_of, players_of, rich_film

from finloop.base.cutout import Cutout
from finloop.edit.schema import FRAME, SPRITE
from finloop.live.fish import ROW
from finloop.live.tank import LiveTank
from finloop.live.view import TankView
from finloop.render.gallery import CutoutSet, Gallery
from finloop.render.painter import Painter


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

    def __len__(self):
        return self.count

    def __getitem__(self, row):
        return Cutout(0, 0, 0, 0, drop())


def view_of(mode="matching", fish=1, seed=0, colour=False):
    floor = np.full(ARENA.shape + ((3,) if colour else ()), 200, np.uint8)
    frames, sprites, middle = len(rich_film().has_next), 60, (15.0, 15.0)
    gallery = Gallery({
        FRAME: CutoutSet(Drops(frames), np.full((frames, 2), middle)),
        SPRITE: CutoutSet(Drops(24 * sprites), np.full((sprites, 2), middle), 24),
    }, bodies_of(rich_film()))  # fmt: skip
    return TankView(LiveTank(toy_players(), mode, fish, seed), Painter(floor), gallery)


def read(frame):
    """A frame as the page takes it apart: the state, the picture."""
    length = int.from_bytes(frame[:4], "little")
    picture = cv2.imdecode(np.frombuffer(frame[4 + length :], np.uint8), cv2.IMREAD_UNCHANGED)
    return json.loads(frame[4 : 4 + length]), picture


def played_rows(tank, ticks, fish=0):
    rows = []
    for _ in range(ticks):
        tank.advance()
        rows.append(tank.fish[fish].row_at(tank.tick)[:-1])  # without the pose
    return np.array(rows, ROW)
