"""Write the normalised clip of a film, check it, and write it again with its faults repaired.

First the pictures are repaired (fields, doubled ones), then their light and shake, which can only
be measured on whole pictures.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np

from finloop.base.arrays import Mask, Picture
from finloop.clip.check import CHECK, CHECK_NAME, TANK_NAME, Clip, Quality, check
from finloop.clip.doubled import Doubled, find_repeats
from finloop.clip.mend import FrameCorrector, field_of, new_pictures, repairs
from finloop.clip.quality import Tally
from finloop.clip.settings import ClipSettings, File
from finloop.clip.write import ClipSource, open_source, write_clip
from finloop.io.footage.source import Order
from finloop.io.picture import save_picture
from finloop.io.table import save_table
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    KEY_FRAME_EVERY,
    VideoFacts,
    read_frames,
    save_mask,
)

Watch = Callable[[str, int], AbstractContextManager[Callable[[], None]]]
"""Reports progress: (word, number of frames) → a block that yields `advance()`."""

_PICTURES, _TAKING = {"deinterlace", "undouble"}, {"even_light", "steady"}


@dataclass(frozen=True)
class ClipResult:
    """A new clip: its facts, the tally of its frames, its arena (h, w), and its quality.

    filmed: the quality of the film before any repair; mended: the repairs that were made, of
    `finloop.clip.mend.REPAIRED_BY`.
    """

    facts: VideoFacts
    tally: Tally
    arena: Mask
    filmed: Quality
    quality: Quality
    mended: frozenset[str]

    @property
    def numbers(self) -> dict[str, float]:
        """Return metrics by name: quality of clip and unrepaired film; each repair, 0 or 1."""
        numbers = dict(vars(self.quality))
        if self.mended:
            numbers |= {f"filmed_{name}": value for name, value in vars(self.filmed).items()}
        words = sorted(_PICTURES | _TAKING)
        return numbers | {f"mended_{word}": int(word in self.mended) for word in words}


def make_clip(
    p: ClipSettings,
    source: ClipSource,
    folder: Path,
    watch: Watch = lambda *_: nullcontext(lambda: None),
) -> ClipResult:
    """Write the normalised clip of a film and its check to a folder; repair a user's own footage.

    The check is a table (`CHECK_NAME`) and the still tank's picture (`TANK_NAME`). A faulty clip is
    written again, repaired. watch: reports progress. FinloopError as in `write_clip`.
    """
    with watch("clip", source.facts.frames) as advance:
        facts, tally, arena = write_clip(source, p, folder, advance)
    filmed, tank = _check_clip(facts, tally, folder)
    result = ClipResult(facts, tally, arena, filmed, filmed, frozenset())
    if not isinstance(p, File):
        return result
    fields: Order = ""
    twice: Doubled | None = None
    calm: FrameCorrector | None = None
    for kind in (_PICTURES, _TAKING):
        todo = repairs(p, result.quality, min(arena.shape)) & kind
        if "undouble" in todo and not _frame_by_frame(result.facts):
            todo.remove("undouble")
        if not todo:
            continue
        if "deinterlace" in todo:
            fields = field_of(result.quality)
        if "undouble" in todo:
            twice = find_repeats(np.array(result.tally.changes))
        if todo & _TAKING:
            calm = FrameCorrector(tank, "even_light" in todo, "steady" in todo)
        again = _reopen_film(p, fields, twice, calm)
        with watch("mend", again.facts.frames) as advance:
            facts, tally, arena = write_clip(again, p, folder, advance)
        if calm:
            arena = arena & calm.common_mask()
            save_mask(folder / ARENA_NAME, arena)
        quality, tank = _check_clip(facts, tally, folder)
        result = ClipResult(facts, tally, arena, filmed, quality, result.mended | todo)
    return result


def _frame_by_frame(facts: VideoFacts) -> bool:
    """Return whether frame k of the clip is frame k of the film."""
    retimed = facts.frames_repeated + facts.frames_dropped + facts.frames_missing
    return not retimed and len(facts.segments) == 1


def _reopen_film(
    p: File, fields: Order, twice: Doubled | None, calm: FrameCorrector | None
) -> ClipSource:
    source = open_source(p, fields)
    facts, takes = source.facts, source.takes
    if twice is not None:
        rate = facts.frame_rate * _simple(twice.rate, len(twice.repeats))
        takes = [new_pictures(take, twice, float(rate)) for take in takes]
        facts = replace(facts, frame_rate=rate, frames=int((~twice.repeats).sum()))
    if calm is not None:
        takes = [calm(take) for take in takes]
    return replace(source, facts=facts, takes=takes)


def _simple(rate: float, frames: int) -> Fraction:
    """Return the simplest fraction within half a frame of a rate over `frames` frames."""
    tries = (Fraction(rate).limit_denominator(most) for most in range(1, 1002))
    return next(
        (fraction for fraction in tries if abs(float(fraction) - rate) * frames < 0.5),
        Fraction(rate).limit_denominator(1001),
    )


def _check_clip(facts: VideoFacts, tally: Tally, folder: Path) -> tuple[Quality, Picture]:
    reader = partial(read_frames, folder / CLIP_NAME)
    samples = list(tally.samples.values())
    clip = Clip(reader, facts.frame_rate_hz, samples, tally.lights, tally.changes)
    quality, table, tank = check(clip, KEY_FRAME_EVERY)
    save_table(folder / CHECK_NAME, table, CHECK)
    save_picture(folder / TANK_NAME, tank)
    return quality, tank
