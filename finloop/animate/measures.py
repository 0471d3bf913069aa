"""How good an animation is: goals, kinematics, smoothness, variety; and the same of the film.

A *step* is the distance (Eq. 5) between two successive pictures; the film's own steps are the
measure. A *jump* i → j shows after frame i another one than the film's next. Its *seam ratio* is
D(i + 1, j) over the median of the film's steps: 1 = as smooth as the film.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from finloop.animate.motion import Motion
from finloop.animate.state import Waters
from finloop.animate.swim import Player
from finloop.base.arrays import Floats
from finloop.base.schema import Column, Schema
from finloop.edit.schema import FILM, FRAME, LOOPS, STATES, TURN, Goal
from finloop.features.current import through_water
from finloop.features.table import wrap_deg
from finloop.puppet import PoseShapes

FILM_MOTION = "film"
KINEMATICS = Schema(
    Column("mode", "string", "1"),
    Column("speed", "float64", "body lengths/s"),
    Column("turn_rate", "float64", "deg/s"),
)
"""How the film (mode FILM_MOTION) and each mode's fish move, a row a tick; both over Δ."""

_ROUNDED_PX = 2.0  # the centre and the outline of a fish are rounded to pixels


def averaged(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Measures of several fish on average, each of those that have it."""
    return dict(rows[0]) if len(rows) == 1 else pd.DataFrame(rows).mean().to_dict()


def of_plan(
    edit: pd.DataFrame, goals: Sequence[Goal], player: Player, film: tuple[Floats, Floats]
) -> dict[str, float]:
    """All measures of one fish that need no picture. film: of `motion_of_film`."""
    return {
        **(of_goals(edit, goals, player.waters) if goals else {}),
        **of_kinematics(motion_of_edit(edit, player), film),
        **of_turns(edit),
        "frames_outside": outside(edit, player),
        "film_pct": 100 * float((edit["mode"] == LOOPS).mean()),
    }


def reached(edit: pd.DataFrame, goals: Sequence[Goal], touch_px: float, head_px: float) -> Floats:
    """The tick at which the head or the centre first comes within `touch_px` of each goal in turn.

    NaN where it does not.
    """
    x, y = edit["x_px"].to_numpy(), edit["y_px"].to_numpy()
    angle = np.radians(edit["heading_deg"].to_numpy(float))
    head_x, head_y = x + head_px * np.cos(angle), y - head_px * np.sin(angle)
    ticks = np.full(len(goals), np.nan)
    since = 0
    for i, goal in enumerate(goals):
        apart = np.minimum(
            np.hypot(x - goal.x_px, y - goal.y_px), np.hypot(head_x - goal.x_px, head_y - goal.y_px)
        )
        # An edit list is rounded on disk, hence the hair's breadth.
        there = np.flatnonzero(apart[since:] <= touch_px + 0.01)
        if there.size == 0:
            break
        since += int(there[0])
        ticks[i] = since
    return ticks


def of_goals(edit: pd.DataFrame, goals: Sequence[Goal], waters: Waters) -> dict[str, float]:
    """Goals reached, time, path error against the straight ways from goal to goal, straightness."""
    ticks, motion = reached(edit, goals, waters.touch_px, waters.head_px), waters.motion
    done = np.flatnonzero(~np.isnan(ticks))
    measures = {"goals": float(len(goals)), "goals_reached_pct": 100 * len(done) / len(goals)}
    if done.size == 0:
        return measures
    place = edit[["x_px", "y_px"]].to_numpy()
    ends = np.concatenate([[0], ticks[done]]).astype(int)
    errors, asked, swum = [], 0.0, 0.0
    start = place[0]
    for i, (a, b) in enumerate(pairwise(ends)):
        goal = np.array(goals[i][1:3])
        leg = place[a : b + 1]
        errors.append(_off_segment(leg, start, goal))
        asked += float(np.hypot(*(place[b] - place[a])))
        swum += float(np.hypot(*np.diff(leg, axis=0).T).sum())
        start = goal
    off = np.concatenate(errors) / motion.body_length_px
    return measures | {
        "time_to_goal_median_s": float(np.median(np.diff(ends)) / motion.rate_hz),
        "path_error_rms_body_lengths": float(np.sqrt((off**2).mean())),
        "straightness": asked / swum if swum > 0 else np.nan,
    }


def _off_segment(points: Floats, a: Floats, b: Floats) -> Floats:
    """Distance (n,) of points (n, 2) from the segment between a and b."""
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return np.hypot(*(points - a - share[:, None] * along).T)


def kinematics(motions: Mapping[str, tuple[Floats, Floats]]) -> pd.DataFrame:
    """The table of `KINEMATICS`, of `motion_of_film` and `motion_of_edit` by name."""
    parts = [
        pd.DataFrame({"mode": mode, "speed": speed, "turn_rate": rate})
        for mode, (speed, rate) in motions.items()
    ]
    return pd.concat(parts, ignore_index=True)


def motion_of_edit(edit: pd.DataFrame, player: Player) -> tuple[Floats, Floats]:
    """Speed [body lengths/s] and turn rate [°/s] of one fish, both over Δ as the film's (Eq. 3).

    The film's heading is that of the head, so the drawn head's is taken: the sprites sway.
    """
    sprite = (edit["kind"] != FRAME).to_numpy()
    number = np.where(sprite, edit["source"], 0)
    sway = player.cast.sprites["head_offset_deg"].to_numpy(float)[number] * sprite
    head = edit["heading_deg"].to_numpy(float) + sway
    motion = player.waters.motion
    place = edit[["x_px", "y_px"]].to_numpy() / motion.body_length_px
    return _over_delta(place, head, motion)


def motion_of_film(features: pd.DataFrame, motion: Motion) -> tuple[Floats, Floats]:
    """The same of every track of the film."""
    length = motion.body_length_px / motion.size
    parts = [
        _over_delta(through_water(track) / length, track["heading_deg"].to_numpy(float), motion)
        for _, track in features.groupby("track_id")
        if len(track) > motion.delta
    ]
    speed, rate = np.concatenate([np.zeros((2, 0)), *parts], axis=1)
    return speed, rate


def _over_delta(place: Floats, heading_deg: Floats, motion: Motion) -> tuple[Floats, Floats]:
    """place (n, 2): in body lengths."""
    delta, seconds = motion.delta, motion.delta / motion.rate_hz
    moved = np.hypot(*(place[delta:] - place[:-delta]).T)
    heading = np.unwrap(heading_deg, period=360)
    turned = heading[delta:] - heading[:-delta]
    return moved / seconds, turned / seconds


def kinematic_distance(mine: Floats, film: Floats, whole: Floats | None = None) -> float:
    """Wasserstein distance of two samples, in standard deviations of the film's or the whole's."""
    sd = (film if whole is None else whole).std()
    return float(scipy.stats.wasserstein_distance(mine, film) / sd)


def of_kinematics(mine: tuple[Floats, Floats], film: tuple[Floats, Floats]) -> dict[str, float]:
    """Kinematic distance of speed and of turn rate."""
    return {
        f"{name}_kinematic_distance_sd": kinematic_distance(*pair)
        for name, *pair in zip(("speed", "turn_rate"), mine, film, strict=True)
    }


def outside(edit: pd.DataFrame, player: Player) -> int:
    """Ticks at which any point of the drawn fish is outside the arena."""
    count, tank = 0, player.waters.tank
    height, width = tank.arena.shape
    angle = np.radians(edit["heading_deg"].to_numpy(float))
    x, y = edit["x_px"].to_numpy(), edit["y_px"].to_numpy()
    column, row = np.round(x).astype(int), np.round(y).astype(int)
    there = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    depth = np.where(there, tank.depth_px[row * there, column * there], 0.0)
    pictures = edit.groupby(["kind", "source", "mirrored"]).indices
    for (kind, source, mirrored), shown in pictures.items():
        ahead, left = player.hull(str(kind), int(source)).T * [[1], [-1 if mirrored else 1]]
        ticks = shown[depth[shown] <= np.hypot(ahead, left).max() + _ROUNDED_PX]
        if not len(ticks):
            continue
        cos, sin = np.cos(angle[ticks, None]), np.sin(angle[ticks, None])
        column = np.round(x[ticks, None] + ahead * cos - left * sin).astype(int)
        row = np.round(y[ticks, None] - ahead * sin - left * cos).astype(int)
        there = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        there[there] = tank.arena[row[there], column[there]]
        count += int((~there.all(1)).sum())
    return count


def of_turns(edit: pd.DataFrame) -> dict[str, float]:
    """Whether the error of the heading against the aim falls at every tick of every turn."""
    turning = (edit["state"] == STATES[TURN]).to_numpy()
    begins = edit["reason"].notna().to_numpy()
    number = np.cumsum(begins)
    bearing = np.degrees(
        np.arctan2(edit["y_px"] - edit["aim_y_px"], edit["aim_x_px"] - edit["x_px"])
    )
    error = np.abs(wrap_deg((bearing - edit["heading_deg"]).to_numpy(float)))
    same = (number[1:] == number[:-1]) & turning[1:]
    rises = same & (np.diff(error) > 1e-3)
    turns = np.unique(number[turning])
    bad = np.unique(number[1:][rises])
    return {
        "turns": float(len(turns)),
        "turns_monotone_pct": 100 * (1 - len(bad) / len(turns)) if len(turns) else np.nan,
        "turns_with_little_room_pct": 100
        * float((edit.loc[begins & turning, "room"] < 1).mean() if len(turns) else np.nan),
    }


def of_steps(mine: Floats, film: Floats) -> dict[str, float]:
    """Steps between drawn pictures against the film's own."""
    above = 100 * float((mine > np.quantile(film, 0.995)).mean())
    return _against(film, "step", mine, "steps") | {"steps_above_film_p995_pct": above}


def of_seams(seams: Floats, film: Floats) -> dict[str, float]:
    """Seam ratios of joins, as drawn, without any cross-fade."""
    if seams.size == 0:
        return {"jumps": 0.0}
    return {"jumps": float(seams.size)} | _against(film, "seam", seams, "jumps")


def _against(film: Floats, name: str, mine: Floats, all_of_them: str) -> dict[str, float]:
    middle = float(np.median(film))
    return {
        f"{name}_ratio_median": float(np.median(mine)) / middle,
        f"{name}_ratio_p95": float(np.quantile(mine, 0.95)) / middle,
        f"{all_of_them}_above_film_p95_pct": 100 * float((mine > np.quantile(film, 0.95)).mean()),
    }


def of_poses(edit: pd.DataFrame, shapes: PoseShapes) -> dict[str, float]:
    """Ticks drawn in another pose than filmed; those whose pose the film hardly shows."""
    codes = [pose for pose in edit["pose"] if pose is not None]
    far = int(shapes.far(np.stack(codes).astype(float)).sum()) if codes else 0
    return {
        "posed_pct": 100 * len(codes) / len(edit),
        "poses_at_the_limit_pct": 100 * far / len(edit),
    }


def of_states(edit: pd.DataFrame) -> dict[str, float]:
    """Share of time in each state."""
    share = 100 * edit["state"].value_counts(normalize=True)
    return {f"{state}_pct": float(share.get(state, 0.0)) for state in STATES}


def longest_repeat(edit: pd.DataFrame) -> int:
    """The longest run of pictures that comes twice, the second after the first, in ticks."""
    pictures, longest = _pictures(edit), 0
    for lag in range(1, len(pictures)):
        if len(pictures) - lag <= longest:
            break
        equal = np.concatenate([[False], pictures[lag:] == pictures[:-lag], [False]])
        edges = np.flatnonzero(np.diff(equal.astype(np.int8)))
        if edges.size:
            longest = max(longest, min(lag, int((edges[1::2] - edges[::2]).max())))
    return longest


def _pictures(edit: pd.DataFrame) -> NDArray[np.intp]:
    """A number (ticks,) for each picture that an edit list names, the same for the same."""
    names = ["kind", "source", "orientation", "mirrored"]
    return edit.groupby(names, dropna=False, sort=False).ngroup().to_numpy()


def film_states(features: pd.DataFrame, motion: Motion) -> dict[str, float]:
    """Share of time the film's fish spend in each state."""
    phases = motion.phases
    straight = np.bincount(phases.state, weights=phases.ticks, minlength=TURN)[:TURN]
    turning = float((features["swimming_type"] != 0).mean())
    share = np.append(straight / straight.sum() * (1 - turning), turning)
    return {
        f"{state}_pct": 100 * float(part) for state, part in zip(STATES[:FILM], share, strict=True)
    }


def of_rhythm(edit: pd.DataFrame, jumps: NDArray[np.intp], rate_hz: float) -> dict[str, float]:
    """Freezing and flickering: the longest time one picture stays, the shortest between two jumps.

    jumps: ticks at which the picture does not follow; only those from frame to frame count.
    """
    changes = np.diff(_pictures(edit)) != 0
    runs = np.diff(np.flatnonzero(np.r_[True, changes, True]))
    frame = (edit["kind"] == FRAME).to_numpy()
    across = jumps[frame[jumps] & frame[jumps - 1]]
    return {
        "longest_still_s": float(runs.max()) / rate_hz,
        "jumps_of_the_film": float(len(across)),
        "shortest_stay_s": float(np.diff(across).min()) / rate_hz if len(across) > 1 else np.nan,
    }


def table(modes: Mapping[str, Mapping[str, float]], film: Mapping[str, float]) -> pd.DataFrame:
    """All measures side by side: a row each, a column per mode and one of the film itself."""
    return pd.DataFrame({**modes, "film": film}).rename_axis("measure").reset_index()


def of_film(
    features: pd.DataFrame, swum: tuple[Floats, Floats], steps: Floats, motion: Motion
) -> dict[str, float]:
    """The film by its own measures: the line that an animation is held against.

    A film has no goals and no jumps. Its kinematic distance is that of its first half from its
    second, about as near as another film of the same fish would come.
    """
    half = features["frame"].median()
    early, late = (
        motion_of_film(part, motion)
        for part in (features[features["frame"] <= half], features[features["frame"] > half])
    )
    halves = {
        f"{name}_halves_kinematic_distance_sd": kinematic_distance(*each)
        for name, *each in zip(("speed", "turn_rate"), early, late, swum, strict=True)
        if all(part.size for part in each)
    }
    return {
        **halves,
        "speed_median_body_lengths_s": float(np.median(swum[0])),
        "turn_rate_sd_deg_s": float(swum[1].std()),
        **of_steps(steps, steps),
        **film_states(features, motion),
    }
