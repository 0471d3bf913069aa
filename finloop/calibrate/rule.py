"""The rule by which a film's fish swim together, and simulated point fish that swim by it.

Speeds, turns and chance come from the film, and so does the behaviour near a wall. The zones add
the response to other fish. A step that leaves the tank is not taken.
"""

import numpy as np
import pandas as pd

from finloop.base.arrays import Complex, Ints
from finloop.calibrate.film import LEAST, FilmGroup
from finloop.calibrate.fit import ZoneFit, default_zones, fit_zones
from finloop.calibrate.settings import CalibrateSettings
from finloop.social.measures import measure_group
from finloop.social.neighbours import all_neighbours
from finloop.social.rule import SchoolRule, SocialSteps
from finloop.social.zones import Zones, pull_of_others

_BURN_IN = 0.1  # share of the steps until the first places are forgotten


def fit_school_rule(
    film: FilmGroup, settings: CalibrateSettings
) -> tuple[SchoolRule, ZoneFit | None]:
    """Return the rule by which a film's fish swim together, and the fit of its zones.

    The fit is None if the film shows too few fish together; then the zones are the given ones, else
    Couzin's.
    """
    fit = None if explain_missing_fit(film) else fit_zones(film, settings)
    zones = fit.zones if fit else default_zones(settings)
    steps = measure_steps_without_others(film, film.rows_with_whole_steps(settings.rows), zones)
    return SchoolRule(zones, steps, film.horizon_frames, settings.similar_steps), fit


def explain_missing_fit(film: FilmGroup) -> str:
    """Return a sentence on why zones cannot be fitted to a film; "" if they can."""
    first, second = (len(film.rows_for_fit(half, len(film.frame))) for half in (True, False))
    has_steps = len(film.rows_with_whole_steps(1)) > 0
    if min(first, second) >= LEAST and has_steps:
        return ""
    lack = (
        "the halves of the film show a fish with others, and again "
        f"{film.horizon_frames} frames later, {first} and {second} times; a fit takes {LEAST} "
        "each, so the zones are those of Couzin et al. (2002), or of the parameters"
    )
    if has_steps:
        return lack
    return f"{lack}; no track has three consecutive frames, so no fish can swim by them"


def measure_steps_without_others(film: FilmGroup, rows: Ints, zones: Zones) -> SocialSteps:
    """Return the steps of a film's fish in some rows (k,), without the effect of other fish.

    rows: from `rows_with_whole_steps`. Least squares give how far a pull of 1 moves a fish, and how
    much it turns it; the fish's own direction counts as a pull of 1 straight on. The effect of the
    others' pulls is subtracted from each step.
    """
    pulls, heading = pull_of_others(film.visible_neighbours(rows), zones), film.heading[rows]
    move = (film.place[film.later[rows]] - film.place[rows]) * heading.conj()
    before = (film.place[rows] - film.place[film.earlier[rows]]) * heading.conj()
    turn = film.relative_headings(rows)
    whole_pulls = 1 + pulls
    move_per_pull = _fit_factor(move, whole_pulls)
    turn_per_pull = _fit_factor(turn, whole_pulls)
    return SocialSteps(
        wall=film.walls.vectors_from_wall(film.place[rows], heading), last=before,
        move=move - move_per_pull * pulls, turn=turn - turn_per_pull * pulls,
        move_per_pull=move_per_pull, turn_per_pull=turn_per_pull,
    )  # fmt: skip


def _fit_factor(vectors: Complex, references: Complex) -> float:
    """Return the factor a ≥ 0 that minimises |vectors − a · references|², (n,) each.

    It is 0 if all references are 0, or there are none.
    """
    squares = float((np.abs(references) ** 2).sum())
    if not squares > 0:
        return 0.0
    return max(0.0, float((vectors * references.conj()).real.sum()) / squares)


def simulate_point_fish(
    film: FilmGroup, steps: SocialSteps, zones: Zones, settings: CalibrateSettings,
    rng: np.random.Generator,
) -> pd.DataFrame:  # fmt: skip
    """Simulate point fish that swim by the film's steps and zones; return measures by frame.

    There are as many as the film typically shows in a frame. The table has `settings.steps` frames
    and the columns of `SCHOOL`, after a time in which the fish forget their random start.
    """
    fish, frames, walls = film.typical_fish_count, settings.steps, film.walls
    place = film.place[rng.choice(len(film.place), fish, replace=len(film.place) < fish)]
    heading, last = np.exp(2j * np.pi * rng.random(fish)), np.zeros(fish, complex)
    burn_in, every_fish = round(_BURN_IN * frames), np.arange(fish)
    places, headings = np.empty((2, frames, fish), complex)
    for number in range(burn_in + frames):
        pulls = pull_of_others(all_neighbours(place, heading), zones)
        # Each fish draws some steps of the film that began alike: (fish, steps).
        moves, turns = steps.sample_similar_steps(
            walls.vectors_from_wall(place, heading),
            last * heading.conj(),
            settings.similar_steps,
            rng,
        )
        offsets = heading * (moves.T + steps.move_per_pull * pulls)
        inside = walls.is_inside(place + offsets)
        chosen = inside.argmax(axis=0)  # the first move inside the tank; without one a fish stays
        target = np.where(inside.any(axis=0), place + offsets[chosen, every_fish], place)
        heading = heading * steps.turn_by_pulls(turns[every_fish, chosen], pulls)
        last, place = target - place, target
        if number >= burn_in:
            places[number - burn_in], headings[number - burn_in] = place, heading
    places_px = np.stack([places.real, -places.imag], axis=-1).reshape(-1, 2) * walls.length
    frame = np.repeat(np.arange(frames), fish)
    return measure_group(frame, places_px, np.degrees(np.angle(headings)).ravel(), walls)
