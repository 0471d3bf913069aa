"""The outputs of a run's stages, file by file, loaded when used; see finloop/project.py."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self
from uuid import uuid4

import pandas as pd

from finloop.base.arrays import Floats, Mask, Picture
from finloop.io.cutouts import CutoutStore, open_cutouts
from finloop.io.mapped import open_array
from finloop.io.parameters import parameters, read_parameters
from finloop.io.picture import load_picture
from finloop.io.record import load_json, load_record, remake_hint
from finloop.io.table import load_lists, load_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, VideoFacts, load_facts, load_mask

if TYPE_CHECKING:  # what properties return; they import it themselves
    from finloop.bpn.model import MotionModel
    from finloop.distance.map import MapFacts
    from finloop.distance.reel import Reel
    from finloop.extract.table import SceneFacts
    from finloop.forecast.film import FilmStates
    from finloop.forecast.sampling import Sampler
    from finloop.pose.film import FilmPoses
    from finloop.social.rule import Shoaling


class RunFiles:
    """The files of a run; each is loaded once, at its first use.

    `finloop.project.Project` adds the edit lists, and documents how to close and pickle it.
    """

    def __init__(self, root: str | Path = ".") -> None:
        self.root = Path(root)
        self.data = self.root / "data"
        self._run = uuid4().hex  # a worker may outlive it
        self._stores = ExitStack()
        self._kept: dict[tuple[Any, ...], Any] = {}  # results of methods, by name and arguments

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (type(self), self.root, self._run)

    def close(self) -> None:
        """Close the stores, and forget what was loaded."""
        self.forget(*[name for name in vars(self) if hasattr(type(self), name)])
        self._kept.clear()
        self._stores.close()

    def forget(self, *names: str) -> None:
        """Forget what these properties have loaded, to free memory."""
        for name in names:
            vars(self).pop(name, None)

    def settings(self, word: str) -> Any:
        """Return the parameters of a stage word as its settings dataclass."""
        return parameters(word, read_parameters(self.root / "params.yaml"))

    # --- clip

    @cached_property
    def facts(self) -> VideoFacts:
        """Return facts of the clip."""
        return load_facts(self.data / "clip" / FACTS_NAME)

    @property
    def rate_hz(self) -> float:
        """Return frames per second."""
        return self.facts.frame_rate_hz

    @cached_property
    def arena(self) -> Mask:
        """Return where animals can be (h, w)."""
        return load_mask(self.data / "clip" / ARENA_NAME, self.facts.width_px, self.facts.height_px)

    # --- extract

    @cached_property
    def background(self) -> Picture:
        """Return the empty tank (h, w) or (h, w, 3), uint8."""
        return load_picture(self.data / "extract/background.png")

    @cached_property
    def scene(self) -> SceneFacts:
        """Return the facts of the film that the stage `extract` has measured."""
        from finloop.extract.table import SceneFacts

        return load_record(self.data / "extract/scene.json", SceneFacts, "extract")

    def tracks(self, columns: Sequence[str] | None = None) -> pd.DataFrame:
        """Return columns of the table of tracks (n rows), all if none are named."""
        from finloop.extract.table import tracks_schema

        key = "tracks", *(columns or ())
        if key not in self._kept:
            schema = tracks_schema(self.scene.points)
            self._kept[key] = load_table(self.data / "extract/tracks.parquet", schema, columns)
        return self._kept[key]

    @cached_property
    def external_tracks(self) -> pd.DataFrame | None:
        """Return another program's tracks of the n rows; None if there are none."""
        from finloop.extract.table import GIVEN, GIVEN_NAME

        path = self.data / "extract" / GIVEN_NAME
        return load_table(path, GIVEN) if path.exists() else None

    @cached_property
    def cutouts(self) -> CutoutStore:
        """Return the n cut-outs of the film."""
        return self._stores.enter_context(open_cutouts(self.data / "extract/cutouts.arrow"))

    # --- features, identity, pose

    @cached_property
    def features(self) -> pd.DataFrame:
        """Return the feature table (n rows)."""
        from finloop.features.table import FEATURES

        return load_table(self.data / "features/features.parquet", FEATURES)

    @cached_property
    def identities(self) -> pd.DataFrame:
        """Return the animal of each track."""
        from finloop.identity.film import IDENTITIES

        return load_table(self.data / "identity/identities.parquet", IDENTITIES)

    @cached_property
    def poses(self) -> FilmPoses:
        """Return the postures of the n rows."""
        from finloop.pose.film import POSES, restore_poses

        folder, features = self.data / "pose", self.features
        (codes,) = load_lists(folder / "poses.parquet", POSES, "codes")
        postures = open_array(folder / "postures.npy", (len(features), None), "float64")
        return load_json(
            folder / "shapes.json",
            lambda facts: restore_poses(features, codes, facts, postures),
            *remake_hint("pose"),
        )

    @cached_property
    def outlines(self) -> Floats:
        """Return outlines (n, k, 2) x, y px of the n rows."""
        shape = len(self.features), None, 2
        return open_array(self.data / "pose/outlines.npy", shape, "float32")

    # --- sprites, and the film's pictures

    @cached_property
    def sprites(self) -> pd.DataFrame:
        """Return the table of sprites."""
        from finloop.sprites.orient import SPRITES

        return load_table(self.data / "sprites/sprites.parquet", SPRITES)

    @cached_property
    def sprite_cutouts(self) -> CutoutStore:
        """Return the sprites in all orientations."""
        return self._stores.enter_context(open_cutouts(self.data / "sprites/sprites.arrow"))

    @cached_property
    def film_reel(self) -> Reel:
        """Return the film's pictures by row."""
        from finloop.distance.reel import Reel

        return Reel(self.features, self.cutouts)

    @cached_property
    def reel(self) -> Reel:
        """Return the film's pictures by row, and its sprites."""
        from finloop.distance.reel import Reel

        return Reel(self.features, self.cutouts, self.sprites, self.sprite_cutouts)

    # --- distance, loops, jumps, gateways

    @cached_property
    def map_facts(self) -> MapFacts:
        """Return how the film's pictures are compared."""
        from finloop.distance.map import MapFacts

        return load_record(self.data / "distance/facts.json", MapFacts, "distance")

    @cached_property
    def steps(self) -> pd.DataFrame:
        """Return the distance from each compared row to the next."""
        from finloop.distance.map import STEPS

        return load_table(self.data / "distance/steps.parquet", STEPS)

    @cached_property
    def pairs(self) -> pd.DataFrame:
        """Return the pairs of similar rows, and their distances."""
        from finloop.distance.map import PAIRS

        return load_table(self.data / "distance/pairs.parquet", PAIRS)

    @cached_property
    def loops(self) -> pd.DataFrame:
        """Return the loops; an empty table if the film shows none."""
        from finloop.loops.search import LOOPS

        return load_table(self.data / "loops/loops.parquet", LOOPS)

    @cached_property
    def jumps(self) -> pd.DataFrame:
        """Return the jumps between rows that look and move alike."""
        from finloop.jumps.table import JUMPS

        return load_table(self.data / "jumps/jumps.parquet", JUMPS)

    @cached_property
    def look(self) -> Floats:
        """Return looks of the n rows, (n, k), or (2 n, k) with mirror images."""
        from finloop.jumps.table import LOOK

        return load_lists(self.data / "jumps/look.parquet", LOOK, "look")[0]

    @cached_property
    def gateways(self) -> pd.DataFrame:
        """Return the jumps from film to sprites and back."""
        from finloop.gateways.find import GATEWAYS

        return load_table(self.data / "gateways/gateways.parquet", GATEWAYS)

    # --- models

    @cached_property
    def model(self) -> MotionModel:
        """Return the motion model of the stage `bpn`."""
        from finloop.bpn.model import motion_model

        return load_record(self.data / "bpn/model.json", motion_model, "bpn")

    @cached_property
    def states(self) -> FilmStates:
        """Return the states of the film, with mirror images if `look` has them.

        FinloopError if the film shows too little.
        """
        from finloop.forecast.film import film_states, posture_mirror

        poses, p = self.poses, self.settings("forecast")
        mirror = posture_mirror(poses, self.look)
        return film_states(self.features, poses.codes, mirror, self.rate_hz, p)

    @property
    def has_forecast(self) -> bool:
        """Return whether the film showed enough for the model of the stage `forecast`."""
        return not (self.data / "forecast/reason.json").exists()

    @cached_property
    def forecast(self) -> Sampler | None:
        """Return the sampler of the stage `forecast`; None if the film showed too little."""
        from finloop.forecast.model import forecast_model
        from finloop.forecast.sampling import sampler

        if not self.has_forecast:
            return None
        folder, film = self.data / "forecast", self.states
        model = load_record(folder / "model.json", forecast_model, "forecast")
        rows, numbers = film.states.shape
        start = open_array(folder / "start.npy", (rows + 1,), "int64")
        graph = start, open_array(folder / "neighbours.npy", (int(start[-1]),), "int32")
        mean = open_array(folder / "mean.npy", (rows, numbers), "float64")
        return sampler(film, model, graph, self.settings("forecast"), mean)

    @cached_property
    def rule(self) -> Shoaling:
        """Return the rule by which fish of a tank act on each other, of the stage `calibrate`."""
        from finloop.social.rule import Shoaling
        from finloop.social.steps import SOCIAL_STEPS, steps_of
        from finloop.social.zones import Zones

        folder = self.data / "calibrate"
        table = load_table(folder / "steps.parquet", SOCIAL_STEPS)
        return load_json(
            folder / "zones.json",
            lambda entry: Shoaling(
                Zones(**entry["zones"]), steps_of(table, entry["forward"], entry["onward"]),
                entry["horizon_frames"], entry["alike"],
            ),
            *remake_hint("calibrate"),
        )  # fmt: skip


@lru_cache(1)
def _unpickle(kind: type[RunFiles], root: Path, run: str) -> RunFiles:
    """Return the project of another process, one for all that it sends here."""
    return kind(root)
