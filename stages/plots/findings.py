"""Pictures of faults of the film: each in a frame in which it is seen."""

from functools import partial
from pathlib import Path

import pandas as pd

from finloop.clip.check import CHECK, CHECK_NAME, TANK_NAME
from finloop.extract.settings import ExtractSettings
from finloop.io.findings import load_faults
from finloop.io.picture import load_picture, save_picture
from finloop.io.several import list_film_folders
from finloop.io.table import load_table, save_csv
from finloop.io.video import CLIP_NAME, FACTS_NAME, load_facts, read_chosen_frames
from finloop.plots.findings import FaultPicture, draw_animal_fault, draw_film_fault
from stages.plots.extract import CLIP, EXTRACT, load_extracted_film
from stages.settings import load_settings

FINDINGS = Path("reports/film/findings")
SEARCHED = 32  # frames of a film in which an animal that shows a fault is searched


def main() -> None:
    """Draw the faults of each film that are seen in a frame, in reports/film/findings/.

    Their names and captions stand there in pictures.csv. Without such a fault nothing is written.
    """
    settings: ExtractSettings = load_settings("extract")
    homes, rows = dict(list_film_folders(CLIP)), []
    for film, word in load_faults([CLIP, EXTRACT])[["film", "what"]].itertuples(index=False):
        if shown := _draw_fault(word, film, homes[film], settings):
            name = f"{film and film + '_'}{word}.png"
            save_picture(FINDINGS / name, shown.picture)
            rows.append({"film": film, "what": word, "picture": name, "caption": shown.caption})
    if rows:
        save_csv(FINDINGS / "pictures.csv", pd.DataFrame(rows), decimals=0)


def _draw_fault(word: str, name: str, home: Path, settings: ExtractSettings) -> FaultPicture | None:
    """Return a picture of a fault of one film, with its caption.

    None if no frame shows the fault, or `extract` has left out the film. word: the kind of fault.
    name: of the film. home: its folder, relative to CLIP and EXTRACT.
    """
    clip = CLIP / home
    facts = load_facts(clip / FACTS_NAME)
    read_frames = partial(read_chosen_frames, clip / CLIP_NAME, colour=facts.colour)
    table, tank = load_table(clip / CHECK_NAME, CHECK), load_picture(clip / TANK_NAME)
    if shown := draw_film_fault(word, table, facts.frame_rate_hz, tank, read_frames):
        return shown
    if not (EXTRACT / home).is_dir():  # a film that was left out
        return None
    film = load_extracted_film(name, home)
    frames = film.read_frames(SEARCHED)
    return draw_animal_fault(word, frames, film.scene, film.typical, film.arena, settings)
