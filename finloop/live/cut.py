"""The stretch under way is cut at the tick on screen: a goal that is set now counts from now.

A planner moves its fish to the end of a stretch when it plans it. Here the fish is put back to
where it was after some ticks of it, as if the stretch had been no longer.
"""

from dataclasses import replace

import numpy as np

from finloop.animate.edit_list import FRAME
from finloop.animate.kinematics import wrap
from finloop.animate.motion import TURN
from finloop.animate.network import Fish, Stretch
from finloop.animate.swim import Player


def snapshot(fish: Fish) -> Fish:
    """A fish that stays as it is when the other swims on."""
    return replace(fish, shown=fish.shown.copy())


def cut(
    before: Fish, after: Fish, found: Stretch, ticks: int, player: Player
) -> tuple[Fish, Stretch]:
    """The fish after the first `ticks` ≥ 1 of a stretch, and these ticks alone.

    before, after: the fish as it was when the stretch was planned, and as planning left it.
    """
    ticks = min(ticks, len(found.way))
    kept = replace(
        found,
        way=found.way[:ticks],
        number=found.number[:ticks],
        rot=None if found.rot is None else found.rot[:ticks],
        phase=None if found.phase is None else found.phase[:ticks],
        touched=found.touched and ticks == len(found.way),
    )
    fish = snapshot(before)
    fish.x, fish.y, fish.heading = kept.way[-1, 0], kept.way[-1, 1], float(wrap(kept.way[-1, 2]))
    fish.state, fish.tick = kept.state, before.tick + ticks
    number = int(kept.number[-1])
    if kept.kind == FRAME and kept.rot is not None:
        film = player.cast.film
        fish.row, fish.rot, fish.sprite = number, float(kept.rot[-1]), -1
        fish.speed, fish.area = float(film.speed[number]), float(film.area[number])
        fish.waits = before.waits + ticks if after.waits else 0
        fish.since = ticks - 1 if kept.new else before.since + ticks
        fish.shown[kept.number] = before.tick + np.arange(ticks)
        return fish, kept
    motion = player.mode.motion
    places = np.vstack([[before.x, before.y], kept.way[:, :2]])
    step = np.hypot(*(places[-1] - places[-2])) / motion.body_length_px
    fish.speed = max(float(step) * motion.rate_hz, motion.low)
    fish.since = ticks if before.row >= 0 else before.since + ticks
    fish.row, fish.waits, fish.sprite, fish.area = -1, 0, number, 0.0
    if kept.phase is not None:
        cycle = player.cast.order.cycles[kept.state]
        fish.phase = float(kept.phase[-1]) % len(cycle)
    if kept.state == TURN and ticks < len(found.way):
        fish.area = float(player.cast.sprites["motion_area_rel"].iloc[number])
    return fish, kept
