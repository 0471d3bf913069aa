"""The verbs of the library, from a film to a video; `import finloop` hands them out.

    film = open_film("film.mp4")                    the normalised clip
    tracks = track(film)                            where every fish is, in every frame (§2.1)
    features = measure(tracks)                      how it swims (§2.2-2.3)
    model = learn(features, film.rate_hz)           the network that moves sprites (§3.1)
    reel = make_sprites(tracks, features)           film and sprites (§3.3)
    similar = compare(reel)                         how alike the frames are (§4.1)
    loops = find_loops(similar, features, film.rate_hz)
    gateways = find_gateways(similar, reel)          (§4.2)
    poses = find_poses(tracks, features)            how every fish is bent
    jumps = find_jumps(reel, poses)   which frames look and move alike
    forecast = foretell(features, poses, jumps, film.rate_hz)   the next pose and motion
    shoaling = find_zones(features, film)           how its fish act on each other
    edit = steer(tracks, reel, model, similar, loops, jumps, gateways, poses, goals=[[0.2, 0.3]])
    write_video("fish.mp4", edit, tracks, reel, poses)

Sections are those of the fish paper. A verb takes the parameters of its stage by name, as in
`finloop/<word>/settings.py`; those not given have their values in conf/. What the pipeline's stages
would write to `data/`, verbs hand over, the same to the last bit. Big results lie in a folder: one
that is given, or a temporary one that goes when the program ends.

Every verb raises FinloopError, which says what came, what was wanted and what to do: if a parameter
is unknown or out of range, a file cannot be read, or the film does not show what is needed.
"""

import atexit
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.planner import Material, planner
from finloop.base.arrays import Mask
from finloop.base.errors import FinloopError
from finloop.base.parallel import Threads
from finloop.base.schema import lists_to_points
from finloop.base.settings import settings
from finloop.bpn.back_propagation import learn as fit
from finloop.bpn.model import MotionModel, motion_rows, split_or_all
from finloop.calibrate.film import film_shoal
from finloop.calibrate.rule import film_rule, shortage
from finloop.distance.compare import Similar
from finloop.distance.compare import compare as compared
from finloop.distance.map import PAIRS, STEPS, mapped
from finloop.edit.bodies import Bodies
from finloop.edit.schema import EDIT, FRAME, HYBRID, SPRITE
from finloop.extract.table import GIVEN, GIVEN_NAME, tracks_schema
from finloop.extraction import BACKGROUND_NAME, extract, said_of_lost
from finloop.features.table import FEATURES, delta_of
from finloop.features.table import features as measured
from finloop.forecast.film import film_states, shown_mirror
from finloop.forecast.learning import learn as train
from finloop.forecast.neighbours import similar_rows
from finloop.forecast.partition import split as hold_out
from finloop.forecast.sampling import Sampler, sampler
from finloop.gateways.find import GATEWAYS, gateways, nearness
from finloop.given_path import given_lines
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import CutoutStore, CutoutWriter, open_cutouts
from finloop.io.film_writer import CUTOUTS_NAME, TRACKS_NAME
from finloop.io.movie import Mp4Writer
from finloop.io.picture import load_picture
from finloop.io.table import as_loaded, load_table
from finloop.io.video import CLIP_NAME, VideoFacts, read_frames
from finloop.jumps.film import FilmJumps, film_jumps
from finloop.jumps.source import InMemory
from finloop.jumps.table import JUMPS
from finloop.loops.search import LOOPS, NoLoops, as_map, find
from finloop.mended import make_clip
from finloop.normalise import open_source
from finloop.pose.film import FilmPoses, film_poses
from finloop.reel import Reel
from finloop.render.gallery import Gallery, frames, shelves
from finloop.render.painter import Painter, Shadow
from finloop.social.rule import Shoaling, rule_of
from finloop.social.steps import STEPS as SHOAL_STEPS
from finloop.social.steps import rows_of, steps_of
from finloop.sprites.choice import choose
from finloop.sprites.orient import SPRITES, sprite_cutouts, sprite_table
from finloop.sprites.swimmers import swimmers

