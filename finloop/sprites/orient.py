"""Sprites: a few frames of the film, turned to fill all orientations (fish paper §3.3)."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from finloop.base.cutout import Cutout, Cutouts
from finloop.base.schema import Column, Schema
from finloop.errors import FinloopError
from finloop.features.table import direction_deg, orientations_of, wrap_deg
from finloop.sprites import pick
from finloop.sprites.pick import SIDES, WORDS, Stretch, smooth
from finloop.sprites.settings import Settings
from finloop.sprites.turn import Placed, turned

BACK_DEG = 8.0  # half a sector of 24


SPRITES = Schema(
    (
        Column("sprite", "int16", "1"),
        Column("sequence", "string", "1"),
        Column("step", "int16", "1"),
        Column("phase", "string", "1"),
        Column("row", "int32", "1"),
        Column("track_id", "int32", "1"),
        Column("frame", "int32", "1"),
        Column("mirrored", "bool", "1"),
        Column("x_px", "float64", "px"),
        Column("y_px", "float64", "px"),
        Column("heading_deg", "float32", "deg"),
        Column("head_offset_deg", "float32", "deg"),
        Column("scale", "float32", "1"),
        Column("motion_area_rel", "float32", "1"),
        Column("bend", "float32", "body length²"),
        Column("forward", "float32", "body length"),
        Column("sideways", "float32", "body length"),
        Column("turn_deg", "float32", "deg"),
        Column("orientations", "int8", "1"),
    )
)


@dataclass(frozen=True)
class Choice:
    """The film's frames for one sequence; `mirrored` where the other side's turn stands in."""

    stretch: Stretch
    mirrored: bool = False


def placed(cutout: Cutout) -> Placed:
    """A cut-out of the store, to be turned."""
    return Placed(cutout.pixels, cutout.x0_px, cutout.y0_px)


def choose(
    table: pd.DataFrame, look: pick.Look, rate_hz: float, settings: Settings
) -> dict[str, Choice]:
    """Find the frames of each sequence of `WORDS`, but for those that the settings list.

    `table` is `sprites.pick.swimmers`. A side without a turn gets the other one mirrored.

    Raises
    ------
    FinloopError
        If frames are listed that do not exist, or there is no tail beat, or no turn.
    """
    sharp = _typical_sharpness(table, look)
    found: dict[str, Sequence[Stretch]] = {}
    for word in WORDS:
        asked = getattr(settings, word)
        if asked is not None:
            found[word] = [_listed(table, word, asked)]
        elif word in SIDES:
            found[word] = pick.pictured(
                table, pick.turns(table, SIDES[word]), look, sharp, loops=False
            )
        else:
            candidates = (
                pick.beats(table, rate_hz)
                if word == "straight"
                else pick.slides(table, rate_hz, settings.slide_least_s, settings.slide_most_s)
            )
            found[word] = pick.pictured(table, candidates, look, sharp, loops=True)
    _enough(found)
    chosen = {word: Choice(one) for word, one in pick.together(table, found).items()}
    if "slide" not in chosen:  # nothing glides: the straightest there is
        chosen["slide"] = chosen["straight"]
    for word, other in (("left", "right"), ("right", "left")):
        if word not in chosen:
            chosen[word] = Choice(chosen[other].stretch, mirrored=True)
    return {word: chosen[word] for word in WORDS}


def _typical_sharpness(table: pd.DataFrame, look: pick.Look, sample: int = 200) -> float:
    usable = np.flatnonzero(table["usable"])
    if not usable.size:
        raise FinloopError(
            "no frame of the film can become a sprite: everywhere head and tail are in doubt "
            f"(head_confidence < {pick.SURE}), or the length is not the animal's, or another fish "
            "is near",
            "frames of one fish, clear of others",
            "film fewer fish, or a longer clip; or list frames in conf/sprites/default.yaml",
        )
    rows = usable[np.linspace(0, usable.size - 1, min(sample, usable.size)).astype(int)]
    return float(np.median(pick.sharpness(look(rows, table["heading"].to_numpy()[rows]))))


def _enough(found: dict[str, Sequence[Stretch]]) -> None:
    """Stop where the film shows no tail beat, or no turn to either side."""
    do = "take a longer clip, or list frames, e.g. sprites.{}=8:120-140"
    if not found["straight"]:
        raise FinloopError(
            "no full tail beat in the film: no straight stretch of one track swings its tail once "
            f"to each side in {pick.BEAT_S[0]}-{pick.BEAT_S[1]} s and {pick.BEAT_FRAMES} frames",
            "a fish that swims straight for one tail beat, clear of others",
            do.format("straight") + "; at a low frame rate film faster",
        )
    if not (found["left"] or found["right"]):
        raise FinloopError(
            "no whole turn in the film, neither to the left nor to the right",
            "a fish that bends from straight to one side and back to straight, clear of others",
            do.format("left") + "; or lower features.turn_threshold_deg, features.bend_threshold",
        )


def _listed(table: pd.DataFrame, word: str, asked: str) -> Stretch:
    """The stretch that a person wrote as "track:first-last"."""
    name = f"sprites.{word}={asked}"
    form = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*-\s*(\d+)\s*", asked)
    if form is None:
        raise FinloopError(
            name, 'a track and its first and last frame, as "8:120-140"', "write it so"
        )
    number, first, last = map(int, form.groups())
    ids = table["track_id"].unique()
    track = np.flatnonzero(table["track_id"] == number)
    if not track.size:
        raise FinloopError(
            f"{name}: there is no track {number}",
            "one of " + ", ".join(map(str, ids[:40])) + (", …" if len(ids) > 40 else ""),
            "look at reports/features/trajectories.png and data/features/features.parquet",
        )
    frames = table["frame"].to_numpy()[track]
    least = 3 if word in SIDES else 2
    if last - first + 1 < least:
        raise FinloopError(
            f"{name}: {max(0, last - first + 1)} frames", f"at least {least}", "list more frames"
        )
    rows = track[(frames >= first) & (frames <= last)]
    if len(rows) != last - first + 1:
        raise FinloopError(
            f"{name}: track {number} lacks {last - first + 1 - len(rows)} of these frames",
            f"frames within {frames[0]}-{frames[-1]}, where track {number} is",
            "list frames of that range, or another track",
        )
    stretch = Stretch(number, first, last, slice(int(rows[0]), int(rows[-1]) + 1))
    if word in SIDES and "hold" not in set(phases(table, stretch, SIDES[word])) - {"none"}:
        raise FinloopError(
            f"{name}: the fish does not bend to the {word} between its first and last frame",
            f"frames before, during and after a bend to the {word}",
            "list frames of a turn to that side (reports/features/fig7.png shows where they are)",
        )
    return stretch


def phases(table: pd.DataFrame, stretch: Stretch, side: int) -> list[str]:
    """in, hold, out of each frame of a turn; ["none"] where there is no bend amid it."""
    bend = side * table["bend"].to_numpy()[stretch.rows]
    peak = int(bend.argmax())
    if bend[peak] <= 0 or peak in (0, len(bend) - 1):
        return ["none"]
    held = bend >= pick.HOLD * bend[peak]
    first = peak - int(np.argmin(np.r_[held[:peak][::-1], False]))
    last = peak + int(np.argmin(np.r_[held[peak + 1 :], False]))
    first, last = max(first, 1), min(last, len(bend) - 2)
    return ["in"] * first + ["hold"] * (last - first + 1) + ["out"] * (len(bend) - 1 - last)


def sprite_table(table: pd.DataFrame, chosen: dict[str, Choice]) -> pd.DataFrame:
    """The rows of `SPRITES`: every picked frame, how it moves, and what is turned to where."""
    typical = float(np.median(table["length_px"]))
    rows = pd.concat([_sequence(table, word, one, typical) for word, one in chosen.items()])
    rows.insert(0, "sprite", np.arange(len(rows)))
    return rows.reset_index(drop=True)[[column.name for column in SPRITES.columns]]


def _sequence(table: pd.DataFrame, word: str, choice: Choice, typical_px: float) -> pd.DataFrame:
    stretch, sign = choice.stretch, -1 if choice.mirrored else 1
    here = table.iloc[stretch.rows]
    n = len(here)
    if word in SIDES:
        side = sign * SIDES[word]  # as filmed
        heading = _turn_heading(table, stretch, side)
        phase = phases(table, stretch, side)
    else:
        heading = _line(table, stretch)
        phase = ["cycle"] * n
    angle = np.radians(heading[:-1])
    dx, dy = here["step_x_px"].to_numpy(), here["step_y_px"].to_numpy()
    length = here["length_px"].to_numpy()
    return pd.DataFrame(
        {
            "sequence": word,
            "step": np.arange(n),
            "phase": phase,
            "row": np.arange(len(table))[stretch.rows],
            "track_id": here["track_id"].to_numpy(),
            "frame": here["frame"].to_numpy(),
            "mirrored": choice.mirrored,
            "x_px": here["x_px"].to_numpy(),
            "y_px": here["y_px"].to_numpy(),
            "heading_deg": wrap_deg(heading[:-1]),
            "head_offset_deg": sign * wrap_deg(here["heading"].to_numpy() - heading[:-1]),
            "scale": typical_px / length,
            "motion_area_rel": here["area_rel"].to_numpy(),
            "bend": sign * here["bend"].to_numpy(),
            "forward": (dx * np.cos(angle) - dy * np.sin(angle)) / length,
            "sideways": sign * (-dx * np.sin(angle) - dy * np.cos(angle)) / length,
            "turn_deg": sign * np.diff(heading),
            "orientations": orientations_of(table),
        }
    )


def _line(table: pd.DataFrame, stretch: Stretch) -> NDArray[np.float64]:
    """Heading (n + 1,) of a straight stretch and of the next frame, on a line."""
    rows = _with_next(table, stretch)
    n = len(stretch)
    if rows.stop - rows.start == n + 1:
        return pick.cycle_heading(table, rows.start, n)
    line = pick.cycle_heading(table, rows.start, n - 1)  # the track ends here
    return np.r_[line, 2 * line[-1] - line[-2]]


def _turn_heading(table: pd.DataFrame, stretch: Stretch, side: int) -> NDArray[np.float64]:
    """Heading (n + 1,) of a turn and of the next frame, smoothed; at the ends as measured.

    Where it turns back by no more than `BACK_DEG` in all, it is made not to: that is the smallness
    of the head's own motion and of the noise.
    """
    rows = _with_next(table, stretch)
    heading = smooth(table["heading"].to_numpy()[rows])
    if len(heading) == len(stretch):  # the track ends here
        heading = np.r_[heading, 2 * heading[-1] - heading[-2]]
    if -np.minimum(side * np.diff(heading), 0).sum() <= BACK_DEG:
        heading = side * isotonic_regression(side * heading).x
    return heading


def _with_next(table: pd.DataFrame, stretch: Stretch) -> slice:
    """Rows of a stretch and of the film's next frame, where the track has one."""
    track, after = table["track_id"].to_numpy(), stretch.rows.stop
    more = after < len(table) and track[after] == stretch.track_id
    return slice(stretch.rows.start, after + int(more))


def drawn(sprites: pd.DataFrame, film: Cutouts) -> Iterator[Cutout]:
    """Every sprite in all orientations: the row is sprite · orientations + orientation − 1."""
    for row in sprites.itertuples():
        cutout = film[row.row]
        mirror = row.heading_deg if row.mirrored else None
        for ahead in direction_deg(np.arange(1, row.orientations + 1), row.orientations):
            one = turned(
                placed(cutout), row.x_px, row.y_px, float(ahead) - row.heading_deg,
                mirror_axis_deg=mirror,
            )  # fmt: skip
            yield Cutout(row.track_id, row.frame, one.x0_px, one.y0_px, one.pixels)
