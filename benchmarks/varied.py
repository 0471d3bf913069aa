"""A film of any number of pictures, varied from the film in data/, as `extract` writes it.

Every track appears again and again, each time as another fish: bent more or less, larger or
smaller, lighter or darker, its sides exchanged or not, in another direction, drawn by the puppet.
"""

import shutil
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from finloop.base.arrays import Floats
from finloop.base.cutout import Cutout
from finloop.base.schema import lists_to_array, lists_to_points
from finloop.extract.table import SceneFacts, tracks_schema
from finloop.features.head import begins_at_tail
from finloop.features.table import FEATURES
from finloop.io.cutouts import CUTOUTS_NAME, TRACKS_NAME, CutoutStore, CutoutWriter, open_cutouts
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import load_json, load_record, remake_hint
from finloop.io.table import load_list_columns, load_table, table_writer
from finloop.io.video import ARENA_NAME, CLIP_NAME, FACTS_NAME, load_facts, save_facts
from finloop.pose.film import POSES, FilmPoses, restore_poses
from finloop.puppet.drawing import PosedPicture, place_backbone
from finloop.puppet.pose import Pose, mirror_posture

WORKERS = 2


@dataclass(frozen=True)
class Base:
    """The film to vary: its folder `data`, tables and postures, row by row."""

    home: Path
    tracks: pd.DataFrame
    poses: FilmPoses
    side: int  # px of a square that holds the turned picture of the film

    @classmethod
    @cache
    def from_folder(cls, home: Path) -> "Base":
        """Load the film; FinloopError if a stage up to `pose` has not run."""
        points = load_record(home / "extract/scene.json", SceneFacts, "extract").points
        tracks = load_table(home / "extract" / TRACKS_NAME, tracks_schema(points))
        features = load_table(home / "features/features.parquet", FEATURES)
        back = begins_at_tail(lists_to_points(tracks, "backbone"), features)
        tracks["half_width_px"] = [
            width[::-1] if turn else width
            for width, turn in zip(tracks["half_width_px"], back, strict=True)
        ]
        (codes,) = load_list_columns(home / "pose/poses.parquet", POSES, "codes")
        poses = load_json(
            home / "pose/shapes.json",
            lambda facts: restore_poses(features, codes, facts),
            *remake_hint("pose"),
        )
        facts = load_facts(home / "clip" / FACTS_NAME)
        return cls(home, tracks, poses, int(np.ceil(np.hypot(facts.width_px, facts.height_px))))


@dataclass(frozen=True)
class Variation:
    """The changes of a copy: the turn of the whole tank, factors, and whether it is mirrored."""

    turn_rad: float
    bend: float
    size: float
    light: float
    mirror: bool

    @classmethod
    def from_number(cls, number: int) -> "Variation":
        """Return the variation of a copy; the first is the film itself."""
        if not number:
            return cls(0.0, 1.0, 1.0, 1.0, False)
        rng = np.random.default_rng(number)
        turn_rad = float(rng.uniform(0, 2 * np.pi))
        bend, size, light = (
            float(rng.uniform(1 - spread, 1 + spread)) for spread in (0.2, 0.1, 0.15)
        )
        return cls(turn_rad, bend, size, light, bool(rng.integers(2)))

    def transform_points(self, points: Floats, base: Base) -> Floats:
        """Transform points (…, 2) of the film to the picture of the copy."""
        facts = load_facts(base.home / "clip" / FACTS_NAME)
        from_middle = points - (facts.width_px / 2, facts.height_px / 2)
        if self.mirror:
            from_middle = from_middle * (1, -1)
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        x, y = from_middle[..., 0], from_middle[..., 1]
        return np.stack([cos * x + sin * y, cos * y - sin * x], -1) + base.side / 2


