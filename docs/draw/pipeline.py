"""Running the stages of dvc.yaml in a scratch folder."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import yaml

from benchmarks.pipeline import ROOT, prepare_folder
from stages.code import stage_module

ENV = os.environ | {"PYTHONPATH": str(ROOT)}  # the program is not installed
BESIDE = ("data/drawings", "data/gaits", "benchmarks/table2.csv")  # tracked inputs of the stages


def run(folder: Path, values: Sequence[str], words: Sequence[str] = ()) -> None:
    """Run the stages `words`, or all of dvc.yaml, in `folder` with overridden values."""
    for name in BESIDE:
        there = folder / name
        there.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, there, dirs_exist_ok=True)
        else:
            shutil.copy2(ROOT / name, there)
    prepare_folder(folder, values)
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
    for word in words or stages:
        print(f"docs: stage {word}", file=sys.stderr)
        module = stage_module(word)
        done = subprocess.run(
            [sys.executable, "-m", module], cwd=folder, env=ENV, capture_output=True, text=True
        )
        if done.returncode:
            raise SystemExit(f"docs: {module} failed:\n{done.stderr}")
