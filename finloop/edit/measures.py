"""Measures of an edit list alone: what it shows, how smooth and how varied it is; also of the film.

A *step* is the Euclidean distance (Eq. 5) between two successive pictures, compared with the film's
own steps. A *seam* is the distance of a join, between the picture that would follow and the one
that does. Its *ratio* divides it by the median of the film's steps: 1 is as smooth as the film.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.base.arrays import Floats
from finloop.base.stretches import longest_repeated_run
from finloop.edit.schema import ENTER, FORECAST, FRAME, SPOT, STATES, TURN
from finloop.features.table import wrap_deg
from finloop.puppet import PoseShapes

FILM, POSED, MIRRORED, SPRITE_SHOWN, PREDICTED = SHOWN = (
    "film", "other pose", "mirror image", "sprite", "prediction",
)  # fmt: skip
"""What a tick shows: a frame as filmed, a frame bent into another pose, the mirror image of a frame
(bent or not), a sprite, a frame in a predicted pose (mirrored or not)."""


def picture_kinds(edit: pd.DataFrame) -> pd.Series:
    """Return what each tick of an edit list shows, (ticks,): a name of `SHOWN`."""
    frame = edit["kind"] == FRAME
    choices = [~frame, edit["state"] == STATES[FORECAST], edit["mirrored"], edit["pose"].notna()]
    names = [SPRITE_SHOWN, PREDICTED, MIRRORED, POSED]
    masks = [choice.to_numpy(bool) for choice in choices]  # the first that is True counts
    return pd.Series(np.select(masks, names, FILM), edit.index)


def picture_kind_shares(edit: pd.DataFrame) -> dict[str, float]:
    """Return the percentage of ticks that show each of `SHOWN`, and the number of switches.

    Keys: shown_<name>_pct; film_pct: frames, as filmed, bent or mirrored; stuck_pct: time on the
    spot, as no candidate stays in the tank, or to turn to the goal first; switches: between sprites
    and film; switches_without_gateway: those not through a gateway, a sprite and a frame that are
    alike.
    """
    names, is_frame = picture_kinds(edit), (edit["kind"] == FRAME).to_numpy()
    switched = np.append(False, is_frame[1:] != is_frame[:-1])
    by_gateway = edit["reason"].eq(ENTER).to_numpy() | edit["exit"].notna().to_numpy()
    by_gateway &= edit["seam"].notna().to_numpy()
    shares = {name: 100 * float((names == name).mean()) for name in SHOWN}
    return {
        **{f"shown_{name.replace(' ', '_')}_pct": share for name, share in shares.items()},
        "film_pct": 100 * float((~names.isin([SPRITE_SHOWN, PREDICTED])).mean()),
        "stuck_pct": 100 * float((edit["reason"].ffill() == SPOT).mean()),
        "switches": float(switched.sum()),
        "switches_without_gateway": float((switched & ~by_gateway).sum()),
    }


def motion_area_errors(edit: pd.DataFrame) -> dict[str, float]:
    """Return how far the sprites of turns are from the motion area that the network asked for.

    `turn_area_missed_median`: median difference between the requested area and that of the turn's
    most bent sprite, as a share of the film's largest. {} without such turns (Fig. 18).
    """
    # Only the first tick of a turn has both.
    missed = (edit["sprite_area"] - edit["motion_area"]).abs().dropna()
    return {} if missed.empty else {"turn_area_missed_median": float(missed.median())}


def average_measures(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Return the mean of each measure, by name, over the fish (rows) that have it."""
    return dict(rows[0]) if len(rows) == 1 else pd.DataFrame(rows).mean().to_dict()


def turn_measures(edit: pd.DataFrame) -> dict[str, float]:
    """Return, by name, the number of turns, and the percentages of good and of narrow turns.

    In a good turn the heading error, the angle between heading and direction to the aim, never
    rises. A narrow one has too little room. Without turns percentages are NaN.
    """
    turning = (edit["state"] == STATES[TURN]).to_numpy()
    is_first = edit["reason"].notna().to_numpy()  # tick of a stretch: only there a reason stands
    stretch = np.cumsum(is_first)
    right, up = edit["aim_x_px"] - edit["x_px"], edit["y_px"] - edit["aim_y_px"]
    bearing = np.degrees(np.arctan2(up, right))
    error_deg = np.abs(wrap_deg((bearing - edit["heading_deg"]).to_numpy(float)))
    is_worse = (stretch[1:] == stretch[:-1]) & turning[1:] & (np.diff(error_deg) > 1e-3)
    turns, bad_turns = np.unique(stretch[turning]), np.unique(stretch[1:][is_worse])
    narrow_share = (edit.loc[is_first & turning, "room"] < 1).mean() if len(turns) else np.nan
    return {
        "turns": float(len(turns)),
        "turns_monotone_pct": 100 * (1 - len(bad_turns) / len(turns)) if len(turns) else np.nan,
        "turns_with_little_room_pct": 100 * float(narrow_share),
    }


