"""Picture of `extract`: what segmentation makes of some frames."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from finloop.extract.background import Polarity, Scene
from finloop.extract.fins import Fins
from finloop.extract.samples import Typical
from finloop.extract.settings import Settings
from finloop.extract.table import SceneFacts
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import load_record
from finloop.io.several import folders
from finloop.io.video import ARENA_NAME, CLIP_NAME, FACTS_NAME, load_facts, load_mask, read_spread
from finloop.plots.extract import detections_picture
from finloop.plots.parts import one_below_another
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
FRAMES = 4


def main() -> None:
    """Draw detections.png."""
    settings: Settings = load("extract")
    films = [(name, home) for name, home in folders(CLIP) if (EXTRACT / home).is_dir()]
    count = max(1, FRAMES // len(films))
    pictures = [detections(name, home, settings, count) for name, home in films]
    save_picture(Path("reports/extract/detections.png"), one_below_another(pictures))


def detections(name: str, home: Path, settings: Settings, count: int) -> NDArray[np.uint8]:
    """The picture of one film, of this many frames."""
    clip, tracks_folder = CLIP / home, EXTRACT / home
    facts = load_facts(clip / FACTS_NAME)
    record = load_record(tracks_folder / "scene.json", SceneFacts, "extract")
    background = load_picture(tracks_folder / "background.png")
    scene = Scene(
        background, cast(Polarity, record.polarity), record.noise_grey, record.threshold_grey
    )
    typical = Typical(
        record.typical_area_px,
        record.typical_length_px,
        record.typical_contrast_grey,
        cast(Fins, record.fins),
        record.thin,
    )
    arena = load_mask(clip / ARENA_NAME, facts.width_px, facts.height_px).astype(np.uint8) * 255
    numbers = np.linspace(0, facts.frames - 1, min(count, facts.frames)).round().astype(int)
    frames = list(read_spread(clip / CLIP_NAME, numbers.tolist(), colour=facts.colour))
    return detections_picture(
        frames,
        [f"{name} frame {number}".strip() for number in numbers],
        scene,
        typical,
        arena,
        settings,
    )


if __name__ == "__main__":
    run(main)
