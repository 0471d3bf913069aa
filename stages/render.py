"""Stage `render`: draw films from an edit list (fish paper Figs. 16, 18)."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pandas as pd

from finloop.edit.modes import MODES
from finloop.edit.schema import EDIT
from finloop.io.atomic import whole_folder
from finloop.io.movie import FilmWriter, Mp4Writer, WebpWriter
from finloop.io.table import load_table
from finloop.project import PLACES, Project
from finloop.render.beside import CAPTION_PX, draw_side_by_side, longest_tracks_edit_list
from finloop.render.gallery import Gallery, fish_by_tick
from finloop.render.marks import MarkPainter
from finloop.render.painter import Painter, Shadow
from finloop.render.settings import RenderSettings
from finloop.render.steps import FrameChangeMeter, film_frame_changes, frame_change_metrics
from stages.settings import load_settings

OUT, REPORT = Path("data/render"), Path("reports/render")


def _save_films(
    p: RenderSettings, edit: pd.DataFrame, project: Project, gallery: Gallery, shadow: Shadow,
    advance: Callable[[], None],
) -> list[float]:  # fmt: skip
    """Write all films of an edit list; return each frame's change from the one before, first NaN.

    An MP4; if `p.marked_film`, another with goals and path; a short WebP, of the marked film if
    there is one; and modes.mp4, with all modes side by side. The changes are in grey levels. They,
    the marked film and the WebP are of fish over a still tank: grain would make files many times as
    large. advance: reports progress.
    """
    all_fish, ticks = fish_by_tick(edit, gallery), edit["tick"].nunique()
    rate, background = project.facts.frame_rate, project.background
    tank = project.living_tank(p.tank)
    still, changes = Painter(background, shadow=shadow), list[float]()
    meter = FrameChangeMeter(still)
    clean = Painter(background, shadow=shadow, tank=tank)
    marked = Painter(background, colour=True, shadow=shadow) if p.marked_film else still
    with whole_folder(OUT) as folder, ExitStack() as stack:
        mp4 = Mp4Writer(folder / f"{p.mode}.mp4", clean.frame.shape, rate, p.crf)
        outputs: list[tuple[FilmWriter, Painter, int]] = [(mp4, clean, ticks)]
        if p.marked_film:
            marks = MarkPainter(marked, edit, project.goals(p.mode))
            mp4 = Mp4Writer(folder / f"{p.mode}_marked.mp4", marked.frame.shape, rate, p.crf)
            outputs.append((mp4, marked, ticks))
        if webp_ticks := round(p.webp_seconds * rate):
            coding = marked.frame.shape, rate, p.webp_width_px, p.webp_quality
            outputs.append((WebpWriter(folder / f"{p.mode}.webp", *coding), marked, webp_ticks))
        for writer, _, _ in outputs:
            stack.enter_context(writer)
        for tick, fish in enumerate(all_fish):
            changes.append(meter.measure_change(still.show(*fish)))
            clean.show(*fish, tick=tick)
            if p.marked_film:
                marks.show(tick, *fish)
            for writer, painter, ticks_to_write in outputs:
                if tick < ticks_to_write:
                    writer.write(painter.frame)
            advance()
        if comparison_ticks := round(p.comparison_seconds * rate):
            _save_comparison(folder / "modes.mp4", p, project, comparison_ticks)
    return changes


def _save_comparison(path: Path, p: RenderSettings, project: Project, ticks: int) -> None:
    """Write a film that shows one fish of the film and one of every mode side by side.

    ticks: longest length; the film is as long as the shortest animation or track.
    """
    tracks, edits = project.tracks(PLACES), dict[str, pd.DataFrame]()
    place = tracks[["x_px", "y_px"]].to_numpy(float)
    edits["Film"] = longest_tracks_edit_list(tracks["track_id"].to_numpy(), place, ticks)
    for mode, facts in MODES.items():
        edit = load_table(Path(f"data/animate/{mode}.parquet"), EDIT)
        edits[facts.title] = edit[edit["fish"] == 0].reset_index(drop=True)
    edits = {title: edit for title, edit in edits.items() if len(edit)}
    ticks = min(map(len, edits.values()))
    edits = {title: edit.iloc[:ticks] for title, edit in edits.items()}
    length_px, gallery = project.scene.typical_length_px, project.whole_gallery
    shape, rate = (p.beside_px + CAPTION_PX, len(edits) * p.beside_px, 3), project.facts.frame_rate
    with Mp4Writer(path, shape, rate, p.crf) as writer:
        frames = draw_side_by_side(
            edits, gallery, project.background, length_px, p.beside_px, project.living_tank(p.tank)
        )
        for frame in frames:
            writer.write(frame)


def main() -> None:
    """Draw the animation of `render.mode` as films; write data/render/ and reports/render/.

    The metrics say how much a frame differs from the one before, in the animation and in the film.
    """
    p: RenderSettings = load_settings("render")
    with Project() as project:
        drawn = project.edit_with_sources(p.mode, "render")
        gallery, ticks = project.gallery(drawn), drawn.edit["tick"].nunique()
        length_px = project.drawn_scale(p.mode) * drawn.scene.typical_length_px
        shadow = Shadow(p.shadow_darkness, p.shadow_blur * length_px)
        with report_progress("render", ticks) as advance:
            changes = _save_films(p, drawn.edit, project, gallery, shadow, advance)
            film_changes = film_frame_changes(Painter(project.background), gallery, drawn.tracks)
        duration = {"frames": ticks, "duration_s": ticks / project.rate_hz}
    save_metrics(REPORT / "metrics.json", frame_change_metrics(changes, film_changes) | duration)


if __name__ == "__main__":
    run(main)
