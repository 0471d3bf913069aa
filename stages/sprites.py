"""Stage `sprites`: make sprites in all orientations from a few frames, and an atlas."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import json
import sys
from functools import partial
from pathlib import Path

import pandas as pd

from finloop.distance.reel import sprite_store_row
from finloop.features.table import count_orientations, infer_delta_frames
from finloop.io.atomic import whole_folder
from finloop.io.cutouts import CutoutWriter, open_cutouts
from finloop.io.table import save_csv, save_table
from finloop.project import Project
from finloop.sprites import atlas
from finloop.sprites.choice import SIDES, ChosenFrames, choose_frames, swimmer_table
from finloop.sprites.metrics import (
    cycle_metrics,
    fault_table,
    sprite_metrics,
    sprite_orientation_table,
)
from finloop.sprites.orient import SPRITES, sprite_cutouts, sprite_table
from finloop.sprites.settings import SpritesSettings
from stages.settings import load_settings

FOLDER, REPORT = Path("data/sprites"), Path("reports/sprites")
TRACKS = ("track_id", "frame", "area_px", "contrast")


def _report_stand_ins(choices: dict[str, ChosenFrames]) -> None:
    """Print which sequences the film lacks, and which frames are used in their place.

    choices: the frames chosen for each sequence, by its name.
    """
    # A film without any turn has stand-ins on both sides: one note. A film with turns to one side
    # has them mirrored on the other.
    for word, what in (("straight", "full tail beat"), ("left", "whole turn")):
        if choices[word].stands_in:
            print(
                f"sprites: no {what} in the film; what is most like one stands in (a longer film "
                f"may show one, or list frames, e.g. sprites.{word}_frames=8:120-140)",
                file=sys.stderr,
            )
    for word, opposite in zip(SIDES, reversed(SIDES), strict=True):
        if choices[word].mirrored:
            print(f"sprites: no turn to the {word}; mirrored the {opposite} one", file=sys.stderr)
    if choices["slide"].stands_in:
        print("sprites: no glide with a still tail; the straightest frame", file=sys.stderr)


def write_atlas(folder: Path, sprites: pd.DataFrame, page_px: int, rate_hz: float) -> int:
    """Write atlas-<n>.png and .json, pages with all sprites, to `folder`; return how many pages.

    folder: has sprites.arrow, the cut-outs. sprites: their table. page_px: width of a page.
    """
    with open_cutouts(folder / "sprites.arrow") as store:
        pages = atlas.lay_out_pages(sprites, store.index, page_px)
        count = count_orientations(sprites)
        for number, page in enumerate(pages):
            picture = atlas.draw_atlas_page(
                page, lambda number, sector: store[sprite_store_row(number, sector, count)].pixels
            )
            (folder / f"atlas-{number}.png").write_bytes(atlas.encode_png(picture))
            text = json.dumps(atlas.atlas_page_json(pages, number, sprites, store.index, rate_hz))
            (folder / f"atlas-{number}.json").write_text(text + "\n", encoding="utf-8")
    return len(pages)


def main() -> None:
    """Turn chosen frames of each sequence to every orientation: the sprites, and their atlas.

    data/sprites/ gets them and tables, reports/sprites/ the metrics.
    """
    settings: SpritesSettings = load_settings("sprites")
    with Project() as project:
        features, facts, rate_hz = project.features, project.facts, project.rate_hz
        delta = infer_delta_frames(features)
        table = swimmer_table(features, project.tracks(TRACKS), settings)
        draw_pictures = partial(project.film_reel.draw_aligned_rows, size_px=settings.picture_px)
        choices = choose_frames(table, draw_pictures, delta, settings)
        sprites = sprite_table(table, choices, settings)
        with (
            whole_folder(FOLDER) as folder,
            report_progress(
                "sprites", count_orientations(sprites) * len(sprites), "pictures"
            ) as advance,
        ):
            save_table(folder / "sprites.parquet", sprites, SPRITES)
            with CutoutWriter(folder / "sprites.arrow", sprites=True) as writer:
                for cutout in sprite_cutouts(sprites, project.cutouts):
                    writer.write(cutout)
                    advance()
            pages = write_atlas(folder, sprites, settings.page_px, rate_hz)
        cycles: dict[str, float] = {}
        for word in ("straight", "slide"):
            cycles |= cycle_metrics(word, choices[word], table, draw_pictures)

    _report_stand_ins(choices)
    save_csv(FOLDER / "table1_after.csv", sprite_orientation_table(sprites, features), decimals=3)
    save_csv(FOLDER / "faults.csv", fault_table(choices), decimals=3)
    save_metrics(
        REPORT / "metrics.json",
        sprite_metrics(sprites, table, features, facts.frames, rate_hz)
        | cycles
        | {"atlas_pages": pages, "slide_stands_in": int(choices["slide"].stands_in)},
    )


if __name__ == "__main__":
    run(main)
