"""Draw all pictures: `python -m docs.draw`; from a finished run: `python -m docs.draw FOLDER`."""

import argparse
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from benchmarks.pipeline import ROOT
from docs.draw.browser import chromium, live_tank, report
from docs.draw.film import (
    RATE_HZ,
    Picture,
    add_caption,
    frames,
    resize_picture,
    save_film,
    save_still,
    steady,
    window,
)
from docs.draw.flow import save_flow
from docs.draw.guides import draw_guides, load
from docs.draw.pipeline import run
from docs.draw.search import search_picture
from finloop.edit.modes import MODES

PICTURES = ROOT / "docs/pictures"
CARP = ["clip=carp", "animate.trials=1"]
SHOWN = "hybrid"  # the mode of the story and of pictures of a single mode
HERO_PX, PANEL_PX, TANK_PX, REPORT_PX = 720, 320, 640, 800  # widths
FILM_S, OUTLINE_S, AFTER_S = 2.0, 2.4, 1.0  # durations of film, outlines, end after the last goal
WINDOW, PANEL_S = (360, 270), 8.0  # size and duration of the window that follows the fish
TANK_S = 7.0, 18.0  # begin and end in the film of the 3-D tank
OUTLINE = (120, 255, 220)
GAIT_FIGURES, FIGURE_PX = ("fig9", "fig10", "fig11", "fig12"), 800
SENT = [(0.25, 0.3), (0.75, 0.3), (0.55, 0.75)]  # goals of the fish in the live tank


def draw_outlines(folder: Path, start_s: float, end_s: float) -> Iterator[Picture]:
    """Yield the film with the outline of every fish."""
    tracks = pd.read_parquet(folder / "data/extract/tracks.parquet")
    rate = tracks_rate(folder)
    for number, picture in enumerate(frames(folder / "data/clip/clip.mp4", start_s, end_s)):
        marked = picture.copy()
        frame = round((start_s + number / RATE_HZ) * rate)
        for fish in tracks[tracks["frame"] == frame].itertuples():
            line = np.round(16 * np.stack([fish.outline_x_px, fish.outline_y_px], 1))
            cv2.polylines(marked, [line.astype(np.int32)], True, OUTLINE, 1, cv2.LINE_AA, 4)
        yield marked


def tracks_rate(folder: Path) -> float:
    """Return the clip's frames per second."""
    table = pd.read_parquet(folder / "data/features/features.parquet", columns=["frame", "time_s"])
    last = table.loc[table["frame"].idxmax()]
    return float(last["frame"] / last["time_s"])


def story(folder: Path) -> Iterator[Picture]:
    """Return the film, its outlines, and the fish on its way to A, B and C, with captions."""
    clip, edit = folder / "data/clip/clip.mp4", edit_list(folder, SHOWN)
    wanders = edit.loc[edit["goal"] == "", "time_s"]
    end_s = AFTER_S + float(wanders.iloc[0] if len(wanders) else edit["time_s"].iloc[-1])
    parts = (
        (frames(clip, 0, FILM_S), "1   The film"),
        (draw_outlines(folder, FILM_S, FILM_S + OUTLINE_S), "2   The fish is cut out and measured"),
        (frames(folder / f"data/render/{SHOWN}_marked.mp4", 0, end_s), "3   Sent to A, B and C"),
    )
    return chain.from_iterable(
        add_caption((resize_picture(one, HERO_PX) for one in steady(part)), words)
        for part, words in parts
    )


def edit_list(folder: Path, mode: str) -> pd.DataFrame:
    """Return the edit list of a mode; no goal is an empty name."""
    return pd.read_parquet(folder / f"data/animate/{mode}.parquet").fillna({"goal": ""})


def panel(path: Path, places: pd.DataFrame) -> Iterator[Picture]:
    """Return a window of a film that follows the fish smoothly."""
    smooth = places[["x_px", "y_px"]].rolling(51, center=True, min_periods=1).mean()

    def place(time_s: float) -> tuple[float, float]:
        at = np.searchsorted(places["time_s"], time_s)
        x, y = smooth.iloc[min(at, len(smooth) - 1)]
        return float(x), float(y)

    follow = window(steady(frames(path, 0, PANEL_S)), place, WINDOW)
    return (resize_picture(one, PANEL_PX) for one in follow)


def draw_panels(folder: Path) -> None:
    """Save panels of the film and of every mode, to be shown side by side."""
    film = pd.read_parquet(folder / "data/features/features.parquet")
    first = film[film["track_id"] == film["track_id"].iloc[0]]
    save_film(PICTURES / "film.webp", panel(folder / "data/clip/clip.mp4", first))
    for mode in sorted(MODES, key=lambda name: name == SHOWN):  # last, as its films are used later
        run(folder, [*CARP, f"render.mode={mode}", "render.comparison_seconds=0"], ["render"])
        moving = panel(folder / f"data/render/{mode}.mp4", edit_list(folder, mode))
        save_film(PICTURES / f"{mode}.webp", moving)


