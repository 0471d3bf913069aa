"""One view of a run: the outputs of its stages, loaded when used.

Each property imports the package that it needs inside itself, here and in finloop/run_files.py. So
a stage depends only on the packages of the properties that it uses; tests/test_pipeline.py reads
that from these two files.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.io.record import load_json, load_records, remake_hint
from finloop.io.table import load_table
from finloop.run_files import RunFiles

if TYPE_CHECKING:  # what properties return; they import it themselves
    from finloop.edit.bodies import Bodies
    from finloop.edit.schema import Goal
    from finloop.extract.table import SceneFacts
    from finloop.render.gallery import Gallery

PLACES = ("track_id", "frame", "x_px", "y_px")


class EditSources(NamedTuple):
    """An edit list and the film's tables that drawing it needs.

    Attributes
    ----------
    edit
        Columns of `EDIT`, a row per tick and fish.
    scene
        Facts about the tank and its fish, from the stage `extract`.
    tracks
        The table of tracks, or some columns of it: n rows, one per fish and frame.
    sprites
        Columns of `SPRITES`; None where the list draws none.
    bodies
        The film's postures; None where no fish is mirrored or in another pose.
    """

    edit: pd.DataFrame
    scene: SceneFacts
    tracks: pd.DataFrame
    sprites: pd.DataFrame | None
    bodies: Bodies | None


class Project(RunFiles):
    """The outputs of a run's stages; each file is loaded once, at its first use.

    As a context manager it closes the stores that it has opened. Pickled, it is only its root; all
    copies that one process unpickles are the same project.

    Every property and method raises FinloopError if a file is missing, damaged, or of another film.

    Parameters
    ----------
    root
        The working copy, with params.yaml and data/.
    """

    def edit(self, mode: str, stage: str) -> pd.DataFrame:
        """Return the edit list of a mode, columns of `EDIT`, a row per tick and fish.

        stage: for messages, which name the parameter `stage`.mode. FinloopError also if the mode
        has no animation.
        """
        from finloop.edit.modes import RETARGET
        from finloop.edit.schema import EDIT

        key, path = ("edit", mode), self.data / f"animate/{mode}.parquet"
        if key not in self._kept and not path.exists():
            raise FinloopError(
                f"there is no {path}: the stage that makes it has not run",
                f"an edit list of the mode that {stage}.mode names",
                "make it: dvc repro",
            )
        if key not in self._kept:
            self._kept[key] = load_table(path, EDIT)
        if self._kept[key].empty and mode != RETARGET:
            why = load_json(
                self.data / f"animate/{mode}/reason.json", lambda facts: str(facts["reason"]),
                *remake_hint(f"modes-{mode}"),
            )  # fmt: skip
            raise FinloopError(
                f"{stage}.mode is {mode}, and there is no animation of it: {why}",
                "a mode for which the film is long and varied enough",
                f"take another mode: {stage}.mode=network",
            )
        if self._kept[key].empty:
            raise FinloopError(
                f"{stage}.mode is retarget, and no track is retargeted",
                "a track whose motion the fish follows",
                f"name one (retarget.tracks), or another mode: {stage}.mode=hybrid",
            )
        return self._kept[key]

    def goals(self, mode: str) -> list[Goal]:
        """Return the goals that a mode's fish swim to; empty for a mode that follows a track."""
        from finloop.edit.schema import Goal

        return load_records(self.data / f"animate/{mode}/goals.json", Goal, f"modes-{mode}")

    def size(self, mode: str) -> float:
        """Return the factor by which a mode draws its fish larger than filmed; 1 = as filmed."""
        path = self.data / f"animate/{mode}/drawn.json"
        return load_json(path, lambda facts: float(facts["size"]), *remake_hint(f"modes-{mode}"))

    def edit_with_sources(
        self, mode: str, stage: str, columns: Sequence[str] = PLACES, sprites: bool = False,
        bodies: bool = False,
    ) -> EditSources:  # fmt: skip
        """Return the edit list of a mode with the film's facts and tables that drawing it needs.

        Parameters
        ----------
        mode
            The mode of the edit list.
        stage
            The stage whose parameter `mode` messages name.
        columns
            Columns of the table of tracks to load.
        sprites
            Load the table of sprites even if the list draws none.
        bodies
            Load the postures even if the list needs none.
        """
        from finloop.edit.bodies import Bodies
        from finloop.edit.schema import SPRITE

        key = "drawn", mode, *columns, sprites, bodies
        if key not in self._kept:
            scene, tracks, edit = self.scene, self.tracks(columns), self.edit(mode, stage)
            wanted = sprites or SPRITE in {*edit["kind"], *edit["partner_kind"]}
            table, postures = self.sprites if wanted else None, None
            mirrored = edit[["mirrored", "partner_mirrored"]].any(axis=None)
            if bodies or mirrored or edit["pose"].notna().any():
                keys = self.features[["track_id", "frame"]].to_numpy()
                goes_on = np.append((np.diff(keys, axis=0) == (0, 1)).all(1), False)
                postures = Bodies(self.poses, goes_on, pd.DataFrame() if table is None else table)
            self._kept[key] = EditSources(edit, scene, tracks, table, postures)
        return self._kept[key]

    @cached_property
    def bodies(self) -> Bodies:
        """Return the film's postures, and the rows from which its sprites are made."""
        from finloop.edit.bodies import Bodies

        return Bodies(self.poses, self.reel.goes_on, self.sprites)

    @cached_property
    def whole_gallery(self) -> Gallery:
        """Return the gallery of every picture that any edit list can draw: frames and sprites.

        It can also bend a fish by the film's postures.
        """
        from finloop.edit.schema import FRAME, SPRITE
        from finloop.render.gallery import Gallery, shelves

        stores = {FRAME: self.cutouts, SPRITE: self.sprite_cutouts}
        return Gallery(shelves(stores, self.tracks(PLACES), self.sprites), self.bodies)

    def gallery(self, drawn: EditSources) -> Gallery:
        """Return the gallery of the pictures that one edit list draws: frames and any sprites.

        drawn: the edit list with its tables, from `edit_with_sources`.
        """
        from finloop.edit.schema import FRAME, SPRITE
        from finloop.render.gallery import Gallery, shelves

        stores = {FRAME: self.cutouts}
        if drawn.sprites is not None:
            stores[SPRITE] = self.sprite_cutouts
        return Gallery(shelves(stores, drawn.tracks, drawn.sprites), drawn.bodies)
