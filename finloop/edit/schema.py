"""The edit list: what is drawn where at every tick. Planners write it, renderers read it.

It has a row for every fish and tick, fish after fish; fish are numbered from 0. A tick lasts one
film frame. The picture, `source`, is the number of a sprite in one of its orientations (1 … n), or
a row of the film, a frame, which has no orientation. A frame may be `mirrored`, about the line
through its mass centre along its heading. It is turned by `rotation_deg` anticlockwise about its
mass centre, which is drawn at (x_px, y_px) of the tank. In a cross-fade a second picture, the
partner, is drawn at the same place, and `weight` is its share. Fish with higher numbers are drawn
on top.

Where `pose` is not empty, the animal is drawn in the posture of these codes of the film's principal
shapes (stage `pose`), as seen on screen, so after mirroring. Place, heading and size are those of
the source; the partner is drawn in the same place and posture.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Ints
from finloop.base.schema import ANY, Column, Schema, columns

SPRITE, FRAME = "sprite", "frame"
"""Kinds of source: a sprite in an orientation, or a row of the film."""

INERTIAL, FADE, CUT = "inertial", "fade", "cut"
"""Joins: posture and heading go on and die away, the pictures are mixed, or nothing of both."""

TERMS = ("seam", "repeat", "rarity", "lag", "path", "time", "to_come", "chance")
"""The terms of a cost: the seams of jumps; film that was on screen just now; steps that the film
seldom shows; lag behind the film's speed; deviation from the path in place, time and heading, and
corrections; the ticks taken; an estimate of what is still to come; and a random part, so that
candidates of about equal cost are all taken."""

TESTS = ("tank", "quadrant", "heading")
"""The tests of Fig. 19, in their order."""

EDIT = Schema(
    Column("fish", "int16", "1"),
    Column("tick", "int32", "1"),
    Column("time_s", "float64", "s"),
    Column("kind", "string", "1"),
    Column("source", "int32", "1"),
    Column("orientation", "int8", "1", nullable=True),
    Column("rotation_deg", "float32", "deg"),
    Column("scale", "float32", "1"),
    Column("mirrored", "bool", "1"),
    *columns("float64", "px", "x_px", "y_px"),
    Column("partner_kind", "string", "1", nullable=True),
    Column("partner", "int32", "1", nullable=True),
    Column("partner_orientation", "int8", "1", nullable=True),
    Column("partner_rotation_deg", "float32", "deg", nullable=True),
    Column("partner_scale", "float32", "1", nullable=True),
    Column("partner_mirrored", "bool", "1"),
    Column("weight", "float32", "1"),
    Column("pose", "float32", "1", nullable=True, length=ANY),
    Column("heading_deg", "float32", "deg"),
    Column("speed", "float32", "body length/s"),
    Column("motion_area", "float32", "1", nullable=True),
    *columns("string", "1", "mode", "state", "goal"),
    *columns("float64", "px", "aim_x_px", "aim_y_px"),
    *columns("string", "1", "reason", "exit", nullable=True),
    Column("seam", "float32", "median step of the film", nullable=True),
    Column("value_s", "float32", "s", nullable=True),
    Column("quadrant", "int8", "1", nullable=True),
    Column("candidates", "int16", "1", nullable=True),
    *columns("int16", "1", *(f"candidates_{test}" for test in TESTS), nullable=True),
    Column("turn_deg", "float32", "deg", nullable=True),
    *columns("float32", "1", "sprite_area", "room", nullable=True),
    Column("film_speed", "float32", "body length/s", nullable=True),
    *columns("float32", "s", *(f"taken_{term}_s" for term in TERMS), nullable=True),
    *columns("float32", "s", *(f"other_{term}_s" for term in TERMS), nullable=True),
)
"""`heading_deg` is the body's (a sprite's head sways about it), `motion_area` what was requested of
the model, `goal` the goal's name (empty: the fish wanders), aim the point that it heads for.
`mode` is the mode that plays the tick (`finloop.edit.modes`): in `hybrid`, `network` or `loops`.
`mirrored` is set for frames only; sprites are mirrored when they are made.

