"""Pictures of a feature table: Fig. 7, trajectories, orientation rose, contact sheet."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import cv2
import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from finloop.base.cutout import Cutouts
from finloop.base.schema import lists_to_points
from finloop.base.stretches import spread_rows
from finloop.features.area import closed_spline_points, control_points
from finloop.features.head import turn_head_first
from finloop.features.metrics import rows_of_longest_track
from finloop.features.swimming_type import LEFT, RIGHT, STRAIGHT, WORDS
from finloop.features.table import count_orientations, orientation_heading_deg
from finloop.plots.parts import (
    Picture,
    convert_to_colour,
    draw_empty_tank,
    draw_heading_arrows,
    join_in_rows,
    unit_vectors,
    write_text,
)

_MOST_TRACKS = 200  # that are drawn; more hide one another
TYPES = {  # Okabe-Ito colours, which colour-blind people distinguish, too
    STRAIGHT: (WORDS[STRAIGHT], "#0072B2"),
    LEFT: (WORDS[LEFT], "#D55E00"),
    RIGHT: (WORDS[RIGHT], "#009E73"),
}


def figure7(features: pd.DataFrame) -> Figure:
    """Draw Fig. 7 of the fish paper for the longest track: (a) motion area, (b) swimming type."""
    track = rows_of_longest_track(features)
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    area, types = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    area.plot(track["frame"], track["motion_area_rel"], lw=0.9, color="0.25")
    for swimming_type, (name, colour) in TYPES.items():
        is_type = (track["swimming_type"] == swimming_type).to_numpy()
        area.fill_between(
            track["frame"], 0, track["motion_area_rel"], where=is_type, color=colour, alpha=0.4,
            label=name, linewidth=0, step=None,
        )  # fmt: skip
    title = f"track {track['track_id'].iloc[0]}, the longest: {len(track)} frames"
    area.set(ylabel="motion area (relative)", ylim=(0, None), title=title)
    area.legend(loc="upper right", ncols=3, frameon=False)
    types.step(track["frame"], track["swimming_type"], where="mid", lw=0.9, color="0.25")
    types.set(xlabel="frame", yticks=(-1, 0, 1), yticklabels=("right", "straight", "left"))
    return figure


def draw_trajectories(features: pd.DataFrame, background: Picture) -> Figure:
    """Draw the paths of at most _MOST_TRACKS tracks over the empty tank, with some headings.

    features: the feature table; background (h, w[, 3]): the empty tank.
    """
    figure, axes = draw_empty_tank(background, alpha=0.6)
    colours = mpl.colormaps["tab20"](np.arange(20))
    tracks = features["track_id"].unique()
    drawn = spread_rows(np.arange(len(tracks)), _MOST_TRACKS)
    sample = features[features["track_id"].isin(tracks[drawn])]
    for number, (_, track) in enumerate(sample.groupby("track_id")):
        colour = colours[number % len(colours)]
        axes.plot(track["x_px"], track["y_px"], color=colour, lw=1.2)
        axes.plot(track["x_px"].iloc[0], track["y_px"].iloc[0], "o", color=colour, ms=5)
        draw_heading_arrows(axes, track.iloc[:: max(1, len(track) // 8)], color=colour)
    share = "" if len(drawn) == len(tracks) else f"; {len(drawn)} of {len(tracks)} tracks"
    axes.set_title(f"dot: a track begins; arrow: heading{share}")
    return figure


def draw_rose(features: pd.DataFrame) -> Figure:
    """Draw the share of frames in each orientation as a polar bar chart, by swimming type."""
    count = count_orientations(features)
    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.add_subplot(projection="polar")
    angle = np.radians(orientation_heading_deg(np.arange(1, count + 1), count))
    base = np.zeros(count)
    for swimming_type, (name, colour) in TYPES.items():
        orientations = features.loc[features["swimming_type"] == swimming_type, "orientation"]
        share = 100 * np.bincount(orientations - 1, minlength=count) / len(features)
        width = 0.9 * angle[1]  # a sector is as wide as angle[1], for orientation 1 is at 0
        axes.bar(angle, share, width=width, bottom=base, color=colour, label=name)
        base += share
    step = -(-count // 12)  # at most 12 orientations are numbered
    axes.set_xticks(angle[::step], [f"{number}" for number in range(1, count + 1, step)])
    axes.set_title("orientation of the head, % of all frames (1 = screen right)")
    axes.legend(loc="lower left", bbox_to_anchor=(-0.08, -0.08), frameon=False)
    return figure


class Specimen(NamedTuple):
    """One fish for a contact sheet: its row of the feature table, its backbone, its picture.

    backbone (n, 2): px of the film, head first. film (h, w) or (h, w, 3): the cut-out over the
    empty tank. x0_px, y0_px: its upper left pixel in the tank.
    """

    row: pd.Series
    backbone: NDArray[np.floating]
    film: Picture
    x0_px: int
    y0_px: int


def read_specimens(
    table: pd.DataFrame, tracks: pd.DataFrame, rows: NDArray[np.intp], cutouts: Cutouts,
    background: Picture,
) -> Iterator[Specimen]:  # fmt: skip
    """Yield the fish in some rows: each with its backbone, and its cut-out over the empty tank.

    table, tracks: the feature table and the tracks, which have the same rows. Backbones run from
    the head. cutouts: by row.
    """
    backbones = turn_head_first(lists_to_points(tracks, "backbone"), table)
    for row in rows.tolist():
        cutout = cutouts[row]
        film = cutout.blend_over(background)
        yield Specimen(table.iloc[row], backbones[row], film, cutout.x0_px, cutout.y0_px)


def choose_rows_to_check(features: pd.DataFrame, count: int) -> NDArray[np.intp]:
    """Return rows for a contact sheet: first doubtful heads, then motion areas of all sizes.

    The first half has the least confidence in head and tail, the worst first, at most three rows of
    a track. The others are spread over the motion areas, the largest first.
    """
    order = features["head_confidence"].to_numpy().argsort(kind="stable")
    track = features["track_id"].iloc[order]
    rank_in_track = track.groupby(track).cumcount().to_numpy()
    doubtful = order[rank_in_track < 3][: count // 2]
    by_area = features["motion_area"].to_numpy().argsort(kind="stable")[::-1]
    spread = by_area[np.linspace(0, len(by_area) - 1, count - len(doubtful)).astype(int)]
    return np.concatenate([doubtful, spread])


def draw_specimens(specimens: Iterable[Specimen], columns: int = 6, size: int = 220) -> Picture:
    """Return a picture of fish in tiles, each with backbone, control points, B-spline and heading.

    columns: tiles per row. size: width of a tile, px. The picture is (h, w, 3), with a key on top.
    """
    rows = join_in_rows([_draw_tile(specimen, size) for specimen in specimens], columns)
    key = np.full((24, rows[0].shape[1], 3), 40, np.uint8)
    colours = {
        "backbone": _BACKBONE, "control points": _CONTROL, "B-spline": _SPLINE, "heading": _HEADING,
    }  # fmt: skip
    for number, (name, colour) in enumerate(colours.items()):
        write_text(key, name, (8 + 130 * number, 16), colour, _LETTERS)
    return np.vstack([key, *rows])


_BACKBONE, _SPLINE, _CONTROL, _HEADING = (255, 220, 0), (255, 60, 60), (255, 255, 255), (0, 255, 90)
_WORDS, _LETTERS = (235, 235, 235), 0.38


def _draw_tile(specimen: Specimen, size: int) -> Picture:
    """Return a tile, `size` px wide, with one fish, its measures drawn on it, and a text."""
    # The fish, as large as fits.
    film = convert_to_colour(specimen.film)
    scale = (size - 40) / max(film.shape[:2])  # 30 px above are for the text, 10 px below free
    tile = np.full((size, size, 3), 40, np.uint8)
    big = cv2.resize(film, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    top, left = 30 + (size - 40 - big.shape[0]) // 2, (size - big.shape[1]) // 2
    tile[top : top + big.shape[0], left : left + big.shape[1]] = big

    def to_tile(points: NDArray[np.floating]) -> NDArray[np.int32]:
        """Convert points from px of the film to sixteenths of a tile's pixel, as OpenCV needs."""
        inside = points - [specimen.x0_px, specimen.y0_px] + 0.5
        return np.round(16 * (inside * scale - 0.5 + [left, top])).astype(np.int32)

    # Its measures.
    control = control_points(specimen.backbone[None])[0]
    style: dict[str, int] = {"lineType": cv2.LINE_AA, "shift": 4}
    spline = to_tile(closed_spline_points(control))
    cv2.polylines(tile, [spline], isClosed=True, color=_SPLINE, **style)
    cv2.polylines(tile, [to_tile(specimen.backbone)], isClosed=False, color=_BACKBONE, **style)
    for x, y in to_tile(control):
        cv2.circle(tile, (int(x), int(y)), 40, _CONTROL, cv2.FILLED, **style)  # radius 2.5 px
    row, head = specimen.row, specimen.backbone[0]
    ahead = 0.25 * row["body_length_px"] * unit_vectors(row["heading_deg"])
    start, end = to_tile(np.stack([head, head + ahead]))
    ends = tuple(map(int, start)), tuple(map(int, end))
    cv2.arrowedLine(tile, *ends, _HEADING, 2, cv2.LINE_AA, shift=4, tipLength=0.3)
    # The text.
    swimming_type = TYPES[int(row["swimming_type"])][0]
    above = f"track {row['track_id']:.0f} frame {row['frame']:.0f} {swimming_type}"
    below = f"confidence {row['head_confidence']:.3f}  area {row['motion_area_rel']:.2f}"
    for text, y in ((above, 13), (below, 27)):
        write_text(tile, text, (5, y), _WORDS, _LETTERS)
    return tile
