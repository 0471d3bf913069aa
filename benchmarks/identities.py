"""Identity tracking: finloop and idtracker.ai 6.0.14, on the latter's clips and on drawn carp.

`python -m benchmarks.identities [--environment FOLDER | --alone] [--films A B drawn-1 …]`

idtracker.ai runs from its command line in an environment of its own. pip makes it unless
`--environment` names one that contains it; `--alone` omits it. Clips A and B come from its wheel,
eight zebrafish each. The drawn films show five carp that swim through one another for a minute,
with the truth.
idtracker.ai gets the number of animals, the tank, and the thresholds of its own example and test;
finloop gets the path. Both write the place and the animal of every fish-frame. A switch is a change
of the animal that a program assigns to a fish, between two unambiguous places. The fish is the true
fish of a drawn film; clips A and B have no truth, so there it is the other program's.

On a processor idtracker.ai's default, contrastive learning, takes hours per clip.
`--idtracker "--disable_contrastive true"` selects the method of its version 5, and the table shows
this. With OMP_NUM_THREADS=1 clip A then takes three quarters of an hour.

Results: identities.csv, a row for each film and program, which replaces the old row; and in the
folder `--keep` disagreements.csv, every switch with its frames and place.
"""

import argparse
import os
import resource
import subprocess
import tempfile
import time
import venv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from benchmarks.films import file_overrides
from benchmarks.pipeline import ROOT, prepare_folder, run_stage
from finloop.base.arrays import Floats, Mask
from finloop.base.settings import settings
from finloop.clip.settings import CarpSettings
from finloop.drawn.carp.film import film_frames
from finloop.drawn.carp.motion import CarpMotion, allowed_rectangle, simulate_swimming
from finloop.io.movie import VideoWriter
from finloop.io.poses import load_poses
from finloop.io.table import save_csv
from finloop.io.wheel import PACKAGE, TANK_PX, fetch_zebrafish_clips, find_cache_folder
from finloop.project import Project

# The package needs PyTorch and torchvision, but does not install them.
PACKAGES = (PACKAGE, "torch", "torchvision")
TABLE = ROOT / "benchmarks/identities.csv"
FISH, RATE = 5, 25  # of a drawn film
_TOUCH, _TWICE = 0.5, 2.0  # body lengths; least ratio of the next animal's distance


@dataclass(frozen=True)
class Film:
    """A film, the settings of each program for it, and its truth, if known."""

    path: Path
    overrides: list[str]
    animals: int
    box: tuple[int, int, int, int]  # left, top, width, height of the tank, px
    dark: int  # brightest level of an animal
    least_px: int  # least area of an animal
    truth: pd.DataFrame | None = None  # frame, animal, x_px, y_px


def zebrafish_film(part: str, dark: int, least_px: int) -> Film:
    """Return a clip of the package of idtracker.ai as a film, with the settings for it.

    part: of the clip's name; dark: grey below which a pixel is fish; least_px: smallest fish, px.
    """
    (path,) = fetch_zebrafish_clips([part], find_cache_folder())
    return Film(path, ["clip=zebrafish", f"clip.parts={part}"], 8, TANK_PX, dark, least_px)


def carp_film(seed: int, folder: Path) -> Film:
    """Return a drawn film of carp that ignore each other, and so swim through one another."""
    p = settings(
        "clip", source="carp", frames=60 * RATE, fish=FISH, width_px=480, height_px=360,
        body_length_px=60.0, frame_rate_hz=float(RATE), colour=False, seed=seed,
    )  # fmt: skip
    path, rows = folder / "carp.mp4", list[dict[str, object]]()
    with VideoWriter(path, p.width_px, p.height_px, Fraction(RATE), p.colour) as writer:
        for picture, frame_rows in film_frames(p, crossing_motion(p)):
            writer.write(picture)
            rows += frame_rows
    truth = pd.DataFrame(rows).rename(columns={"fish_id": "animal"})
    inside = 12, 12, p.width_px - 24, p.height_px - 24  # the rim is dark
    overrides = file_overrides(path)
    return Film(path, overrides, FISH, inside, 125, 100, truth[["frame", "animal", *_PLACE]])


def crossing_motion(carp: CarpSettings) -> CarpMotion:
    """Return the poses of carp that each swim as if alone."""
    room = allowed_rectangle(carp.width_px, carp.height_px, carp.body_length_px)
    streams = np.random.default_rng(carp.seed).spawn(carp.fish)
    motions = [
        simulate_swimming(carp.frames, 1, room, carp.frame_rate_hz, carp.fins_open_ratio, rng)
        for rng in streams
    ]
    names = [field.name for field in fields(CarpMotion)]
    return CarpMotion(
        *(np.concatenate([getattr(motion, name) for motion in motions], axis=1) for name in names)
    )


