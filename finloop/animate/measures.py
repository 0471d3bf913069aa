"""How good an animation is: goals, kinematics, smoothness, variety; and the same for the film.

A *step* is the Euclidean distance (Eq. 5) between two successive pictures, compared with the film's
own steps. A *jump* i → j shows after frame i another one than the film's next. Its *seam ratio* is
D(i + 1, j) over the median of the film's steps: 1 is as smooth as the film.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd

from finloop.animate.arena import are_points_inside
from finloop.animate.motion import MotionStatistics
from finloop.animate.protocols import AnyPlayer
from finloop.animate.world import World
from finloop.base.arrays import Floats
from finloop.base.distributions import wasserstein_distance
from finloop.base.schema import Column, Schema
from finloop.edit.measures import (
    motion_area_errors,
    picture_kind_shares,
    step_measures,
    turn_measures,
)
from finloop.edit.schema import FRAME, Goal
from finloop.features.current import places_through_water
from finloop.features.table import wrap_deg

FILM_MOTION = "film"
KINEMATICS = Schema(
    Column("mode", "string", "1"),
    Column("speed", "float64", "body lengths/s"),
    Column("turn_rate", "float64", "deg/s"),
)
"""How the film (mode FILM_MOTION) and each mode's fish move, a row a tick; both over Δ."""

_ROUNDED_PX = 2.0  # the centre and the outline of a fish are rounded to pixels


def measure_without_pictures(
    edit: pd.DataFrame, goals: Sequence[Goal], player: AnyPlayer, film_motion: tuple[Floats, Floats]
) -> dict[str, float]:
    """Return, by name, all measures of one fish's edit list that need no picture.

    They are about goals, kinematics, turns, kinds of picture, motion areas, and `frames_outside`:
    the ticks outside the arena. film_motion: speed and turn rate of the film, from
    `motion_of_film`.
    """
    return {
        **(measure_goals(edit, goals, player.world) if goals else {}),
        **kinematic_distances(motion_of_edit(edit, player), film_motion),
        **turn_measures(edit),
        **picture_kind_shares(edit),
        **motion_area_errors(edit),
        "frames_outside": count_ticks_outside(edit, player),
    }


def arrival_ticks(
    edit: pd.DataFrame, goals: Sequence[Goal], touch_px: float, head_px: float
) -> Floats:
    """Return the first tick (goals,) at which a fish touches each goal in turn; NaN if it does not.

    A goal counts from the tick at which the one before is touched. Head or centre comes within
    `touch_px` of the goal; head_px: distance of the head from the centre.
    """
    x, y = edit["x_px"].to_numpy(), edit["y_px"].to_numpy()
    angle = np.radians(edit["heading_deg"].to_numpy(float))
    head_x, head_y = x + head_px * np.cos(angle), y - head_px * np.sin(angle)
    ticks = np.full(len(goals), np.nan)
    search_from = 0
    for i, goal in enumerate(goals):
        distance = np.minimum(
            np.hypot(x - goal.x_px, y - goal.y_px), np.hypot(head_x - goal.x_px, head_y - goal.y_px)
        )
        # An edit list is rounded on disk, hence the tolerance.
        touching = np.flatnonzero(distance[search_from:] <= touch_px + 0.01)
        if touching.size == 0:
            break
        search_from += int(touching[0])
        ticks[i] = search_from
    return ticks


