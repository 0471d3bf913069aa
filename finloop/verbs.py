"""The library's verbs, from a film to a video, as `import finloop` exports them.

    film = open_film("film.mp4")                    the normalised clip
    tracks = track(film)                            where every fish is, in every frame (§2.1)
    features = measure(tracks)                      how it swims (§2.2-2.3)
    model = learn(features, film.rate_hz)           the network that moves sprites (§3.1)
    reel = make_sprites(tracks, features)           film and sprites (§3.3)
    similar = compare(reel)                         how alike the frames are (§4.1)
    loops = find_loops(similar, features, film.rate_hz)
    gateways = find_gateways(similar, reel)         (§4.2)
    poses = find_poses(tracks, features)            how every fish is bent
    jumps = find_jumps(reel, poses)                 which frames look and move alike
    forecast = train_forecast(features, poses, jumps, film.rate_hz)   the next pose and motion
    school_rule = find_zones(features, film)        how its fish act on each other
    edit = steer(tracks, reel, model, similar, loops, jumps, gateways, poses, goals=[[0.2, 0.3]])
    write_video("fish.mp4", edit, tracks, reel, poses)

Sections are those of the fish paper. A verb takes the parameters of its stage by name, as in
`finloop/<word>/settings.py`; the others keep their values in conf/. Verbs return what the
pipeline's stages write to `data/`, identical to the last bit. Big results lie in `folder`, or in a
temporary folder that is deleted when the program ends.

Every verb raises FinloopError with what came, what was wanted and what to do: if a parameter is
unknown or out of range, a file cannot be read, or the film does not show enough.
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

from finloop.animate.motion import learn_motion
from finloop.animate.silhouettes import FilmOutlines
from finloop.base.arrays import Mask
from finloop.base.errors import FinloopError
from finloop.base.parallel import Threads
from finloop.base.schema import lists_to_points
from finloop.base.settings import read_conf_values, settings
from finloop.bpn.back_propagation import train_on_film_rows
from finloop.bpn.model import MotionModel, pair_rows_with_later, split_rows_if_possible
from finloop.calibrate.film import build_film_group
from finloop.calibrate.rule import explain_missing_fit, fit_school_rule
from finloop.clip.load_light import load_light_course
from finloop.clip.rewrite import make_clip
from finloop.clip.write import open_clip_source
from finloop.distance.map import PAIRS, STEPS, FrameComparison, compare_frames, find_map_rows
from finloop.distance.reel import Reel
from finloop.edit.bodies import Bodies
from finloop.edit.schema import EDIT, FRAME, SPRITE
from finloop.extract.table import GIVEN, GIVEN_NAME, tracks_schema
from finloop.extract.write import (
    BACKGROUND_NAME,
    describe_lost_frames,
    extract_tracks,
    save_tank_pictures,
)
from finloop.features.table import FEATURES, infer_delta_frames, measure_features
from finloop.forecast.film import compute_film_states, posture_mirror_matrix, split_held_out
from finloop.forecast.learning import train_predictor
from finloop.forecast.neighbours import build_similarity_graph
from finloop.forecast.sampling import Sampler, build_sampler
from finloop.gateways.find import GATEWAYS, list_gateways, measure_sprite_distances
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import CUTOUTS_NAME, TRACKS_NAME, CutoutStore, CutoutWriter, open_cutouts
from finloop.io.movie import Mp4Writer
from finloop.io.picture import load_picture
from finloop.io.table import apply_schema, load_table
from finloop.io.video import CLIP_NAME, GRAIN_NAME, VideoFacts, read_frames
from finloop.jumps.film import FilmJumps, find_film_jumps
from finloop.jumps.signature import InMemorySource
from finloop.jumps.table import JUMPS
from finloop.loops.search import LOOPS, NoLoopsError, find_video_loops, to_sparse_map
from finloop.modes.animator import Animator, FilmData, prepare_mode_assets
from finloop.modes.hybrid import hybrid_animator
from finloop.modes.loops import loops_animator
from finloop.modes.matching import MatchingData, matching_animator
from finloop.modes.network import make_network, network_animator
from finloop.plan.load_paths import load_path_lines
from finloop.plan.matching_settings import merge_settings
from finloop.pose.film import FilmPoses, compute_film_poses
from finloop.render.gallery import Gallery, build_cutout_sets, fish_by_tick
from finloop.render.living import make_living_tank
from finloop.render.painter import Painter, Shadow
from finloop.social.rule import SOCIAL_STEPS, SchoolRule, SocialSteps, require_rule
from finloop.sprites.choice import choose_frames, swimmer_table
from finloop.sprites.orient import SPRITES, sprite_cutouts, sprite_table

__all__ = [
    "compare", "draw_carp", "find_gateways", "find_jumps", "find_loops", "find_poses", "find_zones",
    "learn", "make_sprites", "measure", "open_film", "steer", "track", "train_forecast",
    "write_video",
]  # fmt: skip


_OPEN = ExitStack()  # stores and temporary folders, until the program ends
atexit.register(_OPEN.close)


@dataclass(frozen=True)
class Film:
    """A normalised clip, clip.mp4 in `folder`; iterating over it yields its frames.

    facts: size, frame rate and others. arena (h, w): True where animals can be.
    """

    folder: Path
    facts: VideoFacts
    arena: Mask

    @property
    def rate_hz(self) -> float:
        """Return the clip's frames per second."""
        return self.facts.frame_rate_hz

    def __iter__(self) -> Iterator[NDArray[np.uint8]]:
        """Yield the frames in order, (h, w) grey or (h, w, 3) RGB uint8."""
        return read_frames(self.folder / CLIP_NAME, colour=self.facts.colour)


