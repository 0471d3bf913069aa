"""Marks in a film: goals, paths, and in a corner time, state and goal (Figs. 16, 18).

For several fish the corner has time and number. Goals and paths are drawn on the floor once and
stay, below the fish; only the caption is new at every tick. Sizes follow the picture's height. The
colours are those of Okabe and Ito, which colour-blind eyes can distinguish.
"""

from collections.abc import Sequence
from itertools import cycle, pairwise
from typing import NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.edit.measures import picture_kinds
from finloop.edit.schema import Goal
from finloop.render.painter import Box, Painter, PlacedFish

COLOURS = {
    "straight": "#0072B2",
    "turn": "#D55E00",
    "slide": "#009E73",
    "accelerate": "#E69F00",
    "decelerate": "#CC79A7",
    "film": "#D55E00",
    "other pose": "#E69F00",
    "mirror image": "#CC79A7",
    "sprite": "#0072B2",
    "prediction": "#009E73",
}
"""Colours of what is shown (`finloop.edit.measures.SHOWN`), or where that is one thing, of the
states."""
_OTHERS = ("#56B4E9", "#F0E442", "#000000")
_WAITING, _CURRENT = (255, 255, 255), (255, 190, 40)  # RGB of goals; a reached one has a dot
_EDGE = (25, 25, 25)  # around bright marks, so that they are visible on a bright tank
_FONT, _REGULAR, _BOLD = cv2.FontFace("sans"), 400, 700
_SHIFT = 4  # cv2 takes sixteenths of a pixel


def row_categories(edit: pd.DataFrame) -> tuple[pd.Series, dict[str, str]]:
    """Return the category that each row of an edit list shows, (rows,), and each category's colour.

    A category is a kind of picture ("film", "sprite", …), or a state of swimming if all rows show
    the same kind. Colours are "#RRGGBB".
    """
    names = picture_kinds(edit)
    names = names if names.nunique() > 1 else edit["state"]
    unknown = [name for name in names.unique() if name not in COLOURS]
    colours = COLOURS | dict(zip(unknown, cycle(_OTHERS), strict=False))
    return names, {name: colours[name] for name in colours if (names == name).any()}


class GoalStretch(NamedTuple):
    """The ticks from `start` to before `stop` in which a fish swims to one goal.

    name: of the goal, "" = the fish wanders.
    """

    name: str
    start: int
    stop: int


def goal_stretches(edit: pd.DataFrame) -> list[GoalStretch]:
    """Return the stretches of one goal each, in order, of an edit list of one fish."""
    goal = edit["goal"].to_numpy()
    edges = [0, *np.flatnonzero(goal[1:] != goal[:-1]) + 1, len(goal)]
    return [GoalStretch(goal[start], int(start), int(stop)) for start, stop in pairwise(edges)]


def rows_with_goal(edit: pd.DataFrame) -> NDArray[np.bool_]:
    """Return a mask (rows,) of an edit list's rows that lead to a goal; all True if none does."""
    has_goal = (edit["goal"] != "").to_numpy()
    return has_goal if has_goal.any() else ~has_goal


