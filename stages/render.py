"""Stage `render`: an edit list becomes films and pictures (fish paper Figs. 16, 18)."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.animate.edit_list import EDIT, FRAME, SPRITE, Goal
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io.atomic import whole_folder
from finloop.io.edit_list import load_edit
from finloop.io.gallery import open_gallery
from finloop.io.movie import Movie, Mp4Writer, WebpWriter
from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.io.record import load_record, load_records
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.plots.render import Tile, contact_sheet, liveliest, switches, trajectory, window
from finloop.render.marks import Marks, parts
from finloop.render.painter import Gallery, Painter, Steps, film_steps, placed, step_numbers
from finloop.render.settings import Settings
from finloop.sprites.orient import SPRITES
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
SPRITES_FOLDER, ANIMATE = Path("data/sprites"), Path("data/animate")
OUT, REPORT = Path("data/render"), Path("reports/render")
SHOWN = 40  # ticks on the contact sheet
SWITCHES, BEFORE, AFTER = 12, 3, 5  # rows on the sheet of switches; ticks before, and from, each
Output = tuple[Movie, Painter, int]  # the last: how many ticks it takes


def films(
    p: Settings,
    edit: pd.DataFrame,
    goals: list[Goal],
    tracks: pd.DataFrame,
    gallery: Gallery,
    background: np.ndarray,
    half_px: int,
    advance: Callable[[], None],
) -> tuple[list[float], list[list[Tile]]]:
    """Write the films of an edit list; steps between its frames, tiles of two sheets."""
    rows, rate = placed(edit, gallery), load_facts(CLIP / FACTS_NAME).frame_rate
    names, colours = parts(edit)
    start, changes = liveliest(edit, SHOWN), switches(edit, tracks, SWITCHES)
    wanted = {*range(start, start + SHOWN)}.union(*(around(tick, len(edit)) for tick in changes))
    clean, change, tiles = Painter(background), list[float](), dict[int, Tile]()
    steps = Steps(clean)
    with whole_folder(OUT) as folder, ExitStack() as stack:

        def writes(writer: Movie, painter: Painter, ticks: int) -> Output:
            return stack.enter_context(writer), painter, ticks

        def mp4(painter: Painter, name: str) -> Output:
            path = folder / f"{name}.mp4"
            return writes(Mp4Writer(path, painter.frame.shape, rate, p.crf), painter, len(edit))

        outputs, seen = [mp4(clean, p.mode)], clean
        if p.marks:
            seen = Painter(background, colour=True)
            marks = Marks(seen, edit, goals)
            outputs.append(mp4(seen, f"{p.mode}_marked"))
        if webp_ticks := round(p.webp_seconds * rate):
            how = seen.frame.shape, rate, p.webp_width_px, p.webp_quality
            outputs.append(writes(WebpWriter(folder / f"{p.mode}.webp", *how), seen, webp_ticks))
        for tick, one in enumerate(rows):
            change.append(steps.to(clean.show(one)))
            if p.marks:
                marks.show(tick, one)
            for writer, painter, ticks in outputs:
                if tick < ticks:
                    writer.write(painter.frame)
            if tick in wanted:
                film = window(clean.frame, one.x_px, one.y_px, half_px)
                name = names[tick]
                tiles[tick] = Tile(film, tick, name, colours[name], one.weight)
            advance()
    sheets = [
        [tiles[tick] for tick in range(start, min(start + SHOWN, len(edit)))],
        [tiles[tick] for one in changes for tick in around(one, len(edit))],
    ]
    return change, sheets


def around(tick: int, ticks: int) -> range:
    """The ticks shown of a switch."""
    first = max(0, min(tick - BEFORE, ticks - BEFORE - AFTER))
    return range(first, min(first + BEFORE + AFTER, ticks))


def main() -> None:
    """Make data/render/, reports/render/."""
    p: Settings = load("render")
    facts = load_facts(CLIP / FACTS_NAME)
    scene = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    background = load_picture(EXTRACT / "background.png")
    columns = ["track_id", "frame", "x_px", "y_px"]
    tracks = load_table(EXTRACT / "tracks.parquet", tracks_schema(scene.points), columns)
    edit = load_edit(ANIMATE, p.mode, "render", EDIT)
    goals = load_records(ANIMATE / "goals.json", Goal, "animate")
    drawn = SPRITE in {*edit["kind"], *edit["partner_kind"]}
    table = load_table(SPRITES_FOLDER / "sprites.parquet", SPRITES) if drawn else None
    stores = EXTRACT / "cutouts.arrow", tracks, SPRITES_FOLDER / "sprites.arrow", table
    with open_gallery(*stores) as gallery, progress("render", len(edit)) as advance:
        half_px = round(0.75 * scene.typical_length_px)
        change, sheets = films(p, edit, goals, tracks, gallery, background, half_px, advance)
        natural = film_steps(Painter(background), gallery, FRAME, tracks)
    for name, tiles in zip(("contact_sheet", "switches"), sheets, strict=True):
        save_picture(REPORT / f"{name}.png", contact_sheet(tiles, BEFORE + AFTER))
    save_figure(REPORT / "trajectory.png", trajectory(edit, goals, background))
    save_metrics(
        REPORT / "metrics.json",
        step_numbers(change, natural)
        | {
            "frames": len(edit),
            "duration_s": len(edit) / facts.frame_rate_hz,
        },
    )


if __name__ == "__main__":
    run(main)
