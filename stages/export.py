"""Stage `export`: files for other programs: films with alpha, atlas, edit list, tracks as poses."""

from stages.run import report_progress, run, save_metrics  # isort: skip  (before numpy)

import shutil
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from finloop.base.arrays import Picture
from finloop.base.poses import Poses
from finloop.export.pictures import (
    READABLE,
    FishOnlyPainter,
    add_film_sources,
    box_of_all_fish,
    cut_out_fish,
    flatten_poses,
    sprites_of_sequence,
)
from finloop.export.settings import ExportSettings
from finloop.export.tracks import USED, deeplabcut_tables, keypoints_of_tracks
from finloop.io.atomic import save_bytes, whole_folder
from finloop.io.movie import AlphaWebpWriter, WebmWriter
from finloop.io.poses.save import save_netcdf, save_nwb
from finloop.io.record import save_json
from finloop.io.table import save_csv, save_csv_in_blocks, save_table
from finloop.io.video import VideoFacts
from finloop.project import EditSources, Project
from finloop.render.gallery import fish_by_tick
from finloop.render.painter import Box
from finloop.show.alone import build_standalone_page
from finloop.show.drawn import drawn_states
from finloop.show.pictures import PagePictures
from finloop.sprites.choice import SEQUENCES, SIDES
from stages.settings import load_settings

OUT, REPORT = Path("data/export"), Path("reports/export")
POINTS = ["head_x_px", "head_y_px", "head_confidence", "body_length_px"]


def _save_films(
    folder: Path, p: ExportSettings, project: Project, drawn: EditSources
) -> dict[str, Any]:
    """Write the animation and each sequence of sprites as films with transparency.

    drawn: the edit list with its tables. Return the content of films.json: frame rate, scale, size
    of the tank, and for each film its frames, size, whether it loops, and where it belongs. That is
    the place of its left top corner in the tank or, for sprites, of the mass centre in the film.
    """
    facts, edit, sprites = project.facts, drawn.edit, project.sprites
    gallery = project.gallery(drawn, residue=False)
    rate, channels = facts.frame_rate, 3 if facts.colour else 1
    # Pictures of each sequence, and the half side [px] of a square canvas that holds them all.
    cycles = {word: sprites_of_sequence(sprites, word, gallery) for word in SEQUENCES}
    films: dict[str, dict[str, int]] = {}
    pictures_to_come = edit["tick"].nunique() + sum(len(steps) for steps, _ in cycles.values())
    with report_progress("export", pictures_to_come) as advance:
        write_film = partial(_write_film, p=p, rate=rate, advance=advance)
        tank = FishOnlyPainter(facts.height_px, facts.width_px, channels)
        crop = box_of_all_fish(fish_by_tick(edit, gallery), tank)
        pictures = cut_out_fish(fish_by_tick(edit, gallery), tank, crop)
        facts_of_film = write_film(folder / p.mode, pictures, crop, round(p.webp_seconds * rate))
        place = {"left_px": crop.left, "top_px": crop.top}
        films[p.mode] = facts_of_film | place | {"loops": False}
        for word, (steps, half) in cycles.items():  # the mass centre is at (half, half)
            canvas = FishOnlyPainter(2 * half + 1, 2 * half + 1, channels)
            crop = box_of_all_fish(steps, canvas)
            pictures = cut_out_fish(steps, canvas, crop)
            facts_of_film = write_film(folder / word, pictures, crop, len(steps))
            place = {"pivot_x_px": half - crop.left, "pivot_y_px": half - crop.top}
            is_loop = word not in SIDES  # a turn ends in another heading
            films[word] = facts_of_film | place | {"loops": is_loop}
    return {
        "frame_rate_hz": round(float(rate), 4),
        "mm_per_px": facts.mm_per_px,
        "tank": {"width_px": facts.width_px, "height_px": facts.height_px},
        "films": films,
    }


def _write_film(
    path: Path, pictures: Iterable[Picture], crop: Box, webp_ticks: int, p: ExportSettings,
    rate: Fraction, advance: Callable[[], None],
) -> dict[str, int]:  # fmt: skip
    """Write pictures as a WebM, and the first ones also as a WebP; return their number and size.

    path: of both files, without suffix. There is no WebP if `webp_ticks` is 0. crop: the part of
    the tank that the pictures show. rate: frames per second. advance: is called after each picture.
    """
    shape = crop.bottom - crop.top, crop.right - crop.left, 4
    webm = WebmWriter(path.with_suffix(".webm"), shape, rate, p.webm_crf)
    webp = AlphaWebpWriter(path.with_suffix(".webp"), shape, rate, p.webp_quality)
    with webm, webp if webp_ticks else nullcontext():
        for number, picture in enumerate(pictures):
            webm.write(picture)
            if number < webp_ticks:
                webp.write(picture)
            advance()
    return {"frames": webm.frames, "width_px": shape[1], "height_px": shape[0]}


