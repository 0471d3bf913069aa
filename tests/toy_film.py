"""Made-up films to swim by, their sprites, tanks, and players: shared by the tests of the planner.

One film teaches how to swim: glides, bursts, turns. Another is swum by: a fish of constant speed on
circles and straight lines; every picture of it is alike, so a loop may join any two of its rows.
Positions are px, y down; angles degrees, anticlockwise.
"""

from dataclasses import replace
from functools import cache
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import scipy

from finloop.animate.arena import Tank, make_tank
from finloop.animate.kinematics import Target
from finloop.animate.motion import MotionStatistics, learn_motion
from finloop.animate.protocols import AnyPlayer
from finloop.animate.shoal import animate_fish
from finloop.animate.silhouettes import Silhouettes
from finloop.animate.world import World
from finloop.base.settings import read_conf_values, settings
from finloop.distance.picture import BODY
from finloop.edit.bodies import Bodies
from finloop.edit.build import build_edit_list
from finloop.edit.joins import resolve_join_rules
from finloop.edit.modes import MODES
from finloop.edit.stretch import Swim
from finloop.features.table import wrap_deg
from finloop.gateways.find import GATEWAYS
from finloop.loops.graph import build_loop_graph
from finloop.modes.hybrid import Gateways, Hybrid
from finloop.modes.loops import Loops
from finloop.modes.network import Network
from finloop.modes.phases import Phases, learn_phases
from finloop.modes.player import FilmFrames, PaperMode, PaperPlayer
from finloop.modes.sprites import Sprites, make_sprites
from finloop.plan.graph import MotionGraph, loop_jumps, motion_graph
from finloop.plan.matching_settings import AllSettings, merge_settings
from finloop.plan.planner import Planner
from finloop.plan.sources import FilmSource
from finloop.plan.world import FilmWorld
from finloop.pose.film import FilmPoses
from finloop.puppet import Pose, PoseShapes
from finloop.social.rule import SchoolRule, SocialSteps
from finloop.social.zones import Zones

ORIENTATIONS = 24
RATE, DELTA, LENGTH = 25.0, 5, 40.0
TOUCH, HEAD = 0.5 * LENGTH, 0.4 * LENGTH
SPEED = 2.0  # body lengths/s
STEP = SPEED * LENGTH / RATE  # px per tick

ARENA = np.zeros((600, 800), bool)
ARENA[20:580, 30:770] = True


# --- what the film teaches: glides, bursts, turns


def track(number: int, seed: int, mirror: int = 1, scale: float = 1.0) -> pd.DataFrame:
    """A fish that glides, beats its tail and turns by 40-140°, as a feature table."""
    rng = np.random.default_rng(seed)
    speed, turn, bend, kind = [], [], [], []
    v = 2.0
    for _ in range(8):
        n = int(rng.integers(8, 20))  # glide
        speed += list(v * 0.97 ** np.arange(n))
        turn += list(rng.normal(0, 0.3, n))
        bend += list(rng.normal(0, 0.0005, n))
        kind += [0] * n
        v = speed[-1]
        n = int(rng.integers(6, 14))  # burst
        speed += list(v * 1.05 ** np.arange(n))
        turn += list(rng.normal(0, 0.5, n))
        bend += list(0.02 * np.sin(2 * np.pi * np.arange(n) / 5))
        kind += [0] * n
        v = min(speed[-1], 3.0)
        n, side = int(rng.integers(7, 12)), int(rng.choice((-1, 1)))
        shape = np.sin(np.pi * (np.arange(n) + 0.5) / n)
        angle = rng.uniform(40, 140)
        speed += list(v * (1 - 0.3 * shape))
        turn += list(side * angle * shape / shape.sum())
        bend += list(side * 0.1 * shape * angle / 140)
        kind += [side] * n
    turned, bent, typed = (mirror * np.array(a, float) for a in (turn, bend, kind))
    heading = wrap_deg(30.0 * mirror + np.cumsum(turned))
    angle = np.radians(heading)
    length = LENGTH * scale
    way = np.array(speed)[:, None] / RATE * length * np.stack([np.cos(angle), -np.sin(angle)], 1)
    place = 500 + np.cumsum(way, axis=0)
    return pd.DataFrame({
        "track_id": number, "frame": np.arange(len(place)), "x_px": place[:, 0],
        "y_px": place[:, 1], "heading_deg": heading, "body_length_px": length, "bend": bent,
        "motion_area_rel": np.abs(bent) / 0.1, "swimming_type": typed.astype(int), "current": 0.0,
    })  # fmt: skip


