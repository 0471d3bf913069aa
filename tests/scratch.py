"""Stages run in this process, in a folder of their own: no DVC, nothing of the working tree."""

import hashlib
import shutil
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from finloop.files.video import (
    ARENA_NAME,
    CLIP_NAME,
    FACTS_NAME,
    VideoFacts,
    VideoWriter,
    save_facts,
    save_mask,
)
from stages.params import CONF, PARAMS
from stages.params.compose import composed


@cache  # composing takes Hydra a fifth of a second
def _params(overrides: tuple[str, ...]) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        return composed(list(overrides))


def prepare(folder: Path, *overrides: str) -> None:
    """Give `folder` a copy of conf/ and the params.yaml that `overrides` compose to."""
    (folder / PARAMS).write_text(_params(overrides), encoding="utf-8")
    shutil.copytree(ROOT / CONF, folder / CONF, dirs_exist_ok=True)


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
    with VideoWriter.of(clip / CLIP_NAME, facts) as writer:
        for frame in frames:
            writer.write(frame)
    save_facts(clip / FACTS_NAME, facts)
    save_mask(clip / ARENA_NAME, np.ones((height, width), bool) if arena is None else arena)


def content(folder: Path) -> dict[str, str]:
    """Every file below a folder, hidden ones too, with its digest; empty if there is no folder."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
