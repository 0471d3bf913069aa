"""An edit list and the tables of what it draws from, where the stages left them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.edit.bodies import Bodies
from finloop.edit.schema import EDIT, RETARGET, SPRITE, Goal
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.io.edit_list import load_edit
from finloop.io.record import load_json, load_record, load_records, made_by
from finloop.io.table import load_table
from finloop.sprites.orient import SPRITES
from stages.poses import load_poses

DATA = Path("data")
PLACES = ("track_id", "frame", "x_px", "y_px")


class Drawn(NamedTuple):
    """An edit list, its film's scene and table of tracks; sprites: None where it draws none.

    bodies: the film's postures; None where it draws no frame mirrored and nothing in a pose.
    """

    edit: pd.DataFrame
    scene: SceneFacts
    tracks: pd.DataFrame
    sprites: pd.DataFrame | None
    bodies: Bodies | None


def load_drawn(
    mode: str,
    stage: str,
    columns: Sequence[str] = PLACES,
    sprites: bool = False,
    bodies: bool = False,
) -> Drawn:
    """The edit list of a mode for a stage, with these `columns` of the tracks.

    `sprites`: their table even where the list draws none; `bodies`: the postures even where it
    needs none. FinloopError if a file is missing or damaged.
    """
    scene = load_record(DATA / "extract/scene.json", SceneFacts, "extract")
    tracks = load_table(DATA / "extract/tracks.parquet", tracks_schema(scene.points), columns)
    edit = (
        _load_retargeted(stage)
        if mode == RETARGET
        else load_edit(DATA / "animate", mode, stage, EDIT)
    )
    wanted = sprites or SPRITE in {*edit["kind"], *edit["partner_kind"]}
    table = load_table(DATA / "sprites/sprites.parquet", SPRITES) if wanted else None
    bends = bool(
        edit["pose"].notna().any() or edit[["mirrored", "partner_mirrored"]].any(axis=None)
    )
    return Drawn(edit, scene, tracks, table, _bodies(table) if bends or bodies else None)


def load_goals(mode: str) -> list[Goal]:
    """The goals that the edit list of a mode leads to; a recorded track has none."""
    return [] if mode == RETARGET else load_records(DATA / "animate/goals.json", Goal, "animate")


def load_size(mode: str) -> float:
    """How many times as large as filmed the fish of a mode is drawn, before its own size counts."""
    if mode == RETARGET:
        return 1.0
    return load_json(
        DATA / "animate/drawn.json", lambda facts: float(facts["size"]), *made_by("animate")
    )


def _load_retargeted(stage: str) -> pd.DataFrame:
    """The edit list of a recorded track; FinloopError if none is asked for."""
    edit = load_table(DATA / "retarget/retargeted.parquet", EDIT)
    if edit.empty:
        raise FinloopError(
            f"{stage}.mode is retarget, and no track is retargeted",
            "a track whose motion is swum",
            f"name one (retarget.tracks), or another mode: {stage}.mode=hybrid",
        )
    return edit


def _bodies(sprites: pd.DataFrame | None) -> Bodies:
    """The film's postures, and the rows behind its sprites."""
    features = load_table(DATA / "features/features.parquet", FEATURES)
    follows = (np.diff(features[["track_id", "frame"]].to_numpy(), axis=0) == (0, 1)).all(1)
    empty = pd.DataFrame() if sprites is None else sprites
    return Bodies(load_poses(features), np.append(follows, False), empty)
