"""Figs. 8–14 of the curve paper for any contours: a dog's limbs, a fish's outline."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.base.arrays import Points
from finloop.gait.fit import GaitContours, KeyFrames, Subcycle
from finloop.gait.model import (
    Gait,
    HalfCycleLayout,
    contours_at_phases,
    four_key_frames,
    key_1_share,
)

INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY = "#B0B0B0"
KEY_NAMES = ("1", "2", "1'", "2'")
_CONTROL = (4, 16, 64)  # control points of the rows of Fig. 14
_COLUMNS = 6  # pictures per row
_FRAMES = 18  # contours in Fig. 8, at most

Pose = Mapping[str, Points]


def draw_gait_figures(
    film: GaitContours,
    gait: Gait,
    keys: KeyFrames,
    subcycles: Mapping[tuple[str, int], Subcycle],
    pictures: tuple[Sequence[NDArray[np.uint8]], Points] | None = None,
) -> Iterator[tuple[str, Figure]]:
    """Yield Figs. 8 to 14 of the curve paper, each with its name, "fig8" to "fig14".

    film: contours with their phases. keys: the key frames. subcycles: by contour and 0 for A, 1 for
    B. pictures: of the film with their phases; None: Fig. 8 shows contours.
    """
    yield "fig8", _figure8(*pictures) if pictures else _figure8_contours(film)
    yield "fig9", _figure9(gait, keys, film)
    yield "fig10", _figure10(film, keys, gait.split)
    yield "fig11", _figure11(subcycles)
    yield "fig12", _figure12(gait, keys, film)
    yield "fig13", _figure13(gait, keys, film)
    yield "fig14", _figure14(gait, keys, film)


def _figure8(pictures: Sequence[NDArray[np.uint8]], phases: Points) -> Figure:
    """Draw Fig. 8 with pictures: k frames (h, w) of one gait cycle, row by row, with their phases.

    phases (k,): in cycles.
    """
    high, wide = pictures[0].shape[:2]
    columns, rows = _COLUMNS, -(-len(pictures) // _COLUMNS)
    figure, ax = _open_plot(columns * 2.0, rows * (2.0 * high / wide + 0.2), "")
    for k, (picture, phase) in enumerate(zip(pictures, phases, strict=True)):
        x, y = (k % columns) * 1.04 * wide, (k // columns) * (high + 0.1 * wide)
        ax.imshow(picture, cmap="gray", vmin=0, vmax=255, extent=(x, x + wide, y + high, y))
        ax.text(x + wide / 2, y, f"phase {phase % 1:.2f}", ha="center", va="bottom", fontsize=7)
    ax.set(xlim=(0, columns * 1.04 * wide), ylim=(rows * (high + 0.1 * wide), -0.1 * wide))
    return figure


def _figure8_contours(film: GaitContours) -> Figure:
    """Draw Fig. 8 with contours instead of pictures, of frames spread over the first cycle."""
    first = np.flatnonzero(film.phase < film.phase[0] + 1)
    frames = first[np.unique(np.linspace(0, len(first) - 1, min(_FRAMES, len(first))).astype(int))]
    rows = _arrange_poses({name: points[frames] for name, points in film.contours.items()})
    titles = [f"phase {film.phase[k] % 1:.2f}" for k in frames]
    return _draw_sheet(rows, titles, [""] * len(rows), "contours of the film")


def _figure9(gait: Gait, keys: KeyFrames, film: GaitContours) -> Figure:
    """Draw Fig. 9: (a) limbs on the ground, or the reach of contours; (b) the four key frames."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[1, 1.1])
    ax = parts[0].subplots()
    edges = np.array([0, gait.split, 0.5, 0.5 + gait.split, 1])
    above_axes = ax.get_xaxis_transform()
    for at, name in zip(edges, (*KEY_NAMES, "1"), strict=True):
        ax.axvline(at, color=GREY, lw=0.8)
        ax.text(at, 1.02, f"key {name}", transform=above_axes, ha="center", fontsize=8)
    for letter, (a, b) in zip("ABCD", pairwise(edges), strict=True):
        ax.text((a + b) / 2, 1.02, letter, transform=above_axes, ha="center")
    if gait.support:
        _draw_support(ax, gait)
    else:
        _draw_reach(ax, gait, keys, film)
    ax.set(xlim=(0, 1), xlabel="phase of the cycle")
    poses = four_key_frames(
        keys.first, keys.second, film.symmetry, HalfCycleLayout(offsets=film.offsets)
    )
    titles = [f"key {name}" for name in KEY_NAMES]
    _draw_cells(parts[1].subplots(), [list(poses)], titles)
    return figure


