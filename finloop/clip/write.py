"""Write a film, drawn or filmed, as the normalised clip: constant rate, facts, arena, truth.

An arena, where animals can be, is a mask of the picture: (height, width) bool, True inside. x runs
right, y down, and the centre of pixel (row 0, column 0) is the point (0, 0).
"""

from array import array
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from finloop.base.errors import FinloopError
from finloop.base.parallel import prefetch
from finloop.clip.check import ClipTally
from finloop.clip.settings import (
    CIRCLE,
    CarpSettings,
    ClipSettings,
    FootageSettings,
    ZebrafishSettings,
)
from finloop.drawn.carp.film import film_frames, is_tank_large_enough
from finloop.drawn.truth import TRUTH
from finloop.io.atomic import require_free_space
from finloop.io.footage import open_footage
from finloop.io.footage.source import Footage, LostFrames, NumberedFrames
from finloop.io.footage.timing import FrameCounts, resample_nearest, split_at_cuts
from finloop.io.movie import VideoWriter
from finloop.io.table import save_table, table_writer
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    FRAMES,
    FRAMES_NAME,
    KEY_FRAME_EVERY,
    TRUTH_NAME,
    VideoFacts,
    load_mask,
    save_facts,
    save_mask,
)
from finloop.io.wheel import TANK_PX, fetch_zebrafish_clips, find_cache_folder

_SAMPLE = 2 * KEY_FRAME_EVERY  # frames from which the size of the clip is estimated
_ROWS = 512  # rows of truth that are written at a time
WriteRows = Callable[[pd.DataFrame], None]


@dataclass(frozen=True)
class ClipSource:
    """A clip that is not yet written: its facts, and its frames as iterators."""

    facts: VideoFacts
    streams: list[NumberedFrames]  # one for each film; frames are numbered through all of them
    loss: LostFrames
    truth: list[dict[str, Any]]  # rows about the drawn carp that collect while `streams` is read
    footage: Footage | None = None  # the film, if it is the user's own


def open_clip_source(p: ClipSettings) -> ClipSource:
    """Open the film, or draw the carp, that the parameters name; download the zebrafish if missing.

    Frames are read, or drawn, later. FinloopError if a film cannot be opened or downloaded, or the
    carp have no room in their tank.
    """
    if isinstance(p, CarpSettings):
        return _open_carp(p)
    if isinstance(p, ZebrafishSettings):
        paths = fetch_zebrafish_clips(p.parts, find_cache_folder())
        return _join_films(p, [open_footage(path, colour=False) for path in paths])
    colour = {"auto": None, "always": True, "never": False}[p.colour]
    footage = open_footage(
        p.film, frame_rate_hz=p.frame_rate_hz, start_s=p.start_s, end_s=p.end_s, colour=colour
    )
    return open_footage_source(p, footage)


def open_footage_source(p: FootageSettings, footage: Footage) -> ClipSource:
    """Return the clip of one inspected film, not yet written; its frames are read later."""
    return replace(_join_films(p, [footage]), footage=footage)


def write_clip(
    source: ClipSource, p: ClipSettings, folder: Path, advance: Callable[[], None] = lambda: None
) -> tuple[VideoFacts, ClipTally, np.ndarray]:
    """Write a film as a clip to a folder: pictures, facts, arena, frame numbers, true carp.

    Return the facts, the tally of the frames, and the arena (h, w) bool. `advance()` is called
    after each frame. FinloopError if fewer than two frames can be read, all frames are plain, or
    the mask does not fit.
    """
    facts = source.facts
    arena = _make_arena(p, facts.width_px, facts.height_px)
    with ExitStack() as stack:
        writer = stack.enter_context(VideoWriter.from_facts(folder / CLIP_NAME, facts))
        truth = None
        if isinstance(p, CarpSettings):
            truth = stack.enter_context(table_writer(folder / TRUTH_NAME, TRUTH))
        timing, tally, source_frames = _write_streams(writer, source, truth, advance)
    facts = replace(
        facts, frames=timing.frames, segments=split_at_cuts(timing.cuts, timing.frames),
        frames_repeated=timing.repeated, frames_dropped=timing.dropped,
        frames_missing=source.loss.lost_frames, mm_per_px=p.mm_per_px,
        notes=(*facts.notes, *source.loss.notes),
    )  # fmt: skip
    save_facts(folder / FACTS_NAME, facts)
    save_mask(folder / ARENA_NAME, arena)
    numbers = pd.DataFrame(
        {"frame": np.arange(len(source_frames)), "source_frame": np.asarray(source_frames)}
    )
    save_table(folder / FRAMES_NAME, numbers, FRAMES)
    return facts, tally, arena


def _open_carp(p: CarpSettings) -> ClipSource:
    """Prepare a film of drawn carp; each frame is drawn when it is read.

    FinloopError if the carp have no room.
    """
    if not is_tank_large_enough(p):
        raise FinloopError(
            came=f"{p.fish} carp of {p.body_length_px:g} px have no room in a tank of "
            f"{p.width_px}×{p.height_px} px",
            wanted="about 2.2 body lengths squared for each, and a margin along the walls",
            do="draw fewer or smaller fish, or a larger tank (clip.width_px, clip.height_px)",
        )
    rate = Fraction(p.frame_rate_hz).limit_denominator(1001)
    facts = VideoFacts(
        "carp", p.width_px, p.height_px, p.frames, rate, p.colour, (),
        source_frames=p.frames, crf=p.crf,
    )  # fmt: skip
    truth: list[dict[str, Any]] = []

    def draw_frames() -> NumberedFrames:
        """Yield the drawn frames with time and number, and store the truth about them."""
        for number, (frame, rows) in enumerate(film_frames(p)):
            truth.extend(rows)
            yield float(number / rate), (number, frame)

    return ClipSource(facts, [draw_frames()], LostFrames(), truth)


