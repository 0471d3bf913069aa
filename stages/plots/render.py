"""Pictures of `render`: the path of the fish, its liveliest seconds, and its switches (Fig. 18)."""

from pathlib import Path

from finloop.edit.modes import MODES
from finloop.io.picture import save_figure, save_picture
from finloop.plots.parts import draw_message
from finloop.plots.render import choose_sheet_ticks, cut_tiles, draw_tiles, draw_trajectory
from finloop.project import Project
from finloop.render.gallery import fish_by_row
from finloop.render.painter import Painter
from finloop.render.settings import RenderSettings
from stages.settings import load_settings

REPORT = Path("reports/modes/render")


def main() -> None:
    """Draw the path of every mode and, for `render.mode`, sheets of the first fish's pictures.

    A sheet shows successive ticks, or where the animation changes to other film, a tile per tick.
    """
    p: RenderSettings = load_settings("render")
    with Project() as project:
        background, drawn = project.background, project.edit_with_sources(p.mode, "render")
        gallery = project.gallery(drawn)
        # Tiles are 1.5 body lengths wide.
        half_px = round(0.75 * project.drawn_scale(p.mode) * drawn.scene.typical_length_px)
        edit = drawn.edit[drawn.edit["fish"] == 0]  # tick by tick the first fish is shown alone
        for name, ticks in choose_sheet_ticks(edit, drawn.tracks).items():
            chosen = edit.iloc[ticks].assign(tick=range(len(ticks)))
            rows = fish_by_row(chosen, gallery) if ticks else ()
            sheet = draw_tiles(cut_tiles(edit, ticks, rows, Painter(background), half_px))
            save_picture(REPORT / f"{name}.png", sheet)
        for mode, facts in MODES.items():
            figure = draw_message(f"{facts.title}: the film shows too little for this mode.")
            if (project.data / f"animate/{mode}/goals.json").exists():
                edit = project.edit_list(mode, "render")
                figure = draw_trajectory(edit, project.goals(mode), background)
                figure.suptitle(f"{facts.title} ({facts.source})")
            save_figure(REPORT / f"{mode}.png", figure)
