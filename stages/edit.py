"""An edit list and the tables of what it draws from, where the stages left them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from finloop.animate.edit_list import EDIT, SPRITE
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io.edit_list import load_edit
from finloop.io.record import load_record
from finloop.io.table import load_table
from finloop.sprites.orient import SPRITES

DATA = Path("data")
PLACES = ("track_id", "frame", "x_px", "y_px")


class Drawn(NamedTuple):
    """An edit list, its film's scene and table of tracks; sprites: None where it draws none."""

    edit: pd.DataFrame
    scene: SceneFacts
    tracks: pd.DataFrame
    sprites: pd.DataFrame | None


def load_drawn(
    mode: str, stage: str, columns: Sequence[str] | None = PLACES, sprites: bool = False
) -> Drawn:
    """The edit list of a mode for a stage, with these `columns` of the tracks, None for all.

    `sprites`: their table even where the list draws none. FinloopError if a file is missing or
    damaged.
    """
    scene = load_record(DATA / "extract/scene.json", SceneFacts, "extract")
    tracks = load_table(DATA / "extract/tracks.parquet", tracks_schema(scene.points), columns)
    edit = load_edit(DATA / "animate", mode, stage, EDIT)
    wanted = sprites or SPRITE in {*edit["kind"], *edit["partner_kind"]}
    table = load_table(DATA / "sprites/sprites.parquet", SPRITES) if wanted else None
    return Drawn(edit, scene, tracks, table)
