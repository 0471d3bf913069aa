"""Pictures of video loops: over the tank, the position table, the best and the worst."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from finloop.distance.map import MapFacts
from finloop.distance.reel import Reel
from finloop.loops.graph import LoopGraph
from finloop.loops.positions import LETTERS
from finloop.plots import parts

LARGEST, OTHER, DEAD = "#0072B2", "#E69F00", "#D55E00"  # Okabe-Ito
_QUADRANTS = ("#F0E442", "#56B4E9", "#CC79A7", "#009E73")
_ARROWS = 60
_HALO = [withStroke(linewidth=3, foreground="white")]

Rows = NDArray[np.integer]


def spread_table_rows(table: pd.DataFrame, most: int) -> pd.DataFrame:
    """Return at most `most` rows of a table, evenly spaced from its first row to its last."""
    count = min(len(table), most)
    return table.iloc[np.linspace(0, len(table) - 1, count).round().astype(int)]


def arc_points(
    a: NDArray[np.floating], b: NDArray[np.floating], longest: float | None = None
) -> NDArray[np.float64]:
    """Return an arc, a half ellipse over a time axis, for each of n time spans: points (n, 40, 2).

    a, b (n,): begin and end of the spans. A point is a time and a height; a span's arc is √(its
    length / longest) high. longest: None = the length of the longest span.
    """
    angle = np.linspace(0, np.pi, 40)
    middle, half = (a + b)[:, None] / 2, (b - a)[:, None] / 2
    height = np.sqrt(half / (half.max(initial=1e-9) if longest is None else longest / 2))
    return np.stack([middle - half * np.cos(angle), height * np.sin(angle)], axis=-1)


def draw_loops_over_tank(
    loops: pd.DataFrame, graph: LoopGraph, features: pd.DataFrame, background: parts.Picture
) -> Figure:
    """Draw loop ends over the empty tank, and arrows for loops within a track (Fig. 11a).

    A colour shows whether the film can be played on for ever from an end. graph: of all loops.
    """
    figure, axes = parts.draw_empty_tank(background, alpha=0.45, key_inches=0.6)
    # The loop ends.
    x, y = features["x_px"].to_numpy(float), features["y_px"].to_numpy(float)
    size = 2.5 if len(graph.segment_frames) > 500 else 5
    dead = ~graph.endless
    for mask, colour, meaning in (
        ((graph.component == 0) & ~dead, LARGEST, "in the largest component"),
        ((graph.component > 0) & ~dead, OTHER, "leads to a loop without end"),
        (dead, DEAD, "no playing on from here"),
    ):
        rows = graph.ends[mask]
        if len(rows):
            label = f"{len(rows)} ends: {meaning}"
            axes.plot(x[rows], y[rows], ".", color=colour, ms=size, label=label)
    # The arrows; a loop between two tracks has no length.
    within = loops[loops["length_s"].notna()].sort_values("length_s")
    drawn = spread_table_rows(within, _ARROWS)
    a, b = drawn["a"].to_numpy(), drawn["b"].to_numpy()
    if len(drawn):
        axes.quiver(
            x[a], y[a], x[b] - x[a], y[b] - y[a], angles="xy", scale_units="xy", scale=1,
            width=0.0018, color="black", alpha=0.75, zorder=3,
        )  # fmt: skip
    count = f"{len(drawn)} of" if len(drawn) < len(within) else "all"
    words = f"what is played between the ends of {count} {len(within)} loops within a track"
    axes.set_title(f"arrows: {words}" if len(drawn) else "no loop lies within one track")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, markerscale=3)
    return figure


def figure11(table: pd.DataFrame, ends: Rows, features: pd.DataFrame) -> Figure:
    """Draw Fig. 11 of the fish paper: a track with its loop ends A, B …, and their position table.

    table: quadrants as texts, "" where there is none. ends: rows of one track, in time order.
    """
    figure = Figure(figsize=(14, 7), layout="constrained")
    path, cells = figure.subplots(1, 2)
    # The track.
    track_id = features["track_id"].to_numpy()
    track = features[track_id == track_id[ends[0]]]
    path.plot(track["x_px"], track["y_px"], color="0.6", lw=1)
    end_rows = features.iloc[ends]
    x, y = end_rows["x_px"].to_numpy(float), end_rows["y_px"].to_numpy(float)
    path.scatter(x, y, c=np.arange(len(ends)), cmap="viridis", s=22, zorder=3)
    side_deg = np.where(np.arange(len(x)) % 2, -90, 90)  # letters to the left and right in turn
    towards = np.radians(end_rows["heading_deg"].to_numpy(float) + side_deg)
    for letter, right_px, down_px, angle in zip(LETTERS, x, y, towards, strict=False):
        path.annotate(
            letter, (right_px, down_px), (11 * np.cos(angle), 11 * np.sin(angle)),
            textcoords="offset points", ha="center", va="center", fontweight="bold",
            path_effects=_HALO, zorder=4,
        )  # fmt: skip
    path.set_aspect("equal", adjustable="datalim")
    path.invert_yaxis()
    title = f"track {track_id[ends[0]]}: loop ends in time order"
    path.set(xlabel="x (px)", ylabel="y (px)", title=title)
    # The table.
    quadrant = table.replace("", "0").to_numpy(int)
    cells.imshow(quadrant, cmap=ListedColormap(["white", *_QUADRANTS]), vmin=0, vmax=4)
    for row, column in zip(*np.nonzero(quadrant), strict=True):
        cells.text(column, row, quadrant[row, column], ha="center", va="center", fontsize=8)
    names = list(table.columns)
    cells.set_xticks(range(len(names)), names)
    cells.set_yticks(range(len(names)), names)
    cells.xaxis.tick_top()
    cells.set_title("quadrant of the column's end, seen from the row's; 1 = upper right")
    return figure


SIZE_PX = 128  # of the pictures of a loop


class TransitionPictures(NamedTuple):
    """Three pictures of a jump or gateway for a contact sheet, and the texts above and below them.

    before: the last picture. natural: the picture that would follow it. instead: the picture that
    is shown. Each is (h, w, c), 0 … 1, premultiplied by its last channel, alpha.
    """

    before: NDArray[np.float32]
    natural: NDArray[np.float32]
    instead: NDArray[np.float32]
    above: str
    below: str = ""


def loop_pictures(loops: pd.DataFrame, reel: Reel, facts: MapFacts) -> Iterator[TransitionPictures]:
    """Yield three pictures of each loop: before the jump, as the film goes on, and after the jump.

    They are the row before the loop's end a, row a, and row b, which the jump shows in place of a.
    Where a track begins at a, row a stands for the row before. loops: columns a, b, distance,
    filtered. reel: the film's cut-outs and features. facts: how the distance map was made.
    """
    track, frame = reel.features["track_id"].to_numpy(), reel.features["frame"].to_numpy()
    for loop in loops.itertuples():
        before = loop.a - 1 if loop.a and track[loop.a - 1] == track[loop.a] else loop.a
        rows = np.array([before, loop.a, loop.b])
        last, natural, instead = reel.draw_rows(rows, SIZE_PX, facts.frame_of_reference)
        places = " → ".join(f"{track[row]}:{frame[row]}" for row in (before, loop.b))
        words = (
            f"track:frame {places}: seam {loop.distance / facts.step_median:.2f} steps, "
            f"filtered {loop.filtered / facts.step_median:.2f}"
        )
        yield TransitionPictures(last, natural, instead, words)


def choose_separate_loops(loops: pd.DataFrame, min_rows_apart: int, count: int) -> list[int]:
    """Choose at most `count` loops whose ends lie apart in time; return their table positions.

    The loops are taken in the order of the table; one with an end that is not more than
    `min_rows_apart` rows from an end of a loop taken before is left out.
    """
    ends, chosen = loops[["a", "b"]].to_numpy(), list[int]()
    for position, pair in enumerate(ends):
        if len(chosen) == count:
            break
        if (np.abs(ends[chosen].reshape(-1, 1) - pair) > min_rows_apart).all():
            chosen.append(position)
    return chosen


def figure8(best: Sequence[TransitionPictures], worst: Sequence[TransitionPictures]) -> Figure:
    """Draw Fig. 8 of the fish paper: four pictures of each of the best and the worst loops.

    They are the last frame, the film's next, the loop's next, and the difference of the last two.
    """
    lines = max(len(best), len(worst))
    pictures = [picture for loop in (*best, *worst) for picture in loop[:3]]
    band = rows_with_fish(np.stack(pictures))
    height_share = (band.stop - band.start) / len(best[0].before)
    figure = Figure(figsize=(14, (1.7 * height_share + 0.3) * lines + 0.6), layout="constrained")
    figure.suptitle(
        "shown last | the film's next frame | the loop's next frame | what differs, × 3",
        fontsize=11,
    )
    halves: NDArray[np.object_] = np.asarray(figure.subfigures(1, 2))
    for half, quality, loops in zip(halves, ("best", "worst"), (best, worst), strict=True):
        half.suptitle(f"the {quality} loops that were kept, by filtered distance", fontsize=11)
        panels = half.subplots(lines, 1, squeeze=False)[:, 0]
        for axes in panels:
            axes.axis("off")
        for axes, loop in zip(panels, loops, strict=False):
            last, natural, instead = (composite_on_light_grey(picture) for picture in loop[:3])
            difference = np.clip(0.5 + 1.5 * (instead - natural), 0, 1)  # grey: none; × 3
            axes.imshow(np.hstack([last, natural, instead, difference])[band])
            axes.set_title(loop.above, fontsize=8, loc="left", pad=2)
    return figure


def composite_on_light_grey(picture: NDArray[np.float32]) -> NDArray[np.floating]:
    """Composite a premultiplied picture (h, w, c) over light grey; return RGB (h, w, 3), 0 … 1."""
    blended = picture[..., :-1] + (1 - picture[..., -1:]) * 0.8
    return np.clip(np.broadcast_to(blended, (*blended.shape[:-1], 3)), 0, 1)


def rows_with_fish(pictures: NDArray[np.float32]) -> slice:
    """Return the slice of pixel rows in which any of k pictures (k, h, w, c) shows fish.

    It has a small margin. The last channel of a picture is its alpha, 0 … 1.
    """
    rows = np.flatnonzero(np.any(pictures[..., -1] > 0.1, axis=(0, 2)))
    return slice(max(rows[0] - 4, 0), rows[-1] + 5)
