"""Stages run in this process, in a folder of their own: no DVC, nothing of the working tree."""

import hashlib
import shutil
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import ROOT
from hydra.core.override_parser.overrides_parser import OverridesParser

from finloop.base.settings import settings
from finloop.drawn.carp.film import film_frames
from finloop.io.movie import VideoWriter
from finloop.io.parameters import refusal_error
from finloop.io.video import ARENA_NAME, CLIP_NAME, FACTS_NAME, VideoFacts, save_facts, save_mask
from stages.compose import compose_params
from stages.settings import CONF, PARAMS, list_problems
from stages.stamps import file_stamp


@cache  # composing takes Hydra a fifth of a second
def _compose(overrides: tuple[str, ...]) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return compose_params(["~local", *overrides])


def composed_once(overrides: Sequence[str]) -> str:
    """params.yaml as `python -m stages.compose` writes it in a repository without conf/local/."""
    return _compose(tuple(overrides))


A_FILM = ROOT / "docs/equations"  # a folder: what composing takes for a film


@cache
def _params(overrides: tuple[str, ...], folder: Path) -> str:
    """Options go by Hydra; plain values are laid over here, the film with its stamp."""
    plain = [one for one in overrides if "." in one.partition("=")[0]]
    options = [one for one in overrides if one not in plain]
    film = [f"clip.path={A_FILM}"] if "clip=file" in options else []
    values = yaml.load(_compose((*options, *film)), yaml.CSafeLoader)
    parser = OverridesParser.create()
    for one in plain:
        asked = parser.parse_override(one)
        word, key = asked.key_or_group.split(".")
        values[word][key] = asked.value()
    if film:
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            values["film_stamp"] = file_stamp("film_stamp", values)
    if problems := list_problems(values):
        raise refusal_error(problems)
    return yaml.dump(values, Dumper=yaml.CSafeDumper, sort_keys=False)


def prepare(folder: Path, *overrides: str) -> None:
    """Give `folder` conf/ and the params.yaml that `overrides` compose to."""
    (folder / PARAMS).write_text(_params(overrides, folder), encoding="utf-8")
    if not (folder / CONF).exists():
        (folder / CONF).symlink_to(ROOT / CONF)


def put_clip(
    folder: Path,
    frames: Sequence[np.ndarray],
    rate: int = 25,
    cuts: Sequence[int] = (),
    arena: np.ndarray | None = None,
) -> None:
    """Put what the stage `clip` makes of a film with these frames into `folder`."""
    height, width = frames[0].shape[:2]
    edges = [0, *cuts, len(frames)]
    facts = VideoFacts(
        "file", width, height, len(frames), Fraction(rate), frames[0].ndim == 3,
        tuple(zip(edges[:-1], edges[1:], strict=True)),
    )  # fmt: skip
    clip = folder / "data/clip"
    shutil.rmtree(clip, ignore_errors=True)
    write_frames(VideoWriter.from_facts(clip / CLIP_NAME, facts), frames)
    save_facts(clip / FACTS_NAME, facts)
    save_mask(clip / ARENA_NAME, np.ones((height, width), bool) if arena is None else arena)


def content(folder: Path) -> dict[str, str]:
    """Every file below a folder, hidden ones too, with its digest; empty if there is no folder."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def same_but_figures(first: dict[str, str], again: dict[str, str]) -> bool:
    """Whether a run with `no_drawing` made again what one without it had made.

    Its figures are empty files; that painted ones are the same again, tests/test_pipeline.py shows.
    """
    empty = hashlib.sha256(b"").hexdigest()
    drawn = {name for name, digest in again.items() if digest != empty}
    return first.keys() == again.keys() and all(first[name] == again[name] for name in drawn)


def write_frames(writer: Any, frames: Iterable[np.ndarray]) -> None:
    """Write a film as a whole."""
    with writer:
        for frame in frames:
            writer.write(frame)


def carp_frames(frames: int, **changes: Any) -> list[np.ndarray]:
    """The frames of a film of one drawn carp: small and grey, unless changes say otherwise."""
    small = {"width_px": 224, "height_px": 168, "body_length_px": 50.0, "colour": False, "fish": 1}
    film = settings("clip", source="carp", frames=frames, **small | changes)
    return [frame for frame, _ in film_frames(film)]


def save_svg(path: Path, inside: str) -> str:
    """Write a drawing of 99 by 99 px; return its path."""
    head = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 99 99">'
    path.write_text(f"{head}{inside}</svg>", "utf-8")
    return str(path)