@dataclass(frozen=True)
class Tracks:
    """The position of every fish in every frame of a film, with its cut-out.

    table (n rows): columns of `tracks_schema`, a row per fish per frame, in the order track_id,
    frame. cutouts: the n pictures of these fish. background (h, w) or (h, w, 3) uint8: the empty
    tank. given (n rows): columns of `GIVEN`, from another program's tracks of the same rows.
    tank_pictures: a film of the empty tank with its grain; None if the film shows none.
    """

    film: Film
    table: pd.DataFrame
    cutouts: CutoutStore
    background: NDArray[np.uint8]
    given: pd.DataFrame | None = None
    tank_pictures: Path | None = None


def open_film(path: str | Path, folder: str | Path | None = None, **changes: Any) -> Film:
    """Read a film, a folder of pictures or a TIFF stack, write it as a clip, and return the clip.

    The clip lies in `folder`/clip, or in a temporary folder. `changes` override
    `finloop.clip.settings.FootageSettings`, for example frame_rate_hz=25.0 or end_s=60.0.
    """
    return _write_clip(folder, source="file", path=str(path), **changes)


def draw_carp(folder: str | Path | None = None, **changes: Any) -> Film:
    """Draw a synthetic film of carp, write it as a clip, and return the clip.

    The clip lies in `folder`/clip, or in a temporary folder. `changes` override
    `finloop.clip.settings.CarpSettings`.
    """
    return _write_clip(folder, source="carp", **changes)


def _write_clip(folder: str | Path | None, **values: Any) -> Film:
    """Write the clip that parameters of `clip` describe to `folder`/clip; return it.

    folder: None = a temporary one. values: of the parameters, by name.
    """
    p, clip_folder = settings("clip", **values), _make_folder(folder) / "clip"
    source = open_clip_source(p)
    with whole_folder(clip_folder) as temporary:
        clip = make_clip(p, source, temporary)
    return Film(clip_folder, clip.facts, clip.arena)


def _make_folder(folder: str | Path | None) -> Path:
    """Return `folder` as a path; None makes a temporary one that lasts until the program ends."""
    if folder is None:
        folder = _OPEN.enter_context(tempfile.TemporaryDirectory(prefix="finloop-"))
    return Path(folder)


def _open_store(path: Path) -> CutoutStore:
    """Open the store of cut-outs at `path`; it stays open until the program ends."""
    return _OPEN.enter_context(open_cutouts(path))


def track(film: Film, folder: str | Path | None = None, workers: int = 1, **changes: Any) -> Tracks:
    """Cut out and follow the fish in all frames; return their tracks and cut-outs.

    They are also written to `folder`/extract. A frame that cannot be decoded counts as one without
    fish, and a warning names it. `workers`: number of threads. `changes` override
    `finloop.extract.settings.ExtractSettings`.
    """
    p, home = settings("extract", **changes), _make_folder(folder) / "extract"
    with whole_folder(home) as temporary:
        extraction = extract_tracks(film.folder, p, temporary, Threads(workers))
        save_tank_pictures(film.folder, temporary, extraction.scene)
    if extraction.lost:
        warnings.warn(describe_lost_frames(extraction.lost, film.facts), stacklevel=2)
    table = load_table(home / TRACKS_NAME, tracks_schema(p.points))
    background = load_picture(home / BACKGROUND_NAME)
    given_path = home / GIVEN_NAME
    given = load_table(given_path, GIVEN) if given_path.exists() else None
    cutouts, grain = _open_store(home / CUTOUTS_NAME), home / GRAIN_NAME
    return Tracks(film, table, cutouts, background, given, grain if grain.exists() else None)


