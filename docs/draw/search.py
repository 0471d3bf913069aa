"""A picture of one decision of mode `matching`: the candidates, and the path taken."""

from contextlib import chdir
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from docs.draw.film import Picture
from finloop.animate.kinematics import rotate
from finloop.animate.places import random_goals
from finloop.animate.state import State
from finloop.base.arrays import Floats
from finloop.edit.schema import Goal
from finloop.plan.plan import CandidateVerdicts
from finloop.plan.planner import Planner
from finloop.project import Project
from stages.modes.matching import open_mode

WAY_S, TAKEN_S = 2.0, 3.0  # durations of a candidate's path and of the path taken
TRIES, WAYS = 400, 12  # most decisions tried; least candidates of a decision
SIZE = (9.0, 6.4)  # inches of 100 px


def search_picture(folder: Path) -> Picture:
    """Return the picture for the run in a folder."""
    with chdir(folder), Project() as project:
        planner, background = open_mode(project).player, project.background
    state, goal, options, taken = _decision(planner)
    figure = Figure(figsize=SIZE, dpi=100, layout="constrained")
    axes = figure.add_subplot()
    axes.imshow(background, cmap="gray", vmin=0, vmax=255, alpha=0.35)
    good = np.isfinite(options.costs)
    shades = mpl.colormaps["viridis_r"]
    low, high = options.costs[good].min(), options.costs[good].max()
    every = [
        _film_path(planner, state, int(row), float(rotation_deg))
        for row, rotation_deg in zip(options.rows, options.rotations_deg, strict=True)
    ]
    for one, value in zip(every, options.costs, strict=True):
        x, y = one.T
        share = (value - low) / max(high - low, 1e-9)
        colour = shades(share) if np.isfinite(value) else "0.6"
        axes.plot(x, y, color=colour, lw=2.4, ls="-" if np.isfinite(value) else ":")
    trajectory, jumps = taken
    axes.plot(
        trajectory[:, 0], trajectory[:, 1], color="#d62728", lw=5, alpha=0.8, label="path taken"
    )
    axes.plot(trajectory[jumps, 0], trajectory[jumps, 1], "o", color="#d62728", ms=7, label="jumps")
    axes.plot(state.fish.x, state.fish.y, "o", color="black", ms=8, label="the fish")
    axes.plot(goal.x_px, goal.y_px, "o", mfc="none", mec="black", mew=2, ms=16, label="goal")
    places = np.vstack([*every, trajectory[:, :2], [goal.x_px, goal.y_px]])
    middle, half = (places.max(0) + places.min(0)) / 2, np.ptp(places, axis=0) / 2
    reach = 1.15 * max(half[1], half[0] * SIZE[1] / SIZE[0])
    axes.set_xlim(middle[0] - reach * SIZE[0] / SIZE[1], middle[0] + reach * SIZE[0] / SIZE[1])
    axes.set_ylim(middle[1] + reach, middle[1] - reach)
    axes.set_xticks([])
    axes.set_yticks([])
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(low, high), shades)
    figure.colorbar(scale, ax=axes, label="cost of the best path from there, s", shrink=0.8)
    axes.legend(loc="lower right", framealpha=0.9)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _decision(planner: Planner) -> tuple[State, Goal, CandidateVerdicts, tuple[Floats, Floats]]:
    """Return a decision with many good and bad candidates, and a path with jumps to its goal."""
    rng = np.random.default_rng(2)
    state, best = planner.begin(rng), None
    for _ in range(TRIES):
        goal = random_goals(planner.world, 1, rng)[0]._replace(radius_px=planner.world.touch_px)
        stretch, then = planner.plan(state, goal, rng)
        options = stretch.options
        if options is not None and len(options.rows) >= WAYS and options.taken >= 0:
            good = np.isfinite(options.costs).mean()
            trajectory, jumps = _swim_path(planner, state, goal)
            if 0.4 < good < 0.95 and 2 <= len(jumps) <= 6 and len(trajectory) > 60:
                return state, goal, options, (trajectory, jumps)
            best = best or (state, goal, options, (trajectory, jumps))
        state = then
    assert best is not None
    return best


def _swim_path(planner: Planner, state: State, goal: Goal) -> tuple[Floats, Floats]:
    """Return the path (n, 3) that a fish swims from a state, and the ticks at which it jumps."""
    rng, places, jumps, ticks = np.random.default_rng(0), [], [], 0
    while ticks < TAKEN_S * planner.world.motion.rate_hz:
        stretch, state = planner.plan(state, goal, rng)
        if stretch.begins_with_transition:
            jumps.append(ticks)
        places.append(stretch.trajectory)
        ticks += len(stretch.trajectory)
        if stretch.touches_goal:
            break
    return np.concatenate(places), np.array(jumps, int)


def _film_path(planner: Planner, state: State, row: int, rotation_deg: float) -> Floats:
    """Return the positions (n, 2) that playing the film from a row gives a fish."""
    film, x, y = planner.world.film, state.fish.x, state.fish.y
    ticks, places = round(WAY_S * planner.world.motion.rate_hz), [(x, y)]
    while ticks and film.has_next[row]:
        dx, dy = rotate(film.dx[row], film.dy[row], rotation_deg)
        x, y, row, ticks = x + dx, y + dy, row + 1, ticks - 1
        places.append((x, y))
    return np.array(places)
