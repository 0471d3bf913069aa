"""Picture of `clip`: how good the film is, over time."""

from pathlib import Path

import numpy as np

from finloop.base.arrays import Picture
from finloop.base.light import undo_gain
from finloop.clip.check import CHECK, CHECK_NAME, TANK_NAME
from finloop.clip.light import measure_gain
from finloop.clip.shake import to_grey
from finloop.io.picture import load_picture, save_picture
from finloop.io.several import list_film_folders
from finloop.io.table import load_table
from finloop.io.video import CLIP_NAME, FACTS_NAME, load_facts, read_chosen_frames
from finloop.plots.clip import draw_film_check
from finloop.plots.parts import stack_pictures

CLIP = Path("data/clip")


def main() -> None:
    """Draw how good the film is, reports/film/clip/check.png; several films one below another."""
    pictures = [_draw_film(name, CLIP / home) for name, home in list_film_folders(CLIP)]
    save_picture(Path("reports/film/clip/check.png"), stack_pictures(pictures))


def _draw_film(name: str, clip: Path) -> Picture:
    """Return a picture of one film: a frame, its difference from the tank, and curves over time.

    name: of the film. clip: folder of its clip.
    """
    facts = load_facts(clip / FACTS_NAME)
    middle = [facts.frames // 2]
    (frame,) = read_chosen_frames(clip / CLIP_NAME, middle, colour=facts.colour)
    (grey_frame,) = read_chosen_frames(clip / CLIP_NAME, middle)
    tank = to_grey(load_picture(clip / TANK_NAME))
    table = load_table(clip / CHECK_NAME, CHECK)
    even_light = undo_gain(grey_frame, measure_gain(grey_frame, tank))
    difference = np.abs(even_light.astype(np.float32) - tank)
    title = f"{name} a frame of the film".strip()
    return draw_film_check(frame, difference, table, facts.frame_rate_hz, title)