def rgb_from_hex(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue, 0 … 255, of a colour "#RRGGBB"."""
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue


def write_text(
    picture: NDArray[np.uint8], text: str, place: tuple[int, int], colour: tuple[int, int, int],
    size: int, weight: int = _REGULAR,
) -> None:  # fmt: skip
    """Write a text into a picture (h, w, 3), which is changed.

    place: x, y px of the base line's left end; colour: red, green, blue, 0 … 255; size: of the
    letters, px; weight: 400 regular, 700 bold.
    """
    # The weight is always given: else cv2 takes that of the text before.
    cv2.putText(picture, text, place, colour, _FONT, size, weight)


class Pen(NamedTuple):
    """Colour (red, green, blue, 0 … 255) and width [px] of a line."""

    colour: tuple[int, int, int]
    width_px: int


class MarkedTrack(NamedTuple):
    """The marks of one fish: its path, and the goals that it heads for.

    places (ticks, 2): the path, px; pens: by tick, for the piece of path that ends there; goals: by
    the tick at which the goal changes, the name of the new one, "" = wandering.
    """

    places: NDArray[np.float64]
    pens: list[Pen]
    goals: dict[int, str]


class MarkPainter:
    """Draws the fish of an edit list and their marks tick by tick, with a painter in colour."""

    def __init__(self, painter: Painter, edit: pd.DataFrame, goals: Sequence[Goal]) -> None:
        """Draw the goals on the floor, and lay out the caption in a corner.

        painter: draws in colour; edit: an edit list, of one or several fish, all equally long.
        """
        height = painter.canvas.shape[0]
        self._painter, self._goals = painter, {goal.name: goal for goal in goals}
        self._size = max(9, round(height / 36))  # of letters, px
        self._line = max(1, round(height / 450))  # width of lines, px
        names, colours = row_categories(edit)
        tick_colours = [rgb_from_hex(colours[name]) for name in names]
        faint_pen = Pen(_faint_colour(painter.floor), 1)
        pens = [
            Pen(colour, self._line) if has_goal else faint_pen
            for colour, has_goal in zip(tick_colours, rows_with_goal(edit), strict=True)
        ]
        places = edit[["x_px", "y_px"]].to_numpy(float)
        self._tracks = [
            MarkedTrack(
                places[rows], [pens[row] for row in rows],
                {stretch.start: stretch.name for stretch in goal_stretches(edit.iloc[rows])},
            )
            for rows in edit.groupby("fish").indices.values()
        ]  # fmt: skip
        # Of the square beside the caption, which is there if there is one fish.
        self._colours = tick_colours if len(self._tracks) == 1 else []
        self._lay_out_caption(edit, places)
        self._current_goals: list[str | None] = [None] * len(self._tracks)  # name, of each fish
        for name in self._goals:
            self._draw_goal(name, _WAITING)

    def _lay_out_caption(self, edit: pd.DataFrame, places: NDArray[np.float64]) -> None:
        """Set the caption's text at every tick, and the places of its parts.

        From left to right: a square if there is one fish, the time, the words. places (rows, 2):
        px, of all fish, which the caption shall not cover.
        """
        fish, ticks = len(self._tracks), len(self._tracks[0].places)
        self._times = [f"{time:.1f} s" for time in edit["time_s"][:ticks]]
        self._words = [f"{fish} fish"] * ticks if fish > 1 else [
            f"{state} → {goal}" if goal else f"{state}, wandering"
            for state, goal in zip(edit["state"], edit["goal"], strict=True)
        ]  # fmt: skip
        gap = self._size // 2
        self._time_x = gap + (self._size + gap) * bool(self._colours)
        self._words_x = self._time_x + self._text_width_px(max(self._times, key=len)) + 2 * gap
        plate_width = self._words_x + max(map(self._text_width_px, set(self._words))) + gap
        plate_size, shape = (plate_width, 2 * self._size), self._painter.canvas.shape[:2]
        self._plate = _find_free_corner(places, plate_size, shape, gap)

    def show(self, tick: int, *fish: PlacedFish) -> None:
        """Draw the fish and all marks of a tick; ticks must come in order, since paths grow."""
        self._draw_floor(tick)
        self._painter.show(*fish)
        self._draw_caption(tick)

    def _draw_floor(self, tick: int) -> None:
        """Draw on the floor what a tick adds: a piece of each path, and changed goals.

        The goal before gets a dot, as it is reached; the new one gets its own colour.
        """
        for fish, track in enumerate(self._tracks):
            if tick in track.goals:
                reached, new = self._current_goals[fish], track.goals[tick]
                if reached in self._goals:
                    self._draw_goal(str(reached), _WAITING, reached=True)
                if new in self._goals:
                    self._draw_goal(new, _CURRENT)
                self._current_goals[fish] = new
            if tick:
                start, stop = track.places[tick - 1], track.places[tick]
                pen, ends = track.pens[tick], (_subpixel_point(start), _subpixel_point(stop))
                cv2.line(self._painter.floor, *ends, pen.colour, pen.width_px, cv2.LINE_AA, _SHIFT)
                self._mark_floor_changed(np.stack([start, stop]), self._line + 2)

    def _draw_caption(self, tick: int) -> None:
        """Draw the caption of a tick: time, state and goal, or the number of fish."""
        box = self._plate
        plate = self._painter.canvas[box.slices]
        np.right_shift(plate, 1, out=plate)  # half as bright: letters are legible on any tank
        size, middle = self._size, (box.top + box.bottom) // 2
        corner = box.left + size // 2, middle - size // 2
        canvas, white = self._painter.canvas, (255, 255, 255)
        if self._colours:
            opposite = corner[0] + size, corner[1] + size
            cv2.rectangle(canvas, corner, opposite, self._colours[tick], cv2.FILLED)
        base = middle + round(0.35 * size)
        write_text(canvas, self._times[tick], (box.left + self._time_x, base), white, size)
        write_text(canvas, self._words[tick], (box.left + self._words_x, base), white, size)
        self._painter.mark_changed(box)

    def _draw_goal(self, name: str, colour: tuple[int, int, int], reached: bool = False) -> None:
        """Draw a goal on the floor: a ring with its name beside it, both with a dark edge.

        colour: RGB, 0 … 255; reached: whether a dot is drawn in the ring.
        """
        goal, line = self._goals[name], self._line
        radius = max(0.7 * self._size, goal.radius_px)
        floor, place = self._painter.floor, (goal.x_px, goal.y_px)
        centre = _subpixel_point(place)
        for tone, edge in ((_EDGE, 1), (colour, 0)):
            ring = round(radius * 2**_SHIFT)
            cv2.circle(floor, centre, ring, tone, line + 2 * edge, cv2.LINE_AA, _SHIFT)
            if reached:
                dot = round((0.28 * self._size + edge) * 2**_SHIFT)
                cv2.circle(floor, centre, dot, tone, cv2.FILLED, cv2.LINE_AA, _SHIFT)
        # The name stands to the right of the ring, or to the left if there is no room.
        left = round(goal.x_px + radius + 0.3 * self._size)
        base, length = round(goal.y_px + 0.35 * self._size), self._text_width_px(name)
        if left + length > floor.shape[1]:
            left = round(goal.x_px - radius - 0.3 * self._size) - length
        for x in (-1, 0, 1):
            for y in (-1, 0, 1):
                write_text(floor, name, (left + x, base + y), _EDGE, self._size, _BOLD)
        write_text(floor, name, (left, base), colour, self._size, _BOLD)
        reach = max(2.0 * self._size, radius + line + 2)
        changed = np.array([place, [left, base], [left + length, base]], float)
        self._mark_floor_changed(changed, reach)

    def _text_width_px(self, text: str) -> int:
        """Return the width [px] of a text in the font of the goals' names."""
        picture_size = 10_000, 100  # large enough for any text
        return int(cv2.getTextSize(picture_size, text, (0, 0), _FONT, self._size, _BOLD)[2])

    def _mark_floor_changed(self, points: NDArray[np.float64], reach: float) -> None:
        """Mark a box of the floor as changed: that of points (n, 2), enlarged by `reach` px."""
        left, top = np.floor(points.min(axis=0) - reach).astype(int)
        right, bottom = np.ceil(points.max(axis=0) + reach).astype(int) + 1
        box = Box(int(top), int(left), int(bottom), int(right))
        self._painter.mark_changed(box.clip_to(self._painter.canvas.shape))


def _faint_colour(floor: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return a faint colour (RGB) for paths without a goal, which suits the floor (h, w, 3).

    The colour is a little darker than a bright floor, or brighter than a dark one.
    """
    median = np.median(floor[::8, ::8].reshape(-1, 3), axis=0)
    red, green, blue = (0.75 * median if median.mean() > 80 else median + 40).astype(int).tolist()
    return red, green, blue


def _subpixel_point(point: Sequence[float] | NDArray[np.float64]) -> tuple[int, int]:
    """Return a point (x, y px) in sixteenths of a pixel, as whole numbers for OpenCV."""
    x, y = (round(float(coordinate) * 2**_SHIFT) for coordinate in point)
    return x, y


def _find_free_corner(
    places: NDArray[np.float64], size: tuple[int, int], shape: tuple[int, int], gap: int
) -> Box:
    """Return the box for a caption, in that corner of the picture where fish are least often.

    places (n, 2): of the fish, px; size: width and height of the caption; shape: height and width
    of the picture; gap: from caption to edge; all px. Of equal corners the first counts: upper
    left, upper right, lower left, lower right.
    """
    width, height = size
    reach = np.array(size) / 2 + 2 * height  # near: within two heights around the plate
    fewest, best = np.inf, Box(0, 0, 0, 0)
    for top in (gap, shape[0] - gap - height):
        for left in (gap, shape[1] - gap - width):
            is_near = np.abs(places - [left + width / 2, top + height / 2]) < reach
            near_ticks = is_near.all(axis=1).sum()
            if near_ticks < fewest:
                fewest, best = near_ticks, Box(top, left, top + height, left + width)
    return best.clip_to(shape)
