"""Stretches → edit list: the columns of what is drawn at every tick, and why."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.edit_list import EDIT, FRAME, LOOPS, NETWORK, SPRITE, Goal
from finloop.animate.film import Film
from finloop.animate.joins import INERTIAL, Shown, cross_fades, inertialized
from finloop.animate.motion import FORECAST, STATES
from finloop.animate.shoal import swim
from finloop.animate.state import Decision, Stretch
from finloop.animate.swim import Player, Swim
from finloop.base.arrays import Floats, Ints, Mask
from finloop.features.table import direction_deg, orientation, wrap_deg


def edit_list(swum: Swim, ticks: int, player: Player, fish: int = 0) -> pd.DataFrame:
    """The first `ticks` ticks as an edit list with the columns of `EDIT`; fish: its number."""
    table = pd.DataFrame(edit_columns(swum.stretches, swum.names, ticks, player))
    faded = table["weight"] > 0
    table = table.astype({"orientation": "Int8", "partner": "Int32", "partner_orientation": "Int8"})
    table.loc[~faded, ["partner_kind", "partner"]] = None
    table.loc[~faded, ["partner_rotation_deg", "partner_scale"]] = np.nan
    for side in ("", "partner_"):
        table.loc[table[f"{side}kind"] != SPRITE, f"{side}orientation"] = pd.NA
    table = table.assign(fish=fish, **decision_columns(swum.stretches, ticks))
    return table[EDIT.names]


def edit_lists(swum: Sequence[Swim], ticks: int, player: Player) -> pd.DataFrame:
    """The same of several fish, one after the other, in one table."""
    each = [edit_list(one, ticks, player, fish) for fish, one in enumerate(swum)]
    return each[0] if len(each) == 1 else pd.concat(each, ignore_index=True)


def play(
    player: Player, goals: Sequence[Goal], ticks: int, rng: np.random.Generator
) -> pd.DataFrame:
    """An edit list of `ticks` ticks: to the goals one after the other, afterwards anywhere."""
    return edit_list(swim(player, goals, ticks, rng), ticks, player)


def decision_columns(stretches: Sequence[Stretch], ticks: int) -> dict[str, Any]:
    """The columns (ticks,) that say why, filled on the first tick of each stretch."""
    start = np.cumsum([0] + [len(s.way) for s in stretches])[:-1]
    first = start[start < ticks]
    decisions = [s.decision for s in stretches[: len(first)]]
    columns: dict[str, Any] = {}
    for name, values in zip(Decision._fields, zip(*decisions, strict=True), strict=True):
        if isinstance(values[0], str):
            text = np.full(ticks, None, dtype=object)
            text[first] = [value or None for value in values]
            columns[name] = text
        elif isinstance(values[0], int):
            whole, missing = np.zeros(ticks, np.int16), np.ones(ticks, bool)
            whole[first], missing[first] = values, False
            columns[name] = pd.arrays.IntegerArray(whole, missing)
        else:
            columns[name] = np.full(ticks, np.nan)
            columns[name][first] = values
    return columns


def edit_columns(
    stretches: Sequence[Stretch], names: Sequence[str], ticks: int, player: Player
) -> dict[str, NDArray[Any]]:
    """What is drawn, (ticks,) each; of the partner only where `weight` > 0."""
    motion = player.waters.motion
    lengths = np.array([len(s.way) for s in stretches])
    owner = np.repeat(np.arange(len(stretches)), lengths)[:ticks]
    way = np.concatenate([s.way for s in stretches])[:ticks]
    rots = [np.zeros(len(s.way)) if s.rot is None else s.rot for s in stretches]
    pictures = folded(
        np.array([s.kind == FRAME for s in stretches])[owner],
        np.concatenate([s.number for s in stretches])[:ticks],
        np.concatenate(rots)[:ticks],
        player.waters.film,
    )
    start = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    first = start[start < ticks]
    heading = wrap_deg(way[:, 2])
    step = np.hypot(*np.diff(way[:, :2], axis=0, prepend=way[:1, :2]).T)
    speed = step / motion.body_length_px * motion.rate_hz
    if len(speed) > 1:
        speed[0] = speed[1]  # before the first tick there is no step
    new = np.array([s.new for s in stretches])[: len(first)] & (first > 0)
    aims = np.array([s.aim for s in stretches])
    state = np.array([s.state for s in stretches])[owner]
    return {
        "tick": np.arange(ticks),
        "time_s": np.arange(ticks) / motion.rate_hz,
        **joined(pictures, heading, first[new], player),
        "x_px": way[:, 0],
        "y_px": way[:, 1],
        "heading_deg": heading,
        "speed": speed,
        "motion_area": np.array([s.area for s in stretches])[owner],
        "mode": np.where(pictures.frame & (state != FORECAST), LOOPS, NETWORK),
        "state": np.array(STATES)[state],
        "goal": np.array(names)[owner],
        "aim_x_px": aims[owner, 0],
        "aim_y_px": aims[owner, 1],
    }


def folded(frame: Mask, number: Ints, rot: Floats, film: Film) -> Shown:
    """Pictures (ticks,) whose frames are numbered as `Film` does, with mirror images at the end.

    There a mirror image is the frame upside down; drawn, it is mirrored about its own heading.
    """
    mirrored = frame & (number >= film.filmed)
    row = np.where(mirrored, number - film.filmed, number)
    heading = film.heading[np.where(frame, row, 0)]
    return Shown(frame, row, np.where(mirrored, wrap_deg(rot - 2 * heading), rot), mirrored)


def joined(pictures: Shown, heading: Floats, new: Ints, player: Player) -> dict[str, NDArray[Any]]:
    """The columns (ticks,) of pictures, partners and poses.

    heading (ticks,): of the fish; new: ticks whose picture begins something else. Where pictures
    are inertialized, the pictures themselves say where that is.
    """
    how, own = player.joins, drawn(pictures, heading, player)
    pose = np.full(len(heading), None, object)
    if how.kind == INERTIAL and len(heading):
        join = inertialized(pictures, heading, how)
        new = join.begins
        for tick in np.flatnonzero(join.posed):
            pose[tick] = join.codes[tick]
        own["rotation_deg"] = wrap_deg(own["rotation_deg"] + join.turn_deg).astype(np.float32)
    partner, weight = cross_fades(pictures, new, how.fade, player.following)
    other = {f"partner_{name}": column for name, column in drawn(partner, heading, player).items()}
    return own | {"partner": other.pop("partner_source")} | other | {"weight": weight, "pose": pose}


def drawn(pictures: Shown, heading: Floats, player: Player) -> dict[str, NDArray[Any]]:
    """The columns kind, source, orientation (a frame's is 0), rotation_deg, scale, mirrored."""
    waters, count = player.waters, player.waters.sprites.orientations
    sector = orientation(heading, count)
    residual = wrap_deg(heading - direction_deg(sector, count))
    sprite, frame = (
        np.where(which, pictures.number, 0) for which in (~pictures.frame, pictures.frame)
    )
    return {
        "kind": np.where(pictures.frame, FRAME, SPRITE),
        "source": pictures.number,
        "orientation": np.where(pictures.frame, 0, sector),
        "rotation_deg": np.where(pictures.frame, wrap_deg(pictures.rot), residual).astype(
            np.float32
        ),
        "scale": np.where(
            pictures.frame, waters.film.scale[frame], player.cast.sprite_scale[sprite]
        ),
        "mirrored": pictures.frame & pictures.mirrored,
    }
