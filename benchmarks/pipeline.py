"""The real stages, run in a scratch folder with some parameters overridden."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
STAGES = ("clip", "extract", "features")


def prepare(folder: Path, overrides: Sequence[str]) -> None:
    """Give `folder` a copy of conf/ and the params.yaml that `overrides` compose to."""
    if not (folder / "conf").exists():
        shutil.copytree(ROOT / "conf", folder / "conf")
        shutil.copytree(ROOT / "hydra_plugins", folder / "hydra_plugins")
    _python(folder, "stages.compose", *overrides)


def stage(folder: Path, word: str) -> dict[str, Any]:
    """Run one stage in `folder`; its metrics."""
    _python(folder, f"stages.{word}")
    return json.loads((folder / f"reports/{word}/metrics.json").read_text(encoding="utf-8"))


def _python(folder: Path, *arguments: str) -> None:
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", *arguments], cwd=folder, env=env, capture_output=True, text=True
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(arguments)} failed:\n{done.stderr}")
