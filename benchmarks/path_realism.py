"""Whether a fish on a path is easier to distinguish from film than a wandering fish.

`python -m benchmarks.path_realism FOLDER …` takes working copies with a finished pipeline, one per
film (default: the present folder), and writes benchmarks/path_realism.csv: the area under the ROC
curve of the stage `realism`, for `realism.seconds` of each. Fish wander, swim the fourteen shapes
of `benchmarks.paths` at their own speed, and swim eighteen tracks of the film, without that part of
the film, at their own speed and at the track's times. The film's halves and the film drawn again
are there for comparison.
"""

import stages.run  # noqa: F401  # isort: skip  (sets the thread counts before numpy)

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.matching import MODE, matching_data, replace_settings, settings_without_path
from benchmarks.paths import count_ticks_on_path, longest_tracks, path_shapes
from benchmarks.pipeline import write_film_table
from finloop.animate.paths import lay_path
from finloop.animate.route import Route
from finloop.animate.shoal import animate_fish
from finloop.edit.build import build_edit_lists
from finloop.modes.matching import MatchingAnimator, MatchingData, matching_animator
from finloop.plan.matching_settings import AllSettings
from finloop.plan.planner import Planner
from finloop.project import Project
from finloop.realism import compare
from finloop.realism.examples import FILM
from finloop.realism.instrument import EditList, sample_film_lists
from stages.cluster import open_workers
from stages.realism import (
    WORKERS_NEED,
    GalleryOpener,
    build_instrument,
    classify_all,
    measure_swimming,
)
from stages.settings import load_settings

PIECE_S = 20.0
"""Longest duration of an animation."""
TRACKS = 18


class Swimming(NamedTuple):
    """The animator of a fish, and its path."""

    plans: MatchingAnimator
    route: Route | None


def animate_route(planner: Planner, ticks: int, seed: int, route: Route | None = None) -> EditList:
    """Animate a fish along a route until its end, or wandering without a route."""
    record = animate_fish(planner, [], ticks, np.random.default_rng(seed), route)
    if route is not None:
        ticks = min(ticks, count_ticks_on_path(record))
    return EditList(build_edit_lists([record], ticks, planner.edit_inputs))


def routes_by_motion(
    film_data: MatchingData, animator: MatchingAnimator, settings: AllSettings
) -> dict[str, list[Swimming]]:
    """Return routes and animators by kind of motion; those of a track omit its film."""
    world = animator.world
    routes: dict[str, list[Swimming]] = {
        "wandering": [Swimming(animator, None)],
        "shapes, own pace": [
            Swimming(animator, lay_path(line, world.tank, world.motion, None).route)
            for _, line in path_shapes(animator, np.random.default_rng(0))
        ],
        "tracks, own pace": [],
        "tracks, with times": [],
    }
    for _, line in longest_tracks(film_data, animator, TRACKS):
        animator_without = matching_animator(film_data._replace(lines=[line]), settings)
        for name, route_line in (
            ("tracks, own pace", line._replace(time_s=None, heading_deg=None)),
            ("tracks, with times", line),
        ):
            route = lay_path(route_line, world.tank, world.motion, None).route
            routes[name].append(Swimming(animator_without, route))
    return routes


def animations_by_motion(
    routes: dict[str, list[Swimming]], seconds: float
) -> dict[str, list[EditList]]:
    """Return the animations to compare, by kind of motion."""
    plans = routes["wandering"][0].plans
    rate = plans.world.motion.rate_hz
    edit_lists: dict[str, list[EditList]] = {}
    for name, swimmings in routes.items():
        animations = edit_lists.setdefault(f"{MODE}, {name}", [])
        left_ticks, seed = seconds * rate, 0
        while left_ticks > rate:
            swimming_animator, route = swimmings[seed % len(swimmings)]
            edit_list = animate_route(
                swimming_animator.player, round(min(left_ticks, PIECE_S * rate)), seed, route
            )
            animations.append(edit_list)
            left_ticks, seed = left_ticks - len(edit_list.edit), seed + 1
    return edit_lists


def film_rows(film_name: str) -> Iterator[dict[str, object]]:
    """Yield all comparisons for the film in the present folder."""
    p = load_settings("realism")
    q = replace_settings(settings_without_path(), path_own_frames=False)
    project = Project()
    rate, features = project.rate_hz, project.features
    edit_lists = {
        FILM: sample_film_lists(features, round(q.seconds * rate), round(p.seconds * rate), p.seed)
    }
    amount = min(p.seconds, sum(len(edit) for edit, _ in edit_lists[FILM]) / rate)
    with project, open_workers(WORKERS_NEED) as pool:
        film_data = matching_data(project, q)
        animator = matching_animator(film_data, q)
        size = animator.pictures.reel.scale
        edit_lists |= animations_by_motion(routes_by_motion(film_data, animator, q), amount)
        pictures, instrument = GalleryOpener(project), build_instrument(project)
        drawn = instrument.adapt_to_animation(size)
        instruments = {name: instrument if name == FILM else drawn for name in edit_lists}
        measured = measure_swimming(edit_lists, pictures, instruments, pool)
        sample = compare.build_film_sample(measured[FILM], features, rate, p)
        sides = sample.comparison_windows(
            {k: v for k, v in measured.items() if k != FILM}, features
        )
        table = compare.verdict_table(classify_all(sides, p, pool))
    for row in table.to_dict("records"):
        yield {"film": film_name, **{str(key): value for key, value in row.items()}}


if __name__ == "__main__":
    write_film_table(__file__, film_rows)