FILMS: dict[str, Callable[[Path], Film]] = {
    "A": lambda _: zebrafish_film("A", 155, 100),  # the thresholds of the example in its manual
    "B": lambda _: zebrafish_film("B", 130, 150),  # the thresholds of its own test
    **{f"drawn-{seed}": partial(carp_film, seed) for seed in (1, 2, 3)},
}
_PLACE = ["x_px", "y_px"]


# --- the two programs


def tracker_environment(folder: Path) -> Path:
    """Return the environment of idtracker.ai; install it if missing."""
    if not tracker_command(folder).exists():
        venv.create(folder, with_pip=True)
        python = tracker_command(folder).with_name("python")
        subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    return folder


def tracker_command(environment: Path) -> Path:
    """Return the path of idtracker.ai's program in its environment."""
    return environment / "bin/idtrackerai"


def track_by_idtracker(
    film: Film, folder: Path, environment: Path, extra_arguments: Sequence[str]
) -> pd.DataFrame:
    """Return what idtracker.ai tracks in a film: frame, animal, x_px, y_px."""
    left, top, width, height = map(float, film.box)
    right, low = left + width, top + height
    options = {
        "name": "film",
        "video_paths": [str(film.path)],
        "output_dir": str(folder),
        "intensity_ths": [0, film.dark],
        "area_ths": [float(film.least_px), float("inf")],
        "number_of_animals": film.animals,
        "roi_list": [f"+ Polygon [[{left}, {top}], [{right}, {top}], [{right}, {low}], "
                     f"[{left}, {low}]]"],
        "trajectories_formats": ["npy"],
    }  # fmt: skip
    toml = folder / "film.toml"
    text = "\n".join(f"{key} = {value!r}" for key, value in options.items())
    toml.write_text(text, encoding="utf-8")
    variables = os.environ | {"IDTRACKERAI_DISABLE_ANALYTICS": "1", "QT_QPA_PLATFORM": "offscreen"}
    line = [str(tracker_command(environment)), "--load", str(toml), "--track", *extra_arguments]
    with (folder / "log.txt").open("w", encoding="utf-8") as log:
        subprocess.run(line, cwd=folder, env=variables, stdout=log, stderr=log, check=False)
    session = folder / "session_film"
    if not (session / "trajectories").is_dir():  # its exit status is 1 even after a success
        raise SystemExit(f"idtracker.ai made no trajectories of {film.path}; see {folder}/log.txt")
    poses = load_poses(session, "idtracker.ai", RATE)
    places = pd.DataFrame(poses.places[:, 0], columns=_PLACE)
    return places.assign(frame=poses.frame, animal=poses.individual)


def track_by_finloop(film: Film, folder: Path) -> pd.DataFrame:
    """Return what finloop tracks in a film: frame, animal, x_px, y_px, body_length_px."""
    prepare_folder(folder, film.overrides)
    for stage in ("clip", "extract", "features", "identity"):
        run_stage(folder, stage)
    project = Project(folder)
    rows = project.features.merge(project.identities, on="track_id").rename(
        columns={"identity": "animal"}
    )
    return rows[["frame", "animal", *_PLACE, "body_length_px"]]


# --- the comparison


def match_places(reference: pd.DataFrame, other: pd.DataFrame, length_px: float) -> pd.DataFrame:
    """Return the places of two tables that show one fish: frame, animal, x_px, y_px, other.

    Matched places are each other's nearest, less than half a body length apart, and no third place
    is within twice that distance of either.
    """
    other_by_frame = dict(list(other.groupby("frame")))
    parts = [reference.iloc[:0].assign(other=0)]
    for frame, rows in reference.groupby("frame"):
        if frame in other_by_frame:
            other_rows = other_by_frame[frame]
            distances = cdist(rows[_PLACE], other_rows[_PLACE]) / length_px
            row, column = np.nonzero(is_unambiguous(distances) & is_unambiguous(distances.T).T)
            animals = other_rows["animal"].to_numpy()[column]
            parts.append(rows.iloc[row].assign(other=animals))
    return pd.concat(parts).sort_values(["animal", "frame"], ignore_index=True)


def is_unambiguous(distances: Floats) -> Mask:
    """Return where the least distance of each row is, (n, m): nowhere if that is not clear.

    distances (n, m): body lengths. It is clear if the least is below _TOUCH, and the next is more
    than _TWICE as large.
    """
    nearest = np.sort(np.pad(distances, ((0, 0), (0, 1)), constant_values=np.inf), axis=1)
    is_clear = (nearest[:, 0] < _TOUCH) & (nearest[:, 1] > _TWICE * nearest[:, 0])
    return is_clear[:, None] & (distances == nearest[:, :1])