def lessons(mirror: int = 1, scale: float = 1.0) -> pd.DataFrame:
    return pd.concat([track(i, i, mirror, scale) for i in range(4)], ignore_index=True)


def learnt(table: pd.DataFrame, rate: float = RATE) -> MotionStatistics:
    return learn_motion(table, rate, DELTA)


@cache
def lesson() -> MotionStatistics:
    return learnt(lessons())


@cache
def phases(rate: float = RATE) -> Phases:
    return learn_phases(learnt(lessons(), rate), settings("network"))


def planning(**changes) -> AllSettings:
    common, own = (read_conf_values(word, "default") for word in ("animate", "matching"))
    assert changes.keys() <= common.keys() | own.keys()
    return merge_settings(
        settings("animate", **{k: v for k, v in changes.items() if k in common}),
        settings("matching", **{k: v for k, v in changes.items() if k in own}),
    )


# --- sprites


def sprites() -> pd.DataFrame:
    """Eight frames of a tail beat, six of a glide, a turn of 120° to either side."""
    rows = []
    for sequence, count in (("straight", 8), ("slide", 6), ("left", 9), ("right", 9)):
        side = {"left": 1, "right": -1}.get(sequence, 0)
        shape = np.sin(np.pi * (np.arange(count) + 0.5) / count)
        for i in range(count):
            cycle = side == 0
            phase = "cycle" if cycle else "in" if i < 4 else "hold" if i == 4 else "out"
            rows.append({
                "sequence": sequence, "step": i, "phase": phase,
                "frame": 100 * len({r["sequence"] for r in rows} | {sequence}) + i, "scale": 1.0,
                "head_offset_deg": 0.0, "motion_area_rel": 0.05 if cycle else shape[i],
                "forward": 0.08, "sideways": 0.0,
                "turn_deg": 0.0 if cycle else side * 120 * shape[i] / shape.sum(),
                "orientations": ORIENTATIONS, "row": 10 * len(rows), "mirrored": sequence == "right",
                "heading_deg": 0.0,
            })  # fmt: skip
    return pd.DataFrame(rows)


class Model:
    """A stand-in for the trained network: the area is in proportion to the included angle."""

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        assert inputs.shape[1] == 4
        angle = inputs[:, 3]
        return np.stack([np.clip(np.abs(angle) / 100, 0, 1), np.sign(angle)], 1)


def order(rate: float = RATE) -> Sprites:
    """The sprites as they are played; any of them may follow on any other."""
    table = sprites()
    return make_sprites(table, np.random.default_rng(5).random((len(table), len(table))), rate)


# --- a film to swim by


def arc_track(turns, heading=0.0, track=0, length=LENGTH, at=(500.0, 500.0)):
    """A track that turns by so many degrees from row to row, at a constant speed."""
    headings = heading + np.cumsum([0.0, *turns])
    angle = np.radians(headings)
    step = SPEED * length / RATE * np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    place = np.array(at) + np.cumsum(np.vstack([[0, 0], step[:-1]]), axis=0)
    n = len(headings)
    return pd.DataFrame(
        {
            "track_id": track, "frame": np.arange(n), "x_px": place[:, 0], "y_px": place[:, 1],
            "heading_deg": wrap_deg(headings), "body_length_px": length,
            "motion_area_rel": 0.1, "swimming_type": 0, "bend": 0.0, "current": 0.0,
        }
    )  # fmt: skip


def table_of(*tracks):
    return pd.concat([t.assign(track_id=i) for i, t in enumerate(tracks)], ignore_index=True)