def draw_drawings() -> None:
    """Save a morph and drawings driven by a gait, by the commands of the guide."""
    swim = ["--gait", "trout", "--frames", "24", "--rate", "30"]
    gallop = ["--gait", "horse_gallop", "--frames", "20", "--rate", "30"]
    drawings = (
        {
            "morph": ("morph", ["face_a", "face_b"], ["--frames", "36", "--back"]),
            "dog": ("gait", ["dog_1", "dog_2"], ["--gait", "dog_walk"]),
            "fish": ("gait", ["fish_1", "fish_2"], swim),
        }
        | {
            f"{animal}_trot": ("gait", [f"{animal}_1", f"{animal}_2"], ["--gait", "dog_trot"])
            for animal in ("dog", "cat")
        }
        | {
            f"{animal}_gallop": ("gait", [f"{animal}_gallop_{key}" for key in (1, 2, 3, 4)], gallop)
            for animal in ("dog", "cat")
        }
    )
    for name, (tool, poses, how) in drawings.items():
        keys = [str(ROOT / f"data/drawings/{pose}.svg") for pose in poses]
        output = ["-o", str(PICTURES / f"{name}.webp"), "--size", str(PANEL_PX)]
        command = [sys.executable, "-m", f"finloop.{tool}", *keys, *how, *output]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)


def draw_forces() -> None:
    """Save the moving drawings of docs/forces.md, by the commands that stand there."""
    page = (ROOT / "docs/forces.md").read_text(encoding="utf-8")
    for command in re.findall(r"^\.venv/bin/python (-m finloop\.morph .*)$", page, re.MULTILINE):
        *words, name = shlex.split(command)  # of the output file
        words = [sys.executable, *words, str(PICTURES / name)]
        subprocess.run(words, cwd=ROOT, check=True, capture_output=True)


def pair_gait_figures(walk: Sequence[Picture], gallop: Sequence[Picture]) -> Picture:
    """Return figures of a walk at the left, and the same of a gallop at the right."""
    rows = []
    for pair in zip(walk, gallop, strict=True):
        left, right = (resize_picture(figure, FIGURE_PX) for figure in pair)
        height = max(len(left), len(right))
        pads = [((0, height - len(figure)), (4, 4), (0, 0)) for figure in (left, right)]
        cells = zip((left, right), pads, strict=True)
        rows.append(np.hstack([np.pad(one, pad, constant_values=255) for one, pad in cells]))
    return np.vstack(rows)


def draw_gaits(folder: Path) -> None:
    """Save figures of the drawn dog's walk beside those of the traced horse's gallop."""
    poses = ",".join(f"data/drawings/dog_gallop_{key}.svg" for key in (1, 2, 3, 4))
    horse = [
        "gait.regions=data/gaits/horse", "gait.regions_rate_hz=30",
        "gait.regions_cycle_frames=15", "gait.symmetry=none", f"gait.walker_drawings=[{poses}]",
    ]  # fmt: skip
    figures = []
    for values in ([], horse):
        run(folder, [*CARP, *values], ["gait"])
        paths = [folder / f"reports/gait/figures/limbs/{name}.png" for name in GAIT_FIGURES]
        figures.append([load(path) for path in paths])
    save_still(PICTURES / "gaits.webp", pair_gait_figures(*figures))


def draw_all(folder: Path) -> None:
    """Save all pictures from one run of the pipeline."""
    draw_panels(folder)
    save_film(PICTURES / "goals.webp", story(folder))
    tank = frames(folder / "data/tank/tank.mp4", *TANK_S)
    save_film(PICTURES / "tank.webp", (resize_picture(one, TANK_PX) for one in tank))
    save_still(PICTURES / "planner.webp", search_picture(folder))
    draw_drawings()
    draw_forces()
    draw_gaits(folder)
    save_still(PICTURES / "live.webp", live_tank(folder, SENT))
    save_still(PICTURES / "report.webp", resize_picture(report(folder), REPORT_PX))


def main() -> None:
    """Draw all pictures of docs/pictures/."""
    parser = argparse.ArgumentParser(prog="python -m docs.draw", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, help="a finished pipeline on the carp")
    folder = parser.parse_args().folder
    chromium()  # before the long work
    PICTURES.mkdir(exist_ok=True)
    save_flow(PICTURES / "flow.svg", ROOT / "dvc.yaml")
    with tempfile.TemporaryDirectory() as scratch:
        if folder is None:
            folder = Path(scratch) / "carp"
            run(folder, CARP)
        draw_all(folder.resolve())
        draw_guides(folder, Path(scratch), PICTURES)
    size = sum(path.stat().st_size for path in PICTURES.iterdir())
    print(f"docs: {len(list(PICTURES.iterdir()))} pictures, {size / 1e6:.1f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
