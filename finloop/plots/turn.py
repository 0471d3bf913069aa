"""Fig. 5 of the fish paper: a turn in frames t0, t0 + k, t0 + 2k, and its measures."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.features.area import closed_spline_points, control_points
from finloop.features.swimming_type import STRAIGHT, WORDS
from finloop.features.table import infer_delta_frames
from finloop.plots.features import Specimen
from finloop.plots.parts import crop_with_edge_repeated, draw_arrow, unit_vectors

_BACKBONE, _AREA, _HEADING = "#0072B2", "#D55E00", "#009E73"  # Okabe-Ito
_MOST = 6  # Δ between two frames of the figure
_SURE = 0.9  # least confidence in head and tail
_WINDOW = 1.6  # body lengths, the side of a picture


def find_strongest_turn(features: pd.DataFrame) -> NDArray[np.intp] | None:
    """Return the rows (3,) of the film's strongest clear turn; None if there is no clear turn.

    They are at frames t0, t0 + k and t0 + 2k. k is the least multiple of Δ, up to `_MOST` Δ, with a
    clear turn. Such a turn begins with straight swimming, goes to one side over both k, and bends
    the fish most in the middle. The strongest one changes the heading most.
    """
    delta = infer_delta_frames(features)
    if delta == 0:  # no row lacks a displacement: Δ is unknown
        return None
    for k in range(delta, _MOST * delta + 1, delta):
        turn_deg = _clear_turn_deg(features, k, delta)
        if turn_deg.any():  # one value for each row at which the turn may begin
            return turn_deg.argmax() + k * np.arange(3)
    return None


def _clear_turn_deg(features: pd.DataFrame, k: int, delta: int) -> Floats:
    """Return how many degrees the heading turns in the 2k frames after each row, (rows − 2k,).

    The result is ≥ 0, and 0 without a clear turn. k, delta: the time between two pictures, and the
    time in which motion is measured, in frames.
    """
    first = np.arange(max(len(features) - 2 * k, 0))
    middle, last = first + k, first + 2 * k
    track, area = features["track_id"].to_numpy(), features["motion_area"].to_numpy()
    swimming_type = features["swimming_type"].to_numpy()  # left 1, straight 0, right −1
    least_confidence = features["head_confidence"].rolling(2 * k + 1).min().to_numpy()[last]
    first_half = heading_change_deg(features, first, k, delta)
    second_half = heading_change_deg(features, middle, k, delta)
    side = np.sign(first_half)  # as a swimming type
    is_followed = (least_confidence >= _SURE) & (track[first] == track[last])
    begins_straight = (swimming_type[first] == STRAIGHT) & (side != STRAIGHT)
    goes_on = (swimming_type[middle] == side) & (np.sign(second_half) == side)
    bends_most_amid = area[middle] >= np.maximum(area[first], area[last])
    is_clear = is_followed & begins_straight & goes_on & bends_most_amid
    return np.where(is_clear, np.abs(first_half + second_half), 0.0)


def heading_change_deg(
    features: pd.DataFrame, rows: NDArray[np.integer], k: int, delta: int
) -> Floats:
    """Return how many degrees the heading turns in the k frames after each of n rows: (n,).

    Positive is left. k: a multiple of `delta`, the time in which motion is measured, in frames.
    """
    angle = features["included_angle_deg"].to_numpy(float)  # by how much the heading changes over Δ
    return np.asarray(angle[rows[:, None] + np.arange(0, k, delta)].sum(axis=1))


def figure5(
    features: pd.DataFrame, rows: NDArray[np.intp], fish: Sequence[Specimen], background: Picture
) -> Figure:
    """Draw Fig. 5 of the fish paper: the fish at three rows of a turn, and the turn over time.

    rows (3,): at frames t0, t0 + k, t0 + 2k. fish: at each of these rows the fish with its
    measures. background: the empty tank.
    """
    figure = Figure(figsize=(12.5, 11.5), layout="constrained")
    parts: NDArray[np.object_] = np.asarray(figure.subfigures(2, 1, height_ratios=(8.4, 2.8)))
    upper, lower = parts
    # The pictures: as filmed above, with the measures below.
    panels = upper.subplots(2, len(rows))
    side = round(_WINDOW * max(float(specimen.row["body_length_px"]) for specimen in fish))
    delta, k = infer_delta_frames(features), int(rows[1] - rows[0])
    turns_deg = [None, *heading_change_deg(features, rows[:-1], k, delta).tolist()]
    times = "(a)  t0", "(b)  t0 + k", "(c)  t0 + 2k"
    for number, (specimen, turned_deg) in enumerate(zip(fish, turns_deg, strict=True)):
        filmed, measured = panels[:, number]
        film, corner = _crop_around_fish(specimen, background, side)
        for axes in (filmed, measured):
            axes.imshow(film, cmap="gray", vmin=0, vmax=255, interpolation="bicubic")
            axes.axis("off")
        filmed.set_title(f"{times[number]}: frame {specimen.row['frame']:.0f}")
        _draw_measures(measured, specimen, corner, turned_deg)
        measured.set_title(_describe_measures(specimen, number, turned_deg), fontsize=11)
    # The texts, and the turn over time.
    in_deltas = "Δ" if k == delta else f"{k // delta}Δ"
    frames = f"k = {in_deltas} = {k} frame{'s' if k > 1 else ''}"
    # The film begins at frame 0 and 0 s, so this quotient is the seconds from frame to frame.
    track, frame_s = fish[0].row["track_id"], fish[-1].row["time_s"] / fish[-1].row["frame"]
    handles = [
        *panels[1, 0].get_legend_handles_labels()[0],  # what `_draw_measures` has drawn
        Line2D([], [], color=_HEADING, lw=2.5, label="heading"),
        Line2D([], [], color="0.35", lw=1.5, ls=(0, (3, 2)), label="heading k before"),
    ]
    upper.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    upper.suptitle(f"track {track:.0f}; {frames} = {k * frame_s:.2f} s", fontsize=11)
    _draw_turn_over_time(lower, features, rows, k)
    return figure


def _describe_measures(specimen: Specimen, number: int, turned_deg: float | None) -> str:
    """Return a picture's title with its measures: motion area, swimming type, included angle.

    number: of the picture, from 0. turned_deg: degrees since the previous picture, None for the
    first.
    """
    row = specimen.row
    title = f"({'abc'[number]}′)  motion area {row['motion_area_rel']:.2f}, "
    title += f"swimming type: {WORDS[int(row['swimming_type'])]}\n"
    if turned_deg is not None:
        angle = f"{turned_deg:+.0f}".replace("-", "−")
        title += f"included angle {angle}° since ({'abc'[number - 1]})"
    return title


def _crop_around_fish(
    specimen: Specimen, background: Picture, side: int
) -> tuple[Picture, NDArray[np.intp]]:
    """Return a square of the tank around a fish, and x, y of its upper left pixel.

    side: of the square in px. Beyond the tank's edge its last pixels are repeated.
    """
    film, (height, width) = background.copy(), specimen.film.shape[:2]
    x0, y0 = specimen.x0_px, specimen.y0_px
    film[y0 : y0 + height, x0 : x0 + width] = specimen.film
    low, high = specimen.backbone.min(0), specimen.backbone.max(0)
    corner = np.round((low + high - side) / 2).astype(np.intp)
    left, top = corner.tolist()
    return crop_with_edge_repeated(film, left, top, side, side), corner


def _draw_measures(
    axes: Axes, specimen: Specimen, corner: NDArray[np.intp], turned_deg: float | None
) -> None:
    """Draw the motion area, the backbone and the heading over a picture of the fish.

    corner: x, y of the picture's upper left pixel in the tank. turned_deg: as in
    `_describe_measures`.
    """
    axes.images[0].set_alpha(0.55)
    limits = axes.get_xlim(), axes.get_ylim()
    backbone = specimen.backbone - corner
    control = control_points(backbone[None])[0]
    curve = closed_spline_points(control)
    axes.fill(*curve.T, color=_AREA, alpha=0.35, lw=0, label="motion area")
    axes.plot(*np.vstack([curve, curve[:1]]).T, color=_AREA, lw=1.6, label="closed B-spline")
    axes.plot(*backbone.T, color=_BACKBONE, lw=2, label="backbone")
    axes.plot(
        *control.T, "o", ms=6, mfc="white", mec=_BACKBONE, mew=1.5, zorder=4,
        label="control points: head, 1/6, 1/3, 1/2, 5/6, tail",
    )  # fmt: skip
    head, heading = control[0], specimen.row["heading_deg"]
    reach = 0.25 * float(specimen.row["body_length_px"])
    if turned_deg is not None:
        before = heading - turned_deg
        ahead = head + reach * unit_vectors(before)
        draw_arrow(axes, head, ahead, color="0.35", ls=(0, (3, 2)), lw=1.5)
        arc = head + 0.6 * reach * unit_vectors(before + np.linspace(0, turned_deg, 40))
        axes.plot(*arc.T, color="0.35", lw=1)
    draw_arrow(axes, head, head + reach * unit_vectors(heading), color=_HEADING, lw=2.5)
    axes.set(xlim=limits[0], ylim=limits[1])


def _draw_turn_over_time(
    subfigure: SubFigure, features: pd.DataFrame, rows: NDArray[np.intp], k: int
) -> None:
    """Draw motion area and heading over a turn and k frames around; lines mark its rows (3,)."""
    track = features["track_id"].to_numpy()
    shown = np.arange(max(rows[0] - k, 0), min(rows[-1] + k + 1, len(features)))
    shown = shown[track[shown] == track[rows[0]]]
    frame = features["frame"].to_numpy()
    area = features["motion_area_rel"].to_numpy(float)
    turned_deg = np.unwrap(features["heading_deg"].to_numpy(float)[shown], period=360)
    turned_deg -= turned_deg[np.searchsorted(shown, rows[0])]
    axes = subfigure.subplots()
    axes.plot(frame[shown], area[shown], ".-", color=_AREA, label="motion area (left)")
    axes.set(xlabel="frame", ylabel="motion area (relative)", ylim=(0, None))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    heading_axes = axes.twinx()
    heading_axes.plot(
        frame[shown], turned_deg, ".-", color=_HEADING, label="heading since t0 (right)"
    )
    heading_axes.set(ylabel="heading since t0 (°, + = left)")
    for row, letter in zip(rows, "abc", strict=True):
        axes.axvline(frame[row], color="0.5", lw=0.8, ls=":")
        axes.annotate(
            letter, (frame[row], 1), (0, 4), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontweight="bold",
        )  # fmt: skip
    subfigure.legend(loc="outside lower center", ncols=2, frameon=False)