def loops(*pairs):
    """A table of loops: (a, b) or (a, b, distance) each."""
    rows = [(min(p[:2]), max(p[:2]), p[2] if len(p) > 2 else 0.5) for p in pairs]
    made = pd.DataFrame(rows, columns=["a", "b", "distance"])
    return made.astype({"a": int, "b": int, "distance": float})


def film_of(
    features, found, pose=BODY, step=1.0, barred=None, taught=None, rarity_sum=0.0
) -> MotionGraph:
    """A film with its loops; its drawn length is the median of its own."""
    n = len(features)
    graph = build_loop_graph(found, features["track_id"].to_numpy())
    barred = np.zeros(n, bool) if barred is None else np.isin(np.arange(n), barred)
    length = float(features["body_length_px"].median())
    sized = replace(taught or lesson(), body_length_px=length)
    return motion_graph(
        features, loop_jumps(graph, n, step), sized, pose, barred, rarity_sum * np.ones(n)
    )  # fmt: skip


def film_with_dead_ends() -> MotionGraph:
    """Three tracks of 201 rows; each is joined to the others only in its beginning."""
    pairs = loops(
        *((a, b) for a in (10, 50, 90, 140) for b in (215, 255, 301, 341)),
        *((a, b) for a in (20, 100) for b in (440, 530)), (30, 470), (12, 132),
    )  # fmt: skip
    return film_of(table_of(*(arc_track([rate] * 200) for rate in (4.0, -4.0, 0.0))), pairs)


def rich(seed=0, heading=True):
    """Circles to both sides and straight lines, 150 rows each; loops between any of them."""
    rng = np.random.default_rng(seed)
    rates = (0.0, 2.0, -2.0, 4.0, -4.0, 7.0, -7.0, 0.5)
    tracks = table_of(*(arc_track([rate] * 149, rng.uniform(-180, 180)) for rate in rates))
    ends = np.concatenate([150 * i + np.arange(4, 146, 6) for i in range(len(rates))])
    pairs = {(a, b) for a in ends for b in rng.choice(ends, 4) if abs(int(a) - b) > 12}
    if not heading:  # FILM: both fish of a loop must head alike
        angle = tracks["heading_deg"].to_numpy()
        every = np.array([(a, b) for a in ends for b in ends if b - a > 12])
        alike = np.abs(wrap_deg(angle[every[:, 0]] - angle[every[:, 1]])) < 7.5
        pairs = {tuple(pair) for pair in every[alike]}
    far = rng.uniform(0.1, 0.7, len(pairs))
    return tracks, loops(*((a, b, d) for (a, b), d in zip(sorted(pairs), far, strict=True)))


@cache
def rich_table() -> pd.DataFrame:
    return rich()[0]


@cache
def rich_film() -> MotionGraph:
    return film_of(*rich())


def gateways(features=None, every=7, seed=1) -> pd.DataFrame:
    """Ways in from every sprite of a cycle, ways out to every one, the headings fitting exactly."""
    features = rich_table() if features is None else features
    rng = np.random.default_rng(seed)
    heading = features["heading_deg"].to_numpy()
    last = np.append(np.diff(features["track_id"]) != 0, True)
    rows = [
        (sprite, 0, "in", row, rank, rng.uniform(0.2, 1.0), wrap_deg(-heading[row]))
        for sprite in range(14)
        for rank, row in enumerate(np.arange(1 + sprite % 5, len(features) - 1, 97), 1)
    ] + [
        (sprite, 0, "out", row, sprite + 1, rng.uniform(0.2, 1.0), wrap_deg(-heading[row + 1]))
        for row in np.flatnonzero(~last)[::every]
        for sprite in range(14)
    ]
    return pd.DataFrame(rows, columns=[c.name for c in GATEWAYS.columns])


def random_film(rng, most_rows=24):
    """A few short tracks with a few random loops, and perhaps a barred row."""
    lengths = rng.integers(2, 9, rng.integers(1, 5))
    table = table_of(
        *(arc_track(rng.uniform(-30, 30, n - 1), rng.uniform(0, 360)) for n in lengths)
    )
    n = len(table)
    drawn = {tuple(sorted(rng.choice(n, 2, replace=False))) for _ in range(rng.integers(1, 7))}
    barred = rng.choice(n, rng.integers(0, 3))
    pairs = loops(*((a, b, rng.uniform(0.1, 1)) for a, b in sorted(drawn)))
    return table, pairs, barred