def _draw_support(ax: Axes, gait: Gait) -> None:
    """Draw a row per limb over the phase: ● where it is on the ground, ○ where it is lifted."""
    places = np.linspace(0, 1, 24, endpoint=False) + 1 / 48
    inks = _contour_colours(gait.support)
    for row, (ink, spans) in enumerate(zip(inks, gait.support.values(), strict=True)):
        down = np.zeros(len(places), bool)
        for start, stop in spans:
            down |= (start <= places) & (places < stop)
            down |= (start <= places + 1) & (places + 1 < stop)
        ax.plot(places[down], np.full(down.sum(), row), "o", color=ink, ms=7)
        ax.plot(places[~down], np.full((~down).sum(), row), "o", color=ink, ms=7, mfc="none")
    ax.set_yticks(range(len(gait.support)), [name.replace("_", " ") for name in gait.support])
    ax.set_ylim(len(gait.support) - 0.5, -0.5)
    ax.set_title("● on the ground, ○ lifted", fontsize=9, pad=18)


def _draw_reach(ax: Axes, gait: Gait, keys: KeyFrames, film: GaitContours) -> None:
    """Draw how far each contour reaches to either side over the cycle, in body lengths."""
    phases = np.linspace(0, 1, 121)
    frames = _synthesize_contours(gait, keys, film, phases)
    for ink, (name, points) in zip(_contour_colours(frames), frames.items(), strict=True):
        most = int(np.ptp(points[..., 1], axis=0).argmax())
        side = points[:, most, 1] / film.body_length
        ax.plot(phases, side, color=ink, label=f"{name.replace('_', ' ')}: its farthest point")
    ax.set_ylabel("sideways / body length")
    ax.invert_yaxis()
    ax.legend(fontsize=8)


