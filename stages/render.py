"""Stage `render`: an edit list becomes films (fish paper Figs. 16, 18)."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pandas as pd

from finloop.animate.edit_list import EDIT, SPRITE, Goal
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io.atomic import whole_folder
from finloop.io.edit_list import load_edit
from finloop.io.movie import Movie, Mp4Writer, WebpWriter
from finloop.io.picture import load_picture
from finloop.io.record import load_record, load_records
from finloop.io.table import load_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.render.gallery import Gallery, placed
from finloop.render.marks import Marks
from finloop.render.painter import Painter
from finloop.render.settings import Settings
from finloop.render.steps import Steps, film_steps, step_numbers
from finloop.sprites.orient import SPRITES
from stages.gallery import open_gallery
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
SPRITES_FOLDER, ANIMATE = Path("data/sprites"), Path("data/animate")
OUT, REPORT = Path("data/render"), Path("reports/render")
Output = tuple[Movie, Painter, int]  # the last: how many ticks it takes


def films(
    p: Settings,
    edit: pd.DataFrame,
    goals: list[Goal],
    gallery: Gallery,
    background: np.ndarray,
    advance: Callable[[], None],
) -> list[float]:
    """Write the films of an edit list; the steps between its frames."""
    rows, rate = placed(edit, gallery), load_facts(CLIP / FACTS_NAME).frame_rate
    clean, change = Painter(background), list[float]()
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
            advance()
    return change


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
        change = films(p, edit, goals, gallery, background, advance)
        natural = film_steps(Painter(background), gallery, tracks)
    save_metrics(
        REPORT / "metrics.json",
        step_numbers(change, natural)
        | {"frames": len(edit), "duration_s": len(edit) / facts.frame_rate_hz},
    )


if __name__ == "__main__":
    run(main)