# --- players


@cache
def open_tank() -> Tank:
    return make_tank(ARENA, 0.6 * LENGTH)


def film_world_of(film_=None, room_=None, taught=None, **changes) -> FilmWorld:
    return FilmWorld(
        open_tank() if room_ is None else room_, lesson() if taught is None else taught,
        TOUCH, HEAD, rich_film() if film_ is None else film_,
        planning(**({"wander": "places", "choice_noise": 0.75} | changes)),
    )  # fmt: skip


HULL = np.array([[20.0, 0], [-20, 5], [-20, -5]])


@cache
def crowd_player(overlap=False) -> Planner:
    """A player of fish as wide as HULL, in a tank of ten lengths."""
    arena = np.zeros((600, 800), bool)
    arena[100:500, 200:600] = True
    return matching_of(film_world_of(room_=make_tank(arena, 0.6 * LENGTH), overlap=overlap))


def narrow_tank() -> Tank:
    arena = np.zeros((80, 130), bool)
    arena[10:70, 10:120] = True
    return make_tank(arena, 0.6 * LENGTH)


def cast_of(film_: MotionGraph, hulls=(HULL, HULL)) -> Silhouettes:
    """Outlines: every sprite has the first, every frame the second."""
    frames = np.repeat(hulls[1][None].astype(np.float32), len(film_.has_next), axis=0)
    return Silhouettes(sprites(), [hulls[0]] * len(sprites()), frames)


def matching_of(own_world=None, hulls=(HULL, HULL), prediction=None, film_too=True) -> Planner:
    """A planner of mode `matching`: by the film, and as a forecast predicts if there is one."""
    world = film_world_of() if own_world is None else own_world
    how = resolve_join_rules(world.settings, world.settings.join, bodies_of(world.film), DELTA)
    rows = np.minimum(sprites()["row"].to_numpy(), len(world.film.has_next) - 2)
    by_film = FilmSource(world) if film_too else None
    return Planner(world, by_film, prediction, cast_of(world.film, hulls), how, None, rows)


def world_of(room_=None, taught=None) -> World:
    """The tank of the paper's modes, and what the lessons teach."""
    return World(
        open_tank() if room_ is None else room_, lesson() if taught is None else taught, TOUCH, HEAD
    )


def network_of(world=None, model=None, **changes) -> Network:
    world = world_of() if world is None else world
    rate, p = world.motion.rate_hz, settings("network", **changes)
    return Network(world, order(rate), phases(rate), Model() if model is None else model, p)


def loops_of(film_=None, world=None, **changes) -> Loops:
    world = world_of() if world is None else world
    return Loops(world, rich_film() if film_ is None else film_, settings("loops", **changes))


def hybrid_of(film_=None, world=None, gates=None) -> Hybrid:
    play = loops_of(film_, world)
    ways = Gateways(gateways() if gates is None else gates, 1.0, play)
    return Hybrid(network_of(play.world), play, ways)


def paper_player(mode: PaperMode, join="fade", hulls=(HULL, HULL)) -> PaperPlayer:
    network = mode if isinstance(mode, Network) else getattr(mode, "network", None)
    play = mode if isinstance(mode, Loops) else getattr(mode, "loops", None)
    film_ = rich_film() if play is None else play.film
    how = resolve_join_rules(settings("animate"), join, bodies_of(film_), DELTA)
    world = (network or play).world
    kept = None if network is None else network.sprites
    frames = FilmFrames(film_.heading, film_.scale, film_.has_next)
    return PaperPlayer(mode, world, frames, kept, cast_of(film_, hulls), how)


