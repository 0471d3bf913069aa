"""Stage `animate`: goals become an edit list, with the measures of how good it is."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from finloop import animate_measures as measures
from finloop.animate import Player, player, random_goals
from finloop.animate_edit import EDIT, NETWORK
from finloop.animate_pictures import (
    SIZE,
    drawn_steps,
    film_next,
    film_steps,
    seams,
    sprite_pictures,
)
from finloop.animate_plots import kinematics
from finloop.animate_tank import place_goals
from finloop.distance import distance
from finloop.features import FEATURES
from finloop.files.atomic import whole_folder
from finloop.files.cutouts import CutoutStore, open_cutouts
from finloop.files.goals import save_goals
from finloop.files.model import load_model
from finloop.files.picture import save_figure
from finloop.files.table import load_table, save_table
from finloop.files.video import ARENA_NAME, FACTS_NAME, load_facts, load_mask
from finloop.sprites import SPRITES
from finloop.sprites_pictures import following, outlines, pictures
from stages.params import load
from stages.params.animate import OPTIONS, Animate

CLIP, EXTRACT, SPRITES_FOLDER = Path("data/clip"), Path("data/extract"), Path("data/sprites")
OUT, REPORT = Path("data/animate"), Path("reports/animate")
TRIAL_GOALS = 3
ALIKE = 3.0  # median steps of the film; sprites no farther apart may be drawn on one another


@dataclass(frozen=True)
class Brought:
    """The fish that swims; pose (n, n): Eq. 5 between what the film shows after a sprite, and a
    sprite; natural (steps,): Eq. 5 between successive frames of the film."""

    fish: Player
    pose: np.ndarray
    natural: np.ndarray


def bring(p: Animate, features: pd.DataFrame, film: CutoutStore, store: CutoutStore) -> Brought:
    """Everything that planning needs, from what the stages before have made."""
    facts = load_facts(CLIP / FACTS_NAME)
    sprites = load_table(SPRITES_FOLDER / "sprites.parquet", SPRITES)
    length = float(features["body_length_px"].median())
    natural = film_steps(features, film, length)
    shown = pictures(sprites, store, length, SIZE)
    pose = distance(following(sprites, features, film, length, SIZE), shown)
    fish = player(
        features,
        load_model(Path("data/bpn/model.json")),
        sprites,
        pose,
        distance(shown, shown) <= ALIKE * np.median(natural),
        outlines(sprites, store),
        load_mask(CLIP / ARENA_NAME, facts.width_px, facts.height_px),
        facts.frame_rate_hz,
        p.goal_radius,
    )
    return Brought(fish, pose, natural)


def main() -> None:
    """Make data/animate/, reports/animate/."""
    p = load("animate", OPTIONS)
    features = load_table(Path("data/features/features.parquet"), FEATURES)
    with (
        open_cutouts(SPRITES_FOLDER / "sprites.arrow") as store,
        open_cutouts(EXTRACT / "cutouts.arrow") as film,
    ):
        brought = bring(p, features, film, store)
        fish, natural = brought.fish, brought.natural
        mode, length = fish.mode, fish.mode.motion.body_length_px
        reach = mode.touch_px + mode.head_px
        goals = [
            goal._replace(radius_px=mode.touch_px)
            for goal in place_goals(p.goals, p.goals_in, mode.tank, reach)
        ]
        ticks = round(p.seconds * mode.motion.rate_hz)
        edit = fish.play(goals, ticks, np.random.default_rng(p.seed))
        drawn = drawn_steps(edit, sprite_pictures(fish.sprites, store, length))
    swum = measures.motion_of_film(features, mode.motion)
    numbers = {
        **measures.of_plan(edit, goals, fish, swum),
        **measures.of_steps(drawn, natural),
        **measures.of_seams(seams(edit, brought.pose, film_next(fish.sprites)), natural),
        **(states := measures.of_states(edit)),
        "longest_exact_repeat_s": measures.longest_repeat(edit["source"].to_numpy())
        / mode.motion.rate_hz,
    }
    trials = []
    with progress("animate", p.trials, "trials") as advance:
        for seed in range(p.trials):
            rng = np.random.default_rng([p.seed, seed])
            asked = random_goals(mode.tank, reach, TRIAL_GOALS, rng)
            trials.append(measures.of_plan(fish.play(asked, ticks, rng), asked, fish, swum))
            advance()

    with whole_folder(OUT) as folder:
        save_table(folder / f"{NETWORK}.parquet", edit, EDIT)
        save_goals(folder / "goals.json", goals)
    film_numbers = measures.of_film(features, swum, natural, mode.motion)
    mine = measures.motion_of_edit(edit, fish)
    save_figure(
        REPORT / "kinematics.png", kinematics(swum, film_numbers, {NETWORK: (mine, states)})
    )
    average = pd.DataFrame(trials).mean().add_prefix("trials_").to_dict()
    save_metrics(
        REPORT / "metrics.json",
        {f"{NETWORK}_{name}": value for name, value in (numbers | average).items()}
        | {f"film_{name}": value for name, value in film_numbers.items()},
    )


if __name__ == "__main__":
    run(main)
