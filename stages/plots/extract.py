"""Pictures of `extract`: the segmentation of some frames, side branches (Figs. 3, 4)."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from finloop.base.arrays import Picture
from finloop.extract.background import Polarity, Scene
from finloop.extract.fins import Fins
from finloop.extract.samples import TypicalFish
from finloop.extract.settings import ExtractSettings
from finloop.extract.table import SceneFacts
from finloop.io.picture import load_picture, save_figure, save_picture
from finloop.io.record import load_record
from finloop.io.several import list_film_folders
from finloop.io.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    VideoFacts,
    load_facts,
    load_mask,
    read_chosen_frames,
)
from finloop.plots.branches import ThinnedFish, choose_fish_to_draw, figure3_4, thin_fish
from finloop.plots.extract import draw_detections
from finloop.plots.parts import stack_pictures
from stages.settings import load_settings

CLIP, EXTRACT, REPORT = Path("data/clip"), Path("data/extract"), Path("reports/film/extract")
FRAMES = 4  # whose detections are drawn, of all films together
THINNED_FRAMES = 50  # whose fish are thinned, of all films together: two are drawn in Figs. 3, 4


class ExtractedFilm(NamedTuple):
    """One film with the results of `extract` that are needed to segment its frames again."""

    name: str
    clip: Path
    facts: VideoFacts
    scene: Scene
    typical: TypicalFish
    arena: Picture

    def read_frames(self, count: int) -> Iterator[tuple[str, Picture]]:
        """Yield at most `count` frames spread over the film, as pairs (label, picture)."""
        numbers = np.linspace(0, self.facts.frames - 1, min(count, self.facts.frames))
        frames = numbers.round().astype(int).tolist()
        pictures = read_chosen_frames(self.clip / CLIP_NAME, frames, colour=self.facts.colour)
        for number, picture in zip(frames, pictures, strict=True):
            yield f"{self.name} frame {number}".strip(), picture


def main() -> None:
    """Draw the fish found in some frames, and how two fish are thinned (Figs. 3 and 4)."""
    settings: ExtractSettings = load_settings("extract")
    films = [
        load_extracted_film(name, home)
        for name, home in list_film_folders(CLIP)
        if (EXTRACT / home).is_dir()
    ]
    pictures = []
    for film in films:
        labels, frames = zip(*film.read_frames(max(1, FRAMES // len(films))), strict=True)
        extraction = film.scene, film.typical, film.arena, settings
        pictures.append(draw_detections(frames, labels, *extraction))
    save_picture(REPORT / "detections.png", stack_pictures(pictures))
    fish, caption = choose_fish_to_draw(_thin_fish_in_films(films, settings))
    save_figure(REPORT / "fig3_4.png", figure3_4(fish, caption))


def load_extracted_film(name: str, home: Path) -> ExtractedFilm:
    """Return a film with the results of `clip` and `extract`.

    name: of the film. home: its folder, relative to those of the two stages.
    """
    clip, tracks_folder = CLIP / home, EXTRACT / home
    facts = load_facts(clip / FACTS_NAME)
    record = load_record(tracks_folder / "scene.json", SceneFacts, "extract")
    background = load_picture(tracks_folder / "background.png")
    polarity, fins = cast(Polarity, record.polarity), cast(Fins, record.fins)
    scene = Scene(background, polarity, record.noise_grey, record.threshold_grey)
    typical = TypicalFish(
        record.typical_area_px, record.typical_length_px, record.typical_contrast_grey, fins,
        record.thin, limbs=record.limbs,
    )  # fmt: skip
    arena = load_mask(clip / ARENA_NAME, facts.width_px, facts.height_px).astype(np.uint8) * 255
    return ExtractedFilm(name, clip, facts, scene, typical, arena)


def _thin_fish_in_films(
    films: list[ExtractedFilm], settings: ExtractSettings
) -> Iterator[ThinnedFish]:
    """Yield fish of all films, each thinned to lines 1 px wide.

    The frames are spread evenly over each film. All films together have about `THINNED_FRAMES`.
    """
    count = max(1, THINNED_FRAMES // len(films))
    for film in films:
        for label, frame in film.read_frames(count):
            yield from thin_fish(frame, label, film.scene, film.typical, film.arena, settings)
