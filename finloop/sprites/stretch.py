"""Stretches: successive frames of one track, chosen or listed by hand, and how they turn."""

import re
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from finloop.base.arrays import Floats
from finloop.base.errors import FinloopError
from finloop.features.swimming_type import LEFT, RIGHT

SIDES = {"left": LEFT, "right": RIGHT}
WORDS = ("straight", "slide", *SIDES)
"""The sequences of sprites."""


@dataclass(frozen=True)
class FrameRun:
    """Successive frames of one track, as candidates for sprites.

    first, last: frame numbers, both included; rows: the same frames in the table of `swimmers`;
    faults: by name, 1 is just acceptable.
    """

    track_id: int
    first: int
    last: int
    rows: slice
    faults: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.rows.stop - self.rows.start

    @property
    def cost(self) -> float:
        """Return the sum of the faults; about 1 for each that is just acceptable."""
        return sum(self.faults.values())


def parse_frame_run(table: pd.DataFrame, word: str, text: str, hold: float) -> FrameRun:
    """Parse the frames that `sprites.<word>_frames` gives to a sequence, as "track:first-last".

    table: from `swimmers`; hold: see `phases`. FinloopError if the form is wrong, if there are no
    such frames, or if those of a turn do not bend between the first and the last.
    """
    name = f"sprites.{word}_frames={text}"
    form = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*-\s*(\d+)\s*", text)
    if form is None:
        raise FinloopError(
            name, 'a track and its first and last frame, as "8:120-140"', "write it in this form"
        )
    number, first, last = map(int, form.groups())
    ids = table["track_id"].unique()
    track = np.flatnonzero(table["track_id"] == number)
    if not track.size:
        raise FinloopError(
            f"{name}: there is no track {number}",
            "one of " + ", ".join(map(str, ids[:40])) + (", …" if len(ids) > 40 else ""),
            "see reports/features/trajectories.png and data/features/features.parquet",
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
    stretch = FrameRun(number, first, last, slice(int(rows[0]), int(rows[-1]) + 1))
    if word in SIDES and "hold" not in phases(table, stretch, SIDES[word], hold):
        raise FinloopError(
            f"{name}: the fish does not bend to the {word} between its first and last frame",
            f"frames before, during and after a bend to the {word}",
            "list frames of a turn to that side (reports/features/fig7.png shows where they are)",
        )
    return stretch


def phases(table: pd.DataFrame, stretch: FrameRun, side: int, hold: float) -> list[str]:
    """Return the phase of each frame of a turn: "in", "hold" or "out"; ["none"] without a bend.

    side: 1 = left, −1 = right. The phase is hold where the bend is at least the share `hold` of its
    largest value.
    """
    bend = side * table["bend"].to_numpy()[stretch.rows]
    peak = int(bend.argmax())
    if bend[peak] <= 0 or peak in (0, len(bend) - 1):
        return ["none"]
    strong = bend >= hold * bend[peak]
    first = peak - int(np.argmin(np.r_[strong[:peak][::-1], False]))
    last = peak + int(np.argmin(np.r_[strong[peak + 1 :], False]))
    first, last = max(first, 1), min(last, len(bend) - 2)
    return ["in"] * first + ["hold"] * (last - first + 1) + ["out"] * (len(bend) - 1 - last)


def cycle_heading(table: pd.DataFrame, start: int, n: int) -> Floats:
    """Return headings [°] on a line (n + 1,) for n straight frames and the frame after them.

    start: row of `table` of the first frame. The slope is the drift from the first frame to that
    after the last. Both show the same phase of the tail beat, so the head's yaw, which a
    least-squares line would follow, cancels.
    """
    heading = table["heading"].to_numpy()[start : start + n + 1]
    slope = (heading[-1] - heading[0]) / n
    return heading[:-1].mean() + slope * (np.arange(n + 1) - (n - 1) / 2)