def _figure10(film: GaitContours, keys: KeyFrames, split: float) -> Figure:
    """Draw Fig. 10: the frames of subcycle A up to key 2, and of C mapped onto them by symmetry.

    split: phase of key 2, in cycles.
    """
    inside = (np.mod(film.phase, 0.5) > 0) & (np.mod(film.phase, 0.5) < split)
    late = (np.mod(film.phase, 1) >= 0.5)[inside, None, None]
    later = film.contours_half_cycle_later(film.contours)
    frames = {n: np.where(late, later[n][inside], of[inside]) for n, of in film.contours.items()}
    names = list(film.contours)
    columns = min(4, len(names))
    middles = {n: (_least_xy(of) + _greatest_xy(of)) / 2 for n, of in frames.items()}
    size = np.max([_greatest_xy(of) - _least_xy(of) for of in frames.values()], axis=0)
    wide, high = 1.15 * size
    rows = -(-len(names) // columns)
    figure, ax = _open_plot(9.0, 9.0 / columns * rows * high / wide + 0.6, "")
    ax.set_title("subcycle A: key 1 dashed, key 2 solid, frames dotted", fontsize=10)
    for k, (name, ink) in enumerate(zip(names, _contour_colours(names), strict=True)):
        shift = np.array([k % columns * wide, k // columns * high]) - middles[name]
        for points in frames[name]:
            _draw_contour(ax, points + shift, color=GREY, ls=":", lw=1.0)
        _draw_contour(ax, keys.first[name] + shift, color=ink, ls="--", lw=1.5)
        _draw_contour(ax, keys.second[name] + shift, color=ink, ls="-", lw=1.5)
        x, y = shift + middles[name] - [0, size[1] / 2]
        ax.text(x, y, name.replace("_", " "), ha="center", va="bottom", fontsize=9)
    ax.set(xlim=(-wide / 2, (columns - 0.5) * wide), ylim=((rows - 0.5) * high, -0.6 * high))
    return figure


def _figure11(subcycles: Mapping[tuple[str, int], Subcycle]) -> Figure:
    """Draw Fig. 11: the share f(τ) of the change between two keys that remains, and its fit by γ.

    τ: time from key to key, 0 … 1. Frames of subcycle A are 'o', of B 'x'; f is found by least
    squares over the contour.
    """
    names = list(dict.fromkeys(name for name, _ in subcycles))
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(5.0, 2.7 * columns), 2.7 * rows + 0.3), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    tau = np.linspace(0, 1, 101)
    for ax in axes[len(names) :]:
        ax.axis("off")
    for ax, name in zip(axes, names, strict=False):
        ax.plot(tau, 1 - tau, color=GREY, lw=1, label="linear")
        for sub, mark in enumerate("ox"):
            model = subcycles[name, sub]
            way = (model.start - model.end).ravel()
            flat = (model.samples.coefficients - model.end).reshape(len(model.samples.tau), -1)
            gamma = model.fit_gammas(per_scale=False, least_motion=0.0)[0]
            ink = INKS[sub]
            text = f"{'AB'[sub]}: γ = {gamma:+.2f}"
            ax.plot(tau, key_1_share(tau, np.array(gamma)), color=ink, lw=1.2)
            ax.plot(
                model.samples.tau, flat @ way / max(float(way @ way), 1e-300), mark,
                color=ink, ms=4.5, mfc="none", label=text,
            )  # fmt: skip
        ax.set_title(name.replace("_", " "), fontsize=9)
        ax.legend(fontsize=7)
    figure.supxlabel("τ", fontsize=9)
    figure.supylabel("f(τ), 1 = the key it comes from", fontsize=9)
    return figure


def _figure12(gait: Gait, keys: KeyFrames, film: GaitContours) -> Figure:
    """Draw Fig. 12: the synthesized cycle, with subcycles A to D in rows."""
    edges = np.array([0, gait.split, 0.5, 0.5 + gait.split, 1])
    tau = np.arange(_COLUMNS) / _COLUMNS
    phases = np.concatenate([a + tau * (b - a) for a, b in pairwise(edges)])
    rows = _arrange_poses(_synthesize_contours(gait, keys, film, phases))
    titles = [f"phase {phase:.3f}" for phase in phases]
    return _draw_sheet(rows, titles, list("ABCD"), "synthesized cycle")


def _figure13(gait: Gait, keys: KeyFrames, film: GaitContours) -> Figure:
    """Draw Fig. 13: the synthesized subcycle A in two rows."""
    phases = np.linspace(0, gait.split, 2 * _COLUMNS)
    rows = _arrange_poses(_synthesize_contours(gait, keys, film, phases))
    titles = [f"phase {phase:.3f}" for phase in phases]
    return _draw_sheet(rows, titles, ["", ""], "subcycle A")


def _figure14(gait: Gait, keys: KeyFrames, film: GaitContours) -> Figure:
    """Draw Fig. 14: the cycle with 4, 16 and 64 control points per contour, a row each."""
    phases = np.arange(_COLUMNS) / _COLUMNS
    rows = [
        _arrange_poses(_synthesize_contours(gait, keys, film, phases, control))[0]
        for control in _CONTROL
    ]
    titles = [f"phase {phase:.2f}" for phase in phases] + [""] * (2 * _COLUMNS)
    names = [f"{control} points" for control in _CONTROL]
    return _draw_sheet(rows, titles, names, "the same at few control points")


def _synthesize_contours(
    gait: Gait, keys: KeyFrames, film: GaitContours, phases: Points, control: int | None = None
) -> dict[str, Points]:
    """Return the contours of a gait at some phases (k,), by name, each (k, n, 2).

    control: number of control points per contour, None for all.
    """
    layout = HalfCycleLayout(offsets=film.offsets)
    return contours_at_phases(keys.first, keys.second, gait, phases, layout, control=control)


def _arrange_poses(frames: Mapping[str, Points]) -> list[list[Pose]]:
    """Return the pose of each frame of some contours, in rows of _COLUMNS.

    frames: by the name of the contour, (k, n, 2).
    """
    each = zip(*frames.values(), strict=True)
    poses: list[Pose] = [dict(zip(frames, pose, strict=True)) for pose in each]
    return [poses[k : k + _COLUMNS] for k in range(0, len(poses), _COLUMNS)]


def _draw_sheet(
    rows: Sequence[Sequence[Pose]], titles: Sequence[str], names: Sequence[str], title: str
) -> Figure:
    """Return a figure of poses in rows, with a title above each pose, and names beside the rows."""
    wide, high = _cell_size(rows)
    columns = max(map(len, rows))
    inches = 1.7 * columns + 0.4
    figure, ax = _open_plot(
        inches, (inches / (columns + 0.3)) * len(rows) * high / wide + 0.4, title
    )
    _draw_cells(ax, rows, titles, names)
    return figure


def _cell_size(rows: Sequence[Sequence[Pose]]) -> Points:
    """Return width and height of the cell in which each of some poses is drawn."""
    box = _all_points([pose for row in rows for pose in row])
    wide, high = _greatest_xy(box) - _least_xy(box)
    return np.array([1.08 * wide, 1.04 * high + 0.13 * wide])


def _draw_cells(
    ax: Axes, rows: Sequence[Sequence[Pose]], titles: Sequence[str], names: Sequence[str] = ()
) -> None:
    """Draw poses side by side in rows, with a title above each, and names beside the rows.

    All are in one plot: a plot for each would take ten times as long.
    """
    box = _all_points([pose for row in rows for pose in row])
    low, (wide, high) = _least_xy(box), _cell_size(rows)
    left = iter(titles)
    for r, row in enumerate(rows):
        for c, pose in enumerate(row):
            corner = np.array([c * wide, r * high])
            for ink, points in zip(_contour_colours(pose), pose.values(), strict=True):
                ax.fill(*(points - low + corner).T, color=ink, alpha=0.25, lw=0)
                _draw_contour(ax, points - low + corner, color=ink, lw=1.1)
            x, y = corner + np.array([0.46 * wide, -0.02 * wide])
            ax.text(x, y, next(left), ha="center", va="bottom", fontsize=7)
        if names:
            at = (-0.06 * wide, (r + 0.45) * high)
            ax.text(*at, names[r], rotation=90, ha="right", va="center", fontsize=10)
    columns = max(map(len, rows))
    ax.set(
        xlim=(-0.25 * wide if names else 0, columns * wide),
        ylim=(len(rows) * high - 0.13 * wide, -0.13 * wide),
    )
    ax.set_aspect("equal")
    ax.axis("off")


def _open_plot(wide: float, high: float, title: str) -> tuple[Figure, Axes]:
    """Return a figure of this size in inches, filled by one plot without a frame."""
    figure = Figure(figsize=(wide, high))
    ax = figure.add_axes((0.01, 0.01, 0.98, 0.98 - 0.3 / high))
    ax.set_title(title, fontsize=10)
    ax.set_aspect("equal")
    ax.axis("off")
    return figure, ax


def _draw_contour(ax: Axes, points: Points, color: str, lw: float, ls: str = "-") -> None:
    """Draw a closed contour through points (n, 2)."""
    ax.plot(*np.concatenate([points, points[:1]]).T, color=color, lw=lw, ls=ls)


def _contour_colours(names: Mapping[str, object] | Sequence[str]) -> list[str]:
    """Return a colour for each of some names, in their order."""
    return [INKS[k % len(INKS)] for k in range(len(names))]


def _all_points(poses: Sequence[Pose]) -> Points:
    """Return the points of all contours of some poses, (n, 2)."""
    return np.concatenate([points for pose in poses for points in pose.values()])


def _least_xy(points: Points) -> Points:
    """Return the least x and the least y of some points (…, 2); NaN does not count."""
    return np.nanmin(points.reshape(-1, 2), axis=0)


def _greatest_xy(points: Points) -> Points:
    """Return the greatest x and the greatest y of some points (…, 2); NaN does not count."""
    return np.nanmax(points.reshape(-1, 2), axis=0)