def identity_switches(matched: pd.DataFrame) -> pd.DataFrame:
    """Return the matched places at which the other table's animal of a fish changes."""
    before = matched.shift()
    same_fish = matched["animal"] == before["animal"]
    changed = matched[same_fish & (matched["other"] != before["other"])]
    last = before.loc[changed.index, ["frame", "other"]].astype(int)
    return changed.rename(columns={"other": "becomes"}).assign(
        last_frame=last["frame"], was=last["other"]
    )


def count_right_animals(matched: pd.DataFrame) -> int:
    """Return in how many fish-frames the animal is right, as animals are best assigned to fish."""
    table = pd.crosstab(matched["animal"], matched["other"]).to_numpy()
    return int(table[linear_sum_assignment(table, maximize=True)].sum())


def summarize_program(
    places: pd.DataFrame, animals: int, frames: int, matched: pd.DataFrame
) -> dict[str, float]:
    """Return the scores of a program, from its places and their matches."""
    rows = places.groupby("animal").size().sort_values(ascending=False)
    share = 100 / (animals * frames)
    return {
        "animals": len(rows),
        "fish_frames_pct": share * len(places),
        "fish_frames_of_most_pct": share * float(rows.iloc[:animals].sum()),
        "switches": len(identity_switches(matched)),
        "same_animal_pct": share * count_right_animals(matched),
    }


def time_programs(work: Callable[[], pd.DataFrame]) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return the result of `work`, and time and processor time [s] of the programs it ran."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    result = work()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return result, {"time_s": time.perf_counter() - begin, "processor_s": busy}


def compare_programs(
    name: str, folder: Path, environment: Path | None, arguments: Sequence[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return a film's rows of the table, and the switches of each program.

    environment, arguments: of idtracker.ai; without an environment only finloop runs.
    """
    film = FILMS[name](folder)
    (home := folder / "finloop").mkdir(exist_ok=True)
    places, times = time_programs(lambda: track_by_finloop(film, home))
    frames, length = Project(home).facts.frames, float(places["body_length_px"].median())
    runs = [("finloop", "", places[["frame", "animal", *_PLACE]], times)]
    if environment is not None:
        (home := folder / "idtracker").mkdir(exist_ok=True)
        run = partial(track_by_idtracker, film, home, environment, arguments)
        runs.append(("idtracker.ai", " ".join(arguments), *time_programs(run)))
    rows, switches = list[dict[str, object]](), list[pd.DataFrame]()
    for number, (program, words, places, times) in enumerate(runs):
        reference = runs[1 - number][2] if film.truth is None else film.truth
        matched = match_places(reference, places, length)
        rows.append({
            "film": name, "program": program, "settings": words,
            "beside": "the other" if film.truth is None else "truth",
            **summarize_program(places, film.animals, frames, matched), **times,
        })  # fmt: skip
        switches.append(identity_switches(matched).assign(film=name, program=program))
    return pd.DataFrame(rows), pd.concat(switches)


def keep_rows(rows: pd.DataFrame) -> None:
    """Write the rows of a film into the table, in place of its old rows."""
    if TABLE.is_file():
        key = ["film", "program"]
        table = pd.read_csv(TABLE, dtype={"settings": str}).fillna({"settings": ""})
        rows = pd.concat([table, rows]).drop_duplicates(key, keep="last").sort_values(key)
    save_csv(TABLE, rows, decimals=2)


def main() -> None:
    """Run both programs on each film; print and keep the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--environment", type=Path, help="one with idtracker.ai")
    parser.add_argument("--alone", action="store_true", help="only finloop, on films with a truth")
    parser.add_argument("--keep", type=Path, help="a working folder, which is kept")
    parser.add_argument("--films", nargs="*", choices=list(FILMS))
    parser.add_argument("--idtracker", default="", help="more arguments for idtracker.ai")
    args = parser.parse_args()
    films = args.films or [name for name in FILMS if not args.alone or name.startswith("drawn")]
    if args.alone and not all(name.startswith("drawn") for name in films):
        parser.error("--alone needs films with a truth: clips A and B have none")
    with tempfile.TemporaryDirectory() as scratch:
        home = (args.keep or Path(scratch)).resolve()
        home.mkdir(parents=True, exist_ok=True)
        environment = None
        if not args.alone:
            environment = tracker_environment((args.environment or home / "environment").resolve())
        all_switches = list[pd.DataFrame]()
        for name in films:
            (folder := home / name).mkdir(exist_ok=True)
            rows, switches = compare_programs(name, folder, environment, args.idtracker.split())
            print(rows.round(2).to_string(), switches.round(1).to_string(), sep="\n", flush=True)
            keep_rows(rows)
            all_switches.append(switches)
        pd.concat(all_switches).to_csv(home / "disagreements.csv", index=False)


if __name__ == "__main__":
    main()
