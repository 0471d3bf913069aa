"""Pictures of `render`: the way of the fish, its liveliest seconds, and its switches (Fig. 18)."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.plots.render import contact_sheet, sheet_ticks, tiles, trajectory
from finloop.render.gallery import placed
from finloop.render.painter import Painter
from finloop.render.settings import Settings
from stages.edit import DATA, load_drawn, load_goals, load_size
from stages.gallery import open_gallery
from stages.settings import load

REPORT = Path("reports/render")


def main() -> None:
    """Draw trajectory.png, contact_sheet.png and switches.png."""
    p: Settings = load("render")
    background = load_picture(DATA / "extract/background.png")
    drawn, goals = load_drawn(p.mode, "render"), load_goals(p.mode)
    half_px = round(0.75 * load_size(p.mode) * drawn.scene.typical_length_px)
    edit = drawn.edit[drawn.edit["fish"] == 0]  # tick by tick the first fish is shown alone
    with open_gallery(drawn) as gallery:
        for name, ticks in sheet_ticks(edit, drawn.tracks).items():
            some = edit.iloc[ticks].assign(tick=range(len(ticks)))
            rows = placed(some, gallery) if ticks else ()
            sheet = contact_sheet(tiles(edit, ticks, rows, Painter(background), half_px))
            save_picture(REPORT / f"{name}.png", sheet)
    save_figure(REPORT / "trajectory.png", trajectory(drawn.edit, goals, background))


if __name__ == "__main__":
    run(main)