def measure_goals(edit: pd.DataFrame, goals: Sequence[Goal], world: World) -> dict[str, float]:
    """Return, by name, how well a fish reached its goals: share, time, path, heading.

    `path_error_rms_body_lengths`: distance from the straight lines between goals; `straightness`:
    straight distance / distance covered; `arrival_heading_error_deg`: mean angle between the
    heading at a goal and the straight line there.
    """
    ticks, motion = arrival_ticks(edit, goals, world.touch_px, world.head_px), world.motion
    reached = np.flatnonzero(~np.isnan(ticks))
    measures = {"goals": float(len(goals)), "goals_reached_pct": 100 * len(reached) / len(goals)}
    if reached.size == 0:
        return measures
    place = edit[["x_px", "y_px"]].to_numpy()
    heading = edit["heading_deg"].to_numpy(float)
    arrivals = np.concatenate([[0], ticks[reached]]).astype(int)  # a leg ends where the next begins
    offsets_px, heading_errors_deg, straight_px, covered_px = [], [], 0.0, 0.0
    start = place[0]  # of the straight line to the goal; later the goal before
    for i, (first, last) in enumerate(pairwise(arrivals)):
        goal = np.array([goals[i].x_px, goals[i].y_px])
        leg = place[first : last + 1]
        offsets_px.append(_distances_from_segment(leg, start, goal))
        straight_px += float(np.hypot(*(leg[-1] - leg[0])))
        covered_px += float(np.hypot(*np.diff(leg, axis=0).T).sum())
        direction = np.degrees(np.arctan2(start[1] - goal[1], goal[0] - start[0]))
        heading_errors_deg.append(abs(float(wrap_deg(heading[last] - direction))))
        start = goal
    offsets = np.concatenate(offsets_px) / motion.body_length_px
    return measures | {
        "time_to_goal_median_s": float(np.median(np.diff(arrivals)) / motion.rate_hz),
        "path_error_rms_body_lengths": float(np.sqrt((offsets**2).mean())),
        "straightness": straight_px / covered_px if covered_px > 0 else np.nan,
        "arrival_heading_error_deg": float(np.mean(heading_errors_deg)),
    }