def measure(tracks: Tracks, **changes: Any) -> pd.DataFrame:
    """Measure how each fish swims in each frame; return the feature table.

    Its columns are `FEATURES`: heading, swimming type, motion area and others (§2.2-2.3); its rows
    are those of the tracks. `changes` override `finloop.features.settings.FeaturesSettings`.
    """
    p = settings("features", **changes)
    table, _ = measure_features(tracks.table, tracks.film.rate_hz, p, tracks.given)
    return apply_schema(table, FEATURES)


def learn(features: pd.DataFrame, rate_hz: float, **changes: Any) -> MotionModel:
    """Train the network that predicts motion area and swimming type (§3.1, Fig. 6).

    It learns by back-propagation and has 4 inputs, by default 20 hidden units, and 2 outputs.
    features: from `measure`. rate_hz: frames per second of the film. `changes` override
    `finloop.bpn.settings.BpnSettings`.
    """
    p = settings("bpn", **changes)
    rows = pair_rows_with_later(features, infer_delta_frames(features))
    model, _ = train_on_film_rows(rows, split_rows_if_possible(rows, p), p, rate_hz)
    return model


def make_sprites(
    tracks: Tracks, features: pd.DataFrame, folder: str | Path | None = None, **changes: Any
) -> Reel:
    """Choose sprites, cut-outs turned to all orientations (§3.3); return the reel with them.

    A reel holds the film's features and cut-outs, and the sprites. The sprites are also written to
    `folder`/sprites. `changes` override `finloop.sprites.settings.SpritesSettings`, for example
    straight_frames="8:120-140".
    """
    p, cutouts = settings("sprites", **changes), tracks.cutouts
    table = swimmer_table(features, tracks.table, p)
    draw = partial(Reel(features, cutouts).draw_aligned_rows, size_px=p.picture_px)
    sprites = sprite_table(table, choose_frames(table, draw, infer_delta_frames(features), p), p)
    home, name = _make_folder(folder) / "sprites", "sprites.arrow"
    with whole_folder(home) as temporary, CutoutWriter(temporary / name, sprites=True) as writer:
        for sprite in sprite_cutouts(sprites, cutouts):
            writer.write(sprite)
    return Reel(features, cutouts, apply_schema(sprites, SPRITES), _open_store(home / name))


def compare(reel: Reel, **changes: Any) -> FrameComparison:
    """Return the distances between the film's frames: how unlike they look (Eqs. 5-8).

    Fields of the result: pairs: similar rows, columns of `PAIRS`. steps: distances of each compared
    row to later ones of its track, columns of `STEPS`. facts: how they were compared. Pixels count
    as 0 … 1. In a film of more than `max_rows` rows only stretches are compared. FinloopError if
    the film does not move, or no frame follows another. `changes` override
    `finloop.distance.settings.DistanceSettings`.
    """
    pairs, steps, facts = compare_frames(reel, settings("distance", **changes))
    return FrameComparison(apply_schema(pairs, PAIRS), apply_schema(steps, STEPS), facts)


def find_loops(
    similar: FrameComparison, features: pd.DataFrame, rate_hz: float, **changes: Any
) -> pd.DataFrame:
    """Find the video loops (§4.1), jumps between similar frames; return them, best first.

    similar: from `compare`. features: from `measure`. rate_hz: frames per second of the film. If
    there is no loop, a warning says which parameter would give some, and the table is empty.
    `changes` override `finloop.loops.settings.LoopsSettings`.
    """
    p, distance_map = settings("loops", **changes), to_sparse_map(similar.pairs, len(features))
    try:
        loops, _ = find_video_loops(distance_map, features, rate_hz, similar.facts.step_median, p)
    except NoLoopsError as error:
        warnings.warn(str(error), stacklevel=2)
        loops = LOOPS.empty()
    return apply_schema(loops, LOOPS)


