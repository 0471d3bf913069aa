"""Figs. 8–14 of the curve paper for any contours: a dog's limbs, a fish's outline."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle, pairwise
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from finloop.base.arrays import Points
from finloop.base.stretches import spread_rows
from finloop.gait.coarse import few_point_contours
from finloop.gait.fit import LEAST_MOTION, GaitContours, Subcycle, SubcycleKey
from finloop.gait.model import (
    KEY_NAMES,
    SHARINGS,
    Descriptor,
    Gait,
    Keys,
    contours_at_phases,
    four_key_frames,
    start_share,
)
from finloop.gait.settings import Sharing

INKS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY = "#B0B0B0"
# Of subcycles in Fig. 11: A and B as in the paper, C and D of gaits without symmetry.
MARKS = {"A": ("o", INKS[0]), "B": ("x", INKS[1]), "C": ("^", INKS[2]), "D": ("s", INKS[3])}
_CONTROL = (4, 16, 64)  # control points of the rows of Fig. 14
_COLUMNS = 6  # pictures per row
_FRAMES = 18  # contours in Fig. 8, at most

Pose = Mapping[str, Points]
Id = TypeVar("Id", str, SubcycleKey)
Value = TypeVar("Value")


def draw_gait_figures(
    film: GaitContours, gait: Gait, keys: Keys, subcycles: Mapping[SubcycleKey, Subcycle],
    pictures: tuple[Sequence[NDArray[np.uint8]], Points] | None = None,
) -> Iterator[tuple[str, Figure]]:  # fmt: skip
    """Yield Figs. 8 to 14 of the curve paper, each with its name, "fig8" to "fig14".

    Of Fig. 11 there are four: "fig11" shows the one γ of each limb over time; "fig11_scale",
    "fig11_coefficient" and "fig11_coordinate" show γ over the coefficients, by what shares a γ.
    film: contours with their phases. pictures: frames of the film with their phases; None = Fig. 8
    shows contours. Contours are in the order of their ids, so a limb has one colour in all films.
    """
    film = replace(film, contours=_sort_by_id(film.contours))
    gait = replace(gait, support=_sort_by_id(gait.support))
    keys = [_sort_by_id(key) for key in keys]
    subcycles = _sort_by_id(subcycles)
    yield "fig8", _figure8(*pictures) if pictures else _figure8_contours(film)
    yield "fig9", _figure9(gait, keys, film)
    yield "fig10", _figure10(film, keys, gait.split)
    yield "fig11", _figure11(subcycles)
    for sharing in SHARINGS[1:]:
        least_motion = LEAST_MOTION * film.body_length
        figure = _figure11_gammas(subcycles, sharing, gait.descriptor, least_motion)
        yield f"fig11_{sharing}", figure
    yield "fig12", _figure12(gait, keys, film)
    yield "fig13", _figure13(gait, keys, film)
    yield "fig14", _figure14(gait, keys, film)


def _sort_by_id(values: Mapping[Id, Value]) -> dict[Id, Value]:
    """Return a mapping in the order of its keys."""
    return {key: values[key] for key in sorted(values)}


def _figure8(pictures: Sequence[NDArray[np.uint8]], phases: Points) -> Figure:
    """Draw Fig. 8 with k pictures (h, w) of a gait cycle, and their phases (k,) in cycles."""
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // _COLUMNS)  # rounded up
    figure, ax = _open_plot(_COLUMNS * 2.0, rows * (2.0 * height / width + 0.2), title="")
    cell_width, cell_height = 1.04 * width, height + 0.1 * width
    for k, (picture, phase) in enumerate(zip(pictures, phases, strict=True)):
        x, y = (k % _COLUMNS) * cell_width, (k // _COLUMNS) * cell_height
        ax.imshow(picture, cmap="gray", vmin=0, vmax=255, extent=(x, x + width, y + height, y))
        ax.text(x + width / 2, y, f"phase {phase % 1:.2f}", ha="center", va="bottom", fontsize=7)
    ax.set(xlim=(0, _COLUMNS * cell_width), ylim=(rows * cell_height, -0.1 * width))
    return figure


def _figure8_contours(film: GaitContours) -> Figure:
    """Draw Fig. 8 with contours instead of pictures, of frames spread over the first cycle."""
    first_cycle = np.flatnonzero(film.phase < film.phase[0] + 1)
    frames = spread_rows(first_cycle, _FRAMES)
    rows = _arrange_poses({name: points[frames] for name, points in film.contours.items()})
    titles = [f"phase {film.phase[k] % 1:.2f}" for k in frames]
    return _draw_sheet(rows, titles, [""] * len(rows), "contours of the film")


def _figure9(gait: Gait, keys: Keys, film: GaitContours) -> Figure:
    """Draw Fig. 9: (a) limbs on the ground, or the reach of contours; (b) the four key frames."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    parts: Any = figure.subfigures(2, 1, height_ratios=[1, 1.1])
    ax = parts[0].subplots()
    edges = np.array([0, gait.split, 0.5, 0.5 + gait.split, 1])
    above_axes = ax.get_xaxis_transform()
    for phase, name in zip(edges, (*KEY_NAMES, "1"), strict=True):
        ax.axvline(phase, color=GREY, lw=0.8)
        ax.text(phase, 1.02, f"key {name}", transform=above_axes, ha="center", fontsize=8)
    for letter, (start, stop) in zip("ABCD", pairwise(edges), strict=True):
        ax.text((start + stop) / 2, 1.02, letter, transform=above_axes, ha="center")
    if gait.support:
        _draw_support(ax, gait)
    else:
        _draw_reach(ax, gait, keys, film)
    ax.set(xlim=(0, 1), xlabel="phase of the cycle")
    poses = four_key_frames(keys, film.symmetry, film.layout)
    titles = [f"key {name}" for name in KEY_NAMES]
    _draw_cells(parts[1].subplots(), [poses], titles)
    return figure


