"""Pictures of an edit list: the trajectory (Fig. 16) and a sheet of consecutive ticks."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.patheffects import withStroke

from finloop.base.stretches import spread_rows
from finloop.edit.schema import FRAME, SPOT, Goal, split_by_fish
from finloop.plots.parts import (
    Picture,
    convert_to_colour,
    crop_with_edge_repeated,
    draw_empty_tank,
    draw_heading_arrows,
    join_in_rows,
)
from finloop.render.marks import (
    goal_stretches,
    rgb_from_hex,
    row_categories,
    rows_with_goal,
    write_text,
)
from finloop.render.painter import Painter, PlacedFish

_WANDERING = "0.35"
_HALO = [withStroke(linewidth=2.5, foreground="white")]


def draw_trajectory(edit: pd.DataFrame, goals: Sequence[Goal], background: Picture) -> Figure:
    """Draw Figs. 16, 17 of the fish paper: the fish's path over the empty tank, and its goals.

    The path's colour shows the source of the picture, or the state where all have one source. Each
    goal has the time at which it was reached. Crosses: the fish stays on the spot, for example
    where every route leaves the tank (§4.2). Diamonds: gateways (A, B of Fig. 17).
    """
    figure, axes = draw_empty_tank(background, alpha=0.45, key_inches=0.5)
    key = _draw_paths(axes, edit)
    _draw_goals(axes, edit, goals)
    # The crosses and diamonds. A reason holds until the next one; at a gateway a fish changes its
    # kind, sprite or frame.
    on_the_spot = edit["reason"].ffill() == SPOT
    at_gateway = edit["kind"] != edit.groupby("fish")["kind"].shift().fillna(edit["kind"])
    for mask, marker, label in (
        (on_the_spot, "x", "on the spot"),
        (at_gateway, "D", "gateway"),
    ):  # fmt: skip
        marked = edit[mask.to_numpy(bool)]
        if len(marked):
            style: dict[str, Any] = {"color": "black", "ls": "", "ms": 4, "marker": marker}
            axes.plot(marked["x_px"], marked["y_px"], zorder=4, **style)
            key.append(Line2D([], [], label=label, **style))
    key.append(Line2D([], [], marker="o", mfc="white", mec="black", ls="", label="start"))
    figure.legend(handles=key, loc="outside lower center", ncols=len(key), frameon=False)
    return figure


def _draw_goals(axes: Axes, edit: pd.DataFrame, goals: Sequence[Goal]) -> None:
    """Draw a ring around each goal, with its name and the time at which a fish has reached it."""
    reached_s = {}
    for rows in split_by_fish(edit):
        for name, _, stop in goal_stretches(rows):
            if stop < len(rows):  # else the animation ends on the way to the goal
                reached_s[name] = rows["time_s"].iloc[stop]
    for goal in goals:
        reached = goal.name in reached_s
        text = f"{goal.name}  {reached_s[goal.name]:.1f} s" if reached else goal.name
        ring = Circle((goal.x_px, goal.y_px), goal.radius_px, fill=False, lw=1.8, zorder=4)
        axes.add_patch(ring)
        axes.plot(goal.x_px, goal.y_px, "+", color="black", ms=7, mew=1.4, zorder=4)
        axes.annotate(
            text, (goal.x_px, goal.y_px), (11, 8), textcoords="offset points", fontsize=12,
            fontweight="bold", path_effects=_HALO, zorder=5,
        )  # fmt: skip


def _draw_paths(axes: Axes, edit: pd.DataFrame) -> list[Line2D]:
    """Draw the path of each fish, with its start and some headings; return the key of the colours.

    A thin grey line is swimming without a goal.
    """
    # The path as a line per tick, in the colour of its source or state.
    names, colours = row_categories(edit)
    places, fish = edit[["x_px", "y_px"]].to_numpy(float), edit["fish"].to_numpy()
    later = np.flatnonzero(fish[1:] == fish[:-1]) + 1  # rows that follow one of the same fish
    steps = np.stack([places[later - 1], places[later]], axis=1)  # (n, 2 ends, 2)
    has_goal = rows_with_goal(edit)[later]
    name_of_step = names.to_numpy()[later]
    wandering = list(steps[~has_goal])
    axes.add_collection(LineCollection(wandering, colors=_WANDERING, lw=0.7, alpha=0.7))
    for name, colour in colours.items():
        lines = list(steps[has_goal & (name_of_step == name)])
        axes.add_collection(LineCollection(lines, colors=colour, lw=2.4, capstyle="round"))
    # About twelve headings, from the 13th tick on, the starts, and the key.
    to_goals = edit.iloc[later[has_goal]]
    about_twelve = to_goals.iloc[min(12, len(to_goals)) :: max(1, len(to_goals) // 12)]
    draw_heading_arrows(axes, about_twelve, color="black", zorder=3)
    starts = edit.groupby("fish").head(1)
    axes.plot(starts["x_px"], starts["y_px"], "o", mfc="white", mec="black", ms=7, zorder=4)
    present = [name for name in colours if (has_goal & (name_of_step == name)).any()]
    key = [Line2D([], [], color=colours[name], lw=2.4, label=name) for name in present]
    if not has_goal.all():
        key.append(Line2D([], [], color=_WANDERING, lw=0.7, label="wandering"))
    return key


TICKS = 40  # on the contact sheet
SWITCHES, BEFORE, AFTER = 12, 3, 5  # rows on their sheet; ticks before each, and from it on


class Tile(NamedTuple):
    """One tick on a contact sheet: the picture around the fish, and the text above it.

    film: (h, w) or (h, w, 3). name: state or source of the picture, which sets the colour. weight:
    share of the picture that fades out, 0 … 1.
    """

    film: Picture
    tick: int
    name: str
    colour: str
    weight: float


def find_liveliest_start(edit: pd.DataFrame, count: int) -> int:
    """Return the first tick of those `count` successive ones in which the heading turns most.

    edit: of one fish. Turns to both sides add up.
    """
    if len(edit) <= count:
        return 0
    heading = np.radians(edit["heading_deg"].to_numpy(float))
    change = np.abs(np.diff(np.unwrap(heading), prepend=heading[:1]))
    change_before = np.cumsum(np.r_[0.0, change])
    return int(np.argmax(change_before[count:] - change_before[:-count]))


def choose_switch_ticks(edit: pd.DataFrame, tracks: pd.DataFrame, most: int) -> list[int]:
    """Return ticks, rising, at which another part of the film, a sprite or a cross-fade begins.

    There are at most `most`, spread over the animation. Half of them, rounded down, or more are
    switches between sprite and frame, if there are so many. edit: of one fish.
    """
    # All such ticks.
    kind = edit["kind"].to_numpy()
    fades = (edit["weight"] > 0).to_numpy()  # ticks within a cross-fade
    changes_kind = np.append(False, kind[1:] != kind[:-1])
    is_frame = kind == FRAME
    # Track and frame that each tick shows; a jump leads to another than the track's next frame.
    filmed = tracks[["track_id", "frame"]].to_numpy()[np.where(is_frame, edit["source"], 0)]
    jumps = (np.diff(filmed, axis=0) != (0, 1)).any(axis=1) & is_frame[1:] & is_frame[:-1]
    fade_begins = fades & ~np.append(False, fades[:-1])
    switches = np.flatnonzero(changes_kind)
    others = np.flatnonzero((np.append(False, jumps) | fade_begins) & ~changes_kind)
    # The choice: more switches than half only where the others are too few.
    total = min(most, len(switches) + len(others))
    switch_count = min(len(switches), max(total - len(others), total // 2))
    chosen = spread_rows(switches, switch_count), spread_rows(others, total - switch_count)
    return np.sort(np.concatenate(chosen)).tolist()


def choose_sheet_ticks(edit: pd.DataFrame, tracks: pd.DataFrame) -> dict[str, list[int]]:
    """Return the ticks to draw on each of two sheets, "contact_sheet" and "switches".

    The first shows successive ticks in which the heading turns most, the second the ticks around
    each of some switches, see `choose_switch_ticks`.
    """
    start, count = find_liveliest_start(edit, TICKS), len(edit)
    switches = choose_switch_ticks(edit, tracks, SWITCHES)
    around = [tick for switch in switches for tick in ticks_around_switch(switch, count)]
    return {"contact_sheet": [*range(start, min(start + TICKS, count))], "switches": around}


def ticks_around_switch(tick: int, count: int) -> range:
    """Return the ticks to show around a switch: `BEFORE` ticks before it, `AFTER` from it on.

    They are moved into 0 … count − 1, where count is the number of ticks of the animation.
    """
    first = max(0, min(tick - BEFORE, count - BEFORE - AFTER))
    return range(first, min(first + BEFORE + AFTER, count))


def cut_tiles(
    edit: pd.DataFrame, ticks: Sequence[int], fish: Iterable[PlacedFish], painter: Painter,
    half_px: int,
) -> list[Tile]:  # fmt: skip
    """Return a tile of the tank around the fish at each of the given ticks of an edit list.

    fish: where to draw it at these ticks. half_px: half the width of a tile in the tank.
    """
    names, colours = row_categories(edit)
    tiles = []
    for tick, placed in zip(ticks, fish, strict=True):
        painter.show(placed)
        left, top = round(placed.x_px) - half_px, round(placed.y_px) - half_px
        film = crop_with_edge_repeated(painter.frame, left, top, 2 * half_px + 1, 2 * half_px + 1)
        tiles.append(Tile(film, tick, names[tick], colours[names[tick]], placed.weight))
    return tiles


def draw_tiles(tiles: Sequence[Tile], columns: int = BEFORE + AFTER, size: int = 150) -> Picture:
    """Return a picture (h, w, 3) of tiles side by side in rows, each below a bar in its colour.

    columns: tiles per row. size: width of a tile in px. Without tiles the picture is white.
    """
    white = np.full((size + 20, size + 2, 3), 255, np.uint8)
    return np.vstack(join_in_rows([_draw_tile(tile, size) for tile in tiles] or [white], columns))


def _draw_tile(tile: Tile, size: int) -> Picture:
    """Return a tile, `size` px wide, below a bar that states its tick, name and fading.

    A white frame of 1 px surrounds both.
    """
    big = cv2.resize(convert_to_colour(tile.film), (size, size), interpolation=cv2.INTER_CUBIC)
    bar = np.full((18, size, 3), 255, np.uint8)
    bar[:, :5] = rgb_from_hex(tile.colour)
    share = f"  {100 * tile.weight:.0f} %" if tile.weight > 0 else ""
    write_text(bar, f"{tile.tick} {tile.name}{share}", (9, 13), (0, 0, 0), size=12)
    white_frame = (1, 1), (1, 1), (0, 0)
    return np.pad(np.vstack([bar, big]), white_frame, constant_values=255)