def _join_films(p: ZebrafishSettings | FootageSettings, films: list[Footage]) -> ClipSource:
    """Return one clip of several films in a row; their frames are decoded when they are read."""
    lengths = [f.frames_in_source for f in films]
    facts = replace(
        films[0].clip_facts(p.source, p.crf),
        frames=sum(f.frames_expected for f in films),
        source_frames=sum(lengths),
    )
    loss = LostFrames()
    starts = accumulate(lengths, initial=0)

    def stream_from(footage: Footage, start: int) -> NumberedFrames:
        """Yield the frames of one film, numbered from `start`."""
        for time_s, (number, picture) in prefetch(footage.stream_numbered(loss)):
            yield time_s, (start + number, picture)

    streams = list(map(stream_from, films, starts))
    return ClipSource(facts, streams, loss, [])


def _write_streams(
    writer: VideoWriter, source: ClipSource, write_truth: WriteRows | None,
    advance: Callable[[], None],
) -> tuple[FrameCounts, ClipTally, array]:  # fmt: skip
    """Write the frames of one film after another, timed anew to a constant frame rate.

    write_truth: writes the true places of drawn carp; None for filmed fish. Return the timing, the
    tally, and the numbers that the written frames have in their source. FinloopError if fewer than
    two frames can be decoded, all are plain, or the disk has too little space.
    """
    timing, tally, source_frames = FrameCounts(), ClipTally(), array("i")

    def flush_truth(least: int) -> None:
        """Write the stored rows of truth and drop them, if there are `least` or more."""
        if write_truth and len(source.truth) >= least:
            write_truth(pd.DataFrame(source.truth))
            source.truth.clear()

    for frames in source.streams:
        for number, frame in resample_nearest(frames, source.facts.frame_rate, timing):
            writer.write(frame)
            source_frames.append(number)
            tally.add_frame(frame)
            if tally.frames == _SAMPLE:  # is there space for the clip, judged by its beginning?
                size = writer.bytes_per_frame() * (source.facts.frames - writer.frames)
                what = f"the clip of {source.facts.frames} frames"
                do = "take a shorter film (clip.end_s)"
                require_free_space(writer.path.parent, size, what, do)
            flush_truth(_ROWS)
            advance()
    flush_truth(1)
    _refuse_unusable_film(tally)
    return timing, tally, source_frames


def _refuse_unusable_film(tally: ClipTally) -> None:
    """Raise FinloopError if a film has fewer than two frames, or all are plain."""
    if tally.frames < 2:
        raise FinloopError(
            came=f"only {tally.frames} frame(s) could be decoded",
            wanted="at least 2 frames: without motion there is nothing to follow",
            do="copy or record the film again",
        )
    if tally.is_plain:
        raise FinloopError(
            came=f"all {tally.frames} frames show an even grey of {tally.brightness_mean:.0f} "
            "(0 = black, 255 = white)",
            wanted="a film that shows something",
            do="check the camera's cap, exposure and file; or choose another range of time",
        )


def _make_arena(p: ClipSettings, width_px: int, height_px: int) -> np.ndarray:
    """Return the mask (height_px, width_px) of the pixels where animals can be."""
    if isinstance(p, ZebrafishSettings):
        return rectangle_arena(width_px, height_px, *TANK_PX)
    if not isinstance(p, FootageSettings) or p.arena is None:
        return np.ones((height_px, width_px), bool)
    if isinstance(p.arena, str):
        return load_mask(Path(p.arena).expanduser(), width_px, height_px)
    shape = circle_arena if len(p.arena) == CIRCLE else rectangle_arena
    return shape(width_px, height_px, *p.arena)


def rectangle_arena(
    picture_width: int, picture_height: int, left_px: float, top_px: float, width_px: float,
    height_px: float,
) -> np.ndarray:  # fmt: skip
    """Return the mask of a picture's pixels whose centres lie in a rectangle.

    The mask is (picture_height, picture_width). The left and top edges belong to it, the right and
    bottom ones do not: 10 px wide from 0 is the columns 0 … 9. FinloopError if no pixel of the
    picture lies in it.
    """
    x, y = np.arange(picture_width), np.arange(picture_height)[:, None]
    mask = (x >= left_px) & (x < left_px + width_px) & (y >= top_px) & (y < top_px + height_px)
    size = f"{width_px:g}×{height_px:g} px"
    return _refuse_empty_arena(
        mask, f"rectangle of {size} with its corner at ({left_px:g}, {top_px:g})"
    )


def circle_arena(
    picture_width: int, picture_height: int, x_px: float, y_px: float, radius_px: float
) -> np.ndarray:
    """Return the mask of a picture's pixels whose centres lie in a circle or on it.

    The mask is (picture_height, picture_width). x_px, y_px: centre of the circle. FinloopError if
    no pixel of the picture lies in it.
    """
    x, y = np.arange(picture_width), np.arange(picture_height)[:, None]
    mask = (x - x_px) ** 2 + (y - y_px) ** 2 <= radius_px**2
    return _refuse_empty_arena(
        mask, f"circle of radius {radius_px:g} px about ({x_px:g}, {y_px:g})"
    )


def _refuse_empty_arena(mask: np.ndarray, description: str) -> np.ndarray:
    """Return the mask of an arena; FinloopError if it contains no pixel.

    description: of the arena's shape, for the message.
    """
    if not mask.any():
        height, width = mask.shape
        raise FinloopError(
            came=f"the arena lies outside the picture: a {description}",
            wanted=f"an arena that covers part of the picture, x 0 … {width - 1}, "
            f"y 0 … {height - 1} (x right, y down, in the upright picture)",
            do="correct clip.arena",
        )
    return mask
