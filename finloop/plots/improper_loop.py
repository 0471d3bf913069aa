"""Fig. 13 of the fish paper: an improper loop, along which the fish travels against its heading."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from finloop.base.arrays import Floats, Picture
from finloop.distance.reel import Reel
from finloop.features.current import places_through_water
from finloop.features.table import infer_delta_frames, wrap_deg
from finloop.loops.search import measure_travel
from finloop.plots.loops import SIZE_PX, composite_on_light_grey, rows_with_fish
from finloop.plots.parts import draw_arrow, unit_vectors

_HEADING, _TRAVEL = "#009E73", "#D55E00"  # Okabe-Ito
_HIGH = 0.45  # height of the upper picture, as a share of its width
_DASHED = (0, (2, 1.5))
BETWEEN_ENDS, AT_A, AT_B = range(3)  # where a loop is improper
_PLACES = ("from a to b", "at a", "at b")

Rows = NDArray[np.integer]


class ImproperLoop(NamedTuple):
    """An improper loop: two similar rows a < b between which the fish travels against its heading.

    place: where it does so, BETWEEN_ENDS, AT_A or AT_B. travel_deg, heading_deg: directions at this
    place, anticlockwise. off_deg: the angle between them. filtered: mean picture distance of the
    two rows and their neighbours.
    """

    a: int
    b: int
    place: int
    travel_deg: float
    heading_deg: float
    off_deg: float
    filtered: float


def find_most_improper_loop(
    candidates: pd.DataFrame, features: pd.DataFrame, max_angle_deg: float
) -> ImproperLoop | None:
    """Return the clearest improper loop of the film; None if no pair of rows is improper.

    A pair that is improper between its ends is preferred to one that is improper at an end. Of
    these, the pair whose travel differs most from the heading is taken; a path below one body
    length counts less. candidates: pairs of similar rows, columns a, b, improper, filtered (mean
    distance of them and their neighbours). max_angle_deg: a larger angle is improper.
    """
    pairs = candidates[candidates["improper"]]
    if pairs.empty:
        return None
    a, b = pairs["a"].to_numpy(), pairs["b"].to_numpy()
    travel = measure_travel(a, b, features)  # arrays (pairs, 3): between the ends, at a, at b
    # By how much the travel is off the heading, 0 where it is proper; weighted for short paths.
    fault_deg = np.where(travel.off_deg > max_angle_deg, travel.off_deg, 0.0)
    places = places_through_water(features)
    path_length = np.hypot(*(places[b] - places[a]).T)
    body_length = features["body_length_px"].to_numpy(float)[a]
    fault_deg[:, BETWEEN_ENDS] *= np.minimum(path_length / body_length, 1.0)
    between_ends = fault_deg[:, [BETWEEN_ENDS]]
    considered = between_ends if between_ends.any() else fault_deg
    pair, place = np.unravel_index(int(considered.argmax()), considered.shape)
    return ImproperLoop(
        a=int(a[pair]), b=int(b[pair]), place=int(place),
        travel_deg=float(travel.travel_deg[pair, place]),
        heading_deg=float(travel.heading_deg[pair, place]),
        off_deg=float(travel.off_deg[pair, place]), filtered=float(pairs["filtered"].iloc[pair]),
    )  # fmt: skip


def loop_path_rows(loop: ImproperLoop, features: pd.DataFrame) -> Rows:
    """Return the rows (k,) of a loop's path: from a to b, or Δ/2 to each side of its improper end.

    Δ is the time in which motion is measured. Rows beyond the ends of the track are left out.
    """
    if loop.place == BETWEEN_ENDS:
        return np.arange(loop.a, loop.b + 1)
    end = loop.a if loop.place == AT_A else loop.b
    delta = infer_delta_frames(features)
    rows = end - delta // 2 + np.arange(delta + 1)
    track = features["track_id"].to_numpy()
    rows = rows[(rows >= 0) & (rows < len(track))]
    return rows[track[rows] == track[end]]


def figure13(
    loop: ImproperLoop, reel: Reel, reference: str, background: Picture, headline: str
) -> Figure:
    """Draw Fig. 13 of the fish paper: an improper loop, with the fish's heading and its travel.

    Below are the pictures at both ends. reel: the film's cut-outs and features. reference: FILM or
    BODY, in which the ends were compared. background: the empty tank. headline: the text above the
    figure.
    """
    features = reel.features
    figure = Figure(figsize=(12.5, 8.0), layout="constrained")
    figure.suptitle(headline, fontsize=11)
    heights = _HIGH * 12.5, 2  # inches; the upper part is 12.5 wide
    parts: NDArray[np.object_] = np.asarray(figure.subfigures(2, 1, height_ratios=heights))
    upper, lower = parts
    # The path over the tank, with the fish at its ends.
    path_panel = upper.subplots()
    film = background.copy()
    for row in _rows_to_show(loop).values():
        cutout = reel.cutouts[row]
        height, width = cutout.pixels.shape[:2]
        left, top = cutout.x0_px, cutout.y0_px
        film[top : top + height, left : left + width] = cutout.blend_over(film)
    path_panel.imshow(film, cmap="gray", vmin=0, vmax=255, interpolation="bicubic")
    _draw_loop_path(path_panel, loop, features, film)
    # The pictures at both ends.
    pictures = reel.draw_rows(np.array([loop.a, loop.b]), SIZE_PX, reference)
    band = rows_with_fish(pictures)
    lower.suptitle("the fish at a and b: alike enough for a jump", fontsize=11)
    panels = lower.subplots(1, 2)
    for axes, picture, letter, row in zip(panels, pictures, "ab", (loop.a, loop.b), strict=True):
        axes.imshow(composite_on_light_grey(picture[band]))
        axes.axis("off")
        axes.set_title(f"{letter}: frame {features['frame'].iloc[row]}", fontsize=10)
    return figure


def _rows_to_show(loop: ImproperLoop) -> dict[str, int]:
    """Return the rows at which to draw the fish, by letter: both ends, or the improper end."""
    if loop.place == BETWEEN_ENDS:
        return {"a": loop.a, "b": loop.b}
    return {"a": loop.a} if loop.place == AT_A else {"b": loop.b}


def _draw_loop_path(axes: Axes, loop: ImproperLoop, features: pd.DataFrame, film: Picture) -> None:
    """Draw the fish's path between the ends of a loop, with arrows of its heading and its travel.

    film: the picture below the path; the part that is shown stays inside it.
    """
    rows = loop_path_rows(loop, features)
    part = features.iloc[rows]
    place = part[["x_px", "y_px"]].to_numpy(float)
    head = part[["head_x_px", "head_y_px"]].to_numpy(float)
    length = float(part["body_length_px"].median())  # all arrows are shares of the body length
    # The path, and the heading at its ends.
    axes.plot(*place.T, "-", color="white", lw=1.2)
    axes.plot(*place[[0, -1]].T, "o", color="white", ms=4)
    for letter, row in _rows_to_show(loop).items():
        end = int(np.searchsorted(rows, row))
        ahead = unit_vectors(part["heading_deg"].iloc[end])
        draw_arrow(axes, head[end], head[end] + 0.45 * length * ahead, color=_HEADING, lw=2.5)
        right, down = head[end] + 0.62 * length * ahead
        axes.text(right, down, letter, ha="center", va="center", color=_HEADING, fontweight="bold")
    # The direction of travel, through the middle of the path and at least a body length long.
    reach = max(float(np.hypot(*(place[-1] - place[0]))), length)
    middle, along = place[[0, -1]].mean(0), unit_vectors(loop.travel_deg)
    draw_arrow(axes, middle - along * reach / 2, middle + along * reach / 2, color=_TRAVEL, lw=2.5)
    if loop.place == BETWEEN_ENDS:
        _draw_angle_off_travel(axes, loop, middle, length)
    shown = np.vstack([place, head, head + length / 2, head - length / 2])
    _zoom_to_points(axes, shown, 0.3 * length, film)
    keys = [
        Line2D([], [], color="white", lw=1.2, label="path of the fish, as filmed"),
        Line2D(
            [], [], color=_HEADING, lw=2.5, label=f"heading at {' and '.join(_rows_to_show(loop))}"
        ),
        Line2D([], [], color=_TRAVEL, lw=2.5, label=f"the loop travels, {_PLACES[loop.place]}"),
    ]
    if loop.place == BETWEEN_ENDS:
        keys.append(Line2D([], [], color=_HEADING, lw=2.5, ls=_DASHED, label="mean heading"))
    axes.legend(handles=keys, loc="best", facecolor="0.75", framealpha=0.9)


def _draw_angle_off_travel(axes: Axes, loop: ImproperLoop, middle: Floats, length: float) -> None:
    """Draw a loop's mean heading as an arrow, and its angle to the travel as an arc with a text.

    middle (2,): where both begin, px; length: of the body, px.
    """
    ahead = unit_vectors(loop.heading_deg)
    draw_arrow(axes, middle, middle + 0.75 * length * ahead, color=_HEADING, lw=2.5, ls=_DASHED)
    turned = float(wrap_deg(np.array(loop.heading_deg - loop.travel_deg)))
    angles = loop.travel_deg + np.linspace(0, turned, 40)
    arc = middle + 0.35 * length * unit_vectors(angles)
    axes.plot(*arc.T, color="black", lw=1)
    right, down = middle + 0.58 * length * unit_vectors(loop.travel_deg + turned / 2)
    words = f"{loop.off_deg:.0f}°"
    axes.text(right, down, words, ha="center", va="center", fontweight="bold")


def _zoom_to_points(axes: Axes, points: Floats, margin: float, film: Picture) -> None:
    """Let a panel show points (n, 2) with a margin, both px, within the film if possible."""
    half_size = np.ptp(points, axis=0) / 2 + margin
    # The shorter side is made longer, so that the part has the panel's shape: _HIGH × its width.
    half_size = np.maximum(half_size, half_size[::-1] * (1 / _HIGH, _HIGH))
    left, top = (points.min(0) + points.max(0)) / 2 - half_size
    (height, width), (shown_width, shown_height) = film.shape[:2], 2 * half_size
    left = np.clip(left, -0.5, max(width - 0.5 - shown_width, -0.5))
    top = np.clip(top, -0.5, max(height - 0.5 - shown_height, -0.5))
    axes.set(
        xlim=(left, left + shown_width), ylim=(top + shown_height, top), xticks=[], yticks=[],
        facecolor="0.75",
    )  # fmt: skip