def write_film(home: Path, folder: Path, pictures: int) -> None:
    """Write data/clip and data/extract of a film of `pictures` pictures into a folder.

    `home` is the folder `data` of a film with stages up to `pose`.
    """
    base = Base.from_folder(home)
    clip, extract = folder / "clip", folder / "extract"
    clip.mkdir(parents=True)
    extract.mkdir()
    copies = -(-pictures // len(base.tracks))
    _write_clip(base, clip, copies)
    shutil.copyfile(home / "extract/scene.json", extract / "scene.json")
    _pad_to_square(home / "extract/background.png", extract / "background.png", base.side)
    schema = tracks_schema(load_record(extract / "scene.json", SceneFacts, "extract").points)
    with (
        table_writer(extract / TRACKS_NAME, schema) as write,
        CutoutWriter(extract / CUTOUTS_NAME) as cutouts,
        ProcessPoolExecutor(WORKERS) as pool,
    ):
        missing = pictures
        for table, cutouts_of_copy in pool.map(partial(_vary_film, home), range(copies)):
            write(table[:missing])
            for cutout in cutouts_of_copy[:missing]:
                cutouts.write(cutout)
            missing -= len(cutouts_of_copy[:missing])


def _write_clip(base: Base, folder: Path, copies: int) -> None:
    """Write the facts of the copies one after the other, and square pictures of the tank."""
    home = base.home / "clip"
    facts = load_facts(home / FACTS_NAME)
    segments = [
        (first + copy * facts.frames, stop + copy * facts.frames)
        for copy in range(copies)
        for first, stop in facts.segments
    ]
    all_copies = replace(
        facts, width_px=base.side, height_px=base.side, frames=copies * facts.frames,
        segments=tuple(segments),
    )  # fmt: skip
    save_facts(folder / FACTS_NAME, all_copies)
    (folder / CLIP_NAME).symlink_to((home / CLIP_NAME).resolve())
    _pad_to_square(home / "tank.png", folder / "tank.png", base.side)
    save_picture(folder / ARENA_NAME, np.full((base.side, base.side), 255, np.uint8))


def _pad_to_square(source: Path, target: Path, side: int) -> None:
    """Write a picture padded to a square by repeating its edge."""
    picture = load_picture(source)
    down, across = (side - length for length in picture.shape[:2])
    margins = (down // 2, down - down // 2, across // 2, across - across // 2)
    save_picture(target, cv2.copyMakeBorder(picture, *margins, cv2.BORDER_REPLICATE))


def _vary_film(home: Path, copy_number: int) -> tuple[pd.DataFrame, list[Cutout]]:
    """Return the table of tracks and the cut-outs of one copy of the film."""
    base, variation = Base.from_folder(home), Variation.from_number(copy_number)
    frames = load_facts(home / "clip" / FACTS_NAME).frames
    tracks, pose = base.tracks, base.poses.pose
    mean = base.poses.shapes.mean
    posture = mean + variation.bend * (pose.posture - mean)
    if variation.mirror:
        posture = mirror_posture(posture)
    x, y = variation.transform_points(tracks[["x_px", "y_px"]].to_numpy(float), base).T
    heading = (-1 if variation.mirror else 1) * pose.heading_rad + variation.turn_rad
    target = Pose(x, y, heading, variation.size * pose.size_px, posture)
    first_track = copy_number * (int(tracks["track_id"].max()) + 1)
    table = tracks.assign(
        track_id=(tracks["track_id"] + first_track).astype("int32"),
        frame=(tracks["frame"] + copy_number * frames).astype("int32"),
        x_px=x, y_px=y,
        area_px=tracks["area_px"] * np.float32(variation.size**2),
        contrast=tracks["contrast"] * np.float32(variation.light),
        length_px=tracks["length_px"] * np.float32(variation.size),
        half_width_px=_split_values(lists_to_array(tracks["half_width_px"]) * variation.size),
    )  # fmt: skip
    outline = variation.transform_points(lists_to_points(tracks, "outline").astype(float), base)
    for name, points in (("backbone", target.backbone_px()), ("outline", outline)):
        for axis, values in zip("xy", np.moveaxis(points, -1, 0), strict=True):
            table[f"{name}_{axis}_px"] = _split_values(values)
    keys = table[["track_id", "frame"]].to_numpy().tolist()
    with open_cutouts(home / "extract" / CUTOUTS_NAME) as store:
        return table, list(_draw_cutouts(base, store, target, variation, keys))


def _draw_cutouts(
    base: Base, store: CutoutStore, target: Pose, variation: Variation, keys: list[list[int]]
) -> Iterator[Cutout]:
    """Yield the copy's cut-outs, cropped to the fish."""
    for row, (track_id, frame) in enumerate(keys):
        film_cutout = store[row]
        source = place_backbone(base.poses.pose[row], film_cutout.x0_px, film_cutout.y0_px)
        posed = PosedPicture(
            film_cutout.pixels, source, place_backbone(target[row]), variation.mirror
        )
        top, left, bottom, right = posed.box
        box = max(top, 0), max(left, 0), min(bottom, base.side), min(right, base.side)
        picture = posed.draw_part(box)
        picture[..., :-1] = np.minimum(variation.light * picture[..., :-1], picture[..., -1:])
        pixels = np.round(255 * picture).clip(0, 255).astype(np.uint8)
        x, y, w, h = cv2.boundingRect(pixels[..., -1])
        cropped = np.ascontiguousarray(pixels[y : y + h, x : x + w])
        yield Cutout(track_id, frame, box[1] + x, box[0] + y, cropped)


def _split_values(values: Floats) -> list[Floats]:
    """Return the values in a list of arrays, one for each frame."""
    return list(values.astype(np.float32))
