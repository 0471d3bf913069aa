"""Stretches → edit list: the columns of what is drawn at every tick, and why."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Ints, Mask, Reals
from finloop.edit.joins import JoinRules, PictureSequence, cross_fade_partners, inertialize_pictures
from finloop.edit.schema import EDIT, FRAME, INERTIAL, SPRITE, STATES, TERMS
from finloop.edit.stretch import Decision, Stretch, Swim
from finloop.features.table import find_orientations, orientation_heading_deg, wrap_deg

_NO_COSTS = (np.nan,) * len(TERMS)
_NULLABLE_DTYPES = {
    column.name: column.pandas_dtype
    for column in EDIT.columns
    if column.nullable and (column.dtype == "string" or "int" in column.dtype)
}
"""The dtypes of `EDIT` in pandas that hold nulls: of text and of integers."""


@dataclass(frozen=True)
class EditInputs:
    """All pictures that an edit list can show, n rows of the film and s sprites, and their joins.

    rate_hz: ticks per second; body_length_px: as drawn; heading_deg (n,): as filmed; scale (n,),
    sprite_scale (s,): drawn size / filmed size; goes_on (n,): whether a row is followed by the next
    one; sprite_after (s,): the sprite that follows each; orientations: of each sprite; join_rules:
    pictures are joined; frame_mode, sprite_mode: names of the modes that play frames and sprites.
    """

    rate_hz: float
    body_length_px: float
    heading_deg: Reals
    scale: Reals
    goes_on: Mask
    sprite_scale: Reals
    sprite_after: Ints
    orientations: int
    join_rules: JoinRules
    frame_mode: str
    sprite_mode: str

    def next_number(self, kind: str, number: int) -> int:
        """Return the number of the sprite or film row after `number`; at the end `number`.

        kind: SPRITE or FRAME, what the number is of.
        """
        if kind == SPRITE:
            return int(self.sprite_after[number])
        return number + int(self.goes_on[number])


def build_edit_list(swim: Swim, ticks: int, inputs: EditInputs) -> pd.DataFrame:
    """Return the edit list of one fish: what is drawn at every tick (schema `EDIT`)."""
    return build_edit_lists([swim], ticks, inputs)


def build_edit_lists(swims: Sequence[Swim], ticks: int, inputs: EditInputs) -> pd.DataFrame:
    """Return the edit list of several fish: what is drawn at every tick (schema `EDIT`).

    Each fish has `ticks` rows, fish after fish.
    """
    fish_columns = [
        edit_columns(swim.stretches, swim.names, ticks, inputs)
        | _decision_columns(swim.stretches, ticks)
        for swim in swims
    ]
    columns = {
        name: np.concatenate([columns[name] for columns in fish_columns])
        for name in fish_columns[0]
    }
    # A column of which a tick says nothing holds null there.
    faded = columns["weight"] > 0
    columns["partner_kind"] = np.where(faded, columns["partner_kind"], np.array(None))
    for name in ("partner", "partner_rotation_deg", "partner_scale"):
        columns[name] = np.where(faded, columns[name], np.nan)
    for side in ("", "partner_"):
        is_sprite = columns[f"{side}kind"] == SPRITE
        columns[f"{side}orientation"] = np.where(is_sprite, columns[f"{side}orientation"], np.nan)
    columns["fish"] = np.repeat(np.arange(len(swims)), ticks)
    columns |= {name: pd.array(columns[name], kind) for name, kind in _NULLABLE_DTYPES.items()}
    return pd.DataFrame(columns, columns=EDIT.names)


def _decision_columns(stretches: Sequence[Stretch], ticks: int) -> dict[str, Any]:
    """Return the columns `WHY` (ticks,) by name: why each stretch of ticks was chosen.

    They are filled on the first tick of each stretch, and empty (NaN or null) on the others.
    """
    starts = np.cumsum([0] + [len(stretch.trajectory) for stretch in stretches])[:-1]
    first_ticks = starts[starts < ticks]
    decisions = [stretch.decision for stretch in stretches[: len(first_ticks)]]
    columns: dict[str, Any] = {}
    for name, values in zip(Decision._fields, zip(*decisions, strict=True), strict=True):
        if isinstance(values[0], tuple):  # costs by term
            costs = np.full((ticks, len(TERMS)), np.nan)
            costs[first_ticks] = [value or _NO_COSTS for value in values]
            prefix = name.removesuffix("_terms")
            columns |= {f"{prefix}_{term}_s": costs[:, k] for k, term in enumerate(TERMS)}
        else:
            columns[name] = _fill_column(values, first_ticks, ticks)
    return columns


def _fill_column(values: Sequence[str | int | float], at_ticks: Ints, ticks: int) -> Any:
    """Return a column (ticks,) that has the given values (k,) at some ticks (k,), else null.

    Null is None beside text, for which "" counts as null, too; else NaN.
    """
    if isinstance(values[0], str):
        text = np.full(ticks, None, dtype=object)
        text[at_ticks] = [value or None for value in values]
        return text
    numbers = np.full(ticks, np.nan)
    numbers[at_ticks] = values
    return numbers


def edit_columns(
    stretches: Sequence[Stretch], names: Sequence[str], ticks: int, inputs: EditInputs
) -> dict[str, NDArray[Any]]:
    """Return the columns (ticks,) of `EDIT` that say what is drawn, as arrays without nulls.

    names: of the goal of each stretch. The columns of the cross-fade's partner have a meaning where
    `weight` > 0.
    """
    lengths = np.array([len(stretch.trajectory) for stretch in stretches])
    stretch_of_tick = np.repeat(np.arange(len(stretches)), lengths)[:ticks]
    trajectory = np.concatenate([stretch.trajectory for stretch in stretches])[:ticks]
    rotations_deg = [
        np.zeros(len(stretch.trajectory)) if stretch.rotation_deg is None else stretch.rotation_deg
        for stretch in stretches
    ]
    pictures = resolve_mirror_images(
        frame=np.array([stretch.kind == FRAME for stretch in stretches])[stretch_of_tick],
        number=np.concatenate([stretch.number for stretch in stretches])[:ticks],
        rotation_deg=np.concatenate(rotations_deg)[:ticks],
        heading_deg=inputs.heading_deg,
    )
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    first_ticks = starts[starts < ticks]
    heading = wrap_deg(trajectory[:, 2])
    step = np.hypot(*np.diff(trajectory[:, :2], axis=0, prepend=trajectory[:1, :2]).T)
    speed = step / inputs.body_length_px * inputs.rate_hz
    if len(speed) > 1:
        speed[0] = speed[1]  # before the first tick there is no step
    changes = np.array([stretch.begins_with_transition for stretch in stretches])
    transition_ticks = first_ticks[changes[: len(first_ticks)] & (first_ticks > 0)]
    aims = np.array([stretch.aim for stretch in stretches])[stretch_of_tick]
    state = np.array([stretch.state for stretch in stretches])[stretch_of_tick]
    return {
        "tick": np.arange(ticks),
        "time_s": np.arange(ticks) / inputs.rate_hz,
        **_join_columns(pictures, heading, transition_ticks, inputs),
        "x_px": trajectory[:, 0],
        "y_px": trajectory[:, 1],
        "heading_deg": heading,
        "speed": speed,
        "motion_area": np.array([stretch.area for stretch in stretches])[stretch_of_tick],
        "mode": np.where(pictures.frame, inputs.frame_mode, inputs.sprite_mode),
        "state": np.array(STATES)[state],
        "goal": np.array(names)[stretch_of_tick],
        "aim_x_px": aims[:, 0],
        "aim_y_px": aims[:, 1],
    }


def resolve_mirror_images(
    frame: Mask, number: Ints, rotation_deg: Floats, heading_deg: Reals
) -> PictureSequence:
    """Return pictures (ticks,) in which number n + i, a mirror image, is row i drawn mirrored.

    frame (ticks,): whether each picture is a frame; number (ticks,): its row i, n + i for row i
    upside down, or a sprite; rotation_deg (ticks,): of frames; heading_deg (n,): of the rows as
    filmed. Row i is drawn mirrored about its own heading, so its rotation changes.
    """
    rows = len(heading_deg)
    mirrored = frame & (number >= rows)
    row = np.where(mirrored, number - rows, number)
    heading = heading_deg[np.where(frame, row, 0)]
    turned = np.where(mirrored, wrap_deg(rotation_deg - 2 * heading), rotation_deg)
    return PictureSequence(frame, row, turned, mirrored)


def _join_columns(
    pictures: PictureSequence, heading: Floats, transitions: Ints, inputs: EditInputs
) -> dict[str, NDArray[Any]]:
    """Return the columns (ticks,) of `EDIT` about pictures, poses and cross-fades, by name.

    heading (ticks,): of the fish, degrees; transitions: ticks whose picture does not continue the
    one before; not used for inertialization, whose joins are found in the pictures.
    """
    rules, columns = inputs.join_rules, _picture_columns(pictures, heading, inputs)
    pose = np.full(len(heading), None, object)
    if rules.kind == INERTIAL and len(heading):
        join = inertialize_pictures(pictures, heading, rules)
        transitions = join.begins
        for tick in np.flatnonzero(join.posed):
            pose[tick] = join.codes[tick]
        turned = wrap_deg(columns["rotation_deg"] + join.turn_deg)
        columns["rotation_deg"] = turned.astype(np.float32)
    partner, weight = cross_fade_partners(pictures, transitions, rules.fade, inputs.next_number)
    partner_columns = _picture_columns(partner, heading, inputs)
    return {
        **columns, "partner": partner_columns.pop("source"),
        **{f"partner_{name}": column for name, column in partner_columns.items()},
        "weight": weight, "pose": pose,
    }  # fmt: skip


def _picture_columns(
    pictures: PictureSequence, heading: Floats, inputs: EditInputs
) -> dict[str, NDArray[Any]]:
    """Return the columns (ticks,) of an edit list that say which picture is shown, and how turned.

    heading (ticks,): of the fish, degrees. A sprite is the nearest orientation, turned by the rest.
    """
    count, frame, number = inputs.orientations, pictures.frame, pictures.number
    sector = find_orientations(heading, count)
    residual = wrap_deg(heading - orientation_heading_deg(sector, count))
    frame_scale = inputs.scale[np.where(frame, number, 0)]
    sprite_scale = inputs.sprite_scale[np.where(frame, 0, number)]
    return {
        "kind": np.where(frame, FRAME, SPRITE),
        "source": number,
        "orientation": np.where(frame, 0, sector),
        "rotation_deg": np.where(frame, wrap_deg(pictures.rotation_deg), residual).astype(
            np.float32
        ),
        "scale": np.where(frame, frame_scale, sprite_scale),
        "mirrored": frame & pictures.mirrored,
    }
