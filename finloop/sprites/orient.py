"""Sprites: a few frames of the film, turned to fill all orientations (fish paper §3.3)."""

from collections.abc import Iterator

import numpy as np
import pandas as pd
import scipy

from finloop.base.arrays import Floats
from finloop.base.cutout import Cutout, Cutouts
from finloop.base.schema import Column, Schema, columns
from finloop.features.table import direction_deg, orientations_of, wrap_deg
from finloop.sprites.choice import Choice
from finloop.sprites.settings import SpritesSettings
from finloop.sprites.stretch import SIDES, FrameRun, cycle_heading, phases
from finloop.sprites.swimmers import smooth
from finloop.sprites.turn import turn_cutout

SPRITES = Schema(
    Column("sprite", "int16", "1"),
    Column("sequence", "string", "1"),
    Column("step", "int16", "1"),
    Column("phase", "string", "1"),
    *columns("int32", "1", "row", "track_id", "frame"),
    Column("mirrored", "bool", "1"),
    *columns("float64", "px", "x_px", "y_px"),
    *columns("float32", "deg", "heading_deg", "head_offset_deg"),
    *columns("float32", "1", "scale", "motion_area_rel"),
    Column("bend", "float32", "body length²"),
    *columns("float32", "body length", "forward", "sideways"),
    Column("turn_deg", "float32", "deg"),
    Column("orientations", "int8", "1"),
)


def sprite_table(
    table: pd.DataFrame, choices: dict[str, Choice], settings: SpritesSettings
) -> pd.DataFrame:
    """Return the table of sprites (schema `SPRITES`): every chosen frame, its heading, its motion.

    table: from `swimmers`; choices: the frames of each sequence.
    """
    rows = pd.concat([_sequence(table, word, choice, settings) for word, choice in choices.items()])
    rows.insert(0, "sprite", np.arange(len(rows)))
    return rows.reset_index(drop=True)[SPRITES.names]


def _sequence(
    table: pd.DataFrame, word: str, choice: Choice, settings: SpritesSettings
) -> pd.DataFrame:
    stretch, sign = choice.stretch, -1 if choice.mirrored else 1
    here = table.iloc[stretch.rows]
    n = len(here)
    if word in SIDES:
        side = sign * SIDES[word]  # as filmed
        heading = _turn_heading(table, stretch, side, settings.turn_back_deg)
        phase = phases(table, stretch, side, settings.hold)
    else:
        heading = _line(table, stretch)
        phase = ["cycle"] * n
    angle = np.radians(heading[:-1])
    dx, dy = here["step_x_px"].to_numpy(), here["step_y_px"].to_numpy()
    length = here["length_px"].to_numpy()
    return pd.DataFrame(
        {
            "sequence": word,
            "step": np.arange(n),
            "phase": phase,
            "row": np.arange(len(table))[stretch.rows],
            "track_id": here["track_id"].to_numpy(),
            "frame": here["frame"].to_numpy(),
            "mirrored": choice.mirrored,
            "x_px": here["x_px"].to_numpy(),
            "y_px": here["y_px"].to_numpy(),
            "heading_deg": wrap_deg(heading[:-1]),
            "head_offset_deg": sign * wrap_deg(here["heading"].to_numpy() - heading[:-1]),
            "scale": np.median(table["length_px"]) / length,
            "motion_area_rel": here["area_rel"].to_numpy(),
            "bend": sign * here["bend"].to_numpy(),
            "forward": (dx * np.cos(angle) - dy * np.sin(angle)) / length,
            "sideways": sign * (-dx * np.sin(angle) - dy * np.cos(angle)) / length,
            "turn_deg": sign * np.diff(heading),
            "orientations": orientations_of(table),
        }
    )


def _line(table: pd.DataFrame, stretch: FrameRun) -> Floats:
    """Return the heading (n + 1,) of a straight stretch and of the next frame, on a line."""
    rows = _with_next(table, stretch)
    n = len(stretch)
    if rows.stop - rows.start == n + 1:
        return cycle_heading(table, rows.start, n)
    line = cycle_heading(table, rows.start, n - 1)  # the track ends here
    return np.r_[line, 2 * line[-1] - line[-2]]


def _turn_heading(
    table: pd.DataFrame, stretch: FrameRun, side: int, turn_back_deg: float
) -> Floats:
    """Return the heading (n + 1,) of a turn and of the next frame, smoothed; its ends as measured.

    If it turns back by at most `turn_back_deg` in all, that is removed.
    """
    rows = _with_next(table, stretch)
    heading = smooth(table["heading"].to_numpy()[rows])
    if len(heading) == len(stretch):  # the track ends here
        heading = np.r_[heading, 2 * heading[-1] - heading[-2]]
    if -np.minimum(side * np.diff(heading), 0).sum() <= turn_back_deg:
        heading = side * scipy.optimize.isotonic_regression(side * heading).x
    return heading


def _with_next(table: pd.DataFrame, stretch: FrameRun) -> slice:
    """Return the rows of a stretch and of the film's next frame, where the track has one."""
    track, after = table["track_id"].to_numpy(), stretch.rows.stop
    more = after < len(table) and track[after] == stretch.track_id
    return slice(stretch.rows.start, after + int(more))


def sprite_cutouts(sprites: pd.DataFrame, film: Cutouts) -> Iterator[Cutout]:
    """Yield the cut-out of every sprite in every orientation, in the order of `sprite_row`.

    sprites: schema `SPRITES`; film: the cut-outs of all rows.
    """
    for row in sprites.itertuples():
        cutout = film[row.row]
        mirror = row.heading_deg if row.mirrored else None
        for orientation in range(1, row.orientations + 1):
            turn = float(direction_deg(orientation, row.orientations)) - row.heading_deg
            sprite = turn_cutout(cutout, row.x_px, row.y_px, turn, mirror)
            yield sprite._replace(sprite=row.sprite, orientation=orientation)
