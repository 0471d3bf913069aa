"""Draw docs/carp.jpg, the picture in the README: `python -m docs.picture`.

Above a frame of the drawn carp's film with what was found in it, below fish of that film with their
backbone, control points, motion area and heading.
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.pipeline import ROOT, STAGES, prepare, stage
from finloop.base.schema import lists_to_array
from finloop.drawn.carp.film import film
from finloop.extract.table import tracks_schema
from finloop.features.table import FEATURES
from finloop.io.cutouts import open_cutouts
from finloop.io.picture import load_picture, save_picture
from finloop.io.table import load_table
from finloop.plots.features import Specimen, contact_sheet
from finloop.settings import settings

CARP = settings(
    "clip", source="carp", frames=150, fish=4, width_px=1080, height_px=420, seed=11, fins=0.4
)
FRAME = 120
SHOWN = [(0, 120), (1, 120), (2, 120), (3, 120), (1, 60)]  # track, frame


def main() -> None:
    """Run the pipeline on a short film and put the picture together."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        names = ("frames", "fish", "width_px", "height_px", "seed", "fins")
        prepare(scratch, ["clip=carp", *(f"clip.{name}={getattr(CARP, name)}" for name in names)])
        for word in STAGES:
            stage(scratch, word)
        tracks = load_table(scratch / "data/extract/tracks.parquet", tracks_schema(33))
        table = load_table(scratch / "data/features/features.parquet", FEATURES)
        tank = load_picture(scratch / "data/extract/background.png")
        frame = next(one for number, (one, _) in enumerate(film(CARP)) if number == FRAME).copy()
        for _, row in tracks[tracks["frame"] == FRAME].iterrows():
            ring = np.stack([row["outline_x_px"], row["outline_y_px"]], 1)
            place = np.round(16 * ring).astype(np.int32)
            cv2.polylines(frame, [place], True, (255, 255, 255), 1, cv2.LINE_AA, 4)
        with open_cutouts(scratch / "data/extract/cutouts.arrow") as cutouts:
            specimens = []
            for track, number in SHOWN:
                at = int(np.flatnonzero((tracks.track_id == track) & (tracks.frame == number))[0])
                row = table[(table.track_id == track) & (table.frame == number)].iloc[0]
                line = np.stack([tracks["backbone_x_px"][at], tracks["backbone_y_px"][at]], 1)
                ends = lists_to_array(tracks["backbone_x_px"][at : at + 1])
                if abs(ends[0, 0] - row["head_x_px"]) > abs(ends[0, -1] - row["head_x_px"]):
                    line = line[::-1]
                cutout = cutouts[at]
                film_there = cutout.over(tank)
                specimens.append(Specimen(row, line, film_there, cutout.x0_px, cutout.y0_px))
        sheet = contact_sheet(specimens, columns=len(SHOWN), size=CARP.width_px // len(SHOWN))
    save_picture(ROOT / "docs/carp.jpg", np.vstack([frame, sheet]))


if __name__ == "__main__":
    main()