def find_gateways(similar: FrameComparison, reel: Reel, **changes: Any) -> pd.DataFrame:
    """Find the gateways between film and sprites (§4.2, Fig. 14); return their table.

    similar: from `compare`. reel: from `make_sprites`. `changes` override
    `finloop.gateways.settings.GatewaysSettings`.
    """
    p, facts = settings("gateways", **changes), similar.facts
    rows = find_map_rows(reel.features, similar.steps)
    distances = measure_sprite_distances(reel, rows, facts.size, facts.frame_of_reference)
    gateways = list_gateways(distances, reel.sprites, reel.features, facts.step_median, p)
    return apply_schema(gateways, GATEWAYS)


def find_poses(tracks: Tracks, features: pd.DataFrame, **changes: Any) -> FilmPoses:
    """Return every row's pose as a few numbers, its pose code (n, c), and the shapes behind them.

    `changes` override
    `finloop.pose.settings.PoseSettings`.
    """
    return compute_film_poses(tracks.table, features, settings("pose", **changes))


def find_jumps(reel: Reel, poses: FilmPoses, **changes: Any) -> FilmJumps:
    """Find the jumps between rows that look and move alike; return them with the rows' looks.

    jumps: columns of `JUMPS`. look (n, k): light and skin of the rows. `changes` override
    `finloop.jumps.settings.JumpsSettings`.
    """
    p = settings("jumps", **changes)
    result = find_film_jumps(InMemorySource.from_reel(reel, poses, p.look_px), p)
    return result._replace(jumps=apply_schema(result.jumps, JUMPS))


def train_forecast(
    features: pd.DataFrame, poses: FilmPoses, jumps: FilmJumps, rate_hz: float, **changes: Any
) -> Sampler:
    """Train a network that predicts the next pose and motion; return a sampler of predictions.

    rate_hz: frames per second of the film. `changes` override
    `finloop.forecast.settings.ForecastSettings`. FinloopError also if the film is too short, no
    fish in it moves or turns, or no two rows of it look alike.
    """
    p = settings("forecast", **changes)
    mirror = posture_mirror_matrix(poses, jumps.look)
    states = compute_film_states(features, poses.codes, mirror, rate_hz, p)
    predictor, _ = train_predictor(states, split_held_out(states, p), p)
    return build_sampler(
        states, predictor, build_similarity_graph(states, jumps.look, jumps.visible, p), p
    )


def find_zones(features: pd.DataFrame, film: Film, **changes: Any) -> SchoolRule:
    """Measure how fish of a school react to each other; return the rule: zones and steps.

    In the zones, those of Couzin et al. 2002, fish repel, align with and attract each other; a step
    is how a fish moves over a short time. If the film shows too few fish near each other, a warning
    says so, and the zones are those of the paper. `changes` override
    `finloop.calibrate.settings.CalibrateSettings`, for example attraction_radius_bl=8.0.
    FinloopError also if no track is long enough for a step.
    """
    p = settings("calibrate", **changes)
    group = build_film_group(features, film.arena, infer_delta_frames(features), p.horizon)
    if shortage := explain_missing_fit(group):
        warnings.warn(shortage, stacklevel=2)
    fitted_rule, _ = fit_school_rule(group, p)
    rule = require_rule(fitted_rule)
    steps = rule.steps
    table = apply_schema(steps.to_table(), SOCIAL_STEPS)
    # The steps as the stage `calibrate` stores them: rounded to the table's types.
    stored_steps = SocialSteps.from_table(table, steps.move_per_pull, steps.turn_per_pull)
    return replace(rule, steps=stored_steps)


