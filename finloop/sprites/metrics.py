"""Measures of the sprites: Table 1 after synthesis, closure of loops, faults."""

import numpy as np
import pandas as pd

from finloop.distance.picture import distance_pair_by_pair, successive_distances
from finloop.features.metrics import table1
from finloop.features.swimming_type import LEFT, RIGHT, STRAIGHT
from finloop.features.table import orientations_of
from finloop.sprites.choice import Choice, Look, closure
from finloop.sprites.settings import SpritesSettings
from finloop.sprites.stretch import SIDES, cycle_heading

TYPES = {"straight": STRAIGHT, "slide": STRAIGHT, "left": LEFT, "right": RIGHT}


def table1_after(sprites: pd.DataFrame, features: pd.DataFrame) -> pd.DataFrame:
    """Return the fish paper's Table 1 for the sprites: a row for each of their orientations.

    sprites: schema `SPRITES`; features: the film's. Largest motion areas are shares of the film's
    largest one in turns to that side.
    """
    count = orientations_of(sprites)
    every = pd.DataFrame(
        {
            "orientation": np.tile(np.arange(1, count + 1), len(sprites)),
            "orientations": count,
            "swimming_type": np.repeat(sprites["sequence"].map(TYPES).to_numpy(), count),
            "motion_area": np.repeat(sprites["bend"].abs().to_numpy(), count),
        }
    )
    table = table1(every)
    for word, kind in SIDES.items():
        mine = every.loc[every["swimming_type"] == kind, "motion_area"].max()
        clip = features.loc[features["swimming_type"] == kind, "motion_area"].max()
        if clip > 0:  # NaN where the clip never turns to this side and the other is mirrored
            table[f"max_area_{word}"] *= mine / clip
    return table


def count_complete_orientations(table: pd.DataFrame) -> int:
    """Count the orientations (rows) of a Table 1 that show straight swimming and both turns."""
    return int((table[["straight_pct", "left_pct", "right_pct"]] > 0).all(axis=1).sum())


def numbers(
    sprites: pd.DataFrame, table: pd.DataFrame, features: pd.DataFrame, frames: int, rate_hz: float
) -> dict[str, float]:
    """Return the metrics of the chosen sprites, by their names in metrics.json.

    sprites: schema `SPRITES`; table: from `swimmers`; frames: the number of film frames; rate_hz:
    frames per second.
    """
    sequences = dict(iter(sprites.groupby("sequence", sort=False)))
    frames_used = sprites[["track_id", "frame"]].drop_duplicates()
    result: dict[str, float] = {
        "sprites": len(sprites),
        "pictures": len(sprites) * orientations_of(sprites),
        "picked_of_fish_frames_pct": 100 * len(frames_used) / len(table),
        "picked_of_film_frames_pct": 100 * frames_used["frame"].nunique() / frames,
        "tracks_used": sprites["track_id"].nunique(),
        "scale_min": sprites["scale"].min(),
        "scale_max": sprites["scale"].max(),
        "mirrored_turns": sum(sequences[word]["mirrored"].any() for word in SIDES),
        "orientations_with_all_types_before": count_complete_orientations(table1(features)),
        "orientations_with_all_types_after": count_complete_orientations(
            table1_after(sprites, features)
        ),
        "tail_beat_hz": rate_hz / len(sequences["straight"]),
    }
    for word, rows in sequences.items():
        result |= {
            f"{word}_frames": len(rows),
            f"{word}_speed_body_lengths_per_s": rows["forward"].mean() * rate_hz,
            f"{word}_turn_deg": rows["turn_deg"].sum(),
            f"{word}_motion_area_max_rel": rows["motion_area_rel"].max(),
        }
    return result


def loop_numbers(word: str, choice: Choice, table: pd.DataFrame, look: Look) -> dict[str, float]:
    """Return how far the tail swings [body lengths] in a cycle, and how well the cycle closes.

    word: the sequence, straight or slide. Closure is the picture distance of the last frame, and of
    the one after it, from the first, over the cycle's median step. It is missing if the track ends
    there.
    """
    rows = np.arange(choice.stretch.rows.start, choice.stretch.rows.stop)
    n = len(rows)
    more = np.r_[rows, min(rows[-1] + 1, len(table) - 1)]
    goes_on = table["track_id"].iat[more[-1]] == choice.stretch.track_id and more[-1] > rows[-1]
    tail = table["tail"].to_numpy()[rows]
    pictures = look(more, cycle_heading(table, rows[0], n)) if goes_on else None
    result = {f"{word}_tail_swing_body_lengths": float(np.ptp(tail))}
    if pictures is not None:
        median = max(float(np.median(successive_distances(pictures))), 1e-9)
        result[f"{word}_closure_last_to_first"] = (
            float(distance_pair_by_pair(pictures[n - 1], pictures[0])) / median
        )
        result[f"{word}_closure_after_last_to_first"] = closure(pictures)
    return result


def is_still(choice: Choice, table: pd.DataFrame, delta: int, settings: SpritesSettings) -> bool:
    """Return whether a chosen slide is one: at least `slide_least` long, its tail within `still`.

    table: from `swimmers`; delta: Δ in frames.
    """
    tail = table["tail"].to_numpy()[choice.stretch.rows]
    long = len(tail) >= round(settings.slide_least * delta)
    return long and float(np.ptp(tail)) <= settings.still


def faults(choices: dict[str, Choice]) -> pd.DataFrame:
    """Return every fault of each choice: sequence, frames, fault, value (1 is acceptable)."""
    return pd.DataFrame(
        [
            (word, f"{s.track_id}:{s.first}-{s.last}", name, value)
            for word, choice in choices.items()
            for s in [choice.stretch]
            for name, value in (s.faults or {"listed by hand": 0.0}).items()
        ],
        columns=["sequence", "frames", "fault", "value"],
    )
