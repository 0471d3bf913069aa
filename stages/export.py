"""Stage `export`: what other programs take: films with alpha, atlas, edit list, tracks as poses."""

from stages.run import progress, run, save_metrics  # isort: skip  (before numpy)

import json
import shutil
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from finloop.animate.edit_list import EDIT
from finloop.export.keypoints import deeplabcut
from finloop.export.pictures import READABLE, Alone, cut_out, cycle, readable, way
from finloop.export.settings import Settings
from finloop.export.tracks import USED, poses
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.table import FEATURES
from finloop.io.atomic import whole_folder
from finloop.io.edit_list import load_edit
from finloop.io.movie import Movie
from finloop.io.movie_alpha import AlphaWebpWriter, WebmWriter
from finloop.io.record import load_record
from finloop.io.table import load_table, save_csv, save_csv_in_blocks, save_table
from finloop.io.video import FACTS_NAME, load_facts
from finloop.render.gallery import Gallery, placed
from finloop.render.painter import Box
from finloop.sprites.orient import SPRITES
from finloop.sprites.stretch import SIDES, WORDS
from stages.gallery import open_gallery
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
SPRITES_FOLDER, ANIMATE = Path("data/sprites"), Path("data/animate")
FEATURES_TABLE = Path("data/features/features.parquet")
OUT, REPORT = Path("data/export"), Path("reports/export")
POINTS = ["head_x_px", "head_y_px", "head_confidence"]


def film(
    path: Path,
    pictures: Iterable[NDArray[np.uint8]],
    crop: Box,
    webp_ticks: int,
    rate: Fraction,
    p: Settings,
    advance: Callable[[], None],
) -> dict[str, Any]:
    """Write path.webm, and of its first `webp_ticks` path.webp; what films.json says of both."""
    shape = crop.bottom - crop.top, crop.right - crop.left, 4
    count = 0
    with ExitStack() as stack:
        writers: list[tuple[Movie, float]] = [
            (WebmWriter(path.with_suffix(".webm"), shape, rate, p.webm_crf), float("inf"))
        ]
        if webp_ticks:
            webp = AlphaWebpWriter(path.with_suffix(".webp"), shape, rate, p.webp_quality)
            writers.append((webp, webp_ticks))
        for writer, _ in writers:
            stack.enter_context(writer)
        for picture in pictures:
            for writer, ticks in writers:
                if count < ticks:
                    writer.write(picture)
            count += 1
            advance()
    return {"frames": count, "width_px": shape[1], "height_px": shape[0]}


def films(
    folder: Path, p: Settings, edit: pd.DataFrame, sprites: pd.DataFrame, gallery: Gallery
) -> dict[str, Any]:
    """Write the animation and every sequence of sprites; what films.json says of them."""
    facts = load_facts(CLIP / FACTS_NAME)
    rate, channels = facts.frame_rate, 3 if facts.colour else 1
    cycles = {word: cycle(sprites, word, gallery) for word in WORDS}
    ticks = len(edit) + sum(len(rows) for rows, _ in cycles.values())
    with progress("export", ticks) as advance:
        tank = Alone(facts.height_px, facts.width_px, channels)
        crop = way(placed(edit, gallery), tank)
        webp_ticks = round(p.webp_seconds * rate)
        rows = placed(edit, gallery)
        made: dict[str, Any] = {}
        made[p.mode] = film(
            folder / p.mode, cut_out(rows, tank, crop), crop, webp_ticks, rate, p, advance
        )
        made[p.mode] |= {"left_px": crop.left, "top_px": crop.top, "loops": False}
        for word, (steps, half) in cycles.items():
            alone = Alone(2 * half + 1, 2 * half + 1, channels)
            crop = way(steps, alone)
            made[word] = film(
                folder / word, cut_out(steps, alone, crop), crop, len(steps), rate, p, advance
            )
            made[word] |= {"pivot_x_px": half - crop.left, "pivot_y_px": half - crop.top}
            made[word] |= {"loops": word not in SIDES}
    tank_px = {"width_px": facts.width_px, "height_px": facts.height_px}
    return {"frame_rate_hz": round(float(rate), 4), "tank": tank_px, "films": made}


def main() -> None:
    """Make data/export/, reports/export/."""
    p: Settings = load("export")
    facts = load_facts(CLIP / FACTS_NAME)
    scene = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    tracks = load_table(EXTRACT / "tracks.parquet", tracks_schema(scene.points), USED)
    sprites = load_table(SPRITES_FOLDER / "sprites.parquet", SPRITES)
    edit = load_edit(ANIMATE, p.mode, "export", EDIT)
    points = poses(
        tracks, load_table(FEATURES_TABLE, FEATURES, POINTS), facts.frames,
        p.body_points, round(p.tracks_least_s * facts.frame_rate), p.tracks_most,
    )  # fmt: skip
    with (
        whole_folder(OUT) as folder,
        open_gallery(
            EXTRACT / "cutouts.arrow", tracks, SPRITES_FOLDER / "sprites.arrow", sprites
        ) as gallery,
    ):
        made = films(folder, p, edit, sprites, gallery)
        (folder / "films.json").write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
        for atlas in sorted(SPRITES_FOLDER.glob("atlas-*")):
            shutil.copyfile(atlas, folder / atlas.name)
        listed = readable(edit, tracks, sprites)
        save_csv(folder / f"{p.mode}.csv", listed, decimals=4, exact=True)
        save_table(folder / f"{p.mode}.parquet", listed, READABLE)
        save_csv_in_blocks(folder / "tracks.csv", deeplabcut(points), decimals=3)
    save_metrics(
        REPORT / "metrics.json",
        {f"crop_{side}": made["films"][p.mode][side] for side in ("width_px", "height_px")}
        | {
            "frames": len(edit),
            "tracks": len(points.individuals),
            "track_rows_share": len(points.frame) / len(tracks),
        },
    )


if __name__ == "__main__":
    run(main)