def _draw_support(ax: Axes, gait: Gait) -> None:
    """Draw a row per limb over the phase: ● where it is on the ground, ○ where it is lifted."""
    phases = np.linspace(0, 1, 24, endpoint=False) + 1 / 48  # the middle of each 24th
    inked_spans = zip(cycle(INKS), gait.support.values(), strict=False)  # of phases, limb by limb
    for row, (ink, spans) in enumerate(inked_spans):
        on_ground = np.zeros(len(phases), bool)
        for start, stop in spans:  # a span may end in the next cycle
            on_ground |= (start <= phases) & (phases < stop)
            on_ground |= (start <= phases + 1) & (phases + 1 < stop)
        level = np.full(len(phases), row)
        ax.plot(phases[on_ground], level[on_ground], "o", color=ink, ms=7)
        ax.plot(phases[~on_ground], level[~on_ground], "o", color=ink, ms=7, mfc="none")
    ax.set_yticks(range(len(gait.support)), [name.replace("_", " ") for name in gait.support])
    ax.set_ylim(len(gait.support) - 0.5, -0.5)
    ax.set_title("● on the ground, ○ lifted", fontsize=9, pad=18)


def _draw_reach(ax: Axes, gait: Gait, keys: Keys, film: GaitContours) -> None:
    """Draw over the cycle how far sideways each contour is, at the point that swings most."""
    phases = np.linspace(0, 1, 121)
    frames = _synthesize_contours(gait, keys, film, phases)
    for ink, (name, points) in zip(cycle(INKS), frames.items(), strict=False):
        widest = int(np.ptp(points[..., 1], axis=0).argmax())
        sideways = points[:, widest, 1] / film.body_length
        ax.plot(phases, sideways, color=ink, label=f"{name.replace('_', ' ')}: its farthest point")
    ax.set_ylabel("sideways / body length")
    ax.invert_yaxis()
    ax.legend(fontsize=8)


