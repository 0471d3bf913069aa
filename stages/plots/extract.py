"""Picture of `extract`: what segmentation makes of some frames."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path
from typing import cast

import numpy as np

from finloop.extract.background import Polarity, Scene
from finloop.extract.samples import Typical
from finloop.extract.settings import Settings
from finloop.extract.table import SceneFacts
from finloop.io.picture import load_picture, save_picture
from finloop.io.record import load_record
from finloop.io.video import ARENA_NAME, CLIP_NAME, FACTS_NAME, load_facts, load_mask, read_spread
from finloop.plots.extract import detections_picture
from stages.settings import load

CLIP, EXTRACT = Path("data/clip"), Path("data/extract")
FRAMES = 4


def main() -> None:
    """Draw detections.png."""
    settings: Settings = load("extract")
    facts = load_facts(CLIP / FACTS_NAME)
    known = load_record(EXTRACT / "scene.json", SceneFacts, "extract")
    background = load_picture(EXTRACT / "background.png")
    scene = Scene(
        background, cast(Polarity, known.polarity), known.noise_grey, known.threshold_grey
    )
    typical = Typical(known.typical_area_px, known.typical_length_px, known.typical_contrast_grey)
    arena = load_mask(CLIP / ARENA_NAME, facts.width_px, facts.height_px).astype(np.uint8) * 255
    numbers = np.linspace(0, facts.frames - 1, min(FRAMES, facts.frames)).round().astype(int)
    frames = list(read_spread(CLIP / CLIP_NAME, numbers.tolist(), colour=facts.colour))
    picture = detections_picture(frames, numbers.tolist(), scene, typical, arena, settings)
    save_picture(Path("reports/extract/detections.png"), picture)


if __name__ == "__main__":
    run(main)
