"""Pictures of `render`: the way of the fish, its liveliest seconds, and its switches (Fig. 18)."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.animate.edit_list import EDIT, SPRITE, Goal
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.io.edit_list import load_edit
from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.io.record import load_record, load_records
from finloop.io.table import load_table
from finloop.plots.render import contact_sheet, ticks_drawn, tiles, trajectory
from finloop.render.gallery import placed
from finloop.render.painter import Painter
from finloop.render.settings import Settings
from finloop.sprites.orient import SPRITES
from stages.gallery import open_gallery
from stages.settings import load

EXTRACT, SPRITES_FOLDER = Path("data/extract"), Path("data/sprites")
ANIMATE, REPORT = Path("data/animate"), Path("reports/render")


def main() -> None:
    """Draw trajectory.png, contact_sheet.png and switches.png."""
    p: Settings = load("render")
    scene = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    background = load_picture(EXTRACT / "background.png")
    columns = ["track_id", "frame", "x_px", "y_px"]
    tracks = load_table(EXTRACT / "tracks.parquet", tracks_schema(scene.points), columns)
    edit = load_edit(ANIMATE, p.mode, "render", EDIT)
    goals = load_records(ANIMATE / "goals.json", Goal, "animate")
    sprites = SPRITE in {*edit["kind"], *edit["partner_kind"]}
    table = load_table(SPRITES_FOLDER / "sprites.parquet", SPRITES) if sprites else None
    stores = EXTRACT / "cutouts.arrow", tracks, SPRITES_FOLDER / "sprites.arrow", table
    half_px = round(0.75 * scene.typical_length_px)
    with open_gallery(*stores) as gallery:
        for name, ticks in ticks_drawn(edit, tracks).items():
            some = edit.iloc[ticks].assign(tick=range(len(ticks)))
            rows = placed(some, gallery) if ticks else ()
            sheet = contact_sheet(tiles(edit, ticks, rows, Painter(background), half_px))
            save_picture(REPORT / f"{name}.png", sheet)
    save_figure(REPORT / "trajectory.png", trajectory(edit, goals, background))


if __name__ == "__main__":
    run(main)