The columns from `reason` on say why, on the first tick of each stretch; they are empty on its other
ticks. `reason` is a code of `REASONS`; `exit`, of `EXITS`, where the film is left; `seam` that of a
jump or gateway. For a stretch of film: `value_s`, its whole cost to the goal, and the `quadrant`
that it leads to (Fig. 11). `candidates` counts the rows that could have been shown next, 0 where
the stretch was planned before; the next columns count those that fail each test of Fig. 19. For a
turn: `turn_deg` wanted (+ = left), the motion area of the strongest sprite, and `room`, the share
of the film's displacement for which the tank has room. For a phase: the `film_speed` at which the
film's began. In `matching`: the cost of the chosen candidate, term by term (`taken_seam_s` …), or
of a turn on the spot and what follows it; and that of the cheapest other candidate (`other_seam_s`
…; empty where none led on)."""

WHY = EDIT.names[EDIT.names.index("reason") :]
"""The columns that say why."""

REASONS = PHASE, TURNING, WALL, PLAY, JUMP, ENTER, SPOT, AS_PREDICTED, WAITING = (
    "phase", "turn", "wall", "play", "jump", "enter", "spot", "forecast", "wait",
)  # fmt: skip
"""Swim on like a phase of the film, turn, slow down before a wall; play the film on, jump at a
loop, enter the film by a gateway, turn on the spot as no candidate leads on or as that costs less;
swim as predicted; wait for other fish to move away."""

EXITS = NO_WAY, OTHER_MODE = "no_way", "mode"
"""Why the film is left: no candidate of it is legal, or the mode shows only sprites."""

STRAIGHT, SLIDE, ACCELERATE, DECELERATE, TURN, FILM, FORECAST = range(7)
STATES = ("straight", "slide", "accelerate", "decelerate", "turn", "film", "forecast")
"""How a fish moves: by sprites, as a stretch of film, or as predicted."""

PATH = "path"
"""The goal of a fish that follows a path."""

VERDICTS = ("", *TESTS, "passed over")
"""What becomes of a candidate: "" where it passes the tests of Fig. 19, else the test that it
fails, or "passed over" where cheaper ones displaced it in the search. "tank" is also the verdict
where another fish is met."""

CONSIDERED = Schema(
    Column("fish", "int16", "1"),
    *columns("int32", "1", "tick", "row"),
    Column("mirrored", "bool", "1"),
    Column("seam", "float32", "median step of the film"),
    Column("value_s", "float32", "s", nullable=True),
    *columns("float32", "s", *(f"{term}_s" for term in TERMS), nullable=True),
    Column("fails", "string", "1"),
    Column("taken", "bool", "1"),
)
"""The candidates compared at a tick: rows of the film that could be shown, mirrored or not; the
cost of the best branch from each (empty: there is none, or cheaper ones displaced it), without the
random part, and term by term; and its verdict, of `VERDICTS`."""


class Goal(NamedTuple):
    """A place to swim to, px of the clip; a fish within the radius has reached it."""

    name: str
    x_px: float
    y_px: float
    radius_px: float = 0.0


class RowPicture(NamedTuple):
    """A picture that a row of an edit list names, by columns of `EDIT`."""

    kind: str
    source: int
    orientation: int
    rotation_deg: float
    scale: float
    mirrored: bool


def row_picture(row: Any) -> RowPicture:
    """Return the picture that a row (named tuple) of an edit list shows."""
    return RowPicture(*(getattr(row, name) for name in RowPicture._fields))


def row_partner(row: Any) -> RowPicture:
    """Return the picture that fades out at a row (named tuple) of an edit list."""
    values = (getattr(row, f"partner_{name}") for name in RowPicture._fields[2:])
    return RowPicture(row.partner_kind, row.partner, *values)


def filmed_edit_list(rows: Ints, places_px: Floats) -> pd.DataFrame:
    """Return an edit list (schema `EDIT`) that shows rows (n,) of the film, one a tick, as filmed.

    With it the film is drawn and measured like an animation. places_px (n, 2): x, y of each.
    """
    # A column of which the film says nothing holds null where it may, else "", False or 0.
    empty = {"string": "", "bool": False}
    defaults = {
        column.name: None if column.nullable else empty.get(column.dtype, 0)
        for column in EDIT.columns
    }
    values = {
        "tick": np.arange(len(rows)), "kind": FRAME, "source": rows, "scale": 1.0,
        "x_px": places_px[:, 0], "y_px": places_px[:, 1], "mode": "film", "state": STATES[FILM],
    }  # fmt: skip
    return pd.DataFrame(defaults | values, index=np.arange(len(rows)))


def split_by_fish(edit: pd.DataFrame) -> list[pd.DataFrame]:
    """Return an edit list as one list for each fish, with rows counted from 0."""
    return [rows.reset_index(drop=True) for _, rows in edit.groupby("fish")]