def steer(  # noqa: PLR0913  (a result of every verb)
    tracks: Tracks,
    reel: Reel,
    model: MotionModel,
    similar: FrameComparison,
    loops: pd.DataFrame,
    jumps: FilmJumps,
    gateways: pd.DataFrame,
    poses: FilmPoses,
    forecast: Sampler | None = None,
    mode: str = "hybrid",
    school_rule: SchoolRule | None = None,
    **changes: Any,
) -> pd.DataFrame:
    """Animate fish that swim to their goals; return the edit list.

    Its columns are `EDIT`, its rows one per tick and fish; a tick is one frame of the animation.

    `mode`: "network" (Fig. 18), "loops" (§4.1-4.2), "hybrid" (Fig. 19) or "matching" (all frames,
    their mirror images and, with a `forecast`, predictions). `changes` override the groups
    `animate`, for example goals=[[0.2, 0.3]] (shares of the tank's width and height) and
    seconds=30.0, and the mode's, for example join="inertial"; of matching also path="way.csv",
    instead of goals, and fish=8. The other arguments are results of the other verbs; `school_rule`,
    from `find_zones`, is for rule="zones". FinloopError also if the film shows too little for the
    mode.
    """
    if mode not in GROUPS_OF:
        names = ", ".join(GROUPS_OF)
        raise FinloopError(f"mode {mode!r}", f"one of {names}", "take one of these modes")
    p = _group_settings(("animate", *GROUPS_OF[mode]), changes)
    film, outline_px = tracks.film, lists_to_points(tracks.table, "outline")
    shows_sprites = mode in ("network", "hybrid")
    film_data = FilmData(
        learn_motion(reel.features, film.rate_hz, infer_delta_frames(reel.features)), film.arena,
        tracks.background, reel if shows_sprites else Reel(reel.features, reel.cutouts),
        FilmOutlines.from_rows(outline_px, reel.features), poses, similar.facts, similar.steps,
    )  # fmt: skip
    common = p["animate"]
    assets = prepare_mode_assets(film_data, common)
    animator: Animator
    if mode == "loops":
        animator = loops_animator(assets, loops, common, p["loops"])
    elif shows_sprites:
        network = make_network(assets, model, p["network"])
        if mode == "network":
            animator = network_animator(assets, network, common)
        else:
            animator = hybrid_animator(
                assets, network, loops, gateways, common, p["loops"], p["hybrid"]
            )
    else:
        lines = load_path_lines(p["matching"], reel.features)
        matching_data = MatchingData(
            assets, jumps.jumps, forecast, lines, film.facts.mm_per_px, school_rule
        )
        animator = matching_animator(matching_data, merge_settings(common, p["matching"]))
    _, edit = animator.plan(animator.goals())
    return apply_schema(edit, EDIT)


GROUPS_OF = {
    "network": ("network",),
    "loops": ("loops",),
    "hybrid": ("network", "loops", "hybrid"),
    "matching": ("matching",),
}
"""The groups of parameters of a mode beside `animate`; the last is its own."""


def _group_settings(groups: tuple[str, ...], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of each group; a change applies to the last group that knows its name.

    groups: names of groups of parameters. changes: values by the name of the parameter; the last
    group gets unknown names, and refuses them.
    """
    names = {group: set(read_conf_values(group, "default")) for group in groups}
    changes_of: dict[str, dict[str, Any]] = {group: {} for group in groups}
    for name, value in changes.items():
        last = next((group for group in reversed(groups) if name in names[group]), groups[-1])
        changes_of[last][name] = value
    return {group: settings(group, **changes_of[group]) for group in groups}


def write_video(
    path: str | Path, edit: pd.DataFrame, tracks: Tracks, reel: Reel, poses: FilmPoses,
    **changes: Any,
) -> None:  # fmt: skip
    """Draw an edit list over the empty tank and write it as an MP4 (H.264), one frame per tick.

    The tank has the film's grain; tank="still" makes it stand still, tank="film" adds the film's
    changes of light. `changes` override tank, crf and shadow_darkness of
    `finloop.render.settings.RenderSettings`.
    """
    p = settings("render", **changes)
    stores = {FRAME: reel.cutouts}
    if reel.store is not None:
        stores[SPRITE] = reel.store
    bodies = Bodies(poses, reel.has_next_frame, reel.sprites)
    gallery = Gallery(build_cutout_sets(stores, tracks.table, reel.sprites), bodies)
    shown_length_px = reel.length_px * float(edit["scale"].median())  # of a fish's body
    shadow = Shadow(share=p.shadow_darkness, blur_px=p.shadow_blur * shown_length_px)
    rate, colour = tracks.film.facts.frame_rate, tracks.background.ndim == 3
    grain = tracks.tank_pictures if p.tank != "still" else None
    pictures = [frame.copy() for frame in read_frames(grain, colour=colour)] if grain else []
    light = load_light_course(tracks.film.folder) if p.tank == "film" else None
    tank = make_living_tank(tracks.background, pictures, light)
    painter = Painter(tracks.background, shadow=shadow, tank=tank)
    with Mp4Writer(Path(path), painter.frame.shape, rate, p.crf) as writer:
        for tick, fish in enumerate(fish_by_tick(edit, gallery)):
            painter.show(*fish, tick=tick)
            writer.write(painter.frame)
