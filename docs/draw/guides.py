"""The pictures of the tutorial and of troubleshooting."""

from pathlib import Path

import numpy as np
from PIL import Image

from docs.draw.film import Picture, resize_picture, save_still
from docs.draw.pipeline import run

WIDE = 960  # px
NAMES = 42  # px height of the legend on a sheet of detections
THREE = [
    "clip=carp", "clip.frames=600", "clip.fish=3", "clip.width_px=760", "clip.height_px=460",
    "clip.body_length_px=90", "clip.seed=3", "clip.fins_open_ratio=0.3",
]  # fmt: skip
TOO_STRICT = ["extract.max_area_ratio=1.1", "extract.min_contrast_ratio=0.95"]
SEQUENCES = ("straight", "left", "right")
MOMENTS = 5  # of each sequence
CELL = (128, 192)  # px, height and width


def load(path: Path) -> Picture:
    """Return a picture as RGB."""
    return np.asarray(Image.open(path).convert("RGB"))


def lower(sheet: Picture) -> Picture:
    """Return the legend and the last two frames of a sheet of four."""
    return resize_picture(np.vstack([sheet[:NAMES], sheet[(sheet.shape[0] + NAMES) // 2 :]]), WIDE)


def draw_checkerboard(height: int, width: int) -> Picture:
    """Draw the checkerboard that picture editors show for transparency."""
    y, x = np.mgrid[:height, :width] // 12
    return np.where((x + y) % 2, 205, 245)[..., None].repeat(3, axis=2).astype(np.uint8)


def strip(sequence: Path) -> Picture:
    """Return some frames of an animated WebP, side by side on a checkerboard."""
    tiles = []
    height, width = CELL
    with Image.open(sequence) as film:
        count = getattr(film, "n_frames", 1)
        for number in np.linspace(0, count - 1, MOMENTS).round().astype(int):
            film.seek(int(number))
            fish = film.convert("RGBA")
            ground = Image.fromarray(draw_checkerboard(height, width)).convert("RGBA")
            ground.alpha_composite(fish, ((width - fish.width) // 2, (height - fish.height) // 2))
            tiles.append(np.asarray(ground.convert("RGB")))
    return np.hstack(tiles)


def draw_guides(folder: Path, scratch: Path, pictures: Path) -> None:
    """Save the pictures, from a finished pipeline and from a short film run in `scratch`."""
    export = folder / "data/export"
    sequences = np.vstack([strip(export / f"{word}.webp") for word in SEQUENCES])
    save_still(pictures / "export.webp", sequences)
    three = scratch / "three"
    run(three, THREE, ("clip", "extract", "plots-extract", "features", "plots-features"))
    sheet = load(three / "reports/film/features/contact_sheet.png")
    save_still(pictures / "doubtful.webp", resize_picture(sheet[: sheet.shape[0] // 4], WIDE))
    save_still(
        pictures / "detections.webp", lower(load(three / "reports/film/extract/detections.png"))
    )
    run(three, [*THREE, *TOO_STRICT], ("extract", "plots-extract"))
    save_still(
        pictures / "refused.webp", lower(load(three / "reports/film/extract/detections.png"))
    )