__all__ = [
    "compare", "draw_carp", "find_gateways", "find_jumps", "find_loops", "find_poses", "find_zones",
    "foretell", "learn", "make_sprites", "measure", "open_film", "steer", "track", "write_video",
]  # fmt: skip

_OPEN = ExitStack()  # stores and temporary folders, till the program ends
atexit.register(_OPEN.close)


@dataclass(frozen=True)
class Film:
    """A normalised clip. folder: of clip.mp4; arena (h, w): True where animals can be."""

    folder: Path
    facts: VideoFacts
    arena: Mask

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self.facts.frame_rate_hz

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """The frames, (h, w) grey or (h, w, 3) RGB uint8, one after the other."""
        return read_frames(self.folder / CLIP_NAME, colour=self.facts.colour)


@dataclass(frozen=True)
class Tracks:
    """Where every fish of a film is.

    table (n rows): columns of `tracks_schema`, a row per fish per frame, in the order track_id,
    frame; cutouts: n pictures of the same fish; background (h, w) or (h, w, 3) uint8: the tank;
    given (n rows): columns of `GIVEN`, what another program's tracks say of the same rows.
    """

    film: Film
    table: pd.DataFrame
    cutouts: CutoutStore
    background: NDArray[np.uint8]
    given: pd.DataFrame | None = None


def open_film(path: str | Path, folder: str | Path | None = None, **changes: Any) -> Film:
    """A film, a folder of pictures or a TIFF stack, as the normalised clip in `folder`/clip.

    `changes`: of `finloop.clip.settings.File`, for example frame_rate_hz=25.0 or end_s=60.0.
    """
    return _film(folder, source="file", path=str(path), **changes)


def draw_carp(folder: str | Path | None = None, **changes: Any) -> Film:
    """A film of drawn carp, in `folder`/clip; `changes`: of `finloop.clip.settings.Carp`."""
    return _film(folder, source="carp", **changes)


def _film(folder: str | Path | None, **values: Any) -> Film:
    p, home = settings("clip", **values), _make_folder(folder) / "clip"
    source = open_source(p)
    with whole_folder(home) as part:
        clip = make_clip(p, source, part)
    return Film(home, clip.facts, clip.arena)


def _make_folder(folder: str | Path | None) -> Path:
    """Return the folder that is given, or a new temporary one."""
    if folder is not None:
        return Path(folder)
    return Path(_OPEN.enter_context(tempfile.TemporaryDirectory(prefix="finloop-")))


def _open_store(path: Path) -> CutoutStore:
    """Open a store of cut-outs till the program ends."""
    return _OPEN.enter_context(open_cutouts(path))


def track(film: Film, folder: str | Path | None = None, workers: int = 1, **changes: Any) -> Tracks:
    """Cut out the fish of every frame, and follow each; table and cut-outs go to `folder`/extract.

    A frame that cannot be decoded is as one without fish, and a warning names it.
    `workers`: threads.
    `changes`: of `finloop.extract.settings.Settings`.
    """
    p, home = settings("extract", **changes), _make_folder(folder) / "extract"
    with whole_folder(home) as part:
        lost = extract(film.folder, p, part, Threads(workers)).lost
    if lost:
        warnings.warn(said_of_lost(lost, film.facts), stacklevel=2)
    table = load_table(home / TRACKS_NAME, tracks_schema(p.points))
    background = load_picture(home / BACKGROUND_NAME)
    path = home / GIVEN_NAME
    given = load_table(path, GIVEN) if path.exists() else None
    return Tracks(film, table, _open_store(home / CUTOUTS_NAME), background, given)


def measure(tracks: Tracks, **changes: Any) -> pd.DataFrame:
    """The feature table, columns of `FEATURES`, row by row of the tracks: heading, type, bend, …

    `changes`: of `finloop.features.settings.Settings`.
    """
    p = settings("features", **changes)
    table, _ = measured(tracks.table, tracks.film.rate_hz, p, tracks.given)
    return as_loaded(table, FEATURES)


