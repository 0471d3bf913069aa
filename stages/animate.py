"""Stage `animate`: goals become an edit list a mode, with the measures of how good each is."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.animate import measures
from finloop.animate.arena import place_goals, tank
from finloop.animate.edit_list import CONSIDERED, EDIT, LOOPS, Goal
from finloop.animate.film import film
from finloop.animate.motion import learn
from finloop.animate.pictures import Pictures, drawn_steps, seams, without_ghosts
from finloop.animate.players import frame_hulls, players, reach
from finloop.animate.settings import Settings
from finloop.animate.sprites import arrange
from finloop.animate.state import Waters
from finloop.animate.swim import Cast, Player, edit_list, random_goals, swim
from finloop.base.schema import lists_to_array
from finloop.bpn.model import motion_model
from finloop.distance.map import STEPS, MapFacts
from finloop.distance.picture import distance
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.table import FEATURES, delta_frames
from finloop.gateways.find import GATEWAYS
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import open_cutouts
from finloop.io.record import load_record, save_records
from finloop.io.table import load_table, save_csv, save_table
from finloop.io.video import ARENA_NAME, FACTS_NAME, load_facts, load_mask
from finloop.loops.find import LOOPS as LOOPS_TABLE
from finloop.loops.graph import loop_graph
from finloop.reel import Reel
from finloop.sprites.orient import SPRITES
from finloop.sprites.pictures import outlines
from stages.settings import load

DATA, OUT, REPORT = Path("data"), Path("data/animate"), Path("reports/animate")
OUTLINE = ("outline_x_px", "outline_y_px")

Swum = tuple[np.ndarray, np.ndarray]
"""Speed and turn rate of everything that swam."""


@dataclass(frozen=True)
class Brought:
    """A player a mode, and the film's natural steps.

    step: their median, the unit of every seam; steps, as_filmed (n,): Eq. 5 between successive
    frames, in the pose of the distance map and without turning them.
    """

    waters: Waters
    players: dict[str, Player]
    pictures: Pictures
    step: float
    steps: np.ndarray
    as_filmed: np.ndarray
    features: pd.DataFrame


@contextmanager
def bring(p: Settings) -> Iterator[Brought]:
    """Everything that planning and measuring need, from what the stages before have made."""
    facts = load_facts(DATA / "clip" / FACTS_NAME)
    features = load_table(DATA / "features/features.parquet", FEATURES)
    sprites = load_table(DATA / "sprites/sprites.parquet", SPRITES)
    model = load_record(DATA / "bpn/model.json", motion_model, "bpn")
    points = load_record(DATA / "extract/scene.json", SceneFacts, "extract").points
    outline = load_table(DATA / "extract/tracks.parquet", tracks_schema(points), OUTLINE)
    map_facts = load_record(DATA / "distance" / "facts.json", MapFacts, "distance")
    loops = load_table(DATA / "loops/loops.parquet", LOOPS_TABLE)
    gates = load_table(DATA / "gateways/gateways.parquet", GATEWAYS)
    arena = load_mask(DATA / "clip" / ARENA_NAME, facts.width_px, facts.height_px)
    steps = load_table(DATA / "distance/steps.parquet", STEPS)[["step", "as_filmed"]].dropna()
    with (
        open_cutouts(DATA / "sprites/sprites.arrow") as store,
        open_cutouts(DATA / "extract/cutouts.arrow") as frames,
    ):
        motion = learn(
            features, facts.frame_rate_hz, delta_frames(model.delta_s, facts.frame_rate_hz), p
        )
        reel = Reel(features, frames, sprites, store)
        pictures = Pictures(reel, map_facts.size)
        hulls = frame_hulls(
            np.stack([lists_to_array(outline[name]) for name in OUTLINE], axis=-1),
            features,
            (reel.length_px / reel.lengths_px).astype(float),
        )
        cast = Cast(sprites, outlines(reel), hulls)
        reach_px, barred = reach(cast.sprite_hulls, hulls, p.reach_quantile)
        graph = loop_graph(loops, features["track_id"].to_numpy())
        way = film(features, graph, motion, map_facts.pose, map_facts.step_median, barred)
        head = np.hypot(
            features["head_x_px"] - features["x_px"], features["head_y_px"] - features["y_px"]
        ).median()
        order = arrange(sprites, distance(pictures.after, pictures.headed), motion.rate_hz)
        touch_px = p.goal_radius * motion.body_length_px
        waters = Waters(tank(arena, reach_px), way, order, motion, touch_px, float(head), p)
        yield Brought(
            waters,
            players(waters, cast, model, gates, map_facts.step_median),
            pictures,
            map_facts.step_median,
            steps["step"].to_numpy(float),
            steps["as_filmed"].to_numpy(float),
            features,
        )


def trials(p: Settings, player: Player, film_motion: Swum) -> dict[str, float]:
    """The measures of further animations, to random goals, on average."""
    waters = player.waters
    ticks, goal_reach = waters.ticks(p.seconds), waters.touch_px + waters.head_px
    numbers = []
    with progress("animate", p.trials, "trials") as advance:
        for seed in range(p.trials):
            rng = np.random.default_rng([p.seed, seed])
            goals = random_goals(waters.tank, goal_reach, p.trial_goals, rng)
            edit = player.play(goals, ticks, rng)
            numbers.append(measures.of_plan(edit, goals, player, film_motion))
            advance()
    return pd.DataFrame(numbers).mean().add_prefix("trials_").to_dict()


def animation(
    folder: Path, mode: str, goals: list[Goal], brought: Brought, film_motion: Swum
) -> tuple[dict[str, float], pd.DataFrame]:
    """Make the edit list of a mode: its measures, and itself."""
    player, waters, pictures = brought.players[mode], brought.waters, brought.pictures
    p, ticks = waters.settings, waters.ticks(waters.settings.seconds)
    swum = swim(player, goals, ticks, np.random.default_rng(p.seed))
    edit = without_ghosts(edit_list(swum, ticks, player), pictures, p.fade_steps * brought.step)
    save_table(folder / f"{mode}.parquet", edit, EDIT)
    save_table(folder / f"{mode}_considered.parquet", swum.considered(ticks), CONSIDERED)
    joins, jumps = seams(edit, pictures)
    rate = waters.motion.rate_hz
    return {
        **measures.of_plan(edit, goals, player, film_motion),
        **measures.of_steps(drawn_steps(edit, pictures), brought.as_filmed),
        **measures.of_seams(joins, brought.steps),
        **measures.of_states(edit),
        **measures.of_rhythm(edit, jumps, rate),
        "longest_exact_repeat_s": measures.longest_repeat(edit) / rate,
        **trials(p, player, film_motion),
    }, edit


def main() -> None:
    """Make data/animate/, reports/animate/."""
    p: Settings = load("animate")
    numbers: dict[str, dict[str, float]] = {}
    moved = {}
    with bring(p) as brought, whole_folder(OUT) as folder:
        waters = brought.waters
        touch_px = waters.touch_px + waters.head_px
        goals = [
            goal._replace(radius_px=waters.touch_px)
            for goal in place_goals(p.goals, p.goals_in, waters.tank, touch_px)
        ]
        save_records(folder / "goals.json", goals)
        swum = measures.motion_of_film(brought.features, waters.motion)
        for mode, player in brought.players.items():
            numbers[mode], edit = animation(folder, mode, goals, brought, swum)
            moved[mode] = measures.motion_of_edit(edit, player)
        film_numbers = measures.of_film(brought.features, swum, brought.as_filmed, waters.motion)
        moves = measures.kinematics({measures.FILM_MOTION: swum} | moved)
        save_table(folder / "kinematics.parquet", moves, measures.KINEMATICS)
    if LOOPS not in numbers:
        print(
            "animate: the film has no loops to go on by: no mode `loops`, and `hybrid` is the "
            "network mode alone (the stage `loops` says what would give some)",
            file=sys.stderr,
        )
    side_by_side = measures.table(numbers, film_numbers)
    save_csv(REPORT / "measures.csv", side_by_side, decimals=3)
    save_metrics(
        REPORT / "metrics.json",
        {
            f"{mode}_{name}": value
            for mode, measured in numbers.items()
            for name, value in measured.items()
        }
        | {f"film_{name}": value for name, value in film_numbers.items()},
    )


if __name__ == "__main__":
    run(main)
