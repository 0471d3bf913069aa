"""Picture of `retarget`: the requested lines and the drawn backbones."""

from pathlib import Path

from finloop.edit.modes import RETARGET
from finloop.io.atomic import whole_folder
from finloop.io.picture import save_picture
from finloop.io.table import load_table
from finloop.plots.retarget import choose_ticks_to_draw, draw_backbones
from finloop.project import Project
from finloop.render.gallery import fish_by_row
from finloop.render.painter import Painter
from finloop.retarget import ASKED

REPORT = Path("reports/modes/retarget")
_SPAN = 1.6  # body lengths across a tile


def main() -> None:
    """Draw requested and drawn backbones of a retargeted track, backbones.png.

    The folder reports/modes/retarget/ stays empty if no track is retargeted.
    """
    asked = load_table(Path("data/retarget/asked.parquet"), ASKED)
    with whole_folder(REPORT) as folder:
        if asked.empty:
            return
        ticks = choose_ticks_to_draw(asked)
        with Project() as project:
            drawn = project.edit_with_sources(RETARGET, "plots-modes")
            chosen = drawn.edit.iloc[ticks].assign(tick=range(len(ticks)))
            rows, painter = (
                fish_by_row(chosen, project.gallery(drawn)),
                Painter(project.background),
            )
            size = round(_SPAN * drawn.scene.typical_length_px)
            picture = draw_backbones(asked, ticks, rows, painter, size)
        save_picture(folder / "backbones.png", picture)
