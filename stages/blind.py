"""A blind test for people: `make blind` writes one page with pairs of film and animation.

It is a program that reads the stages' results, not a stage. It writes reports/blind/index.html,
which needs no network: docs/blind.md. With the answer files of people, it says how many were right.
"""

from stages.run import report_progress, run  # isort: skip  (before numpy)

import argparse
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import numpy as np
import pandas as pd

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.edit.modes import RETARGET, Mode
from finloop.edit.schema import EDIT, split_by_fish
from finloop.io.atomic import save_bytes
from finloop.io.movie import Mp4Writer
from finloop.io.table import load_table
from finloop.io.video import CLIP_NAME, read_frames
from finloop.project import Project
from finloop.realism.blind import (
    ANSWERS,
    SECONDS,
    SIDES,
    BlindPair,
    BlindSource,
    Score,
    build_blind_page,
    choose_pairs,
    join_halves,
    score_answers,
)
from finloop.render.gallery import fish_by_tick
from finloop.render.painter import Painter, Shadow
from finloop.render.settings import RenderSettings
from stages.settings import load_settings

PAGE = Path("reports/blind/index.html")
_LONGEST_HEAD = 1000  # bytes of the first line of an answer file
MOST_BYTES = 20e6  # of the page
CRFS = (14, 18, 22, 26, 30, 34, 38, 42, 46, 50)  # the first by which a pair becomes small enough


def main() -> None:
    """Write the page, or score answer files, as the command line says."""
    options = _build_parser().parse_args()
    if options.answers:
        print(describe_answers([Path(name) for name in shlex.split(options.answers)]))
        return
    p: RenderSettings = load_settings("render")
    with Project() as project:
        write_page(options.mode or p.mode, options.seed, p, project)


# --- the page


def write_page(mode: str, seed: int, p: RenderSettings, project: Project) -> None:
    """Write the page of a blind test of a mode. FinloopError if the film is too short for one."""
    edits = load_edit_lists(mode, project)
    rate, scale = project.rate_hz, project.drawn_scale(mode)
    ticks = max(2, round(SECONDS * rate))
    length_px = project.scene.typical_length_px
    shape = project.facts.height_px, project.facts.width_px
    names = {"track_id": "animal", "frame": "tick"}
    film = project.features[[*names, "x_px", "y_px"]].rename(columns=names).assign(scene=0)
    drawn = pd.concat([edit.assign(scene=scene) for scene, edit in enumerate(edits)])
    drawn = drawn.rename(columns={"fish": "animal"})
    pairs = choose_pairs(
        BlindSource(film, length_px, shape),
        BlindSource(drawn.reset_index(drop=True), length_px * scale, shape),
        ticks, seed,
    )  # fmt: skip
    tank = project.background
    around = np.rint(tank.mean(axis=(0, 1))).astype(np.uint8).reshape(-1)  # a level, or a colour
    shadow = Shadow(p.shadow_darkness, p.shadow_blur * length_px * scale)
    films, coarsest = list[bytes](), 0
    with report_progress("blind", len(pairs), "pairs") as advance:
        for pair in pairs:
            frames = list(
                join_halves(
                    _film_frames(pair, ticks, project),
                    _animation_frames(pair, ticks, edits, shadow, project),
                    pair,
                    around,
                )
            )
            content, crf = _code_film(frames, project, MOST_BYTES / len(pairs))
            films.append(content)
            coarsest = max(coarsest, crf)
            advance()
    page = build_blind_page(films, [pair.side for pair in pairs], mode, rate, seed)
    save_bytes(PAGE, page.encode())
    print(
        f"blind: {PAGE} has {len(pairs)} pairs of film and {mode}, {len(page) / 1e6:.1f} MB, "
        f"coded with CRF {CRFS[0]} to {coarsest}"
    )


def load_edit_lists(mode: str, project: Project) -> list[pd.DataFrame]:
    """Return the edit lists of a mode: the animation, and the samples for `realism` if any.

    FinloopError if the mode has no animation.
    """
    try:
        edit = project.edit_list(mode, "blind")
    except FinloopError as error:  # the mode is no parameter of a stage
        raise FinloopError(*(part.replace("blind.mode", "MODE") for part in error.args)) from error
    samples = project.data / "animate" / mode / "samples.parquet"
    return [edit, *(split_by_fish(load_table(samples, EDIT)) if samples.exists() else [])]


