"""Load the outputs of a run's stages, each when it is first used.

Each member of `Project` imports the package that it needs inside itself. So a stage depends only on
the packages of the members that it uses; `stages.code` reads that from this file.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self
from uuid import uuid4

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats, Mask, Picture
from finloop.base.errors import FinloopError
from finloop.io.cutouts import CutoutStore, open_cutouts
from finloop.io.mapped import open_array
from finloop.io.parameters import build_settings, read_parameters
from finloop.io.picture import load_picture
from finloop.io.record import load_json, load_record, load_records, remake_hint
from finloop.io.table import load_list_columns, load_table
from finloop.io.video import (
    ARENA_NAME,
    FACTS_NAME,
    GRAIN_NAME,
    VideoFacts,
    load_facts,
    load_mask,
    read_frames,
)

if TYPE_CHECKING:  # what members return; they import it themselves
    from finloop.animate.motion import MotionStatistics
    from finloop.animate.silhouettes import FilmOutlines
    from finloop.bpn.model import MotionModel
    from finloop.distance.map import MapFacts
    from finloop.distance.reel import Reel
    from finloop.edit.bodies import Bodies
    from finloop.edit.schema import Goal
    from finloop.extract.table import SceneFacts
    from finloop.forecast.film import FilmStates
    from finloop.forecast.sampling import Sampler
    from finloop.modes.animator import FilmData, ModeAssets
    from finloop.modes.network import Network
    from finloop.pose.film import FilmPoses
    from finloop.render.gallery import Gallery
    from finloop.render.living import LivingTank
    from finloop.render.settings import TankLook
    from finloop.social.rule import SchoolRule

PLACES = ("track_id", "frame", "x_px", "y_px")


class EditSources(NamedTuple):
    """An edit list, with the facts and tables of the film that are needed to draw it."""

    edit: pd.DataFrame  # columns of `EDIT`, a row per tick and fish
    scene: SceneFacts
    tracks: pd.DataFrame  # n rows, one per fish and frame
    sprites: pd.DataFrame | None  # columns of `SPRITES`; None where the list draws none
    bodies: Bodies | None  # postures; None where no fish is mirrored or in another pose


class Project:
    """The results of a run's stages; each file is loaded once, at its first use.

    root: the working copy, with params.yaml and data/. n is the number of rows: one per fish and
    frame of the film. As a context manager it closes the stores that it has opened. Pickled, it is
    only its root; all copies that one process unpickles are the same project. Every member raises
    FinloopError if a file is missing, damaged, or of another film.
    """

    def __init__(self, root: str | Path = ".") -> None:
        """Set the working copy's folder; nothing is loaded yet."""
        self.root = Path(root)
        self.data = self.root / "data"
        self._run = uuid4().hex  # a worker may outlive it
        self._stores = ExitStack()
        self._kept: dict[tuple[Any, ...], Any] = {}  # results of methods, by name and arguments

    def __enter__(self) -> Self:
        """Return the project, which is closed at the end of the block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the project."""
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs to make this project in another process."""
        return _unpickle, (self.root, self._run)

    def close(self) -> None:
        """Close the open stores of cut-outs, and drop all that was loaded."""
        # Attributes of that kind are cached properties.
        self.forget(*[name for name in vars(self) if hasattr(type(self), name)])
        self._kept.clear()
        self._stores.close()

    def forget(self, *names: str) -> None:
        """Drop what the named properties have loaded, to free memory."""
        for name in names:
            vars(self).pop(name, None)

    def settings(self, word: str) -> Any:
        """Return the parameters of a stage, from params.yaml, as its settings dataclass.

        word: name of the group of parameters, mostly that of a stage.
        """
        return build_settings(word, read_parameters(self.root / "params.yaml"))

    # --- clip

    @cached_property
    def facts(self) -> VideoFacts:
        """Return the facts of the clip: size, number of frames, frame rate and others."""
        return load_facts(self.data / "clip" / FACTS_NAME)

    @property
    def rate_hz(self) -> float:
        """Return the clip's frames per second."""
        return self.facts.frame_rate_hz

    @cached_property
    def arena(self) -> Mask:
        """Return the mask (h, w) of the film's pixels where animals can be."""
        return load_mask(self.data / "clip" / ARENA_NAME, self.facts.width_px, self.facts.height_px)

    # --- extract

    @cached_property
    def background(self) -> Picture:
        """Return the picture of the empty tank: (h, w) grey or (h, w, 3) RGB, uint8."""
        return load_picture(self.data / "extract/background.png")

    def living_tank(self, look: TankLook) -> LivingTank | None:
        """Return the empty tank at every tick, as `render.tank` wants it; None if it stands still.

        It stands still, too, where the film shows neither grain nor, if wanted, changes of light.
        """
        from finloop.clip.load_light import load_light_course
        from finloop.render.living import make_living_tank

        key = "living tank", look
        if key not in self._kept:
            path, colour = self.data / "extract" / GRAIN_NAME, self.background.ndim == 3
            frames = read_frames(path, colour=colour) if look != "still" and path.exists() else ()
            pictures = [frame.copy() for frame in frames]
            light = load_light_course(self.data / "clip") if look == "film" else None
            self._kept[key] = make_living_tank(self.background, pictures, light)
        return self._kept[key]

    @cached_property
    def scene(self) -> SceneFacts:
        """Return what the stage `extract` measured of the tank and its fish, such as the noise."""
        from finloop.extract.table import SceneFacts

        return load_record(self.data / "extract/scene.json", SceneFacts, "extract")

    def tracks(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return the table of tracks (n rows), with all columns or the named ones."""
        from finloop.extract.table import tracks_schema

        key = "tracks", *(columns or ())
        if key not in self._kept:
            schema = tracks_schema(self.scene.points)
            self._kept[key] = load_table(self.data / "extract/tracks.parquet", schema, columns)
        return self._kept[key]

    @cached_property
    def external_tracks(self) -> pd.DataFrame | None:
        """Return another program's tracks (n rows); None if none were given.

        Columns are those of `GIVEN`.
        """
        from finloop.extract.table import GIVEN, GIVEN_NAME

        path = self.data / "extract" / GIVEN_NAME
        return load_table(path, GIVEN) if path.exists() else None

    @cached_property
    def cutouts(self) -> CutoutStore:
        """Return the store of the film's n cut-outs; number k is row k of the table of tracks."""
        return self._stores.enter_context(open_cutouts(self.data / "extract/cutouts.arrow"))

    # --- features, identity, pose

    @cached_property
    def features(self) -> pd.DataFrame:
        """Return the feature table (n rows), columns of `FEATURES`: heading, displacement, …."""
        from finloop.features.table import FEATURES

        return load_table(self.data / "features/features.parquet", FEATURES)

    @cached_property
    def identities(self) -> pd.DataFrame:
        """Return the table that says which animal each track shows, columns of `IDENTITIES`."""
        from finloop.identity.film import IDENTITIES

        return load_table(self.data / "identity/identities.parquet", IDENTITIES)

    @cached_property
    def poses(self) -> FilmPoses:
        """Return the film's pose codes (n, c), and the principal shapes behind them."""
        from finloop.pose.film import POSES, restore_poses

        folder, features = self.data / "pose", self.features
        (codes,) = load_list_columns(folder / "poses.parquet", POSES, "codes")
        postures = open_array(folder / "postures.npy", (len(features), None), "float64")
        return load_json(
            folder / "shapes.json",
            lambda facts: restore_poses(features, codes, facts, postures),
            *remake_hint("pose"),
        )

    @cached_property
    def outlines(self) -> FilmOutlines:
        """Return the outlines of the n rows' silhouettes, (n, k, 2): k points x, y in px."""
        from finloop.animate.silhouettes import FilmOutlines

        shape = len(self.features), None, 2
        outline_px = open_array(self.data / "pose/outlines.npy", shape, "float32")
        return FilmOutlines.from_rows(outline_px, self.features)

    # --- sprites, and the film's pictures

    @cached_property
    def sprites(self) -> pd.DataFrame:
        """Return the table of sprites, columns of `SPRITES`, a row per sprite."""
        from finloop.sprites.orient import SPRITES

        return load_table(self.data / "sprites/sprites.parquet", SPRITES)

    @cached_property
    def sprite_cutouts(self) -> CutoutStore:
        """Return the store of the sprites' cut-outs, each sprite in all orientations."""
        return self._stores.enter_context(open_cutouts(self.data / "sprites/sprites.arrow"))

    @cached_property
    def film_reel(self) -> Reel:
        """Return the film without sprites: the feature table together with the n cut-outs."""
        from finloop.distance.reel import Reel

        return Reel(self.features, self.cutouts)

    @cached_property
    def reel(self) -> Reel:
        """Return the film with its sprites: the feature table, the n cut-outs and the sprites."""
        from finloop.distance.reel import Reel

        return Reel(self.features, self.cutouts, self.sprites, self.sprite_cutouts)

    # --- distance, loops, jumps, gateways

    @cached_property
    def map_facts(self) -> MapFacts:
        """Return facts about the distance map: how it was made, and its unit, the median step."""
        from finloop.distance.map import MapFacts

        return load_record(self.data / "distance/steps/facts.json", MapFacts, "distance")

    @cached_property
    def step_distances(self) -> pd.DataFrame:
        """Return the distances from rows to later frames of their tracks, columns of `STEPS`."""
        from finloop.distance.map import STEPS

        return load_table(self.data / "distance/steps/steps.parquet", STEPS)

    @cached_property
    def similar_pairs(self) -> pd.DataFrame:
        """Return the distance map: pairs of similar rows, with distances; columns of `PAIRS`."""
        from finloop.distance.map import PAIRS

        return load_table(self.data / "distance/pairs.parquet", PAIRS)

    @cached_property
    def loops(self) -> pd.DataFrame:
        """Return the video loops, columns of `LOOPS`; an empty table if the film shows none."""
        from finloop.loops.search import LOOPS

        return load_table(self.data / "loops/loops.parquet", LOOPS)

    @cached_property
    def jumps(self) -> pd.DataFrame:
        """Return the jumps between rows that look and move alike, columns of `JUMPS`."""
        from finloop.jumps.table import JUMPS

        return load_table(self.data / "jumps/jumps.parquet", JUMPS)

    @cached_property
    def row_looks(self) -> Floats:
        """Return k numbers on light and skin in each row's picture, (n, k).

        It is (2 n, k) if the project uses mirror images: their numbers follow.
        """
        from finloop.jumps.table import LOOK

        return load_list_columns(self.data / "jumps/look.parquet", LOOK, "look")[0]

    @cached_property
    def gateways(self) -> pd.DataFrame:
        """Return the gateways from film to sprites and back, columns of `GATEWAYS`."""
        from finloop.gateways.find import GATEWAYS

        return load_table(self.data / "gateways/gateways.parquet", GATEWAYS)

    # --- models

    @cached_property
    def motion_network(self) -> MotionModel:
        """Return the trained back-propagation network of the stage `bpn`, with its scaling."""
        from finloop.bpn.model import restore_motion_model

        return load_record(self.data / "bpn/model.json", restore_motion_model, "bpn")

    @cached_property
    def forecast_states(self) -> FilmStates:
        """Return each row's pose and motion as states of the forecast.

        Mirror images are there if `row_looks` has them. FinloopError if the film shows too little.
        """
        from finloop.forecast.film import compute_film_states, posture_mirror_matrix

        poses, p = self.poses, self.settings("forecast")
        mirror = posture_mirror_matrix(poses, self.row_looks)
        return compute_film_states(self.features, poses.codes, mirror, self.rate_hz, p)

    @property
    def has_forecast(self) -> bool:
        """Return whether the film showed enough for the stage `forecast` to train its model."""
        return not (self.data / "forecast/reason.json").exists()

    @cached_property
    def forecast_sampler(self) -> Sampler | None:
        """Return the sampler that draws the forecast's next pose and motion; None without a model.

        None if the film showed too little to learn from.
        """
        from finloop.forecast.model import restore_forecast
        from finloop.forecast.sampling import build_sampler

        if not self.has_forecast:
            return None
        folder, film = self.data / "forecast", self.forecast_states
        model = load_record(folder / "model.json", restore_forecast, "forecast")
        rows, numbers = film.states.shape
        start = open_array(folder / "start.npy", (rows + 1,), "int64")
        # The rows similar to row r are neighbours[start[r] : start[r + 1]].
        graph = start, open_array(folder / "neighbours.npy", (int(start[-1]),), "int32")
        # The states that the network predicts after each row.
        mean = open_array(folder / "mean.npy", (rows, numbers), "float64")
        return build_sampler(film, model, graph, self.settings("forecast"), mean)

    @cached_property
    def school_rule(self) -> SchoolRule:
        """Return the rule by which fish react to each other: zones and steps of `calibrate`."""
        from finloop.social.rule import SOCIAL_STEPS, SchoolRule, SocialSteps
        from finloop.social.zones import Zones

        folder = self.data / "calibrate"
        table = load_table(folder / "steps.parquet", SOCIAL_STEPS)
        return load_json(
            folder / "zones.json",
            lambda entry: SchoolRule(
                Zones(**entry["zones"]),
                SocialSteps.from_table(
                    table, move_per_pull=entry["forward"], turn_per_pull=entry["onward"]
                ),
                horizon=entry["horizon_frames"], similar_steps=entry["alike"],
            ),
            *remake_hint("calibrate"),
        )  # fmt: skip

    # --- animations

    @cached_property
    def motion_statistics(self) -> MotionStatistics:
        """Return statistics of the film's motion, such as its turns, at filmed size."""
        from finloop.animate.motion import learn_motion
        from finloop.features.table import infer_delta_frames

        return learn_motion(self.features, self.rate_hz, infer_delta_frames(self.features))

    @cached_property
    def film_assets(self) -> ModeAssets:
        """Return what all modes use of a film: pictures at drawn size, tank, outlines."""
        from finloop.modes.animator import prepare_mode_assets

        return prepare_mode_assets(self.film_data(self.film_reel), self.settings("animate"))

    @cached_property
    def sprite_assets(self) -> ModeAssets:
        """Return what the modes with sprites use: `film_assets` together with the sprites."""
        from finloop.modes.animator import prepare_mode_assets

        return prepare_mode_assets(self.film_data(self.reel), self.settings("animate"))

    @cached_property
    def network_mode(self) -> Network:
        """Return mode `network`, which steers by a flow chart; mode `hybrid` uses it, too."""
        from finloop.modes.network import make_network

        return make_network(self.sprite_assets, self.motion_network, self.settings("network"))

    def film_data(self, reel: Reel) -> FilmData:
        """Return what the modes take from the film; reel: its pictures, with or without sprites."""
        from finloop.modes.animator import FilmData

        return FilmData(
            self.motion_statistics, self.arena, self.background, reel, self.outlines, self.poses,
            self.map_facts, self.step_distances,
        )  # fmt: skip

    def edit_list(self, mode: str, stage: str) -> pd.DataFrame:
        """Return the edit list of a mode, columns of `EDIT`, a row per tick and fish.

        stage: name of the stage whose parameter `mode` chose it, for messages. FinloopError also if
        the mode has no animation.
        """
        from finloop.edit.modes import RETARGET
        from finloop.edit.schema import EDIT

        key, path = ("edit", mode), self.data / f"animate/{mode}.parquet"
        if key not in self._kept:
            if not path.exists():
                raise FinloopError(
                    f"there is no {path}: the stage that makes it has not run",
                    f"an edit list of the mode that {stage}.mode names",
                    "make it: dvc repro",
                )
            self._kept[key] = load_table(path, EDIT)
        edit = self._kept[key]
        if edit.empty and mode == RETARGET:
            raise FinloopError(
                f"{stage}.mode is retarget, and no track is retargeted",
                "a track whose motion the fish follows",
                f"name one (retarget.tracks), or another mode: {stage}.mode=hybrid",
            )
        if edit.empty:
            why = load_json(
                self.data / f"animate/{mode}/reason.json", lambda facts: str(facts["reason"]),
                *remake_hint(f"modes-{mode}"),
            )  # fmt: skip
            raise FinloopError(
                f"{stage}.mode is {mode}, and there is no animation of it: {why}",
                "a mode for which the film is long and varied enough",
                f"take another mode: {stage}.mode=network",
            )
        return edit

    def goals(self, mode: str) -> list[Goal]:
        """Return the goals that a mode's fish swim to; empty if it follows a path."""
        from finloop.edit.schema import Goal

        return load_records(self.data / f"animate/{mode}/goals.json", Goal, f"modes-{mode}")

    def drawn_scale(self, mode: str) -> float:
        """Return the scale at which a mode draws its fish; 1 is as filmed."""
        path = self.data / f"animate/{mode}/drawn.json"
        return load_json(path, lambda facts: float(facts["size"]), *remake_hint(f"modes-{mode}"))

    def edit_with_sources(
        self, mode: str, stage: str, columns: Sequence[str] = PLACES, sprites: bool = False,
        bodies: bool = False,
    ) -> EditSources:  # fmt: skip
        """Return a mode's edit list with all facts and tables needed to draw it.

        stage: the one whose parameter `mode` errors name. columns: of the table of tracks.
        sprites, bodies: load the sprites, or the fish's postures, even if the list needs none:
        postures are for pictures that are bent or mirrored.
        """
        from finloop.edit.bodies import Bodies
        from finloop.edit.schema import SPRITE

        key = "drawn", mode, *columns, sprites, bodies
        if key not in self._kept:
            edit = self.edit_list(mode, stage)
            needs_sprites = sprites or SPRITE in {*edit["kind"], *edit["partner_kind"]}
            needs_bodies = bodies or edit["pose"].notna().any()
            needs_bodies |= edit[["mirrored", "partner_mirrored"]].any(axis=None)
            sprite_table = self.sprites if needs_sprites else None
            postures = None
            if needs_bodies:
                keys = self.features[["track_id", "frame"]].to_numpy()
                # Whether the next row is the next frame of the same track.
                has_next_frame = np.append((np.diff(keys, axis=0) == (0, 1)).all(1), False)
                sprites_or_empty = pd.DataFrame() if sprite_table is None else sprite_table
                postures = Bodies(self.poses, has_next_frame, sprites_or_empty)
            self._kept[key] = EditSources(
                edit, self.scene, self.tracks(columns), sprite_table, postures
            )
        return self._kept[key]

    @cached_property
    def bodies(self) -> Bodies:
        """Return the film's poses, by which fish are bent, and the rows of its sprites."""
        from finloop.edit.bodies import Bodies

        return Bodies(self.poses, self.reel.has_next_frame, self.sprites)

    @cached_property
    def whole_gallery(self) -> Gallery:
        """Return the pictures that any edit list can draw: frames and sprites, in any pose."""
        return self._open_gallery(self.tracks(PLACES), self.sprites, self.bodies)

    def gallery(self, drawn: EditSources, residue: bool = True) -> Gallery:
        """Return the pictures that one edit list draws: frames, and sprites if it shows any.

        drawn: the edit list with its tables, from `edit_with_sources`. residue: False for pictures
        that are not drawn on the film's own tank (`Gallery`).
        """
        return self._open_gallery(drawn.tracks, drawn.sprites, drawn.bodies, residue)

    def _open_gallery(
        self, tracks: pd.DataFrame, sprites: pd.DataFrame | None, bodies: Bodies | None,
        residue: bool = True,
    ) -> Gallery:  # fmt: skip
        """Return the film's pictures; also sprites, and bent or mirrored fish, if these are given.

        tracks: the columns `PLACES` of the table of tracks, n rows. sprites: their table. bodies:
        the film's poses. residue: see `Gallery`.
        """
        from finloop.edit.schema import FRAME, SPRITE
        from finloop.render.gallery import Gallery, build_cutout_sets

        stores = {FRAME: self.cutouts}
        if sprites is not None:
            stores[SPRITE] = self.sprite_cutouts
        return Gallery(build_cutout_sets(stores, tracks, sprites), bodies, residue=residue)


@lru_cache(1)
def _unpickle(root: Path, run: str) -> Project:
    """Return the project that another process has pickled, the same object for each call.

    root: the working copy; run: name of that process's run, a key of the cache: results that
    another run left here are not reused.
    """
    return Project(root)