def step_measures(drawn: Floats, film: Floats) -> dict[str, float]:
    """Return how much an animation's picture changes per tick, compared with the film's.

    drawn, film: Euclidean distances (Eq. 5) between successive pictures. Results: median and 95th
    percentile over the film's median; percentages above the film's 95th and 99.5th percentile.
    """
    above = 100 * float((drawn > np.quantile(film, 0.995)).mean())
    return _ratios_to_film(drawn, film, "step", "steps") | {"steps_above_film_p995_pct": above}


def discontinuity_measures(seams: Floats, film: Floats) -> dict[str, float]:
    """Return the number of joins, and how visible they are compared with the film's steps.

    seams: Euclidean distances (Eq. 5) of joins, without cross-fade; film: those of its successive
    pictures. Results: median and 95th percentile over the film's median; percentage above the
    film's 95th. Without joins only their number, `jumps`.
    """
    if seams.size == 0:
        return {"jumps": 0.0}
    return {"jumps": float(seams.size)} | _ratios_to_film(seams, film, "seam", "jumps")


def _ratios_to_film(drawn: Floats, film: Floats, name: str, plural: str) -> dict[str, float]:
    """Return, by name, how large picture distances (k,) are, compared with the film's (l,).

    name, plural: of what is measured, in the names of the results.
    """
    film_median = float(np.median(film))
    return {
        f"{name}_ratio_median": float(np.median(drawn)) / film_median,
        f"{name}_ratio_p95": float(np.quantile(drawn, 0.95)) / film_median,
        f"{plural}_above_film_p95_pct": 100 * float((drawn > np.quantile(film, 0.95)).mean()),
    }


def pose_measures(edit: pd.DataFrame, shapes: PoseShapes) -> dict[str, float]:
    """Return the percentage of ticks in an unfilmed pose, and in a pose the film hardly shows.

    Keys: `posed_pct`, `poses_at_the_limit_pct`.
    """
    codes = [pose for pose in edit["pose"] if pose is not None]
    far_count = int(shapes.is_far_from_film(np.stack(codes).astype(float)).sum()) if codes else 0
    return {
        "posed_pct": 100 * len(codes) / len(edit),
        "poses_at_the_limit_pct": 100 * far_count / len(edit),
    }


def state_measures(edit: pd.DataFrame) -> dict[str, float]:
    """Return, as `<state>_pct`, the percentage of ticks in each of `STATES`, such as "turn"."""
    share = 100 * edit["state"].value_counts(normalize=True)
    return {f"{state}_pct": float(share.get(state, 0.0)) for state in STATES}


def longest_repeat(edit: pd.DataFrame) -> int:
    """Return the length in ticks of the longest run of pictures that is shown again later."""
    return longest_repeated_run(_number_pictures(edit))


def _number_pictures(edit: pd.DataFrame) -> NDArray[np.intp]:
    """Return a number (ticks,) for each picture of an edit list, equal for equal pictures.

    Pictures are equal if they show one frame or sprite, turned and bent or not.
    """
    names = ["kind", "source", "orientation", "mirrored"]
    return edit.groupby(names, dropna=False, sort=False).ngroup().to_numpy()


def rhythm_measures(
    edit: pd.DataFrame, jumps: NDArray[np.intp], rate_hz: float
) -> dict[str, float]:
    """Return how long one picture stays, how many film jumps there are, and how near in time.

    `longest_still_s`: longest time of one picture; `jumps_of_the_film`: number of jumps from frame
    to frame; `shortest_stay_s`: least time between two of them, NaN with fewer than two. jumps
    (k,): ticks of all transitions.
    """
    changes = np.diff(_number_pictures(edit)) != 0
    runs = np.diff(np.flatnonzero(np.r_[True, changes, True]))
    is_frame = (edit["kind"] == FRAME).to_numpy()
    film_jumps = jumps[is_frame[jumps] & is_frame[jumps - 1]]
    shortest = float(np.diff(film_jumps).min()) if len(film_jumps) > 1 else np.nan
    return {
        "longest_still_s": float(runs.max()) / rate_hz,
        "jumps_of_the_film": float(len(film_jumps)),
        "shortest_stay_s": shortest / rate_hz,
    }
