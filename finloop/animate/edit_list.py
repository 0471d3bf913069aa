"""The edit list: what is drawn where at every tick. Planners write it, renderers read it.

A tick is the time of one film frame. The picture is a sprite (a row of the sprites' store) or a
frame (a row of the cut-outs' store); it is turned by `rotation_deg` anticlockwise about its mass
centre, which is drawn at (x_px, y_px) of the tank. In a cross-fade a second picture, the partner,
is drawn at the same place, and `weight` is its share.
"""

from typing import NamedTuple

from finloop.base.schema import Column, Schema

SPRITE, FRAME = "sprite", "frame"
"""Kinds of source: a picture of the sprites' store, or of the film's cut-outs."""

NETWORK, LOOPS, HYBRID = MODES = ("nn", "loops", "hybrid")
"""The modes: sprites moved by what the network learnt; the film, jumping at loops; both in turn."""

EDIT = Schema(
    (
        Column("tick", "int32", "1"),
        Column("time_s", "float64", "s"),
        Column("kind", "string", "1"),
        Column("source", "int32", "1"),
        Column("rotation_deg", "float32", "deg"),
        Column("scale", "float32", "1"),
        Column("x_px", "float64", "px"),
        Column("y_px", "float64", "px"),
        Column("partner_kind", "string", "1", nullable=True),
        Column("partner", "int32", "1", nullable=True),
        Column("partner_rotation_deg", "float32", "deg", nullable=True),
        Column("partner_scale", "float32", "1", nullable=True),
        Column("weight", "float32", "1"),
        Column("heading_deg", "float32", "deg"),
        Column("speed", "float32", "body length/s"),
        Column("motion_area", "float32", "1", nullable=True),
        Column("mode", "string", "1"),
        Column("state", "string", "1"),
        Column("goal", "string", "1"),
        Column("aim_x_px", "float64", "px"),
        Column("aim_y_px", "float64", "px"),
        Column("decision", "string", "1", nullable=True),
    )
)

CONSIDERED = Schema(
    (
        Column("tick", "int32", "1"),
        Column("row", "int32", "1"),
        Column("seam", "float32", "median step of the film"),
        Column("value_s", "float32", "s", nullable=True),
        Column("fails", "string", "1"),
        Column("taken", "bool", "1"),
    )
)
"""What was weighed at a tick: rows of the feature table that could have been shown, what the best
way from there costs (empty: there is none, or it was passed over for better ones), and which test
of Fig. 19 it fails ("" = none)."""
"""`heading_deg` is the body's (a sprite's head sways about it), `motion_area` what was asked of the
model, `goal` the goal's name (empty: the fish wanders), aim the point that it is heading for, and
`decision` says on a state's first tick why it was entered. `mode` is "nn" or "loops", whichever the
tick is in."""


class Goal(NamedTuple):
    """A place to swim to, in pixels of the clip; a fish that comes within the radius is there."""

    name: str
    x_px: float
    y_px: float
    radius_px: float = 0.0