def learn(features: pd.DataFrame, rate_hz: float, **changes: Any) -> MotionModel:
    """Train the network 4-20-2 on a feature table of `rate_hz` rows a second.

    `changes`: of `finloop.bpn.settings.Settings`.
    """
    p = settings("bpn", **changes)
    rows = motion_rows(features, delta_of(features))
    model, _ = fit(rows, split_or_all(rows, p), p, rate_hz)
    return model


def make_sprites(
    tracks: Tracks, features: pd.DataFrame, folder: str | Path | None = None, **changes: Any
) -> Reel:
    """The film's pictures by row, with sprites in all orientations, which go to `folder`/sprites.

    `changes`: of `finloop.sprites.settings.Settings`, for example straight="8:120-140".
    """
    p, film = settings("sprites", **changes), tracks.cutouts
    table = swimmers(features, tracks.table, p)
    look = partial(Reel(features, film).headed, size=p.picture_px)
    sprites = sprite_table(table, choose(table, look, delta_of(features), p), p)
    home = _make_folder(folder) / "sprites"
    with whole_folder(home) as part, CutoutWriter(part / "sprites.arrow", sprites=True) as writer:
        for sprite in sprite_cutouts(sprites, film):
            writer.write(sprite)
    return Reel(features, film, as_loaded(sprites, SPRITES), _open_store(home / "sprites.arrow"))


def compare(reel: Reel, **changes: Any) -> Similar:
    """Which frames are alike (Eqs. 5-8): columns of `PAIRS` and `STEPS`, distances of 0 … 1 pixels.

    `changes`: of `finloop.distance.settings.Settings`.
    """
    pairs, steps, facts = compared(reel, settings("distance", **changes))
    return Similar(as_loaded(pairs, PAIRS), as_loaded(steps, STEPS), facts)


def find_loops(
    similar: Similar, features: pd.DataFrame, rate_hz: float, **changes: Any
) -> pd.DataFrame:
    """Where the film can jump to a similar frame: columns of `LOOPS`, best first.

    Where there is none, a warning says what would give some, and the table is empty.
    `changes`: of `finloop.loops.settings.Settings`.
    """
    p, pairs = settings("loops", **changes), as_map(similar.pairs, len(features))
    try:
        loops, _ = find(pairs, features, rate_hz, similar.facts.step_median, p)
    except NoLoops as none:
        warnings.warn(str(none), stacklevel=2)
        loops = LOOPS.empty()
    return as_loaded(loops, LOOPS)


def find_gateways(similar: Similar, reel: Reel, **changes: Any) -> pd.DataFrame:
    """The jumps from the film to a sprite and back: columns of `GATEWAYS`.

    `changes`: of `finloop.gateways.settings.Settings`.
    """
    p, facts = settings("gateways", **changes), similar.facts
    near = nearness(reel, mapped(reel.features, similar.steps), facts.size, facts.pose)
    ways = gateways(near, reel.sprites, reel.features, facts.step_median, p)
    return as_loaded(ways, GATEWAYS)


def find_poses(tracks: Tracks, features: pd.DataFrame, **changes: Any) -> FilmPoses:
    """How every fish is bent in every frame, as a few codes.

    `changes`: of `finloop.pose.settings.Settings`.
    """
    return film_poses(tracks.table, features, settings("pose", **changes))


def find_jumps(reel: Reel, poses: FilmPoses, **changes: Any) -> FilmJumps:
    """The jumps between frames that look and move alike, and the looks of all rows.

    `changes`: of `finloop.jumps.settings.Settings`.
    """
    p = settings("jumps", **changes)
    result = film_jumps(InMemory.of(reel, poses, p.look_px), p)
    return result._replace(jumps=as_loaded(result.jumps, JUMPS))