def _film_frames(pair: BlindPair, ticks: int, project: Project) -> Iterator[Picture]:
    """Yield the clip's frames of a pair's stretch of film."""
    first, clip = pair.film.stretch.first, project.data / "clip" / CLIP_NAME
    yield from read_frames(clip, colour=project.facts.colour, start=first, stop=first + ticks)


def _animation_frames(
    pair: BlindPair, ticks: int, edits: Sequence[pd.DataFrame], shadow: Shadow, project: Project
) -> Iterator[Picture]:
    """Yield the frames of a pair's stretch of animation, with the film's grain and light.

    Otherwise they are drawn as the stage `render` draws them.
    """
    first, edit = pair.animation.stretch.first, edits[pair.animation.stretch.scene]
    part = edit[edit["tick"].between(first, first + ticks - 1)]
    part = part.assign(tick=part["tick"] - first)
    painter = Painter(project.background, shadow=shadow, tank=project.living_tank("film"))
    for tick, fish in enumerate(fish_by_tick(part, project.whole_gallery), start=first):
        painter.show(*fish, tick=tick)
        yield painter.frame


def _code_film(frames: Sequence[Picture], project: Project, page_bytes: float) -> tuple[bytes, int]:
    """Return the MP4 of a pair, and the CRF by which it fits; page_bytes: its room on the page."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "pair.mp4"
        for crf in CRFS:
            with Mp4Writer(path, frames[0].shape, project.facts.frame_rate, crf) as writer:
                for frame in frames:
                    writer.write(frame)
            content = path.read_bytes()
            if len(content) * 4 / 3 < page_bytes - 500:  # as text of the page, beside its program
                break
    return content, crf


# --- the answers


def describe_answers(paths: Sequence[Path]) -> str:
    """Return a line for each answer file, and one for all if there are several."""
    counts = {path: _count_answers(path) for path in paths}
    lines = [f"{path.name}: {_describe_score(score_answers(*n))}" for path, n in counts.items()]
    if len(paths) > 1:
        right, answers = map(sum, zip(*counts.values(), strict=True))
        lines.append(f"all {len(paths)}: {_describe_score(score_answers(right, answers))}")
    return "\n".join(lines)


def _count_answers(path: Path) -> tuple[int, int]:
    """Return how many answers of a file are right, and how many there are.

    FinloopError if the file is no answer file, or contradicts itself.
    """
    advice = "take the file that the page's button “Save the answers” wrote"
    wanted = f"a CSV file with the columns {', '.join(ANSWERS)}, a row for each answer"
    try:
        with path.open("rb") as file:
            if len(file.readline(_LONGEST_HEAD)) == _LONGEST_HEAD:
                raise ValueError("its first line is too long")
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise FinloopError(f"{path} cannot be read: {error}", wanted, advice) from error
    if tuple(table.columns) != ANSWERS or table.empty:
        raise FinloopError(f"{path} is no answer file", wanted, advice)
    is_right = table["side"] == table["answer"]
    sides_known = table[["side", "answer"]].isin(SIDES).all(axis=None)
    if not sides_known or (is_right != table["right"].astype(bool)).any():
        raise FinloopError(f"{path} contradicts itself, or names another side", wanted, advice)
    return int(is_right.sum()), len(table)


def _describe_score(score: Score) -> str:
    """Return number, share and interval of right answers, and what they mean, as a text."""
    share = f"{score.right} of {score.answers} right, {score.right / score.answers:.0%}"
    return f"{share} (95 % interval {score.low:.0%} to {score.high:.0%}). {score.sentence}"


def _build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m stages.blind", description="A blind test: film or animation?"
    )
    add = parser.add_argument
    add("--mode", choices=("", *get_args(Mode), RETARGET), help="default: render.mode")
    add("--seed", type=int, default=0, help="of the choice of pairs and sides; default 0")
    add("--answers", default="", help="answer files, to score them instead")
    return parser


if __name__ == "__main__":
    run(main)
