"""Draw the pictures of the tutorial and of troubleshooting: `python -m docs.guide_pictures`.

All of them show the drawn carp: real footage is never part of this repository.
"""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from benchmarks.pipeline import ROOT, prepare, stage
from finloop.io.picture import load_picture, save_picture

WIDE = 960  # px
NAMES = 42  # px of a sheet of detections, where the colours are named
CARP = [
    "clip=carp", "clip.frames=600", "clip.fish=3", "clip.width_px=760", "clip.height_px=460",
    "clip.body_length_px=90", "clip.seed=3", "clip.fins=0.3", "clip.shadow=0.3",
    "bpn.epochs=60", "animate.seconds=20", "animate.trials=1",
]  # fmt: skip
WORDS = (
    "clip", "extract", "features", "bpn", "sprites", "distance", "loops", "gateways", "animate",
    "export",
)  # fmt: skip
TOO_STRICT = ["extract.most_area_ratio=1.1", "extract.least_contrast_ratio=0.95"]
SEQUENCES = ("straight", "left", "right")
SHOWN = 5  # moments of each sequence


def whole_width(picture: np.ndarray) -> np.ndarray:
    """The picture `WIDE` px wide."""
    height = round(picture.shape[0] * WIDE / picture.shape[1])
    return cv2.resize(picture, (WIDE, height), interpolation=cv2.INTER_AREA)


def lower(sheet: np.ndarray) -> np.ndarray:
    """The names of the colours and the last two frames of a sheet of four."""
    return whole_width(np.vstack([sheet[:NAMES], sheet[(sheet.shape[0] + NAMES) // 2 :]]))


def chequered(height: int, width: int) -> np.ndarray:
    """What picture editors show where there is nothing."""
    y, x = np.mgrid[:height, :width] // 12
    return np.where((x + y) % 2, 205, 245)[..., None].repeat(3, axis=2).astype(np.uint8)


def over(sequence: Path, height: int, width: int) -> np.ndarray:
    """Some moments of an animated WebP, side by side over a chequered ground."""
    tiles = []
    with Image.open(sequence) as film:
        for number in np.linspace(0, film.n_frames - 1, SHOWN).round().astype(int):
            film.seek(int(number))
            fish = film.convert("RGBA")
            ground = Image.fromarray(chequered(height, width)).convert("RGBA")
            place = (width - fish.width) // 2, (height - fish.height) // 2
            ground.alpha_composite(fish, place)
            tiles.append(np.array(ground.convert("RGB")))
    return np.hstack(tiles)


def main() -> None:
    """Run the pipeline on a short film; keep pictures of it, one with settings that are wrong."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        prepare(scratch, CARP)
        for word in WORDS:
            stage(scratch, word)
        reports, export = scratch / "reports", scratch / "data/export"
        sheet = load_picture(reports / "features/contact_sheet.png")
        pictures = {
            "detections": lower(load_picture(reports / "extract/detections.png")),
            "doubtful": whole_width(sheet[: sheet.shape[0] // 4]),
            "export": np.vstack([over(export / f"{word}.webp", 128, 192) for word in SEQUENCES]),
        }
        prepare(scratch, [*CARP, *TOO_STRICT])
        stage(scratch, "extract")
        pictures["refused"] = lower(load_picture(reports / "extract/detections.png"))
    for name, picture in pictures.items():
        save_picture(ROOT / f"docs/{name}.jpg", picture)


if __name__ == "__main__":
    main()