def foretell(
    features: pd.DataFrame, poses: FilmPoses, jumps: FilmJumps, rate_hz: float, **changes: Any
) -> Sampler:
    """A network of the next pose and motion, trained, and what is sampled beside it.

    `changes`: of `finloop.forecast.settings.Settings`. FinloopError also if the film is too short,
    no fish in it moves or turns, or no two rows of it look alike.
    """
    p = settings("forecast", **changes)
    mirror = shown_mirror(poses, jumps.look)
    states = film_states(features, poses.codes, mirror, rate_hz, p)
    foreteller, _ = train(states, hold_out(states, p), p)
    return sampler(states, foreteller, similar_rows(states, jumps.look, jumps.visible, p), p)


def find_zones(features: pd.DataFrame, film: Film, **changes: Any) -> Shoaling:
    """How the fish of a film act on each other: zones (Couzin et al. 2002), and own steps.

    Where it shows too little company, a warning says so, and the zones are those of the paper.
    `changes`: of `finloop.calibrate.settings.Settings`, for example attraction=8.0. FinloopError
    also if no track is long enough for a step.
    """
    p = settings("calibrate", **changes)
    company = film_shoal(features, film.arena, delta_of(features), p.horizon)
    if lack := shortage(company):
        warnings.warn(lack, stacklevel=2)
    rule = rule_of(film_rule(company, p)[0])
    steps = as_loaded(pd.DataFrame(rows_of(rule.steps)), SHOAL_STEPS)
    return replace(rule, steps=steps_of(steps, rule.steps.forward, rule.steps.onward))


def steer(  # noqa: PLR0913  (a result of every verb)
    tracks: Tracks,
    reel: Reel,
    model: MotionModel,
    similar: Similar,
    loops: pd.DataFrame,
    jumps: FilmJumps,
    gateways: pd.DataFrame,
    poses: FilmPoses,
    forecast: Sampler | None = None,
    mode: str = HYBRID,
    shoaling: Shoaling | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Send fish to their goals: an edit list, columns of `EDIT`, a row a tick and fish (Fig. 18).

    `mode`: "nn" (as the forecast foretells; without one, sprites alone), "loops" (film alone) or
    "hybrid". `changes`: of
    `finloop.animate.settings.Settings`, for example goals=[[0.2, 0.3]] (shares of the tank's width
    and height) and seconds=30.0, or path="way.csv" in their place; fish=8 for several.
    `shoaling`: of `find_zones`, for rule="zones". Without loops there is no mode "loops".
    """
    film, p = tracks.film, settings("animate", **changes)
    material = Material(
        film.rate_hz, film.arena, reel, lists_to_points(tracks.table, "outline"), model,
        similar.facts, similar.steps, loops, jumps.jumps, gateways, poses, forecast,
        given_lines(p, reel.features), film.facts.mm_per_px, shoaling, tracks.background,
    )  # fmt: skip
    plans = planner(material, p)
    if mode not in plans.players:
        raise FinloopError(
            f"mode {mode!r}",
            f"one of {', '.join(plans.players)}, which this film has",
            "choose another mode; find_loops(…, threshold=…) may give a film loops",
        )
    return as_loaded(plans.plan(mode, plans.goals())[1], EDIT)


def write_video(
    path: str | Path, edit: pd.DataFrame, tracks: Tracks, reel: Reel, poses: FilmPoses,
    **changes: Any,
) -> None:  # fmt: skip
    """Draw an edit list over the empty tank: an MP4 of H.264, a frame a tick.

    `changes`: of `finloop.render.settings.Settings`; here count crf, shadow and shadow_blur.
    """
    p = settings("render", **changes)
    stores = {FRAME: reel.film} | ({} if reel.store is None else {SPRITE: reel.store})
    bodies = Bodies(poses, reel.goes_on, reel.sprites)
    gallery = Gallery(shelves(stores, tracks.table, reel.sprites), bodies)
    length_px = reel.length_px * float(edit["scale"].median())
    shadow = Shadow(p.shadow, p.shadow_blur * length_px)
    painter = Painter(tracks.background, shadow=shadow)
    rate = tracks.film.facts.frame_rate
    with Mp4Writer(Path(path), painter.frame.shape, rate, p.crf) as writer:
        for fish in frames(edit, gallery):
            painter.show(*fish)
            writer.write(painter.frame)