def _distances_from_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance (n,) of points (n, 2) from a straight segment, start and end (2,)."""
    segment = end - start
    share = np.clip((points - start) @ segment / max(float(segment @ segment), 1e-12), 0.0, 1.0)
    return np.hypot(*(points - start - share[:, None] * segment).T)


def kinematics_table(motions: Mapping[str, tuple[Floats, Floats]]) -> pd.DataFrame:
    """Return the table `KINEMATICS` of speeds and turn rates, a row a tick.

    motions: by name of the mode, speeds [body lengths/s] and turn rates [°/s], (k,) each.
    """
    parts = [
        pd.DataFrame({"mode": mode, "speed": speed, "turn_rate": rate})
        for mode, (speed, rate) in motions.items()
    ]
    return pd.concat(parts, ignore_index=True)


def motion_of_edit(edit: pd.DataFrame, player: AnyPlayer) -> tuple[Floats, Floats]:
    """Return speed [body lengths/s] and turn rate [°/s], (ticks − Δ,) each, over Δ (Eq. 3).

    edit: of one fish. The film's heading is that of the head, so for sprites, which sway, the drawn
    head's heading is taken.
    """
    head = edit["heading_deg"].to_numpy(float, copy=True)
    is_sprite = (edit["kind"] != FRAME).to_numpy()
    if is_sprite.any():
        number = np.where(is_sprite, edit["source"], 0)
        head += player.silhouettes.sprites["head_offset_deg"].to_numpy(float)[number] * is_sprite
    motion = player.world.motion
    place = edit[["x_px", "y_px"]].to_numpy() / motion.body_length_px
    return _motion_over_delta(place, head, motion)


def motion_of_film(features: pd.DataFrame, motion: MotionStatistics) -> tuple[Floats, Floats]:
    """Return speed [body lengths/s] and turn rate [°/s], (k,) each, of all tracks, over Δ.

    Tracks that are no longer than Δ are left out. A turn to the left is positive.
    """
    length = motion.body_length_px / motion.size  # as filmed, not as drawn
    parts = [
        _motion_over_delta(
            places_through_water(track) / length, track["heading_deg"].to_numpy(float), motion
        )
        for _, track in features.groupby("track_id")
        if len(track) > motion.delta
    ]
    speed, rate = np.concatenate([np.zeros((2, 0)), *parts], axis=1)
    return speed, rate


def _motion_over_delta(
    places: Floats, headings_deg: Floats, motion: MotionStatistics
) -> tuple[Floats, Floats]:
    """Return speed [BL/s] and turn rate [°/s], (n − Δ,), over Δ, from places (n, 2) [BL].

    headings_deg (n,): with or without jumps of 360. A turn to the left is positive.
    """
    delta, seconds = motion.delta, motion.delta / motion.rate_hz
    distances = np.hypot(*(places[delta:] - places[:-delta]).T)
    heading = np.unwrap(headings_deg, period=360)
    turns = heading[delta:] - heading[:-delta]
    return distances / seconds, turns / seconds


def kinematic_distance(
    values: Floats, film_values: Floats, scale_values: Floats | None = None
) -> float:
    """Return the Wasserstein distance of samples (k,), (l,), in standard deviations of the film.

    values (k,): of an animation; film_values (l,): of the film, in the same unit. scale_values: the
    sample whose standard deviation is the unit, by default `film_values`.
    """
    sd = (film_values if scale_values is None else scale_values).std()
    return wasserstein_distance(values, film_values) / float(sd)


def kinematic_distances(
    motion: tuple[Floats, Floats], film_motion: tuple[Floats, Floats]
) -> dict[str, float]:
    """Return the kinematic distances of speed and of turn rate, `<name>_kinematic_distance_sd`.

    motion, film_motion: speeds and turn rates, (k,) and (l,) each, of the animation and of the
    film.
    """
    return {
        f"{name}_kinematic_distance_sd": kinematic_distance(values, film_values)
        for name, values, film_values in zip(
            ("speed", "turn_rate"), motion, film_motion, strict=True
        )
    }


def count_ticks_outside(edit: pd.DataFrame, player: AnyPlayer) -> int:
    """Return the number of ticks at which any point of the drawn fish is outside the arena."""
    count, tank = 0, player.world.tank
    angle = np.radians(edit["heading_deg"].to_numpy(float))
    x, y = edit["x_px"].to_numpy(), edit["y_px"].to_numpy()
    wall_px = np.zeros(len(edit))  # from each place to the nearest wall, 0 outside the picture
    in_picture = are_points_inside(np.ones_like(tank.arena), x, y)
    row, column = (np.round(axis[in_picture]).astype(int) for axis in (y, x))
    wall_px[in_picture] = tank.depth_px[row, column]
    pictures = edit.groupby(["kind", "source", "mirrored"]).indices
    for (kind, source, mirrored), shown in pictures.items():
        ahead, left = player.silhouettes.outline(str(kind), int(source)).T
        left = -left if mirrored else left
        # Only ticks at which the outline can reach the wall need a test.
        ticks = shown[wall_px[shown] <= np.hypot(ahead, left).max() + _ROUNDED_PX]
        if not len(ticks):
            continue
        cos, sin = np.cos(angle[ticks, None]), np.sin(angle[ticks, None])
        outline_x = x[ticks, None] + ahead * cos - left * sin
        outline_y = y[ticks, None] - ahead * sin - left * cos
        inside = are_points_inside(tank.arena, outline_x, outline_y)
        count += int((~inside.all(1)).sum())
    return count


def measure_film(
    features: pd.DataFrame, film_motion: tuple[Floats, Floats], steps: Floats,
    motion: MotionStatistics,
) -> dict[str, float]:  # fmt: skip
    """Return, by name, the film's own measures, with which an animation is compared.

    film_motion: speed and turn rate, from `motion_of_film`; steps: Euclidean distances (Eq. 5)
    between successive frames. A film has no goals and no jumps. Its kinematic distances are those
    between its two halves, as two films of one fish differ by about as much; they are left out if
    a half has no track longer than Δ.
    """
    half = features["frame"].median()
    early, late = (
        motion_of_film(part, motion)
        for part in (features[features["frame"] <= half], features[features["frame"] > half])
    )
    halves = {}
    for name, first_half, second_half, whole in zip(
        ("speed", "turn_rate"), early, late, film_motion, strict=True
    ):
        if first_half.size and second_half.size:
            distance = kinematic_distance(first_half, second_half, scale_values=whole)
            halves[f"{name}_halves_kinematic_distance_sd"] = distance
    return {
        **halves,
        "speed_median_body_lengths_s": float(np.median(film_motion[0])),
        "turn_rate_sd_deg_s": float(film_motion[1].std()),
        **step_measures(drawn=steps, film=steps),
    }