def project_of(world: World) -> Any:
    """What a stage of a mode reads of a `Project`: the rich film, in a world."""
    features, pairs = rich()
    reel = SimpleNamespace(
        features=features, lengths_px=features["body_length_px"].to_numpy(), scale=1.0,
        sprites=sprites(),
    )  # fmt: skip
    film_data = SimpleNamespace(
        map_facts=SimpleNamespace(step_median=1.0, frame_of_reference=BODY), natural_step=1.0
    )
    assets = SimpleNamespace(
        film_data=film_data, world=world, silhouettes=cast_of(rich_film()),
        scaled=SimpleNamespace(reel=reel, barred=np.zeros(len(features), bool)),
        pictures=SimpleNamespace(reel=reel, bodies=bodies_of(rich_film())),
    )  # fmt: skip
    return SimpleNamespace(
        settings=settings, film_assets=assets, sprite_assets=assets, features=features,
        loops=pairs, gateways=gateways(), network_mode=network_of(world), rate_hz=world.motion.rate_hz,
    )  # fmt: skip


def player_of(
    mode: str, own_world: FilmWorld | None = None, gates=None, join="fade", hulls=(HULL, HULL)
) -> AnyPlayer:
    """The player of a mode; of one that this file does not name, as its stage opens it."""
    own_world = film_world_of(join=join) if own_world is None else own_world
    film_, world = own_world.film, world_of(own_world.tank, own_world.motion)
    match mode:
        case "network":
            return paper_player(network_of(world), join, hulls)
        case "loops":
            return paper_player(loops_of(film_, world), join, hulls)
        case "hybrid":
            return paper_player(hybrid_of(film_, world, gates), join, hulls)
        case "matching":
            return matching_of(own_world, hulls)
    player = import_module(f"stages.modes.{mode}").open_mode(project_of(world)).player
    rules = resolve_join_rules(settings("animate"), join, bodies_of(film_), DELTA)
    return replace(player, join_rules=rules, silhouettes=cast_of(film_, hulls))


def players_of(own_world=None, gates=None, hulls=(HULL, HULL)) -> dict[str, AnyPlayer]:
    return {mode: player_of(mode, own_world, gates, hulls=hulls) for mode in MODES}


@cache
def shapes() -> PoseShapes:
    """The shapes of animals of eight steps that bend in two ways."""
    rng, n = np.random.default_rng(3), 8
    bent = rng.normal(0, 0.4, (400, 2)) @ [np.linspace(0, 1, n), np.sin(np.linspace(0, 6, n))]
    head = np.column_stack([np.full(400, 0.4), np.zeros(400)])
    return PoseShapes.fit(np.hstack([head, bent, np.full((400, n), 1 / n)]), 0.999)


def bodies_of(film_: MotionGraph) -> Bodies:
    """Postures of a film's rows, which change little by little, and of the sprites."""
    rng, n = np.random.default_rng(4), len(film_.has_next)
    noise = rng.normal(0, 0.8, (n, len(shapes().shapes)))
    codes = scipy.ndimage.gaussian_filter1d(noise, 2, axis=0)
    heading, postures = np.radians(film_.heading), shapes().decode(codes)
    pose = Pose(film_.x, film_.y, heading, LENGTH / film_.scale, postures)
    table = sprites()
    return Bodies(
        FilmPoses(pose, codes, shapes(), False, 0.0, 3.0), film_.has_next.copy(),
        table.assign(row=np.minimum(table["row"], n - 1)),
    )  # fmt: skip


def school_rule(zones: Zones) -> SchoolRule:
    """Steps of about two body lengths ahead, and zones that change them."""
    turn = np.exp(1j * np.random.default_rng(1).normal(0, 0.5, 200))
    own = SocialSteps(np.full(200, 0.2 + 0j), np.full(200, 2.0 + 0j), 2 * turn, turn, 2.0, 0.7)
    return SchoolRule(zones, own, 15, 10)


def spot(x, y, touch=TOUCH, head=HEAD) -> Target:
    return Target(float(x), float(y), touch, head)


def edit_of(player, goals, ticks, seed) -> tuple[Swim, pd.DataFrame]:
    found = animate_fish(player, goals, ticks, np.random.default_rng(seed))
    return found, build_edit_list(found, ticks, player.edit_inputs)
