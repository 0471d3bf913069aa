"""Measures of the sprites: Table 1 after synthesis, closure of loops, faults."""

import numpy as np
import pandas as pd

from finloop.distance.picture import paired_distances, successive_distances
from finloop.features.metrics import orientation_table
from finloop.features.swimming_type import STRAIGHT
from finloop.features.table import count_orientations
from finloop.sprites.choice import (
    SIDES,
    ChosenFrames,
    DrawPictures,
    cycle_headings,
    measure_loop_closure,
)


def sprite_orientation_table(sprites: pd.DataFrame, features: pd.DataFrame) -> pd.DataFrame:
    """Return the fish paper's Table 1 for the sprites: a row for each of their orientations.

    Motion areas are relative to the film's largest in turns to that side.
    """
    count = count_orientations(sprites)
    types = [SIDES.get(sequence, STRAIGHT) for sequence in sprites["sequence"]]
    pictures = pd.DataFrame({  # a row for each sprite in each orientation
        "orientation": np.tile(np.arange(1, count + 1), len(sprites)),
        "orientations": count,
        "swimming_type": np.repeat(types, count),
        "motion_area": np.repeat(sprites["bend"].abs().to_numpy(), count),
    })  # fmt: skip
    table = orientation_table(pictures)
    for sequence, side in SIDES.items():
        of_sprites, of_film = (
            rows.loc[rows["swimming_type"] == side, "motion_area"].max()
            for rows in (pictures, features)
        )
        if of_film > 0:  # NaN where the film never turns to this side and the other is mirrored
            table[f"max_area_{sequence}"] *= of_sprites / of_film
    return table


def count_complete_orientations(table: pd.DataFrame) -> int:
    """Return how many orientations (rows) of a Table 1 show straight swimming and both turns."""
    return int((table[["straight_pct", "left_pct", "right_pct"]] > 0).all(axis=1).sum())


def sprite_metrics(
    sprites: pd.DataFrame, table: pd.DataFrame, features: pd.DataFrame, film_frames: int,
    rate_hz: float,
) -> dict[str, float]:  # fmt: skip
    """Return the metrics of the chosen sprites, by their names in metrics.json.

    table: from `swimmer_table`; film_frames: how many the film has. Names with "before" speak of
    the film, those with "after" of the sprites.
    """
    sequences = dict(iter(sprites.groupby("sequence", sort=False)))
    used = sprites[["track_id", "frame"]].drop_duplicates()
    after = sprite_orientation_table(sprites, features)
    result: dict[str, float] = {
        "sprites": len(sprites),
        "pictures": len(sprites) * count_orientations(sprites),
        "picked_of_fish_frames_pct": 100 * len(used) / len(table),
        "picked_of_film_frames_pct": 100 * used["frame"].nunique() / film_frames,
        "tracks_used": sprites["track_id"].nunique(),
        "scale_min": sprites["scale"].min(),
        "scale_max": sprites["scale"].max(),
        "mirrored_turns": sum(sequences[sequence]["mirrored"].any() for sequence in SIDES),
        "orientations_with_all_types_before": count_complete_orientations(
            orientation_table(features)
        ),
        "orientations_with_all_types_after": count_complete_orientations(after),
        "tail_beat_hz": rate_hz / len(sequences["straight"]),
    }
    for sequence, rows in sequences.items():
        result |= {
            f"{sequence}_frames": len(rows),
            f"{sequence}_speed_body_lengths_per_s": rows["forward"].mean() * rate_hz,
            f"{sequence}_turn_deg": rows["turn_deg"].sum(),
            f"{sequence}_motion_area_max_rel": rows["motion_area_rel"].max(),
        }
    return result


def cycle_metrics(
    sequence: str, choice: ChosenFrames, table: pd.DataFrame, draw_pictures: DrawPictures
) -> dict[str, float]:
    """Measure a cycle of sprites: swing of the tail [body lengths], and closure of the loop.

    The result has three metrics by name. sequence: "straight" or "slide". Closure is the picture
    distance of the last frame, and of the one after it, from the first, over the cycle's median
    step. It is missing if the track ends there.
    """
    start, stop = choice.run.rows.start, choice.run.rows.stop
    tail = table["tail"].to_numpy()[start:stop]
    result = {f"{sequence}_tail_swing_body_lengths": float(np.ptp(tail))}
    if stop < len(table) and table["track_id"].iat[stop] == choice.run.track_id:
        headings = cycle_headings(table, start, stop - start)
        pictures = draw_pictures(np.arange(start, stop + 1), headings)
        median_step = max(float(np.median(successive_distances(pictures))), 1e-9)
        last = float(paired_distances(pictures[-2], pictures[0]))
        result[f"{sequence}_closure_last_to_first"] = last / median_step
        result[f"{sequence}_closure_after_last_to_first"] = measure_loop_closure(pictures)
    return result


def fault_table(choices: dict[str, ChosenFrames]) -> pd.DataFrame:
    """Return a table of what is wrong with the chosen frames: sequence, frames, fault, value.

    frames: as "track:first-last". A value of 1 is just acceptable.
    """
    rows = []
    for sequence, choice in choices.items():
        run = choice.run
        for name, value in (run.faults or {"listed by hand": 0.0}).items():
            rows.append((sequence, f"{run.track_id}:{run.first}-{run.last}", name, value))
    return pd.DataFrame(rows, columns=["sequence", "frames", "fault", "value"])
