"""Stage `clip`: a film becomes the normalised clip, with its facts, its arena and its truth."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from finloop.clip.arena import circle_arena, rectangle_arena
from finloop.clip.quality import Tally, psnr_db
from finloop.clip.settings import Carp, File, Settings, Zebrafish
from finloop.drawn.carp.film import film, fits
from finloop.drawn.truth import TRUTH
from finloop.errors import FinloopError
from finloop.io.atomic import whole_folder
from finloop.io.footage import Loss, Timing, nearest_in_time, open_footage, segments_of
from finloop.io.movie import VideoWriter
from finloop.io.table import TableWriter
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    TRUTH_NAME,
    VideoFacts,
    load_mask,
    read_spread,
    save_facts,
    save_mask,
)
from finloop.io.wheel import TANK_PX, cache_folder, zebrafish_clips
from stages.settings import load

CLIP = Path("data/clip")
METRICS = Path("reports/clip/metrics.json")
ROWS = 512  # of truth that gather before they are written


@dataclass(frozen=True)
class Reel:
    """A clip before it is written: its facts, as far as they are known, and its frames."""

    facts: VideoFacts
    takes: list[Iterator[tuple[float, np.ndarray]]]
    loss: Loss
    truth: list[dict[str, Any]]  # rows of truth about the carp that are not written yet


def carp_reel(p: Carp) -> Reel:
    """The film of the drawn carp."""
    if not fits(p):
        raise FinloopError(
            came=f"{p.fish} carp of {p.body_length_px:g} px have no room in a tank of "
            f"{p.width_px}×{p.height_px} px",
            wanted="about 2.2 body lengths squared for each, and a margin along the walls",
            do="draw fewer or smaller fish, or a larger tank (clip.width_px, clip.height_px)",
        )
    rate = Fraction(p.frame_rate_hz).limit_denominator(1001)
    facts = VideoFacts("carp", p.width_px, p.height_px, p.frames, rate, p.colour, (), crf=p.crf)
    truth: list[dict[str, Any]] = []

    def take() -> Iterator[tuple[float, np.ndarray]]:
        for number, (frame, rows) in enumerate(film(p)):
            truth.extend(rows)
            yield float(number / rate), frame

    return Reel(facts, [take()], Loss(), truth)


def film_reel(p: Zebrafish | File) -> Reel:
    """Films that follow one another in the clip."""
    if isinstance(p, Zebrafish):
        paths = zebrafish_clips(p.parts, cache_folder())
        films = [open_footage(path, colour=False) for path in paths]
    else:
        colour = {"auto": None, "always": True, "never": False}[p.colour]
        path = Path(p.path).expanduser()
        films = [
            open_footage(
                path, frame_rate_hz=p.frame_rate_hz, start_s=p.start_s, end_s=p.end_s, colour=colour
            )
        ]
    facts = replace(films[0].facts(p.source, p.crf), frames=sum(f.frames_expected for f in films))
    loss = Loss()
    return Reel(facts, [footage.frames(loss) for footage in films], loss, [])


def flush(rows: list[dict[str, Any]], table: TableWriter) -> None:
    """Write the rows of truth to their table, and empty the list."""
    table.write(pd.DataFrame(rows))
    rows.clear()


def flushing(
    rows: list[dict[str, Any]], table: TableWriter, advance: Callable[..., None]
) -> Callable[..., None]:
    """`advance` that also writes the rows of truth whenever there are `ROWS` of them."""

    def step(frames: int = 1) -> None:
        advance(frames)
        if len(rows) >= ROWS:
            flush(rows, table)

    return step


def record(writer: VideoWriter, reel: Reel, advance: Callable[..., None]) -> tuple[Timing, Tally]:
    """Write the takes one after the other, each re-timed to a constant rate from its first frame.

    FinloopError if fewer than two frames can be read, or all frames are plain.
    """
    timing, tally = Timing(), Tally()
    for take in reel.takes:
        for frame in nearest_in_time(take, reel.facts.frame_rate, timing):
            writer.write(frame)
            tally.add(frame)
            advance()
    if tally.frames < 2:
        raise FinloopError(
            came=f"only {tally.frames} frame(s) could be decoded",
            wanted="at least 2 frames: without motion there is nothing to follow",
            do="copy or record the film again",
        )
    if tally.plain:
        raise FinloopError(
            came=f"all {tally.frames} frames show an even grey of {tally.brightness_mean:.0f} "
            "(0 = black, 255 = white)",
            wanted="a film in which something is to be seen",
            do="check the camera's cap, exposure and file; or choose another range of time",
        )
    return timing, tally


def arena_of(p: Settings, width: int, height: int) -> np.ndarray:
    """Mask (height, width) of the pixels where animals can be."""
    if isinstance(p, Zebrafish):
        return rectangle_arena(width, height, *TANK_PX)
    if not isinstance(p, File) or p.arena == "none":
        return np.ones((height, width), bool)
    if p.arena == "mask":
        return load_mask(Path(*p.arena_values()).expanduser(), width, height)
    shape = circle_arena if p.arena == "circle" else rectangle_arena
    return shape(width, height, *p.arena_values())


def main() -> None:
    """Make data/clip/ and reports/clip/metrics.json."""
    p: Settings = load("clip")
    reel = carp_reel(p) if isinstance(p, Carp) else film_reel(p)
    facts = reel.facts
    arena = arena_of(p, facts.width_px, facts.height_px)
    for note in facts.notes:
        print(f"finloop: note: {note}", file=sys.stderr)
    with whole_folder(CLIP) as folder:
        clip = folder / CLIP_NAME
        with ExitStack() as stack:
            advance = stack.enter_context(progress("clip", facts.frames))
            writer = stack.enter_context(VideoWriter.of(clip, facts))
            if isinstance(p, Carp):
                truth = stack.enter_context(TableWriter(folder / TRUTH_NAME, TRUTH))
                advance = flushing(reel.truth, truth, advance)
            timing, tally = record(writer, reel, advance)
            if reel.truth:
                flush(reel.truth, truth)
        facts = replace(
            facts,
            frames=timing.frames,
            segments=segments_of(timing.cuts, timing.frames),
            frames_repeated=timing.repeated,
            frames_dropped=timing.dropped,
            frames_missing=reel.loss.frames,
            notes=(*facts.notes, *reel.loss.notes),
        )
        for note in reel.loss.notes:
            print(f"finloop: WARNING: {note}", file=sys.stderr)
        save_facts(folder / FACTS_NAME, facts)
        save_mask(folder / ARENA_NAME, arena)
        coded = read_spread(clip, list(tally.samples), colour=facts.colour)
        numbers = {
            "frames": facts.frames,
            "width_px": facts.width_px,
            "height_px": facts.height_px,
            "frame_rate_hz": facts.frame_rate_hz,
            "duration_s": facts.frames / facts.frame_rate_hz,
            "segments": len(facts.segments),
            "frames_repeated": facts.frames_repeated,
            "frames_dropped": facts.frames_dropped,
            "frames_missing": facts.frames_missing,
            "brightness_mean_level": tally.brightness_mean,
            "brightness_min_level": tally.darkest,
            "brightness_max_level": tally.brightest,
            "coding_psnr_db": psnr_db(zip(tally.samples.values(), coded, strict=True)),
            "arena_fraction": float(arena.mean()),
        }
    save_metrics(METRICS, numbers)


if __name__ == "__main__":
    run(main)
