"""Figs. 2, 3, 6 and 7 of the curve paper."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.sparse import csr_array

from finloop.curve.contour import Curve
from finloop.curve.wavelet import drop_details, scale_slices

LEVELS = (0, 3, 4, 5, 6)  # the paper leaves out 1 and 2, which look like the curve
INK, REST, OTHER = "#0072B2", "#B0B0B0", "#D55E00"
COLUMNS = 6  # pictures in a row of Fig. 6

Array = NDArray[np.float64]


def _plot_line(
    ax: Axes, points: Array, closed: bool, colour: str = INK, width: float = 1.3
) -> None:
    """Plot a line through points (n, 2); a closed curve returns to its first point."""
    x, y = (np.concatenate([points, points[:1]]) if closed else points).T
    ax.plot(x, y, color=colour, lw=width, solid_capstyle="round")


def _fit_axes(ax: Axes, points: Array) -> None:
    """Set the range of a plot to points (…, 2), y down, with a margin; hide its axes."""
    low, high = points.reshape(-1, 2).min(axis=0), points.reshape(-1, 2).max(axis=0)
    margin = 0.06 * float((high - low).max())
    ax.set(xlim=(low[0] - margin, high[0] + margin), ylim=(high[1] + margin, low[1] - margin))
    ax.set_aspect("equal")
    ax.axis("off")


def _panel_height(points: Array, width: float) -> float:
    """Return the height [inches] of a panel that shows points (…, 2), with room for its title.

    width: of the panel, inches.
    """
    extent_x, extent_y = np.ptp(points.reshape(-1, 2), axis=0) + 1e-9
    return min(3.0, max(0.7, width * float(extent_y / extent_x))) + 0.3


def _write_row_name(ax: Axes, text: str) -> None:
    """Write the name of a row of panels to the left of its first panel."""
    ax.text(
        -0.08, 0.5, text, transform=ax.transAxes, rotation=90, va="center", ha="right", fontsize=9
    )


def figure2(curve: Curve, wavelets: Sequence[tuple[str, str]]) -> Figure:
    """Draw Fig. 2 of the curve paper: a curve of n points, drawn from n / 2^k samples of it.

    wavelets: pairs of a wavelet's name and the title of its row.
    """
    n = len(curve.points)  # it can be halved up to the greatest of LEVELS times
    figure = Figure(figsize=(2.1 * len(LEVELS), 2.9 * len(wavelets)), layout="constrained")
    rows = figure.subplots(len(wavelets), len(LEVELS), squeeze=False)
    for row, (wavelet, title) in zip(rows, wavelets, strict=True):
        shapes = [drop_details(curve.points, wavelet, k, curve.closed) for k in LEVELS]
        for ax, k, points in zip(row, LEVELS, shapes, strict=True):
            _plot_line(ax, points, curve.closed)
            _fit_axes(ax, np.stack(shapes))
            ax.set_title(f"({k})  {n >> k} samples", fontsize=9)
        _write_row_name(row[0], title)
    return figure


def figure3(matrix: csr_array, levels: int, title: str) -> Figure:
    """Draw Fig. 3 of the curve paper: the sizes of the entries of the stiffness matrix K (n, n).

    matrix: K in the wavelet basis. levels: number of scales, which lines separate.
    """
    magnitude = np.abs(matrix.toarray())
    largest = float(magnitude.max())
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    ax = figure.subplots()
    shades = ax.imshow(
        np.where(magnitude > 1e-6 * largest, magnitude, np.nan) / largest,
        cmap="gray_r", norm=LogNorm(1e-6, 1), interpolation="nearest",
    )  # fmt: skip
    for scale in scale_slices(len(magnitude), levels)[1:]:
        ax.axhline(scale.start - 0.5, color=INK, lw=0.8)
        ax.axvline(scale.start - 0.5, color=INK, lw=0.8)
    ax.set(title=title, xlabel="coefficient, coarse to fine", ylabel="coefficient, coarse to fine")
    figure.colorbar(shades, ax=ax, label="size of the entry, largest = 1 (white: below 1e-6)")
    return figure


def figure6(
    frames: Array, times: Array, rest: Array, title: str,
    curves: Mapping[str, tuple[Array, Array]] | None = None,
) -> Figure:  # fmt: skip
    """Draw Fig. 6 of the curve paper: pictures of a moving curve, with its rest shape in grey.

    frames (t, n, 2): the closed curve at the times (t,). rest (n, 2): its shape without forces.
    curves: by name, times (k,) and shares (k,) of the displacement that remain then, for a plot
    below the pictures.
    """
    rows = -(-len(frames) // COLUMNS)  # rounded up
    all_points = np.concatenate([frames, rest[None]])
    heights = [rows * _panel_height(all_points, width=1.7) + 0.4, *([2.6] if curves else [])]
    figure = Figure(figsize=(1.7 * COLUMNS, sum(heights)), layout="constrained")
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    axes = parts[0].subplots(rows, COLUMNS, squeeze=False).ravel()
    for ax, points, time in zip(axes, frames, times, strict=False):
        _plot_line(ax, rest, closed=True, colour=REST, width=0.8)
        _plot_line(ax, points, closed=True)
        ax.set_title(f"τ = {time:.3g}", fontsize=8)
    for ax in axes:
        _fit_axes(ax, all_points)
    parts[0].suptitle(title, fontsize=10)
    if curves:
        _plot_remaining_displacement(parts[1].subplots(), curves)
    return figure


def _plot_remaining_displacement(ax: Axes, curves: Mapping[str, tuple[Array, Array]]) -> None:
    """Plot over time how much of a displacement remains, a line for each curve.

    curves: by name, times (k,) and shares (k,) of the first displacement.
    """
    for colour, (name, (times, shares)) in zip((INK, OTHER), curves.items(), strict=False):
        ax.plot(times, shares, color=colour, lw=1.3, label=name)
        ax.set_xlim(0, times[-1])
    ax.set(xlabel="τ", ylabel="RMS displacement, first = 1", ylim=(0, None))
    ax.legend(fontsize=9, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False)


def figure7(
    shapes: Sequence[tuple[str, Array]], times: Array, title: str, fine: Array | None = None
) -> Figure:
    """Draw Fig. 7 of the curve paper: a moving curve, one row for each number of control points.

    shapes: pairs (name of the row, closed curves (t, n, 2) at the times (t,)). fine (t, n, 2): the
    solution at all points, drawn in grey behind each row.
    """
    all_points = np.concatenate([frames for _, frames in shapes])
    height = len(shapes) * _panel_height(all_points, width=1.5) + 0.5
    figure = Figure(figsize=(1.5 * len(times) + 0.6, height), layout="constrained")
    rows = figure.subplots(len(shapes), len(times), squeeze=False)
    for index, (row, (name, frames)) in enumerate(zip(rows, shapes, strict=True)):
        for column, (ax, time, points) in enumerate(zip(row, times, frames, strict=True)):
            if fine is not None:
                _plot_line(ax, fine[column], closed=True, colour=REST, width=0.8)
            _plot_line(ax, points, closed=True)
            _fit_axes(ax, all_points)
            if index == 0:
                ax.set_title(f"τ = {time:.3g}", fontsize=8)
        _write_row_name(row[0], f"({'abcdefgh'[index]}) {name}")
    figure.suptitle(title, fontsize=10)
    return figure