def _figure10(film: GaitContours, keys: Keys, split: float) -> Figure:
    """Draw Fig. 10: the frames of subcycle A, and those of C mapped onto A by symmetry.

    split: phase of key 2, at which A ends, in cycles. Each contour has a cell of its own. Without
    symmetry the frames of A are drawn alone.
    """
    # The frames of each contour, and their extents.
    subcycle, tau = film.locate_in_subcycle(split)
    in_a = (subcycle == 0) & (tau > 0)
    poses = film.exchange_second_half(film.contours)
    frames, middles, sizes = {}, {}, []
    for name in film.contours:
        frames[name] = poses[name][in_a]
        drawn = np.concatenate([frames[name], [key[name] for key in keys[:2]]])
        low, high = np.nanmin(drawn, axis=(0, 1)), np.nanmax(drawn, axis=(0, 1))
        middles[name] = (low + high) / 2
        sizes.append(high - low)
    # A cell for each contour, a little larger than the largest one.
    size = np.max(sizes, axis=0)
    names, (width, height) = list(frames), 1.15 * size
    columns = min(4, len(names))
    rows = -(-len(names) // columns)  # rounded up
    figure, ax = _open_plot(9.0, 9.0 / columns * rows * height / width + 0.6, title="")
    ax.set_title("subcycle A: key 1 dashed, key 2 solid, frames dotted", fontsize=10)
    for k, (name, ink) in enumerate(zip(names, cycle(INKS), strict=False)):
        shift = np.array([k % columns * width, k // columns * height]) - middles[name]
        for points in frames[name]:
            _draw_contour(ax, points + shift, color=GREY, ls=":", lw=1.0)
        _draw_contour(ax, keys[0][name] + shift, color=ink, ls="--", lw=1.5)
        _draw_contour(ax, keys[1][name] + shift, color=ink, ls="-", lw=1.5)
        x, y = shift + middles[name] - [0, size[1] / 2]
        ax.text(x, y, name.replace("_", " "), ha="center", va="bottom", fontsize=9)
    ax.set(xlim=(-width / 2, (columns - 0.5) * width), ylim=((rows - 0.5) * height, -0.6 * height))
    return figure


def _figure11(subcycles: Mapping[SubcycleKey, Subcycle]) -> Figure:
    """Draw Fig. 11: how much of the change from key to key remains, f(τ), and its fit by γ.

    τ: time from key to key, 0 … 1. Frames of subcycle A are 'o', of B 'x', see MARKS; f of a frame
    is found by least squares over the contour.
    """
    names = list(dict.fromkeys(name for name, _ in subcycles))
    columns = min(4, len(names))
    rows = -(-len(names) // columns)  # rounded up
    figure = Figure(figsize=(max(5.0, 2.7 * columns), 2.7 * rows + 0.3), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    tau = np.linspace(0, 1, 101)
    for ax in axes[len(names) :]:
        ax.axis("off")
    for ax, name in zip(axes, names, strict=False):
        ax.plot(tau, 1 - tau, color=GREY, lw=1, label="linear")
        for letter, (mark, ink) in _subcycle_marks(subcycles).items():
            subcycle = subcycles[name, letter]
            # Least squares: each frame, a sample, = end + f · (start − end).
            change = (subcycle.start - subcycle.end).ravel()
            samples = subcycle.samples
            remaining = (samples.coefficients - subcycle.end).reshape(len(samples.tau), -1)
            share = remaining @ change / max(float(change @ change), 1e-300)  # not 0 / 0 at rest
            gamma = float(subcycle.fit_gammas("limb", least_motion=0.0)[0])
            ax.plot(tau, start_share(tau, gamma), color=ink, lw=1.2)
            ax.plot(
                samples.tau, share, mark, color=ink, ms=4.5, mfc="none",
                label=f"{letter}: γ = {gamma:+.2f}",
            )  # fmt: skip
        ax.set_title(name.replace("_", " "), fontsize=9)
        ax.legend(fontsize=7)
    figure.supxlabel("τ", fontsize=9)
    figure.supylabel("f(τ), 1 = the key it comes from", fontsize=9)
    return figure


def _figure11_gammas(
    subcycles: Mapping[SubcycleKey, Subcycle],
    sharing: Sharing,
    descriptor: Descriptor,
    least_motion: float,
) -> Figure:
    """Draw Fig. 11 for several γ per limb: γ over the number of the coefficient.

    sharing: what shares one γ: a scale, a coefficient, or a coordinate of a coefficient. 'o' is
    subcycle A, 'x' B, see MARKS; the larger a mark, the farther its coefficient moves between the
    keys. Scales lie between upright lines. Within the grey band, |γ| ≤ 1, f(τ) never turns back.
    descriptor, least_motion: see `Subcycle.fit_gammas`.
    """
    names = list(dict.fromkeys(name for name, _ in subcycles))
    coordinates = "xy" if sharing == "coordinate" else " "
    panels = [(name, k) for name in names for k in range(len(coordinates))]
    columns = min(4, len(panels))
    rows = -(-len(panels) // columns)  # rounded up
    figure = Figure(figsize=(max(7.0, 3.2 * columns), 2.7 * rows + 0.7), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    for ax in axes[len(panels) :]:
        ax.axis("off")
    for ax, (name, k) in zip(axes, panels, strict=False):
        ax.set_xscale("log", base=2)  # before the marks: they set the limits in this scale
        ax.set_yscale("symlog", linthresh=1)
        ax.axhspan(-1, 1, color=GREY, alpha=0.25, lw=0)
        for scale in subcycles[name, "A"].scales[1:]:
            ax.axvline(scale.start + 0.5, color=GREY, lw=0.7)
        for letter, (mark, ink) in _subcycle_marks(subcycles).items():
            subcycle = subcycles[name, letter]
            n = len(subcycle.start)
            fitted = subcycle.fit_gammas(sharing, least_motion)
            gammas = descriptor.spread_gammas(fitted, n)[:, k]
            shown: Sharing = "coordinate" if sharing == "coordinate" else "coefficient"
            shares = subcycle.motion_shares(shown)[:, k]
            inks = [to_rgba(ink, alpha) for alpha in np.clip(0.25 + 15 * shares, 0, 1)]
            face: dict[str, Any] = {"color": inks}
            if mark != "x":
                face = {"facecolors": "none", "edgecolors": inks}
            sizes = 5 + 90 * shares
            ax.scatter(np.arange(1, n + 1), gammas, sizes, marker=mark, linewidths=1, **face)
            limb = float(subcycle.fit_gammas("limb", least_motion)[0])
            ax.axhline(limb, color=ink, lw=0.8, ls="--")
        ax.set_title(f"{name.replace('_', ' ')} {coordinates[k]}".strip(), fontsize=9)
        ax.minorticks_off()
        ax.xaxis.set_major_formatter("{x:.0f}")
        ax.yaxis.set_major_formatter("{x:.0f}")
    handles = [
        Line2D([], [], color=ink, marker=mark, mfc="none", ls="--", label=letter)
        for letter, (mark, ink) in _subcycle_marks(subcycles).items()
    ]
    axes[0].legend(handles=handles, title="subcycle", fontsize=7, title_fontsize=7)
    figure.suptitle(
        "large marks move far between the keys, pale ones hardly; dashed: one γ for the limb; "
        "grey band: no turning back", fontsize=8,
    )  # fmt: skip
    figure.supxlabel("number of the coefficient, coarse to fine", fontsize=9)
    figure.supylabel(f"γ by {sharing}", fontsize=9)
    return figure


def _subcycle_marks(subcycles: Mapping[SubcycleKey, Subcycle]) -> dict[str, tuple[str, str]]:
    """Return, for each subcycle letter that occurs, the mark and the colour in the plots."""
    letters = {letter for _, letter in subcycles}
    return {letter: mark for letter, mark in MARKS.items() if letter in letters}


def _figure12(gait: Gait, keys: Keys, film: GaitContours) -> Figure:
    """Draw Fig. 12: the synthesized cycle, with subcycles A to D in rows."""
    edges = np.array([0, gait.split, 0.5, 0.5 + gait.split, 1])
    tau = np.arange(_COLUMNS) / _COLUMNS
    phases = np.concatenate([start + tau * (stop - start) for start, stop in pairwise(edges)])
    rows = _arrange_poses(_synthesize_contours(gait, keys, film, phases))
    titles = [f"phase {phase:.3f}" for phase in phases]
    return _draw_sheet(rows, titles, list("ABCD"), "synthesized cycle")


def _figure13(gait: Gait, keys: Keys, film: GaitContours) -> Figure:
    """Draw Fig. 13: the synthesized subcycle A in two rows."""
    phases = np.linspace(0, gait.split, 2 * _COLUMNS)
    rows = _arrange_poses(_synthesize_contours(gait, keys, film, phases))
    titles = [f"phase {phase:.3f}" for phase in phases]
    return _draw_sheet(rows, titles, ["", ""], "subcycle A")


def _figure14(gait: Gait, keys: Keys, film: GaitContours) -> Figure:
    """Draw Fig. 14: the cycle solved at 4, 16 and 64 control points per contour, a row each.

    Beside a row stands the RMS distance of its contours from those of all points, in % of body
    length.
    """
    phases = np.arange(_COLUMNS) / _COLUMNS  # so each number of points has a single row of poses
    full = _synthesize_contours(gait, keys, film, phases)
    rows, names = [], []
    for control in _CONTROL:
        few = few_point_contours(keys, gait, phases, film.layout, control)
        distances = np.stack([np.linalg.norm(few[name] - full[name], axis=-1) for name in full])
        rms_pct = 100 * np.sqrt((distances**2).mean()) / film.body_length
        rows += _arrange_poses(few)
        names.append(f"{control}\n{rms_pct:.2f} %")
    # The phases are written above the first of the three rows alone.
    titles = [f"phase {phase:.2f}" for phase in phases] + [""] * (2 * _COLUMNS)
    title = "solved at few control points; beside: their number, RMS error in % of body length"
    return _draw_sheet(rows, titles, names, title)


def _synthesize_contours(
    gait: Gait, keys: Keys, film: GaitContours, phases: Points
) -> dict[str, Points]:
    """Return the contours of a gait at k phases, by name, each (k, n, 2).

    phases (k,): in cycles. film: tells how much farther right and down each limb hangs than its
    left-right partner.
    """
    return contours_at_phases(keys, gait, phases, film.layout)


def _arrange_poses(frames: Mapping[str, Points]) -> list[list[Pose]]:
    """Return the poses of all frames in rows of `_COLUMNS`; a pose has its contours by name.

    frames: name → contour in each of k frames, (k, n, 2).
    """
    poses: list[Pose] = [
        dict(zip(frames, contours, strict=True)) for contours in zip(*frames.values(), strict=True)
    ]
    return [poses[k : k + _COLUMNS] for k in range(0, len(poses), _COLUMNS)]


def _draw_sheet(
    rows: Sequence[Sequence[Pose]], titles: Sequence[str], names: Sequence[str], title: str
) -> Figure:
    """Return a figure of poses in rows, with a title above each pose, and names beside the rows."""
    cell_width, cell_height = _cell_size(rows)
    columns = max(map(len, rows))
    # In inches; 0.3 of a cell is for the names, 0.4 inches above are for the title.
    width = 1.7 * columns + 0.4
    height = (width / (columns + 0.3)) * len(rows) * cell_height / cell_width + 0.4
    figure, ax = _open_plot(width, height, title)
    _draw_cells(ax, rows, titles, names)
    return figure


def _cell_size(rows: Sequence[Sequence[Pose]]) -> Points:
    """Return the width and height (2,) of a cell that has room for any of the poses in rows."""
    least, greatest = _pose_bounds(rows)
    width, height = greatest - least
    return np.array([1.08 * width, 1.04 * height + 0.13 * width])  # with room for a title


def _draw_cells(
    ax: Axes, rows: Sequence[Sequence[Pose]], titles: Sequence[str], names: Sequence[str] = ()
) -> None:
    """Draw poses side by side in rows, with a title above each, and names beside the rows.

    All are in one plot: a plot for each would take ten times as long.
    """
    (least, _), (width, height) = _pose_bounds(rows), _cell_size(rows)
    next_titles = iter(titles)
    for row_number, row in enumerate(rows):
        for column, pose in enumerate(row):
            corner = np.array([column * width, row_number * height])
            for ink, contour in zip(cycle(INKS), pose.values(), strict=False):
                points = contour - least + corner
                ax.fill(*points.T, color=ink, alpha=0.25, lw=0)
                _draw_contour(ax, points, color=ink, lw=1.1)
            x, y = corner + np.array([0.46 * width, -0.02 * width])
            ax.text(x, y, next(next_titles), ha="center", va="bottom", fontsize=7)
        if names:
            x, y = -0.06 * width, (row_number + 0.45) * height
            ax.text(x, y, names[row_number], ha="right", va="center", fontsize=9)
    # Room for the names at the left, and for the titles above the rows.
    ax.set(
        xlim=((-0.3 if names else -0.03) * width, max(map(len, rows)) * width),
        ylim=(len(rows) * height - 0.1 * width, -0.13 * width),
    )
    ax.set_aspect("equal")
    ax.axis("off")


def _open_plot(width: float, height: float, title: str) -> tuple[Figure, Axes]:
    """Return a figure of a size [inches] and the only plot in it, which has no frame."""
    figure = Figure(figsize=(width, height))
    ax = figure.add_axes((0.01, 0.01, 0.98, 0.98 - 0.3 / height))  # 0.3 inches for the title
    ax.set_title(title, fontsize=10)
    ax.set_aspect("equal")
    ax.axis("off")
    return figure, ax


def _draw_contour(ax: Axes, points: Points, color: str, lw: float, ls: str = "-") -> None:
    """Draw a closed contour through points (n, 2)."""
    ax.plot(*np.concatenate([points, points[:1]]).T, color=color, lw=lw, ls=ls)


def _pose_bounds(rows: Sequence[Sequence[Pose]]) -> tuple[Points, Points]:
    """Return the least and the greatest x and y, (2,) each, of all poses in rows.

    NaN does not count.
    """
    points = np.concatenate([points for row in rows for pose in row for points in pose.values()])
    return np.nanmin(points, axis=0), np.nanmax(points, axis=0)