def _save_page(
    folder: Path, p: ExportSettings, project: Project, drawn: EditSources, ticks: int
) -> None:
    """Write a page to `folder`, stimulus.html, that plays the first `ticks` without a server.

    drawn: the edit list with its tables and the fish's bodies.
    """
    assert drawn.bodies is not None
    edit = drawn.edit.sort_values(["tick", "fish"], kind="stable")
    rows = list(edit[edit["tick"] < ticks].itertuples(index=False))
    states = drawn_states(rows, drawn.bodies)
    motion = states.reshape(-1, edit["fish"].nunique(), states.shape[1])  # (ticks, fish, numbers)
    page_pictures = PagePictures(project.gallery(drawn, residue=False), project.drawn_scale(p.mode))
    pictures = page_pictures.load_pictures(motion)
    text = build_standalone_page("finloop", project.rate_hz, project.background, pictures, motion)
    save_bytes(folder / "stimulus.html", text.encode())


def _save_tracks(folder: Path, p: ExportSettings, points: Poses, facts: VideoFacts) -> None:
    """Write the animals' tracks to `folder`: tracks.csv, and netCDF and NWB where the settings say.

    Where the film's scale is known, tracks_mm.csv has them in mm. points: keypoints, px.
    """
    mm_per_px = facts.mm_per_px
    save_csv_in_blocks(folder / "tracks.csv", deeplabcut_tables(points), decimals=3)
    if mm_per_px is not None:
        in_mm = replace(points, places=points.places * mm_per_px)
        save_csv_in_blocks(folder / "tracks_mm.csv", deeplabcut_tables(in_mm), decimals=4)
    if p.tracks_netcdf:
        save_netcdf(folder / "tracks.nc", points, facts.frame_rate, mm_per_px)
    if p.tracks_nwb:
        save_nwb(folder / "nwb", points, facts.frame_rate, mm_per_px)


def animal_names(project: Project, tracks: pd.DataFrame) -> pd.Series:
    """Return the name of the animal in each row of the table of tracks.

    It is the name in another program's tracks if they were given, else `animal_<identity>`, with
    leading zeros so that all names have one length.
    """
    if project.external_tracks is not None:
        return project.external_tracks["animal"]
    identities = project.identities
    digits = len(str(identities["identity"].max()))
    names = "animal_" + identities["identity"].astype(str).str.zfill(digits)
    return tracks["track_id"].map(names.set_axis(identities["track_id"]))


def main() -> None:
    """Write the files that other programs read to data/export/, and metrics to reports/export/.

    They are films with alpha, the sprites' atlas, the edit list, the animals' tracks as poses (CSV,
    netCDF, NWB) and a page that plays the animation.
    """
    p: ExportSettings = load_settings("export")
    with Project() as project, whole_folder(OUT) as folder:
        facts, features, sprites = project.facts, project.features[POINTS], project.sprites
        drawn = project.edit_with_sources(
            p.mode, "export", USED, sprites=True, bodies=p.stimulus_seconds > 0
        )
        edit, tracks, mm_per_px = drawn.edit, drawn.tracks, facts.mm_per_px
        length_px = project.drawn_scale(p.mode) * float(features["body_length_px"].median())
        least_frames = round(p.tracks_min_s * facts.frame_rate)
        animals = animal_names(project, tracks)
        points = keypoints_of_tracks(
            tracks, features, facts.frames, p.tracks_body_points, least_frames, p.tracks_most,
            animals,
        )  # fmt: skip
        films = _save_films(folder, p, project, drawn)
        save_json(folder / "films.json", films)
        if stimulus_ticks := round(p.stimulus_seconds * facts.frame_rate):
            _save_page(folder, p, project, drawn, stimulus_ticks)
        for atlas in sorted((project.data / "sprites").glob("atlas-*")):
            shutil.copyfile(atlas, folder / atlas.name)
        if edit["pose"].notna().any():
            shutil.copyfile(project.data / "pose/shapes.json", folder / "shapes.json")
        readable_edit = add_film_sources(edit, tracks, sprites, mm_per_px, length_px)
        save_csv(folder / f"{p.mode}.csv", flatten_poses(readable_edit), decimals=4, exact=True)
        save_table(folder / f"{p.mode}.parquet", readable_edit, READABLE)
        _save_tracks(folder, p, points, facts)
    animation = films["films"][p.mode]
    metrics = {
        "crop_width_px": animation["width_px"],
        "crop_height_px": animation["height_px"],
        "frames": animation["frames"],
        "animals": len(points.individuals),
        "track_rows_share": len(points.frame) / len(tracks),
    }
    save_metrics(REPORT / "metrics.json", metrics)


if __name__ == "__main__":
    run(main)
